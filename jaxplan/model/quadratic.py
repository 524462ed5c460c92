"""Quadratic forms of three variables, such as inertias: the lengths that they give, and the largest of these.

All of it computes with numpy or JAX, as its arguments do.
"""

from itertools import product

import jax
import numpy as np

from jaxplan.geometry.vectors import AnyArray, array_module, arrays

_CORNERS = np.array([(1.0, *signs) for signs in product((1.0, -1.0), repeat=2)])
"""(4, 3) corners of the box of half widths one about zero, without their opposites."""


def greatest_of(values: list[AnyArray]) -> AnyArray:
    """The elementwise maximum of arrays, taken by index, so that it has the derivative of one of them.

    Compiled, a maximum may be equal to none of the values, and then its derivative is zero.
    """
    xp = array_module(*values)
    rows = xp.stack(values)
    return xp.take_along_axis(rows, xp.argmax(rows, axis=0)[None], axis=0)[0]


def inverse_of(matrix: AnyArray) -> AnyArray:
    """The inverse of a matrix, by numpy or JAX."""
    return array_module(matrix).linalg.inv(matrix)


def principal(inertia: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Principal moments (3,) of an inertia, and principal axes (3, 3) as columns, without derivatives."""
    if array_module(inertia) is np:
        _, axes = np.linalg.eigh(inertia)
    else:
        _, axes = jax.numpy.linalg.eigh(jax.lax.stop_gradient(inertia))
    return array_module(axes).diagonal(axes.T @ inertia @ axes), axes


def largest_in_box(bound: AnyArray, matrix: AnyArray) -> AnyArray:
    """The largest ``sqrt(x . matrix x)`` over the box ``|x_i| <= bound_i``."""
    _, bound, matrix = arrays(bound, matrix)
    return largest_size(_CORNERS * bound, matrix)


def largest_size(vectors: AnyArray, matrix: AnyArray) -> AnyArray:
    """The largest ``sqrt(x . matrix x)`` of vectors (k, 3), some of which may be zero.

    The root is taken of the largest alone: that of a zero has no derivative.
    """
    xp, x, matrix = arrays(vectors, matrix)
    return xp.sqrt(xp.max(xp.sum((x @ matrix) * x, axis=-1)))


def sizes_by(vectors: AnyArray, matrix: AnyArray) -> AnyArray:
    """``sqrt(x . matrix x)`` (k,) of vectors (k, 3); the derivative is taken as zero where it is zero."""
    xp, x, matrix = arrays(vectors, matrix)
    return roots_of(xp.sum((x @ matrix) * x, axis=-1))


def roots_of(squares: AnyArray) -> AnyArray:
    """Square roots of numbers >= 0; at zero, where they have no derivative, it is taken as zero."""
    xp = array_module(squares)
    some = squares > 0
    return xp.where(some, xp.sqrt(xp.where(some, squares, 1)), 0)
