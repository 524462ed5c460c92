"""Quadratic programs in a box, which is what the dual of a program with elastic rows is.

    minimise  y^T M y / 2 - d^T y    subject to    0 <= y <= penalty

``M`` is symmetric and positive semidefinite. Mehrotra's predictor-corrector method with a dense Cholesky
factorisation; the matrix it factors is ``M`` plus a positive diagonal, so rows may depend on each other.
Programs have tens or hundreds of rows, no two the same number: LAPACK takes each as it is. All else is done
for many programs at once, their rows one after the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jaxplan.runtime.batching import parts
from jaxplan.trajectory import options

_TINY = 1e-12  # least size of d


class BoxQP(NamedTuple):
    """A program.

    Attributes:
        matrix: (R, R) ``M``, with a positive diagonal.
        linear: (R,) ``d``.
        penalty: (R,) positive and finite.
    """

    matrix: np.ndarray
    linear: np.ndarray
    penalty: np.ndarray


class BoxQPSolution(NamedTuple):
    """Solution of one program.

    Attributes:
        multipliers: (R,) ``y``; NaN where the iteration broke down.
        iterations: how many it took.
        residual: the largest of what is left of the conditions of an optimum, in their scaled form.
    """

    multipliers: np.ndarray
    iterations: int
    residual: float


def solve_box_qps(programs: Sequence[BoxQP]) -> list[BoxQPSolution]:
    """Solve many programs."""
    solutions: dict[int, BoxQPSolution] = {}
    scaled, scales = {}, {}
    for number, (matrix, linear, penalty) in enumerate(programs):
        if not len(linear):
            solutions[number] = BoxQPSolution(np.zeros(0), iterations=0, residual=0.0)
            continue
        scale = 1 / np.sqrt(matrix.diagonal())
        own = BoxQP(matrix * scale[:, None] * scale, linear * scale, penalty / scale)
        if all(np.isfinite(part).all() for part in own):
            scaled[number], scales[number] = own, scale
        else:
            solutions[number] = BoxQPSolution(np.full_like(linear, np.nan), iterations=0, residual=np.nan)
    for part in parts(list(scaled), options.BOX_QP.together):
        for number, found in zip(part, _solve([scaled[number] for number in part]), strict=True):
            y = found.multipliers if found.residual <= options.BOX_QP.usable else np.nan
            solutions[number] = found._replace(multipliers=y * scales[number])
    return [solutions[number] for number in range(len(programs))]


@dataclass(frozen=True, eq=False)
class _BoxQPStack:
    """Programs in their scaled form with their rows one after the other, N in all.

    Attributes:
        matrices: of each.
        parts: its rows.
        first: (P,) the first of them.
        count: (P,) how many.
        d: (N,).
        top: (N,).
        size: (P,) of its ``d``.
    """

    matrices: list[np.ndarray]
    parts: list[slice]
    first: np.ndarray
    count: np.ndarray
    d: np.ndarray
    top: np.ndarray
    size: np.ndarray

    @classmethod
    def of(cls, programs: Sequence[BoxQP]) -> "_BoxQPStack":
        """The stack of some programs."""
        matrices, d, top = zip(*programs, strict=True)
        count = np.array([len(own) for own in d])
        last = np.cumsum(count)
        first = last - count
        d = np.concatenate(d)
        return cls(
            matrices=list(matrices),
            parts=[slice(*part) for part in zip(first.tolist(), last.tolist(), strict=True)],
            first=first,
            count=count,
            d=d,
            top=np.concatenate(top),
            size=np.maximum(np.sqrt(np.add.reduceat(d * d, first) / count), _TINY),
        )

    def gradient(self, values: np.ndarray) -> np.ndarray:
        """(N,) what is left of the first condition of an optimum."""
        product = np.empty_like(self.d)
        for m, rows in zip(self.matrices, self.parts, strict=True):
            np.dot(m, values[0, rows], out=product[rows])
        product -= self.d
        product -= values[2]
        product += values[3]
        return product

    def gap(self, values: np.ndarray) -> np.ndarray:
        """(P,) mean product of a bound's room and its multiplier."""
        products = values[0] * values[2]
        products += values[1] * values[3]
        return np.add.reduceat(products, self.first) / (2 * self.count)

    def spread(self, own: np.ndarray) -> np.ndarray:
        """What each program has (P,), for each of its rows: (N,), or (1,) of a single one."""
        return own if len(own) == 1 else np.repeat(own, self.count)


def _solve(programs: Sequence[BoxQP]) -> list[BoxQPSolution]:
    """Iterate until each program is solved, or as near as rounding allows."""
    stack, number = _BoxQPStack.of(programs), np.arange(len(programs))
    solutions: dict[int, BoxQPSolution] = {}
    values, residual = _first(stack), np.full(len(programs), np.inf)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        for iterations in range(options.BOX_QP.most_iterations + 1):
            done = (residual <= options.BOX_QP.tolerance) | (iterations == options.BOX_QP.most_iterations)
            ahead, left = values, np.full(len(number), np.nan)
            if not done.all():
                ahead, left = _iterate(stack, values)
            over = done | ~np.isfinite(left)
            if over.any():
                for own in np.flatnonzero(over).tolist():
                    y = values[0, stack.parts[own]]
                    solutions[int(number[own])] = BoxQPSolution(y, iterations, float(residual[own]))
                if over.all():
                    break
                ahead, left, number = ahead[:, stack.spread(~over)], left[~over], number[~over]
                stack = _BoxQPStack.of([programs[own] for own in number.tolist()])
            values, residual = ahead, left
    return [solutions[own] for own in range(len(programs))]


def _first(stack: _BoxQPStack) -> np.ndarray:
    """Where to begin: (4, N) ``y``, the room above it, and the multipliers of the two bounds, all positive.

    The products of each bound's room and multiplier are alike, however wide the box is.
    """
    inside, d, top = stack.spread(options.BOX_QP.inside * stack.size), stack.d, stack.top
    y = np.minimum(np.maximum(d, 0) + inside, top / 2)
    return np.stack([y, top - y, np.maximum(-d, 0) + inside, inside**2 / (top - y)])


def _iterate(stack: _BoxQPStack, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One predictor and one corrector step from the same factorisations; NaN is left where there is none."""
    from scipy.linalg.lapack import dpotrf, dpotrs

    room, multipliers = values[:2], values[2:]
    first, count = stack.first, stack.count
    gap, gradient = stack.gap(values), stack.gradient(values)
    ratio = multipliers / room
    diagonal = ratio[0] + ratio[1] + options.BOX_QP.regularisation
    factors, broken = [], np.zeros(len(first), bool)
    for own, (m, rows) in enumerate(zip(stack.matrices, stack.parts, strict=True)):
        bent = m.copy()
        bent.reshape(-1)[:: len(m) + 1] += diagonal[rows]
        factor, broken[own] = dpotrf(bent.T, lower=True, overwrite_a=True, clean=False)
        factors.append(factor)

    def direction(wanted: np.ndarray) -> np.ndarray:
        """Newton's direction (4, N) for wanted changes of the products, over the room, (2, N)."""
        step = np.empty_like(values)
        right = wanted[0] - wanted[1] - gradient
        for factor, rows in zip(factors, stack.parts, strict=True):
            step[0, rows], _ = dpotrs(factor, right[rows], lower=True)
        np.negative(step[0], out=step[1])
        step[2:] = wanted - ratio * step[:2]
        return step

    def length(step: np.ndarray, share: float) -> np.ndarray:
        """How far (N,) a step may go before one of the four meets zero, for each program."""
        steepest = -np.minimum.reduceat((step / values).min(axis=0), first)
        return stack.spread(share / np.maximum(steepest, share))

    step = direction(-multipliers)
    reached = values + length(step, 1.0) * step
    target = stack.spread(gap * (stack.gap(reached) / gap) ** 3)
    step = direction((target - step[:2] * step[2:]) / room - multipliers)
    ahead = values + length(step, options.BOX_QP.interior) * step
    ahead[1] = stack.top - ahead[0]
    gradient = stack.gradient(ahead)
    steep = np.sqrt(np.add.reduceat(gradient * gradient, first) / count) / stack.size
    left = np.maximum(steep, stack.gap(ahead) / stack.size**2)
    inside = np.logical_and.reduceat((ahead > 0).all(axis=0), first)
    return ahead, np.where(inside & ~broken, left, np.nan)
