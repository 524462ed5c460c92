"""Vectors and directions, for numpy and JAX alike.

**The array module**: functions compute with numpy, or with JAX as soon as one argument is a JAX array or is
traced, so that one line of code serves both. Plain numbers are computed in float64 whatever precision JAX is
set to, and come back as numpy arrays; inside ``jit``, ``vmap`` and ``grad`` the same line is traced.

**Small vectors, components first**: the same formula serves kernels, which keep components apart, and arrays.
A vector is anything whose first axis runs over its components: an array (3, ...), or a sequence of three
arrays whose shapes broadcast. So each operation works on many vectors at once. Results are tuples of
components, which the caller stacks where needed. `components` turns an array (..., 3) into this form, and
stacking along the last axis turns it back.

**Directions**: angles between them, and their azimuth and elevation in radians. The direction at azimuth
``a`` and elevation ``b`` is ``v(a, b) = (cos b cos a, cos b sin a, sin b)``, equation (13). `separation`,
`pointing` and `azimuth_elevation` work on arrays (..., 3).
"""

from collections.abc import Sequence
from functools import partial, reduce
from operator import add
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

AnyArray: TypeAlias = Any
"""An array of numpy or of JAX."""


def array_module(*values: Any) -> Any:
    """Return `jax.numpy` if any of the values is a JAX array or is traced, else `numpy`."""
    for value in values:
        if type(value) is not np.ndarray and isinstance(value, jax.Array):
            return jnp
    return np


def arrays(*values: Any) -> tuple[Any, ...]:
    """Return the module to compute with, followed by the values as its floating-point arrays.

    Args:
        values: arrays, lists of numbers, or numbers.

    Returns:
        `array_module` of the values, then each value. Floating-point arrays keep their dtype. With numpy,
        lists and integer arrays become float64, and Python numbers take the common dtype of the other values;
        with JAX both get the precision that JAX is set to.
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
    """Tell whether a value is a numpy array or scalar of a floating-point (or complex) type."""
    return isinstance(value, np.ndarray | np.generic) and bool(np.issubdtype(value.dtype, np.inexact))


Components: TypeAlias = AnyArray
"""An array (k, ...), or a sequence of k arrays."""


def components(vector: AnyArray) -> AnyArray:
    """Move the last axis of an array (..., k) to the front, so that components (k, ...) come first."""
    return vector.transpose(-1, *range(vector.ndim - 1))


def dot(first: Components, second: Components) -> AnyArray:
    """Scalar product (...) of two vectors, given as three components each."""
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]


def cross(first: Components, second: Components) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Cross product ``first x second`` of two vectors, given as three components each."""
    (a, b, c), (x, y, z) = first, second
    return b * z - c * y, c * x - a * z, a * y - b * x


def norm(vector: Components) -> AnyArray:
    """Euclidean length (...) of a vector of any number of components.

    At zero, where the length has no derivative, the derivative is taken as zero.
    """
    square = reduce(add, [component * component for component in vector])
    xp = array_module(square)
    zero = square == 0
    return xp.where(zero, 0, xp.sqrt(xp.where(zero, 1, square)))


def unit(vector: Components) -> tuple[AnyArray, ...]:
    """Divide a vector by its length; the components are NaN for a zero vector."""
    square = reduce(add, [component * component for component in vector])
    size = array_module(square).sqrt(square)
    return tuple(component / size for component in vector)


def length(vector: ArrayLike) -> AnyArray:
    """Euclidean length of arrays of vectors.

    Args:
        vector: (..., k).

    Returns:
        (...); the derivative at zero is taken as zero.
    """
    _, v = arrays(vector)
    return norm(components(v))


Vector: TypeAlias = tuple[AnyArray, AnyArray, AnyArray]
"""The three components of vectors, arrays of any shape."""


def max_along(values: AnyArray, axis: int) -> AnyArray:
    """Return the largest entry along an axis, -inf if there is none; its derivative is that of this entry.

    `jnp.max` finds its derivative by comparing entries with the result. Where a compiler computes an entry
    anew and rounds it otherwise no entry equals the result, and the derivative is not a number. Like that one
    it may lose a NaN on the CPU, so it decides nothing about safety.
    """
    if array_module(values) is np:
        return np.max(values, axis=axis, initial=-np.inf)
    if not values.shape[axis]:
        return jnp.max(values, axis=axis, initial=-jnp.inf)
    return _max_along(values, axis)


def min_along(values: AnyArray, axis: int) -> AnyArray:
    """Return the smallest entry along an axis, +inf if there is none; its derivative is as in `max_along`."""
    return -max_along(-values, axis)


def min_of_numbers(values: np.ndarray | Sequence[np.ndarray], axis: int | tuple[int, ...] = 0) -> np.ndarray:
    """Return the smallest entries along axes, NaN left aside, by numpy; NaN where there is no number."""
    found: np.ndarray = np.fmin.reduce(np.asarray(values), axis=axis)  # type: ignore[call-overload]
    return found


@partial(jax.custom_jvp, nondiff_argnums=(1,))
def _max_along(values: Array, axis: int) -> Array:
    """Return the largest entry along an axis that is not empty."""
    return jnp.max(values, axis=axis)


@_max_along.defjvp
def _max_along_jvp(axis: int, values: tuple[Array], changes: tuple[Array]) -> tuple[Array, Array]:
    """Differentiate `_max_along`: the change of the first entry that is the largest."""
    place = jnp.argmax(values[0], axis=axis, keepdims=True)
    change = jnp.take_along_axis(changes[0], place, axis=axis)
    return _max_along(values[0], axis), jnp.squeeze(change, axis=axis)


def separation(first: ArrayLike, second: ArrayLike) -> AnyArray:
    """Angle between directions, accurate near 0 and pi too.

    Args:
        first: (..., 3) vectors of any length but zero.
        second: (..., 3) likewise, broadcast against the first.

    Returns:
        (...) rad in [0, pi]; its derivative at 0 and pi is taken as zero.
    """
    xp, *both = arrays(first, second)
    a, b = (components(vector) for vector in both)
    return xp.arctan2(norm(cross(a, b)), dot(a, b))


def outward(ca: AnyArray, sa: AnyArray, cb: AnyArray, sb: AnyArray) -> Vector:
    """Components of ``v(a, b)``, given the cosine and sine of azimuth ``a`` and of elevation ``b``."""
    return cb * ca, cb * sa, sb


def frame(ca: AnyArray, sa: AnyArray, cb: AnyArray, sb: AnyArray) -> tuple[Vector, Vector, Vector]:
    """Three orthonormal vectors at azimuth ``a`` and elevation ``b``: ahead, left and up.

    Args:
        ca: cosine of the azimuth.
        sa: sine of the azimuth.
        cb: cosine of the elevation.
        sb: sine of the elevation.

    Returns:
        ``v(a, b)``; the horizontal unit vector to its left, toward rising azimuth; and the unit vector across
        both, toward rising elevation. Each is three components.
    """
    left = -sa, ca, array_module(sa).zeros_like(sa)
    return outward(ca, sa, cb, sb), left, (-sb * ca, -sb * sa, cb)


def carried(vector: Components, ca: AnyArray, sa: AnyArray, cb: AnyArray, sb: AnyArray) -> Vector:
    """Convert a vector from the axes of `frame` (ahead, left, up) to those in which the angles are measured.

    Args:
        vector: its components ahead, left and up.
        ca: cosine of the azimuth.
        sa: sine of the azimuth.
        cb: cosine of the elevation.
        sb: sine of the elevation.
    """
    x, y, z = (dot(vector, column) for column in zip(*frame(ca, sa, cb, sb), strict=True))
    return x, y, z


def pointing(azimuth: ArrayLike, elevation: ArrayLike) -> AnyArray:
    """Unit vector at an azimuth and an elevation, ``v(a, b)`` of equation (13).

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
        Azimuth (...) rad in [-pi, pi] and elevation (...) rad in [-pi / 2, pi / 2]. Along the z axis the
        azimuth is arbitrary, but derivatives are finite there, too.
    """
    xp, vector = arrays(direction)
    x, y, z = components(vector)
    horizontal = norm((x, y))
    return xp.arctan2(y, xp.where(horizontal == 0, 1, x)), xp.arctan2(z, horizontal)
