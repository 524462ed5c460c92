"""Algebra in three dimensions for many problems side by side.

The lane is the last axis and the component the first, so that the processor's vector units work across lanes:
vectors are (3, K), or (3, m, K) where each lane has several; matrices, all symmetric, are (3, 3, K).
"""

import jax.numpy as jnp
from jax import Array

from jaxplan.geometry.vectors import cross, dot


def apply(matrix: Array, vector: Array) -> Array:
    """Product of matrices and vectors."""
    return dot(matrix, vector[:, None])


def identity(matrix: Array) -> Array:
    """Identity of the type of a matrix."""
    return jnp.eye(3, dtype=matrix.dtype)[:, :, None]


def sum_of_squares(vectors: Array) -> Array:
    """Matrix ``sum n n^T`` over each lane's vectors (3, m, K)."""
    return jnp.sum(vectors[:, None] * vectors[None], axis=2)


def inverse(matrix: Array) -> Array:
    """Inverse, by the adjugate."""
    first, second, third = matrix
    rows = (cross(second, third), cross(third, first), cross(first, second))
    adjugate = jnp.stack([jnp.stack(row) for row in rows])
    return adjugate / dot(first, adjugate[0])


def least_eigenvalue(matrix: Array) -> Array:
    """Least eigenvalue (K,), by the cosine formula for the roots of a cubic."""
    mean = jnp.trace(matrix) / 3
    rest = matrix - mean * identity(matrix)
    square = jnp.sum(rest * rest, axis=(0, 1)) / 6
    spread = jnp.sqrt(jnp.where(square > 0, square, 1))
    cosine = dot(rest[0], cross(rest[1], rest[2])) / (2 * spread**3)
    angle = jnp.arccos(jnp.clip(cosine, -1, 1)) / 3
    return mean + jnp.where(square > 0, 2 * spread, 0) * jnp.cos(angle + 2 * jnp.pi / 3)
