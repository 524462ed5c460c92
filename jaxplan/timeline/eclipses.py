"""Compute when the Earth hides the Sun from the spacecraft, if a scene's zones allow that.

A scene has no orbit, but zones about the Earth and the Sun have the directions to both over time. How far the
Earth is follows from how its direction turns: on a Kepler orbit the angular momentum ``h = r^2 theta'`` is
constant and ``r = p / (1 + e cos(theta - w))``, so that ``sqrt(theta')`` is ``(mu / p^3)^(1/4)`` times ``1 +
e cos(theta - w)``, which is linear in ``1, cos theta, sin theta`` and so can be fitted. Here ``r`` is the
distance, ``theta`` the angle of the direction in the orbit's plane, ``p`` the semi-latus rectum, ``e`` the
eccentricity and ``w`` the angle of perigee. If that fit leaves more than a thousandth, no eclipses are
computed.

The Earth is taken as a sphere of its equatorial radius without air, and the Sun as its centre. On an orbit
disturbed by the Earth's flattening the ends of eclipses are off by some seconds.
"""

from collections.abc import Iterable

import numpy as np

from jaxplan.geometry.vectors import separation
from jaxplan.model.directions import DirectionPath
from jaxplan.model.zones import Zone
from jaxplan.sky import RADII
from jaxplan.sky.frames import EARTH_MU
from jaxplan.timeline.sign_changes import Changes, changes

_ZONE_NAMES = {"sun": ("sun",), "earth": ("earth", "nadir")}
_MAX_MISFIT = 1e-3  # relative error of the square root of the rate up to which an orbit counts as fitting
_MIN_ARC = 0.5  # rad of the orbit that must be known to tell its shape
_SAMPLE_STEP = 20.0  # s between samples


def paths_of(zones: Iterable[Zone]) -> tuple[DirectionPath, DirectionPath] | None:
    """Return the directions to Sun and Earth over time, from zones of these names; None if one is missing."""
    found: dict[str, DirectionPath] = {}
    for zone in zones:
        for body, names in _ZONE_NAMES.items():
            if zone.path is not None and zone.name.lower() in names:
                found.setdefault(body, zone.path)
    return (found["sun"], found["earth"]) if len(found) == len(_ZONE_NAMES) else None


def eclipses(sun: DirectionPath, earth: DirectionPath, end: float) -> Changes | None:
    """Find when the Sun's centre goes behind the Earth and comes out.

    Args:
        sun: inertial direction to the Sun.
        earth: inertial direction to the Earth's centre.
        end: s, until when to look.

    Returns:
        The changes, rising where the Sun comes out; None where the directions do not show an orbit.
    """
    if not earth.moves:
        return None
    first = max(0.0, float(earth.times[0]), float(sun.times[0]) if sun.moves else 0.0)
    last = min(end, float(earth.times[-1]), float(sun.times[-1]) if sun.moves else end)
    if not last > first:
        return None
    times = np.linspace(first, last, 2 + int((last - first) / _SAMPLE_STEP))
    orbit = _fit_orbit(earth, times)
    if orbit is None:
        return None
    east, north, shape = orbit

    def clearance(at: np.ndarray, _: np.ndarray) -> np.ndarray:
        down = np.asarray(earth.at(at))
        angle = np.arctan2(down @ north, down @ east)
        root = _harmonic_basis(angle) @ shape
        parameter = (EARTH_MU / shape[0] ** 4) ** (1 / 3)
        radius = parameter / (root / shape[0])
        limb = np.arcsin(np.minimum(RADII["earth"] / radius, 1.0))
        return np.asarray(separation(down, np.asarray(sun.at(at)))) - limb

    table = clearance(times, np.zeros(len(times), int))[:, None]
    return changes(table, times, clearance)


def _harmonic_basis(angle: np.ndarray) -> np.ndarray:
    """Return (k, 3): 1, cosine and sine of angles (k,), rad."""
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=-1)


def _fit_orbit(earth: DirectionPath, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Fit an orbit to directions to the Earth at `times`, s; None where none fits.

    Returns:
        Two unit vectors (3,) that span the orbit's plane, and coefficients (3,) of `_harmonic_basis` for the
        square root of the angular rate.
    """
    down, turn = np.asarray(earth.at(times)), np.asarray(earth.rate(times))
    normal = np.mean(np.cross(down, turn), axis=0)
    size = float(np.linalg.norm(normal))
    rate = np.linalg.norm(turn, axis=-1)
    if not size > 0 or not np.all(rate > 0):
        return None
    normal /= size
    east = down[0] - (down[0] @ normal) * normal
    east /= np.linalg.norm(east)
    north = np.cross(normal, east)
    angle = np.unwrap(np.arctan2(down @ north, down @ east))
    if np.ptp(angle) < _MIN_ARC:
        return None
    basis, root = _harmonic_basis(angle), np.sqrt(rate)
    shape = np.linalg.lstsq(basis, root, rcond=None)[0]
    misfit = np.max(np.abs(basis @ shape - root)) / shape[0]
    eccentric = np.linalg.norm(shape[1:]) / shape[0]
    if not (misfit <= _MAX_MISFIT and eccentric < 1):
        return None
    return east, north, shape
