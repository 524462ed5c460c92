"""Quadratic programs in a box, which is what the dual of a program with elastic rows is.

    minimise  y^T M y / 2 - d^T y    subject to    0 <= y <= penalty

``M`` is symmetric and positive semidefinite. Mehrotra's predictor-corrector method with a dense Cholesky
factorisation; the matrix it factors is ``M`` plus a positive diagonal, so rows may depend on each other.
Programs have tens or hundreds of rows, no two the same number: LAPACK takes each as it is.
"""

from typing import NamedTuple

import numpy as np

MOST_ITERATIONS = 60
TOLERANCE = 1e-9  # of the residual, in the scaled form, relative to the size of d
_USABLE = 1e-4  # such a residual is still an answer, where rounding or the iterations end it
_INTERIOR = 0.995  # share of the way to the boundary that a step may take
_INSIDE = 0.5  # of the size of d: how far inside the box an iteration begins
_TINY = 1e-12  # least size of d
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
    size = max(float(np.sqrt(np.mean(d * d))), _TINY)
    values, residual, iterations = _first(d, top, size), np.inf, 0
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        while iterations < MOST_ITERATIONS and residual > TOLERANCE:
            ahead, left = _iterate(m, d, top, size, values)
            if not np.isfinite(left):  # as near as rounding allows
                break
            values, residual = ahead, left
            iterations += 1
    y = values[0] if residual <= _USABLE else np.full_like(d, np.nan)
    return Answer(multipliers=y * scale, iterations=iterations, residual=residual)


def _first(d: np.ndarray, top: np.ndarray, size: float) -> np.ndarray:
    """Where to begin: (4, R) ``y``, the room above it, and the multipliers of the two bounds, all positive.

    The products of each bound's room and multiplier are alike, however wide the box is.
    """
    inside = _INSIDE * size
    y = np.minimum(np.maximum(d, 0) + inside, top / 2)
    return np.stack([y, top - y, np.maximum(-d, 0) + inside, inside**2 / (top - y)])


def _iterate(
    m: np.ndarray, d: np.ndarray, top: np.ndarray, size: float, values: np.ndarray
) -> tuple[np.ndarray, float]:
    """One predictor and one corrector step from the same factorisation; NaN is left where there is none."""
    from scipy.linalg.lapack import dpotrf, dpotrs

    room, multipliers = values[:2], values[2:]
    count = len(d)
    gap = np.vdot(room, multipliers) / (2 * count)
    gradient = m @ values[0] - d - multipliers[0] + multipliers[1]
    ratio = multipliers / room
    bent = m.copy()
    bent.flat[:: count + 1] += ratio[0] + ratio[1] + _ROUNDING
    factor, failed = dpotrf(bent.T, lower=True, overwrite_a=True, clean=False)
    if failed:
        return values, np.nan

    def direction(wanted: np.ndarray) -> np.ndarray:
        """Newton's direction (4, R) for wanted changes of the products, over the room, (2, R)."""
        step = np.empty_like(values)
        step[0], _ = dpotrs(factor, wanted[0] - wanted[1] - gradient, lower=True)
        np.negative(step[0], out=step[1])
        step[2:] = wanted - ratio * step[:2]
        return step

    def length(step: np.ndarray, share: float) -> float:
        """How far a step may go before one of the four meets zero."""
        steepest = -float(np.min(step / values))
        return min(1.0, share / steepest) if steepest > 0 else 1.0

    step = direction(-multipliers)
    reached = values + length(step, 1.0) * step
    target = gap * (np.vdot(reached[:2], reached[2:]) / (2 * count) / gap) ** 3
    step = direction((target - step[:2] * step[2:]) / room - multipliers)
    ahead = values + length(step, _INTERIOR) * step
    ahead[1] = top - ahead[0]
    gradient = m @ ahead[0] - d - ahead[2] + ahead[3]
    gap = np.vdot(ahead[:2], ahead[2:]) / (2 * count)
    left = max(float(np.sqrt(np.mean(gradient * gradient))) / size, float(gap) / size**2)
    return ahead, left if np.all(ahead > 0) else np.nan
