"""Orbits about the Earth, circular ones and others that do not escape, and directions between satellites.

Conventions. The frame is inertial with its origin at the Earth's centre and z along the Earth's axis; right
ascensions are counted from x. Lengths are in km, angles in rad, times in s. On a circular orbit a satellite
has an altitude above the equatorial radius, an inclination, a right ascension of its ascending node, and at
time zero an argument of latitude: the angle along the orbit from the ascending node, which is what a true
anomaly means where there is no perigee (section 5 of the paper). Functions of these compute with JAX, and
their arguments broadcast against each other. States of a `CircularOrbit` or a `KeplerOrbit` are computed with
numpy.

Left out are drag, Sun, Moon, the time that light takes, and the Earth's oblateness, by which the node of a
low orbit turns by up to 8 deg a day; the position is off by tens of km after one revolution. Over the minutes
of a manoeuvre all this turns a line of sight between satellites by some 1e-4 rad, far less than a step of the
search. For long times use two-line elements or an ephemeris.
"""

from dataclasses import dataclass, fields
from functools import lru_cache
from math import pi
from numbers import Real

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.model.epochs import parse_epoch
from jaxplan.runtime.display import shown
from jaxplan.sky.frames import EARTH_MU, EARTH_RADIUS, elapsed

HIGHEST_ALTITUDE = 150_000.0
"""km, greatest altitude of circular orbits; of low orbits one in metres is beyond it."""
_MAX_ITERATIONS = 60  # of Newton's method, more than any solution takes: 3 to 6, but for e near 1


def mean_motion(altitude: ArrayLike) -> Array:
    """Angular rate along a circular orbit.

    Args:
        altitude: (...) km above the equatorial radius.

    Returns:
        (...) rad/s.
    """
    radius = EARTH_RADIUS + jnp.asarray(altitude)
    return jnp.sqrt(EARTH_MU / radius) / radius


def period(altitude: ArrayLike) -> Array:
    """Time of one revolution on a circular orbit.

    Args:
        altitude: (...) km above the equatorial radius.

    Returns:
        (...) s.
    """
    return 2 * pi / mean_motion(altitude)


def position(
    altitude: ArrayLike, inclination: ArrayLike, node: ArrayLike, latitude: ArrayLike, time: ArrayLike = 0.0
) -> Array:
    """Position of a satellite on a circular orbit.

    The four satellites of section 5, at time zero:

        position(500.0, jnp.deg2rad(10.0), jnp.deg2rad(jnp.array([10.0, 10.0, 5.0, 13.0])),
                 jnp.deg2rad(jnp.array([20.0, 25.0, 15.0, 15.0])))

    Args:
        altitude: (...) km above the equatorial radius.
        inclination: (...) rad.
        node: (...) rad, right ascension of the ascending node.
        latitude: (...) rad, argument of latitude at time zero.
        time: (...) s at which the position is wanted.

    Returns:
        (..., 3) km, inertial.
    """
    up, _ = _orbit_frame(altitude, inclination, node, latitude, time)
    return (EARTH_RADIUS + jnp.asarray(altitude))[..., None] * up


def velocity(
    altitude: ArrayLike, inclination: ArrayLike, node: ArrayLike, latitude: ArrayLike, time: ArrayLike = 0.0
) -> Array:
    """Velocity of a satellite on a circular orbit; the arguments are those of `position`.

    Returns:
        (..., 3) km/s, inertial.
    """
    _, ahead = _orbit_frame(altitude, inclination, node, latitude, time)
    speed = mean_motion(altitude) * (EARTH_RADIUS + jnp.asarray(altitude))
    return speed[..., None] * ahead


def _orbit_frame(
    altitude: ArrayLike, inclination: ArrayLike, node: ArrayLike, latitude: ArrayLike, time: ArrayLike
) -> tuple[Array, Array]:
    """Return inertial unit vectors (..., 3) up and ahead, along the velocity.

    The arguments are those of `position`.
    """
    i, o = jnp.asarray(inclination), jnp.asarray(node)
    u = jnp.asarray(latitude) + mean_motion(altitude) * jnp.asarray(time)
    u, i, o = jnp.broadcast_arrays(u, i, o)
    cos_i, sin_i, cos_o, sin_o = jnp.cos(i), jnp.sin(i), jnp.cos(o), jnp.sin(o)
    at_node = jnp.stack([cos_o, sin_o, jnp.zeros_like(o)], axis=-1)
    quarter_on = jnp.stack([-sin_o * cos_i, cos_o * cos_i, sin_i], axis=-1)
    cos_u, sin_u = jnp.cos(u)[..., None], jnp.sin(u)[..., None]
    return cos_u * at_node + sin_u * quarter_on, cos_u * quarter_on - sin_u * at_node


def line_of_sight(observer: ArrayLike, target: ArrayLike) -> Array:
    """Direction from one satellite to another: the target ``z`` of a terminal (section 3.1).

    Args:
        observer: (..., 3) km.
        target: (..., 3) km, broadcast against the observer.

    Returns:
        (..., 3) unit vector from observer to target, inertial. For two satellites in one place it is zero,
        with zero derivative.
    """
    between = jnp.asarray(target) - jnp.asarray(observer)
    square = jnp.sum(between * between, axis=-1, keepdims=True)
    apart = square > 0
    return jnp.where(apart, between / jnp.sqrt(jnp.where(apart, square, 1)), 0)


def grazing_altitude(observer: ArrayLike, target: ArrayLike) -> Array:
    """Lowest altitude to which the straight line between two satellites descends.

    Args:
        observer: (..., 3) km.
        target: (..., 3) km, broadcast against the observer.

    Returns:
        (...) km above the sphere of the equatorial radius, negative where the line meets it; at most the
        altitude of the lower satellite.
    """
    start, end = jnp.asarray(observer), jnp.asarray(target)
    between = end - start
    square = jnp.sum(between * between, axis=-1)
    along = -jnp.sum(start * between, axis=-1) / jnp.where(square > 0, square, 1)
    nearest = start + jnp.clip(along, 0, 1)[..., None] * between
    return jnp.sqrt(jnp.sum(nearest * nearest, axis=-1)) - EARTH_RADIUS


def earth_blocks(observer: ArrayLike, target: ArrayLike, lowest_altitude: ArrayLike = 0.0) -> Array:
    """Tell whether the Earth, or the air below an altitude, is in the way between two satellites.

    Args:
        observer: (..., 3) km.
        target: (..., 3) km, broadcast against the observer.
        lowest_altitude: (...) km that the line must stay above; a laser wants some 100 km.

    Returns:
        (...) bool, true also where a position is not a number.
    """
    return ~(grazing_altitude(observer, target) >= jnp.asarray(lowest_altitude))


@shown("altitude km", "inclination deg", "node deg", "latitude deg", "epoch")
@dataclass(frozen=True, kw_only=True)
class CircularOrbit:
    """A satellite on a circular Keplerian orbit.

    Its elements refer to the axes of the GCRS: to the equator of J2000, not that of date, from which it
    differs by 0.006 deg a year.

    Attributes:
        altitude: km above the Earth's equatorial radius, in (0, 150000].
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
        _expect_numbers(self)
        if not 0 < self.altitude <= HIGHEST_ALTITUDE:
            where = f"(0, {HIGHEST_ALTITUDE:g}], it is in km; higher orbits are a KeplerOrbit"
            raise ValueError(f"altitude = {self.altitude}: must lie in {where}")
        _expect_angles(self, "node", "latitude")


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
        place, speed = np.asarray(position(*elements)), np.asarray(velocity(*elements))
        return place, speed, float(mean_motion(elements[0]))


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
        _expect_numbers(self)
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
        _expect_angles(self, "node", "perigee", "anomaly")


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


def _expect_numbers(orbit: CircularOrbit | KeplerOrbit) -> None:
    """Raise `ValueError` if an element is not a number."""
    for field in fields(orbit):
        given: object = getattr(orbit, field.name)  # whatever its type says
        if field.name != "epoch" and (isinstance(given, bool) or not isinstance(given, Real)):
            raise ValueError(f"{field.name} = {given!r}: must be a number")


def _expect_angles(orbit: CircularOrbit | KeplerOrbit, *names: str) -> None:
    """Raise `ValueError` if inclination, an angle of these names, or epoch is not what it must be."""
    if not abs(orbit.inclination) <= np.pi:  # more is degrees
        raise ValueError(f"inclination = {orbit.inclination}: must lie in [-pi, pi] rad")
    for name in names:
        if not abs(getattr(orbit, name)) <= 1e3:
            raise ValueError(f"{name} = {getattr(orbit, name)}: must lie in [-1e3, 1e3] rad")
    if orbit.epoch is not None:
        parse_epoch(orbit.epoch)
