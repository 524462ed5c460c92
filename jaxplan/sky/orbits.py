"""Circular Keplerian orbits, and the directions from one satellite to others.

Conventions. The frame is inertial with its origin at the Earth's centre and z along the Earth's axis; right
ascensions are counted from x. Lengths are in km, angles in rad, times in s. A satellite has an altitude above
the equatorial radius, an inclination, a right ascension of its ascending node, and at time zero an argument
of latitude: the angle along the orbit from the ascending node, which is what a true anomaly means where there
is no perigee (section 5 of the paper). All arguments broadcast against each other.

Left out are the Earth's oblateness, drag, and the time that light takes: over the minutes of a manoeuvre they
turn a line of sight by some 1e-4 rad, far less than a step of the search.
"""

from math import pi

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

# World Geodetic System 1984 (NGA.STND.0036): equatorial radius, and GM of the Earth with its atmosphere.
EARTH_RADIUS = 6378.137  # km
EARTH_MU = 398600.4418  # km^3/s^2


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
