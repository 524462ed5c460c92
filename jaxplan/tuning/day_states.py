"""The states in which activities of a day begin, as differentiable functions of the time when they do.

To *follow* a state is to compute it again for changed numbers of the timeline, with the plan's choices held
fixed. A state depends on the state before, and on the time at which it is reached:

    an attitude      is a number of the timeline, held at rest
    idle             is the state before or, if that was in motion, where even braking from it has ended
    targets          is the optimum of step 1 at that instant, from the state before, with the least rates
                     with which devices follow targets that move
    a track          begins as the motion of least energy near the state before does

The way each is computed is checked against the plan's own state before it is used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.derivatives import own_arrays
from jaxplan.goal.derivative import differentiable_goal
from jaxplan.goal.followed_goal import AS_A_STATE, followed_by
from jaxplan.goal.free_devices import MadeWay
from jaxplan.goal.pointing_start import differentiable_rates
from jaxplan.model.activities import Activity
from jaxplan.model.directions import as_path
from jaxplan.model.goals import LEAST_ROTATION, Targets
from jaxplan.model.nameless import nameless, unlabelled
from jaxplan.model.path import Goal
from jaxplan.model.scenario import MINIMUM, Scenario, moves
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import Turns, masks
from jaxplan.runtime.at_once import at_once
from jaxplan.timeline.choices import Choice
from jaxplan.timeline.motions import Motion, with_room
from jaxplan.timeline.track_derivative import Track, ends_of, track_of
from jaxplan.timeline.tracking import State

_LEAST_ENERGY_ADVICE = "set trajectory.optimal = true, or give it an attitude"
TARGETS_MOVE = f"its targets, zones or wishes make it move: {_LEAST_ENERGY_ADVICE}"
"""Why a track that moves has no derivatives where its energy is not least."""
GIVES_WAY = f"it gives way to a zone: {_LEAST_ENERGY_ADVICE}"
"""Why rest that moves has none then."""
_OPTIMUM_TOLERANCE = 1e-6  # rad and rad/s, by which a plan's state may be off the optimum differentiated


class When(NamedTuple):
    """Times of an activity, s; each may be traced by JAX.

    Attributes:
        since: when the state before was reached.
        begin: when the slew ends, and the activity's motion begins.
        end: when the motion ends.
    """

    since: Any
    begin: Any
    end: Any


Ends: TypeAlias = tuple[State, State]
"""The states in which an activity begins and ends."""


class Reached(Protocol):
    """A rule that computes the state in which an activity begins from numbers of the timeline."""

    @property
    def in_time(self) -> bool:
        """Whether the state depends on the time at which it is reached."""
        ...

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """Return the states in which an activity begins and ends, near those of the plan.

        Args:
            scene: the timeline's scene, with numbers that may have changed.
            activity: the activity, likewise.
            before: the state before.
            when: when that was reached, and when the activity begins and ends.
            near: the motion of the plan, with unchanged numbers.
        """
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Held:
    """An attitude that is held.

    Attributes:
        in_time: False, since it does not depend on time.
    """

    in_time: bool = False

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """Return the state that the activity gives, for both ends."""
        assert activity.attitude is not None
        joints: Any = jnp.asarray(activity.attitude.joints)
        found = State.still(so3.exp(jnp.asarray(activity.attitude.rotation_vector)), joints)
        return found, found


@dataclass(frozen=True, kw_only=True, eq=False)
class Known:
    """A state that is taken from the plan as a constant, since no result depends on it.

    Attributes:
        goal: the plan's state.
        in_time: whether the state depends on the time at which it is reached.
    """

    goal: State
    in_time: bool = False

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """Return the plan's state, for both ends."""
        return self.goal, self.goal


@dataclass(frozen=True, kw_only=True, eq=False)
class Rested:
    """Rest in the state before, or where even braking from it ends.

    Attributes:
        in_time: whether the spacecraft was in motion before.
    """

    in_time: bool

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """Return, for both ends, the state before or the one in which even braking from it ends."""
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
        moves: how devices without a target have moved out of the way there (`MadeWay`).
        met: places, in `Targets.prefer`, of the wishes that it meets.
        turns: whole turns of the yaw after which each mask is met again.
        roomy: whether it keeps extra room to zones and ends of ranges, see `with_room`.
        moving: whether devices must turn at the rates of their targets.
        in_time: whether a target or a zone moves.
    """

    moves: tuple[MadeWay, ...]
    met: tuple[int, ...]
    turns: Turns
    roomy: bool
    moving: bool
    in_time: bool

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """Return for both ends the optimum of step 1 when the activity begins, with the least rates."""
        assert activity.targets is not None
        begin = when.begin
        found: Any = self.goal(scene, activity.targets, before, begin, near.state)
        still = State.still(*found)
        if not self.moving:
            return still, still
        rates: Any = _least_rates(scene.usable, unlabelled(activity.targets), begin, *found)
        found = replace(still, velocity=rates[:3], rates=rates[3:])
        return found, found

    def goal(
        self, scene: Scenario, targets: Targets, before: State, begin: Any, near: State | Goal
    ) -> tuple[Any, Any]:
        """Return attitude and joints of the optimum of step 1 at `begin`, s, from the state before.

        `near` is that of the plan.
        """
        starts, places = (before.attitude, before.joints), (near.attitude, near.joints)
        scene, targets = nameless(scene), unlabelled(targets)
        found = _optimum(scene, targets, begin, starts, places, self.moves, self.met, self.turns, self.roomy)
        return found[:9].reshape(3, 3), found[9:]


@at_once("met", "turns", "roomy", of_arrays=True)
def _optimum(
    scene: Scenario,
    targets: Targets,
    begin: Any,
    before: tuple[Any, Any],
    near: tuple[Any, Any],
    moves: tuple[MadeWay, ...],
    met: tuple[int, ...],
    turns: Turns,
    roomy: bool,
) -> Array:
    """Return the optimum of step 1 at `begin`, s: its attitude by rows and its joints, (9 + J,).

    Args:
        scene: the timeline's scene.
        targets: those of the activity.
        begin: s, when it begins.
        before: attitude and joints of the state before.
        near: attitude and joints of the optimum in the plan.
        moves: how devices without a target have moved out of the way, see `Pointed`.
        met: places of the wishes that are met, in `Targets.prefer`.
        turns: whole turns of the yaw after which each mask is met again.
        roomy: whether extra room is kept, see `with_room`.
    """
    craft, wanted = scene.usable, replace(targets.at(begin), criterion=LEAST_ROTATION)
    if roomy:
        craft, wanted = with_room(craft, wanted)
    found: Any = differentiable_goal(
        Goal(attitude=near[0], joints=near[1], slew_angle=0.0),
        craft,
        before[0],
        wanted,
        scene.rows(turns).at(begin),
        start_joints=before[1],
        moves=moves,
        met=met,
    )
    return jnp.concatenate([found.attitude.ravel(), found.joints])


@at_once(of_arrays=True)
def _least_rates(craft: Spacecraft, targets: Targets, begin: Any, attitude: Any, joints: Any) -> Array:
    """Return the least rates, rad/s, with which devices follow targets at `begin`, s, (3 + J,)."""
    rates = differentiable_rates(
        craft, targets.at(begin), jnp.asarray(attitude), jnp.asarray(joints), targets.rates(begin)
    )
    return jnp.concatenate([*map(jnp.asarray, rates)])


@dataclass(frozen=True, kw_only=True, eq=False)
class Following:
    """The motion of least energy with which devices follow targets, or give way to zones while at rest.

    Attributes:
        aim: rule for the state to whose joints the motion is drawn: the optimum of step 1, rest, or the state
            before.
        tracks: what the plan's motions depend on, by their `id`.
        turns: whole turns of the yaw after which each mask is met again.
        in_time: whether the state depends on the time at which the motion begins: always True.
    """

    aim: Pointed | Rested
    tracks: dict[int, Track]
    turns: Turns
    in_time: bool = True

    def at(self, scene: Scenario, activity: Activity, before: State, when: When, near: Motion) -> Ends:
        """Return the states of the motion of least energy at both of its ends."""
        targets, settings, track = activity.targets, scene.trajectory, self.tracks[id(near)]
        if isinstance(self.aim, Pointed):
            assert targets is not None
            assert near.aim is not None
            joints = self.aim.goal(scene, targets, before, when.begin, near.aim)[1]
        else:
            joints = self.aim.at(scene, activity, before, when, near)[0].joints
        wishes = () if targets is None else targets.prefer
        now = unlabelled(
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
        return ends_of(now)


def following(choice: Choice, targets: Targets | None, motions: Sequence[Motion]) -> Following:
    """Return the rule for a motion with which devices follow targets, or give way to zones while at rest.

    Args:
        choice: how the motion came to begin.
        targets: the targets that it follows; None for rest.
        motions: all motions on which its begin depends, itself included.

    Raises:
        ValueError: if one of them is not known to be an optimum.
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
    if (off := off_by(found, choice)) <= _OPTIMUM_TOLERANCE:
        return found
    raise ValueError(f"its motion is off an optimum by {off:.1g}: give it an attitude")


def _joints_stay(choice: Choice, targets: Targets, aim: Goal) -> bool:
    """Tell whether joints at a goal are those before at any attitude, as no device with joints must point."""
    craft, joints = choice.departure.scene.usable, choice.before.joints
    wished = [craft.device_names.index(wish.device) for wish in targets.prefer]
    fixed = all(number >= craft.gimbals.count for number in (*targets.numbers(craft), *wished))
    return fixed and bool(np.array_equal(aim.joints, joints))


def pointed(choice: Choice, targets: Targets) -> Pointed:
    """Return the rule for the state in which devices point at targets.

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
        if off_by(own, choice) <= _OPTIMUM_TOLERANCE:
            return own
    raise ValueError(reason)


def optimum_at(choice: Choice, targets: Targets, state: Any, *, roomy: bool = False) -> Pointed:
    """Return the rule for an optimum of step 1, near a state or goal in which an activity may begin.

    `roomy` is as of `Pointed`.

    Raises:
        ValueError: for the doubts of `followed_by`.
    """
    before, scene = choice.before, _freeze_zones(choice.departure.scene, choice.begin)
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


def _freeze_zones(scene: Scenario, time: float) -> Scenario:
    """Return a scene whose moving zones stand still where they are at `time`, s."""

    def still(zones: Any) -> Any:
        return tuple(
            replace(zone, direction=as_path(zone.direction).at(time)) if zone.moves else zone
            for zone in zones
        )

    return replace(scene, keep_out=still(scene.keep_out), keep_in=still(scene.keep_in))


def off_by(reached: Reached, choice: Choice) -> float:
    """Return how far the state computed by a rule is off the plan's, the largest of rad and rad/s.

    It is infinite where that cannot be computed.
    """
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
