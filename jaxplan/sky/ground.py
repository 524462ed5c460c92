"""Points of the ground, which turn with the Earth.

Latitude and longitude are geodetic, on the ellipsoid of WGS 84, and altitudes are above the ellipsoid: not
above the sea, from which it differs by up to 110 m. `jaxplan.sky.frames` says what is left out of the Earth's
rotation, and calls the axes that are fixed to the Earth ITRS.
"""

from dataclasses import dataclass
from numbers import Real

import numpy as np

from jaxplan.runtime.display import shown
from jaxplan.sky.frames import EARTH_RADIUS, earth_fixed_state, library

_FLATTENING = 1 / 298.257223563  # of the ellipsoid of WGS 84
_SQUARED_ECCENTRICITY = _FLATTENING * (2 - _FLATTENING)  # the square of its eccentricity


@shown("latitude deg", "longitude deg", "altitude m", "minimum_elevation deg")
@dataclass(frozen=True, kw_only=True)
class GroundPoint:
    """A point of the ground, or above it, which turns with the Earth.

    Attributes:
        latitude: rad, geodetic, positive north, in [-pi / 2, pi / 2].
        longitude: rad, positive east, in [-2 pi, 2 pi].
        altitude: m above the ellipsoid of WGS 84, in [-1000, 100000].
        minimum_elevation: rad, least elevation above its horizon at which it sees the observer, in [0, pi /
            2).
    """

    latitude: float
    longitude: float
    altitude: float = 0.0
    minimum_elevation: float = 0.0

    def __post_init__(self) -> None:
        for name in ("latitude", "longitude", "altitude", "minimum_elevation"):
            given: object = getattr(self, name)  # whatever its type says
            if isinstance(given, bool) or not isinstance(given, Real):
                raise ValueError(f"{name} = {given!r}: must be a number")
        if not abs(self.latitude) <= np.pi / 2:
            raise ValueError(f"latitude = {self.latitude}: must lie in [-pi / 2, pi / 2] rad")
        if not abs(self.longitude) <= 2 * np.pi:
            raise ValueError(f"longitude = {self.longitude}: must lie in [-2 pi, 2 pi] rad")
        if not -1e3 <= self.altitude <= 1e5:
            raise ValueError(f"altitude = {self.altitude}: must lie in [-1000, 100000] m")
        if not 0 <= self.minimum_elevation < np.pi / 2:
            raise ValueError(f"minimum_elevation = {self.minimum_elevation}: must lie in [0, pi / 2) rad")

    @property
    def up(self) -> np.ndarray:
        """Unit vector (3,) outward, at right angles to the ellipsoid, along axes fixed to the Earth."""
        cos = np.cos(self.latitude)
        return np.array([cos * np.cos(self.longitude), cos * np.sin(self.longitude), np.sin(self.latitude)])

    @property
    def place(self) -> np.ndarray:
        """Position (3,) km from the Earth's centre, along axes that are fixed to the Earth."""
        normal = EARTH_RADIUS / np.sqrt(1 - _SQUARED_ECCENTRICITY * np.sin(self.latitude) ** 2)
        height = self.altitude * 1e-3
        return self.up * np.array([normal + height] * 2 + [normal * (1 - _SQUARED_ECCENTRICITY) + height])


def surface_point(place: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Find where lines first meet the ellipsoid of WGS 84 from outside.

    Args:
        place: (..., 3) km where lines begin, along axes that are fixed to the Earth.
        direction: (..., 3) of any length but zero, along the same axes.

    Returns:
        (..., 3) km; NaN where a line misses the ellipsoid, leads away from it, or begins in it.
    """
    stretch = np.array([1.0, 1.0, 1 / (1 - _FLATTENING)]) / EARTH_RADIUS  # makes it the unit sphere
    start, way = place * stretch, direction * stretch
    length, along = np.sum(way * way, axis=-1), np.sum(start * way, axis=-1)
    outside = np.sum(start * start, axis=-1) - 1
    root = along * along - length * outside
    meets = (root >= 0) & (along < 0) & (outside > 0)
    # the nearer crossing, written so that no digits are lost where the line begins close to it
    share = outside / np.where(meets, np.sqrt(np.where(meets, root, 1.0)) - along, np.nan)
    return np.asarray(place + share[..., None] * direction)


def geodetic(place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return geodetic coordinates on WGS 84; the inverse of `GroundPoint.place`.

    Args:
        place: (..., 3) km along axes that are fixed to the Earth, not at its centre.

    Returns:
        (...) rad latitude, (...) rad longitude, positive east, in (-pi, pi], and (...) m altitude; NaN where
        a position is not finite.
    """
    known = np.all(np.isfinite(place), axis=-1, keepdims=True)
    metres = np.where(known, place, [EARTH_RADIUS, 0.0, 0.0]) * 1e3
    east, latitude, height = library("erfa").gc2gde(EARTH_RADIUS * 1e3, _FLATTENING, metres)
    found = np.where(known, np.stack([latitude, east, height], axis=-1), np.nan)
    return found[..., 0], found[..., 1], found[..., 2]


def ground_state(
    point: GroundPoint, epoch: np.datetime64, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity of a point of the ground.

    Args:
        point: the point.
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3) km and (..., 3) km/s, GCRS.
    """
    return earth_fixed_state(point.place, epoch, times)


def elevation(
    point: GroundPoint, position: np.ndarray, epoch: np.datetime64, times: np.ndarray
) -> np.ndarray:
    """Return the elevation of something above the horizon of a point of the ground, without refraction.

    Args:
        point: the point of the ground.
        position: (..., 3) km of what is seen from there, GCRS.
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (...) rad, negative below the plane at right angles to the ellipsoid's normal.
    """
    between = position - ground_state(point, epoch, times)[0]
    up, _ = earth_fixed_state(point.up, epoch, times)
    along = np.sum(between * up, axis=-1)
    across = np.linalg.norm(np.cross(between, up), axis=-1)
    return np.asarray(np.arctan2(along, across))
