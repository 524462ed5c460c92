"""Keplerian orbits of any shape that does not escape: undisturbed two-body motion.

Left out are drag, Sun, Moon and the Earth's oblateness, by which the node of a low orbit turns by up to 8 deg
a day, and the position is off by tens of km after one revolution. For long times use two-line elements or an
ephemeris.
"""

from dataclasses import dataclass
from numbers import Real

import numpy as np

from jaxplan.model.epochs import parse_epoch
from jaxplan.runtime.display import shown
from jaxplan.sky.frames import elapsed
from jaxplan.sky.orbits import EARTH_MU, EARTH_RADIUS

_MAX_ITERATIONS = 60  # of Newton's method, more than any solution takes: 3 to 6, but for e near 1
_ANGLE_FIELDS = ("node", "perigee", "anomaly")


@shown(
    "semi_major_axis km", "eccentricity", "inclination deg", "node deg", "perigee deg", "anomaly deg", "epoch"
)
@dataclass(frozen=True, kw_only=True)
class KeplerOrbit:
    """A satellite on a Keplerian orbit, with elements about the axes of the GCRS (the equator of J2000).

    Attributes:
        semi_major_axis: km, at most 1e6, and so large that the perigee is outside the Earth.
        eccentricity: in [0, 1).
        inclination: rad, in [-pi, pi].
        node: rad, right ascension of the ascending node.
        perigee: rad, argument of the perigee, measured from the ascending node.
        anomaly: rad, true anomaly at the orbit's epoch, measured from the perigee.
        epoch: UTC in ISO 8601 at which the elements hold; None for the epoch given in each call.
    """

    semi_major_axis: float
    eccentricity: float
    inclination: float
    node: float
    perigee: float
    anomaly: float
    epoch: str | None = None

    def __post_init__(self) -> None:
        for name in ("semi_major_axis", "eccentricity", "inclination", *_ANGLE_FIELDS):
            given: object = getattr(self, name)  # whatever its type says
            if isinstance(given, bool) or not isinstance(given, Real):
                raise ValueError(f"{name} = {given!r}: must be a number")
        if not 0 <= self.eccentricity < 1:
            raise ValueError(f"eccentricity = {self.eccentricity}: must lie in [0, 1)")
        if not 0 < self.semi_major_axis <= 1e6:
            raise ValueError(f"semi_major_axis = {self.semi_major_axis}: must lie in (0, 1e6] km")
        lowest = self.semi_major_axis * (1 - self.eccentricity)
        if not lowest > EARTH_RADIUS:
            raise ValueError(
                f"semi_major_axis = {self.semi_major_axis}: the perigee is {lowest:.6g} km from the Earth's "
                f"centre, must be beyond {EARTH_RADIUS}"
            )
        if not abs(self.inclination) <= np.pi:  # more is degrees
            raise ValueError(f"inclination = {self.inclination}: must lie in [-pi, pi] rad")
        for name in _ANGLE_FIELDS:
            if not abs(getattr(self, name)) <= 1e3:
                raise ValueError(f"{name} = {getattr(self, name)}: must lie in [-1e3, 1e3] rad")
        if self.epoch is not None:
            parse_epoch(self.epoch)


def kepler_state(
    orbit: KeplerOrbit, epoch: np.datetime64, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity on a Keplerian orbit.

    Args:
        orbit: the orbit of the satellite.
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3) km and (..., 3) km/s, GCRS.
    """
    if orbit.epoch is not None:
        times = elapsed(parse_epoch(orbit.epoch), epoch, times)
    a, e = orbit.semi_major_axis, orbit.eccentricity
    minor = np.sqrt((1 - e) * (1 + e))  # semi-minor axis, in semi-major ones
    rate = np.sqrt(EARTH_MU / a) / a
    first = 2 * np.arctan2(
        np.sqrt(1 - e) * np.sin(orbit.anomaly / 2), np.sqrt(1 + e) * np.cos(orbit.anomaly / 2)
    )
    eccentric = eccentric_anomaly(first - e * np.sin(first) + rate * times, e)
    cos, sin = np.cos(eccentric), np.sin(eccentric)
    speed = a * rate / (1 - e * cos)
    plane = _perifocal_axes(orbit)
    position = np.stack([a * (cos - e), a * minor * sin], axis=-1) @ plane
    velocity = np.stack([-speed * sin, speed * minor * cos], axis=-1) @ plane
    return position, velocity


def eccentric_anomaly(mean: np.ndarray, eccentricity: float) -> np.ndarray:
    """Solve Kepler's equation ``E - e sin E = M`` for the eccentric anomaly ``E``.

    Args:
        mean: (...) rad, the mean anomaly ``M``, of any number of turns.
        eccentricity: ``e``, in [0, 1).

    Returns:
        (...) rad, in the same turn as the mean anomaly.
    """
    turns = 2 * np.pi * np.round(np.asarray(mean) / (2 * np.pi))
    wanted = mean - turns  # in [-pi, pi]
    # Beyond the solution on the side where the function is convex, so that no step leads past it.
    found = np.where(wanted < 0, -np.pi, np.pi) * np.ones(np.shape(wanted))
    for _ in range(_MAX_ITERATIONS):
        step = (found - eccentricity * np.sin(found) - wanted) / (1 - eccentricity * np.cos(found))
        found = found - step
        if np.all(np.abs(step) <= 1e-14):
            break
    return np.asarray(found + turns)


def _perifocal_axes(orbit: KeplerOrbit) -> np.ndarray:
    """Return unit vectors (2, 3), GCRS, toward the perigee and toward a true anomaly of a quarter turn."""
    ci, si = np.cos(orbit.inclination), np.sin(orbit.inclination)
    co, so = np.cos(orbit.node), np.sin(orbit.node)
    cw, sw = np.cos(orbit.perigee), np.sin(orbit.perigee)
    at_node, quarter_on = np.array([co, so, 0.0]), np.array([-so * ci, co * ci, si])
    return np.stack([cw * at_node + sw * quarter_on, cw * quarter_on - sw * at_node])
