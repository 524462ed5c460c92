"""The quadratic programs of one step, solved through their duals; rows that a step would break are added.

    minimise   dc^T H dc / 2 + g^T dc   [ + dT / T + duration_hessian (dT / T)^2 / 2 ]

over the free changes ``dc`` of all axes, subject to elastic rows. ``H`` is the same for every axis, so its
inverse is that of one small matrix, and the dual has one unknown a row (`dual`). Few of the rows are near: a
program begins with those, and is solved again with rows added that its answer breaks, of those that are true
of all steps only the worst ones at first, and without those that it leaves far behind.

The slopes of a row are a product of a row of the axes and one of the basis, or a sum of a few
(`RowJacobian`). So where each row is one product the dual's matrix ``G H^-1 G^T`` is that of the rows of the
basis times, number by number, that of the rows of the axes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from jaxplan.trajectory import options
from jaxplan.trajectory.box_qp import BoxQP, solve_box_qps
from jaxplan.trajectory.constraints import ConstraintBlock, Index, Step, lowest, numbers
from jaxplan.trajectory.iterates import taken

Multipliers = dict[str, np.ndarray]  # by block, of every row


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadraticProgram:
    """The quadratic programs at a stack of G curves.

    Attributes:
        free: (G, n, k) ``F``: free changes are ``F x``.
        by_time: (G, n, A) what the coefficients change by with the relative change of the duration.
        hessian: (G, n, n) ``H``.
        gradient: (G, n, A) ``g``.
        duration_hessian: of the duration's own term, whose slope is 1; None for a given duration.
        rows: (G, 4, S, n) of the basis at the places.
        blocks: all rows of the constraints at the curves.
        penalty: (G, 3) of broken rows, by kind.
    """

    free: np.ndarray
    by_time: np.ndarray
    hessian: np.ndarray
    gradient: np.ndarray
    duration_hessian: float | None
    rows: np.ndarray
    blocks: list[ConstraintBlock]
    penalty: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class QPSolution:
    """What the programs answer.

    Attributes:
        coefficients: (G, n, A) changes to make; not finite where a program broke down.
        stretch: (G,) relative changes of the duration.
        multipliers: by block, of every row (G, ...); zero where it does not bind.
    """

    coefficients: np.ndarray
    stretch: np.ndarray
    multipliers: Multipliers


def solve(quadratic: QuadraticProgram, multipliers: Multipliers) -> QPSolution:
    """Solve the programs at a stack of curves.

    Args:
        quadratic: the programs.
        multipliers: by block, of earlier programs; rows that bound there are in from the start.
    """
    count, blocks = len(quadratic.gradient), quadratic.blocks
    which = np.arange(count)
    free_t = np.swapaxes(quadratic.free, 1, 2)
    inverse = inverses(free_t @ quadratic.hessian @ quadratic.free)
    alone = -inverse @ (free_t @ quadratic.gradient)  # (G, k, A), the steps without rows
    coefficients, stretch = np.empty_like(quadratic.gradient), np.zeros(count)
    found = {block.name: np.zeros(block.slack.shape) for block in blocks}
    chosen = [block.chosen(block.slack < block.tolerance, block.slack, which) for block in blocks]
    for block, mask in zip(blocks, chosen, strict=True):
        if block.name in multipliers:  # in a group another entry may hold now
            mask |= (multipliers[block.name] > 0) & np.isfinite(block.slack)
            mask[~block.may_bind] = False
    for round_ in range(options.PROGRAM.rounds):
        rows = ActiveRows.of(blocks, chosen, which)
        changes, stretches, own_multipliers = solve_duals(quadratic, inverse, alone, rows)
        step = Step(which, changes, taken(quadratic.rows, which) @ changes[:, None], stretches)
        coefficients[which], stretch[which] = changes, stretches
        added = np.zeros(len(which), dtype=bool)
        for block, mask, (index, number) in zip(blocks, chosen, rows.blocks, strict=True):
            found[block.name][which] = 0.0
            found[block.name][index] = own_multipliers[number]
            looked = block.may_bind[which]
            if not np.any(looked):
                continue
            own = step.some(looked)
            slack = taken(block.slack, own.which) - block.change(own)
            if block.time:
                slack -= (block.time * own.stretch).reshape(-1, *[1] * (slack.ndim - 1))
            broken = (
                block.chosen(slack < -options.PROGRAM.broken * block.tolerance, slack, own.which)
                & ~mask[own.which]
            )
            if block.linear and round_ < options.PROGRAM.all_at_once:
                broken &= lowest(np.where(broken, slack, np.inf))
            mask[own.which] = (mask[own.which] & (slack < options.PROGRAM.kept * block.tolerance)) | broken
            added[looked] |= np.any(broken.reshape(len(own.which), -1), axis=1)
        which = which[added]
        if not len(which):
            break
    _drop_small(found, count)
    return QPSolution(coefficients=coefficients, stretch=stretch, multipliers=found)


def decrease_bound(quadratic: QuadraticProgram, multipliers: Multipliers, which: np.ndarray) -> np.ndarray:
    """By how much programs of a given time can lower the objectives of curves that break nothing, at most.

    By weak duality, from any multipliers: those of the programs before tell next to exactly once steps are
    short.

    Args:
        quadratic: the programs at a stack of curves.
        multipliers: by block, of every row, none larger than its penalty.
        which: (g,) numbers of the curves that are asked about.

    Returns:
        (g,).
    """
    # In a group another entry may hold now; without its multiplier the bound remains one.
    blocks = quadratic.blocks
    pushing = [(multipliers[block.name] > 0) & np.isfinite(block.slack) for block in blocks]
    rows = ActiveRows.of(blocks, pushing, which)
    y = np.zeros(len(rows.slack))
    for block, (index, number) in zip(blocks, rows.blocks, strict=True):
        y[number] = multipliers[block.name][index]
    free = taken(quadratic.free, which)
    free_t = np.swapaxes(free, 1, 2)
    gradient = quadratic.gradient[which]
    left = free_t @ (gradient + transposed_product(rows, y, gradient.shape))
    inverse = inverses(free_t @ quadratic.hessian[which] @ free)
    by_slope = np.sum((left * (inverse @ left)).reshape(len(which), -1), axis=1) / 2
    by_slack = np.array([np.sum(part) for part in np.split(y * rows.slack, rows.ends[:-1])])
    return np.asarray(by_slope + by_slack)


def _drop_small(multipliers: Multipliers, count: int) -> None:
    """Take for zero what is beside the largest multiplier of each of so many programs."""
    largest = np.zeros(count)
    for own in multipliers.values():
        largest = np.maximum(largest, np.max(own.reshape(count, -1), axis=1, initial=0))
    for own in multipliers.values():
        own[~(own > options.PROGRAM.binding * largest.reshape(-1, *[1] * (own.ndim - 1)))] = 0.0


class ActiveRows(NamedTuple):
    """Rows of some curves of a stack, those of a curve together, R in all with T products.

    Attributes:
        which: (g,) numbers of the curves.
        ends: (g,) where the rows of each end.
        slack: (R,).
        time: (R,).
        kind: (R,) int.
        row: (T,) int, whose each product is, rising.
        axes: (T, A).
        basis: (T, n).
        blocks: for each block the index of its rows, and their numbers (r,) among all.
    """

    which: np.ndarray
    ends: np.ndarray
    slack: np.ndarray
    time: np.ndarray
    kind: np.ndarray
    row: np.ndarray
    axes: np.ndarray
    basis: np.ndarray
    blocks: list[tuple[Index, np.ndarray]]

    @classmethod
    def of(
        cls, blocks: Sequence[ConstraintBlock], chosen: Sequence[np.ndarray], which: np.ndarray
    ) -> "ActiveRows":
        """The rows of blocks that are chosen, bool like their slacks, for some curves."""
        if not blocks:
            none, nobody = np.zeros(0), np.zeros(0, int)
            empty = np.zeros((0, 0))
            return cls(which, np.zeros_like(which), none, none, nobody, nobody, empty, empty, [])
        indices: list[Index] = []
        for mask in chosen:
            curve, *rest = numbers(mask[which])
            indices.append((which[curve], *rest))
        slopes = [block.slopes(index) for block, index in zip(blocks, indices, strict=True)]
        counts = [len(index[0]) for index in indices]
        curve = np.concatenate([index[0] for index in indices])
        order = np.argsort(curve, kind="stable")
        number = np.empty_like(order)
        number[order] = np.arange(len(order))
        parts = np.split(number, np.cumsum(counts)[:-1])

        def gathered(values: Sequence[np.ndarray]) -> np.ndarray:
            return np.concatenate(values)[order]

        rows = [np.repeat(own, each.axes.shape[1]) for own, each in zip(parts, slopes, strict=True)]
        row = np.concatenate(rows)
        sort = np.argsort(row, kind="stable")
        wide = [each.axes.reshape(-1, each.axes.shape[2]) for each in slopes]
        long = [each.basis.reshape(-1, each.basis.shape[2]) for each in slopes]
        return cls(
            which=which,
            ends=np.searchsorted(curve[order], which, side="right"),
            slack=gathered([block.slack[index] for block, index in zip(blocks, indices, strict=True)]),
            time=gathered([np.full(n, block.time) for block, n in zip(blocks, counts, strict=True)]),
            kind=gathered([np.full(n, block.kind) for block, n in zip(blocks, counts, strict=True)]),
            row=row[sort],
            axes=np.concatenate(wide)[sort],
            basis=np.concatenate(long)[sort],
            blocks=list(zip(indices, parts, strict=True)),
        )


class DualProgram(NamedTuple):
    """The dual of one program.

    Attributes:
        program: of the rows that are kept.
        kept: (r,) which of its rows.
        axes: (t, A) of their products.
        basis: (t, k) likewise, of the free coefficients.
        of: (t,) int, whose of the rows that are kept each product is.
        time: (r,).
    """

    program: BoxQP
    kept: np.ndarray
    axes: np.ndarray
    basis: np.ndarray
    of: np.ndarray
    time: np.ndarray


def solve_duals(
    quadratic: QuadraticProgram,
    inverse: np.ndarray,
    alone: np.ndarray,
    rows: ActiveRows,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The best steps under some rows.

    Args:
        quadratic: the programs of a stack.
        inverse: (G, k, k) of the Hessians in the free coefficients.
        alone: (G, k, A) the steps without rows.
        rows: of some of the curves.

    Returns:
        Changes of the coefficients (g, n, A), relative changes of the durations (g,), and multipliers (R,).
    """
    begins = np.append(0, rows.ends[:-1])
    firsts = np.searchsorted(rows.row, begins)
    lasts = np.searchsorted(rows.row, rows.ends)
    spans = list(zip(begins.tolist(), rows.ends.tolist(), firsts.tolist(), lasts.tolist(), strict=True))
    duals = [
        _dual(quadratic, curve, inverse[curve], alone[curve], rows, span)
        for curve, span in zip(rows.which.tolist(), spans, strict=True)
    ]
    answers = solve_box_qps([dual.program for dual in duals])
    multipliers = np.zeros(len(rows.slack))
    changes = np.empty((len(duals), *quadratic.gradient.shape[1:]))
    stretches = np.zeros(len(duals))
    for own, (curve, span, dual, answer) in enumerate(
        zip(rows.which.tolist(), spans, duals, answers, strict=True)
    ):
        y = answer.multipliers
        pull = dual.basis.T @ (y[dual.of, None] * dual.axes)
        changes[own] = quadratic.free[curve] @ (alone[curve] - inverse[curve] @ pull)
        if quadratic.duration_hessian is not None:
            stretches[own] = max(
                float(-(1 + dual.time @ y) / quadratic.duration_hessian), options.PROGRAM.shortest_step
            )
            changes[own] += stretches[own] * quadratic.by_time[curve]
        multipliers[span[0] + dual.kept] = y
    return changes, stretches, multipliers


def transposed_product(rows: ActiveRows, multipliers: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """``J^T y``: gradient of rows with multipliers (R,) in the coefficients, of the shape (g, n, A)."""
    found = np.zeros(shape)
    if len(multipliers):
        pull = multipliers[rows.row, None] * rows.axes
        ends = np.searchsorted(rows.row, rows.ends)
        for own, (first, last) in enumerate(pairwise([0, *ends.tolist()])):
            found[own] = rows.basis[first:last].T @ pull[first:last]
    return found


def _dual(
    quadratic: QuadraticProgram,
    curve: int,
    inverse: np.ndarray,
    alone: np.ndarray,
    rows: ActiveRows,
    span: tuple[int, int, int, int],
) -> DualProgram:
    """The dual of one curve's program; rows and products are those within the span."""
    begin, end, first, last = span
    axes, basis = rows.axes[first:last], rows.basis[first:last]
    of, slack, time = rows.row[first:last] - begin, rows.slack[begin:end], rows.time[begin:end]
    limit = quadratic.penalty[curve][rows.kind[begin:end]]
    if end == begin:
        none = np.zeros((0, 0)), np.zeros((0, alone.shape[1])), np.zeros((0, len(alone)))
        return DualProgram(BoxQP(none[0], slack, limit), np.zeros(0, int), *none[1:], of, time)
    along = basis @ quadratic.free[curve]
    sloping = np.max(np.abs(axes), axis=1) * np.max(np.abs(along), axis=1) > options.PROGRAM.no_slope
    kept = np.arange(end - begin) if np.all(sloping) else np.unique(of[sloping])
    if len(kept) > options.PROGRAM.most_rows:  # those with the least slack
        kept = np.sort(kept[np.argsort(slack[kept], kind="stable")[: options.PROGRAM.most_rows]])
    if len(kept) < end - begin:
        stays = np.isin(of, kept)
        axes, basis, along = axes[stays], basis[stays], along[stays]
        of = np.searchsorted(kept, of[stays])
        slack, time, limit = slack[kept], time[kept], limit[kept]
    single = len(of) == len(kept)

    def summed(values: np.ndarray) -> np.ndarray:
        """Over the products of each row."""
        if single:
            return values
        by_row = np.flatnonzero(np.append(True, of[1:] != of[:-1]))
        return np.add.reduceat(values, by_row, axis=0)

    if quadratic.duration_hessian is not None:
        time = time + summed(np.sum((basis @ quadratic.by_time[curve]) * axes, axis=1))
    if single:
        matrix = (along @ inverse @ along.T) * (axes @ axes.T)
    else:  # of a row with four products it would take sixteen times as many numbers
        slopes = summed(axes[:, :, None] * along[:, None, :])
        matrix = np.tensordot(slopes @ inverse, slopes, axes=((1, 2), (1, 2)))
    linear = summed(np.sum((along @ alone) * axes, axis=1)) - slack
    if quadratic.duration_hessian is not None:
        matrix += np.outer(time, time) / quadratic.duration_hessian
        linear -= time / quadratic.duration_hessian
    return DualProgram(BoxQP(matrix, linear, limit), kept, axes, along, of, time)


def inverses(matrices: np.ndarray) -> np.ndarray:
    """Of square matrices (G, n, n); NaN where there is none."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:  # of one: the others have theirs
        if len(matrices) == 1:
            return np.full_like(matrices, np.nan)
        return np.concatenate([inverses(own[None]) for own in matrices])
