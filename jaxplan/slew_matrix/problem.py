"""The planning problems between goals: the state in which a slew leaves a goal, and what it goes to.

Each goal has a **state** at each departure. A `GivenState` is its own state. That of `Targets` is found by
step 1 (decomposition) from a reference state: of all states that meet the targets it is the one turned least
from the reference's attitude, unless the targets name another criterion, and devices without a target keep
the reference's joints where zones allow it. It depends on goal, reference and zones only, never on the goal
before, so that slews can be put one after another. What wheels store is stated for the reference; in any
other state they hold what the total momentum, constant in inertial axes, leaves to them there.

Directions **that move** are known over times from 0 on, the time of the scene. For a slew that departs at
``t`` all paths are shifted by ``-t``, and the epoch is ``t`` later, so that its own time begins at 0. The
state of moving targets is the one at departure, with the rates at which it follows them. Targets that stand
still have one state for all departures, for which only zones that stand still are considered; planning a slew
shows whether the others allow that state.

A slew **goes to** the state of its goal. Only where the targets move, or a `free` end is asked for, it goes
to any state that meets them when it ends. Radians, seconds; attitudes are body to inertial.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.model.goals import LEAST_ROTATION, GivenState, Targets
from jaxplan.model.hidden_spans import rounded_up
from jaxplan.model.scenario import Scenario, known_until, paths, seen_from
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.time_shift import later, later_goal
from jaxplan.model.zones import JointBound, KeepIn, KeepOut, Zone
from jaxplan.planner.entry_points import as_filed
from jaxplan.planner.messages import FOR_LONGER
from jaxplan.planner.record import Plan, end_rates
from jaxplan.planner.steps import find_goals
from jaxplan.planner.validity import hidden_targets, start_breaches
from jaxplan.runtime.arguments import expect, expect_any, floats, several
from jaxplan.runtime.display import shown
from jaxplan.schema import ScenarioError, with_settings
from jaxplan.schema.reading import checked_spacecraft
from jaxplan.slew_matrix.wheel_loads import loaded, overload_text

AnyZone = TypeVar("AnyZone", KeepOut, KeepIn, JointBound)
_MAX_PAIRS = 2**31  # there must be fewer pairs, since a study numbers its scenes with 32 bits


class Unmet(NamedTuple):
    """The reason why a goal has no state: the name of a `Status`, and a message for the user."""

    status: str
    message: str


@shown("names", "departures s", "free")
@dataclass(frozen=True, kw_only=True, eq=False)
class SlewProblem:
    """Goals of a spacecraft among zones, between which slews are to be planned.

    Attributes:
        scene: spacecraft, zones, settings and epoch; its start is the reference from which states are found,
            and in which wheels hold what they store.
        names: (n,) names of the goals.
        goals: (n,) the goals.
        departures: (k,) s, when slews depart, in the scene's time; None where they depart at time 0 only.
        free: whether slews go to any state that meets the targets of their goal.
    """

    scene: Scenario
    names: tuple[str, ...]
    goals: tuple[GivenState | Targets, ...]
    departures: np.ndarray | None
    free: bool

    @property
    def times(self) -> np.ndarray:
        """Departures (k,) in s; the scene's time 0 where none are given."""
        return np.zeros(1) if self.departures is None else self.departures

    @cached_property
    def scenes(self) -> tuple[Scenario, ...]:
        """The scene at each of the k departures, with what moves and the epoch counted from there."""
        return tuple(later(self.scene, float(time)) for time in self.times)

    @cached_property
    def states(self) -> tuple[tuple[GivenState | Unmet, ...], ...]:
        """The state of each goal at each departure, or the reason why there is none: k rows of n."""
        quiet = _drop_moving_zones(self.scene)
        fixed = [None if goal.moves else self._find_state(quiet, goal) for goal in self.goals]
        return tuple(
            tuple(
                (
                    _hidden_at(self.scene, goal, float(time))
                    or self._find_state(scene, later_goal(goal, float(time)))
                )
                if own is None
                else own
                for goal, own in zip(self.goals, fixed, strict=True)
            )
            for scene, time in zip(self.scenes, self.times, strict=True)
        )

    def _find_state(self, scene: Scenario, goal: GivenState | Targets) -> GivenState | Unmet:
        """Find the state of a goal at a scene's time 0; or the reason why not, such as wheels full there."""
        state = _find_state(scene, goal)
        if isinstance(state, Unmet):
            return state
        full = overload_text(replace(scene, spacecraft=loaded(self.scene, state)))
        return Unmet("LIMITS_TOO_TIGHT", full) if full else state

    def goes_to(self, departure: int, goal: int) -> GivenState | Targets | Unmet:
        """What slews to a goal go to: a state, or targets; or the reason why there is none.

        Args:
            departure: index of the departure.
            goal: index of the goal.
        """
        asked = self.goals[goal]
        if isinstance(asked, Targets) and (self.free or asked.moves):
            return later_goal(asked, float(self.times[departure]))
        return self.states[departure][goal]

    def unmet(self, departure: int, first: int, second: int) -> Unmet | None:
        """Say why there is no planning problem for a slew from one goal to another; None where there is one.

        All arguments are indices.
        """
        for name, end in (
            (self.names[first], self.states[departure][first]),
            (self.names[second], self.goes_to(departure, second)),
        ):
            if isinstance(end, Unmet):
                return Unmet(end.status, f"{name}: {end.message}")
        return None

    def scenario(self, departure: int, first: int, second: int) -> Scenario:
        """Make the planning problem of a slew from one goal to another; `unmet` must be None for it.

        All arguments are indices.
        """
        start, goal = self.states[departure][first], self.goes_to(departure, second)
        assert not isinstance(start, Unmet)
        assert not isinstance(goal, Unmet)
        when = "" if self.departures is None else f" at {self.departures[departure]:g} s"
        name = f"{self.names[first]} to {self.names[second]}{when}"
        craft = loaded(self.scene, start)
        return replace(self.scenes[departure], name=name, spacecraft=craft, start=start, goal=goal)

    def stay(self, departure: int, goal: int) -> Unmet | None:
        """Say why the spacecraft cannot be in the state of a goal at a departure; None where it can.

        It cannot if there is no such state, or if the state violates limits or zones. Arguments are indices.
        """
        state = self.states[departure][goal]
        if isinstance(state, Unmet):
            return self.unmet(departure, goal, goal)
        scene = replace(self.scenes[departure], spacecraft=loaded(self.scene, state))
        broken = start_breaches(replace(scene, start=state, goal=state))
        return Unmet("INVALID_START", f"{self.names[goal]}: {'; '.join(broken)}") if broken else None


def _hidden_at(scene: Scenario, goal: GivenState | Targets, time: float) -> Unmet | None:
    """Say that targets of a goal are hidden at a departure, s, and which one to take; None if all are seen.

    Times are those of the scene, as departures are, and not those of a slew, whose duration helps nothing.
    """
    asked = replace(scene, goal=goal)
    unseen = hidden_targets(asked, time, "at the departure")
    if not unseen:
        return None
    seen, (known, _) = seen_from(asked, time), known_until(asked)
    advice = f"take a departure at {rounded_up(seen)} s or later" if seen < known else FOR_LONGER
    return Unmet("INVALID_GOAL", f"{'; '.join(unseen)}: {advice}")


def _find_state(scene: Scenario, goal: GivenState | Targets) -> GivenState | Unmet:
    """Find the state of a goal at a scene's time 0, by step 1 from its start; or the reason why not."""
    if isinstance(goal, GivenState):
        return goal
    asked = replace(scene, goal=replace(goal, criterion=goal.criterion or LEAST_ROTATION))
    found = find_goals(asked, 0.0)
    if isinstance(found, Plan):
        return Unmet(found.status.name, found.message)
    spin, rates = end_rates(asked, found[0])
    return GivenState(
        rotation_vector=np.asarray(so3.log(found[0].attitude)),
        joints=np.asarray(found[0].joints),
        angular_velocity=np.asarray(spin),
        joint_rates=np.asarray(rates),
    )


def _drop_moving_zones(scene: Scenario) -> Scenario:
    """The scene without moving zones; a group of zones (`any_of`) with a moving one is left out."""
    every: tuple[Zone, ...] = (*scene.keep_out, *scene.keep_in, *scene.joint_bounds)
    moving = {zone.any_of for zone in every if zone.moves}

    def still(zones: Iterable[AnyZone]) -> tuple[AnyZone, ...]:
        alone = (zone for zone in zones if not zone.moves)
        return tuple(zone for zone in alone if zone.any_of is None or zone.any_of not in moving)

    return replace(
        scene,
        keep_out=still(scene.keep_out),
        keep_in=still(scene.keep_in),
        joint_bounds=still(scene.joint_bounds),
    )


def make_problem(
    problem: Spacecraft | Scenario,
    goals: Mapping[str, Any] | Sequence[Any],
    *,
    zones: Mapping[str, Sequence[Any]],
    departures: ArrayLike | None,
    start: GivenState | None,
    free: bool,
    settings: Mapping[str, Any] | None,
) -> SlewProblem:
    """Check the arguments of `slew_times` of the same names, and make its problem.

    Args:
        problem: see `slew_times`; likewise the others but for `zones`.
        goals: see there.
        zones: keep_out, keep_in and joint_bounds by these names.
        departures: see there.
        start: see there.
        free: see there.
        settings: see there.

    Raises:
        TypeError: for arguments of the wrong type.
        ScenarioError: for values that a scenario file may not have, with every fault.
        ValueError: for zones given with a scenario, departures at which something is not known, and a
            duration that is a number.
    """
    if not isinstance(free, bool):
        raise TypeError(f"free must be True or False, not {free!r}")
    scene = _make_scene(problem, zones, start)
    scene = with_settings(scene, {"trajectory.duration_s": "minimum", **_check_settings(settings)})
    if scene.trajectory.timed:
        raise ValueError(
            f"settings: trajectory.duration_s = {scene.trajectory.duration:g}: "
            'must be "minimum" or "stretched", since the times are to be found'
        )
    named = _name_goals(goals)
    checked = [_check_goal(scene, name, goal) for name, goal in named.items()]
    when = None if departures is None else _check_departures(scene, named, checked, departures)
    pairs = len(checked) * (len(checked) - 1) * (1 if when is None else len(when))
    if pairs >= _MAX_PAIRS:
        raise ValueError(f"goals and departures make {pairs} pairs: must be less than {_MAX_PAIRS}")
    return SlewProblem(scene=scene, names=tuple(named), goals=tuple(checked), departures=when, free=free)


def _check_settings(settings: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Settings as a dict, empty for None; raises a TypeError for anything else."""
    if settings is not None and not isinstance(settings, Mapping):
        raise TypeError(
            f'settings must be a dict such as {{"search.seed": 1}}, not {type(settings).__name__}'
        )
    return settings or {}


def _make_scene(
    problem: Spacecraft | Scenario, zones: Mapping[str, Sequence[Any]], start: GivenState | None
) -> Scenario:
    """Make the scene with the reference as its start, and check it.

    Args:
        problem: a scenario, or a spacecraft to which the zones belong.
        zones: keep_out, keep_in and joint_bounds by these names.
        start: the reference; None for the usual one, see `slew_times`.

    Returns:
        The scene; its goal is its start, which stands in until a pair's goal replaces it.
    """
    expect_any("problem", problem, (Spacecraft, Scenario), "a Spacecraft or a Scenario")
    if start is not None:
        expect("start", start, GivenState, "jp.point makes one that points somewhere")
    every: dict[str, Any] = {name: tuple(several(name, each, "zones")) for name, each in zones.items()}
    if isinstance(problem, Scenario):
        given = [name for name, each in every.items() if each]
        if given:
            raise ValueError(f"{given[0]}: the scenario has zones of its own; give these to it")
        reference = problem.start if start is None else start
        return _checked("problem", replace(problem, start=reference, goal=reference))
    craft = checked_spacecraft(problem)
    rest = np.clip(np.zeros(craft.joint_count), *craft.joint_ranges.T)
    reference = GivenState(rotation_vector=np.zeros(3), joints=rest) if start is None else start
    return _checked(
        "the scene", Scenario(name="slew times", spacecraft=craft, start=reference, goal=reference, **every)
    )


def _checked(name: str, scene: Scenario) -> Scenario:
    """Check a scene whose goal is its start; faults of this goal are left out, which nobody gave.

    Args:
        name: of the scene, for messages.
        scene: with a start in place of its goal.

    Raises:
        ScenarioError: for values that a scenario file may not have, with every fault.
    """
    try:
        return as_filed(name, scene)
    except ScenarioError as error:
        own = [one for one in error.faults if not one.startswith("goal.")]
        raise ScenarioError(own or error.faults, name) from error


def _name_goals(goals: Mapping[str, Any] | Sequence[Any]) -> dict[str, Any]:
    """Goals by name; those of a sequence are named by their index.

    Raises:
        TypeError: for a name that is not a text, or goals of the wrong type.
        ValueError: for a name that is empty, too long or not printable, or if there are no goals.
    """
    if isinstance(goals, Mapping):
        named = dict(goals)
        for name in named:
            expect("a name in goals", name, str)
            if not name or len(name) > 100 or not name.isprintable():
                raise ValueError(f"goals: the name {name[:100]!r} must have 1 to 100 characters that print")
    else:
        named = {str(place): goal for place, goal in enumerate(several("goals", goals, "goals"))}
    if not named:
        raise ValueError("goals is empty: there is nothing to go to")
    return named


def _check_goal(scene: Scenario, name: str, goal: Any) -> GivenState | Targets:
    """Check a goal as a scenario file is checked; a dict becomes `Targets`. Errors name the goal."""
    where = f"goals[{name!r}]"
    expect_any(where, goal, (GivenState, Targets, Mapping), "a GivenState, Targets, or a dict by devices")
    asked = Targets.of(goal) if isinstance(goal, Mapping) else goal
    return as_filed(where, replace(scene, goal=asked)).goal


def _check_departures(
    scene: Scenario,
    named: Iterable[str],
    goals: Sequence[GivenState | Targets],
    departures: ArrayLike,
) -> np.ndarray:
    """Check departures, and return them as (k,) s.

    Raises:
        ValueError: unless they rise within [0, 1e7], and all that moves in scene and goals is known beyond
            them.
    """
    times = floats("departures", departures, "an array of numbers of seconds")
    if times.ndim != 1 or not len(times):
        raise ValueError(f"departures: must be of shape (k,) with k at least 1, not {times.shape}")
    known = {what: float(path.times[-1]) for what, path in paths(scene)}
    known |= {f"zone {zone.name}": zone.lasts for zone in scene.zones if zone.lasts < np.inf}
    for name, goal in zip(named, goals, strict=True):
        own = paths(replace(scene, goal=goal))
        known |= {f"{what}, of goal {name}": float(path.times[-1]) for what, path in own}
    for place, time in enumerate(times):
        if not 0 <= time <= 1e7:
            raise ValueError(f"departures[{place}] = {time:g}: must lie in [0, 1e7] s")
        if place and not time > times[place - 1]:
            raise ValueError(f"departures[{place}] = {time:g}: must be later than {times[place - 1]:g}")
        for what, last in known.items():
            if not time < last:
                raise ValueError(
                    f"departures[{place}] = {time:g}: must be earlier than {last:g} s, until "
                    f"when {what} is known"
                )
    return times
