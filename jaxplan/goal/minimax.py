"""Descent to goals of least time among caps: make the slowest of platform and joints as quick as possible.

From rest to rest a joint travels at most its *reach* ``reach(t)`` within the time ``t``, at a speed that
follows a trapezoid, and so does the platform along its turn. With the *way* ``w``, the distance that each has
to travel from the start, the least time is

    minimise  t^2 / 2 + STILLNESS theta^2 / 2   over E and t
    such that  w(E) <= reach(t)  for platform and joints to either side, and  excess(E) <= 0  for all caps

where ``theta`` is the angle of ``E``. These constraints are smooth, whereas the time of each as a function of
its way behaves as a square root at zero. Of attitudes that are equally quick the small second term prefers
the one nearest to the start. The problem is solved by sequential quadratic programming in four unknowns, as
in `jaxplan.goal.descent`, with which it shares caps, lanes and programs; ``E = R0^T R`` is a unit quaternion
that is turned by ``exp(d^)``.

Ways with their slopes and bends come from `jaxplan.goal.distances`. Time is in units of about that of half a
turn. Shapes: w ways, m caps, K lanes (problems side by side, the last axis).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry.vectors import dot
from jaxplan.goal.caps import applies
from jaxplan.goal.descent import (
    LEAST_CURVATURE,
    LONGEST_STEP,
    MET,
    PROXIMITY,
    Active,
    active_terms,
    angle_terms,
    bordered_inverse,
    cap_terms,
    identity,
    inner,
    inverse,
    least_eigenvalue,
    none_active,
    restoration,
    solve,
    sum_of_squares,
    turned,
)
from jaxplan.goal.distances import Platform, Pointers, reach, speed_limits, ways
from jaxplan.runtime.jit import quick_jit

STEPS = 14  # number of steps of each descent
STILLNESS = 1e-4
"""Weight of the square of the turn, rad^2, beside that of the time, in units."""
TIMES = 0.01, 50.0  # units of time, least and largest; steps are clipped to these


class _Point(NamedTuple):
    """The point of a descent that was evaluated last, with the fields of `Soonest`, lanes last."""

    quaternion: Array  # (4, K)
    time: Array  # (K,)
    excess: Array  # (K,) of the caps that apply
    residual: Array  # (K,) of the conditions of optimality, over one plus the sum of the multipliers


class Soonest(NamedTuple):
    """End points of K descents.

    Attributes:
        quaternion: (K, 4) of ``E``, scalar first, with the scalar below zero beyond half a turn.
        time: (K,) units of time.
        excess: (K,) rad, depth in the worst cap that applies, negative if clear of all.
        residual: (K,) violation of the conditions of optimality.
    """

    quaternion: np.ndarray
    time: np.ndarray
    excess: np.ndarray
    residual: np.ndarray


@partial(quick_jit, level=1)
def soonest_ends(
    starts: Array,
    times: Array,
    axis: Array,
    direction: Array,
    half_angle: Array,
    member: Array,
    group: Array,
    pointers: Pointers,
    platform: Platform,
) -> Array:
    """Run K descents from starts (4, K) and times (K,), and return where they end.

    `axis` to `group` are the arrays of `Caps`; `pointers` and `platform` are what moves
    (`jaxplan.goal.distances`).

    Returns:
        The fields of `Soonest` as rows (7, K).
    """
    rates = speed_limits(pointers, platform)
    caps, count = len(axis), len(rates[0])

    def step(_count: int, state: tuple[Array, Array, Active, _Point]) -> tuple[Array, Array, Active, _Point]:
        quaternion, time, active, _ = state
        _, eta, nearness = angle_terms(quaternion)
        body, excess, slopes = cap_terms(quaternion, axis, direction, half_angle)
        excess = jnp.where(applies(excess, member, group), excess, MET)
        way, way_slopes, bent = ways(quaternion, pointers, platform)
        reached, top, bend = reach(time, *rates)
        every = jnp.concatenate([excess, way - reached])
        gradients = jnp.concatenate(
            [
                jnp.concatenate([slopes, way_slopes], axis=1),
                jnp.concatenate([jnp.zeros_like(excess), -top])[None],
            ]
        )

        of_caps = active._replace(number=jnp.where(active.number < caps, active.number, -1))
        curved, _, _ = active_terms(of_caps, axis, body, excess, slopes)
        weight = jnp.sum(
            jnp.where(caps + jnp.arange(count)[:, None, None] == active.number, active.multiplier, 0), axis=1
        )  # (w, K)
        hessian = STILLNESS * nearness + curved + bent(weight)
        corner = jnp.maximum(1 - jnp.sum(weight * bend, axis=0), LEAST_CURVATURE)

        chosen = jnp.maximum(active.number, 0)
        depth = jnp.take_along_axis(every, chosen, axis=0)
        used = (active.number >= 0) & (depth > MET)
        depth = jnp.where(used, depth, 0)
        normals = jnp.where(used, jnp.take_along_axis(gradients, chosen[None], axis=1), 0)  # (4, 4, K)
        multiplier = jnp.where(used, active.multiplier, 0)
        scale = 1 + jnp.sum(multiplier, axis=0)
        gradient = jnp.concatenate([STILLNESS * eta, time[None]])
        stationarity = gradient + jnp.sum(multiplier * normals, axis=1)
        slackness = jnp.max(jnp.abs(multiplier * depth), axis=0)
        size = jnp.sqrt(inner(stationarity, stationarity))
        beyond = jnp.max(way - reached, axis=0)  # the time is not the least one yet
        residual = jnp.maximum(jnp.maximum(size, slackness) / scale, beyond)
        point = _Point(quaternion, time, jnp.max(excess, axis=0), residual)

        inverses = _inverse_hessian(hessian, corner, normals, PROXIMITY * scale)
        pushed = gradient + PROXIMITY * scale * jnp.sum(normals * depth, axis=1)
        move, active, lost = solve(inverses, pushed, gradients, every)
        matrix, pull = restoration(slopes, excess)
        back = jnp.concatenate([-inner(inverse(matrix), pull[:, None]), jnp.zeros_like(time)[None]])
        move = jnp.where(lost, back, move)
        length = jnp.sqrt(dot(move, move))
        move = move * (LONGEST_STEP / jnp.maximum(length, LONGEST_STEP))
        return turned(quaternion, move[:3]), jnp.clip(time + move[3], *TIMES), active, point

    lanes, dtype = starts.shape[1], starts.dtype
    number = jnp.zeros(lanes, dtype)
    unknown = _Point(starts, number, number, number)
    first = (starts, times, none_active(lanes, dtype, 4), unknown)
    *_, end = jax.lax.fori_loop(0, STEPS + 1, step, first)
    return jnp.concatenate([end.quaternion, jnp.stack([end.time, end.excess, end.residual])])


def _inverse_hessian(hessian: Array, corner: Array, normals: Array, proximity: Array) -> Array:
    """Return the inverse (4, 4, K) of the augmented Hessian, shifted to be positive definite.

    The augmented Hessian is that of the Lagrangian plus the squares of the active constraints. There are K
    lanes.

    Args:
        hessian: (3, 3, K) part along turns.
        corner: (K,) part along time, positive.
        normals: (4, 4, K) gradients of the active constraints, the component first.
        proximity: (K,) weight of their squares.
    """
    along, time = normals[:3], normals[3]
    border = proximity * jnp.sum(along * time, axis=1)
    corner = corner + proximity * jnp.sum(time * time, axis=0)
    rest = hessian + proximity * sum_of_squares(along) - border[:, None] * border[None] / corner
    shift = jnp.maximum(0, LEAST_CURVATURE - least_eigenvalue(rest))
    return bordered_inverse(rest + shift * identity(rest), border, corner)
