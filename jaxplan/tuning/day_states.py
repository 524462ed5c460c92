"""The states in which activities of a day begin, as functions of the time at which they do.

A state is reached at some time from the state before, and both move with the numbers of the timeline:

    an attitude      is a number of the timeline, held at rest
    idle             the state before; one that moved has braked evenly since
    targets          the optimum of step 1 at that instant, from the state before, with the least rates with
                     which devices follow targets that move
    a track          the motion of least energy near the state before

Each is checked against the plan's before it is followed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from jaxplan import so3
from jaxplan.derivatives import own_arrays
from jaxplan.goal.derivative import differentiable_goal
from jaxplan.goal.followed_goal import AS_A_STATE, followed_by
from jaxplan.goal.free_devices import MadeWay
from jaxplan.goal.rates import differentiable_rates
from jaxplan.model.directions import as_path
from jaxplan.model.goals import LEAST_ROTATION, Targets
from jaxplan.model.path import Goal
from jaxplan.model.scenario import MINIMUM, Scenario, moves
from jaxplan.model.timeline import Activity
from jaxplan.model.zones import Turns, masks
from jaxplan.timeline.choices import Choice
from jaxplan.timeline.motions import Motion, with_room
from jaxplan.timeline.track_derivative import Track, ends_of, track_of
from jaxplan.timeline.tracking import State

_LEAST_ENERGY = "set trajectory.optimal = true, or give it an attitude"
TARGETS_MOVE = f"its targets, zones or wishes make it move: {_LEAST_ENERGY}"
"""Why a track that moves has no derivatives where its energy is not least."""
GIVES_WAY = f"it gives way to a zone: {_LEAST_ENERGY}"
"""Why rest that moves has none then."""
_OPTIMAL = 1e-6  # rad, rad/s, by which a state may be off the optimum whose derivative is taken


class When(NamedTuple):
    """Times of an activity, s.

    Attributes:
        since: when the state before was reached.
        begin: when the slew ends, and the motion begins.
        end: when that ends.
    """

    since: Any
    begin: Any
    end: Any


Ends: TypeAlias = tuple[State, State]
"""The states in which an activity begins and ends."""


class Reached(Protocol):
    """The state in which an activity begins, and how it is followed."""

    @property
    def in_time(self) -> bool:
        """Whether it depends on the time at which it is reached."""
        ...

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """The states in which an activity begins and ends, near those of the plan.

        Args:
            scene: of the timeline.
            activity: with the numbers of the timeline.
            before: the state before.
            when: it was reached, and the activity begins and ends.
            near: the motion of the plan.
        """
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Held:
    """An attitude that is held."""

    in_time: bool = False

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """The state that the activity gives."""
        assert activity.attitude is not None
        joints: Any = jnp.asarray(activity.attitude.joints)
        found = State.still(so3.exp(jnp.asarray(activity.attitude.rotation_vector)), joints)
        return found, found


@dataclass(frozen=True, kw_only=True, eq=False)
class Known:
    """A state on which nothing depends that is asked for.

    Attributes:
        goal: that of the plan.
        in_time: whether it depends on the time at which it begins.
    """

    goal: State
    in_time: bool = False

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """The plan's state."""
        return self.goal, self.goal


@dataclass(frozen=True, kw_only=True, eq=False)
class Rested:
    """Rest.

    Attributes:
        in_time: whether the spacecraft moved before.
    """

    in_time: bool

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """The state before, or the one in which even braking ends."""
        if not self.in_time:
            return before, before
        far = (when.begin - when.since) / 2
        low, high = scene.usable.joint_ranges.T
        joints: Any = jnp.clip(before.joints + far * before.rates, low, high)
        found = State.still(before.attitude @ so3.exp(far * before.velocity), joints)
        return found, found


@dataclass(frozen=True, kw_only=True, eq=False)
class Pointed:
    """The state in which devices point at targets.

    Attributes:
        moves: how devices without a target make way there.
        met: places of the wishes that it meets.
        turns: whole turns of the yaw after which masks are met again.
        roomy: whether it keeps the room that an instant keeps from zones and ends of ranges.
        moving: whether devices follow targets at an instant, at their rates.
        in_time: whether a target or a zone moves.
    """

    moves: tuple[MadeWay, ...]
    met: tuple[int, ...]
    turns: Turns
    roomy: bool
    moving: bool
    in_time: bool

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """The optimum of step 1 at the time at which the state is reached, with the least rates."""
        assert activity.targets is not None
        begin = when.begin
        found = self.goal(scene, activity.targets, before, begin, near.state)
        still = State.still(found.attitude, found.joints)
        if not self.moving:
            return still, still
        there = activity.targets.at(begin)
        spin, rates = differentiable_rates(
            scene.usable,
            there,
            jnp.asarray(found.attitude),
            jnp.asarray(found.joints),
            activity.targets.rates(begin),
        )
        velocity: Any = spin
        joint_rates: Any = rates
        found = replace(still, velocity=velocity, rates=joint_rates)
        return found, found

    def goal(self, scene: Scenario, targets: Targets, before: State, begin: Any, near: State | Goal) -> Any:
        """The optimum of step 1 at a time, s, after some state before, near the one of the plan."""
        craft, wanted = scene.usable, replace(targets.at(begin), criterion=LEAST_ROTATION)
        if self.roomy:
            craft, wanted = with_room(craft, wanted)
        return differentiable_goal(
            Goal(attitude=near.attitude, joints=near.joints, slew_angle=0.0),
            craft,
            before.attitude,
            wanted,
            scene.rows(self.turns).at(begin),
            start_joints=before.joints,
            moves=self.moves,
            met=self.met,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Following:
    """The motion of least energy with which devices follow targets, or give way to zones at rest.

    Attributes:
        aim: the state to whose joints the motion is drawn: the optimum of step 1, rest, or the state before.
        tracks: the motions of the plan, by their `id`.
        turns: whole turns of the yaw after which masks are met again.
        in_time: whether it depends on the time at which it begins, as it does.
    """

    aim: Pointed | Rested
    tracks: dict[int, Track]
    turns: Turns
    in_time: bool = True

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """The states of the optimum at both ends."""
        targets, settings, track = activity.targets, scene.trajectory, self.tracks[id(near)]
        if isinstance(self.aim, Pointed):
            assert targets is not None
            assert near.aim is not None
            joints = self.aim.goal(scene, targets, before, when.begin, near.aim).joints
        else:
            joints = self.aim.at(scene, activity, before, when, near)[0].joints
        wishes = () if targets is None else targets.prefer
        return ends_of(
            replace(
                track,
                craft=scene.usable,
                paths=() if targets is None else targets.paths,
                attitude=None if track.attitude is None else before.attitude,
                joints=joints,
                begin=when.begin,
                end=when.end,
                weights=jnp.stack(
                    [jnp.asarray(settings.rate_weight), jnp.asarray(settings.acceleration_weight)]
                ),
                wishes=tuple(as_path(wish.direction) for wish in wishes),
                rows=None if track.rows is None else scene.rows(self.turns),
            )
        )


def following(choice: Choice, targets: Targets | None, motions: Sequence[Motion]) -> Following:
    """How the motion is followed with which devices follow targets, or give way to zones without any.

    Args:
        choice: how it came to begin.
        targets: that it follows; None for rest.
        motions: all on which its begin depends.

    Raises:
        ValueError: if it is none that is known to be the optimum.
    """
    scene = choice.departure.scene
    if not scene.trajectory.optimal:
        raise ValueError(GIVES_WAY if targets is None else TARGETS_MOVE)
    if any(motion.tracked is None or (motion.aim is None) != (targets is None) for motion in motions):
        raise ValueError("it is no optimum near the state before; give it an attitude")
    tracks = {id(motion): track_of(motion, scene.usable, scene.constraints, targets) for motion in motions}
    aim: Pointed | Rested = Rested(in_time=True)
    if targets is not None:
        near = choice.motion.aim
        assert near is not None
        still = _joints_stay(choice, targets, near)
        aim = Rested(in_time=False) if still else optimum_at(choice, targets, near)
    turns = tuple(mask.turns for mask in masks(scene.spacecraft))
    found = Following(aim=aim, tracks=tracks, turns=turns)
    if (off := off_by(found, choice)) <= _OPTIMAL:
        return found
    raise ValueError(f"its motion is off an optimum by {off:.1g}: give it an attitude")


def _joints_stay(choice: Choice, targets: Targets, aim: Goal) -> bool:
    """Whether joints at a goal are those before, whatever its attitude: no device that has any is asked."""
    craft, joints = choice.departure.scene.usable, choice.before.joints
    wished = [craft.device_names.index(wish.device) for wish in targets.prefer]
    fixed = all(number >= craft.gimbals.count for number in (*targets.numbers(craft), *wished))
    return fixed and bool(np.array_equal(aim.joints, joints))


def pointed(choice: Choice, targets: Targets) -> Pointed:
    """How the state is followed in which devices point at targets.

    Raises:
        ValueError: for the doubts of `followed_by`, or if the state is not the optimum of step 1.
    """
    goal, scene = choice.goal, choice.departure.scene
    in_time = targets.moves or moves(scene)
    instant = choice.activity.kind == "point"
    reason = "it turns more than its targets ask for, as by room that it keeps: give it an attitude"
    for roomy in (True, False) if instant else (False,):
        try:
            own = optimum_at(choice, targets, goal, roomy=roomy)
        except ValueError as error:
            reason = str(error)
            continue
        own = replace(own, moving=instant and in_time, in_time=in_time)
        if off_by(own, choice) <= _OPTIMAL:
            return own
    raise ValueError(reason)


def optimum_at(choice: Choice, targets: Targets, state: Any, *, roomy: bool = False) -> Pointed:
    """How an optimum of step 1 is followed, a state or goal in which an activity may begin.

    Raises:
        ValueError: for the doubts of `followed_by`.
    """
    before, scene = choice.before, _at(choice.departure.scene, choice.begin)
    place = Goal(
        attitude=state.attitude,
        joints=state.joints,
        slew_angle=float(so3.distance(before.attitude, state.attitude)),
    )
    wanted = replace(targets.at(choice.begin), criterion=LEAST_ROTATION)
    asked = replace(choice.departure, scene=scene, state=before).scenario(choice.goal, MINIMUM)
    if roomy:
        craft, wanted = with_room(scene.usable, wanted)
        asked = asked if scene.robust is not None else replace(asked, spacecraft=craft)
    followed = followed_by(replace(asked, goal=wanted), place)
    if followed.doubts:
        told = "; ".join(followed.doubts)
        raise ValueError(told.replace(AS_A_STATE, "give it an attitude"))
    return Pointed(
        moves=followed.moves,
        met=followed.met,
        turns=tuple(mask.turns for mask in masks(scene.spacecraft)),
        roomy=roomy,
        moving=False,
        in_time=True,
    )


def _at(scene: Scenario, time: float) -> Scenario:
    """A scene whose zones stay where they are at a time, s."""

    def still(zones: Any) -> Any:
        return tuple(
            replace(zone, direction=as_path(zone.direction).at(time)) if zone.moves else zone
            for zone in zones
        )

    return replace(scene, keep_out=still(scene.keep_out), keep_in=still(scene.keep_in))


def off_by(reached: Reached, choice: Choice) -> float:
    """How far the state that is followed is off the plan's, rad and rad/s."""
    when = When(choice.since, choice.begin, choice.end)
    with jax.enable_x64(True):
        scene = own_arrays(choice.departure.scene)
        found = reached.at(scene, choice.activity, choice.before, when, choice.motion)[0]
    goal = choice.goal
    off = [np.asarray(so3.distance(np.asarray(found.attitude), goal.attitude))]
    off += [
        np.abs(np.asarray(getattr(found, name)) - getattr(goal, name))
        for name in ("joints", "velocity", "rates")
    ]
    most = max(float(np.max(one, initial=0.0)) for one in off)
    return most if np.isfinite(most) else np.inf
