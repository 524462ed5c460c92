"""A strict lower bound of the duration: what the slowest axis needs by itself.

A joint within its limits of rate and acceleration cannot be quicker than a trapezoid of its rate. Of the
platform every body axis has these limits, so the length of its angular velocity is at most sqrt(3) times the
limit, and grows at most sqrt(3) times as fast as one axis may; along the shortest rotation it is a trapezoid
again. Zones, torque, and that accelerations must be continuous, only add to it.
"""

import numpy as np

from jaxplan import so3
from jaxplan.model.spacecraft import Spacecraft

_TELLING = 0.01  # of the duration: a lower bound, as of a path that ends where it starts, tells nothing


def shortest_time(
    distance: np.ndarray, first: np.ndarray, last: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
) -> np.ndarray:
    """Least time of a motion on a line with bounded rate and acceleration.

    Args:
        distance: (...) rad, with its sign.
        first: (...) rad/s, rate at the start, within the limit.
        last: (...) rad/s, rate at the end, likewise.
        rate: (...) rad/s, the limit.
        acceleration: (...) rad/s^2, likewise.

    Returns:
        (...) s.
    """
    best = np.full(np.broadcast(distance, first, last, rate).shape, np.inf)
    for sign in (1, -1):  # which way it goes first
        d, v, w = sign * distance, sign * first, sign * last
        square = acceleration * d + (v**2 + w**2) / 2  # of the rate at the top of a triangle
        top = np.sqrt(np.maximum(square, 0))
        triangle = (2 * top - v - w) / acceleration
        coasting = (2 * rate - v - w) / acceleration + (square - rate**2) / (rate * acceleration)
        time = np.where(top <= rate, triangle, coasting)
        possible = (square >= 0) & (top >= np.maximum(v, w) * (1 - 1e-12) - 1e-15)
        best = np.minimum(best, np.where(possible, np.maximum(time, 0), np.inf))
    return best


def duration_bound(
    spacecraft: Spacecraft,
    attitudes: np.ndarray,
    joints: np.ndarray,
    angular_velocities: np.ndarray,
    joint_rates: np.ndarray,
) -> float:
    """No motion between two states that keeps the limits of rate and acceleration takes less time.

    Args:
        spacecraft: its limits.
        attitudes: (2, 3, 3) first and last, body to inertial.
        joints: (2, 2n) rad.
        angular_velocities: (2, 3) rad/s, body axes.
        joint_rates: (2, 2n) rad/s.

    Returns:
        s.
    """
    of_joints = shortest_time(
        joints[1] - joints[0],
        joint_rates[0],
        joint_rates[1],
        spacecraft.joint_rate_limits,
        spacecraft.joint_acceleration_limits,
    )
    slew = so3.distance(*attitudes)
    fastest = np.sqrt(3.0) * np.array([spacecraft.rate_limit, spacecraft.acceleration_limit])
    first, last = np.linalg.norm(angular_velocities, axis=1)
    of_platform = shortest_time(slew, first, last, fastest[0], fastest[1])
    if slew * 2 * fastest[1] < abs(first**2 - last**2):  # too short to change pace along it
        of_platform = np.abs(first - last) / fastest[1]
    return float(max(np.max(of_joints, initial=0.0), of_platform))


def excess(duration: float, bound: float) -> float | None:
    """Share by which a duration exceeds a bound, None where the bound is too low to tell anything."""
    return duration / bound - 1 if bound > _TELLING * duration else None
