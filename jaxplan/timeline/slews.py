"""Slews between the motions of activities; each ends in the state, rates and accelerations of what follows.

A slew leads from one state to another at given times. It is fitted along the straight path first; if that
cannot be proved safe, it is planned with a search, like any manoeuvre. Its duration is the time that there
is, or the shortest. The latter is sought upwards from the lower bound: first a time a little above it, then
what the fit says is needed; with ``trajectory.optimal`` what the optimum takes or, if an end of the slew
moves, a fixed multiple of the bound, a *rung*. The state in which the slew ends depends on when that is, so
each duration that is tried has a goal of its own.

A *way* is a path past zones. Attitudes are (3, 3) body to inertial.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.certificate import LIMIT_ALLOWANCE, Certificate, faults_later
from jaxplan.model.duration_bound import DurationBound, duration_bound
from jaxplan.model.goals import GivenState
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import MINIMUM, Scenario, moves
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.model.time_shift import later
from jaxplan.planner.clock import Clock
from jaxplan.planner.record import Plan
from jaxplan.planner.rounds import plan_in_rounds
from jaxplan.planner.steps import fit
from jaxplan.timeline import curves, proving
from jaxplan.timeline.choices import BOUND, NEEDED, SEEN, SlewTime
from jaxplan.timeline.tracking import State
from jaxplan.trajectory import Fit, Trajectory
from jaxplan.trajectory.fit import too_tight
from jaxplan.trajectory.peaks import peaks

_FIRST_FACTOR = 1.03  # times the bound: the first duration that is tried
_FIRST_SLACK = 0.3  # s, least by which it exceeds the bound, since accelerations begin and end at zero
_MIN_FACTOR = 1.004  # times the bound, below which a duration is not worth a try
_NEEDED_FACTOR = 1.003  # times the time needed to one goal: given to reach the goal at another time
_RUNG_RATIO = 1.01  # times the rung below; rungs are multiples of the bound, where no optimum tells the time
_GROWTH_FACTORS = (1.02, 1.04, 1.08, 1.15, 1.3, 1.6)  # least factors from each try to the next
_MIN_INCREASE = 0.05  # s, likewise the least increase
FIRST = 10.0  # s, duration for which the first goal is found
LEAST = 0.5  # s, least duration of any slew
_BLOCKED_FACTOR = 1.3  # times the duration that was tried; a straight slew that needs more counts as blocked


@dataclass(frozen=True, kw_only=True, eq=False)
class Slew:
    """A slew, or why there is none.

    Attributes:
        status: how planning it ended.
        message: what is in the way, and what to change; empty if it is planned.
        duration: s, planned or asked for.
        needed: s, a duration that is long enough if that one is too short; None if unknown.
        blocked: whether it failed for another reason than a duration a little too short, such as a zone.
        trajectory: the slew, its time zero at its start; None if it failed.
        goal: what follows the slew, as the caller's function `goal_at` gave it.
        proof: certificate of the trajectory, also of one that could not be certified; None without any.
        time: how the duration came about, for slews in the shortest time; else None.
    """

    status: Status
    message: str
    duration: float
    needed: float | None = None
    blocked: bool = False
    trajectory: Trajectory | None = None
    goal: Any = None
    proof: Certificate | None = None
    time: SlewTime | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Departure:
    """The state and time from which slews start.

    Attributes:
        scene: zones and settings, in the timeline's times.
        craft: the spacecraft, with what its wheels hold at the start.
        state: the state at the start.
        time: s of the start, in the timeline's times.
    """

    scene: Scenario
    craft: Spacecraft
    state: State
    time: float

    def in_time(self, goal: State, duration: float) -> Slew:
        """Return the slew to a state in a given duration, s; one that is blocked is planned with a search."""
        straight = self._slew_along(None, goal, duration)
        if straight.trajectory is not None or not straight.blocked:
            return straight
        plan = self._plan_with_search(goal, duration)
        if plan.trajectory is None or not plan.ok:
            return Slew(status=plan.status, message=self._failure_text(plan), duration=duration)
        return self._prove_fit(goal, plan.trajectory)

    def _slew_along(
        self, way: Path | None, goal: State, duration: float, craft: Spacecraft | None = None
    ) -> Slew:
        """Return the slew to a state in a given duration, s, along a way to a nearby state; None is straight.

        The accelerations added at the ends may exceed limits that the fit has used in full. Then the slew is
        fitted again for a spacecraft with limits that are smaller by as much, `craft`, and proved for the
        real one.
        """
        path = _straight_path(self.state, goal) if way is None else _replace_last_node(way, goal)
        scenario = self.scenario(goal, duration)
        if craft is not None:
            scenario = replace(scenario, spacecraft=craft)
        fitted = fit(scenario, path, _goal_of_slew(self.state, goal, duration))
        if fitted.status is Status.OK and fitted.trajectory is not None:
            slew = self._prove_fit(goal, fitted.trajectory)
            if (
                slew.trajectory is None
                and craft is None
                and (over := _peak_over_limit(slew.proof, _ACCELERATION_NAMES)) > 1
            ):
                eased = self._slew_along(
                    way, goal, duration, _ease_accelerations(self.craft, 1 + _EASING_FACTOR * (over - 1))
                )
                slew = slew if eased.trajectory is None else eased
            return slew
        needed, text = fitted.needed_duration, self._failure_text(fitted)
        blocked = needed is None or needed > _BLOCKED_FACTOR * max(duration, self.bound(goal))
        return Slew(status=fitted.status, message=text, duration=duration, needed=needed, blocked=blocked)

    def _prove_fit(self, goal: State, fitted: Trajectory) -> Slew:
        """Return a slew from a fit, with the accelerations of both ends added, and its certificate.

        If they make a rate exceed its limit, they are added over a shorter time.
        """
        ends = (self.state.acceleration, self.state.bends), (goal.acceleration, goal.bends)
        for share in _END_SHARES:
            made = curves.bent(fitted, ends, share)
            proof = proving.certify_part(self.scene, self.time, made, self.craft)
            if proof.certified or not _peak_over_limit(proof, _RATE_NAMES) > 1:
                break
        if not proof.certified:
            text = _tell_faults(faults_later(proof, self.time), proof)
            blocked = proof.min_margin is None or not proof.min_margin >= 0
            return Slew(
                status=Status.UNCERTIFIED, message=text, duration=made.duration, blocked=blocked, proof=proof
            )
        return Slew(status=Status.OK, message="", trajectory=made, duration=made.duration, proof=proof)

    def shortest(
        self,
        goal_at: Callable[[float], tuple[State, Any]],
        seen_from: Callable[[float], float],
        last: float = np.inf,
    ) -> Slew:
        """Find the shortest slew to a goal that depends on when it is reached.

        Args:
            goal_at: given a time, s, in the timeline's times, returns the goal state then, and anything that
                the caller wants to find in `Slew.goal`.
            seen_from: given such a time, returns the first one at or after it at which there is a goal.
            last: s, the last such time at which there is a goal.
        """

        def admitted(time: SlewTime) -> SlewTime:
            begin = self.time + max(time.seconds, LEAST)
            seen = seen_from(begin)
            own = time if time.seconds >= LEAST else SlewTime.fixed(LEAST)
            if seen > begin:
                own = SlewTime(seconds=0.0, kind=SEEN, factor=1.0)
            return replace(own, seconds=seen - self.time)

        time = admitted(SlewTime.fixed(min(FIRST, last - self.time)))
        state, found = goal_at(self.time + time.seconds)
        time = admitted(self._first_duration(state, time, found))
        failed: Slew | None = None
        way: Path | None = None
        shortest: Trajectory | None = None
        for growth in _GROWTH_FACTORS:
            duration = time.seconds
            state, found = goal_at(self.time + duration)
            if duration < _MIN_FACTOR * self.bound(state):
                time = admitted(self._first_duration(state, time, found))
                duration = time.seconds
                state, found = goal_at(self.time + duration)
            slew = self._slew_along(way, state, duration)
            if slew.trajectory is not None:
                return replace(slew, goal=found, time=time)
            failed = failed or slew
            needed = self._needed_duration(way, state, slew.needed)
            if slew.blocked and way is None:
                quickest = self._plan_with_search(state, MINIMUM)
                if quickest.path is None or quickest.trajectory is None or not quickest.ok:
                    if needed is None:
                        return replace(slew, status=quickest.status, message=self._failure_text(quickest))
                elif needed is None or quickest.trajectory.duration < needed:
                    way, shortest = quickest.path, quickest.trajectory
                    needed = shortest.duration
            elif slew.status not in _PERHAPS_TOO_SHORT:
                return slew
            enough = SlewTime(
                seconds=_NEEDED_FACTOR * (needed or 0.0),
                kind=NEEDED,
                factor=_NEEDED_FACTOR,
                goal=state,
                after=time,
                path=way,
                shortest=shortest,
                motion=found,
            )
            if self.scene.trajectory.optimal and not self._has_optimum(state):
                enough = self._raise_to_rung(enough)
            longer = (enough, time.longer(growth, 0.0), time.longer(1.0, _MIN_INCREASE))
            time, shortest = admitted(max(longer, key=lambda one: one.seconds)), None
        assert failed is not None
        return failed

    def _needed_duration(self, way: Path | None, goal: State, needed: float | None) -> float | None:
        """Return the duration needed to a state, s: with `trajectory.optimal` that of the optimum, if known.

        Otherwise it is `needed`, what a fit along `way` has said.
        """
        if needed is None or not (self.scene.trajectory.optimal and self._has_optimum(goal)):
            return needed
        fitted = self._fit_shortest(way, goal)
        found = fitted.trajectory is not None and fitted.status is Status.OK
        return fitted.trajectory.duration if found and fitted.trajectory is not None else needed

    def _has_optimum(self, goal: State) -> bool:
        """Tell whether the optimal motion to a state can be computed: at rest at both ends, nothing moves."""
        return self.at_rest(goal) and not moves(self.scene)

    def _raise_to_rung(self, enough: SlewTime) -> SlewTime:
        """Raise a duration to the next rung, which is a power of `_RUNG_RATIO` times the lower bound.

        What a fit says is needed may change slightly from one fit to the next. Rungs do not, so the duration
        is a function of both ends.
        """
        assert enough.goal is not None
        bound = self.bound(enough.goal)
        if not 0 < bound < enough.seconds:
            return enough
        factor = _RUNG_RATIO ** int(np.ceil(np.log(enough.seconds / bound) / np.log(_RUNG_RATIO)))
        own = replace(enough, seconds=bound, kind=BOUND, factor=1.0, path=None, shortest=None)
        return own.longer(factor, 0.0)

    def _fit_shortest(self, way: Path | None, goal: State) -> Fit:
        """Fit the shortest motion to a state along a way; None is straight."""
        path = _straight_path(self.state, goal) if way is None else _replace_last_node(way, goal)
        return fit(self.scenario(goal, MINIMUM), path, _goal_of_slew(self.state, goal, 0.0))

    def at_rest(self, goal: State) -> bool:
        """Tell whether slews to a state begin and end at rest."""
        return not any(np.any(one.velocity) or np.any(one.rates) for one in (self.state, goal))

    def shortest_plan(self, time: SlewTime) -> Plan:
        """Return the shortest motion on which a duration is based, as a manoeuvre's plan, not certified."""
        assert time.goal is not None
        goal, way, found = time.goal, time.path, time.shortest
        if found is None:
            found = self._fit_shortest(way, goal).trajectory
        return Plan(
            scenario=self.scenario(goal, MINIMUM),
            status=Status.INFEASIBLE if found is None else Status.OK,
            goal=_goal_of_slew(self.state, goal, 0.0),
            path=_straight_path(self.state, goal) if way is None else _replace_last_node(way, goal),
            trajectory=found,
        )

    def _plan_with_search(self, goal: State, duration: Any) -> Plan:
        """Plan the slew to a state as a manoeuvre with a search.

        `duration` is in s, or a word such as "minimum".
        """
        scenario = self.scenario(goal, duration)
        return plan_in_rounds([scenario], [Clock(scenario.search.time_limit)])[0]

    def _failure_text(self, found: Fit | Plan) -> str:
        """Return text on why a fit or a plan failed, for timelines, where no duration of a slew is set."""
        trajectory = found.trajectory
        if found.status is Status.LIMITS_TOO_TIGHT and trajectory is not None:
            own = peaks(trajectory, self._usable_craft)
            needed = found.needed_duration if isinstance(found, Fit) else None
            enough = f"no longer slew was found that keeps all limits: {_OTHER_ADVICE}"
            if needed is not None:
                enough = f"this way takes about {needed:.2f} s: {_LATER_ADVICE}"
            if np.isfinite(own.stretch):
                return too_tight(trajectory.duration, own, enough, "")
        if isinstance(found, Plan) and found.certificate is not None:
            return _tell_faults(found.certificate.faults, found.certificate)
        reason, of_settings, _ = found.message.partition(": set trajectory")
        return f"{reason}: {_OTHER_ADVICE}" if of_settings else reason

    @property
    def _usable_craft(self) -> Spacecraft:
        """The spacecraft with the ranges and limits that a plan may use."""
        return replace(self.scene, spacecraft=self.craft).usable

    def bound(self, goal: State) -> float:
        """Strict lower bound, s, of the duration of slews to a state; it takes no account of zones."""
        return self.limiting(goal).seconds

    def limiting(self, goal: State) -> DurationBound:
        """The lower bound of `bound`, with the name of what sets it."""
        pairs = [(getattr(self.state, name), getattr(goal, name)) for name in _BOUND_FIELDS]
        return duration_bound(self.craft, *(np.stack(pair) for pair in pairs))

    def _first_duration(self, goal: State, after: SlewTime, motion: Any) -> SlewTime:
        """Return the first duration to try for a state, a little above its lower bound.

        `after` is the duration after which this state is the goal, and `motion` what follows it.
        """
        bound = self.bound(goal)
        above = SlewTime(seconds=bound, kind=BOUND, factor=1.0, goal=goal, after=after, motion=motion)
        return max(
            above.longer(_FIRST_FACTOR, 0.0), above.longer(1.0, _FIRST_SLACK), key=lambda one: one.seconds
        )

    def scenario(self, goal: State, duration: Any) -> Scenario:
        """Return the problem of a slew to a state; `duration` is in s, or a word such as "minimum"."""
        scene = later(self.scene, self.time, None if isinstance(duration, str) else duration)
        tube = scene.trajectory.node_tube
        settings = replace(
            scene.trajectory,
            duration=duration,
            method="global",
            end_acceleration="zero",
            node_tube=np.inf if tube is None else tube,
            first_guesses=0,
        )
        return replace(
            scene,
            name=f"slew at {self.time:.2f} s",
            spacecraft=self.craft,
            start=_given_state(self.state),
            goal=_given_state(goal),
            trajectory=settings,
        )


# What a user may change, in timelines.
_LATER_ADVICE = "let it begin later, what comes before end sooner, or raise that limit"
_OTHER_ADVICE = "let it begin at another time or after something else, or try a larger search.clearance_deg"

_RATE_NAMES = ("angular_velocity", "angular_velocity_norm", "joint_rates")
_END_SHARES = (1.0, 0.25, 0.05)  # fractions of a fit's outermost pieces to add accelerations on, in turn
_ACCELERATION_NAMES = ("angular_acceleration", "angular_acceleration_norm", "joint_accelerations")
_EASING_FACTOR = 1.5  # times the excess over a limit: by so much limits are lowered
_MAX_EASED_PEAK = 1.1  # peak over its limit above which the slew is not fitted again
_PERHAPS_TOO_SHORT = (Status.LIMITS_TOO_TIGHT, Status.UNCERTIFIED)
_BOUND_FIELDS = ("attitude", "joints", "velocity", "rates")


def _tell_faults(faults: Sequence[str], proof: Certificate) -> str:
    """Return text on the faults of a slew's certificate, with advice if its trajectory was evaluated."""
    told = "; ".join(faults)
    return f"{told}: {_OTHER_ADVICE}" if proof.evaluated else told


def _peak_over_limit(proof: Certificate | None, names: Sequence[str]) -> float:
    """Return a proof's largest peak over its limit, if only limits with these names are exceeded.

    It returns 0 if others are, if it exceeds `_MAX_EASED_PEAK`, if a zone is broken, and without a proof.
    """
    if proof is None or not proof.peaks or (proof.min_margin is not None and not proof.min_margin >= 0):
        return 0.0
    others = [peak for name, peak in proof.peaks.items() if name not in names]
    most = max(proof.peaks.values())
    return most if all(peak <= 1 + LIMIT_ALLOWANCE for peak in others) and most <= _MAX_EASED_PEAK else 0.0


def _ease_accelerations(craft: Spacecraft, share: float) -> Spacecraft:
    """Return a spacecraft whose limits of acceleration are divided by `share`."""

    def less(part: Any, *names: str) -> Any:
        given = {name: getattr(part, name) for name in names}
        return replace(part, **{name: own / share for name, own in given.items() if own is not None})

    own = ("acceleration_limit", "yaw_acceleration_limit", "pitch_acceleration_limit")
    return replace(
        less(craft, "acceleration_limit", "acceleration_norm_limit"),
        terminals=tuple(less(one, *own) for one in craft.terminals),
        drives=tuple(less(one, own[0]) for one in craft.drives),
    )


def _given_state(state: State) -> GivenState:
    """Return a state in the form that scenarios have."""
    return GivenState(
        rotation_vector=so3.log(state.attitude),
        joints=state.joints,
        angular_velocity=state.velocity,
        joint_rates=state.rates,
    )


def _goal_of_slew(start: State, state: State, time: float) -> Goal:
    """Return a state as the goal of a slew of `time` s from another state."""
    return Goal(
        attitude=state.attitude,
        joints=state.joints,
        slew_angle=float(so3.distance(start.attitude, state.attitude)),
        time=time,
        angular_velocity=state.velocity,
        joint_rates=state.rates,
    )


def _replace_last_node(way: Path, goal: State) -> Path:
    """Return a path with its last node replaced by a state."""
    attitudes, joints = (
        np.concatenate([nodes[:-1], last[None]])
        for nodes, last in ((way.attitudes, goal.attitude), (way.joints, goal.joints))
    )
    return replace(way, attitudes=attitudes, joints=joints)


def _straight_path(start: State, goal: State) -> Path:
    """Return the path of a single edge between two states."""
    return Path(
        attitudes=np.stack([start.attitude, goal.attitude]),
        joints=np.stack([start.joints, goal.joints]),
        edge_costs=np.ones(1),
    )
