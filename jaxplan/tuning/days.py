"""The total time of a day as a function of its timeline, with derivatives.

What was chosen while a timeline was planned is held (`jaxplan.timeline.choices`): the order, which slews wait
for a window, and how the duration of each slew came about. The rest is followed from activity to activity:

    begin = t + T(p, s, g)          t, s the time and state before; g the state in which the slew ends
    t     = begin or window + time that the activity takes

so that what makes a slew longer moves all that comes after it, until a window is waited for. A duration
``T`` is a multiple of the strict lower bound, a formula, or of the shortest motion's time. That motion is an
optimum, followed as that of a single plan (`jaxplan.gradients`); its slopes by ends, limits, inertia and
zones are found once, and stand for it here.

States in which an attitude is held are numbers of the timeline, and one who rests stays as it is. Where
devices point at directions that stand still, the state is the optimum of step 1, followed as goals are
(`jaxplan.goal.sensitivity`). What else a timeline may ask for has no derivatives yet, and is refused with all
activities and reasons together.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxplan import so3
from jaxplan.derivatives import own_arrays
from jaxplan.goal.followed import followed_by
from jaxplan.goal.free import MadeWay
from jaxplan.goal.sensitivity import differentiable_goal
from jaxplan.gradients import differentiable
from jaxplan.model.duration_bound import rest_bounds
from jaxplan.model.goals import LEAST_ROTATION, Targets
from jaxplan.model.path import Goal
from jaxplan.model.scenario import MINIMUM, Scenario, moves
from jaxplan.model.timeline import Activity
from jaxplan.model.zones import Turns, masks
from jaxplan.timeline import TimelinePlan, plan_timeline
from jaxplan.timeline.choices import BOUND, NEEDED, SEEN, Choice, SlewTime
from jaxplan.timeline.motions import with_room
from jaxplan.timeline.slews import Departure
from jaxplan.timeline.stored import holding, total_in
from jaxplan.timeline.tracking import State
from jaxplan.trajectory import measures

_SAME = 1e-6  # s, by which times of a plan that was read, and of one made anew, may differ
_STAYS = 1e-9  # rad, by which a state that is held may change
_RESTS = 1e-9  # rad/s, below which a motion counts as at rest
_OPTIMAL = 1e-6  # rad, by which a state may be off the optimum whose derivative is taken
_NEAR = 0.01  # of the time of a shortest motion, by which the optimum near it may differ
TOTAL_TIME = "total_time"
"""What can be asked of a day: s, from its start to the end of the last activity, no rest after it."""


class Numbers(NamedTuple):
    """The numbers of a timeline, as JAX differentiates by them.

    Attributes:
        scene: of the timeline.
        activities: in their order in the file.
        until: s, the timeline's end; None without.
    """

    scene: Scenario
    activities: tuple[Activity, ...]
    until: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Slope:
    """The time of a shortest motion near a plan's, to first order.

    Attributes:
        seconds: s, at the optimum.
        scenario: of the plan.
        slopes: derivatives of the time by the scenario's numbers.
    """

    seconds: float
    scenario: Scenario
    slopes: Scenario

    def at(self, scenario: Scenario) -> Any:
        """The time, s, of a scenario near that of the plan."""
        change: Any = 0.0
        each = (jax.tree.leaves(tree) for tree in (self.slopes, scenario, self.scenario))
        for slope, now, then in zip(*each, strict=True):
            if np.asarray(slope).dtype.kind == "f":  # limits may be infinite, and have no slopes then
                change += jnp.sum(jnp.where(np.isfinite(then), slope * (jnp.asarray(now) - then), 0.0))
        return self.seconds + change


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pointed:
    """The state in which devices point at directions that stand still, near a plan's.

    Attributes:
        place: the state, as a goal of step 1.
        moves: how devices without a target make way there.
        turns: whole turns of the yaw after which masks are met again.
        roomy: whether it keeps the room that an instant keeps from zones and ends of ranges.
    """

    place: Goal
    moves: tuple[MadeWay, ...]
    turns: Turns
    roomy: bool

    def state(self, scene: Scenario, targets: Targets, before: State) -> State:
        """The state of a scene near that of the plan, after some state before."""
        craft, wanted = scene.usable, replace(targets, criterion=LEAST_ROTATION)
        if self.roomy:
            craft, wanted = with_room(craft, wanted)
        found: Any = differentiable_goal(
            self.place,
            craft,
            before.attitude,
            wanted,
            scene.rows(self.turns),
            start_joints=before.joints,
            moves=self.moves,
        )
        return State.still(found.attitude, found.joints)


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldDay:
    """What is held of a timeline's plan, as a function of the timeline's numbers.

    Attributes:
        numbers: those of the plan's timeline.
        rows: numbers of the activities in the file, in the order in which they are done.
        choices: how each of them came to begin.
        slopes: of the shortest motions that durations are multiples of, by `id` of these durations.
        places: the states in which devices point at their targets, by names of activities.
    """

    numbers: Numbers
    rows: tuple[int, ...]
    choices: tuple[Choice, ...]
    slopes: dict[int, _Slope]
    places: dict[str, _Pointed]

    def total_time(self, numbers: Numbers) -> Any:
        """The time, s, at which the last activity of a timeline near that of the plan ends."""
        scene = numbers.scene
        state, time = _start(scene), jnp.asarray(0.0)
        total = total_in(scene.spacecraft, state)
        for row, choice in zip(self.rows, self.choices, strict=True):
            activity = numbers.activities[row]
            craft = holding(scene.spacecraft, total, state)
            here = replace(choice.departure, scene=scene, craft=craft, state=state)
            goal = self._goal(scene, activity, state)
            begin: Any = 0.0 if activity.earliest is None else activity.earliest
            if choice.time is not None:
                begin = time + self._seconds(choice, choice.time, here, goal, time)
            time, state = _ends(activity, choice, begin, numbers.until), goal
        return time

    def _goal(self, scene: Scenario, activity: Activity, before: State) -> State:
        """The state in which the slew to an activity ends; one at rest stays as it is before."""
        if activity.targets is not None:
            return self.places[activity.name].state(scene, activity.targets, before)
        if activity.attitude is None:
            return before
        joints: Any = jnp.asarray(activity.attitude.joints)
        return State.still(so3.exp(jnp.asarray(activity.attitude.rotation_vector)), joints)

    def _seconds(self, choice: Choice, own: SlewTime, here: Departure, goal: State, time: Any) -> Any:
        """A duration of a slew, s, from a departure at a time, s, to a goal that does not move."""
        base: Any = 0.0
        if own.kind == BOUND:
            turn = so3.log(here.state.attitude.T @ goal.attitude)
            base = rest_bounds(here.craft, turn[None], (goal.joints - here.state.joints)[None])[0]
        elif own.kind == NEEDED:
            base = self.slopes[id(own)].at(here.scenario(goal, MINIMUM))
        elif own.kind == SEEN:
            base = choice.departure.time + (own.seconds - own.offset) / own.factor - time
        return own.factor * base + own.offset


def _start(scene: Scenario) -> State:
    """The state at a scene's start, which rests."""
    joints: Any = jnp.asarray(scene.start.joints)
    return State.still(so3.exp(jnp.asarray(scene.start.rotation_vector)), joints)


def _ends(activity: Activity, choice: Choice, begin: Any, until: Any) -> Any:
    """When an activity ends, s, that begins at a time, s."""
    if activity.duration is not None:
        opens: Any = activity.earliest
        waits = opens is not None and choice.begin < (choice.activity.earliest or 0.0)
        return (opens if waits else begin) + activity.duration
    if activity.kind == "point":
        return begin
    return until if activity.latest is None else activity.latest


def hold_day(plan: TimelinePlan) -> HeldDay:
    """Return what of a timeline's plan stays fixed while the timeline's numbers change.

    Args:
        plan: an OK one. One that was read from a file is planned anew, since files do not say how its slews
            came about.

    Raises:
        ValueError: if it is not OK, one that is planned anew is another one, or some activities have no
            derivatives; the message names all of these, each with its reason.
    """
    plan = _with_choices(plan)
    timeline = plan.timeline
    rows = {one.name: row for row, one in enumerate(timeline.activities)}
    choices = tuple(one for one in plan.choices if one.activity.name in rows)
    reasons = {one.activity.name: _refused(one, plan) for one in choices}
    start = timeline.scene.start
    if np.any(start.angular_velocity) or np.any(start.joint_rates):
        reasons[choices[0].activity.name] = (
            "the start has rates, as one in the local frame has: give it a start at rest"
        )
    places: dict[str, _Pointed] = {}
    for one in choices:
        name = one.activity.name
        if one.activity.targets is not None and not reasons[name]:
            try:
                places[name] = _pointed(one, one.activity.targets)
            except ValueError as error:
                reasons[name] = str(error)
    slopes: dict[int, _Slope] = {}
    for one in choices:
        name, time = one.activity.name, one.time
        if reasons[name] or time is None or time.kind != NEEDED:
            continue
        try:
            slopes[id(time)] = _slope(one.departure, time)
        except ValueError as error:
            reasons[name] = str(error)
    if any(reasons.values()):
        told = "; ".join(f"activity {name}: {reason}" for name, reason in reasons.items() if reason)
        raise ValueError(f"the total time of {timeline.name} has no derivatives that are known: {told}")
    return HeldDay(
        numbers=Numbers(
            scene=own_arrays(timeline.scene), activities=timeline.activities, until=timeline.until
        ),
        rows=tuple(rows[one.activity.name] for one in choices),
        choices=choices,
        slopes=slopes,
        places=places,
    )


def _with_choices(plan: TimelinePlan) -> TimelinePlan:
    """The plan with how its activities came to begin; planned anew where it does not know."""
    if not plan.ok or plan.trajectory is None:
        raise ValueError(
            f"the plan of {plan.timeline.name} ended as {plan.status.name}: only an OK one is followed"
        )
    if len(plan.choices) >= len(plan.activities):
        return plan
    again = plan_timeline(plan.timeline, throw=False, progress=False)
    ends = [np.array([one.end or 0.0 for one in own.activities]) for own in (plan, again)]
    if not again.ok or np.max(np.abs(ends[0] - ends[1]), initial=0.0) > _SAME:
        raise ValueError(
            f"the plan of {plan.timeline.name} does not say how its slews came about, and planned anew its "
            "activities end at other times: use the plan that jp.plan_timeline returns"
        )
    return again


def _refused(choice: Choice, plan: TimelinePlan) -> str:
    """Why how an activity begins has no derivative that is known; empty if it has."""
    activity, departure = choice.activity, choice.departure
    scene, targets = departure.scene, activity.targets
    if targets is not None and targets.moves:
        return "its targets move; give it an attitude"
    if targets is not None and (moves(scene) or targets.prefer):
        return f"{'a zone moves' if moves(scene) else 'a device has a wish'}; give it an attitude"
    rates = [np.concatenate([one.velocity, one.rates]) for one in (departure.state, choice.goal)]
    if np.max(np.abs(rates)) > _RESTS:
        return "the slew to it begins or ends with rates"
    if choice.time is not None and choice.time.kind == NEEDED and not departure.at_rest(choice.goal):
        return (
            "the slew to it takes longer than its bound, and before or after it something moves: give it an "
            "attitude"
        )
    end = next(one.end for one in plan.activities if one.name == activity.name)
    assert plan.trajectory is not None
    assert end is not None
    then = plan.trajectory.sample(end)
    moved = so3.distance(then.attitude, choice.goal.attitude), *np.abs(then.joints - choice.goal.joints)
    if activity.idle:
        before = departure.state
        moved += (
            so3.distance(before.attitude, choice.goal.attitude),
            *np.abs(before.joints - choice.goal.joints),
        )
    if max(moved) > _STAYS:
        return "it gives way to a zone"
    return ""


def _pointed(choice: Choice, targets: Targets) -> _Pointed:
    """How the state is followed in which devices point at directions that stand still.

    Raises:
        ValueError: for the doubts of `followed_by`, or if the state is not the optimum of step 1.
    """
    departure, goal = choice.departure, choice.goal
    place = Goal(
        attitude=goal.attitude,
        joints=goal.joints,
        slew_angle=float(so3.distance(departure.state.attitude, goal.attitude)),
    )
    scene = departure.scene
    turns = tuple(mask.turns for mask in masks(scene.spacecraft))
    asked = departure.scenario(goal, MINIMUM)
    for roomy in (True, False) if choice.activity.kind == "point" else (False,):
        wanted = replace(targets, criterion=LEAST_ROTATION)
        if roomy:
            wanted = with_room(scene.usable, wanted)[1]
        followed = followed_by(replace(asked, goal=wanted), place)
        if followed.doubts:
            raise ValueError("; ".join(followed.doubts))
        own = _Pointed(place=place, moves=followed.moves, turns=turns, roomy=roomy)
        with jax.enable_x64(True):
            near = own.state(own_arrays(scene), targets, departure.state)
        off = (
            so3.distance(np.asarray(near.attitude), goal.attitude),
            *np.abs(np.asarray(near.joints) - goal.joints),
        )
        if max(off) <= _OPTIMAL:
            return own
    raise ValueError("it turns more than its targets ask for, as by room that it keeps")


def _slope(departure: Departure, time: SlewTime) -> _Slope:
    """Expand the minimum time of a slew to first order in the numbers of its scenario.

    Args:
        departure: the state that the slew starts from.
        time: the slew's duration, a multiple of that minimum.

    Raises:
        ValueError: if the shortest plan cannot be differentiated, or its optimum takes another time, by more
            than 1 %, than was found.
    """
    plan = departure.shortest_plan(time)
    function = differentiable(plan)
    with jax.enable_x64(True):
        scenario = own_arrays(plan.scenario)
        seconds, slopes = jax.value_and_grad(lambda own: measures.duration(function(own)), allow_int=True)(
            scenario
        )
    asked = (time.seconds - time.offset) / time.factor
    if not abs(float(seconds) - asked) <= _NEAR * asked:
        raise ValueError(f"the optimum near the slew of {asked:.2f} s takes {float(seconds):.2f} s")
    return _Slope(seconds=float(seconds), scenario=scenario, slopes=slopes)


def day_slopes(plan: TimelinePlan) -> tuple[float, Numbers]:
    """The total time of a timeline's plan, s, and its derivatives by the timeline's numbers.

    Raises:
        ValueError: as of `hold_day`.
    """
    held = hold_day(plan)
    with jax.enable_x64(True):
        value, slopes = jax.value_and_grad(held.total_time, allow_int=True)(held.numbers)
    return float(value), slopes
