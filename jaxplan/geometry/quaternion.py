"""Unit quaternions as arrays (..., 4), scalar first: conversion to and from matrices and rotation vectors.

A quaternion and its negative are the same rotation. Every function broadcasts over leading axes, computes
with numpy or JAX according to its arguments and in their dtype (`jaxplan.geometry.vectors`), and composes
with ``jit``, ``vmap`` and ``grad``. Quaternions are not checked or normalised unless a function says so.
"""

import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry import rotations
from jaxplan.geometry.vectors import AnyArray, arrays, components, unit


def _products_of(attitude: np.ndarray) -> np.ndarray:
    """Compute ``4 q q^T`` (4, 4) of the quaternion ``q`` of a rotation matrix (3, 3)."""
    trace, skew = np.trace(attitude), attitude - attitude.T
    vector = np.array([[skew[2, 1], skew[0, 2], skew[1, 0]]])
    symmetric = attitude + attitude.T + (1 - trace) * np.eye(3)
    return np.block([[np.array([[1 + trace]]), vector], [vector.T, symmetric]])


# The products are a constant and a linear function of the matrix, so that they take one operation to trace.
_PRODUCTS_OF_ZERO = _products_of(np.zeros((3, 3)))
_PRODUCTS_PER_ENTRY = np.stack(
    [(_products_of(entry) - _PRODUCTS_OF_ZERO).reshape(16) for entry in np.eye(9).reshape(9, 3, 3)]
)


def from_matrix(attitude: ArrayLike) -> AnyArray:
    """Unit quaternion of a rotation matrix.

    Of the four equivalent formulas, the rows of ``4 q q^T``, the one with the largest divisor (at least one)
    is used, so no digit is lost at any angle. At exactly half a turn the sign of the axis is arbitrary; the
    largest component is made positive.

    Args:
        attitude: (..., 3, 3) rotation matrix.

    Returns:
        (..., 4) as ``w x y z``, with ``w >= 0``.
    """
    xp, m = arrays(attitude)
    constant, per_entry = (xp.asarray(one, m.dtype) for one in (_PRODUCTS_OF_ZERO, _PRODUCTS_PER_ENTRY))
    leading = m.shape[:-2]
    products = (m.reshape(*leading, 9) @ per_entry).reshape(*leading, 4, 4) + constant
    squares = products.reshape(*leading, 16)[..., ::5]
    largest = (xp.argmax(squares, axis=-1)[..., None] == np.arange(4)).astype(m.dtype)
    row = xp.einsum("...k,...kc->...c", largest, products)
    quaternion = row / (2 * xp.sqrt(xp.sum(largest * row, axis=-1, keepdims=True)))
    return xp.where(quaternion[..., :1] < 0, -quaternion, quaternion)


def continuous(attitudes: ArrayLike) -> AnyArray:
    """Unit quaternions along a motion, with signs chosen so that neighbours never jump to the negative.

    Args:
        attitudes: (k, 3, 3) rotation matrices, neighbours less than half a turn apart; or a single one, (3,
            3).

    Returns:
        (k, 4) or (4,) as ``w x y z``; the scalar part of the first one is not negative.
    """
    found = from_matrix(attitudes)
    if found.ndim == 1:
        return found
    xp, q = arrays(found)
    flips = xp.where(xp.sum(q[1:] * q[:-1], axis=-1) < 0, -1.0, 1.0).astype(q.dtype)
    return q * xp.concatenate([xp.ones(1, q.dtype), xp.cumprod(flips)])[: len(q), None]


def to_matrix(quaternion: ArrayLike) -> AnyArray:
    """Rotation matrix of a unit quaternion.

    Args:
        quaternion: (..., 4) as ``w x y z``; taken to be of unit length.

    Returns:
        (..., 3, 3) rotation matrix.
    """
    xp, q = arrays(quaternion)
    return xp.stack([xp.stack(row, axis=-1) for row in rotations.matrix(components(q))], axis=-2)


def log(quaternion: ArrayLike) -> AnyArray:
    """Rotation vector of a unit quaternion.

    Args:
        quaternion: (..., 4) as ``w x y z``, with ``w >= 0``.

    Returns:
        (..., 3) rad, of length at most pi. It is computed with ``atan2``, so no branch is needed near half a
        turn.
    """
    xp, q = arrays(quaternion)
    cosine, vector = q[..., 0], q[..., 1:]  # of half the angle
    square = xp.sum(vector * vector, axis=-1)
    small = square < xp.finfo(q.dtype).eps
    sine = xp.sqrt(xp.where(small, 1, square))
    # atan(x) / x = 1 - x^2 / 3 + ..., where x^2 is too small to be seen beside 1
    near_zero = 2 / xp.where(small, cosine, 1)
    factor = xp.where(small, near_zero, 2 * xp.arctan2(sine, cosine) / sine)
    return factor[..., None] * vector


def exp(rotation_vector: ArrayLike) -> AnyArray:
    """Unit quaternion of a rotation vector, the inverse of `log`.

    Args:
        rotation_vector: (..., 3) rad, of any length.

    Returns:
        (..., 4) as ``w x y z``. The scalar part is the cosine of half the angle, so it is negative for angles
        between pi and 3 pi.
    """
    xp, vector = arrays(rotation_vector)
    return xp.stack(xp.broadcast_arrays(*rotations.exp(components(vector))), axis=-1)


def product(first: ArrayLike, second: ArrayLike) -> AnyArray:
    """Unit quaternion of the rotation ``R(first) @ R(second)``.

    Args:
        first: (..., 4) as ``w x y z``, of any length but zero.
        second: (..., 4) likewise, broadcast against the first.

    Returns:
        (..., 4), normalised to unit length so that no error builds up over many products, with ``w >= 0``.
    """
    xp, *factors = arrays(first, second)
    w, *vector = unit(rotations.product(*(components(factor) for factor in factors)))
    return xp.stack([xp.where(w < 0, -component, component) for component in (w, *vector)], axis=-1)


def distance(first: ArrayLike, second: ArrayLike) -> AnyArray:
    """Angle of the rotation from one attitude to another.

    Args:
        first: (..., 4) as ``w x y z``, of unit length.
        second: (..., 4) likewise, broadcast against the first.

    Returns:
        (...) rad in [0, pi], whatever the signs of the quaternions.
    """
    _, *both = arrays(first, second)
    return rotations.angle(rotations.relative(*(components(one) for one in both)))


def conjugate(quaternion: ArrayLike) -> AnyArray:
    """Conjugate of a quaternion; of a unit quaternion that is the inverse rotation.

    Args:
        quaternion: (..., 4) as ``w x y z``.

    Returns:
        (..., 4) as ``w -x -y -z``.
    """
    xp, q = arrays(quaternion)
    return xp.stack(rotations.conjugate(components(q)), axis=-1)
