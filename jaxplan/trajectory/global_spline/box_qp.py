"""Quadratic programs in a box, which is what the dual of a program with elastic rows is.

    minimise  y^T M y / 2 - d^T y    subject to    0 <= y <= penalty

``M`` is symmetric and positive semidefinite. Mehrotra's predictor-corrector method with a dense Cholesky
factorisation; the matrix it factors is ``M`` plus a positive diagonal, so rows may depend on each other.
It composes with jit and vmap, and rows that are there only to fill a size cost nothing but time.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.scipy.linalg import cho_solve

MOST_ITERATIONS = 50
TOLERANCE = 1e-9  # of the residuals and of the complementarity, relative to the sizes of M and d
_INTERIOR = 0.995  # share of the way to the boundary that a step may take
_ROUNDING = 1e-14  # added to the diagonal, which is of order one


class Answer(NamedTuple):
    """Of a program.

    Attributes:
        multipliers: (R,) ``y``; NaN where the iteration broke down.
        iterations: how many it took.
        residual: the largest of what is left of the conditions of an optimum, in their scaled form.
    """

    multipliers: Array
    iterations: Array
    residual: Array


class _Iterate(NamedTuple):
    y: Array  # 0 <= y <= penalty
    low: Array  # multiplier of the lower bound
    high: Array  # of the upper one
    iterations: Array
    residual: Array


def solve_box_qp(matrix: Array, linear: Array, penalty: Array) -> Answer:
    """Solve one program.

    Args:
        matrix: (R, R) ``M``, with a positive diagonal.
        linear: (R,) ``d``.
        penalty: (R,) positive and finite.
    """
    scale = 1 / jnp.sqrt(jnp.diag(matrix))
    m, d, top = matrix * scale[:, None] * scale, linear * scale, penalty / scale
    size = 1 + jnp.sqrt(jnp.mean(d * d))
    start = 0.1 * size
    y = jnp.minimum(jnp.maximum(d, 0) + start, top / 2)
    first = _Iterate(
        y=y,
        low=jnp.maximum(-d, 0) + start,
        high=jnp.full_like(d, start),
        iterations=jnp.zeros((), int),
        residual=jnp.full((), jnp.inf, d.dtype),
    )

    def going(at: _Iterate) -> Array:
        return (at.iterations < MOST_ITERATIONS) & (at.residual > TOLERANCE)

    last = jax.lax.while_loop(going, lambda at: _iterate(m, d, top, size, at), first)
    return Answer(multipliers=last.y * scale, iterations=last.iterations, residual=last.residual)


def _iterate(m: Array, d: Array, top: Array, size: Array, at: _Iterate) -> _Iterate:
    """One predictor and one corrector step from the same factorisation."""
    y, low, high = at.y, at.low, at.high
    room = top - y
    gradient = m @ y - d - low + high
    gap = (y @ low + room @ high) / (2 * len(d))
    factor = jnp.linalg.cholesky(m + jnp.diag(low / y + high / room + _ROUNDING))

    def direction(low_target: Array, high_target: Array) -> tuple[Array, Array, Array]:
        """Newton's direction for wanted changes of the products ``y low`` and ``room high``."""
        step = cho_solve((factor, True), low_target / y - high_target / room - gradient)
        return step, (low_target - low * step) / y, (high_target + high * step) / room

    def length(step: Array, low_step: Array, high_step: Array, share: float) -> Array:
        """How far the step may go before one of the four meets zero."""
        values = jnp.concatenate([y, room, low, high])
        slopes = jnp.concatenate([step, -step, low_step, high_step])
        ratios = jnp.where(slopes < 0, -values / jnp.where(slopes < 0, slopes, -1), jnp.inf)
        return jnp.minimum(1, share * jnp.min(ratios))

    ahead = direction(-y * low, -room * high)
    far = length(*ahead, 1.0)
    reached = (y + far * ahead[0]) @ (low + far * ahead[1]) + (room - far * ahead[0]) @ (
        high + far * ahead[2]
    )
    target = gap * (reached / (2 * len(d)) / gap) ** 3
    step, low_step, high_step = direction(
        target - y * low - ahead[0] * ahead[1], target - room * high + ahead[0] * ahead[2]
    )
    far = length(step, low_step, high_step, _INTERIOR)
    y, low, high = y + far * step, low + far * low_step, high + far * high_step
    gradient = m @ y - d - low + high
    gap = (y @ low + (top - y) @ high) / (2 * len(d))
    residual = jnp.maximum(jnp.sqrt(jnp.mean(gradient * gradient)) / size, gap / size**2)
    return _Iterate(y=y, low=low, high=high, iterations=at.iterations + 1, residual=residual)
