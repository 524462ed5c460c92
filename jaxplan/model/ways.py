"""Distances that a motion has to cover, and the least time for that where speed and its growth have limits.

Units are those of the distance: rad for angles.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan.geometry.vectors import AnyArray, arrays

_ROOTS = 12  # steps of Newton's method, which has then converged to rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """A distance that a motion has to cover, and the limits of the speed along it.

    Its unit U is rad for angles, rad over that of the box for lengths in boxes, and rad (kg m^2)^1/2 for the
    length by the energy.

    Attributes:
        name: of the limits.
        distance: (...) U, with a sign where it has one.
        top: U/s, largest speed, or inf.
        growth: U/s^2, largest acceleration along the way.
        more_growth: U/s^4, by which that grows with the square of the time since rest; zero for a motion with
            rates at an end.
        speeds: (2,) U/s, at start and end; None from rest to rest.
        signed: whether the speed may be negative, as that of a joint.
    """

    name: str
    distance: AnyArray
    top: AnyArray
    growth: AnyArray
    more_growth: AnyArray = 0.0
    speeds: AnyArray | None = None
    signed: bool = False

    @property
    def rest_time(self) -> AnyArray:
        """Least time (...) s from rest to rest, with numpy or JAX."""
        xp, far, top, growth, more = arrays(self.distance, self.top, self.growth, self.more_growth)
        far = xp.abs(far)
        full = top / growth  # s, until the top is reached; from above, where Newton's method stays
        for _ in range(_ROOTS):
            full = full - (full * (growth + more * full**2 / 3) - top) / (growth + more * full**2)
        flanks = full**2 * (growth + more * full**2 / 6)  # covered by both of them
        moving = far > 0
        some = xp.where(moving, far, 1)
        square = 2 * some / (growth + xp.sqrt(growth**2 + 2 * more * some / 3))
        time = xp.where(far < flanks, 2 * xp.sqrt(square), 2 * full + (far - flanks) / top)
        return xp.where(moving, time, 0)

    @property
    def time(self) -> np.ndarray:
        """Least time between the speeds at both ends, (...) s; in numpy."""
        if self.speeds is None:
            return np.asarray(self.rest_time)
        first, last = self.speeds
        found = shortest_time(self.distance, first, last, self.top, self.growth)
        # speeds along a length are at least zero: on too short a one they cannot change within the growth
        short = 2 * self.growth * np.abs(self.distance) < np.abs(first**2 - last**2)
        return np.where(short & (not self.signed), np.abs(first - last) / self.growth, found)


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
