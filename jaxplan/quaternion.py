"""Unit quaternions, scalar first: the way between rotation matrices and rotation vectors.

A quaternion and its negative are the same rotation; those handed out have a scalar part that is not
negative. Everything broadcasts over leading axes, follows the dtype of its input and composes with ``jit``,
``vmap`` and ``grad``.
"""

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike


def from_matrix(attitude: ArrayLike) -> Array:
    """Unit quaternion of a rotation matrix.

    Of the four equivalent formulas the one with the largest divisor (at least one) is used, so no
    digit is lost at any angle. At exactly half a turn the sign of the axis is free; the largest
    component is made positive.

    Args:
        attitude: (..., 3, 3) rotation matrix.

    Returns:
        (..., 4) as ``w x y z``.
    """
    m = jnp.asarray(attitude)
    a, b, c = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    p, q, r = m[..., 2, 1], m[..., 0, 2], m[..., 1, 0]
    s, t, u = m[..., 1, 2], m[..., 2, 0], m[..., 0, 1]
    squares = (1 + a + b + c, 1 + a - b - c, 1 - a + b - c, 1 - a - b + c)  # four times each component's
    products = (  # row k: four times component k times every component
        (squares[0], p - s, q - t, r - u),
        (p - s, squares[1], r + u, q + t),
        (q - t, r + u, squares[2], p + s),
        (r - u, q + t, p + s, squares[3]),
    )
    # nested `where` instead of a gather: it fuses, and the sides not taken hold no division or root
    largest, row = squares[0], jnp.stack(products[0], axis=-1)
    for square, candidate in zip(squares[1:], products[1:], strict=True):
        larger = square > largest
        largest = jnp.where(larger, square, largest)
        row = jnp.where(larger[..., None], jnp.stack(candidate, axis=-1), row)
    quaternion = row / (2 * jnp.sqrt(largest))[..., None]
    return jnp.where(quaternion[..., :1] < 0, -quaternion, quaternion)


def to_matrix(quaternion: ArrayLike) -> Array:
    """Rotation matrix of a unit quaternion.

    Args:
        quaternion: (..., 4) as ``w x y z``; taken to be of unit length.

    Returns:
        (..., 3, 3).
    """
    w, x, y, z = jnp.moveaxis(jnp.asarray(quaternion), -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


def log(quaternion: ArrayLike) -> Array:
    """Rotation vector of a unit quaternion.

    Args:
        quaternion: (..., 4) whose scalar part is not negative.

    Returns:
        (..., 3) rad, of length at most pi; through ``atan2``, so no branch near half a turn.
    """
    q = jnp.asarray(quaternion)
    cosine, vector = q[..., 0], q[..., 1:]  # of half the angle
    square = jnp.sum(vector * vector, axis=-1)
    small = square < jnp.finfo(q.dtype).eps
    sine = jnp.sqrt(jnp.where(small, 1, square))
    # atan(x) / x = 1 - x^2 / 3 + ..., where x^2 is too small to be seen beside 1
    near_zero = 2 / jnp.where(small, cosine, 1)
    factor = jnp.where(small, near_zero, 2 * jnp.arctan2(sine, cosine) / sine)
    return factor[..., None] * vector


def product(first: ArrayLike, second: ArrayLike) -> Array:
    """Quaternion of the rotation ``R(first) @ R(second)``.

    Args:
        first: (..., 4).
        second: (..., 4), broadcast.

    Returns:
        (..., 4) of unit length, so that no error builds up over many products.
    """
    a, b, c, d = jnp.moveaxis(jnp.asarray(first), -1, 0)
    w, x, y, z = jnp.moveaxis(jnp.asarray(second), -1, 0)
    whole = (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )
    square = whole[0] * whole[0] + whole[1] * whole[1] + whole[2] * whole[2] + whole[3] * whole[3]
    signed_length = jnp.where(whole[0] < 0, -1, 1) * jnp.sqrt(square)
    return jnp.stack([component / signed_length for component in whole], axis=-1)


def conjugate(quaternion: ArrayLike) -> Array:
    """Quaternion of the inverse rotation.

    Args:
        quaternion: (..., 4).

    Returns:
        (..., 4).
    """
    q = jnp.asarray(quaternion)
    return q * jnp.array([1, -1, -1, -1], q.dtype)
