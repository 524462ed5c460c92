"""The jitted expansion: all children of a node with their slack, cost and heuristics, in one call.

What a device sees depends only on the attitude move and on its own terminal's two joints, each of which has
three options. So zones are looked at once for every (attitude move, option pair, device) and the children
read the result: nine entries a device instead of one a joint move. Edges are checked whole: each is cut
into intervals, and on each of these a bound of the boresight's curvature makes its ends speak for what
lies between. Slack is a difference of cosines, >= 0 where the wanted clearance is kept.
Letters of axes as in `jaxplan.search.motions`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial, reduce
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import dot
from jaxplan.model import constraints
from jaxplan.model.constraints import SIGHT, Constraints
from jaxplan.search.calls import Call, Kernel
from jaxplan.search.fields import look_up
from jaxplan.search.motions import (
    EDGE_INTERVALS,
    STRAIGHT_INTERVALS,
    Motions,
    Sight,
    motions,
    sight_between,
)
from jaxplan.search.problem import Scene

PLACE_COLUMNS = 7  # attitude relative to the start (4), rotation vector to the goal (3)
HEURISTICS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """What an expansion tries: every attitude move with every joint move.

    Attributes:
        turns: (A, 3) rotation vectors, body axes.
        options: (A or 1, 3, 2n) change of each joint under its three options, rad.
        choice: (M, 2n) int32, the option of each joint in each joint move.
        allowed: (A, M) bool, or None where nothing is ruled out beforehand.
    """

    turns: np.ndarray
    options: np.ndarray
    choice: np.ndarray
    allowed: np.ndarray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Expansion:
    """The children of a node: every attitude move (A) with every joint move (M).

    Attributes:
        places: (A, 7) where the attitude moves lead: unit quaternion relative to the start (4), rotation
            vector from there to the goal in body axes (3).
        slacks: (A, M) smallest slack on the way, +inf without zones.
        steps: (A, M) cost of the move, steps.
        heuristics: (4, A, M) steps of the straight motion on to the goal; equation (15): rotation
            angle, Euclidean and Manhattan distance, each with the joints', rad.
        fields: (2, A, M) sum and largest over the devices of what the distance fields say, rad.
        onward: (A, M) smallest slack on the straight motion from the child to the goal; None where it
            was not asked for.
    """

    places: np.ndarray
    slacks: np.ndarray
    steps: np.ndarray
    heuristics: np.ndarray
    fields: np.ndarray
    onward: np.ndarray | None


def _fold(combine: Callable[[Array, Array], Array], values: Array, axis: int, empty: float) -> Array:
    """Reduce a short axis by elementwise steps, which fuse; NaN is kept. `empty` is returned for none."""
    parts = [jax.lax.index_in_dim(values, i, axis, keepdims=False) for i in range(values.shape[axis])]
    if not parts:
        return jnp.full(values.shape[:axis] + values.shape[axis:][1:], empty)
    return reduce(combine, parts)


def _scores(cones: Constraints, zone_axes: ArrayLike, sight: Sight, edges: bool) -> Array:
    """Score of each sight, the worst on each interval, or at the end alone: (a, o, k or 1, d, z)."""
    axes, body = jnp.asarray(zone_axes), jnp.asarray(sight.body)
    dots = dot(axes[:, :, None, :, None, :], body[..., None])
    values = constraints.joint_values(cones, sight.joints) if cones.inner else None
    score = constraints.scores(cones, dots, values)
    if edges:
        score = constraints.edge_bound(score[:, :, :-1], score[:, :, 1:], sight.sag(cones)[:, :, None])
    else:
        score = score[:, :, -1:]
    return jnp.where(cones.bound.T, score, -jnp.inf)


def _child_slacks(
    scene: Scene, sight: Sight, choice: Array, wanted: tuple[Array, Array], edges: bool
) -> Array:
    """Smallest slack of every child's motion, (a, m).

    Args:
        scene: the problem.
        sight: lines of sight along the motions.
        choice: (m, d) the option pair of each device's joints.
        wanted: (k, z) cosines asked for by the zones, and by those of groups; k is 1 for ends alone.
        edges: whether the whole motion counts.
    """
    devices = range(choice.shape[1])
    slacks = wanted[0][:, None] - _scores(scene.cones, sight.axes, sight, edges)
    worst = _fold(jnp.minimum, _fold(jnp.minimum, slacks, 2, jnp.inf), 3, jnp.inf)  # (a, o, d)
    total = jnp.full((worst.shape[0], choice.shape[0]), jnp.inf)
    for device in devices:
        total = jnp.minimum(total, worst[:, choice[:, device], device])
    if scene.grouped_cones.half_angle.shape[0]:
        coupled = _coupled_slacks(scene, sight, choice, wanted[1][:, None, None], edges)
        total = jnp.minimum(total, _fold(jnp.minimum, coupled, 0, jnp.inf))  # NaN is kept
    return total


def _coupled_slacks(scene: Scene, sight: Sight, choice: Array, wanted: Array, edges: bool) -> Array:
    """Smallest slack over the rows that couple devices at each instant, on each interval, (k, a, m).

    It goes from sample to sample, since tables of all children at all samples would be large, and a kernel
    with every interval written out takes a minute to compile.

    Args:
        scene: the problem.
        sight: lines of sight along the motions.
        choice: (m, d) the option pair of each sight's joints.
        wanted: (k, a or 1, 1, z) scores asked for; k is 1 for ends alone.
        edges: whether the whole motion counts, or its end alone.
    """
    rows = scene.grouped_cones
    devices = range(choice.shape[1])
    axes, body, joints = (jnp.asarray(part) for part in (sight.grouped_axes, sight.body, sight.joints))

    def chosen(values: Array) -> Array:
        """Of options (..., o, d) those of each child, (..., m, d)."""
        return jnp.stack([values[..., choice[:, device], device] for device in devices], axis=-1)

    def at(sample: ArrayLike) -> tuple[Array, Array | None]:
        """Scores of each sight (a, o, d, z), and of sights to each other (a or 1, m, d, z)."""
        seen = jnp.take(body, sample, axis=3)  # (3, a or 1, o, d)
        values = constraints.joint_values(rows, jnp.take(joints, sample, axis=2)) if rows.inner else None
        along = jnp.take(axes, sample, axis=2)[:, :, None, None]
        alone = constraints.scores(rows, dot(along, seen[..., None]), values)
        if not rows.inner:
            return alone, None
        both = chosen(seen)  # they depend on the joints of two devices
        return alone, constraints.scores(rows, dot(both[..., None], both[..., None, rows.partner]), 0.0)

    def slack(alone: Array, between: Array | None, asked: Array) -> Array:
        """Of the largest scores on an interval: (a, m)."""
        bound = jnp.where(rows.bound.T, alone, -jnp.inf)
        held = reduce(jnp.maximum, [bound[:, choice[:, device], device] for device in devices])
        if between is not None:
            worst = _fold(jnp.maximum, jnp.where(rows.bound.T, between, -jnp.inf), 2, -jnp.inf)
            held = jnp.where(rows.frame == SIGHT, worst, held)
        return jnp.asarray(constraints.worst_constraint(rows, asked - held))

    if not edges:
        return slack(*at(-1), wanted[0])[None]
    own_sag, sag = sight.sag(rows), jnp.zeros(())
    if rows.inner:  # two sights are seen alike from wherever the platform turns
        sag = constraints.score_curvature(rows, sag, chosen(sight.rate), chosen(sight.bend)) / 2

    def step(before: tuple[Array, Array | None], each: tuple[Array, Array]) -> tuple[Any, Array]:
        sample, asked = each
        now = at(sample)
        alone = constraints.edge_bound(before[0], now[0], own_sag)
        pairs = None
        if before[1] is not None and now[1] is not None:
            pairs = constraints.edge_bound(before[1], now[1], sag)
        return now, slack(alone, pairs, asked)

    intervals = axes.shape[2] - 1
    asked = jnp.broadcast_to(wanted, (intervals, *wanted.shape[1:]))
    return jax.lax.scan(step, at(0), (jnp.arange(1, intervals + 1), asked))[1]


def _field_values(scene: Scene, made: Motions, fields: Array, choice: Array) -> list[Array]:
    """Sum and largest over the devices of the distance fields at every child, (a, m) each."""
    attitude = jnp.asarray(scene.start_attitude) @ quaternion.to_matrix(made.places[:, :4])  # (a, 3, 3)
    body = made.moved.body[:, :, :, -1]  # (3, a or 1, o, d)
    rows = [dot(attitude[:, i, :].T[:, :, None, None], body) for i in range(3)]
    to_go = look_up(fields, jnp.stack(rows))  # (a, o, d)
    seen = [to_go[:, choice[:, device], device] for device in range(choice.shape[1])]
    nothing = jnp.zeros((to_go.shape[0], choice.shape[0]))
    return [reduce(jnp.add, seen, nothing), reduce(jnp.maximum, seen, nothing)]


def _rows(wanted: tuple[Array, Array], rows: slice) -> tuple[Array, Array]:
    return wanted[0][rows], wanted[1][rows]


def _expand(
    scene: Scene,
    node: Array,
    turns: Array,
    options: Array,
    choice: Array,
    clearance: Array,
    fields: Array,
    gate: Array,
    *,
    edges: bool,
) -> Array:
    """The children of a node as one array, see `expansion`."""
    made = motions(scene, node, turns, options, choice, clearance, gate, onward=edges)
    terminals = scene.mounts.shape[0]
    pairs = 3 * choice[:, :terminals] + choice[:, terminals:]
    sights = scene.sights
    still = jnp.zeros((choice.shape[0], sights.fixed.shape[0]), pairs.dtype)
    device_choice = jnp.concatenate([pairs, still, pairs[:, sights.carrier]], axis=-1)
    moving, onward = slice(0 if edges else EDGE_INTERVALS - 1, EDGE_INTERVALS), slice(EDGE_INTERVALS, None)
    turn_steps, angle, euclidean, manhattan = made.reach[:, :, None]
    joint_steps, steps_left, manhattan_left, euclidean_left = made.ways
    numbers = [
        _child_slacks(scene, made.moved, device_choice, _rows(made.wanted, moving), edges),
        jnp.maximum(turn_steps, joint_steps),
        jnp.maximum(angle / scene.attitude_step, steps_left),
        angle + manhattan_left,  # the three of (15)
        euclidean + euclidean_left,
        manhattan + manhattan_left,
    ]
    numbers += _field_values(scene, made, fields, device_choice)
    if made.onward is not None:
        asked = _rows(made.wanted, onward)
        numbers.append(_child_slacks(scene, made.onward, device_choice, asked, edges))
    return jnp.concatenate([jnp.ravel(made.places), *(number.ravel() for number in numbers)])


_EXPANSIONS = {edges: Kernel(partial(_expand, edges=edges)) for edges in (False, True)}


def expansion_call(
    node: np.ndarray, moves: Moves, clearance: np.ndarray, fields: np.ndarray, *, edges: bool
) -> Call:
    """The call for all children of a node, and whether the straight motion from each to the goal is clear.

    Args:
        node: (7 + 2n,) unit quaternion relative to the start (4), rotation vector to the goal in body
            axes (3), joints.
        moves: what is tried.
        clearance: (EDGE_INTERVALS + ONWARD_INTERVALS,) rad wanted on the intervals of the moves, and onward.
        fields: (D, SIZE, SIZE) of `jaxplan.search.fields`; zeros where there are none.
        edges: whether zones hold over the whole edge, and the motion onward counts; or at nodes alone.
    """
    return Call(_EXPANSIONS[edges], (node, moves.turns, moves.options, moves.choice, clearance, fields))


def expansion(answer: np.ndarray, moves: Moves, *, edges: bool) -> Expansion:
    """The children that the answer to an `expansion_call` of these moves tells of."""
    first = len(moves.turns) * PLACE_COLUMNS
    numbers = answer[first:].reshape(-1, len(moves.turns), len(moves.choice))
    last = 2 + HEURISTICS
    return Expansion(
        answer[:first].reshape(-1, PLACE_COLUMNS),
        numbers[0],
        numbers[1],
        numbers[2:last],
        numbers[last : last + 2],
        numbers[-1] if edges else None,
    )


def interval_slacks(scene: Scene, sight: Sight, clearance: Array) -> Array:
    """Smallest slack on each interval of straight motions, (a, k).

    Args:
        scene: the problem.
        sight: of `motions.sight_between`.
        clearance: (a or 1, k or 1) rad wanted.
    """
    wanted = constraints.thresholds(scene.cones, clearance)  # (a or 1, k or 1, z)
    cosines = _scores(scene.cones, sight.axes, sight, edges=True)[:, 0]  # (a, k, d, z)
    total = _fold(jnp.minimum, wanted - _fold(jnp.maximum, cosines, 2, -jnp.inf), 2, jnp.inf)
    if scene.grouped_cones.half_angle.shape[0]:
        asked = constraints.thresholds(scene.grouped_cones, clearance)
        alone = jnp.zeros((1, sight.body.shape[-1]), int)  # there is one option
        coupled = _coupled_slacks(scene, sight, alone, jnp.moveaxis(asked, 1, 0)[:, :, None], True)
        total = jnp.minimum(total, coupled[:, :, 0].T)
    return total


@Kernel
def _straight_slacks(scene: Scene, node: Array, clearance: Array, gate: Array) -> Array:
    since, turn, joints = node[None, :4], node[None, 4:7], node[None, 7:]
    ends = jnp.asarray(scene.goal_joints)[None]
    sight = sight_between(scene, since, joints, turn, ends, STRAIGHT_INTERVALS, gate)
    return interval_slacks(scene, sight, clearance[None])[0]


def straight_call(node: np.ndarray, clearance: np.ndarray) -> Call:
    """The call for the smallest slack on each interval of the straight motion from a node to the goal.

    Args:
        node: (7 + 2n,) as for `expansion_call`.
        clearance: (STRAIGHT_INTERVALS,) rad wanted.

    Returns:
        Its answer is (STRAIGHT_INTERVALS,), +inf without zones.
    """
    return Call(_straight_slacks, (node, clearance))
