"""The total time of a day as a function of its timeline, with derivatives.

The choices made while a timeline was planned are held fixed (`jaxplan.timeline.record`): the order, which
slews wait for a window, and how the duration of each slew came about. The rest is followed from activity to
activity:

    begin = t + T(p, s, g)          t, s the time and state before; g the state in which the slew ends
    t     = begin or window + time that the activity takes

with the timeline's numbers ``p``. So what makes a slew longer shifts all that comes after it, until a window
is waited for. A duration ``T`` is a multiple of the strict lower bound, a formula, or of the shortest
motion's time. That motion is an optimum, differentiated as that of a single plan (`jaxplan.gradients`). Its
slopes by ends, limits, inertia and zones are computed once, and a first-order expansion stands for it here.

A bound or a shortest motion is to the state in which the activity begins, which depends on time if targets
move. So it is the state at the end of a duration tried before, and those durations are followed, too. The
states themselves are in `jaxplan.tuning.day_states`. What else a timeline may ask for has no derivatives yet,
and is refused in one message with all activities and reasons.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.derivatives import own_arrays
from jaxplan.gradients import differentiable
from jaxplan.model.activities import Activity, Timeline
from jaxplan.model.duration_bound import moving_bound, rest_bounds
from jaxplan.model.scenario import MINIMUM, Scenario, moves
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.timeline import TimelinePlan, plan_timeline
from jaxplan.timeline.choices import BOUND, FIXED, NEEDED, SEEN, Choice, SlewTime
from jaxplan.timeline.motions import Motion
from jaxplan.timeline.slews import FIRST, LEAST, Departure
from jaxplan.timeline.tracking import State
from jaxplan.timeline.wheel_momentum import holding, total_in
from jaxplan.trajectory import measures
from jaxplan.trajectory.plan_measures import at_once
from jaxplan.tuning.day_states import (
    Ends,
    Held,
    Known,
    Reached,
    Rested,
    When,
    following,
    off_by,
    pointed,
)

_TIME_TOLERANCE = 1e-6  # s, by which times of a plan that was read, and of that plan made anew, may differ
_STATE_TOLERANCE = 1e-9  # rad, most by which a state that counts as held may change
_OPTIMUM_TOLERANCE = 0.01  # fraction of a shortest motion's time by which the optimum near it may differ
TOTAL_TIME = "total_time"
"""What can be asked of a day: s, from its start to the end of the last activity, no rest after it."""


class Numbers(NamedTuple):
    """The numbers of a timeline, as a pytree by which JAX differentiates.

    Attributes:
        scene: the timeline's scene.
        activities: in the file's order.
        until: s, the timeline's end; None without one.
    """

    scene: Scenario
    activities: tuple[Activity, ...]
    until: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class _TimeExpansion:
    """The time of a shortest motion near a plan's, to first order.

    Attributes:
        seconds: s, at the optimum.
        scenario: the scenario of the slew, in which that is the time.
        slopes: derivatives of the time by the scenario's numbers, in an object like it.
    """

    seconds: float
    scenario: Scenario
    slopes: Scenario

    def at(self, scenario: Scenario) -> Any:
        """Return the time, s, for a scenario near that of the plan."""
        change: Any = 0.0
        each = (jax.tree.leaves(tree) for tree in (self.slopes, scenario, self.scenario))
        for slope, now, then in zip(*each, strict=True):
            if np.asarray(slope).dtype.kind == "f":  # limits may be infinite, and have no slopes then
                change += jnp.sum(jnp.where(np.isfinite(then), slope * (jnp.asarray(now) - then), 0.0))
        return self.seconds + change


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldDay:
    """What is held fixed of a timeline's plan, as a function of the timeline's numbers.

    Attributes:
        numbers: those of the plan's timeline.
        rows: places of the activities in the file, in the order in which they are done.
        choices: how each of them came to begin.
        states: the rule for the state in which each of them begins.
        slopes: expansions of the shortest motions on which durations depend, by `id` of these durations.
    """

    numbers: Numbers
    rows: tuple[int, ...]
    choices: tuple[Choice, ...]
    states: tuple[Reached, ...]
    slopes: dict[int, _TimeExpansion]

    def total_time(self, numbers: Numbers) -> Any:
        """Return the time, s, at which the last activity ends, for numbers near those of the plan."""
        scene = numbers.scene
        state, time = _start_state(scene), jnp.asarray(0.0)
        total = total_in(scene.spacecraft, state)
        for row, choice, reached in zip(self.rows, self.choices, self.states, strict=True):
            leg = _Leg(
                slopes=self.slopes,
                choice=choice,
                reached=reached,
                activity=numbers.activities[row],
                scene=scene,
                craft=holding(scene.spacecraft, total, state),
                state=state,
                time=time,
                until=numbers.until,
            )
            begin = leg.begin
            time, state = leg.ends(begin), leg.states(begin, choice.motion)[1]
        return time


@dataclass(frozen=True, kw_only=True, eq=False)
class _Leg:
    """The slew to an activity and the activity itself, in numbers near those of the plan's timeline.

    Attributes:
        slopes: as of `HeldDay`.
        choice: how the activity came to begin, in the plan.
        reached: the rule for the state in which it begins.
        activity: the activity, with the changed numbers.
        scene: the timeline's scene, likewise.
        craft: the spacecraft, with what its wheels hold before the slew.
        state: the state before the slew.
        time: s, when that is reached.
        until: s, when the timeline ends; None without.
    """

    slopes: dict[int, _TimeExpansion]
    choice: Choice
    reached: Reached
    activity: Activity
    scene: Scenario
    craft: Spacecraft
    state: State
    time: Any
    until: Any

    @property
    def begin(self) -> Any:
        """When the activity begins, s."""
        if self.choice.time is not None and isinstance(self.reached, Known):
            return self.choice.begin
        if self.choice.time is not None:
            return self.time + self._slew_seconds(self.choice.time)
        opens = self.choice.activity.earliest or 0.0
        late = abs(self.choice.begin - opens) > _TIME_TOLERANCE  # what is hidden then depends on no number
        return self.choice.begin if late else self.activity.earliest or 0.0

    def states(self, begin: Any, near: Motion) -> Ends:
        """Return the states in which the activity begins, at `begin`, s, and ends, near a plan's motion."""
        when = When(self.time, begin, self.ends(begin))
        return self.reached.at(self.scene, self.activity, self.state, when, near)

    def ends(self, begin: Any) -> Any:
        """Return when the activity ends, s, if it begins at `begin`, s."""
        activity, opens = self.activity, self.activity.earliest
        if activity.duration is not None:
            waits = self.choice.begin < (self.choice.activity.earliest or 0.0)
            return (begin if opens is None or not waits else opens) + activity.duration
        if activity.kind == "point":
            return begin
        return self.until if activity.latest is None else activity.latest

    def _slew_seconds(self, own: SlewTime) -> Any:
        """Return a duration of the slew, s, for the changed numbers."""
        base: Any = 0.0
        if own.kind in (BOUND, NEEDED):
            after = own.after if self.reached.in_time else None
            goal = self.states(0.0 if after is None else self.time + self._slew_seconds(after), own.motion)[0]
            base = self._lower_bound(own, goal) if own.kind == BOUND else self._shortest_time(own, goal)
        elif own.kind == SEEN:
            base = self.choice.since + (own.seconds - own.offset) / own.factor - self.time
        return own.factor * base + own.offset

    def _lower_bound(self, own: SlewTime, goal: State) -> Any:
        """Return the strict lower bound, s, of the slew to a goal; either end may be in motion."""
        assert own.goal is not None
        then = self.choice.departure.state, own.goal
        turning = any(np.any(one.velocity) for one in then)
        pairs = [
            jnp.stack([jnp.asarray(getattr(one, name)) for one in (self.state, goal)])
            for name in ("attitude", "joints", "velocity", "rates")
        ]
        if turning or any(np.any(one.rates) for one in then):
            return _moving_bound(self.craft, *pairs, turning=turning)
        return _rest_bound(self.craft, *pairs[:2])

    def _shortest_time(self, own: SlewTime, goal: State) -> Any:
        """Return the time, s, of the shortest motion to a goal at rest."""
        here = replace(self.choice.departure, scene=self.scene, craft=self.craft, state=self.state)
        return self.slopes[id(own)].at(here.scenario(goal, MINIMUM))


@at_once()
def _rest_bound(craft: Spacecraft, attitudes: Array, joints: Array) -> Array:
    """Return the lower bound, s, of a slew at rest between attitudes (2, 3, 3) and joints (2, J)."""
    turn, moved = so3.log(attitudes[0].T @ attitudes[1]), joints[1] - joints[0]
    return rest_bounds(craft, turn[None], moved[None])[0]


@at_once("turning")
def _moving_bound(
    craft: Spacecraft, attitudes: Array, joints: Array, velocities: Array, rates: Array, *, turning: bool
) -> Array:
    """Return the lower bound, s, of a slew between two states, see `moving_bound`."""
    return moving_bound(craft, attitudes, joints, velocities, rates, turning=turning)


def _start_state(scene: Scenario) -> State:
    """Return the state at a scene's start, with its rates."""
    start = scene.start
    joints: Any = jnp.asarray(start.joints)
    velocity: Any = jnp.asarray(start.angular_velocity)
    rates: Any = jnp.asarray(start.joint_rates)
    still = State.still(so3.exp(jnp.asarray(start.rotation_vector)), joints)
    return replace(still, velocity=velocity, rates=rates)


def hold_day(plan: TimelinePlan) -> HeldDay:
    """Return what of a timeline's plan stays fixed while the timeline's numbers change.

    Args:
        plan: a certified plan. One read from a file is planned anew, since files do not store its choices.

    Raises:
        ValueError: if it is not OK, if the plan made anew differs from it, or if activities have no
            derivatives. The message names these activities with their reasons: all whose states cannot be
            followed or, if there are none, all whose shortest motions cannot be; these take long to
            differentiate.
    """
    if not plan.ok or plan.trajectory is None:
        raise ValueError(
            f"the plan of {plan.timeline.name} ended as {plan.status.name}: only an OK one is followed"
        )
    timeline = plan.timeline
    plan = _with_choices(plan)
    rows = {one.name: row for row, one in enumerate(timeline.activities)}
    choices = tuple(one for one in plan.choices if one.activity.name in rows)
    reasons: dict[str, str] = {}
    states: list[Reached] = []
    slopes: dict[int, _TimeExpansion] = {}
    asked: list[tuple[Choice, SlewTime]] = []
    for one, matters in zip(choices, _states_matter(choices), strict=True):
        name = one.activity.name
        try:
            states.append(_state_rule(one) if matters else Known(goal=one.goal))
            asked += [(one, time) for time in (_needed_durations(one, states[-1].in_time) if matters else ())]
        except ValueError as error:
            reasons[name] = str(error)
    _refuse_derivatives(timeline, reasons)
    for one, time in asked:  # takes long, so only where all else is known
        try:
            slopes[id(time)] = _expand_time(one.departure, time)
        except ValueError as error:
            reasons[one.activity.name] = str(error)
    _refuse_derivatives(timeline, reasons)
    return HeldDay(
        numbers=Numbers(
            scene=own_arrays(timeline.scene), activities=timeline.activities, until=timeline.until
        ),
        rows=tuple(rows[one.activity.name] for one in choices),
        choices=choices,
        states=tuple(states),
        slopes=slopes,
    )


def _refuse_derivatives(timeline: Timeline, reasons: Mapping[str, str]) -> None:
    """Raise ValueError if there are reasons, by activity, why the total time has no derivatives."""
    told = "; ".join(f"activity {name}: {reason}" for name, reason in reasons.items())
    if told:
        raise ValueError(f"the total time of {timeline.name} has no derivatives that are known: {told}")


def _states_matter(choices: Sequence[Choice]) -> list[bool]:
    """Tell for each activity whether the state in which it begins influences when the last activity ends.

    It does if the slew to it, or a later one, takes a time that follows from its ends, and if that time
    shifts the end of the last activity. An activity that waits for its window, or ends with it, cuts this
    chain.
    """
    found: list[bool] = []
    end_matters, state_matters = True, False
    for one in reversed(choices):
        activity, opens = one.activity, one.activity.earliest or 0.0
        lasts = activity.duration is not None and one.begin >= opens
        begin_matters = state_matters or (end_matters and (lasts or activity.kind == "point"))
        end_matters = begin_matters and one.time is not None
        state_matters = state_matters or end_matters
        found.append(state_matters)
    return found[::-1]


def _with_choices(plan: TimelinePlan) -> TimelinePlan:
    """Return the plan with its choices; it is planned anew if it has none.

    Raises:
        ValueError: if the plan made anew has activities that end at other times.
    """
    if len(plan.choices) >= len(plan.activities):
        return plan
    again = plan_timeline(plan.timeline, throw=False, progress=False)
    ends = [np.array([one.end or 0.0 for one in own.activities]) for own in (plan, again)]
    if not again.ok or np.max(np.abs(ends[0] - ends[1]), initial=0.0) > _TIME_TOLERANCE:
        raise ValueError(
            f"the plan of {plan.timeline.name} does not say how its slews came about, and planned anew its "
            "activities end at other times: use the plan that jp.plan_timeline returns"
        )
    return again


def _is_following(choice: Choice) -> bool:
    """Whether an activity is a motion in which devices follow targets and wishes, or give way to zones."""
    targets, trajectory = choice.activity.track, choice.motion.trajectory
    if choice.motion.tracked is None or trajectory is None:
        return False
    if targets is None or targets.moves or moves(choice.departure.scene):
        return True
    last, goal = trajectory.sample(trajectory.duration), choice.goal
    moved = so3.distance(last.attitude, goal.attitude), *np.abs(last.joints - goal.joints)
    return max(moved) > _STATE_TOLERANCE


def _tried_motions(choice: Choice) -> Iterator[Motion]:
    """Yield the motions that follow the goals of all durations tried for the slew to an activity."""
    time = choice.time
    while time is not None:
        if time.motion is not None:
            yield time.motion
        time = time.after


def _state_rule(choice: Choice) -> Reached:
    """Return the rule for the state in which an activity begins.

    Raises:
        ValueError: if there is none, or if the activity is led to where the next slew leads.
    """
    targets, before = choice.activity.targets, choice.before
    if choice.motion.led:
        raise ValueError("it is led to where the next slew leads: plan with look_ahead = false")
    if _is_following(choice):
        return following(choice, targets, [choice.motion, *_tried_motions(choice)])
    if targets is not None:
        return pointed(choice, targets)
    if choice.activity.attitude is not None:
        return Held()
    found = Rested(in_time=bool(np.any(before.velocity) or np.any(before.rates)))
    if off_by(found, choice) > _STATE_TOLERANCE:
        raise ValueError("it gives way to a zone")
    return found


def _needed_durations(choice: Choice, in_time: bool) -> Iterator[SlewTime]:
    """Yield the durations based on a shortest motion on which the time of a slew depends.

    Args:
        choice: how the slew's activity came to begin.
        in_time: whether the state in which the activity begins depends on time.

    Raises:
        ValueError: if such a motion is not from rest to rest, or the first duration was cut by what is known.
    """
    time = choice.time
    while time is not None:
        if time.kind == NEEDED:
            if not choice.departure.at_rest(time.goal):
                raise ValueError(
                    "the slew to it begins or ends with rates and takes longer than its bound asks for: set "
                    "trajectory.optimal = true"
                )
            yield time
        begun = time.kind == FIXED and time is not choice.time
        if begun and in_time and time.seconds not in (FIRST, LEAST):
            raise ValueError("it can begin only shortly before the end of what is known")
        time = time.after if in_time else None


def _expand_time(departure: Departure, time: SlewTime) -> _TimeExpansion:
    """Expand the shortest time of a slew to first order in the numbers of its scenario.

    Args:
        departure: the state from which the slew starts.
        time: the slew's duration, a multiple of that shortest time.

    Raises:
        ValueError: if the shortest plan cannot be differentiated, or if its optimum takes a time that differs
            by more than 1 % from the one that was found.
    """
    plan = departure.shortest_plan(time)
    function = differentiable(plan)
    with jax.enable_x64(True):
        scenario = own_arrays(plan.scenario)
        seconds, slopes = jax.value_and_grad(lambda own: measures.duration(function(own)), allow_int=True)(
            scenario
        )
    asked = (time.seconds - time.offset) / time.factor
    if not abs(float(seconds) - asked) <= _OPTIMUM_TOLERANCE * asked:
        raise ValueError(f"the optimum near the slew of {asked:.2f} s takes {float(seconds):.2f} s")
    return _TimeExpansion(seconds=float(seconds), scenario=scenario, slopes=slopes)


def day_slopes(plan: TimelinePlan) -> tuple[float, Numbers, str]:
    """Return the total time of a timeline's plan, s, and its derivatives by the timeline's numbers.

    Returns:
        Time, derivatives (in a `Numbers`), and a sentence on what is waited for, so that nothing before it
        has an influence; empty if nothing is waited for.

    Raises:
        ValueError: as for `hold_day`.
    """
    held = hold_day(plan)
    with jax.enable_x64(True):
        value, slopes = jax.value_and_grad(held.total_time, allow_int=True)(held.numbers)
    return float(value), slopes, _describe_wait(held.choices)


def _describe_wait(choices: Sequence[Choice]) -> str:
    """Return a sentence on the last activity whose times do not follow from its slew; empty if none."""
    for one in reversed(choices):
        activity, opens = one.activity, one.activity.earliest or 0.0
        if activity.duration is None and activity.kind != "point":
            what = f"ends when {'the timeline' if activity.latest is None else 'its window'} does"
        elif one.begin < opens:
            what = "waits for its window"
        elif one.time is None or (one.time.kind == SEEN and one.time.offset == 0.0):
            late = abs(one.begin - opens) > _TIME_TOLERANCE
            what = "begins when its targets come into sight" if late else "begins when its window opens"
        else:
            continue
        return f"activity {activity.name} {what}, so that nothing before that changes the total time"
    return ""
