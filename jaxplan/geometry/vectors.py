"""Vectors and directions, components first, of numpy or JAX alike.

**The module to compute with**: numpy, or JAX as soon as one argument is an array of JAX or is traced. So one
line of code serves both. Plain numbers are computed in float64 whatever precision JAX is set to, and come
back as arrays of numpy; inside ``jit``, ``vmap`` and ``grad`` the same line is traced.

**Small vectors**: one formula for kernels, which keep components apart, and for arrays. A vector is anything
whose leading axis are its components: an array (3, ...), or a tuple of arrays of any shapes that broadcast.
What comes back are components again, as a tuple, which the caller stacks where it wants them; so all loops
run over many vectors. Of ``(..., 3)`` arrays `components` are the way in, and a stack along the last axis is
the way out.

**Directions**: angles between them, and their azimuth and elevation. A direction at azimuth ``a`` and
elevation ``b`` is ``v(a, b) = (cos b cos a, cos b sin a, sin b)``, equation (13). Arrays are (..., 3).
Radians.
"""

from functools import reduce
from operator import add
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

AnyArray: TypeAlias = Any
"""An array of numpy or of JAX."""


def array_module(*values: Any) -> Any:
    """`jax.numpy` if any of the values is an array of JAX or is traced, else `numpy`."""
    for value in values:
        if type(value) is not np.ndarray and isinstance(value, jax.Array):
            return jnp
    return np


def arrays(*values: Any) -> tuple[Any, ...]:
    """The module to compute with, and the values as floating-point arrays of it.

    Args:
        values: arrays, lists of numbers, or numbers.

    Returns:
        `array_module` of the values, then each of them. Floating-point arrays keep their dtype. For numpy
        a list or an array of integers becomes float64, and a number of Python takes the dtype of the others;
        for JAX both are of the precision that it is set to.
    """
    for value in values:
        if type(value) is not np.ndarray or value.dtype.kind != "f":
            break
    else:
        return np, *values  # nearly always: searches call this very often
    xp = array_module(*values)
    if xp is jnp:
        given = [jnp.asarray(value) for value in values]
        return xp, *(a if jnp.issubdtype(a.dtype, jnp.inexact) else a.astype(float) for a in given)
    known = [value if isinstance(value, int | float) else np.asarray(value) for value in values]
    common = np.result_type(0.0, *known)
    return xp, *(np.asarray(value, None if _is_floating(value) else common) for value in known)


def _is_floating(value: Any) -> bool:
    """Whether a value is an array or scalar of numpy of a floating-point type."""
    return isinstance(value, np.ndarray | np.generic) and bool(np.issubdtype(value.dtype, np.inexact))


Components: TypeAlias = AnyArray
"""An array (k, ...), or a sequence of k arrays."""


def components(vector: AnyArray) -> AnyArray:
    """The components (k, ...) of an array (..., k)."""
    return vector.transpose(-1, *range(vector.ndim - 1))


def dot(first: Components, second: Components) -> AnyArray:
    """Scalar product of vectors of three components."""
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]


def cross(first: Components, second: Components) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Cross product of vectors of three components."""
    (a, b, c), (x, y, z) = first, second
    return b * z - c * y, c * x - a * z, a * y - b * x


def norm(vector: Components) -> AnyArray:
    """Euclidean length of a vector; at zero, where it has no derivative, the derivative is taken as zero."""
    square = reduce(add, [component * component for component in vector])
    xp = array_module(square)
    zero = square == 0
    return xp.where(zero, 0, xp.sqrt(xp.where(zero, 1, square)))


def unit(vector: Components) -> tuple[AnyArray, ...]:
    """The vector divided by its length; NaN for a zero vector."""
    square = reduce(add, [component * component for component in vector])
    size = array_module(square).sqrt(square)
    return tuple(component / size for component in vector)


def length(vector: ArrayLike) -> AnyArray:
    """Euclidean length of an array of vectors, with a derivative everywhere.

    Args:
        vector: (..., k).

    Returns:
        (...); see `norm`.
    """
    _, v = arrays(vector)
    return norm(components(v))


Vector: TypeAlias = tuple[AnyArray, AnyArray, AnyArray]
"""The three components of vectors, arrays of any shape."""


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
    """Components of ``v(a, b)``, of the horizontal unit vector to its left, and of the one upward from it.

    Arguments are cosine and sine of the azimuth, then of the elevation.
    """
    left = -sa, ca, array_module(sa).zeros_like(sa)
    return outward(ca, sa, cb, sb), left, (-sb * ca, -sb * sa, cb)


def carried(vector: Components, ca: AnyArray, sa: AnyArray, cb: AnyArray, sb: AnyArray) -> Vector:
    """Components of the vector that has the components `vector` in the axes of `frame`: ahead, left, up.

    The other arguments are those of `frame`.
    """
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
