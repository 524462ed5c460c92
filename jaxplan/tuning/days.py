"""The total time of a day as a function of its timeline, with derivatives.

The choices made while a timeline was planned are held fixed (`jaxplan.timeline.record`): the order, which
slews wait for a window, and how the duration of each slew came about. The rest is followed from activity to
activity:

    begin = t + T(p, s, g)          t, s the time and state before; g the state in which the slew ends
    t     = begin or window + time that the activity takes

with the timeline's numbers ``p``. So what makes a slew longer shifts all that comes after it, until a window
is waited for. A duration ``T`` is a multiple of a lower bound or of the shortest motion's time
(`jaxplan.tuning.day_legs`), to the state in which the activity begins, which depends on time if targets move.
So it is the state at the end of a duration tried before, and those durations are followed, too. The states
themselves are in `jaxplan.tuning.day_states`. What else a timeline may ask for has no derivatives yet, and is
refused in one message with all activities and reasons.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxplan import so3
from jaxplan.derivatives import own_arrays
from jaxplan.model.activities import Activity, Timeline
from jaxplan.model.directions import resplined
from jaxplan.model.scenario import Scenario, moves
from jaxplan.timeline import TimelinePlan, plan_timeline
from jaxplan.timeline.choices import FIXED, NEEDED, SEEN, Choice, SlewTime
from jaxplan.timeline.motions import Motion
from jaxplan.timeline.slews import FIRST, LEAST
from jaxplan.timeline.tracking import State
from jaxplan.timeline.wheel_momentum import holding, total_in
from jaxplan.tuning.day_legs import TIME_TOLERANCE, Leg, TimeExpansion, expand_time
from jaxplan.tuning.day_states import (
    Held,
    Known,
    Reached,
    Rested,
    following,
    off_by,
    pointed,
)

_STATE_TOLERANCE = 1e-9  # rad, most by which a state that counts as held may change
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
    slopes: dict[int, TimeExpansion]

    def total_time(self, numbers: Numbers) -> Any:
        """Return the time, s, at which the last activity ends, for numbers near those of the plan."""
        numbers = resplined(numbers)
        scene = numbers.scene
        state, time = _start_state(scene), jnp.asarray(0.0)
        total = total_in(scene.spacecraft, state)
        for row, choice, reached in zip(self.rows, self.choices, self.states, strict=True):
            leg = Leg(
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
    slopes: dict[int, TimeExpansion] = {}
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
            slopes[id(time)] = expand_time(one.departure, time)
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
    if not again.ok or np.max(np.abs(ends[0] - ends[1]), initial=0.0) > TIME_TOLERANCE:
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
        if choice.time is not None and choice.time.kind == FIXED and choice.time.seconds == 0.0:
            raise ValueError(
                "it keeps the attitude before it, and any other takes a slew: ask for idle = true"
            )
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
            late = abs(one.begin - opens) > TIME_TOLERANCE
            what = "begins when its targets come into sight" if late else "begins when its window opens"
        else:
            continue
        return f"activity {activity.name} {what}, so that nothing before that changes the total time"
    return ""
