"""Strict lower bounds of the time that any motion takes within the limits of a spacecraft.

A *way* is a distance that a motion has to cover: a length of the platform's turn, or the change of a joint's
angle. Along each the motion has a speed, whose magnitude limits keep below a *top*, and whose rate of change
they keep below a *growth*, its largest acceleration. So a way takes at least the time of a trapezoid of the
speed, or of a triangle. Every way gives a lower bound of the duration, and the largest of them is used.

`jaxplan.model.platform_turns` has those of the platform, by rates, accelerations, torque, wheels and inertia;
that of a joint's angle has its rate for speed, and the joint's own limits.

No zone is in these bounds, nor jerk, nor that accelerations be continuous: they only add to the time.
Radians, seconds, body axes.
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

_TELLING = 0.01  # share of the duration below which a bound says nothing, as of a path that ends at its start


@dataclass(frozen=True, kw_only=True)
class DurationBound:
    """A strict lower bound of the duration.

    Attributes:
        seconds: s, no motion takes less.
        name: of the limits from which the bound follows.
    """

    seconds: float
    name: str


def rest_bounds(spacecraft: Spacecraft, turns: ArrayLike, moves: ArrayLike) -> AnyArray:
    """Strict lower bounds of the time of motions from rest to rest.

    Args:
        spacecraft: its limits.
        turns: (N, 3) rad, rotation vectors of the platform in the axes that the body has at first.
        moves: (N, 2n + d) rad, of the joints.

    Returns:
        (N,) s. Derivatives are finite, and right almost everywhere; by the inertia the principal axes are
        taken to stay.
    """
    _, turned, moved = arrays(turns, moves)
    times = [way.rest_time for way in ways_of_platform(spacecraft, turned, Ends())]
    times += [way.rest_time for way in _ways_of_joints(spacecraft, moved)]
    return greatest_of(times)


def times_along(spacecraft: Spacecraft, paths: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """About how long motions along paths take, to compare these: the slowest on each edge at top speed.

    A top speed that cannot be reached by accelerating along half of a path is lowered to what can.

    Args:
        spacecraft: its limits.
        paths: P of them, each as attitudes (m + 1, 3, 3), body to inertial, and joints (m + 1, 2n + d) rad.

    Returns:
        (P,) s, no bounds.
    """
    before = np.concatenate([attitudes[:-1] for attitudes, _ in paths])
    after = np.concatenate([attitudes[1:] for attitudes, _ in paths])
    moves = np.concatenate([np.diff(joints, axis=0) for _, joints in paths])
    owner = np.repeat(np.arange(len(paths)), [len(joints) - 1 for _, joints in paths])  # of each edge
    turns = so3.log(np.swapaxes(before, -1, -2) @ after)
    ways = [*ways_of_platform(spacecraft, turns, Ends()), *_ways_of_joints(spacecraft, moves)]
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
    """Strict lower bound of the time of a motion between two states, with rates at either.

    Args:
        spacecraft: its limits.
        attitudes: (2, 3, 3) first and last, body to inertial.
        joints: (2, 2n + d) rad.
        angular_velocities: (2, 3) rad/s, body axes.
        joint_rates: (2, 2n + d) rad/s.

    Returns:
        The largest bound, with its name; of equal ones the first.
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
    """The seconds of `duration_bound` as a number of numpy or JAX, with derivatives.

    Args:
        spacecraft: its limits.
        attitudes: (2, 3, 3) first and last, body to inertial.
        joints: (2, 2n + d) rad.
        angular_velocities: (2, 3) rad/s, body axes.
        joint_rates: (2, 2n + d) rad/s.
        turning: whether the platform turns at either end. If it turns at neither more limits are known.

    Returns:
        s. Derivatives are finite, and right almost everywhere: where an end comes to rest they are those of
        one that stays at rest.
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
    """All ways between two states; arguments as of `moving_bound`."""
    _, attitudes, joints, spins, rates = arrays(attitudes, joints, angular_velocities, joint_rates)
    turn = so3.log(attitudes[0].T @ attitudes[1])
    ways = list(ways_of_platform(craft, turn, Ends(spins if turning else None, joints, rates)))
    return [*ways, *_ways_of_joints(craft, joints[1] - joints[0], rates)]


def excess(duration: float, bound: float) -> float | None:
    """Share by which a duration exceeds a bound, both in s; None where the bound is too low to matter."""
    return duration / bound - 1 if bound > _TELLING * duration else None


def _ways_of_joints(craft: Spacecraft, moves: AnyArray, rates: AnyArray | None = None) -> Iterator[Way]:
    """Yield the way of each joint, of changes (..., 2n + d) rad and rates (2, 2n + d) rad/s at both ends.

    Rates of None are zero.
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
