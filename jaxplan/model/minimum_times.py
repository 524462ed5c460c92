"""Distances that a motion has to cover, and the least time for them if speed and acceleration have limits.

Units are those of the distance: rad for angles. *Ways*, *top* and *growth* are explained in
`jaxplan.model.duration_bound`.
"""

from dataclasses import dataclass

from jaxplan.geometry.vectors import AnyArray, arrays

_NEWTON_STEPS = 12  # steps of Newton's method, which has then converged to rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """A distance that a motion has to cover, and the limits of the speed along it.

    Its unit U is rad for angles, rad over the unit of the box's sides for lengths in boxes (so s for a box of
    rates), and rad (kg m^2)^1/2 for the length by the energy.

    Attributes:
        name: name of the limits.
        distance: (...) U, with a sign if `signed`.
        top: U/s, largest speed, or inf.
        growth: U/s^2, largest acceleration along the way.
        more_growth: U/s^4, by which the largest acceleration rises with the square of the time since rest;
            None where it does not, as for a motion that does not rest at both ends.
        speeds: (2,) U/s, at start and end; None from rest to rest.
        signed: whether the speed may be negative, as that of a joint.
    """

    name: str
    distance: AnyArray
    top: AnyArray
    growth: AnyArray
    more_growth: AnyArray | None = None
    speeds: AnyArray | None = None
    signed: bool = False

    @property
    def rest_time(self) -> AnyArray:
        """Least time (...) s in which the distance is covered from rest to rest, of numpy or JAX."""
        grows = self.more_growth is not None
        more_growth = self.more_growth if grows else 0.0
        xp, far, top, growth, more = arrays(self.distance, self.top, self.growth, more_growth)
        far = xp.abs(far)
        full = top / growth  # s, until the top is reached; Newton's method comes from above
        for _ in range(_NEWTON_STEPS if grows else 0):
            full = full - (full * (growth + more * full**2 / 3) - top) / (growth + more * full**2)
        flanks = full**2 * (
            growth + more * full**2 / 6
        )  # distance covered while speeding up and slowing down
        moving = far > 0
        some = xp.where(moving, far, 1)
        square = 2 * some / (growth + xp.sqrt(growth**2 + 2 * more * some / 3))
        time = xp.where(far < flanks, 2 * xp.sqrt(square), 2 * full + (far - flanks) / top)
        return xp.where(moving, time, 0)

    @property
    def time(self) -> AnyArray:
        """Least time (...) s to cover the distance between the speeds at both ends, of numpy or JAX."""
        if self.speeds is None:
            return self.rest_time
        xp, far, top, growth, speeds = arrays(self.distance, self.top, self.growth, self.speeds)
        first, last = speeds[0], speeds[1]
        found = shortest_time(far, first, last, top, growth)
        if self.signed:
            return found
        # A speed along a length is never negative. If the length is too short for the change of speed, the
        # time of that change alone is the bound.
        short = 2 * growth * xp.abs(far) < xp.abs(first**2 - last**2)
        return xp.where(short, xp.abs(first - last) / growth, found)


def shortest_time(
    distance: AnyArray, first: AnyArray, last: AnyArray, rate: AnyArray, acceleration: AnyArray
) -> AnyArray:
    """Return the least time of a motion on a line with bounded rate and acceleration, of numpy or JAX.

    Args:
        distance: (...) rad, with its sign.
        first: (...) rad/s, rate at the start, within the limit.
        last: (...) rad/s, rate at the end, within the limit.
        rate: (...) rad/s, limit of the rate's magnitude; may be infinite.
        acceleration: (...) rad/s^2, limit of the acceleration's magnitude.

    Returns:
        (...) s. Its derivatives are finite, and right almost everywhere.
    """
    xp, distance, first, last, rate, acceleration = arrays(distance, first, last, rate, acceleration)
    highest = xp.where(
        xp.isfinite(rate), rate, 1
    )  # without a limit there is no coasting, and any number will do
    found = []
    for sign in (1, -1):  # of the first acceleration
        d, v, w = sign * distance, sign * first, sign * last
        square = acceleration * d + (v**2 + w**2) / 2  # of the rate at the top of a triangle
        some = square > 0
        top = xp.where(some, xp.sqrt(xp.where(some, square, 1)), 0)
        triangle = (2 * top - v - w) / acceleration
        coasting = (2 * highest - v - w) / acceleration + (square - highest**2) / (highest * acceleration)
        time = xp.where(top <= rate, triangle, coasting)
        possible = (square >= 0) & (top >= xp.maximum(v, w) * (1 - 1e-12) - 1e-15)
        found.append(xp.where(possible, xp.maximum(time, 0), xp.inf))
    return xp.where(found[1] < found[0], found[1], found[0])
