"""Satellites on circular orbits; `jaxplan.sky.orbits` has the mathematics."""

from dataclasses import dataclass
from functools import lru_cache
from numbers import Real

import jax
import numpy as np

from jaxplan.model.epochs import parse_epoch
from jaxplan.runtime.display import shown
from jaxplan.sky import orbits
from jaxplan.sky.frames import elapsed


@shown("altitude km", "inclination deg", "node deg", "latitude deg", "epoch")
@dataclass(frozen=True, kw_only=True)
class CircularOrbit:
    """A satellite on a circular Keplerian orbit, as in `jaxplan.sky.orbits`.

    Its elements refer to the axes of the GCRS: to the equator of J2000, not that of date, from which it
    differs by 0.006 deg a year.

    Attributes:
        altitude: km above the Earth's equatorial radius, in (0, 1e6].
        inclination: rad, in [-pi, pi].
        node: rad, right ascension of the ascending node.
        latitude: rad, argument of latitude at the orbit's epoch.
        epoch: UTC in ISO 8601 at which `latitude` holds; None for the epoch given in each call.
    """

    altitude: float
    inclination: float
    node: float
    latitude: float
    epoch: str | None = None

    def __post_init__(self) -> None:
        for name in ("altitude", "inclination", "node", "latitude"):
            given: object = getattr(self, name)  # whatever its type says
            if isinstance(given, bool) or not isinstance(given, Real):
                raise ValueError(f"{name} = {given!r}: must be a number")
        if not 0 < self.altitude <= 1e6:
            raise ValueError(f"altitude = {self.altitude}: must lie in (0, 1e6] km")
        if not abs(self.inclination) <= np.pi:  # more is degrees
            raise ValueError(f"inclination = {self.inclination}: must lie in [-pi, pi] rad")
        for name in ("node", "latitude"):
            if not abs(getattr(self, name)) <= 1e3:
                raise ValueError(f"{name} = {getattr(self, name)}: must lie in [-1e3, 1e3] rad")
        if self.epoch is not None:
            parse_epoch(self.epoch)


def orbit_state(
    orbit: CircularOrbit, epoch: np.datetime64, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity on a circular orbit.

    Args:
        orbit: the orbit of the satellite.
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3) km and (..., 3) km/s, GCRS.
    """
    if orbit.epoch is not None:
        times = elapsed(parse_epoch(orbit.epoch), epoch, times)
    position, velocity, rate = _epoch_state(orbit.altitude, orbit.inclination, orbit.node, orbit.latitude)
    # numpy goes round the circle, since JAX would compile anew for every number of times
    cos, sin = np.cos(rate * times)[..., None], np.sin(rate * times)[..., None]
    return cos * position + sin / rate * velocity, cos * velocity - sin * rate * position


@lru_cache(maxsize=4096)
def _epoch_state(*elements: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return position (3,) km, velocity (3,) km/s and mean motion, rad/s, at the epoch of a circular orbit.

    The arguments are altitude, inclination, node and latitude, as in `CircularOrbit`.
    """
    with jax.enable_x64(True):
        position, velocity = np.asarray(orbits.position(*elements)), np.asarray(orbits.velocity(*elements))
        return position, velocity, float(orbits.mean_motion(elements[0]))
