"""Local minima of problem (7): sequential quadratic programming from many starts at once.

The variable is ``E = R0^T R_d`` as a unit quaternion; the objective is half the square of its angle
``theta``. Along ``E exp(d^)`` that has the gradient ``eta = theta u``, for ``D(eta)^T eta = eta`` in
equation (2), and the Hessian ``k I + (1 - k) u u^T`` with ``k = (theta / 2) cot(theta / 2)``. The excess
over a cap, ``h - angle(a, b)`` with ``b = E^T z``, has the gradient ``n = a x b / s``, where
``s = |a x b|``, and the Hessian ``((a b^T + b a^T) / 2 - c I + c n n^T) / s`` with ``c = a . b``. Each
step solves the quadratic program of these exactly; where that has no solution, the step restores
feasibility instead.

Beyond half a turn the angle is that of the longer way round: the quaternion keeps its sign, so nothing
jumps on the way. Shapes as in `lanes`: one start a lane, m caps.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.decomposition import quadratic
from jaxplan.decomposition.caps import Caps
from jaxplan.decomposition.groups import applies
from jaxplan.decomposition.lanes import identity, least_eigenvalue, sum_of_squares
from jaxplan.decomposition.quadratic import MET, Active
from jaxplan.geometry import rotations
from jaxplan.geometry.vectors import cross, dot, unit
from jaxplan.runtime.quick_jit import quick_jit

STEPS = 10
LONGEST_STEP = 0.5  # rad
LEAST_CURVATURE = 0.01  # that the Hessian is raised to
TINY = 1e-20  # least square of the sine of an angle to a cap's axis, where the angle has no derivative
# The Hessian is that of the Lagrangian plus this times the squares of the active caps, which change nothing
# where these are at their bounds; relative to the multipliers.
PROXIMITY = 100.0


class Minima(NamedTuple):
    """Where the descents ended; K lanes.

    Attributes:
        quaternion: (K, 4) of ``E``, scalar first and below zero beyond half a turn.
        slew: (K,) rad, angle of ``E`` in [0, 2 pi].
        excess: (K,) rad, depth in the worst cap that applies.
        residual: (K,) of the conditions of optimality, rad, over one plus the sum of the multipliers.
        curvature: (K,) least curvature of the Lagrangian within the active caps.
    """

    quaternion: np.ndarray
    slew: np.ndarray
    excess: np.ndarray
    residual: np.ndarray
    curvature: np.ndarray


def descend(caps: Caps, starts: np.ndarray) -> Minima:
    """Descend from each start.

    Args:
        caps: what directions must stay out of.
        starts: (K, 4) unit quaternions.
    """
    arguments = (caps.axis, caps.direction, caps.half_angle, caps.member, caps.group)
    packed = np.asarray(descent_ends(np.ascontiguousarray(starts.T), *arguments))
    return Minima(packed[:4].T, *packed[4:])


class _Point(NamedTuple):
    """What a descent knows of the point that it stands on."""

    quaternion: Array  # (4, K)
    slew: Array  # (K,)
    excess: Array  # (K,)
    residual: Array  # (K,)
    lagrangian: Array  # (3, 3, K), its Hessian
    normals: Array  # (3, 3, K), gradients of the active caps, the component first


@quick_jit
def descent_ends(
    starts: Array, axis: Array, direction: Array, half_angle: Array, member: Array, group: Array
) -> Array:
    """The fields of `Minima` as rows (8, K), of starts (4, K) and the arrays of `Caps`."""

    def step(_count: int, state: tuple[Array, Active, _Point]) -> tuple[Array, Active, _Point]:
        quaternion, active, _ = state
        slew, eta, hessian = angle_terms(quaternion)
        body, excess, gradients = cap_terms(quaternion, axis, direction, half_angle)
        excess = jnp.where(applies(excess, member, group), excess, MET)
        curved, normals, depth = active_terms(active, axis, body, excess, gradients)
        lagrangian = hessian + curved
        scale = 1 + jnp.sum(active.multiplier, axis=0)
        stationarity = eta + jnp.sum(active.multiplier * normals, axis=1)
        slackness = jnp.max(jnp.abs(active.multiplier * depth), axis=0)
        residual = jnp.maximum(jnp.sqrt(dot(stationarity, stationarity)), slackness) / scale
        point = _Point(quaternion, slew, jnp.max(excess, axis=0), residual, lagrangian, normals)

        hessian = lagrangian + PROXIMITY * scale * sum_of_squares(normals)
        gradient = eta + PROXIMITY * scale * jnp.sum(normals * depth, axis=1)
        raised = jnp.maximum(0, LEAST_CURVATURE - least_eigenvalue(hessian))
        hessian = hessian + raised * identity(hessian)
        move, active, lost = quadratic.solve(hessian, gradient, gradients, excess)
        move = jnp.where(lost, quadratic.restoration(gradients, excess), move)
        length = jnp.sqrt(dot(move, move))
        return turned(quaternion, move * (LONGEST_STEP / jnp.maximum(length, LONGEST_STEP))), active, point

    lanes, dtype = starts.shape[1], starts.dtype
    number, matrix = jnp.zeros(lanes, dtype), jnp.zeros((3, 3, lanes), dtype)
    unknown = _Point(starts, number, number, number, matrix, matrix)
    *_, end = jax.lax.fori_loop(0, STEPS + 1, step, (starts, quadratic.none_active(lanes, dtype), unknown))
    curvature = least_eigenvalue(end.lagrangian + 1e6 * sum_of_squares(end.normals))
    return jnp.concatenate([end.quaternion, jnp.stack([end.slew, end.excess, end.residual, curvature])])


def angle_terms(quaternion: Array) -> tuple[Array, Array, Array]:
    """Angle (K,), and gradient (3, K) and Hessian (3, 3, K) of half its square."""
    scalar, vector = quaternion[0], quaternion[1:]
    square = dot(vector, vector)
    small = square < 1e-16
    sine = jnp.sqrt(jnp.where(small, 1, square))
    angle = 2 * jnp.arctan2(jnp.where(small, 0, sine), scalar)
    eta = jnp.where(small, 2, angle / sine) * vector
    across = jnp.where(small, 1, angle * scalar / (2 * sine))
    unit = jnp.where(small, 0, vector / sine)
    along = unit[:, None] * unit
    return angle, eta, across * identity(along) + (1 - across) * along


def cap_terms(
    quaternion: Array, axis: Array, direction: Array, half_angle: Array
) -> tuple[Array, Array, Array]:
    """Directions in body axes (3, m, K), excess over the caps (m, K), and its gradients (3, m, K)."""
    a, d = axis.T[:, :, None], direction.T[:, :, None]
    body = jnp.stack(rotations.turned_back(quaternion, d))
    normal = jnp.stack(cross(a, body))
    sine = jnp.sqrt(jnp.maximum(dot(normal, normal), TINY))
    return body, half_angle[:, None] - jnp.arctan2(sine, dot(a, body)), normal / sine


def active_terms(
    active: Active, axis: Array, body: Array, excess: Array, gradients: Array
) -> tuple[Array, Array, Array]:
    """Of the active caps that still apply: sum of Hessians (3, 3, K), gradients (3, 3, K), excess (3, K)."""
    cap = jnp.maximum(active.number, 0)
    depth = jnp.take_along_axis(excess, cap, axis=0)
    used = (active.number >= 0) & (depth > MET)
    of = jnp.moveaxis(axis[cap], -1, 0)
    towards = jnp.take_along_axis(body, cap[None], axis=1)
    normals = jnp.where(used, jnp.take_along_axis(gradients, cap[None], axis=1), 0)
    sine = jnp.sqrt(jnp.maximum(dot(normal := cross(of, towards), normal), TINY))
    weight = jnp.where(used, active.multiplier / sine, 0)
    product = jnp.sum(weight * of[:, None] * towards[None], axis=2)
    curved = (product + jnp.swapaxes(product, 0, 1)) / 2 - jnp.trace(product) * identity(product)
    curved = curved + jnp.sum(weight * dot(of, towards) * normals[:, None] * normals[None], axis=2)
    return curved, normals, jnp.where(used, depth, 0)


def turned(quaternion: Array, move: Array) -> Array:
    """The quaternion of ``E exp(move^)``."""
    return jnp.stack(unit(rotations.product(quaternion, rotations.exp(move))))
