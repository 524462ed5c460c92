"""Small vectors, components first: one formula for kernels, which keep components apart, and for arrays.

A vector is anything whose leading axis are its components: an array (3, ...), or a tuple of arrays of any
shapes that broadcast. What comes back are components again, as a tuple, which the caller stacks where it
wants them; so all loops run over many vectors. Of ``(..., 3)`` arrays `components` are the way in, and a
stack along the last axis is the way out.
"""

from functools import reduce
from operator import add
from typing import TypeAlias

from jax.typing import ArrayLike

from jaxplan.geometry.arrays import AnyArray, array_module, arrays

Components: TypeAlias = AnyArray
"""An array (k, ...), or a sequence of k arrays."""


def components(vector: AnyArray) -> AnyArray:
    """The components (k, ...) of an array (..., k)."""
    return vector.transpose(-1, *range(vector.ndim - 1))


def dot(first: Components, second: Components) -> AnyArray:
    """Scalar product of vectors of three components."""
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]


def cross(first: Components, second: Components) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Cross product."""
    (a, b, c), (x, y, z) = first, second
    return b * z - c * y, c * x - a * z, a * y - b * x


def norm(vector: Components) -> AnyArray:
    """Euclidean length; at zero, where it has no derivative, the derivative is taken as zero."""
    square = reduce(add, [component * component for component in vector])
    xp = array_module(square)
    zero = square == 0
    return xp.where(zero, 0, xp.sqrt(xp.where(zero, 1, square)))


def unit(vector: Components) -> tuple[AnyArray, ...]:
    """The vector of length one; of zero there is none."""
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
