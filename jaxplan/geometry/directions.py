"""Directions: angles between them, and their azimuth and elevation.

A direction at azimuth ``a`` and elevation ``b`` is ``v(a, b) = (cos b cos a, cos b sin a, sin b)``, equation
(13). Arrays are (..., 3); functions of components are as in `jaxplan.geometry.vectors`. Radians.
"""

from typing import TypeAlias

from jax.typing import ArrayLike

from jaxplan.geometry.arrays import AnyArray, array_module, arrays
from jaxplan.geometry.vectors import Components, components, cross, dot, norm

Vector: TypeAlias = tuple[AnyArray, AnyArray, AnyArray]


def separation(first: ArrayLike, second: ArrayLike) -> AnyArray:
    """Angle between directions, exact near 0 and pi.

    Args:
        first: (..., 3) of any length but zero.
        second: (..., 3), broadcast.

    Returns:
        (...) rad in [0, pi]; its derivative at 0 and pi is taken as zero.
    """
    xp, *both = arrays(first, second)
    a, b = (components(vector) for vector in both)
    return xp.arctan2(norm(cross(a, b)), dot(a, b))


def outward(ca: AnyArray, sa: AnyArray, cb: AnyArray, sb: AnyArray) -> Vector:
    """Components of ``v(a, b)`` from cosine and sine of the azimuth, cosine and sine of the elevation."""
    return cb * ca, cb * sa, sb


def frame(ca: AnyArray, sa: AnyArray, cb: AnyArray, sb: AnyArray) -> tuple[Vector, Vector, Vector]:
    """Components of ``v(a, b)``, of the unit vector to its left (level), and of the one upward from it."""
    left = -sa, ca, array_module(sa).zeros_like(sa)
    return outward(ca, sa, cb, sb), left, (-sb * ca, -sb * sa, cb)


def slopes(ca: AnyArray, sa: AnyArray, cb: AnyArray, sb: AnyArray) -> tuple[Vector, Vector]:
    """Components of the derivatives of ``v(a, b)`` by azimuth and by elevation, from what `outward` takes."""
    _, (x, y, z), up = frame(ca, sa, cb, sb)
    return (cb * x, cb * y, cb * z), up


def turns(vector: Components, ca: AnyArray, sa: AnyArray) -> tuple[Vector, Vector]:
    """Components of the derivatives by azimuth and elevation of any direction that turns with ``v(a, b)``.

    The azimuth turns it about z, the elevation about the opposite of the left, ``(sin a, -cos a, 0)``.

    Args:
        vector: components of the direction.
        ca: cosine of the azimuth.
        sa: its sine.
    """
    x, y, z = vector
    return (-y, x, array_module(z).zeros_like(z)), (-z * ca, -z * sa, x * ca + y * sa)


def carried(vector: Components, ca: AnyArray, sa: AnyArray, cb: AnyArray, sb: AnyArray) -> Vector:
    """Components of what is ``vector`` ahead, to the left and upward of ``v(a, b)``, see `frame`."""
    x, y, z = (dot(vector, column) for column in zip(*frame(ca, sa, cb, sb), strict=True))
    return x, y, z


def pointing(azimuth: ArrayLike, elevation: ArrayLike) -> AnyArray:
    """Unit vector of an azimuth and an elevation, ``v(a, b)`` of equation (13).

    Args:
        azimuth: (...) rad.
        elevation: (...) rad.

    Returns:
        (..., 3).
    """
    xp, a, b = arrays(azimuth, elevation)
    return xp.stack(outward(xp.cos(a), xp.sin(a), xp.cos(b), xp.sin(b)), axis=-1)


def azimuth_elevation(direction: ArrayLike) -> tuple[AnyArray, AnyArray]:
    """Azimuth and elevation of a direction, the inverse of `pointing`.

    Args:
        direction: (..., 3) of any length.

    Returns:
        (...) rad in [-pi, pi] and (...) rad in [-pi / 2, pi / 2]. The azimuth of the z axis means nothing;
        derivatives are finite there, too.
    """
    xp, vector = arrays(direction)
    x, y, z = components(vector)
    horizontal = norm((x, y))
    return xp.arctan2(y, xp.where(horizontal == 0, 1, x)), xp.arctan2(z, horizontal)
