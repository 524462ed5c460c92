"""Descent of step 1 from many starts at once, to the least rotation among caps.

**Lanes**: many problems are solved side by side. The last axis of arrays runs over the K lanes and the first
over components, so that the processor's vector units work across lanes: vectors are (3, K), or (3, m, K)
where each lane has m of them, one for each cap; matrices, all symmetric, are (3, 3, K).

**The quadratic program** of a step has n unknowns ``d``, three or four, and m constraints; it is solved by
the dual method of Goldfarb and Idnani (1983):

    minimise  gradient . d + d . H d / 2   such that  excess + gradients . d <= 0

From the unconstrained minimum the most violated constraint is brought to its bound; an active one whose
multiplier reaches zero on the way leaves. At most n constraints are active.

**Local minima** of problem (7) are found by sequential quadratic programming. The variable is ``E = R0^T
R_d`` as a unit quaternion; the objective is half the square of its angle ``theta``. Along ``E exp(d^)`` that
has the gradient ``eta = theta u``, for ``D(eta)^T eta = eta`` in equation (2), and the Hessian ``k I + (1 -
k) u u^T`` with ``k = (theta / 2) cot(theta / 2)``. The excess over a cap, ``h - angle(a, b)`` with ``b = E^T
z``, has the gradient ``n = a x b / s``, where ``s = |a x b|``, and the Hessian ``((a b^T + b a^T) / 2 - c I +
c n n^T) / s`` with ``c = a . b``. Each step solves the quadratic program of these exactly; where that has no
solution, the step restores feasibility instead.

Quaternions have the scalar first. Beyond half a turn the angle is that of the longer way round: the
quaternion keeps its sign, so nothing jumps on the way. Each lane is one descent from one start.
"""

from functools import reduce
from operator import add
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry import rotations
from jaxplan.geometry.vectors import cross, dot, unit
from jaxplan.goal.caps import Caps, applies
from jaxplan.runtime.jit import materialise, quick_jit


def inner(first: Array, second: Array) -> Array:
    """Return scalar products (...) of vectors (n, ...), whose n components come first."""
    return reduce(add, [one * other for one, other in zip(first, second, strict=True)])


def apply(matrix: Array, vector: Array) -> Array:
    """Return products (n, ...) of symmetric n by n matrices (n, n, ...) and vectors (n, ...)."""
    return inner(matrix, vector[:, None])


def identity(matrix: Array) -> Array:
    """Return the n by n identity (n, n, 1, ...) with the dtype and number of axes of a matrix (n, n, ...)."""
    size = matrix.shape[0]
    return jnp.eye(size, dtype=matrix.dtype).reshape(size, size, *[1] * (matrix.ndim - 2))


def sum_of_squares(vectors: Array) -> Array:
    """Return the matrix ``sum n n^T`` (3, 3, K) over the m vectors ``n`` (3, m, K) of each of K lanes."""
    return jnp.sum(vectors[:, None] * vectors[None], axis=2)


def inverse(matrix: Array) -> Array:
    """Return the inverses of symmetric matrices in K lanes, (3, 3, ..., K) or (4, 4, ..., K).

    The former come from the adjugate, the latter from `bordered_inverse`.
    """
    if len(matrix) > 3:
        border, corner = matrix[:3, 3], matrix[3, 3]
        return bordered_inverse(matrix[:3, :3] - border[:, None] * border[None] / corner, border, corner)
    first, second, third = matrix
    rows = (cross(second, third), cross(third, first), cross(first, second))
    adjugate = jnp.stack([jnp.stack(row) for row in rows])
    return adjugate / dot(first, adjugate[0])


def bordered_inverse(rest: Array, border: Array, corner: Array) -> Array:
    """Return ``[[rest + border border^T / corner, border], [border^T, corner]]``, inverted: (4, 4, ..., K).

    `rest` is (3, 3, ..., K) and symmetric, `border` (3, ..., K), and `corner` (..., K) is not zero.
    """
    own = inverse(rest)
    share = border / corner
    across = -apply(own, share)
    last = 1 / corner - inner(share, across)
    top = jnp.concatenate([own, across[:, None]], axis=1)
    return jnp.concatenate([top, jnp.concatenate([across, last[None]])[None]])


def least_eigenvalue(matrix: Array) -> Array:
    """Return the least eigenvalue (..., K) of symmetric matrices (3, 3, ..., K), K lanes of them.

    It uses the cosine formula for the roots of a cubic.
    """
    mean = jnp.trace(matrix) / 3
    rest = matrix - mean * identity(matrix)
    square = jnp.sum(rest * rest, axis=(0, 1)) / 6
    spread = jnp.sqrt(jnp.where(square > 0, square, 1))
    cosine = dot(rest[0], cross(rest[1], rest[2])) / (2 * spread**3)
    angle = jnp.arccos(jnp.clip(cosine, -1, 1)) / 3
    return mean + jnp.where(square > 0, 2 * spread, 0) * jnp.cos(angle + 2 * jnp.pi / 3)


CHANGES = 64  # most changes of the active set; most programs need three to eight
ROUNDING = 1e-13  # rad, a violation that counts as none
REGULARISATION = 1e-6  # added to the diagonal of a restoration's normal equations, which makes them regular
DEPENDENT = 1e-12  # squared sine below which a constraint's gradient lies in the span of the active ones
MET = -1e3  # excess given to a constraint that is to be ignored


class Active(NamedTuple):
    """Up to n active constraints of each of K programs, in n slots.

    Attributes:
        number: (n, K) number of the constraint in each slot, -1 where the slot is free.
        multiplier: (n, K) its multiplier, 0 where the slot is free.
    """

    number: Array
    multiplier: Array


def none_active(lanes: int, dtype: jnp.dtype, unknowns: int = 3) -> Active:
    """Return empty active sets for `lanes` programs of `unknowns` variables."""
    return Active(number=jnp.full((unknowns, lanes), -1), multiplier=jnp.zeros((unknowns, lanes), dtype))


class _Progress(NamedTuple):
    """State of the dual method, for K programs with n unknowns."""

    changes: Array | int  # number of changes of the active set so far
    move: Array  # (n, K) d so far
    active: Active
    normals: Array  # (n, n, K) gradients of the active constraints, the component first
    entering: Array  # (K,) the constraint on its way in, -1 for none
    pressure: Array  # (K,) its multiplier so far
    lost: Array  # (K,) bool: no d meets all constraints
    done: Array  # (K,) bool


def solve(
    inverse_hessian: Array, gradient: Array, gradients: Array, excess: Array
) -> tuple[Array, Active, Array]:
    """Solve K quadratic programs with n unknowns and m constraints, in the notation of the module.

    Args:
        inverse_hessian: (n, n, K) inverse of ``H``, positive definite.
        gradient: (n, K) of the objective at ``d = 0``.
        gradients: (n, m, K) of the constraints.
        excess: (m, K) of the constraints at ``d = 0``, above zero where violated.

    Returns:
        The solutions ``d`` (n, K), the active constraints, and (K,) bool, which programs have no solution: in
        these no constraint is active and ``d`` is meaningless.
    """
    lanes, dtype, unknowns = excess.shape[1], excess.dtype, len(gradient)
    start = _Progress(
        changes=0,
        move=-apply(inverse_hessian, gradient),
        active=none_active(lanes, dtype, unknowns),
        normals=jnp.zeros((unknowns, unknowns, lanes), dtype),
        entering=jnp.full(lanes, -1),
        pressure=jnp.zeros(lanes, dtype),
        lost=jnp.zeros(lanes, bool),
        done=jnp.zeros(lanes, bool),
    )

    def unfinished(progress: _Progress) -> Array:
        return (progress.changes < CHANGES) & ~jnp.all(progress.done)

    def change(progress: _Progress) -> _Progress:
        return _change_active_set(progress, inverse_hessian, gradients, excess)

    end = jax.lax.while_loop(unfinished, change, start)
    return end.move, end.active, end.lost


def _change_active_set(
    progress: _Progress, inverse_hessian: Array, gradients: Array, excess: Array
) -> _Progress:
    """Return the state after one step of the dual method.

    The entering constraint arrives at its bound, or an active one leaves. Where no constraint is entering,
    the most violated one starts to; where none is violated, the program is done.
    """
    _, move, active, normals, entering, pressure, lost, done = progress
    violation = excess + inner(gradients, move[:, None])
    # the active ones are met but for rounding
    held = jnp.any(jnp.arange(len(excess))[:, None, None] == active.number, axis=1)
    violation = jnp.where(held, MET, violation)
    idle = entering < 0
    done = done | (idle & (jnp.max(violation, axis=0) <= ROUNDING))
    entering = jnp.where(idle, jnp.argmax(violation, axis=0), entering)
    normal = jnp.take_along_axis(gradients, entering[None, None], axis=1)[:, 0]
    distance = jnp.take_along_axis(violation, entering[None], axis=0)[0]

    # kept as arrays: fused into all that follows they would be computed once for each number of the state
    normal, distance, entering = materialise(progress.changes + 1, (normal, distance, entering))
    found = _step_directions(inverse_hessian, normals, active.number >= 0, normal)
    way, share, gain = materialise(progress.changes + 1, found)
    shrinks = share > 0
    leaves = jnp.where(shrinks, active.multiplier / jnp.where(shrinks, share, 1), jnp.inf)
    leave = jnp.min(leaves, axis=0)
    arrive = jnp.where(gain > 0, distance / jnp.where(gain > 0, gain, 1), jnp.inf)
    lost = lost | (~done & (leave == jnp.inf) & (arrive == jnp.inf))
    done = done | lost
    stride = jnp.where(done, 0, jnp.minimum(leave, arrive))
    pressure = pressure + stride

    arrives = arrive <= leave
    slot = jnp.where(arrives, jnp.argmin(active.number >= 0, axis=0), jnp.argmin(leaves, axis=0))
    here = (jnp.arange(len(move))[:, None] == slot) & ~done
    number = jnp.where(here, jnp.where(arrives, entering, -1), active.number)
    multiplier = jnp.where(here, jnp.where(arrives, pressure, 0), active.multiplier - stride * share)
    arrived = arrives & ~done
    return _Progress(
        changes=progress.changes + 1,
        move=move - jnp.where(gain > 0, stride, 0) * way,
        active=Active(number=jnp.where(lost, -1, number), multiplier=jnp.where(lost, 0, multiplier)),
        normals=jnp.where(here, jnp.where(arrives, normal, 0)[:, None], normals),
        entering=jnp.where(arrived, -1, entering),
        pressure=jnp.where(arrived, 0, pressure),
        lost=lost,
        done=done,
    )


def _step_directions(
    inverse_hessian: Array, normals: Array, used: Array, normal: Array
) -> tuple[Array, Array, Array]:
    """Return how ``d``, multipliers and violation change while a constraint enters.

    All changes are per unit of the entering constraint's multiplier. There are K programs with n unknowns and
    n slots for active constraints.

    Args:
        inverse_hessian: (n, n, K) inverse of ``H``.
        normals: (n, n, K) gradients of the active constraints, the component first.
        used: (n, K) bool, slots that hold a constraint.
        normal: (n, K) gradient of the entering constraint.

    Returns:
        The direction (n, K), against which ``d`` moves and along which the active constraints keep their
        bounds; the rates (n, K) at which their multipliers shrink; and the rate (K,) at which the violation
        shrinks, 0 where it cannot.
    """
    solved = jnp.stack([apply(inverse_hessian, normals[:, slot]) for slot in range(len(normal))], axis=1)
    gram = inner(normals[:, :, None], solved[:, None]) + jnp.where(used, 0, identity(normals))
    share = jnp.where(used, apply(inverse(gram), inner(solved, normal[:, None])), 0)
    free = apply(inverse_hessian, normal)
    way = free - jnp.sum(share * solved, axis=1)
    gain = inner(normal, way)
    blocked = jnp.all(used, axis=0) | (gain <= DEPENDENT * inner(normal, free))
    return way, share, jnp.where(blocked, 0, gain)


def restoration(gradients: Array, excess: Array) -> tuple[Array, Array]:
    """Return ``M`` (3, 3, K) and ``b`` (3, K) for the step ``d = -M^-1 b`` that restores feasibility.

    These are the regularised normal equations of the least squares of the violations. The m constraints in K
    lanes have gradients (3, m, K) and excess (m, K), above zero where violated.
    """
    violated = excess > 0
    matrix = sum_of_squares(jnp.where(violated, gradients, 0))
    pull = jnp.sum(gradients * jnp.where(violated, excess, 0), axis=1)
    return matrix + REGULARISATION * identity(matrix), pull


LANES = 128
"""Starts of one batch: there is one shape to compile."""
CLEAR = 5e-13
"""rad; an excess over caps that counts as none, half of what caps are wider than their constraints."""
FLAT = 1e-5
"""Curvature that counts as none: at half a turn of an instrument a tolerance leaves a few millionths."""
STEPS = 10  # number of steps of each descent
LONGEST_STEP = 0.5  # rad; longer steps are shortened to this
LEAST_CURVATURE = 0.01  # least eigenvalue that the Hessian is shifted to have
TINY = 1e-20  # least square of the sine of an angle to a cap's axis, where the angle has no derivative
# The Hessian is that of the Lagrangian plus the squares of the active caps times this weight, relative to the
# multipliers. Where these caps are at their bounds, the squares do not change the solution.
PROXIMITY = 100.0
WITHIN = 1e6  # likewise, so large that the least curvature is that of a motion along the active caps


class Minima(NamedTuple):
    """End points of K descents.

    Attributes:
        quaternion: (K, 4) of ``E``, scalar first, with the scalar below zero beyond half a turn.
        slew: (K,) rad, angle of ``E`` in [0, 2 pi].
        excess: (K,) rad, depth in the worst cap that applies, negative if clear of all.
        residual: (K,) rad, violation of the conditions of optimality, relative to one plus the sum of the
            multipliers.
        curvature: (K,) least curvature of the Lagrangian along the active caps.
    """

    quaternion: np.ndarray
    slew: np.ndarray
    excess: np.ndarray
    residual: np.ndarray
    curvature: np.ndarray

    def good(self, tolerance: float) -> np.ndarray:
        """Tell which ends are local minima: feasible, stationary to `tolerance` rad, not concave."""
        within = (self.excess <= CLEAR) & (self.residual <= tolerance)
        # the longer way round is no minimum, and bends by about one
        return within & (self.curvature >= -FLAT) & (self.slew <= np.pi + 1e-9)


def descend(caps: Caps, starts: np.ndarray) -> Minima:
    """Run a descent from each start and return the `LANES` ends.

    Args:
        caps: what directions must stay out of.
        starts: (at most LANES, 4) unit quaternions of ``E``, scalar first; repeated to fill the batch.
    """
    arguments = (caps.axis, caps.direction, caps.half_angle, caps.member, caps.group)
    starts = np.resize(starts, (LANES, 4))
    packed = np.asarray(descent_ends(np.ascontiguousarray(starts.T), *arguments))
    return Minima(packed[:4].T, *packed[4:])


class _Point(NamedTuple):
    """The point of a descent that was evaluated last, with the fields of `Minima`, lanes last."""

    quaternion: Array  # (4, K)
    slew: Array  # (K,)
    excess: Array  # (K,)
    residual: Array  # (K,)
    curvature: Array  # (K,)


@quick_jit
def descent_ends(
    starts: Array, axis: Array, direction: Array, half_angle: Array, member: Array, group: Array
) -> Array:
    """Run K descents from starts (4, K), and return where they end as rows (8, K): the fields of `Minima`.

    The other arguments are arrays of `Caps`.
    """

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
        squares = sum_of_squares(normals)
        gradient = eta + PROXIMITY * scale * jnp.sum(normals * depth, axis=1)
        curved = jnp.stack([PROXIMITY * scale * squares, WITHIN * squares], axis=2) + lagrangian[:, :, None]
        least, curvature = least_eigenvalue(curved)
        hessian = curved[:, :, 0] + jnp.maximum(0, LEAST_CURVATURE - least) * identity(lagrangian)
        point = _Point(quaternion, slew, jnp.max(excess, axis=0), residual, curvature)

        matrix, pull = restoration(gradients, excess)
        inverses = inverse(jnp.stack([hessian, matrix], axis=2))
        move, active, lost = solve(inverses[:, :, 0], gradient, gradients, excess)
        move = jnp.where(lost, -apply(inverses[:, :, 1], pull), move)
        length = jnp.sqrt(dot(move, move))
        return turned(quaternion, move * (LONGEST_STEP / jnp.maximum(length, LONGEST_STEP))), active, point

    lanes, dtype = starts.shape[1], starts.dtype
    number = jnp.zeros(lanes, dtype)
    unknown = _Point(starts, number, number, number, number)
    *_, end = jax.lax.fori_loop(0, STEPS + 1, step, (starts, none_active(lanes, dtype), unknown))
    return jnp.concatenate([end.quaternion, jnp.stack([end.slew, end.excess, end.residual, end.curvature])])


def angle_terms(quaternion: Array) -> tuple[Array, Array, Array]:
    """Return the angle of quaternions, and gradient and Hessian of half its square along ``E exp(d^)``.

    Args:
        quaternion: (4, K) unit quaternions of ``E`` in K lanes, scalar first.

    Returns:
        Angle (K,) rad in [0, 2 pi]; gradient (3, K), which is the rotation vector ``eta``; Hessian (3, 3, K).
    """
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
    """Return directions in body axes, their excess over the caps, and its gradients along ``E exp(d^)``.

    Args:
        quaternion: (4, K) unit quaternions of ``E`` in K lanes.
        axis: (m, 3) axes of the m caps, in body axes.
        direction: (m, 3) in the body axes of the start.
        half_angle: (m,) rad.

    Returns:
        Directions (3, m, K), excess (m, K) rad and gradients (3, m, K).
    """
    a, d = axis.T[:, :, None], direction.T[:, :, None]
    body = jnp.stack(rotations.turned_back(quaternion, d))
    normal = jnp.stack(cross(a, body))
    sine = jnp.sqrt(jnp.maximum(dot(normal, normal), TINY))
    return body, half_angle[:, None] - jnp.arctan2(sine, dot(a, body)), normal / sine


def active_terms(
    active: Active, axis: Array, body: Array, excess: Array, gradients: Array
) -> tuple[Array, Array, Array]:
    """Return curvature, gradients and excess of the active caps; zero in free slots and of ignored caps.

    Args:
        active: numbers and multipliers (n, K) of up to n active caps in each of K lanes.
        axis: (m, 3) axes of all m caps.
        body: (3, m, K) directions in body axes, which with the next two come from `cap_terms`.
        excess: (m, K) rad, `MET` for a cap that is ignored.
        gradients: (3, m, K).

    Returns:
        The sum (3, 3, K) of the caps' Hessians times their multipliers, gradients (3, n, K), excess (n, K)
        rad.
    """
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
    """Return unit quaternions (4, K) of ``E exp(move^)``, from those of ``E`` (4, K) and moves (3, K) rad."""
    return jnp.stack(unit(rotations.product(quaternion, rotations.exp(move))))
