"""Small vectors with their components first, so that loops run over many of them.

Arrays of vectors, quaternions (``w x y z``) and rotations have the component as their first axis, and any
others behind it; small products are written out.
"""

import jax.numpy as jnp
from jax import Array


def total(values: Array) -> Array:
    """Sum over a short leading axis, unrolled so that it fuses."""
    return sum((values[i] for i in range(values.shape[0])), start=jnp.zeros(values.shape[1:]))


def spread(values: Array, axes: int) -> Array:
    """Values with further axes of length one at the end."""
    return values.reshape(*values.shape, *(1,) * axes)


def times(first: Array, second: Array) -> Array:
    """Product of quaternions, components first."""
    a, b = first, second
    return jnp.stack([
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ])  # fmt: skip


def unit(vectors: Array) -> Array:
    """Vectors of length one, components first."""
    return vectors / jnp.sqrt(total(vectors * vectors))


def conjugate(quaternions: Array) -> Array:
    """Quaternions of the inverse rotations, components first."""
    q = quaternions
    return jnp.stack([q[0], -q[1], -q[2], -q[3]])


def between(quaternions: Array) -> Array:
    """Quaternions of the turns between neighbours along the last axis, body axes."""
    return times(conjugate(quaternions[..., :-1]), quaternions[..., 1:])


def in_body(quaternions: Array, directions: Array) -> Array:
    """Directions (3, z) given in the start's body axes, in those at quaternions (4, b, s): (3, z, b, s)."""
    w, x, y, z = quaternions
    a = spread(directions, w.ndim)
    return jnp.stack([
        (1 - 2 * (y * y + z * z)) * a[0] + 2 * (x * y + w * z) * a[1] + 2 * (x * z - w * y) * a[2],
        2 * (x * y - w * z) * a[0] + (1 - 2 * (x * x + z * z)) * a[1] + 2 * (y * z + w * x) * a[2],
        2 * (x * z + w * y) * a[0] + 2 * (y * z - w * x) * a[1] + (1 - 2 * (x * x + y * y)) * a[2],
    ])  # fmt: skip
