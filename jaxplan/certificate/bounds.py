"""Least values of many polynomials at once, as proved lower bounds, by subdivision in the Bernstein basis.

On its interval a polynomial lies above the least of its Bernstein coefficients, and the first and last of
them are its values at the ends. Halving the interval brings the two together quadratically. So: bound, drop
what is settled, halve the rest, all rows at once.

Rows come in nests. An *entry* holds where all its rows do, so its value is that of its worst row; a
*clause* holds where one of its entries does, so its value is that of its best entry. The rows of one clause
on one interval form a *task* and are halved together. Clauses belong to *quantities*, for which one least
value is wanted, and to *owners*, of whom each has a budget of work. The last axis numbers the rows.

What is found for one owner is, to the last bit, the same whichever others there are: nothing is summed but
along each row by itself.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import comb
from typing import Self

import numpy as np

# By how much the polynomial through samples at most enlarges their errors, up to degree 12.
LEBESGUE = 3.0
_MOST_HALVINGS = 40
_MOST_ROWS = 400_000  # of an owner, in one round


@dataclass(frozen=True, kw_only=True, eq=False)
class Layout:
    """How rows nest. Each row is of a kind; kinds are numbered clause by clause and entry by entry.

    Attributes:
        opens_entry: (kinds,) bool, whether the kind is the first of its entry.
        opens_clause: (kinds,) bool, whether it is the first of its clause.
        quantity: (clauses,) int, the quantity each clause belongs to.
        owner: (clauses,) int, the owner each clause belongs to.
    """

    opens_entry: np.ndarray
    opens_clause: np.ndarray
    quantity: np.ndarray
    owner: np.ndarray

    @classmethod
    def joined(cls, layouts: Sequence[Self]) -> Self:
        """Those of some owners, each the only one of its layout; they are numbered in this order."""
        quantities = [layout.quantity.max(initial=-1) + 1 for layout in layouts]
        clauses = [len(layout.quantity) for layout in layouts]
        before = np.cumsum([0, *quantities[:-1]])
        return cls(
            opens_entry=np.concatenate([layout.opens_entry for layout in layouts]),
            opens_clause=np.concatenate([layout.opens_clause for layout in layouts]),
            quantity=np.concatenate([layout.quantity for layout in layouts]) + np.repeat(before, clauses),
            owner=np.repeat(np.arange(len(layouts)), clauses),
        )

    @property
    def clause(self) -> np.ndarray:
        """(kinds,) number of the clause that each kind belongs to."""
        return np.cumsum(self.opens_clause) - 1

    def fold(self, kind: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values of tasks from those of their rows, which lie together: the best entry's worst row.

        Args:
            kind: (rows,).
            values: (..., rows).

        Returns:
            (..., tasks).
        """
        entries = np.flatnonzero(self.opens_entry[kind])
        clauses = np.flatnonzero(self.opens_clause[kind[entries]])
        if len(clauses) == len(kind):  # each row is a task
            return values
        return np.maximum.reduceat(np.minimum.reduceat(values, entries, axis=-1), clauses, axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Polynomials on intervals, the rows of each task together and in the order of their kinds.

    Attributes:
        coefficients: (K + 1, rows) in the Bernstein basis.
        error: (rows,) how far each polynomial may be off.
        kind: (rows,) int.
        low: (tasks,) s, start of the interval.
        high: (tasks,) s, its end.
    """

    coefficients: np.ndarray
    error: np.ndarray
    kind: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Minima:
    """What is known of each clause's least value.

    Attributes:
        bound: (clauses,) proved lower bound.
        seen: (clauses,) least value met.
        time: (clauses,) s, when it was met.
    """

    bound: np.ndarray
    seen: np.ndarray
    time: np.ndarray

    @classmethod
    def of(cls, clauses: int) -> "Minima":
        """Nothing known yet of so many clauses."""
        return cls(bound=np.full(clauses, np.inf), seen=np.full(clauses, np.inf), time=np.zeros(clauses))

    def part(self, of: slice) -> "Minima":
        """Of some clauses; what is changed in one is changed in both."""
        return Minima(bound=self.bound[of], seen=self.seen[of], time=self.time[of])

    def meet(self, clause: np.ndarray, value: np.ndarray, time: np.ndarray) -> None:
        """Takes in values (k,) of clauses at some times."""
        np.minimum.at(self.seen, clause, value)
        least = value == self.seen[clause]
        self.time[clause[least]] = time[least]

    def wanted(self, layout: Layout, tolerance: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Bounds that are good enough, for each clause; see `minimise`."""
        least = np.full(layout.quantity.max(initial=0) + 1, np.inf)
        np.minimum.at(least, layout.quantity, self.seen)
        enough = np.maximum(least - tolerance(least), 0)[layout.quantity]
        return np.minimum(self.seen - tolerance(self.seen), enough)


@lru_cache
def to_bernstein(degree: int) -> np.ndarray:
    """Matrix from values at the extrema of the Chebyshev polynomial to Bernstein coefficients.

    Both are in rising order of their places. The Chebyshev polynomials have

        T_n(2 u - 1) = sum_j (-1)^(n - j) C(2 n, 2 j) u^j (1 - u)^(n - j);

    times ``(u + (1 - u))^(K - n)`` they are of degree K, in exact integers.

    Args:
        degree: K.

    Returns:
        (K + 1, K + 1); its largest row sum is `growth`.
    """
    order = np.arange(degree + 1)
    cosines = np.cos(np.pi / degree * np.outer(order, degree - order))  # T_n at the nodes
    ends_halved = np.where((order == 0) | (order == degree), 0.5, 1.0)
    to_chebyshev = (2 / degree) * ends_halved[:, None] * cosines * ends_halved
    columns = []
    for n in range(degree + 1):
        own = [(-1) ** (n - j) * comb(2 * n, 2 * j) for j in range(n + 1)]
        columns.append(np.convolve(own, [comb(degree - n, i) for i in range(degree - n + 1)]))
    binomials = np.array([comb(degree, j) for j in range(degree + 1)])
    matrix = np.column_stack(columns) / binomials[:, None] @ to_chebyshev
    matrix[[0, -1]] = np.eye(degree + 1)[[0, -1]]  # exactly
    return matrix


@lru_cache
def growth(degree: int) -> float:
    """By how much `to_bernstein` may enlarge an error: it grows like 2^K, 733 for K = 10."""
    return float(np.abs(to_bernstein(degree)).sum(axis=1).max())


def to_rows(samples: np.ndarray) -> np.ndarray:
    """Bernstein coefficients (K + 1, rows) from samples (rows, K + 1) at the places of `to_bernstein`."""
    values = np.ascontiguousarray(samples.T)
    if values.shape[1] == 1:  # of one row alone numpy takes the sum in another order
        return to_rows(np.repeat(samples, 2, axis=0))[:, :1]
    return np.einsum("kj,jr->kr", to_bernstein(len(values) - 1), values)


def _halved(coefficients: np.ndarray) -> np.ndarray:
    """Coefficients (K + 1, 2 rows) of all left halves and then of all right ones, by de Casteljau."""
    last, count = len(coefficients) - 1, coefficients.shape[1]
    halves = np.empty((last + 1, 2 * count))
    left, right = halves[:, :count], halves[:, count:]
    between = coefficients
    left[0], right[last] = between[0], between[last]
    for k in range(1, last + 1):
        between = (between[:-1] + between[1:]) / 2
        left[k], right[last - k] = between[0], between[-1]
    return halves


def minimise(
    rows: Rows,
    layout: Layout,
    minima: Minima,
    value: Callable[[np.ndarray, np.ndarray], np.ndarray],
    tolerance: Callable[[np.ndarray], np.ndarray],
) -> None:
    """Bounds the least value of every clause over all its tasks, and completes `minima` with it.

    The least clause of a quantity is bounded to within the tolerance, and so is every clause that falls
    below zero; of the others it is only proved that they are larger. Where the work for an owner exceeds a
    fixed budget, its bounds are less tight, but remain bounds.

    Args:
        rows: what is not settled yet.
        layout: how rows nest.
        minima: what is known already; changed in place.
        value: rising function of polynomials' values (..., rows) and of the rows' kinds (rows,).
        tolerance: how close a bound must come to the least value met, (clauses,) to (clauses,).
    """
    clause_of = layout.clause
    coefficients, error, kind, low, high = rows.coefficients, rows.error, rows.kind, rows.low, rows.high
    for _ in range(_MOST_HALVINGS):
        clause = clause_of[kind[layout.opens_clause[kind]]]
        ends = coefficients[[0, -1]]
        guarded = np.concatenate([coefficients.min(axis=0)[None] - error, ends - error, ends])
        lower, left, right, at_low, at_high = layout.fold(kind, value(guarded, kind))
        minima.meet(clause, at_low, low)
        minima.meet(clause, at_high, high)
        # Halving does not help where an end is the least already.
        settled = (lower >= minima.wanted(layout, tolerance)[clause]) | (lower >= np.minimum(left, right))
        owner = layout.owner[clause]
        task = np.cumsum(layout.opens_clause[kind]) - 1
        unsettled = np.bincount(owner[task], ~settled[task], minlength=1)
        settled |= (2 * unsettled > _MOST_ROWS)[owner]
        np.minimum.at(minima.bound, clause[settled], lower[settled])
        lower, clause = lower[~settled], clause[~settled]
        row = np.flatnonzero(~settled[task])
        if len(row) == 0:
            return
        coefficients = _halved(coefficients[:, row])
        middle = (low + high)[~settled] / 2
        error, kind = np.tile(error[row], 2), np.tile(kind[row], 2)
        low, high = np.append(low[~settled], middle), np.append(middle, high[~settled])
    np.minimum.at(minima.bound, clause, lower)
