"""The quadratic programs of one step, solved through their duals; rows that a step would break are added.

    minimise   dc^T H dc / 2 + g^T dc   [ + dT / T + duration_hessian (dT / T)^2 / 2 ]

over the free changes ``dc`` of all axes, and in brackets over the change ``dT`` of a free duration ``T``,
subject to elastic rows (inequalities that may be broken at a linear penalty). ``H`` is the same for every
axis, so its inverse is that of one small matrix, and the dual has one unknown for each row
(`interior_point`). Few rows are near their bounds: a program begins with those, and is solved again, in
*rounds*, with the rows added that its solution breaks (at first, of rows that are exact, only the worst
ones), and without those to which it leaves much slack. A program that is only a step of a search may be
solved *roughly*, from the multipliers of the program before. Letters of sizes are those of `motion`; besides,
k counts the free coefficients of an axis, R the rows, P the products of a slope (`constraints`), and g some
of the G curves.

The matrix of the dual, ``G H^-1 G^T`` of the rows ``G``, is that of `gram`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jaxplan.trajectory.constraints import ConstraintBlock, Index, lowest, numbers
from jaxplan.trajectory.gram import gram_of, order_by_place, times
from jaxplan.trajectory.interior_point import ROUGHLY, BoxQP, solve_box_qps
from jaxplan.trajectory.motion import taken

_MAX_ROUNDS = 6  # most times that a program is solved, each time with the rows that were missed before
_WORST_ONLY_ROUNDS = 2  # rounds after which all broken rows are added, not only the worst ones
_DROP_SLACK_RATIO = 0.1  # of a row's tolerance; a row to which a step leaves more slack is taken out again
_MULTIPLIER_TOLERANCE = 1e-6  # of the largest multiplier of a program; smaller ones count as zero
_MAX_ROWS = 512  # most rows of a dual; no more can bind on the usual number of intervals
_MIN_STRETCH = -0.5  # of the duration, the largest decrease in one step, so that it stays positive
_MIN_SLOPE = 1e-9  # rows with smaller derivatives are left out, as no step changes them

Multipliers = dict[str, np.ndarray]  # by name of the block, one for each of its rows


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadraticProgram:
    """The quadratic programs at a stack of G curves.

    Attributes:
        free: (G, n, k) ``F``: the changes of n coefficients of an axis are ``F x`` with k free ``x``.
        by_time: (G, n, A) change of the coefficients of A axes with the relative change of the duration.
        hessian: (G, n, n) ``H`` of one axis.
        gradient: (G, n, A) ``g``.
        duration_hessian: (G,) second derivative in the relative change of the duration, in which the slope is
            1; None for a given duration.
        rows: (G, 4, S, n) values of the n splines, and of their three derivatives, at S places.
        blocks: all rows of the constraints at the curves.
        penalty: (G, 3) for each unit by which a row is broken, by kind of constraint.
        overlooked: (G,) fraction of a row's tolerance; a row that a step breaks by more is added.
        leeway: the same for each unit of the relative change of the duration; the larger of both counts.
        few_rounds: (count, share): programs that shorten the duration by more than `share` take at most
            `count` rounds; None for no such limit.
        roughly: (G,) bool, which programs are solved roughly; all of them then begin with the multipliers
            before. None if they begin anew and are solved precisely.
    """

    free: np.ndarray
    by_time: np.ndarray
    hessian: np.ndarray
    gradient: np.ndarray
    duration_hessian: np.ndarray | None
    rows: np.ndarray
    blocks: list[ConstraintBlock]
    penalty: np.ndarray
    overlooked: np.ndarray
    leeway: float = 0.0
    few_rounds: tuple[int, float] | None = None
    roughly: np.ndarray | None = None


class QPSolution(NamedTuple):
    """Solutions of the programs at a stack of G curves.

    Attributes:
        coefficients: (G, n, A) changes to make, n on each of A axes; not finite where a program broke down.
        stretch: (G,) relative changes of the duration.
        multipliers: by name of the block, of every row (G, ...); zero where it does not bind.
    """

    coefficients: np.ndarray
    stretch: np.ndarray
    multipliers: Multipliers


class ActiveRows(NamedTuple):
    """Some rows of some curves of a stack, R in all, block after block.

    Attributes:
        which: (g,) numbers of the curves.
        of_curve: for each of these curves the rising indices, among the R, of its rows.
        of_block: for each block the indices of its rows.
        slack: (R,) of each row.
        time: (R,) coefficient of the relative change of the duration.
        kind: (R,) int, kind of constraint.
        axes: (R, P, A), which with `basis` are the slopes, sums of P products; zero for missing products.
        basis: (R, P, n), see `axes`.
    """

    which: np.ndarray
    of_curve: list[np.ndarray]
    of_block: list[Index]
    slack: np.ndarray
    time: np.ndarray
    kind: np.ndarray
    axes: np.ndarray
    basis: np.ndarray


class _ReducedForms(NamedTuple):
    """The programs at a stack of G curves in the free coefficients, without any rows.

    Attributes:
        hessian: (G, k, k) in the k free coefficients of one axis.
        inverse: (G, k, k) its inverse.
        alone: (G, k, A) the steps of A axes that would be best without rows.
    """

    hessian: np.ndarray
    inverse: np.ndarray
    alone: np.ndarray


def solve(quadratic: QuadraticProgram, multipliers: Multipliers) -> QPSolution:
    """Solve the programs at a stack of curves.

    Args:
        quadratic: the programs.
        multipliers: of earlier programs, by name of the block; rows with a positive one take part from the
            start. Empty for none. They are not changed.
    """
    count, blocks = len(quadratic.gradient), quadratic.blocks
    which = np.arange(count)
    free_t = np.swapaxes(quadratic.free, 1, 2)
    hessian = free_t @ quadratic.hessian @ quadratic.free
    inverse = _scaled_inverses(hessian)
    forms = _ReducedForms(hessian, inverse, -inverse @ (free_t @ quadratic.gradient))
    coefficients, stretch = np.empty_like(quadratic.gradient), np.zeros(count)
    found = {block.name: np.zeros(block.slack.shape) for block in blocks}
    chosen = [block.chosen(block.slack < block.tolerance, block.slack, which) for block in blocks]
    for block, mask in zip(blocks, chosen, strict=True):
        if block.name in multipliers:  # slack is infinite where now another entry of a group holds
            mask |= (multipliers[block.name] > 0) & np.isfinite(block.slack)
            mask[~block.may_bind] = False
    for round_ in range(_MAX_ROUNDS):
        rows = active_rows(blocks, chosen, which)
        before = found if round_ else multipliers
        changes, stretches, y = _solve_duals(
            quadratic, forms, rows, _look_up_multipliers(rows, blocks, before)
        )
        coefficients[which], stretch[which] = changes, stretches
        curves = taken(quadratic.rows, which) @ changes[:, None]
        overlooked = np.maximum(quadratic.overlooked[which], quadratic.leeway * np.abs(stretches))
        added, end = np.zeros(len(which), dtype=bool), 0
        for block, mask, index in zip(blocks, chosen, rows.of_block, strict=True):
            begin, end = end, end + len(index[0])
            found[block.name][which] = 0.0
            found[block.name][index] = y[begin:end]
            looked = block.may_bind[which]
            if not np.any(looked):
                continue
            own = which[looked]
            change = block.change(own, taken(changes, looked), taken(curves, looked))
            slack = taken(block.slack, own) - change
            if block.power:
                slack += block.relief(own, stretches[looked])
            beyond = (-block.tolerance * overlooked[looked]).reshape(-1, *[1] * (slack.ndim - 1))
            broken = block.chosen(slack < beyond, slack, own) & ~mask[own]
            if block.linear and round_ < _WORST_ONLY_ROUNDS:
                broken &= lowest(np.where(broken, slack, np.inf))
            mask[own] = (mask[own] & (slack < _DROP_SLACK_RATIO * block.tolerance)) | broken
            added[looked] |= np.any(broken.reshape(len(own), -1), axis=1)
        if quadratic.few_rounds is not None and round_ + 1 >= quadratic.few_rounds[0]:
            added &= stretches >= -quadratic.few_rounds[1]
        which = which[added]
        if not len(which):
            break
    _zero_small_multipliers(found, count)
    return QPSolution(coefficients, stretch, found)


def decrease_bound(quadratic: QuadraticProgram, multipliers: Multipliers, which: np.ndarray) -> np.ndarray:
    """Upper bound on how far programs of a given duration lower the objective, at curves without violations.

    By weak duality it holds for any multipliers; those of the programs before make it nearly exact once steps
    are short.

    Args:
        quadratic: the programs at a stack of curves.
        multipliers: by name of the block, of every row, none larger than its penalty.
        which: (g,) numbers of the curves that are asked about.

    Returns:
        (g,) in the unit of the objective.
    """
    # Another entry of a group may hold now; without its multiplier the bound is still valid.
    blocks = quadratic.blocks
    pushing = [(multipliers[block.name] > 0) & np.isfinite(block.slack) for block in blocks]
    rows = active_rows(blocks, pushing, which)
    of_block = [multipliers[block.name][index] for block, index in zip(blocks, rows.of_block, strict=True)]
    y = np.concatenate([np.zeros(0), *of_block])
    free, gradient = taken(quadratic.free, which), quadratic.gradient[which]
    free_t = np.swapaxes(free, 1, 2)
    left = free_t @ (gradient + transposed_product(rows, y, gradient.shape))
    inverse = _scaled_inverses(free_t @ quadratic.hessian[which] @ free)
    by_slope = np.sum((left * (inverse @ left)).reshape(len(which), -1), axis=1) / 2
    by_slack = y * rows.slack
    return np.asarray(by_slope + [np.sum(by_slack[part]) for part in rows.of_curve])


def _look_up_multipliers(
    rows: "ActiveRows", blocks: Sequence[ConstraintBlock], multipliers: Multipliers
) -> np.ndarray:
    """Look up multipliers of rows in those of earlier programs; zero for blocks that had none.

    Returns:
        (R,) one for each row.
    """
    of_block = [
        multipliers[block.name][index] if block.name in multipliers else np.zeros(len(index[0]))
        for block, index in zip(blocks, rows.of_block, strict=True)
    ]
    return np.concatenate([np.zeros(0), *of_block])


def _zero_small_multipliers(multipliers: Multipliers, count: int) -> None:
    """Set to zero, in place, multipliers (count, ...) that are tiny beside the largest of their program."""
    largest = np.zeros(count)
    for own in multipliers.values():
        largest = np.maximum(largest, np.max(own.reshape(count, -1), axis=1, initial=0))
    for own in multipliers.values():
        own[~(own > _MULTIPLIER_TOLERANCE * largest.reshape(-1, *[1] * (own.ndim - 1)))] = 0.0


def active_rows(
    blocks: Sequence[ConstraintBlock], chosen: Sequence[np.ndarray], which: np.ndarray
) -> ActiveRows:
    """Collect the chosen rows of some curves.

    Args:
        blocks: of rows.
        chosen: for each block bool like its slack.
        which: (g,) numbers of the curves, rising.
    """
    of_block: list[Index] = []
    for mask in chosen:
        curve, *rest = numbers(taken(mask, which))
        of_block.append((which[curve], *rest))
    slopes = [block.slopes(index) for block, index in zip(blocks, of_block, strict=True)]
    counts = np.array([len(index[0]) for index in of_block], int)
    curve = np.concatenate([np.zeros(0, int), *(index[0] for index in of_block)])
    order = np.argsort(curve, kind="stable")
    ends = np.searchsorted(curve[order], which, side="right")
    slack = [block.slack[index] for block, index in zip(blocks, of_block, strict=True)]
    axes, basis = zip(*slopes, strict=True) if blocks else ((), ())
    return ActiveRows(
        which=which,
        of_curve=np.split(order, ends[:-1]),
        of_block=of_block,
        slack=np.concatenate([np.zeros(0), *slack]),
        time=np.concatenate(
            [np.zeros(0), *(block.time(index) for block, index in zip(blocks, of_block, strict=True))]
        ),
        kind=np.repeat(np.array([block.kind for block in blocks], int), counts),
        axes=_concatenate_slopes(axes),
        basis=_concatenate_slopes(basis),
    )


def _concatenate_slopes(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Concatenate arrays (r, P, w), of r rows by P products, along r; missing products become zeros."""
    parts = [part for part in parts if len(part)]
    most = max((part.shape[1] for part in parts), default=1)
    found = np.zeros((sum(map(len, parts)), most, parts[0].shape[2] if parts else 0))
    end = 0
    for part in parts:
        begin, end = end, end + len(part)
        found[begin:end, : part.shape[1]] = part
    return found


def transposed_product(rows: ActiveRows, multipliers: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Sum the rows' derivatives times their multipliers, for each curve.

    Args:
        rows: R rows of g curves.
        multipliers: (R,) of the rows.
        shape: (g, n, A) of the result: curves, spline coefficients, axes.
    """
    found = np.zeros(shape)
    for own, part in enumerate(rows.of_curve):
        if len(part):
            found[own] = _sum_weighted_slopes(multipliers[part], rows.axes[part], rows.basis[part])
    return found


def _sum_weighted_slopes(y: np.ndarray, axes: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Sum of the derivatives of some rows times ``y``, by n spline coefficients and A axes.

    Args:
        y: (r,) a factor for each row.
        axes: (r, P, A) slopes of the rows, with P products.
        basis: (r, P, n) likewise.

    Returns:
        (n, A).
    """
    pull = y[:, None, None] * axes
    return np.asarray(basis.reshape(-1, basis.shape[2]).T @ pull.reshape(-1, axes.shape[2]))


def _solve_duals(
    quadratic: QuadraticProgram,
    forms: _ReducedForms,
    rows: ActiveRows,
    guess: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute the best steps under some rows.

    Args:
        quadratic: the programs of a stack.
        forms: of these programs.
        rows: of some of the curves.
        guess: (R,) multipliers near the solution.

    Returns:
        Changes of the coefficients (g, n, A), relative changes of the durations (g,), and multipliers (R,).
    """
    duals = [_make_dual(quadratic, forms, rows, guess, own) for own in range(len(rows.which))]
    answers = solve_box_qps([dual[0] for dual in duals])
    multipliers = np.zeros(len(rows.slack))
    changes = np.empty((len(duals), *quadratic.gradient.shape[1:]))
    stretches = np.zeros(len(duals))
    for own, (curve, (_, kept, axes, along, time), answer) in enumerate(
        zip(rows.which.tolist(), duals, answers, strict=True)
    ):
        y = multipliers[kept] = answer.multipliers
        changes[own] = quadratic.free[curve] @ (
            forms.alone[curve] - forms.inverse[curve] @ _sum_weighted_slopes(y, axes, along)
        )
        if quadratic.duration_hessian is not None:
            stretch = float(-(1 + time @ y) / quadratic.duration_hessian[curve])
            stretches[own] = max(stretch, _MIN_STRETCH)
            changes[own] += stretches[own] * quadratic.by_time[curve]
    return changes, stretches, multipliers


def _make_dual(
    quadratic: QuadraticProgram,
    forms: _ReducedForms,
    rows: ActiveRows,
    guess: np.ndarray,
    own: int,
) -> tuple[BoxQP, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Make the dual of the program of one curve, that of index `own` in `rows`.

    Other arguments are those of `_solve_duals`. Rows without slopes are left out, as are those with the most
    slack beyond `_MAX_ROWS`.

    Returns:
        The dual, the numbers (r,) of the rows that it has, their slopes in the free coefficients, (r, P, A)
        and (r, P, k), and the coefficients (r,) of the relative change of the duration.
    """
    curve, kept = int(rows.which[own]), rows.of_curve[own]
    if not len(kept):
        axes, along = (np.zeros((0, 1, forms.alone.shape[dimension])) for dimension in (2, 1))
        return BoxQP(np.zeros((0, 0)), rows.slack[kept], rows.slack[kept]), kept, axes, along, rows.time[kept]
    axes, basis = rows.axes[kept], rows.basis[kept]
    if axes.shape[1] > 1 and not np.any(axes[:, 1:]):
        axes, basis = axes[:, :1], basis[:, :1]
    along = times(basis, quadratic.free[curve])
    steep = np.einsum("rpa,rpa->rp", axes, axes) * np.einsum("rpk,rpk->rp", along, along)
    stays = np.flatnonzero(np.any(steep > _MIN_SLOPE**2, axis=1))
    if len(stays) > _MAX_ROWS:  # keep those with the least slack
        order = np.argsort(rows.slack[kept[stays]], kind="stable")
        stays = np.sort(stays[order[:_MAX_ROWS]])
    if len(stays) < len(kept):
        kept, axes, basis, along = kept[stays], axes[stays], basis[stays], along[stays]
    count = 0
    if quadratic.roughly is not None:  # optima that are differentiated need the smallest multipliers, too
        order, count = order_by_place(axes, along)
    if count:
        kept, axes, basis, along = kept[order], axes[order], basis[order], along[order]
    slack, time, limit = rows.slack[kept], rows.time[kept], quadratic.penalty[curve][rows.kind[kept]]
    linear = np.sum(times(along, forms.alone[curve]) * axes, axis=(1, 2)) - slack
    bend = 1.0
    if quadratic.duration_hessian is not None:
        if np.any(quadratic.by_time[curve]):
            time = time + np.sum(times(basis, quadratic.by_time[curve]) * axes, axis=(1, 2))
        bend = float(quadratic.duration_hessian[curve])
        linear -= time / bend
    else:
        time = np.zeros_like(time)
    matrix = gram_of(axes, along, time, forms.hessian[curve], forms.inverse[curve], bend, count)
    dual = BoxQP(matrix, linear, limit)
    if quadratic.roughly is not None:
        dual = dual._replace(guess=guess[kept])
        if quadratic.roughly[curve]:
            dual = dual._replace(tolerance=ROUGHLY)
    return dual, kept, axes, along, time


def _scaled_inverses(matrices: np.ndarray) -> np.ndarray:
    """Inverses of G positive definite matrices (G, n, n), scaled to unit diagonals on the way.

    The scaling keeps splines on unequal intervals from costing digits.
    """
    size = np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))
    outer = size[:, :, None] * size[:, None, :]
    return np.asarray(inverses(matrices / outer) / outer)


def inverses(matrices: np.ndarray) -> np.ndarray:
    """Inverses of G square matrices (G, n, n); NaN for those that are singular."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:  # one of them is singular; the others have an inverse
        if len(matrices) == 1:
            return np.full_like(matrices, np.nan)
        return np.concatenate([inverses(own[None]) for own in matrices])
