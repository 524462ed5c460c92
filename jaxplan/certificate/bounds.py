"""Error bounds of interpolating polynomials, and proved lower bounds of the minima of many polynomials.

**Interpolation.** `gather` samples trajectories on intervals so short that the polynomials through the
samples are off by next to nothing. The polynomial of degree K through samples of f at `motion.NODES` of an
interval of half width h is off by at most ``2^(1 - K) h^(K + 1) max |f^(K+1)| / (K + 1)!``. The derivatives
are bounded by majorants, which `series` defines. Let ``g`` be a majorant of the rotation vector ``eta`` of
`motion`, less its constant term. Then ``exp(g)`` is one of ``exp(eta^)``, since in the expansion about the
constant each factor is a rotation, of norm one, or bounded by ``g``. So with ``m = g + |Omega| t``, ``Omega``
being the chart rate, ``exp(m)`` is a majorant of the attitude and ``exp(2 m) m'`` one of the angular velocity
``R^T R'``. In body axes, a majorant of a boresight, or of another vector of a terminal's moving part, is the
exponential of the sum of the majorants of its yaw and pitch; of a direction fixed in the body it is one. For
inertial axes ``m`` is added to the exponent. What is interpolated is the scalar product of a sight and an
axis. Where both move, its majorant is the product of theirs: the exponents of two sights add up, and that of
a moving inertial axis is given in `motion`.

**Rounding.** Legendre sums err by a few units in the last place of their terms, and so do other steps. What
an error of ``eta`` does to the results follows to first order from the same majorants.

**Minima.** `minimise` bounds many polynomials from below by subdivision in the Bernstein basis. On its
interval a polynomial is nowhere less than the least of its Bernstein coefficients, of which the first and
last are its values at the ends. Halving the interval brings the two together quadratically. So for all rows
at once: bound them, drop what is settled (needs no closer bound), and halve the rest. A *row* (last axis) is
one polynomial on one interval, and rows are nested. An *entry* holds where all of its rows do, so its value
is that of its worst row; a *clause* holds where one of its entries does, so its value is that of its best
entry. The rows of one clause on one interval form a *task* and are halved together. The *kind* of a row is
its place in its clause, the same on every interval. Each clause belongs to a *quantity*, whose least value is
wanted, and to an *owner* (a trajectory), which has its own budget of work. Results for one owner do not
depend, to the last bit, on which others there are: the only sums are along each row by itself.
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

NEGLIGIBLE = 1e-11  # error that polynomials may make, of a limit or in rad: a hundredth of the allowances
LEBESGUE = 3.0  # largest factor by which interpolation enlarges the samples' errors, up to degree 12
_MOST_INTERVALS = 4000  # of a trajectory, or twice those before a round: beyond, no more are cut
_MOST_PARTS = 16  # into which an interval is cut in one round of `gather`
_MOST_CUTTING_ROUNDS = 12  # of cutting, at most
_MOST_HALVINGS = 40  # of an interval in `minimise`
_MOST_ROWS = 400_000  # of an owner in one round of `minimise`: beyond, its bounds stay as they are


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Bounds of errors on n intervals, or, for `gather`, errors that may remain, one for each trajectory.

    Attributes:
        direction: (S + k, n) errors of scalar products: of the S sights with inertial axes, which may move,
            then of the k pairs of directions compared in body axes (`motion.Views.within`).
        spin: (3, n) those of the angular velocity and its two derivatives, rad/s, rad/s^2, rad/s^3.
        joints: (3, J, n) those of the J joint angles and their two derivatives, rad, rad/s, rad/s^2.
        attitude: (n,) those of unit vectors turned by the attitude; None where that is not asked for.
    """

    direction: np.ndarray
    spin: np.ndarray
    joints: np.ndarray
    attitude: np.ndarray | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Majorants:
    """Majorants on n intervals: bounds of Taylor coefficients about any point, in the unit of half widths h.

    Attributes:
        turning: (orders, n) the majorant ``m`` of the module's description, rad; zero at order zero.
        direction: (orders, S + k, n) those of scalar products, in the order of `Errors.direction`.
        spin: (orders, n) that of h times the angular velocity, rad.
        joints: (orders, J, n) those of the joint angles, rad.
    """

    turning: np.ndarray
    direction: np.ndarray
    spin: np.ndarray
    joints: np.ndarray

    @cached_property
    def attitude(self) -> np.ndarray:
        """(orders, n) majorant ``exp(m)`` of the attitude, dimensionless."""
        return series.exponential(self.turning)


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Samples of trajectories with everything that is needed to bound the motion between them.

    Attributes:
        on: the intervals; those of each trajectory cover all of its duration, in order of time.
        samples: the motion at `motion.NODES` of each interval.
        majorants: those of the motion on the intervals.
        left_out: bounds of the errors of the polynomials through exact samples.
        rounding: sizes of the rounding errors of the samples.
    """

    on: Intervals
    samples: Samples
    majorants: Majorants
    left_out: Errors
    rounding: Errors


def _sum_joints_by_sight(motion: Motion, joints: np.ndarray) -> np.ndarray:
    """Sum yaw and pitch values (..., J, n) for each sight: (..., S, n), zero for sights fixed in the body."""
    yaw, pitch = (np.moveaxis(part, 0, -2) for part in motion.mountings.split(np.moveaxis(joints, -2, 0)))
    still = np.zeros((*yaw.shape[:-2], len(motion.fixed), yaw.shape[-1]))
    both = yaw + pitch
    return np.concatenate([both, still, both[..., motion.views.carrier, :]], axis=-2)


def _sum_body_pairs(motion: Motion, of_sights: np.ndarray) -> np.ndarray:
    """Sum the values (..., S, n) of both directions of each pair compared in body axes: (..., k, n)."""
    sight, axis = motion.views.within.T
    return of_sights[..., sight, :] + np.where(axis[:, None] < 0, 0, of_sights[..., axis, :])


def majorants(motion: Motion, on: Intervals, ways: Sequence[Way] = ()) -> Majorants:
    """Bound the Taylor coefficients of everything that moves on some intervals.

    Args:
        motion: that of the trajectories.
        on: intervals, each within one piece of every way.
        ways: the moving inertial axes (`motion.Way`); none if empty.
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
    swinging = _sum_joints_by_sight(motion, moving)
    sweeping = np.concatenate([turning[:, None] + swinging, _sum_body_pairs(motion, swinging)], axis=1)
    sweeping[0] = 0
    direction = series.exponential(sweeping)
    if ways:
        swiftest = np.max([way.majorant(on.centre, on.half, orders) for way in ways], axis=0)
        outward = slice(swinging.shape[1])
        direction[:, outward] = series.product("dn,n->dn", direction[:, outward], swiftest)
    spinning = series.product("n,n->n", series.exponential(2 * turning), series.slope(turning))
    return Majorants(turning=turning, direction=direction, spin=spinning, joints=moving)


def interpolation(on: Intervals, bounds: Majorants) -> Errors:
    """Bound the errors of the polynomials through samples on intervals, given the majorants there."""
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
    """Estimate the rounding errors of samples, moving axes included; arguments as for `majorants`."""
    unit = on.half ** np.arange(4)[:, None]
    eta = np.linalg.norm(motion.platform.rounding(on.piece, 4), axis=1) * unit
    eta[0] += ROUNDING
    lever = series.slope(eta) + 2 * series.product("n,n->n", series.slope(bounds.turning[:4]), eta)
    spin = series.product("n,n->n", series.exponential(2 * bounds.turning[:3]), lever)
    joints = motion.joints.rounding(on.joint_piece, 3) + ROUNDING * bounds.joints[:3] / unit[:3, None]
    factorial = np.array([1, 1, 2])[:, None]
    of_axes = [np.zeros(len(on.half)), *(way.rounding(on.centre, on.half) for way in ways)]
    swung = _sum_joints_by_sight(motion, joints[0])
    outward, inward = eta[0] + swung + np.max(of_axes, axis=0), _sum_body_pairs(motion, swung + ROUNDING)
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
        motion: that of one trajectory or of several.
        wanted: the errors that may remain, one a trajectory on the last axis. Where that would take too many
            intervals, larger errors remain.
        ways: the moving inertial axes, known all the time; only for a single trajectory.
        further: function of intervals and their majorants that returns other errors over the wanted ones,
            (n,); None where there are none.
    """
    on = motion.pieces(ways)
    unsettled = np.ones(len(on.begins) - 1, dtype=bool)
    for left in reversed(range(_MOST_CUTTING_ROUNDS)):
        bounds = majorants(motion, on, ways)
        left_out = interpolation(on, bounds)
        # An error shrinks with the interval's power DEGREE + 1 at the least, so this rarely cuts too finely.
        excess = _largest_error_ratio(left_out, wanted, on)
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


def _largest_error_ratio(errors: Errors, wanted: Errors, on: Intervals) -> np.ndarray:
    """Return the largest ratio of an error to the wanted one on each interval, (n,), at least one."""
    ratios = (
        errors.direction / wanted.direction[:, on.trajectory],
        errors.spin / wanted.spin[:, on.trajectory],
        np.concatenate(errors.joints / wanted.joints[..., on.trajectory]),
    )
    return np.maximum(np.nan_to_num(np.concatenate(ratios), nan=np.inf).max(axis=0), 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Layout:
    """How rows nest in entries and clauses. Kinds are numbered clause by clause, in each entry by entry.

    Attributes:
        opens_entry: (kinds,) bool, whether the kind is the first of its entry.
        opens_clause: (kinds,) bool, whether it is the first of its clause.
        quantity: (clauses,) int, the quantity that each clause belongs to.
        owner: (clauses,) int, the owner (trajectory) that each clause belongs to.
    """

    opens_entry: np.ndarray
    opens_clause: np.ndarray
    quantity: np.ndarray
    owner: np.ndarray

    @classmethod
    def joined(cls, layouts: Sequence[Self]) -> Self:
        """Concatenate layouts of one quantity and one owner each; both are numbered in the order given."""
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
        """Reduce values of rows to those of their tasks: the largest over entries of the least over rows.

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
    """Polynomials on intervals; the rows of a task are side by side, in the order of their kinds.

    Attributes:
        coefficients: (K + 1, rows) coefficients in the Bernstein basis, degree K.
        error: (rows,) bound of each polynomial's error.
        kind: (rows,) int, kind of each row.
        low: (tasks,) s, start of each task's interval.
        high: (tasks,) s, its end.
    """

    coefficients: np.ndarray
    error: np.ndarray
    kind: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Minima:
    """What is known of the least value of each clause over all time.

    Attributes:
        bound: (clauses,) proved lower bound; infinite before any proof.
        seen: (clauses,) least value that was evaluated, an upper bound of the least one.
        time: (clauses,) s, at which `seen` was evaluated.
    """

    bound: np.ndarray
    seen: np.ndarray
    time: np.ndarray

    @classmethod
    def of(cls, clauses: int) -> Self:
        """Minima of `clauses` clauses, of which nothing is known yet: infinite."""
        return cls(bound=np.full(clauses, np.inf), seen=np.full(clauses, np.inf), time=np.zeros(clauses))

    def part(self, of: slice) -> Self:
        """Return the minima of a slice of the clauses; its arrays are views into these."""
        return type(self)(bound=self.bound[of], seen=self.seen[of], time=self.time[of])

    def meet(self, clause: np.ndarray, value: np.ndarray, time: np.ndarray) -> None:
        """Update `seen` and `time` in place with values (k,) of clauses, by number (k,), at times (k,) s."""
        np.minimum.at(self.seen, clause, value)
        least = value == self.seen[clause]
        self.time[clause[least]] = time[least]

    def wanted(self, layout: Layout, tolerance: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Return for each clause the lower bound that is close enough; `tolerance` as for `minimise`."""
        least = np.full(layout.quantity.max(initial=0) + 1, np.inf)
        np.minimum.at(least, layout.quantity, self.seen)
        enough = np.maximum(least - tolerance(least), 0)[layout.quantity]
        return np.minimum(self.seen - tolerance(self.seen), enough)


@lru_cache
def to_bernstein(degree: int) -> np.ndarray:
    """Return the matrix that maps values at extrema of the Chebyshev polynomial to Bernstein coefficients.

    Nodes rise from -1 to 1, coefficients go from the start of the interval to its end. The Chebyshev
    polynomials

        T_n(2 u - 1) = sum_j (-1)^(n - j) C(2 n, 2 j) u^j (1 - u)^(n - j)

    are raised to degree K by the factor ``(u + (1 - u))^(K - n)``, in exact integers.

    Args:
        degree: K.

    Returns:
        (K + 1, K + 1); its largest absolute row sum is `growth`.
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
    """Return the largest factor by which `to_bernstein` may enlarge an error; about 2^K, 733 for K = 10."""
    return float(np.abs(to_bernstein(degree)).sum(axis=1).max())


def to_rows(samples: np.ndarray) -> np.ndarray:
    """Turn samples (rows, K + 1) at `motion.NODES` into Bernstein coefficients (K + 1, rows)."""
    values = np.ascontiguousarray(samples.T)
    if values.shape[1] == 1:  # of one row alone numpy takes the sum in another order
        return to_rows(np.repeat(samples, 2, axis=0))[:, :1]
    return np.einsum("kj,jr->kr", to_bernstein(len(values) - 1), values)


def _halve_intervals(coefficients: np.ndarray) -> np.ndarray:
    """Halve intervals: Bernstein coefficients (K + 1, rows) to (K + 1, 2 rows), left halves first."""
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
    """Bound the least value of every clause over all of its tasks, and store the bounds in `minima`.

    The least clause of each quantity, and every clause that falls below zero, is bounded to within the
    tolerance; the others are only proved to be larger than the least. Where an owner takes more work than its
    fixed budget, its bounds stay wider but remain bounds.

    Args:
        rows: polynomials that are not settled yet.
        layout: how rows nest.
        minima: what is known already; changed in place.
        value: maps polynomials' values (..., rows), in which it must rise, and the rows' kinds (rows,) to the
            clauses' measure, (..., rows).
        tolerance: maps the least values met (clauses,) to how close bounds must come to them (clauses,).
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
        coefficients = _halve_intervals(coefficients[:, row])
        middle = (low + high)[~settled] / 2
        error, kind = np.tile(error[row], 2), np.tile(kind[row], 2)
        low, high = np.append(low[~settled], middle), np.append(middle, high[~settled])
    np.minimum.at(minima.bound, clause, lower)
