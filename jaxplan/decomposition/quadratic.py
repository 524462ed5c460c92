"""Quadratic programs in three unknowns, many at once, by the dual method of Goldfarb and Idnani (1983).

    minimise  gradient . d + d . H d / 2   such that  excess + gradients . d <= 0

From the free minimum the most violated constraint is brought to its bound; one whose multiplier gets to
zero on the way leaves. At most three are active. Shapes as in `lanes`: K programs of m constraints.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxplan.decomposition.lanes import apply, identity, inverse, sum_of_squares
from jaxplan.geometry.vectors import dot

CHANGES = 64  # of the active set at most; most programs take three to eight
ROUNDING = 1e-13  # rad, a violation that counts as none
DEPENDENT = 1e-12  # squared sine below which a constraint's gradient lies in the span of the active ones
MET = -1e3  # excess that stands for a constraint that need not be looked at


class Active(NamedTuple):
    """Up to three active constraints of each program.

    Attributes:
        number: (3, K), -1 where free.
        multiplier: (3, K), 0 where free.
    """

    number: Array
    multiplier: Array


def none_active(lanes: int, dtype: jnp.dtype) -> Active:
    """No active constraint in any of so many programs."""
    return Active(number=jnp.full((3, lanes), -1), multiplier=jnp.zeros((3, lanes), dtype))


class _Progress(NamedTuple):
    changes: Array | int
    move: Array  # (3, K) d so far
    active: Active
    normals: Array  # (3, 3, K) gradients of the active constraints, the component first
    entering: Array  # (K,) the constraint on its way in, -1 for none
    pressure: Array  # (K,) its multiplier so far
    lost: Array  # (K,) bool: no d meets all constraints
    done: Array  # (K,) bool


def solve(hessian: Array, gradient: Array, gradients: Array, excess: Array) -> tuple[Array, Active, Array]:
    """Solve the programs.

    Args:
        hessian: (3, 3, K) ``H``, positive definite.
        gradient: (3, K).
        gradients: (3, m, K) of the constraints.
        excess: (m, K).

    Returns:
        ``d`` (3, K), the active constraints, and which programs (K,) have no solution: in these no constraint
        is active and ``d`` means nothing.
    """
    lanes, dtype = excess.shape[1], excess.dtype
    inverse_hessian = inverse(hessian)
    start = _Progress(
        changes=0,
        move=-apply(inverse_hessian, gradient),
        active=none_active(lanes, dtype),
        normals=jnp.zeros((3, 3, lanes), dtype),
        entering=jnp.full(lanes, -1),
        pressure=jnp.zeros(lanes, dtype),
        lost=jnp.zeros(lanes, bool),
        done=jnp.zeros(lanes, bool),
    )

    def unfinished(progress: _Progress) -> Array:
        return (progress.changes < CHANGES) & ~jnp.all(progress.done)

    def change(progress: _Progress) -> _Progress:
        return _change(progress, inverse_hessian, gradients, excess)

    end = jax.lax.while_loop(unfinished, change, start)
    return end.move, end.active, end.lost


def _change(progress: _Progress, inverse_hessian: Array, gradients: Array, excess: Array) -> _Progress:
    """Bring in the most violated constraint, or the one on its way, until it arrives or another leaves."""
    _, move, active, normals, entering, pressure, lost, done = progress
    violation = excess + dot(gradients, move[:, None])
    # the active ones are met but for rounding
    held = jnp.any(jnp.arange(len(excess))[:, None, None] == active.number, axis=1)
    violation = jnp.where(held, MET, violation)
    idle = entering < 0
    done = done | (idle & (jnp.max(violation, axis=0) <= ROUNDING))
    entering = jnp.where(idle, jnp.argmax(violation, axis=0), entering)
    normal = jnp.take_along_axis(gradients, entering[None, None], axis=1)[:, 0]
    distance = jnp.take_along_axis(violation, entering[None], axis=0)[0]

    way, share, gain = _directions(inverse_hessian, normals, active.number >= 0, normal)
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
    here = (jnp.arange(3)[:, None] == slot) & ~done
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


def _directions(
    inverse_hessian: Array, normals: Array, used: Array, normal: Array
) -> tuple[Array, Array, Array]:
    """What bringing in a constraint does, for a unit of its multiplier.

    Returns:
        The way (3, K) that ``d`` moves against, along which the active constraints keep their bounds; how
        fast their multipliers shrink (3, K); and how fast the violation shrinks (K,), 0 where it cannot.
    """
    solved = jnp.stack([apply(inverse_hessian, normals[:, slot]) for slot in range(3)], axis=1)
    gram = dot(normals[:, :, None], solved[:, None]) + jnp.where(used, 0, identity(normals))
    share = jnp.where(used, apply(inverse(gram), dot(solved, normal[:, None])), 0)
    free = apply(inverse_hessian, normal)
    way = free - jnp.sum(share * solved, axis=1)
    gain = dot(normal, way)
    blocked = jnp.all(used, axis=0) | (gain <= DEPENDENT * dot(normal, free))
    return way, share, jnp.where(blocked, 0, gain)


def restoration(gradients: Array, excess: Array) -> Array:
    """The ``d`` (3, K) that brings the violated constraints nearest to their bounds, in least squares."""
    violated = excess > 0
    matrix = sum_of_squares(jnp.where(violated, gradients, 0))
    matrix = matrix + 1e-6 * identity(matrix)
    return -apply(inverse(matrix), jnp.sum(gradients * jnp.where(violated, excess, 0), axis=1))
