"""Small vectors with their components first, so that loops run over many of them.

Arrays of vectors, quaternions (``w x y z``) and rotations have the component as their first axis, and any
others behind it; their products are those of `jaxplan.geometry`.
"""

import jax.numpy as jnp
from jax import Array

from jaxplan.geometry import rotations


def total(values: Array) -> Array:
    """Sum over a short leading axis, unrolled so that it fuses."""
    return sum((values[i] for i in range(values.shape[0])), start=jnp.zeros(values.shape[1:]))


def spread(values: Array, axes: int) -> Array:
    """Values with further axes of length one at the end."""
    return values.reshape(*values.shape, *(1,) * axes)


def between(quaternions: Array) -> Array:
    """Quaternions of the turns between neighbours along the last axis, body axes."""
    return jnp.stack(rotations.relative(quaternions[..., :-1], quaternions[..., 1:]))


def in_body(quaternions: Array, directions: Array) -> Array:
    """Directions (3, z) given in the start's body axes, in those at quaternions (4, b, s): (3, z, b, s)."""
    return jnp.stack(rotations.turned_back(quaternions, spread(directions, quaternions.ndim - 1)))
