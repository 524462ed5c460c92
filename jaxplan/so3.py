"""Rotations: exponential, logarithm, right Jacobian and distance on SO(3).

Conventions. A rotation matrix ``R`` maps body to inertial coordinates; a rotation vector ``w`` (rad)
is its exponential coordinates, ``R = exp(w^)``. Angular velocities are in body axes: ``R' = R omega^``.
Everything broadcasts over leading axes, follows the dtype of its input and composes with ``jit``,
``vmap`` and ``grad``. The coefficients are even functions of the angle, so they are computed as smooth
functions of its square: below one radian by their series, above by the closed form. That keeps values
and first derivatives right down to zero, where the printed closed forms lose all digits (Lemma 3 of
the paper, with the sign and the threshold of its errata). The logarithm goes through the unit
quaternion (`jaxplan.quaternion`), which needs no branch near half a turn.
"""

from math import factorial

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxplan import quaternion
from jaxplan.compiled import keep_by_default

keep_by_default()  # here, since whatever is compiled in this package computes with rotations

# Terms of the series in theta**2: the first one left out is below 1e-17 at one radian.
_TERMS = 10


def _even_series(square: Array, offset: int, derivative: bool = False) -> Array:
    """Sum of ``(-1)^k z^k / (2 k + offset)!`` in ``z = square``, or its derivative in ``z``."""
    coefficients = [(-1) ** k / factorial(2 * k + offset) for k in range(_TERMS)]
    if derivative:
        coefficients = [k * c for k, c in enumerate(coefficients)][1:]
    total = jnp.zeros_like(square)
    for coefficient in reversed(coefficients):
        total = total * square + coefficient
    return total


def _coefficients(square: Array) -> tuple[Array, Array, Array]:
    """``sin t / t``, ``(1 - cos t) / t^2`` and ``(t - sin t) / t^3`` as functions of ``t^2``."""
    small = square < 1
    safe = jnp.where(small, 1, square)  # the unused side must not divide by zero
    theta = jnp.sqrt(safe)
    sinc, half_sinc = jnp.sin(theta) / theta, jnp.sin(theta / 2) / theta
    return (
        jnp.where(small, _even_series(square, 1), sinc),
        jnp.where(small, _even_series(square, 2), 2 * half_sinc * half_sinc),
        jnp.where(small, _even_series(square, 3), (1 - sinc) / safe),
    )


def _coefficient_slopes(square: Array) -> tuple[Array, Array]:
    """Derivatives in ``t^2`` of the second and third function of `_coefficients`."""
    small = square < 1
    safe = jnp.where(small, 1, square)
    sinc, cosc, cubic = _coefficients(safe)
    return (
        jnp.where(small, _even_series(square, 2, derivative=True), (sinc - 2 * cosc) / (2 * safe)),
        jnp.where(small, _even_series(square, 3, derivative=True), (cosc - 3 * cubic) / (2 * safe)),
    )


def length(vector: ArrayLike) -> Array:
    """Euclidean length of a vector, with a derivative everywhere.

    Args:
        vector: (..., k).

    Returns:
        (...); at zero, where it has none, the derivative is taken as zero.
    """
    v = jnp.asarray(vector)
    square = jnp.sum(v * v, axis=-1)
    zero = square == 0
    return jnp.where(zero, 0, jnp.sqrt(jnp.where(zero, 1, square)))


def hat(vector: ArrayLike) -> Array:
    """Cross-product matrix: ``hat(a) @ b == cross(a, b)``.

    Args:
        vector: (..., 3).

    Returns:
        (..., 3, 3) skew-symmetric.
    """
    x, y, z = jnp.moveaxis(jnp.asarray(vector), -1, 0)
    zero = jnp.zeros_like(x)
    rows = [jnp.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return jnp.stack(rows, axis=-2)


def _hat_square(vector: Array) -> Array:
    """``hat(x) @ hat(x)`` written as ``x x^T - |x|^2 I``, which fuses with what surrounds it."""
    square = jnp.sum(vector * vector, axis=-1)[..., None, None]
    return vector[..., :, None] * vector[..., None, :] - square * jnp.eye(3, dtype=vector.dtype)


def vee(matrix: ArrayLike) -> Array:
    """Inverse of `hat`; of a general matrix, the vector of its skew-symmetric part.

    Args:
        matrix: (..., 3, 3).

    Returns:
        (..., 3).
    """
    m = jnp.asarray(matrix)
    skew = [m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]]
    return jnp.stack(skew, axis=-1) / 2


def exp(rotation_vector: ArrayLike) -> Array:
    """Rotation matrix of a rotation vector (Lemma 1).

    Args:
        rotation_vector: (..., 3) rad, of any length.

    Returns:
        (..., 3, 3); value and derivatives are exact at zero too.
    """
    w = jnp.asarray(rotation_vector)
    sinc, cosc, _ = _coefficients(jnp.sum(w * w, axis=-1))
    cross = hat(w)
    identity = jnp.eye(3, dtype=w.dtype)
    return identity + sinc[..., None, None] * cross + cosc[..., None, None] * _hat_square(w)


def log(attitude: ArrayLike) -> Array:
    """Rotation vector of a rotation matrix, of length at most pi.

    Args:
        attitude: (..., 3, 3) rotation matrix.

    Returns:
        (..., 3) rad. At exactly half a turn, where the logarithm has two values and no derivative, it is
        the one whose largest component is positive, and the derivative returned is finite: that of
        the branch the value belongs to.
    """
    return quaternion.log(quaternion.from_matrix(attitude))


def angle(attitude: ArrayLike) -> Array:
    """Rotation angle of a rotation matrix, the length of its logarithm.

    Args:
        attitude: (..., 3, 3) rotation matrix.

    Returns:
        (...) rad in [0, pi]. It has no derivative at 0 and at pi; the one returned is finite: zero
        at 0, and at pi the one from below along the axis that `log` returns.
    """
    return length(log(attitude))


def distance(first: ArrayLike, second: ArrayLike) -> Array:
    """Angle of the rotation between two attitudes, ``d(R1, R2)`` of Lemma 4.

    Args:
        first: (..., 3, 3).
        second: (..., 3, 3).

    Returns:
        (...) rad in [0, pi]; derivatives as for `angle`.
    """
    return angle(jnp.swapaxes(jnp.asarray(first), -1, -2) @ jnp.asarray(second))


def geodesic(first: ArrayLike, second: ArrayLike, fraction: ArrayLike) -> Array:
    """Attitude on the shortest rotation from one attitude to another.

    Args:
        first: (..., 3, 3) attitude at fraction 0.
        second: (..., 3, 3) attitude at fraction 1; half a turn away, either axis is a shortest one
            and that of `log` is taken.
        fraction: (...) broadcast against the leading axes.

    Returns:
        (..., 3, 3).
    """
    start = jnp.asarray(first)
    turn = log(jnp.swapaxes(start, -1, -2) @ jnp.asarray(second))
    return start @ exp(jnp.asarray(fraction)[..., None] * turn)


def right_jacobian(rotation_vector: ArrayLike) -> Array:
    """Tangent operator ``D`` of Lemma 3: the body rate of ``exp(x^)`` is ``D(x) x'`` (equation 2).

    Args:
        rotation_vector: (..., 3) rad.

    Returns:
        (..., 3, 3), the identity at zero.
    """
    x = jnp.asarray(rotation_vector)
    _, cosc, cubic = _coefficients(jnp.sum(x * x, axis=-1))
    cross = hat(x)
    identity = jnp.eye(3, dtype=x.dtype)
    return identity - cosc[..., None, None] * cross + cubic[..., None, None] * _hat_square(x)


def right_jacobian_rate(rotation_vector: ArrayLike, rate: ArrayLike) -> Array:
    """Time derivative of `right_jacobian` along a curve.

    Args:
        rotation_vector: (..., 3) rad, the curve's value ``x``.
        rate: (..., 3) rad/s, its derivative ``x'``.

    Returns:
        (..., 3, 3) 1/s; ``-hat(rate) / 2`` at zero.
    """
    x, x_dot = jnp.asarray(rotation_vector), jnp.asarray(rate)
    square = jnp.sum(x * x, axis=-1)
    square_rate = 2 * jnp.sum(x * x_dot, axis=-1)
    _, cosc, cubic = _coefficients(square)
    cosc_slope, cubic_slope = _coefficient_slopes(square)
    cross, cross_rate = hat(x), hat(x_dot)
    return (
        -(cosc_slope * square_rate)[..., None, None] * cross
        - cosc[..., None, None] * cross_rate
        + (cubic_slope * square_rate)[..., None, None] * _hat_square(x)
        + cubic[..., None, None] * (cross_rate @ cross + cross @ cross_rate)
    )
