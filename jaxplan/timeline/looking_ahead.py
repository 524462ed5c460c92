"""Motions that turn the platform to where the next slew leads while devices follow their targets.

Where targets leave the platform's attitude free, a turn costs nothing but motion within limits. The motion of
least energy is found first, as if nothing came after it. From its end, step 1 finds the state to which the
next slew would lead. If the lower bound of that slew's duration is set by the platform, and not by a joint
that must move anyway, the motion is found again with its last two nodes *drawn* there: each gets an added
term of energy of the same form as the one that draws the first node to the state before,

    rate_weight / T |log(A^T R_k)|^2,        A the attitude of that state, R_k that of the node

over a short time T, so that a track of minutes turns most of the way. The next state depends on the end of
the motion, so this is repeated a few times. If the result breaks a limit or a zone, a longer T draws less.
Rates change over a quarter of the motion's time, so that accelerations are small. A drawn motion is taken
only if it breaks nothing and lowers the bound.

The first nodes are *held*, and so is the curve until the last of them, so the motion begins as it did: the
slew to it can take as long as before, and the activity ends when it did.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from jaxplan import so3
from jaxplan.model.duration_bound import DurationBound
from jaxplan.timeline import curves
from jaxplan.timeline.activity_times import Refused
from jaxplan.timeline.least_energy import LeastMotion, Nodes
from jaxplan.timeline.motions import Doing, Motion, keeps_all
from jaxplan.timeline.pursuit import Pursuit
from jaxplan.timeline.slews import FIRST, LEAST, Departure
from jaxplan.timeline.tracking import State, tracked_through
from jaxplan.timeline.wheel_momentum import holding

_DRAW_TIMES = (4.0, 20.0, 100.0)  # s, times T that are tried in turn, until one breaks nothing
_MAX_ROUNDS = 3  # most repetitions, each with the next state for the new end of the motion
_REFINEMENT = 4  # intervals of the curve in each between nodes, so that the held part is far from the turn
_MAX_TURN = 2.8  # rad, most by which nodes may turn
_EQUATIONS_OF_ATTITUDE = 3  # number of equations of targets that leaves nothing of an attitude free
_MIN_GAIN = 0.2  # s, least by which each repetition must lower the bound
_SMALL_GAIN_SHARE = 0.1  # fraction of the bound; a repetition that gains less is the last
_SMOOTHING_SHARE = 0.25  # fraction of the motion's time in which rates change, so that it begins as it did
_HELD_NODES = 3  # first nodes that are held, so that the slew before, and its final rates, stay the same


@dataclass(frozen=True, kw_only=True, eq=False)
class _NextSlew:
    """The slew that would follow a motion.

    Attributes:
        attitude: (3, 3) body to inertial, to which it leads.
        bound: lower bound of its duration.
        by_platform: whether the platform, not a joint, sets the bound.
    """

    attitude: np.ndarray
    bound: DurationBound
    by_platform: bool

    @property
    def can_gain(self) -> bool:
        """Whether turning the platform beforehand can make the slew shorter."""
        return self.by_platform and self.bound.seconds > LEAST


class Led(NamedTuple):
    """A motion that is drawn to where the next slew leads.

    Attributes:
        motion: the drawn motion.
        bound: s, lower bound of the next slew after the motion that was not drawn.
    """

    motion: Motion
    bound: float


def led_ahead(doing: Doing, motion: Motion, then: Doing) -> Led | None:
    """Return an activity's motion drawn to where the slew to the next activity leads.

    Args:
        doing: the activity, which has targets.
        motion: its motion, found without regard to what comes after.
        then: the next activity; its state and time before are ignored.

    Returns:
        None where nothing is gained.
    """
    targets, tracked = doing.activity.track, motion.tracked
    if targets is None or tracked is None or motion.trajectory is None:
        return None
    pursuit = Pursuit.of(doing.scene.usable, doing.scene.constraints, targets)
    if pursuit.equations >= _EQUATIONS_OF_ATTITUDE:
        return None
    ahead = _find_next_slew(motion, then, FIRST)
    if ahead is not None and ahead.can_gain and then.activity.attitude is None:
        ahead = _find_next_slew(motion, then, ahead.bound.seconds)  # targets depend on when it ends
    if ahead is None or not ahead.can_gain:
        return None
    for over in _DRAW_TIMES:
        best, found = motion, ahead
        for _ in range(_MAX_ROUNDS):
            drawn = _draw_end_toward(doing, pursuit, best, found.attitude, over)
            after = None if drawn is None else _find_next_slew(drawn, then, found.bound.seconds)
            if drawn is None or after is None:
                break
            gained = found.bound.seconds - after.bound.seconds
            if gained < _MIN_GAIN:
                break
            best, found = drawn, after
            if gained < _SMALL_GAIN_SHARE * after.bound.seconds or not after.can_gain:
                break
        if best is not motion:
            return Led(motion=best, bound=ahead.bound.seconds)
        if drawn is not None:
            return None  # what breaks nothing and gains nothing gains no more where it is drawn less
    return None


def _find_next_slew(motion: Motion, then: Doing, seconds: float) -> _NextSlew | None:
    """Return the slew from the end of a motion to the activity `then`; it takes about `seconds`.

    Returns:
        None where step 1 finds no state for the activity.
    """
    assert motion.trajectory is not None
    length = motion.trajectory.duration
    state, time = State.of(motion.trajectory, length), motion.begin + length
    then = replace(then, before=state, time=time, last=None)
    goal = _find_begin_state(then, then.seen_from(min(time + max(seconds, LEAST), then.last_begin)))
    if goal is None:
        return None
    craft = holding(then.scene.spacecraft, then.total, state)
    bound = Departure(scene=then.scene, craft=craft, state=state, time=time).limiting(goal)
    by_platform = bound.name not in craft.joint_names
    return _NextSlew(attitude=goal.attitude, bound=bound, by_platform=by_platform)


def _find_begin_state(then: Doing, time: float) -> State | None:
    """Return the best state of step 1 in which an activity may begin at `time`, s; None if there is none."""
    given, targets = then.activity.attitude, then.activity.targets
    if given is not None:
        return State.still(given.attitude, given.joints)
    if targets is None or time > then.last_begin:
        return None
    goals = then.attempted(then.scene.usable, targets, time).goals
    return then.at_rates(targets, goals[0], time) if goals else None


def _draw_end_toward(
    doing: Doing, pursuit: Pursuit, near: Motion, attitude: np.ndarray, over: float
) -> Motion | None:
    """Return a motion near another one, its end drawn to an attitude; None if it breaks something.

    Args:
        doing: the activity.
        pursuit: its targets, and the constraints.
        near: the other motion.
        attitude: (3, 3) body to inertial.
        over: s, the time T of the added term: the shorter, the stronger it draws.
    """
    tracked, targets = near.tracked, doing.activity.track
    assert tracked is not None
    assert targets is not None
    nodes, (rate, acceleration) = tracked.nodes, tracked.wanted.weights
    smooth = max(acceleration, rate * (_SMOOTHING_SHARE * (nodes.times[-1] - nodes.times[0])) ** 2)
    wanted = replace(
        tracked.wanted, ahead=attitude, ahead_time=over, held=_HELD_NODES, weights=(rate, smooth)
    )
    search = LeastMotion(pursuit, wanted, tracked.free)
    turned = search.solve(nodes.times, nodes.attitudes, nodes.joints)
    through = _refine_turned_nodes(pursuit, near, turned)
    if through is None:
        return None
    found = tracked_through(search, turned, through, float(targets.tolerance))
    own = replace(
        near, state=State.of(found.trajectory, 0.0), trajectory=found.trajectory, tracked=found, led=True
    )
    if not keeps_all(own):
        return None
    try:
        doing.expect_possible(own)
    except Refused:
        return None
    return own


def _refine_turned_nodes(pursuit: Pursuit, near: Motion, turned: Nodes) -> Nodes | None:
    """Return a finer set of nodes through turned ones that begins as the motion `near` does.

    The turn from that motion is zero, with two derivatives, until the last held node. A spline through the
    turned nodes alone would swing there, and so have other rates at its start.

    Returns:
        None where the turn is too large for its direction to be certain.
    """
    assert near.tracked is not None
    assert near.trajectory is not None
    nodes, count = near.tracked.nodes, len(turned.times)
    turns = so3.log(np.swapaxes(nodes.attitudes, 1, 2) @ turned.attitudes)
    if np.max(np.linalg.norm(turns, axis=1)) > _MAX_TURN:
        return None
    apart = np.concatenate([turns, turned.joints - nodes.joints], axis=1)[_HELD_NODES - 1 :]
    spline = curves.rising(turned.times[_HELD_NODES - 1 :], apart)
    times = np.linspace(turned.times[0], turned.times[-1], _REFINEMENT * (count - 1) + 1)
    at = near.trajectory.sample(np.clip(times - times[0], 0, near.trajectory.duration))
    own = np.where((times > turned.times[_HELD_NODES - 1])[:, None], spline(times), 0.0)
    attitudes = pursuit.meeting(at.attitude @ so3.exp(own[:, :3]), times)
    joints = pursuit.joints(attitudes, times, at.joints + own[:, 3:])
    return Nodes(times=times, attitudes=attitudes, joints=pursuit.unwrapped(joints))
