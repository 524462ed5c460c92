"""Quadratic forms of three variables, such as inertias, and the lengths ``sqrt(x . M x)`` that they give.

Everything computes with numpy or JAX, as its arguments do.
"""

from itertools import product

import jax
import numpy as np

from jaxplan.geometry.vectors import AnyArray, array_module, arrays, max_along

_BOX_CORNERS = np.array([(1.0, *signs) for signs in product((1.0, -1.0), repeat=2)])
"""(4, 3) corners of the box of half widths one about zero, without their opposites."""


def greatest_of(values: list[AnyArray]) -> AnyArray:
    """Return the elementwise maximum of arrays, chosen by index, with the derivative of the array chosen.

    Compiled, a plain maximum may differ from all of its arguments in rounding, and then its derivative is
    zero.
    """
    xp = array_module(*values)
    rows = xp.stack(values)
    return xp.take_along_axis(rows, xp.argmax(rows, axis=0)[None], axis=0)[0]


def inverse_of(matrix: AnyArray) -> AnyArray:
    """Return the inverse of a matrix, by numpy or JAX."""
    return array_module(matrix).linalg.inv(matrix)


def principal(inertia: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return the principal moments (3,) of an inertia and its principal axes (3, 3) as columns.

    With JAX the axes have no derivatives; the moments have.
    """
    if array_module(inertia) is np:
        _, axes = np.linalg.eigh(inertia)
    else:
        _, axes = jax.numpy.linalg.eigh(jax.lax.stop_gradient(inertia))
    return array_module(axes).diagonal(axes.T @ inertia @ axes), axes


def largest_in_box(bound: AnyArray, matrix: AnyArray) -> AnyArray:
    """Return the largest ``sqrt(x . matrix x)`` of vectors x in the box ``|x_i| <= bound_i``."""
    _, bound, matrix = arrays(bound, matrix)
    return largest_size(_BOX_CORNERS * bound, matrix)


def largest_size(vectors: AnyArray, matrix: AnyArray) -> AnyArray:
    """Return the largest ``sqrt(x . matrix x)`` of vectors (k, 3), of which some may be zero.

    The root is taken of the largest only, as the root of zero has no derivative.
    """
    xp, x, matrix = arrays(vectors, matrix)
    return xp.sqrt(max_along(xp.sum((x @ matrix) * x, axis=-1), -1))


def sizes_by(vectors: AnyArray, matrix: AnyArray) -> AnyArray:
    """Return ``sqrt(x . matrix x)`` (k,) of vectors (k, 3).

    Where it is zero, zero is taken for its derivative.
    """
    xp, x, matrix = arrays(vectors, matrix)
    return roots_of(xp.sum((x @ matrix) * x, axis=-1))


def roots_of(squares: AnyArray) -> AnyArray:
    """Return square roots of numbers >= 0; at zero, where they have no derivative, zero is taken for it."""
    xp = array_module(squares)
    some = squares > 0
    return xp.where(some, xp.sqrt(xp.where(some, squares, 1)), 0)
