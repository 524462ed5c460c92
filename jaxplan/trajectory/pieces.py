"""What one polynomial piece evaluates to: angles, and on a chart of SO(3) attitude and body rates.

In the chart with base attitude ``R_a``, start ``t_a`` and constant rate ``Omega``, with ``tau = t - t_a``
(equation 25, corrected as in the errata's derivation):

    gamma = U exp(eta^) U,   U = exp(tau Omega / 2),   W = U^T,   eta = b - tau Omega,   R = R_a gamma.

``b`` is a polynomial in time. ``D`` is the right Jacobian of `so3`; rates are in body axes. Nothing here
divides by ``Omega`` or ``eta``: values and derivatives are right at zero.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.display import shown
from jaxplan.trajectory.basis import derivative_matrix, legendre


@shown("start s", "end s", "chart_rate deg/s", "coefficients rad")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """A piece of the platform's motion, or several along leading axes.

    Attributes:
        start: (...) s.
        end: (...) s.
        chart_attitude: (..., 3, 3) ``R_a``, body to inertial.
        chart_start: (...) s, ``t_a``.
        chart_rate: (..., 3) rad/s, ``Omega``.
        coefficients: (..., l + 1, 3) of ``b``, rad.
    """

    start: ArrayLike
    end: ArrayLike
    chart_attitude: ArrayLike
    chart_start: ArrayLike
    chart_rate: ArrayLike
    coefficients: ArrayLike


def polynomial(coefficients: ArrayLike, start: ArrayLike, end: ArrayLike, t: ArrayLike) -> tuple[Array, ...]:
    """A curve and its first three time derivatives.

    Args:
        coefficients: (..., l + 1, d) in the Legendre basis of ``x = 2 (t - start) / (end - start) - 1``.
        start: (...) s.
        end: (...) s; on a piece of no length the curve rests at its left end.
        t: (...) s.

    Returns:
        Four arrays (..., d): value, 1/s, 1/s^2, 1/s^3.
    """
    c, start, t = jnp.asarray(coefficients), jnp.asarray(start), jnp.asarray(t)
    order = c.shape[-2] - 1
    length = jnp.asarray(end) - start
    scale = jnp.where(length > 0, 2 / jnp.where(length > 0, length, 1), 0)[..., None]  # dx / dt
    values = legendre((t - start) * scale[..., 0] - 1, order)
    powers = [np.linalg.matrix_power(derivative_matrix(order), power) for power in range(4)]
    rows = values @ jnp.asarray(np.concatenate(powers, axis=1), c.dtype)
    curves = jnp.einsum("...rk,...kd->...rd", rows.reshape(*values.shape[:-1], 4, order + 1), c)
    return tuple(curves[..., power, :] * scale**power for power in range(4))


def chart_motion(
    rate: Array, tau: Array, b: Array, b_rate: Array, b_acceleration: Array
) -> tuple[Array, ...]:
    """Rotation, angular velocity and angular acceleration in a chart (equations 25 to 29).

    Args:
        rate: (..., 3) rad/s, ``Omega``.
        tau: (..., 1) s since the chart's start.
        b: (..., 3) rad.
        b_rate: (..., 3) rad/s.
        b_acceleration: (..., 3) rad/s^2.

    Returns:
        ``gamma`` (..., 3, 3), and (..., 3) rad/s and (..., 3) rad/s^2 in body axes.
    """
    eta, eta_rate = b - tau * rate, b_rate - rate
    half = so3.exp(tau * rate / 2)  # U
    gamma = half @ so3.exp(eta) @ half
    tangent = so3.right_jacobian(eta)  # D
    bend = _apply(so3.right_jacobian_rate(eta, eta_rate), eta_rate) + _apply(tangent, b_acceleration)
    turned = _apply_transposed(gamma, rate) / 2  # gamma^T Omega / 2
    own = _apply_transposed(half, _apply(tangent, eta_rate))  # W D eta'
    velocity = turned + rate / 2 + own  # (29), first line
    # (29), second line, where the second factor Omega / 2 must be a matrix: a cross product
    acceleration = jnp.cross(turned, velocity) + jnp.cross(own, rate) / 2 + _apply_transposed(half, bend)
    return gamma, velocity, acceleration


def platform(piece: Piece, t: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """Attitude, angular velocity, angular acceleration and angular jerk on a piece.

    The jerk is the exact derivative of (29), by forward mode along the known derivatives of ``b``.

    Args:
        piece: one or several, with leading axes (...).
        t: (...) s.

    Returns:
        (..., 3, 3) body to inertial, then (..., 3) in rad/s, rad/s^2 and rad/s^3, body axes.
    """
    tau = (jnp.asarray(t) - jnp.asarray(piece.chart_start))[..., None]
    rate = jnp.asarray(piece.chart_rate)
    b, *derivatives = polynomial(piece.coefficients, piece.start, piece.end, t)
    point = (rate, tau, b, derivatives[0], derivatives[1])
    direction = (jnp.zeros_like(rate), jnp.ones_like(tau), *derivatives)
    (gamma, velocity, acceleration), (_, _, jerk) = jax.jvp(chart_motion, point, direction)
    return jnp.asarray(piece.chart_attitude) @ gamma, velocity, acceleration, jerk


def _apply(matrix: Array, vector: Array) -> Array:
    return jnp.einsum("...ij,...j->...i", matrix, vector)


def _apply_transposed(matrix: Array, vector: Array) -> Array:
    return jnp.einsum("...ij,...i->...j", matrix, vector)
