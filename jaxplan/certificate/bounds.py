"""Bounds between samples: errors of the polynomials through them, and their least values.

**Interpolation.** A trajectory is sampled on intervals so short that polynomials through the samples leave
out next to nothing (`gather`). The polynomial of degree K through the samples at `motion.NODES` of an
interval of half width h is off by at most ``2^(1 - K) h^(K + 1) |f^(K+1)| / (K + 1)!``. Derivatives are
bounded by majorants (see `series`). Let ``g`` be one of ``eta`` without its constant term. Then ``exp(g)`` is
one of ``exp(eta^)``: in the expansion around the constant every factor is a rotation, of norm one, or is
bounded by ``g``. So with ``m = g + |Omega| t`` the attitude has the majorant ``exp(m)``, and the angular
velocity, which is ``R^T R'``, the majorant ``exp(2 m) m'``. In body axes a boresight, or another vector of a
terminal's moving part, has the exponential of the majorants of its yaw and its pitch together, and what is
fixed there is its own majorant, one. In inertial axes ``m`` is added to the exponent. It is the scalar
product of sight and axis that is interpolated, so where both move the majorant is the product of theirs: the
exponents of two sights add up, and that of an inertial axis is in `motion`.

**Rounding.** Legendre sums err by a few units in the last place of their terms. How an error of ``eta`` moves
the rest follows from the same majorants, to first order; other steps are taken to err by a few units too.

**Least values** of many polynomials at once are bounded from below by subdivision in the Bernstein basis
(`minimise`). On its interval a polynomial lies above the least of its Bernstein coefficients, and the first
and last of them are its values at the ends. Halving the interval brings the two together quadratically. So:
bound, drop what is settled, halve the rest, all rows at once. The last axis numbers the rows.

Rows come in nests. An *entry* holds where all its rows do, so its value is that of its worst row; a
*clause* holds where one of its entries does, so its value is that of its best entry. The rows of one clause
on one interval form a *task* and are halved together. Clauses belong to *quantities*, for which one least
value is wanted, and to *owners*, of whom each has a budget of work. What is found for one owner is, to the
last bit, the same whichever others there are: nothing is summed but along each row by itself.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import comb, perm
from typing import Self

import numpy as np

from jaxplan.certificate import series
from jaxplan.certificate.motion import DEGREE, Intervals, Motion, Samples, Way
from jaxplan.certificate.series import ROUNDING

NEGLIGIBLE = 1e-11  # share of a limit or angle that polynomials may leave out, a hundredth of the allowances
LEBESGUE = 3.0  # by how much the polynomial through samples at most enlarges their errors, up to degree 12
_MOST_INTERVALS = (
    4000  # of a trajectory, or twice as many as before a round: beyond, intervals stay as they are
)
_MOST_PARTS = 16  # into which an interval is cut in one round
_ROUNDS = 12  # of cutting
_MOST_HALVINGS = 40  # of an interval
_MOST_ROWS = 400_000  # of an owner, in one round: beyond, its bounds stay as they are


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Bounds of errors on n intervals.

    Attributes:
        direction: (S + k, n) of all S sights relative to inertial axes, which may move, then of the k pairs
            within the body (`motion.Views.within`).
        spin: (3, n) of the angular velocity and its two derivatives, rad/s, rad/s^2, rad/s^3.
        joints: (3, J, n) of the joints and their two derivatives, rad, rad/s, rad/s^2.
        attitude: (n,) of unit vectors that the attitude turns; None where that is not asked for.
    """

    direction: np.ndarray
    spin: np.ndarray
    joints: np.ndarray
    attitude: np.ndarray | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Majorants:
    """Bounds of Taylor coefficients about any point of intervals, in the unit of their half widths h.

    Attributes:
        turning: (orders, n) ``m`` above, rad; zero at order zero.
        direction: (orders, S + k, n) of scalar products of sights with axes, as `Errors` has them.
        spin: (orders, n) of h times the angular velocity, rad.
        joints: (orders, J, n) rad.
    """

    turning: np.ndarray
    direction: np.ndarray
    spin: np.ndarray
    joints: np.ndarray

    @cached_property
    def attitude(self) -> np.ndarray:
        """(orders, n) of the attitude, ``exp(m)``."""
        return series.exponential(self.turning)


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Samples of trajectories with all that is needed to bound the motion between them.

    Attributes:
        on: intervals that cover all the time of each, in its order.
        samples: of the motion at `motion.NODES` of each.
        majorants: of the motion on them.
        left_out: what the polynomials through the samples leave out.
        rounding: size of the samples' rounding errors.
    """

    on: Intervals
    samples: Samples
    majorants: Majorants
    left_out: Errors
    rounding: Errors


def _of_sights(motion: Motion, joints: np.ndarray) -> np.ndarray:
    """For each sight the sum (..., S, n) of its yaw's and pitch's values among (..., J, n); zero without."""
    yaw, pitch = (np.moveaxis(part, 0, -2) for part in motion.mountings.split(np.moveaxis(joints, -2, 0)))
    still = np.zeros((*yaw.shape[:-2], len(motion.fixed), yaw.shape[-1]))
    both = yaw + pitch
    return np.concatenate([both, still, both[..., motion.views.carrier, :]], axis=-2)


def _within(motion: Motion, of_sights: np.ndarray) -> np.ndarray:
    """For each pair within the body the sum (..., k, n) of its sight's and its axis' values (..., S, n)."""
    sight, axis = motion.views.within.T
    return of_sights[..., sight, :] + np.where(axis[:, None] < 0, 0, of_sights[..., axis, :])


def majorants(motion: Motion, on: Intervals, ways: Sequence[Way] = ()) -> Majorants:
    """Majorants of everything that moves on some intervals.

    Args:
        motion: of the trajectories.
        on: intervals, each within one piece of every way.
        ways: of the inertial axes that move.
    """
    orders = DEGREE + 5
    centre = on.centre[:, None]
    unit = on.half ** np.arange(max(motion.platform.length, motion.joints.length, 2))[:, None]
    eta = motion.turn(on, centre, max(motion.platform.length, 2))[..., 0]
    turning = series.majorant(np.linalg.norm(eta, axis=1) * unit[: len(eta)], orders)
    turning[1] += on.half * np.linalg.norm(motion.chart_rate[on.piece], axis=-1)
    turning[0] = 0
    joints = motion.joints.taylor(on.joint_piece, centre, motion.joints.length)[..., 0]
    moving = series.majorant(np.abs(joints) * unit[: len(joints), None], orders)
    swinging = _of_sights(motion, moving)
    sweeping = np.concatenate([turning[:, None] + swinging, _within(motion, swinging)], axis=1)
    sweeping[0] = 0
    direction = series.exponential(sweeping)
    if ways:
        swiftest = np.max([way.majorant(on.centre, on.half, orders) for way in ways], axis=0)
        outward = slice(swinging.shape[1])
        direction[:, outward] = series.product("dn,n->dn", direction[:, outward], swiftest)
    spinning = series.product("n,n->n", series.exponential(2 * turning), series.slope(turning))
    return Majorants(turning=turning, direction=direction, spin=spinning, joints=moving)


def interpolation(on: Intervals, bounds: Majorants) -> Errors:
    """Bounds of the interpolation errors of the polynomials through samples, from majorants."""
    factor = 2.0 ** (1 - DEGREE)
    order, unit = DEGREE + 1, on.half ** -np.arange(3.0)[:, None]
    spin = np.stack([perm(order + d, d) * bounds.spin[order + d] for d in range(3)])
    joints = np.stack([perm(order + d, d) * bounds.joints[order + d] for d in range(3)])
    return Errors(
        direction=factor * bounds.direction[order],
        spin=factor * spin * unit / on.half,
        joints=factor * joints * unit[:, None],
    )


def rounding(motion: Motion, on: Intervals, bounds: Majorants, ways: Sequence[Way] = ()) -> Errors:
    """Sizes of the rounding errors of samples, those of axes included; arguments as of `majorants`."""
    unit = on.half ** np.arange(4)[:, None]
    eta = np.linalg.norm(motion.platform.rounding(on.piece, 4), axis=1) * unit
    eta[0] += ROUNDING
    lever = series.slope(eta) + 2 * series.product("n,n->n", series.slope(bounds.turning[:4]), eta)
    spin = series.product("n,n->n", series.exponential(2 * bounds.turning[:3]), lever)
    joints = motion.joints.rounding(on.joint_piece, 3) + ROUNDING * bounds.joints[:3] / unit[:3, None]
    factorial = np.array([1, 1, 2])[:, None]
    of_axes = [np.zeros(len(on.half)), *(way.rounding(on.centre, on.half) for way in ways)]
    swung = _of_sights(motion, joints[0])
    outward, inward = eta[0] + swung + np.max(of_axes, axis=0), _within(motion, swung + ROUNDING)
    return Errors(
        direction=np.concatenate([outward, inward]),
        spin=factorial * (spin + ROUNDING * bounds.spin[:3]) / (unit[:3] * on.half),
        joints=factorial[:, None] * joints,
        attitude=eta[0],
    )


def gather(
    motion: Motion,
    wanted: Errors,
    ways: Sequence[Way] = (),
    further: Callable[[Intervals, Majorants], np.ndarray] | None = None,
) -> Evidence:
    """Sample trajectories on intervals so short that the polynomials' errors are at most as large as wanted.

    Args:
        motion: of one trajectory or of several.
        wanted: the errors that may remain, with the last axis for the trajectories. Where one would take too
            many intervals, larger errors remain.
        ways: the axes that move, where there is a single trajectory; they must be known all the time.
        further: of intervals and the majorants there, how many times as large as wanted other errors are,
            (n,); None where there are none.
    """
    on = motion.pieces(ways)
    unsettled = np.ones(len(on.begins) - 1, dtype=bool)
    for left in reversed(range(_ROUNDS)):
        bounds = majorants(motion, on, ways)
        left_out = interpolation(on, bounds)
        # An error shrinks with the interval's power DEGREE + 1 at the least, so this rarely cuts too finely.
        excess = _excess(left_out, wanted, on)
        if wanted.attitude is not None:
            turned = 2.0 ** (1 - DEGREE) * bounds.attitude[DEGREE + 1]
            excess = np.maximum(excess, np.nan_to_num(turned / wanted.attitude[on.trajectory], nan=np.inf))
        if further is not None:
            excess = np.maximum(excess, further(on, bounds))
        parts = np.ceil(np.minimum(excess ** (1 / (DEGREE + 1)), _MOST_PARTS))
        before, after = np.diff(on.begins), np.add.reduceat(parts, on.begins[:-1])
        unsettled &= (after > before) & (after <= np.maximum(_MOST_INTERVALS, 2 * before))
        if left == 0 or not np.any(unsettled):
            break
        on = on.cut(np.where(unsettled[on.trajectory], parts, 1).astype(int))
    return Evidence(
        on=on,
        samples=motion.sample(on),
        majorants=bounds,
        left_out=left_out,
        rounding=rounding(motion, on, bounds, ways),
    )


def _excess(errors: Errors, wanted: Errors, on: Intervals) -> np.ndarray:
    """The worst ratio of an error to the one wanted on each interval, (n,), at least one."""
    ratios = (
        errors.direction / wanted.direction[:, on.trajectory],
        errors.spin / wanted.spin[:, on.trajectory],
        np.concatenate(errors.joints / wanted.joints[..., on.trajectory]),
    )
    return np.maximum(np.nan_to_num(np.concatenate(ratios), nan=np.inf).max(axis=0), 1)


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
        """One layout of those of several owners, each with a single quantity, numbered in this order."""
        owner = np.repeat(np.arange(len(layouts)), [len(layout.owner) for layout in layouts])
        return cls(
            opens_entry=np.concatenate([layout.opens_entry for layout in layouts]),
            opens_clause=np.concatenate([layout.opens_clause for layout in layouts]),
            quantity=owner,
            owner=owner,
        )

    @cached_property
    def clause(self) -> np.ndarray:
        """(kinds,) number of the clause that each kind belongs to."""
        return np.cumsum(self.opens_clause) - 1

    def fold(self, kind: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values of tasks from those of their rows: the best entry's worst row.

        Args:
            kind: (rows,) int, kinds of the rows, those of a task side by side.
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
        error: (rows,) bound of each polynomial's error.
        kind: (rows,) int, of each row.
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
        seen: (clauses,) least value that was evaluated, an upper bound.
        time: (clauses,) s, at which that is.
    """

    bound: np.ndarray
    seen: np.ndarray
    time: np.ndarray

    @classmethod
    def of(cls, clauses: int) -> Self:
        """Minima of `clauses` clauses, of which nothing is known yet: infinite."""
        return cls(bound=np.full(clauses, np.inf), seen=np.full(clauses, np.inf), time=np.zeros(clauses))

    def part(self, of: slice) -> Self:
        """The minima of a slice of the clauses, which share memory with these."""
        return type(self)(bound=self.bound[of], seen=self.seen[of], time=self.time[of])

    def meet(self, clause: np.ndarray, value: np.ndarray, time: np.ndarray) -> None:
        """Update `seen` and `time` in place with values (k,) of clauses, by number (k,), at times (k,) s."""
        np.minimum.at(self.seen, clause, value)
        least = value == self.seen[clause]
        self.time[clause[least]] = time[least]

    def wanted(self, layout: Layout, tolerance: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """For each clause the lower bound that suffices, see `minimise`; `tolerance` as there."""
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
    """Bernstein coefficients (K + 1, rows) from samples (rows, K + 1) at the nodes of `to_bernstein`."""
    values = np.ascontiguousarray(samples.T)
    if values.shape[1] == 1:  # of one row alone numpy takes the sum in another order
        return to_rows(np.repeat(samples, 2, axis=0))[:, :1]
    return np.einsum("kj,jr->kr", to_bernstein(len(values) - 1), values)


def _halved(coefficients: np.ndarray) -> np.ndarray:
    """Bernstein coefficients (K + 1, 2 rows) on all left half intervals and then on all right ones.

    By de Casteljau's algorithm, from those (K + 1, rows) on the whole intervals.
    """
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
    """Bound the least value of every clause over all its tasks, and update `minima` with it.

    The least clause of a quantity is bounded to within the tolerance, and so is every clause that falls
    below zero; of the others it is only proved that they are larger. Where the work for an owner exceeds a
    fixed budget, its bounds are less tight, but remain bounds.

    Args:
        rows: what is not settled yet.
        layout: how rows nest.
        minima: what is known already; changed in place.
        value: function of polynomials' values (..., rows), with which it rises, and of rows' kinds (rows,).
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
