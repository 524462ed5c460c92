"""Satellites in motion: circular orbits of `jaxplan.orbits`, and two-line elements by SGP4."""

import warnings
from dataclasses import dataclass
from numbers import Real

import jax
import numpy as np

from jaxplan import orbits
from jaxplan.display import shown
from jaxplan.epochs import parse_epoch
from jaxplan.sky.frames import teme_to_gcrs
from jaxplan.sky.instants import elapsed, library
from jaxplan.sky.tle import StaleTleWarning, Tle, TleError

STALE_DAYS = 7.0  # from here on SGP4 is likely tens of km off in low orbit
LAST_DAYS = 30.0  # from here on hundreds
_DAY = 86400.0

# What SGP4 answers instead of a position.
_ERRORS = {
    1: "the mean eccentricity leaves [0, 1)",
    2: "the mean motion is not positive",
    3: "the perturbed eccentricity leaves [0, 1]",
    4: "the semi-latus rectum is negative",
    6: "the satellite has decayed",
}


@shown("altitude km", "inclination deg", "node deg", "latitude deg", "epoch")
@dataclass(frozen=True, kw_only=True)
class CircularOrbit:
    """A satellite on a circular Keplerian orbit, as in `jaxplan.orbits`.

    Its elements are those about the axes of the GCRS: the equator of J2000, not that of date, from which
    it differs by 0.006 deg a year.

    Attributes:
        altitude: km above the equatorial radius, in (0, 1e6].
        inclination: rad, in [-pi, pi].
        node: rad, right ascension of the ascending node.
        latitude: rad, argument of latitude at the orbit's epoch.
        epoch: UTC in ISO 8601; None for that of each question, whose times then count from the elements.
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
    """Position and velocity on a circular orbit.

    Args:
        orbit: the satellite's.
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3) km and (..., 3) km/s, GCRS.
    """
    if orbit.epoch is not None:
        times = elapsed(parse_epoch(orbit.epoch), epoch, times)
    elements = (orbit.altitude, orbit.inclination, orbit.node, orbit.latitude)
    with jax.enable_x64(True):
        position, velocity = np.asarray(orbits.position(*elements)), np.asarray(orbits.velocity(*elements))
        rate = float(orbits.mean_motion(orbit.altitude))
    # numpy goes round the circle, since JAX would compile anew for every number of times
    cos, sin = np.cos(rate * times)[..., None], np.sin(rate * times)[..., None]
    return cos * position + sin / rate * velocity, cos * velocity - sin * rate * position


def tle_state(tle: Tle, epoch: np.datetime64, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity by SGP4, with its constants of WGS 72, to which two-line elements are fitted.

    Args:
        tle: the satellite's elements.
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3) km and (..., 3) km/s, GCRS.

    Raises:
        TleError: if a time is more than 30 days from the elements' epoch, or SGP4 finds that the satellite
            has decayed or has no orbit.

    Warns:
        StaleTleWarning: if a time is more than 7 days from the elements' epoch.
    """
    position, velocity = tle_state_teme(tle, elapsed(tle.epoch, epoch, times))
    rotation = teme_to_gcrs(epoch, times)
    return (rotation @ position[..., None])[..., 0], (rotation @ velocity[..., None])[..., 0]


def tle_state_teme(tle: Tle, since: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity by SGP4 in its own frame.

    Args:
        tle: the satellite's elements.
        since: (...) s from their epoch on.

    Returns:
        (..., 3) km and (..., 3) km/s, TEME of each instant; it raises and warns as `tle_state` does.
    """
    _check_age(tle, since)
    record = library("sgp4.api").Satrec.twoline2rv(tle.line1, tle.line2)
    days = np.atleast_1d(since) / _DAY
    codes, position, velocity = record.sgp4_array(
        np.full(days.shape, record.jdsatepoch), record.jdsatepochF + days
    )
    bad = (codes != 0) | ~np.all(np.isfinite(position) & np.isfinite(velocity), axis=-1)
    if np.any(bad):
        first = int(np.argmax(bad))
        reason = _ERRORS.get(int(codes[first]), f"SGP4 has no answer (code {codes[first]})")
        raise TleError(f"{tle.name}: {reason}, {days[first]:.6g} days from the elements' epoch {tle.epoch}")
    return position.reshape(*since.shape, 3), velocity.reshape(*since.shape, 3)


def _check_age(tle: Tle, since: np.ndarray) -> None:
    if not since.size:
        return
    days = np.abs(since) / _DAY
    oldest = float(since.flat[int(np.argmax(days))]) / _DAY
    far = f"{tle.name}: {oldest:.1f} days from the elements' epoch {str(tle.epoch)[:19]}"
    if not np.all(days <= LAST_DAYS):
        raise TleError(f"{far}, must lie in [{-LAST_DAYS:g}, {LAST_DAYS:g}]")
    if np.any(days > STALE_DAYS):
        advice = f"beyond {STALE_DAYS:g} the position may be tens of km off; take newer elements"
        warnings.warn(f"{far}, {advice}", StaleTleWarning, stacklevel=2)
