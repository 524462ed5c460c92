"""Derivatives of a goal of least time by its problem: those of the optimum of `jaxplan.goal.minimax`.

The unknowns are the turn ``d`` in ``E exp(d^)`` and the time ``t``. With the ways and caps that bind, at most
four, the optimum is where

    slopes by d and t of  t^2 / 2 + STILLNESS theta^2 / 2 + sum of m_i c_i = 0       and      c_i = 0

with ``theta`` the angle of the turn, ``c`` a way less its reach or the excess over a cap, and ``m`` its
multiplier. Which of them bind is held fixed, as in `derivative`. A *way* is the distance that a joint or the
platform has to go, its *reach* the longest distance that it can go in time ``t`` (`jaxplan.goal.distances`).
Shapes: m caps, w ways.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry.vectors import max_along
from jaxplan.goal import descent
from jaxplan.goal.descent import MET, angle_terms, cap_terms, turned
from jaxplan.goal.distances import Platform, Pointers, reach, speed_limits, ways
from jaxplan.goal.minimax import STILLNESS
from jaxplan.runtime.implicit import Equations, implicit_root


class Conditions(NamedTuple):
    """A goal of least time with its active ways and caps, from which the conditions of optimality follow.

    Attributes:
        turn: (4, 1) unit quaternion, scalar first, of the turn from the start to the goal found.
        caps: axes (m, 3), directions (m, 3) and half-angles (m,) rad of all m caps that may be active.
        pointers: devices whose joints follow directions.
        platform: lengths of the platform's turns, with limits of their speeds.
        number: (4,) which caps and ways are active: caps from 0, ways from m on, -1 for a free slot.
    """

    turn: Array
    caps: tuple[Array, Array, Array]
    pointers: Pointers
    platform: Platform
    number: Array


def soonest_turn(conditions: Conditions, matter: Array, equations: np.ndarray) -> Array:
    """Return the quaternion (4, 1) of the turn of least time near the one found, differentiable once.

    Args:
        conditions: the goal found; its `number` is ignored, since what is active is found here.
        matter: (m,) bool, which of the m caps must be kept.
        equations: (2, e) numbers of the upper and lower caps of each of e angles that are met exactly.
    """
    still = jax.lax.stop_gradient(conditions)
    way, *_ = ways(still.turn, still.pointers, still.platform)
    time = max_along(_least_times(way[:, 0], *speed_limits(still.pointers, still.platform)), 0)
    guess = jnp.concatenate([jnp.zeros(3, time.dtype), time[None]])
    at = jnp.zeros(4, time.dtype).at[3].set(time)
    excess, slopes = _constraint_excess(still, at), jax.jacfwd(lambda z: _constraint_excess(still, z))(at)
    met = jnp.concatenate([matter, jnp.ones(len(way), bool)])
    excess = jnp.where(met, excess.at[equations.ravel()].set(0.0), MET)
    gradient = jax.grad(lambda z: _objective(still, z))(at)
    _, active, _ = descent.solve(
        jnp.eye(4)[:, :, None], gradient[:, None], slopes.T[:, :, None], excess[:, None]
    )
    number, multiplier = active.number[:, 0], active.multiplier[:, 0]
    for upper, lower in equations.T.tolist():
        missing = ~jnp.any((number == upper) | (number == lower))
        slot = jnp.argmin(number)  # a free one, if any
        put = missing & (number[slot] < 0)
        number = jnp.where(put & (np.arange(4) == slot), upper, number)
    own = conditions._replace(number=number)
    root = implicit_root(_KKT_EQUATIONS, own, jnp.concatenate([guess, multiplier]))
    return turned(conditions.turn, root[:3, None])


def _least_times(way: Array, top: Array, growth: Array) -> Array:
    """Return least times from rest to rest over w ways (w,), with limits (w,) of rate and acceleration."""
    way = jnp.maximum(way, 0)
    return jnp.where(way * growth < top**2, 2 * jnp.sqrt(way / growth), way / top + top / growth)


def _constraint_excess(own: Conditions, at: Array) -> Array:
    """Return the excess over the m caps and then the w ways less their reach, (m + w,).

    `at` (4,) is the turn from the goal found, rad, and the time.
    """
    turn = turned(own.turn, at[:3, None])
    _, excess, _ = cap_terms(turn, *own.caps)
    way, *_ = ways(turn, own.pointers, own.platform)
    reached, *_ = reach(at[3:], *speed_limits(own.pointers, own.platform))
    return jnp.concatenate([excess, way - reached])[:, 0]


def _objective(own: Conditions, at: Array) -> Array:
    """Return the objective: half the square of the time plus a little of that of the turn.

    The second term makes the optimum unique. `at` is as for `_constraint_excess`.
    """
    _, eta, _ = angle_terms(turned(own.turn, at[:3, None]))
    return at[3] ** 2 / 2 + STILLNESS * jnp.sum(eta**2) / 2


def _kkt_residual(own: Conditions, z: Array) -> Array:
    """Return the residual (8,) of the conditions of optimality.

    ``z`` is the turn (3,) rad from the goal found, the time, and the multipliers (4,).
    """
    used, number = own.number >= 0, jnp.maximum(own.number, 0)

    def lagrangian(at: Array) -> tuple[Array, Array]:
        depth = jnp.where(used, _constraint_excess(own, at)[number], 0)
        return _objective(own, at) + jnp.sum(z[4:] * depth), depth

    slope, depth = jax.grad(lagrangian, has_aux=True)(z[:4])
    return jnp.concatenate([slope, jnp.where(used, depth, z[4:])])


def _kkt_inverse(own: Conditions, z: Array) -> Array:
    """Return the pseudoinverse (8, 8) of the derivative of `_kkt_residual` by ``z``.

    It is zero along directions that are not determined.
    """
    derivative: Any = jax.jacfwd(lambda z: _kkt_residual(own, z))(z)
    return jnp.linalg.pinv(derivative, rtol=float(jnp.finfo(z.dtype).eps) ** (2 / 3))


_KKT_EQUATIONS = Equations(
    residual=_kkt_residual, factor=_kkt_inverse, solve=jnp.matmul, steps=1, tolerance=0.0
)
