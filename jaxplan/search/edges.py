"""The edge check: whether straight motions keep clear of all constraints over their whole length.

A motion is cut into intervals. The scores of `jaxplan.model.constraints` are taken at the ends of each
interval, and a bound of their second derivative covers what lies between. A *slack* is what a score has left
to the threshold at which the wanted clearance is just kept: zero or more where it is kept, in about the unit
of a difference of cosines. Searches ask for slacks, smoothing for margins in rad.

What turns with the platform and what moves with the joints are tabulated apart (`LinesOfSight`): the axes of
the rows in body coordinates along the turn, and the sights in body coordinates under each option of the
joints. So an expansion, which combines many turns with many joint moves, evaluates each of them once.

Letters of axes: a motions (of an expansion attitude moves); o options, which are changes of the joints of a
device; k intervals, with k + 1 samples at their ends; d sights; z rows. Components of vectors come first and
small products are written out, so that loops run over the batch. Attitudes are unit quaternions relative to
the start; a state is a row of ``4 + 2n`` numbers, attitude and joints, where 2n stands for the number of all
joints, drives counted too. The two *tables* of rows are those of `Scene.tables`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import jax
import jax.numpy as jnp
from jax import Array

from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import cross, dot
from jaxplan.model.constraints import INERTIAL, SIGHT, Constraints, joint_values, worst_constraint
from jaxplan.model.scores import edge_bound, margins_of_scores, room, score_curvature, scores, thresholds
from jaxplan.runtime.jit import materialise
from jaxplan.search.scene import Scene

Tables = tuple[Array, Array]
"""An array for each of `Scene.tables`."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class LinesOfSight:
    """Sights and axes of rows, sampled along motions, and how fast they turn.

    There are ``a`` motions of ``k`` intervals (``k + 1`` samples), ``o`` options of the joints, ``d`` sights
    and ``z`` rows.

    Attributes:
        axes: for each table (3, a, k + 1, z), axes of its rows in body coordinates; meaningless where a sight
            is the axis.
        body: (3, a or 1, o, k + 1, d) sights in body coordinates.
        joints: (a or 1, o, k + 1, 2n) rad.
        turn: (a,) rad, angle by which the platform turns on each interval.
        rate: (a or 1, o, d) first bound of `Sights.bounds` for the joints' change on an interval.
        bend: (a or 1, o, d) second bound of `Sights.bounds`.
    """

    axes: Tables
    body: Array
    joints: Array
    turn: Array
    rate: Array
    bend: Array

    def chord_error(self, rows: Constraints) -> Array:
        """Return the bound ``C h^2 / 2`` of `edge_bound`, which holds for each interval: (a, o, d, z or 1).

        The axes are ``a`` motions, ``o`` options, ``d`` sights and ``z`` rows.
        """
        half: Array = score_curvature(rows, self.turn[:, None], self.rate, self.bend) / 2
        return half


def fold(combine: Callable[[Array, Array], Array], values: Array, axis: int, empty: float) -> Array:
    """Reduce a short axis of `values` by an elementwise function, which XLA fuses and which keeps NaN.

    Where the axis has length 0 the result is filled with `empty`.
    """
    parts = [jax.lax.index_in_dim(values, i, axis, keepdims=False) for i in range(values.shape[axis])]
    if not parts:
        return jnp.full(values.shape[:axis] + values.shape[axis:][1:], empty)
    return reduce(combine, parts)


def axes_at(scene: Scene, attitudes: Array) -> Tables:
    """Return the axes of each table's rows in body axes, as if all were inertial: (3, a, z) for each table.

    `attitudes` (a, 4) are unit quaternions relative to the start, ``a`` of them; there are ``z`` rows.
    """
    rotation = jnp.moveaxis(quaternion.to_matrix(attitudes), 0, -1)[..., None]

    def of_table(rows: Constraints) -> Array:
        at_start = dot(jnp.asarray(scene.start_attitude)[:, :, None], jnp.asarray(rows.axis).T[:, None])
        found: Array = dot(rotation, at_start[:, None, None])
        return found

    return of_table(scene.cones), of_table(scene.grouped_cones)


def lines_of_sight(
    scene: Scene, axes: Tables, joints: Array, turns: Array, changes: Array, intervals: int
) -> tuple[LinesOfSight, Array]:
    """Return lines of sight along motions, and the unit quaternions of the whole turns.

    Args:
        scene: the problem.
        axes: for each table (3, a or 1, z), axes of its ``z`` rows in body coordinates where the motions
            start.
        joints: (a or 1, o or 1, 2n) rad, where the ``a`` motions start.
        turns: (a, 3) rotation vectors of the platform, rad, body axes.
        changes: (a or 1, o, 2n) rad, changes of the joints under ``o`` options.
        intervals: number of intervals, of equal length; static.

    Returns:
        The lines of sight; the quaternions (4, a).
    """
    fraction = jnp.arange(intervals + 1) / intervals
    vectors = turns.T
    angle = jnp.sqrt(dot(vectors, vectors))
    axis = vectors / jnp.where(angle > 0, angle, 1)
    angles = jnp.concatenate([angle[:, None] * fraction, angle[:, None] / 2], axis=-1)
    cosines, sines = materialise(scene.attitude_step, (jnp.cos(angles), jnp.sin(angles)))

    def turned(rows: Constraints, start: Array) -> Array:
        """Return row axes in body axes along the turns, (3, a, k + 1, z), from (3, a, z) at their start."""
        across = jnp.stack(cross(axis[:, :, None], start))
        along = axis[:, :, None] * dot(axis[:, :, None], start)
        rest = start - along
        cosine, sine = cosines[:, :-1, None], sines[:, :-1, None]
        found = along[:, :, None] + rest[:, :, None] * cosine - across[:, :, None] * sine
        if not rows.inner:
            return found
        return jnp.where(rows.frame == INERTIAL, found, jnp.asarray(rows.axis).T[:, None, None])

    path = joints[:, :, None, :] + fraction[:, None] * changes[:, :, None, :]
    rate, bend = scene.sights.bounds(changes / intervals)
    lines = LinesOfSight(
        axes=(turned(scene.cones, axes[0]), turned(scene.grouped_cones, axes[1])),
        body=jnp.moveaxis(scene.sights.in_body(path), -1, 0),
        joints=path,
        turn=angle / intervals,
        rate=rate,
        bend=bend,
    )
    return lines, jnp.concatenate([cosines[None, :, -1], axis * sines[:, -1]])


def straight_lines(scene: Scene, first: Array, second: Array, intervals: int) -> LinesOfSight:
    """Return lines of sight along ``a`` straight motions, each cut into equal intervals.

    The platform turns along the shortest rotation, joints change linearly. The axis of options, motions of
    which one must be clear, has length one here.

    Args:
        scene: with the zones.
        first: (a, 4 + 2n) states at the starts: unit quaternions, scalar first, and joints, rad.
        second: (a, 4 + 2n) states at the ends.
        intervals: how many for each motion, static.
    """
    turns = turns_between(first, second)
    joints, change = first[:, None, 4:], (second - first)[:, None, 4:]
    lines, _ = lines_of_sight(scene, axes_at(scene, first[:, :4]), joints, turns, change, intervals)
    found: LinesOfSight = materialise(scene.attitude_step, lines)
    return found


def turns_between(first: Array, second: Array) -> Array:
    """Return the rotation vectors (a, 3) rad, in body axes, of motions between states (a, 4 + 2n)."""
    turn: Array = quaternion.log(quaternion.product(quaternion.conjugate(first[:, :4]), second[:, :4]))
    return turn


def interval_scores(scene: Scene, lines: LinesOfSight) -> Tables:
    """Return for each table the largest score of each row over its sights on each interval.

    Args:
        scene: the problem.
        lines: lines of sight of motions with one option.

    Returns:
        (a, k, z) for each table: ``a`` motions, ``k`` intervals, ``z`` rows.
    """
    body, joints = lines.body[:, :, 0], lines.joints[:, 0]

    def of_table(rows: Constraints, axes: Array) -> Array:
        if rows.inner:
            axes = jnp.where(rows.frame == SIGHT, body[..., rows.partner], axes)
        values = joint_values(rows, scene.gimbals, joints) if rows.inner else None
        score = scores(rows, dot(axes[:, :, :, None], body[..., None]), values)  # (a, k + 1, d, z)
        over = edge_bound(score[:, :-1], score[:, 1:], lines.chord_error(rows))
        return fold(jnp.maximum, jnp.where(rows.bound.T, over, -jnp.inf), 2, -jnp.inf)

    return of_table(scene.cones, lines.axes[0]), of_table(scene.grouped_cones, lines.axes[1])


def interval_slacks(scene: Scene, lines: LinesOfSight, clearance: Array) -> Array:
    """Return the smallest slack on each interval of motions with one option; +inf without constraints.

    Args:
        scene: the problem.
        lines: lines of sight, see `straight_lines`, of ``a`` motions with ``k`` intervals.
        clearance: (a or 1, k or 1) rad wanted.

    Returns:
        (a, k).
    """
    slacks, coupled = (
        thresholds(rows, clearance) - score
        for rows, score in zip(scene.tables, interval_scores(scene, lines), strict=True)
    )
    least = fold(jnp.minimum, slacks, 2, jnp.inf)
    return jnp.minimum(least, worst_constraint(scene.grouped_cones, coupled))


def motion_margins(scene: Scene, lines: LinesOfSight, wanted: Array) -> tuple[Array, Array]:
    """Return lower bounds of the smallest margin over whole motions with one option.

    Args:
        scene: the problem.
        lines: lines of sight, see `straight_lines`.
        wanted: (a,) rad of clearance for each of ``a`` motions; of a row no more is wanted than its `room`.

    Returns:
        (a,) smallest margin, and (a,) smallest margin less the clearance wanted, rad, both positive where
        kept; +inf without constraints, -inf where a score is NaN.
    """
    least = [jnp.full_like(wanted, jnp.inf)] * 2
    for rows, score in zip(scene.tables, interval_scores(scene, lines), strict=True):
        if not rows.bound.size:
            continue
        lost = jnp.any(jnp.isnan(score.reshape(len(wanted), -1)), axis=1)  # which `jnp.max` may drop
        if rows is scene.cones:  # the worst interval counts: one arc cosine for all
            score = jnp.max(score, axis=1, keepdims=True)
        margins = jnp.where(jnp.isneginf(score), jnp.inf, margins_of_scores(rows, score))
        both = [margins, margins - jnp.minimum(wanted[:, None, None], room(rows))]
        if rows is scene.cones:
            new = [jnp.min(part, axis=(1, 2)) for part in both]
        else:
            new = [jnp.min(worst_constraint(rows, part), axis=1) for part in both]
        new = [jnp.where(lost, -jnp.inf, part) for part in new]
        least = [jnp.minimum(first, second) for first, second in zip(least, new, strict=True)]
    return least[0], least[1]
