"""Strict lower bounds of the duration of any motion within the limits of a spacecraft.

A *way* is a distance that a motion has to cover: a length of the platform's turn, or the change of a joint's
angle. The motion has a speed along each way. Limits keep the magnitude of the speed below a *top*, and the
magnitude of its rate of change below a *growth*. So the motion takes at least as long as a trapezoid or a
triangle of the speed that covers the way. Every way gives a lower bound of the duration, and the largest of
them is used.

`jaxplan.model.platform_turns` has the ways of the platform, by rates, accelerations, torque, wheels and
inertia. The way of a joint has its rate as speed, and the joint's own limits.

These bounds know neither zones, nor jerk, nor that accelerations must be continuous, all of which can only
lengthen a motion. Radians, seconds, body axes; 2n + d joints of n terminals and d drives: yaws, pitches,
drives.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.minimum_times import Way
from jaxplan.model.platform_turns import Ends, ways_of_platform
from jaxplan.model.quadratic import greatest_of
from jaxplan.model.spacecraft import Spacecraft

# A bound below this fraction of the duration says nothing, such as that of a path that ends at its start.
_MIN_BOUND_SHARE = 0.01


@dataclass(frozen=True, kw_only=True)
class DurationBound:
    """A strict lower bound of the duration.

    Attributes:
        seconds: s; no motion takes less.
        name: name of the limits from which the bound follows.
    """

    seconds: float
    name: str


def rest_bounds(spacecraft: Spacecraft, turns: ArrayLike, moves: ArrayLike) -> AnyArray:
    """Return strict lower bounds of the durations of motions from rest to rest.

    Args:
        spacecraft: the spacecraft, with its limits.
        turns: (N, 3) rad, rotation vectors of the platform in the body axes at the start.
        moves: (N, 2n + d) rad, changes of the joints.

    Returns:
        (N,) s. Derivatives are finite, and right almost everywhere; those with respect to the inertia take
        its principal axes as constant.
    """
    _, turned, moved = arrays(turns, moves)
    times = [way.rest_time for way in ways_of_platform(spacecraft, turned, Ends())]
    times += [way.rest_time for way in ways_of_joints(spacecraft, moved)]
    return greatest_of(times)


def times_along(spacecraft: Spacecraft, paths: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Estimate how long motions along paths take, in order to compare the paths.

    On each edge the slowest of platform and joints counts, at its top speed. A top speed that cannot be
    reached by accelerating along half of the path is lowered to what can.

    Args:
        spacecraft: the spacecraft, with its limits.
        paths: P of them, each as attitudes (m + 1, 3, 3), body to inertial, and joints (m + 1, 2n + d) rad.

    Returns:
        (P,) s, which are no bounds.
    """
    before = np.concatenate([attitudes[:-1] for attitudes, _ in paths])
    after = np.concatenate([attitudes[1:] for attitudes, _ in paths])
    moves = np.concatenate([np.diff(joints, axis=0) for _, joints in paths])
    owner = np.repeat(np.arange(len(paths)), [len(joints) - 1 for _, joints in paths])  # of each edge
    turns = so3.log(np.swapaxes(before, -1, -2) @ after)
    ways = [*ways_of_platform(spacecraft, turns, Ends()), *ways_of_joints(spacecraft, moves)]
    slowest = np.zeros(len(turns))
    for way in ways:
        far = np.abs(way.distance)
        whole = np.maximum(np.bincount(owner, far, len(paths)), np.finfo(float).tiny)
        speed = np.minimum(way.top, np.sqrt(way.growth * whole))
        slowest = np.maximum(slowest, far / speed[owner])
    return np.bincount(owner, slowest, len(paths))


def duration_bound(
    spacecraft: Spacecraft,
    attitudes: np.ndarray,
    joints: np.ndarray,
    angular_velocities: np.ndarray,
    joint_rates: np.ndarray,
) -> DurationBound:
    """Return a strict lower bound of the duration of a motion between two states, with rates at both.

    Args:
        spacecraft: the spacecraft, with its limits.
        attitudes: (2, 3, 3) at start and end, body to inertial.
        joints: (2, 2n + d) rad, likewise.
        angular_velocities: (2, 3) rad/s, likewise, body axes.
        joint_rates: (2, 2n + d) rad/s, likewise.

    Returns:
        The largest bound of all ways, with the name of its limits; of equal ones the first.
    """
    turning = bool(np.any(angular_velocities))
    ways = _ways_between(spacecraft, attitudes, joints, angular_velocities, joint_rates, turning=turning)
    times = [float(way.time) for way in ways]
    slowest = int(np.argmax(times))
    return DurationBound(seconds=times[slowest], name=ways[slowest].name)


def moving_bound(
    spacecraft: Spacecraft,
    attitudes: AnyArray,
    joints: AnyArray,
    angular_velocities: AnyArray,
    joint_rates: AnyArray,
    *,
    turning: bool,
) -> AnyArray:
    """Return the seconds of `duration_bound`, as a number of numpy or JAX with derivatives.

    Args:
        spacecraft: the spacecraft, with its limits.
        attitudes: (2, 3, 3) at start and end, body to inertial.
        joints: (2, 2n + d) rad, likewise.
        angular_velocities: (2, 3) rad/s, likewise, body axes.
        joint_rates: (2, 2n + d) rad/s, likewise.
        turning: whether the platform turns at start or end. If it rests at both, the bound uses more limits.

    Returns:
        s. Derivatives are finite, and right almost everywhere. Where a platform or joint rests at an end,
        they are those of one that stays at rest there.
    """
    ways = _ways_between(spacecraft, attitudes, joints, angular_velocities, joint_rates, turning=turning)
    return greatest_of([way.time for way in ways])


def _ways_between(
    craft: Spacecraft,
    attitudes: AnyArray,
    joints: AnyArray,
    angular_velocities: AnyArray,
    joint_rates: AnyArray,
    *,
    turning: bool,
) -> list[Way]:
    """Return all ways (see the module's docstring) between two states.

    Arguments are as for `moving_bound`.
    """
    xp, attitudes, joints, spins, rates = arrays(attitudes, joints, angular_velocities, joint_rates)
    turn = so3.log(attitudes[0].T @ attitudes[1])
    ends = Ends(spins if turning else None, joints, rates)
    if not turning and (craft.stages is None or (xp is np and not np.any(rates))):
        ends = Ends()  # the joints have no influence, and what is known of the spacecraft is used
    ways = list(ways_of_platform(craft, turn, ends))
    return [*ways, *ways_of_joints(craft, joints[1] - joints[0], rates)]


def excess(duration: float, bound: float) -> float | None:
    """Return the fraction by which a duration exceeds a bound, both in s.

    The result is None if the bound is too low to tell anything.
    """
    return duration / bound - 1 if bound > _MIN_BOUND_SHARE * duration else None


def ways_of_joints(craft: Spacecraft, moves: AnyArray, rates: AnyArray | None = None) -> Iterator[Way]:
    """Yield the way of each joint.

    Args:
        craft: the spacecraft, with its limits.
        moves: (..., 2n + d) rad, changes of the joints.
        rates: (2, 2n + d) rad/s, at start and end; None for rest.
    """
    tops, growths = craft.joint_rate_limits, craft.joint_acceleration_limits
    for number, name in enumerate(craft.joint_names):
        yield Way(
            name=name,
            distance=moves[..., number],
            top=tops[number],
            growth=growths[number],
            speeds=None if rates is None else rates[:, number],
            signed=True,
        )
