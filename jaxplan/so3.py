"""Rotations: exponential, logarithm, right Jacobian and distance on SO(3).

Conventions. A rotation matrix ``R`` maps body to inertial coordinates; a rotation vector ``w`` (rad) is its
exponential coordinates, ``R = exp(w^)``, where ``w^`` is `hat` of ``w``. Angular velocities are in body axes:
``R' = R omega^``. Every function broadcasts over leading axes, computes with numpy or JAX according to its
arguments and in their dtype (`jaxplan.geometry.vectors`), and composes with ``jit``, ``vmap`` and ``grad``.

The coefficients of these formulas are even functions of the rotation angle, so they are computed as smooth
functions of its square: where the closed forms as printed lose all digits near zero (Lemma 3 of the paper,
with the sign and the threshold of its errata), by their series below one radian. That keeps values and
derivatives accurate down to zero. The logarithm goes through the unit quaternion
(`jaxplan.geometry.quaternion`), which needs no branch near half a turn.
"""

from math import factorial

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import AnyArray, array_module, arrays, components, length
from jaxplan.runtime.arguments import expect_numbers

# Terms of the series in theta**2: the first one left out is below 1e-17 at one radian.
_SERIES_TERMS = 9


def _stumpff(square: AnyArray, last: int = 3) -> tuple[AnyArray, ...]:
    """Evaluate ``sin t / t``, ``(1 - cos t) / t^2``, ``(t - sin t) / t^3`` and so on at ``z = t^2``.

    The n-th of these Stumpff functions, n from 1, is ``S_n(z)``, the sum of ``(-1)^k z^k / (2 k + n)!``. They
    obey the recurrence ``S_n + z S_(n + 2) = 1 / n!``, and their derivatives are ``2 S_n' = n S_(n + 2) -
    S_(n + 1)``.

    Args:
        square: (...) rad^2, the values of ``z``.
        last: number of functions to evaluate, at least two.

    Returns:
        The functions ``S_1`` to ``S_last``, each of shape (...).
    """
    return (
        _differentiable_stumpff(square, last)
        if array_module(square) is jnp
        else _stumpff_values(square, last)
    )


def _stumpff_values(square: AnyArray, last: int) -> tuple[AnyArray, ...]:
    """Evaluate the first `last` functions of `_stumpff` at squares (...) rad^2, without derivatives."""
    xp = array_module(square)
    least = np.finfo(square.dtype).tiny
    angle = xp.sqrt(xp.where(square < least, least, square))
    half_sinc = xp.sin(angle / 2) / angle
    closed = [xp.sin(angle) / angle, 2 * half_sinc * half_sinc]  # accurate down to zero, unlike the others
    if last == 2:
        return tuple(closed)
    small = square < 1
    near, far = xp.where(small, square, 0), xp.where(small, 1, square)  # where each form is accurate
    for n in range(1, last - 1):
        closed.append((1 / factorial(n) - closed[n - 1]) / far)
    by_series = [_stumpff_series(near, n) for n in range(last, max(last - 2, 2), -1)]
    for n in range(last - 2, 2, -1):
        by_series.append(1 / factorial(n) - near * by_series[-2])
    chosen = (xp.where(small, *both) for both in zip(reversed(by_series), closed[2:], strict=True))
    return *closed[:2], *chosen


def _stumpff_series(square: AnyArray, n: int) -> AnyArray:
    """Evaluate ``S_n`` of `_stumpff` by its series, accurate for squares (...) below 1 rad^2."""
    total = array_module(square).zeros_like(square)
    for k in reversed(range(_SERIES_TERMS)):
        total = total * square + (-1) ** k / factorial(2 * k + n)
    return total


_differentiable_stumpff = jax.custom_jvp(_stumpff_values, nondiff_argnums=(1,))


@_differentiable_stumpff.defjvp
def _stumpff_jvp(
    last: int, primals: tuple[AnyArray], tangents: tuple[AnyArray]
) -> tuple[tuple[AnyArray, ...], tuple[AnyArray, ...]]:
    """Return the functions of `_stumpff` and their derivatives along a tangent, for `jax.custom_jvp`."""
    found = _differentiable_stumpff(*primals, last + 2)
    slopes = [_stumpff_slope(found, n) for n in range(1, last + 1)]
    return found[:last], tuple(slope * tangents[0] for slope in slopes)


def _stumpff_slope(found: tuple[AnyArray, ...], n: int) -> AnyArray:
    """Return the derivative ``S_n'`` by ``z``, given the functions of `_stumpff` up to ``S_(n + 2)``."""
    return (n * found[n + 1] - found[n]) / 2


def _stumpff_slopes(square: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return derivatives by ``z = t^2`` of ``S_2`` and ``S_3`` of `_stumpff`, at squares (...) rad^2."""
    found = _stumpff(square, 5)
    return _stumpff_slope(found, 2), _stumpff_slope(found, 3)


def _stumpff_bends(square: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return the second derivatives of ``S_2`` and ``S_3`` by ``z = t^2`` at squares (...) rad^2."""
    found = _stumpff(square, 7)
    second, third = ((n * _stumpff_slope(found, n + 2) - _stumpff_slope(found, n + 1)) / 2 for n in (2, 3))
    return second, third


def hat(vector: ArrayLike) -> AnyArray:
    """Cross-product matrix of a vector: ``hat(a) @ b == cross(a, b)``.

    Args:
        vector: (..., 3).

    Returns:
        (..., 3, 3) skew-symmetric.

    Raises:
        ValueError: if an argument has another shape, or is not made of real numbers.
    """
    expect_numbers("vector", vector, 3)
    xp, v = arrays(vector)
    x, y, z = components(v)
    zero = xp.zeros_like(x)
    rows = [xp.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return xp.stack(rows, axis=-2)


def _hat_square(vector: AnyArray) -> AnyArray:
    """Return ``hat(x) @ hat(x)`` (..., 3, 3) of vectors ``x`` (..., 3).

    It is computed as ``x x^T - |x|^2 I``, which XLA fuses.
    """
    xp = array_module(vector)
    square = xp.sum(vector * vector, axis=-1)[..., None, None]
    return vector[..., :, None] * vector[..., None, :] - square * xp.eye(3, dtype=vector.dtype)


def vee(matrix: ArrayLike) -> AnyArray:
    """Return the vector of a skew-symmetric matrix, the inverse of `hat`.

    Of a general matrix it is the vector of the skew-symmetric part.

    Args:
        matrix: (..., 3, 3).

    Returns:
        (..., 3).

    Raises:
        ValueError: if an argument has another shape, or is not made of real numbers.
    """
    expect_numbers("matrix", matrix, 3, 3)
    xp, m = arrays(matrix)
    skew = [m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]]
    return xp.stack(skew, axis=-1) / 2


def exp(rotation_vector: ArrayLike) -> AnyArray:
    """Rotation matrix of a rotation vector (Lemma 1).

    Args:
        rotation_vector: (..., 3) rad, of any length.

    Returns:
        (..., 3, 3); value and derivatives are exact at zero too.

    Raises:
        ValueError: if an argument has another shape, or is not made of real numbers.
    """
    expect_numbers("rotation_vector", rotation_vector, 3)
    xp, w = arrays(rotation_vector)
    sinc, cosc = _stumpff(xp.sum(w * w, axis=-1), 2)
    cross = hat(w)
    identity = xp.eye(3, dtype=w.dtype)
    return identity + sinc[..., None, None] * cross + cosc[..., None, None] * _hat_square(w)


def log(attitude: ArrayLike) -> AnyArray:
    """Rotation vector of a rotation matrix, of length at most pi.

    Args:
        attitude: (..., 3, 3) rotation matrix.

    Returns:
        (..., 3) rad. At exactly half a turn, where the logarithm has two values and no derivative, the value
        is the one whose largest component is positive, and the derivative is finite: that of the branch to
        which the value belongs.

    Raises:
        ValueError: if an argument has another shape, or is not made of real numbers.
    """
    expect_numbers("attitude", attitude, 3, 3)
    return quaternion.log(quaternion.from_matrix(attitude))


def angle(attitude: ArrayLike) -> AnyArray:
    """Rotation angle of a rotation matrix, which is the length of its logarithm.

    Args:
        attitude: (..., 3, 3) rotation matrix.

    Returns:
        (...) rad in [0, pi]. The angle has no derivative at 0 and at pi, but a finite one is returned: zero
        at 0, and at pi the one from below along the axis that `log` returns.

    Raises:
        ValueError: if an argument has another shape, or is not made of real numbers.
    """
    return length(log(attitude))


def distance(first: ArrayLike, second: ArrayLike) -> AnyArray:
    """Angle of the rotation between two attitudes, ``d(R1, R2)`` of Lemma 4.

    Args:
        first: (..., 3, 3) rotation matrix.
        second: (..., 3, 3) rotation matrix, broadcast against the first.

    Returns:
        (...) rad in [0, pi]; derivatives as for `angle`.

    Raises:
        ValueError: if an argument has another shape, or is not made of real numbers.
    """
    expect_numbers("first", first, 3, 3)
    expect_numbers("second", second, 3, 3)
    xp, start, end = arrays(first, second)
    return angle(xp.swapaxes(start, -1, -2) @ end)


def geodesic(first: ArrayLike, second: ArrayLike, fraction: ArrayLike) -> AnyArray:
    """Attitude on the shortest rotation from one attitude to another.

    Args:
        first: (..., 3, 3) attitude at fraction 0.
        second: (..., 3, 3) attitude at fraction 1. If it is exactly half a turn away, two rotations are
            equally short, and the one about the axis of `log` is taken.
        fraction: (...) broadcast against the leading axes; values outside [0, 1] continue the same rotation.

    Returns:
        (..., 3, 3) attitudes.

    Raises:
        ValueError: if an argument has another shape, or is not made of real numbers.
    """
    expect_numbers("first", first, 3, 3)
    expect_numbers("second", second, 3, 3)
    expect_numbers("fraction", fraction)
    xp, start, end, share = arrays(first, second, fraction)
    turn = log(xp.swapaxes(start, -1, -2) @ end)
    return start @ exp(share[..., None] * turn)


def right_jacobian(rotation_vector: ArrayLike) -> AnyArray:
    """Right Jacobian ``D`` of Lemma 3, which gives the body rate of ``exp(x^)`` as ``D(x) x'`` (equation 2).

    Args:
        rotation_vector: (..., 3) rad, the rotation vector ``x``.

    Returns:
        (..., 3, 3), the identity at zero.

    Raises:
        ValueError: if an argument has another shape, or is not made of real numbers.
    """
    expect_numbers("rotation_vector", rotation_vector, 3)
    xp, x = arrays(rotation_vector)
    _, cosc, cubic = _stumpff(xp.sum(x * x, axis=-1))
    cross = hat(x)
    identity = xp.eye(3, dtype=x.dtype)
    return identity - cosc[..., None, None] * cross + cubic[..., None, None] * _hat_square(x)


def right_jacobian_rate(rotation_vector: ArrayLike, rate: ArrayLike) -> AnyArray:
    """Time derivative of `right_jacobian` along a curve of rotation vectors.

    Args:
        rotation_vector: (..., 3) rad, the value ``x`` of the curve.
        rate: (..., 3) rad/s, its time derivative ``x'``.

    Returns:
        (..., 3, 3) 1/s; ``-hat(rate) / 2`` at zero.

    Raises:
        ValueError: if an argument has another shape, or is not made of real numbers.
    """
    expect_numbers("rotation_vector", rotation_vector, 3)
    expect_numbers("rate", rate, 3)
    xp, x, x_dot = arrays(rotation_vector, rate)
    square = xp.sum(x * x, axis=-1)
    square_rate = 2 * xp.sum(x * x_dot, axis=-1)
    _, cosc, cubic, fourth, fifth = _stumpff(square, 5)
    cosc_slope, cubic_slope = fourth - cubic / 2, (3 * fifth - fourth) / 2
    cross, cross_rate = hat(x), hat(x_dot)
    return (
        -(cosc_slope * square_rate)[..., None, None] * cross
        - cosc[..., None, None] * cross_rate
        + (cubic_slope * square_rate)[..., None, None] * _hat_square(x)
        + cubic[..., None, None] * (cross_rate @ cross + cross @ cross_rate)
    )


def right_jacobian_acceleration(
    rotation_vector: ArrayLike, rate: ArrayLike, acceleration: ArrayLike
) -> AnyArray:
    """Second time derivative of `right_jacobian` along a curve of rotation vectors.

    Args:
        rotation_vector: (..., 3) rad, the value ``x`` of the curve.
        rate: (..., 3) rad/s, its time derivative ``x'``.
        acceleration: (..., 3) rad/s^2, its second time derivative ``x''``.

    Returns:
        (..., 3, 3) 1/s^2; ``-hat(acceleration) / 2 + hat(rate) @ hat(rate) / 3`` at zero.

    Raises:
        ValueError: if an argument has another shape, or is not made of real numbers.
    """
    for name, value in (
        ("rotation_vector", rotation_vector),
        ("rate", rate),
        ("acceleration", acceleration),
    ):
        expect_numbers(name, value, 3)
    xp, x, x_1, x_2 = arrays(rotation_vector, rate, acceleration)
    square, square_1 = xp.sum(x * x, axis=-1), 2 * xp.sum(x * x_1, axis=-1)
    square_2 = 2 * xp.sum(x_1 * x_1 + x * x_2, axis=-1)
    _, *values = _stumpff(square)
    slopes, bends = _stumpff_slopes(square), _stumpff_bends(square)
    h, h_1, h_2 = hat(x), hat(x_1), hat(x_2)
    mixed = h_1 @ h
    bent = h_2 @ h
    crosses = h, h_1, h_2
    squares = h @ h, mixed + xp.swapaxes(mixed, -1, -2), bent + xp.swapaxes(bent, -1, -2) + 2 * h_1 @ h_1
    total = xp.zeros_like(h)
    for sign, value, slope, bend, matrices in zip(
        (-1, 1), values, slopes, bends, (crosses, squares), strict=True
    ):
        factors = bend * square_1 * square_1 + slope * square_2, 2 * slope * square_1, value
        for factor, matrix in zip(factors, matrices, strict=True):
            total = total + sign * factor[..., None, None] * matrix
    return total
