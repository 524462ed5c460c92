"""Quadratic programs in a box, which is what the dual of a program with elastic rows is.

    minimise  y^T M y / 2 - d^T y    subject to    0 <= y <= penalty

``M`` is symmetric and positive semidefinite. Mehrotra's predictor-corrector method with a dense Cholesky
factorisation; the matrix it factors is ``M`` plus a positive diagonal, so rows may depend on each other.
Programs have tens or hundreds of rows, no two the same number: LAPACK takes each as it is.
"""

from typing import NamedTuple

import numpy as np

MOST_ITERATIONS = 50
TOLERANCE = 1e-9  # of the residuals and of the complementarity, relative to the sizes of M and d
_USABLE = 1e-4  # such a residual is still an answer, where rounding or the iterations end it
_INTERIOR = 0.995  # share of the way to the boundary that a step may take
_ROUNDING = 1e-14  # added to the diagonal, which is of order one


class Answer(NamedTuple):
    """Of a program.

    Attributes:
        multipliers: (R,) ``y``; NaN where the iteration broke down.
        iterations: how many it took.
        residual: the largest of what is left of the conditions of an optimum, in their scaled form.
    """

    multipliers: np.ndarray
    iterations: int
    residual: float


class _Iterate(NamedTuple):
    y: np.ndarray  # 0 < y < penalty
    low: np.ndarray  # multiplier of the lower bound, positive
    high: np.ndarray  # of the upper one, positive
    residual: float


def solve_box_qp(matrix: np.ndarray, linear: np.ndarray, penalty: np.ndarray) -> Answer:
    """Solve one program.

    Args:
        matrix: (R, R) ``M``, with a positive diagonal.
        linear: (R,) ``d``.
        penalty: (R,) positive and finite.
    """
    if not len(linear):
        return Answer(multipliers=np.zeros(0), iterations=0, residual=0.0)
    scale = 1 / np.sqrt(np.diag(matrix))
    m, d, top = matrix * scale[:, None] * scale, linear * scale, penalty / scale
    if not (np.all(np.isfinite(m)) and np.all(np.isfinite(d)) and np.all(np.isfinite(top))):
        return Answer(multipliers=np.full_like(d, np.nan), iterations=0, residual=np.nan)
    size = 1 + np.sqrt(np.mean(d * d))
    start = 0.1 * size
    at = _Iterate(
        y=np.minimum(np.maximum(d, 0) + start, top / 2),
        low=np.maximum(-d, 0) + start,
        high=np.full_like(d, start),
        residual=np.inf,
    )
    iterations = 0
    while iterations < MOST_ITERATIONS and at.residual > TOLERANCE:
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            ahead = _iterate(m, d, top, size, at)
        if not np.isfinite(ahead.residual):  # as near as rounding allows
            break
        at = ahead
        iterations += 1
    y = at.y if at.residual <= _USABLE else np.full_like(d, np.nan)
    return Answer(multipliers=y * scale, iterations=iterations, residual=at.residual)


def _iterate(m: np.ndarray, d: np.ndarray, top: np.ndarray, size: float, at: _Iterate) -> _Iterate:
    """One predictor and one corrector step from the same factorisation."""
    from scipy.linalg.lapack import dpotrf, dpotrs

    y, low, high = at.y, at.low, at.high
    room, count = top - y, len(d)
    gradient = m @ y - d - low + high
    gap = (y @ low + room @ high) / (2 * count)
    bent = m.copy()
    bent.flat[:: count + 1] += low / y + high / room + _ROUNDING
    factor, failed = dpotrf(bent.T, lower=True, overwrite_a=True, clean=False)
    if failed:
        return at._replace(residual=np.nan)
    values = np.concatenate([y, room, low, high])

    def direction(low_target: np.ndarray, high_target: np.ndarray) -> tuple[np.ndarray, ...]:
        """Newton's direction for wanted changes of the products ``y low`` and ``room high``."""
        step, _ = dpotrs(factor, low_target / y - high_target / room - gradient, lower=True)
        return step, (low_target - low * step) / y, (high_target + high * step) / room

    def length(steps: tuple[np.ndarray, ...], share: float) -> float:
        """How far a step may go before one of the four meets zero."""
        step, low_step, high_step = steps
        steepest = float(np.max(-np.concatenate([step, -step, low_step, high_step]) / values))
        return min(1.0, share / steepest) if steepest > 0 else 1.0

    ahead = direction(-y * low, -room * high)
    far = length(ahead, 1.0)
    reached = (y + far * ahead[0]) @ (low + far * ahead[1]) + (room - far * ahead[0]) @ (
        high + far * ahead[2]
    )
    target = gap * (reached / (2 * count) / gap) ** 3
    ahead = direction(target - y * low - ahead[0] * ahead[1], target - room * high + ahead[0] * ahead[2])
    far = length(ahead, _INTERIOR)
    step, low_step, high_step = ahead
    y, low, high = y + far * step, low + far * low_step, high + far * high_step
    gradient = m @ y - d - low + high
    gap = (y @ low + (top - y) @ high) / (2 * count)
    residual = max(float(np.sqrt(np.mean(gradient * gradient))) / size, float(gap) / size**2)
    return _Iterate(y=y, low=low, high=high, residual=residual)
