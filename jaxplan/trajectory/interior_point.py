"""Solve small quadratic programs in a box.

That is the form of the dual of a program with elastic rows:

    minimise  y^T M y / 2 - d^T y    subject to    0 <= y <= penalty

``M`` is symmetric and positive semidefinite. The method is Mehrotra's predictor-corrector, with a Cholesky
factorisation (`gram`); what is factored is ``M`` plus a positive diagonal, so rows may depend on each other.
Programs have tens or hundreds of rows, no two the same number: LAPACK factors each separately. Everything
else is done for P programs at once, with their rows one after the other, N in all.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jaxplan.runtime.batching import parts
from jaxplan.trajectory.gram import DenseGram, Gram

_MAX_ITERATIONS = 60  # most iterations, after which the answer is taken if it is usable
_RESIDUAL_TOLERANCE = 1e-9  # of the scaled residual, relative to the size of the linear term
ROUGHLY = 1e-6  # the same, of a program whose solution is only a step of another iteration
_MAX_USABLE_RESIDUAL = 1e-4  # largest residual of an answer, where the method ends above its tolerance
_BOUNDARY_STEP_FRACTION = 0.995  # fraction of the distance to the boundary that a step may take
_START_DISTANCE = 0.5  # of the size of the linear term, distance from the bounds where the iteration begins
_REGULARISATION = 1e-14  # added to the diagonal, which is of order one
# The same where multipliers are guessed: of these, and of the bounds' multipliers. Binding ones are large.
_START_DISTANCES_FROM_GUESS = (10.0, 0.3)
TOGETHER = 16  # programs solved together; their matrices are then still in the processor's cache

_MIN_LINEAR_SIZE = 1e-12  # least size of d that is divided by


class BoxQP(NamedTuple):
    """A quadratic program in a box, with R rows.

    Attributes:
        matrix: (R, R) ``M``, with a positive diagonal, as an array or as a `Gram`.
        linear: (R,) ``d``.
        penalty: (R,) upper bounds of ``y``, positive and finite.
        guess: (R,) ``y`` near the solution, from which the iteration begins; None for a default.
        tolerance: of the residual, see `BoxQPSolution`.
    """

    matrix: np.ndarray | Gram
    linear: np.ndarray
    penalty: np.ndarray
    guess: np.ndarray | None = None
    tolerance: float = _RESIDUAL_TOLERANCE


class BoxQPSolution(NamedTuple):
    """Solution of one quadratic program in a box.

    Attributes:
        multipliers: (R,) ``y``; NaN where the iteration broke down.
        residual: the largest residual of the optimality conditions, in their scaled form; NaN where input
            numbers are not finite.
    """

    multipliers: np.ndarray
    residual: float


def solve_box_qps(programs: Sequence[BoxQP]) -> list[BoxQPSolution]:
    """Solve many quadratic programs in boxes; there is one solution for each, in the same order.

    A solution that is not precise enough to be used is NaN.
    """
    solutions: dict[int, BoxQPSolution] = {}
    scaled, scales = {}, {}
    for number, (matrix, linear, penalty, guess, tolerance) in enumerate(programs):
        if not len(linear):
            solutions[number] = BoxQPSolution(np.zeros(0), residual=0.0)
            continue
        gram = DenseGram(matrix) if isinstance(matrix, np.ndarray) else matrix
        scale = 1 / np.sqrt(gram.diagonal())
        gram = gram.scaled(scale)
        near = None if guess is None else guess / scale
        own = BoxQP(gram, linear * scale, penalty / scale, near, tolerance)
        if gram.is_finite() and np.isfinite(own.linear).all() and np.isfinite(own.penalty).all():
            scaled[number], scales[number] = own, scale
        else:
            solutions[number] = BoxQPSolution(np.full_like(linear, np.nan), residual=np.nan)
    for part in parts(list(scaled), TOGETHER):
        for number, found in zip(part, _solve_scaled([scaled[number] for number in part]), strict=True):
            y = found.multipliers if found.residual <= _MAX_USABLE_RESIDUAL else np.nan
            solutions[number] = found._replace(multipliers=y * scales[number])
    return [solutions[number] for number in range(len(programs))]


class _Iterate(NamedTuple):
    """An iterate of P programs with N rows in all.

    Attributes:
        values: (4, N), all positive: ``y``, the room between it and its upper bound, and the multipliers of
            the lower and of the upper bounds.
        gradient: (N,) residual of stationarity, ``M y - d`` less the lower bounds' multipliers plus the upper
            bounds'.
        gap: (P,) mean product of the room to a bound and that bound's multiplier.
    """

    values: np.ndarray
    gradient: np.ndarray
    gap: np.ndarray


@dataclass(frozen=True, eq=False)
class _BoxQPStack:
    """P programs in their scaled form with their rows one after the other, N in all.

    Attributes:
        matrices: ``M`` of each program.
        parts: slice of the rows of each program among the N.
        first: (P,) index of the first row of each.
        count: (P,) number of rows of each.
        d: (N,) linear terms.
        top: (N,) upper bounds, the penalties.
        size: (P,) root mean square of each program's ``d``.
        tolerance: (P,) of the residuals.
    """

    matrices: list[Gram]
    parts: list[slice]
    first: np.ndarray
    count: np.ndarray
    d: np.ndarray
    top: np.ndarray
    size: np.ndarray
    tolerance: np.ndarray

    @classmethod
    def of(cls, programs: Sequence[BoxQP]) -> "_BoxQPStack":
        """Make the stack of some programs, none of which is empty."""
        matrices, d, top, _, tolerance = zip(*programs, strict=True)
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
            size=np.maximum(np.sqrt(np.add.reduceat(d * d, first) / count), _MIN_LINEAR_SIZE),
            tolerance=np.array(tolerance),
        )

    def at(self, values: np.ndarray) -> "_Iterate":
        """Make the iterate of given values, (4, N) as in `_Iterate`, with its residuals."""
        gradient = values[3] - values[2]
        gradient -= self.d
        for m, rows in zip(self.matrices, self.parts, strict=True):
            gradient[rows] += m.times(values[0, rows])
        return _Iterate(values, gradient, self.gap(values))

    def gap(self, values: np.ndarray) -> np.ndarray:
        """Mean product (P,), for each program, of the room to a bound and that bound's multiplier.

        `values` are those of an `_Iterate`.
        """
        products = values[:2] * values[2:]
        return np.add.reduceat(products[0] + products[1], self.first) / (2 * self.count)

    def residual(self, iterate: "_Iterate") -> np.ndarray:
        """Error (P,) of each program's iterate in the optimality conditions, relative to the linear terms."""
        squares = np.add.reduceat(iterate.gradient * iterate.gradient, self.first)
        return np.maximum(np.sqrt(squares / self.count) / self.size, iterate.gap / self.size**2)

    def least(self, values: np.ndarray) -> np.ndarray:
        """Least of the values (4, N) of all rows for each program, (P,); NaN where one is NaN."""
        return np.asarray(np.minimum.reduceat(values, self.first, axis=1).min(axis=0))

    def spread(self, own: np.ndarray) -> np.ndarray:
        """Repeat one number for each program (P,) for each of its rows (N,); (1,) for a single program."""
        return own if len(own) == 1 else np.repeat(own, self.count)


def _solve_scaled(programs: Sequence[BoxQP]) -> list[BoxQPSolution]:
    """Solve programs in their scaled form, each to its tolerance if rounding and `_MAX_ITERATIONS` allow."""
    stack, number = _BoxQPStack.of(programs), np.arange(len(programs))
    solutions: dict[int, BoxQPSolution] = {}
    iterate, residual = stack.at(_first_values(stack, programs)), np.full(len(programs), np.inf)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        for iterations in range(_MAX_ITERATIONS + 1):
            done = (residual <= stack.tolerance) | (iterations == _MAX_ITERATIONS)
            ahead, left = iterate, np.full(len(number), np.nan)
            if not done.all():
                ahead, left = _predictor_corrector_step(stack, iterate)
            over = done | ~np.isfinite(left)
            if over.any():
                for own in np.flatnonzero(over).tolist():
                    y = iterate.values[0, stack.parts[own]]
                    solutions[int(number[own])] = BoxQPSolution(y, float(residual[own]))
                if over.all():
                    break
                rows = stack.spread(~over)
                ahead = _Iterate(ahead.values[:, rows], ahead.gradient[rows], ahead.gap[~over])
                left, number = left[~over], number[~over]
                stack = _BoxQPStack.of([programs[own] for own in number.tolist()])
            iterate, residual = ahead, left
    return [solutions[own] for own in range(len(programs))]


def _first_values(stack: _BoxQPStack, programs: Sequence[BoxQP]) -> np.ndarray:
    """Values of the first iterate of all programs, (4, N) as in `_Iterate`.

    The products of each bound's room and multiplier are similar, however wide the box is.
    """
    first = _default_first_values(stack)
    of_each = zip(programs, stack.matrices, stack.parts, stack.size, strict=True)
    for own, matrix, rows, size in of_each:
        if own.guess is not None:
            inside, room = (share * size for share in _START_DISTANCES_FROM_GUESS)
            y = np.minimum(own.guess + inside, own.penalty - np.minimum(own.penalty / 2, inside))
            lower = np.maximum(matrix.times(own.guess) - own.linear, 0) + room
            first[:, rows] = y, own.penalty - y, lower, inside * room / (own.penalty - y)
    return first


def _default_first_values(stack: _BoxQPStack) -> np.ndarray:
    """Do the same as `_first_values` for programs without guesses."""
    inside, d, top = stack.spread(_START_DISTANCE * stack.size), stack.d, stack.top
    y = np.minimum(np.maximum(d, 0) + inside, top / 2)
    return np.stack([y, top - y, np.maximum(-d, 0) + inside, inside**2 / (top - y)])


def _predictor_corrector_step(stack: _BoxQPStack, iterate: _Iterate) -> tuple[_Iterate, np.ndarray]:
    """Take one predictor and one corrector step, both with the same factorisations.

    Args:
        stack: the programs.
        iterate: where the step begins.

    Returns:
        The next iterate, and (P,) its residuals, NaN where a program has broken down.
    """
    values, gradient, gap = iterate
    room, multipliers = values[:2], values[2:]
    ratio = multipliers / room
    diagonal = ratio[0] + ratio[1]
    diagonal += _REGULARISATION
    solvers = [m.factored(diagonal[rows]) for m, rows in zip(stack.matrices, stack.parts, strict=True)]

    def direction(wanted: np.ndarray) -> np.ndarray:
        """Newton's direction, (4, N) like the values, for wanted changes of the products room * multiplier.

        `wanted` (2, N) are these changes divided by the room, for lower and upper bounds.
        """
        step = np.empty_like(values)
        right = wanted[0] - wanted[1]
        right -= gradient
        for solve, rows in zip(solvers, stack.parts, strict=True):
            step[0, rows] = np.nan if solve is None else solve(right[rows])
        np.negative(step[0], out=step[1])
        np.multiply(ratio, step[:2], out=step[2:])
        np.subtract(wanted, step[2:], out=step[2:])
        return step

    def beyond(step: np.ndarray, share: float) -> np.ndarray:
        """Values (4, N) after a `share` of the largest step that keeps them positive, at most the whole step.

        The step has one length for all rows of a program.
        """
        steepest = stack.least(step / values)
        ahead = stack.spread(share / np.maximum(-steepest, share)) * step
        ahead += values
        return ahead

    step = direction(-multipliers)
    target = stack.spread(gap * (stack.gap(beyond(step, 1.0)) / gap) ** 3)
    wanted = step[:2] * step[2:]
    np.subtract(target, wanted, out=wanted)
    wanted /= room
    wanted -= multipliers
    reached = beyond(direction(wanted), _BOUNDARY_STEP_FRACTION)
    np.subtract(stack.top, reached[0], out=reached[1])
    ahead = stack.at(reached)
    return ahead, np.where(stack.least(reached) > 0, stack.residual(ahead), np.nan)
