"""The jitted expansion: all children of a search node with their slack, cost and heuristics, in one call.

A child is one of ``A`` attitude moves combined with one of ``M`` joint moves. What a device sees depends only
on the attitude move and on its own one or two joints, each of which has three options. So zones are checked
once for every (attitude move, option pair, device) and the children read the result: nine entries a device
instead of one for each joint move. Attitude moves and joint moves are priced apart, too. Edges are checked
whole by `jaxplan.search.edges`, which defines the letters of axes (a, o, k, d, z); besides, m is a joint
move. The option pair of a device is 3 * yaw option + pitch option, that of a drive 3 * the option of its
angle. 2n stands for the number of all joints.
"""

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
from jaxplan.model.constraints import SIGHT
from jaxplan.model.scores import edge_bound, score_curvature, scores, thresholds
from jaxplan.runtime.jit import materialise
from jaxplan.search.edges import LinesOfSight, Tables, axes_at, fold, lines_of_sight
from jaxplan.search.fields import look_up
from jaxplan.search.kernel_calls import Call, Kernel
from jaxplan.search.scene import Scene

EDGE_INTERVALS = 8
ONWARD_INTERVALS = 16
PLACE_COLUMNS = 7  # attitude relative to the start (4), rotation vector to the goal (3)
HEURISTICS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """What an expansion tries: every one of A attitude moves with every one of M joint moves.

    Attributes:
        turns: (A, 3) rotation vectors of the attitude moves, rad, body axes.
        options: (A or 1, 3, 2n) change of each joint under its three options, rad.
        choice: (M, 2n) int32, the option of each joint in each joint move.
        allowed: (A, M) bool, combinations that may be used; None for all.
    """

    turns: np.ndarray
    options: np.ndarray
    choice: np.ndarray
    allowed: np.ndarray | None = None


def chosen(options: np.ndarray, choice: np.ndarray) -> np.ndarray:
    """Return changes of joints (..., 2n), rad, given the option chosen for each (..., 2n).

    `options` (3, 2n) holds the three options of each joint, rad.
    """
    return options[choice, np.arange(options.shape[-1])]


@dataclass(frozen=True, slots=True, eq=False)
class Expansion:
    """The children of a node: every one of A attitude moves with every one of M joint moves.

    Attributes:
        places: (A, 7) where the attitude moves lead: unit quaternion relative to the start (4), rotation
            vector from there to the goal in body axes, rad (3).
        slacks: (A, M) smallest slack (see `jaxplan.search.edges`) on the move, negative where it is not
            clear, +inf without zones.
        steps: (A, M) cost of the move, steps.
        heuristics: (4, A, M) the steps of the straight motion on to the goal; then, as in equation (15),
            rotation angle, Euclidean and Manhattan distance, each with the joints' added, rad.
        fields: (2, A, M) distances to go by the distance fields, rad: their sum over the devices and the
            largest.
        onward: (A, M) smallest slack on the straight motion from the child to the goal; None where it was not
            asked for.
    """

    places: np.ndarray
    slacks: np.ndarray
    steps: np.ndarray
    heuristics: np.ndarray
    fields: np.ndarray
    onward: np.ndarray | None


def expansion_call(
    node: np.ndarray, moves: Moves, clearance: np.ndarray, fields: np.ndarray, *, edges: bool
) -> Call:
    """Make the kernel call for all children of a node; `expansion` reads its answer.

    Args:
        node: (7 + 2n,) unit quaternion relative to the start (4), rotation vector to the goal in body axes,
            rad (3), joints, rad.
        moves: the moves to try.
        clearance: (EDGE_INTERVALS + ONWARD_INTERVALS,) rad wanted on the intervals of the moves, then on
            those of the motions onward to the goal.
        fields: (devices, SIZE, SIZE) distance fields of `jaxplan.search.fields`; zeros where there are none.
        edges: True to check zones over the whole edge, and over the straight motion from each child to the
            goal too; False to check them at the children alone.
    """
    return Call(
        _EXPANSION_KERNELS[edges], (node, moves.turns, moves.options, moves.choice, clearance, fields)
    )


def expansion(answer: np.ndarray, moves: Moves, *, edges: bool) -> Expansion:
    """Unpack the children of a node from the answer to its `expansion_call` with these moves and edges."""
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


def _expand(
    scene: Scene,
    node: Array,
    turns: Array,
    options: Array,
    choice: Array,
    clearance: Array,
    fields: Array,
    *,
    edges: bool,
) -> Array:
    """Compute the children of a node as one flat array, which `expansion` unpacks.

    The arguments are those of `expansion_call`, with the moves as arrays.
    """
    gimbals = scene.gimbals
    terminals = gimbals.terminals
    since, joints = node[:4], node[None, None, 7:]
    yaw = jnp.repeat(options, 3, axis=1)
    pitch = jnp.tile(options, (1, 3, 1))
    is_pitch = np.isin(np.arange(gimbals.joint_count), gimbals.pitches)
    pairs = jnp.where(is_pitch, pitch, yaw)  # (a or 1, o, J)
    moved, whole_turns = lines_of_sight(
        scene, axes_at(scene, since[None]), joints, turns, pairs, EDGE_INTERVALS
    )
    places, attitude_costs = _evaluate_attitude_moves(scene, since, whole_turns, turns)
    onward = None
    if edges:
        axes, ends = (moved.axes[0][:, :, -1], moved.axes[1][:, :, -1]), joints + pairs
        left = jnp.asarray(scene.goal_joints) - ends
        onward, _ = lines_of_sight(scene, axes, ends, places[:, 4:], left, ONWARD_INTERVALS)
    joint_costs = _joint_move_costs(scene, joints, jnp.take_along_axis(options, choice[None], axis=1))
    wanted = tuple(thresholds(rows, clearance) for rows in scene.tables)  # (k, z) each
    moved, onward, places, attitude_costs, joint_costs, wanted = materialise(
        scene.attitude_step, (moved, onward, places, attitude_costs, joint_costs, wanted)
    )

    option = 3 * choice[:, gimbals.yaws]
    option = option.at[:, :terminals].add(choice[:, gimbals.pitches])
    still = jnp.zeros((choice.shape[0], scene.sights.fixed.shape[0]), option.dtype)
    of_sights = jnp.concatenate([option, still, option[:, scene.sights.carrier]], axis=-1)  # (m, d)
    first = 0 if edges else EDGE_INTERVALS - 1
    asked = (wanted[0][first:EDGE_INTERVALS], wanted[1][first:EDGE_INTERVALS])
    turn_steps, angle, euclidean, manhattan = attitude_costs[:, :, None]
    joint_steps, steps_left, manhattan_left, euclidean_left = joint_costs
    numbers = [
        _child_slacks(scene, moved, of_sights, asked, edges),
        jnp.maximum(turn_steps, joint_steps),
        jnp.maximum(angle / scene.attitude_step, steps_left),
        angle + manhattan_left,  # the three of (15)
        euclidean + euclidean_left,
        manhattan + manhattan_left,
        *_field_values(scene, places, moved, fields, of_sights),
    ]
    if edges:
        asked = (wanted[0][EDGE_INTERVALS:], wanted[1][EDGE_INTERVALS:])
        numbers.append(_child_slacks(scene, onward, of_sights, asked, edges))
    return jnp.concatenate([jnp.ravel(places), *(number.ravel() for number in numbers)])


_EXPANSION_KERNELS = {edges: Kernel(partial(_expand, edges=edges)) for edges in (False, True)}


def _evaluate_attitude_moves(
    scene: Scene, since: Array, whole_turns: Array, turns: Array
) -> tuple[Array, Array]:
    """Return the places (a, 7) to which attitude moves lead, as in `Expansion`, and costs (4, a).

    The costs are the steps of the move, and three distances that are left, rad: the angle to the goal, and
    the L2 and L1 distance between the rotation vectors of place and goal relative to the start.

    Args:
        scene: the problem.
        since: (4,) attitude of the node relative to the start, a unit quaternion.
        whole_turns: (4, a) unit quaternions of the moves.
        turns: (a, 3) rotation vectors of the moves, rad.
    """
    ends = quaternion.product(since, whole_turns.T)
    to_goal = quaternion.log(quaternion.product(quaternion.conjugate(ends), scene.goal_quaternion))
    difference = (quaternion.log(ends) - scene.goal_coordinates).T
    onward = to_goal.T
    size = jnp.abs(difference)
    costs = [
        jnp.sqrt(dot(turns.T, turns.T)) / scene.attitude_step,
        jnp.sqrt(dot(onward, onward)),
        jnp.sqrt(dot(difference, difference)),
        size[0] + size[1] + size[2],
    ]
    return jnp.concatenate([ends, to_goal], axis=-1), jnp.stack(costs)


def _joint_move_costs(scene: Scene, joints: Array, changes: Array) -> Array:
    """Return costs of m joint moves, (4, a or 1, m).

    They are the steps of the move, and three distances from its end to the goal: steps, L1 and L2 in rad. The
    changes may differ with each of ``a`` attitude moves.

    Args:
        scene: the problem.
        joints: (1, 1, 2n) rad, of the node.
        changes: (a or 1, m, 2n) rad.
    """
    left = jnp.abs(scene.goal_joints - joints - changes)
    steps = jnp.asarray(scene.joint_steps)
    return jnp.stack([
        jnp.max(jnp.abs(changes) / steps, axis=-1, initial=0.0),
        jnp.max(left / steps, axis=-1, initial=0.0),
        jnp.sum(left, axis=-1),
        jnp.sqrt(jnp.sum(left * left, axis=-1)),
    ])  # fmt: skip


def _field_values(scene: Scene, places: Array, moved: LinesOfSight, fields: Array, choice: Array) -> Array:
    """Return the sum over devices and the largest of the distance fields at every child, (2, a, m) rad.

    There are ``a`` attitude moves, ``m`` joint moves and ``d`` sights.

    Args:
        scene: the problem.
        places: (a, 7) as in `Expansion`.
        moved: lines of sight along the moves.
        fields: (d, SIZE, SIZE) rad.
        choice: (m, d) option pair of each sight's joints.
    """
    attitude = jnp.asarray(scene.start_attitude) @ quaternion.to_matrix(places[:, :4])  # (a, 3, 3)
    body = moved.body[:, :, :, -1]  # (3, a or 1, o, d)
    rows = [dot(attitude[:, i, :].T[:, :, None, None], body) for i in range(3)]
    to_go = look_up(fields, jnp.stack(rows))  # (a, o, d)
    seen = [to_go[:, choice[:, device], device] for device in range(choice.shape[1])]
    nothing = jnp.zeros((to_go.shape[0], choice.shape[0]))
    return jnp.stack([reduce(jnp.add, seen, nothing), reduce(jnp.maximum, seen, nothing)])


def _child_slacks(scene: Scene, lines: LinesOfSight, choice: Array, wanted: Tables, edges: bool) -> Array:
    """Return the smallest slack of every child's motion, (a, m).

    There are ``a`` attitude moves, ``m`` joint moves and ``d`` sights.

    Args:
        scene: the problem.
        lines: lines of sight along the motions.
        choice: (m, d) option pair of each sight's joints.
        wanted: for each table (k, z), scores asked for by its z rows on k intervals; k is 1 for ends alone.
        edges: whether the whole motion counts, or its end alone.
    """
    rows = scene.cones
    dots = dot(lines.axes[0][:, :, None, :, None, :], lines.body[..., None])  # (a, o, k + 1, d, z)
    values = constraints.joint_values(rows, scene.gimbals, lines.joints) if rows.inner else None
    score = scores(rows, dots, values)
    if edges:
        error = lines.chord_error(rows)[:, :, None]
        score = edge_bound(score[:, :, :-1], score[:, :, 1:], error)
    else:
        score = score[:, :, -1:]
    slacks = wanted[0][:, None] - jnp.where(rows.bound.T, score, -jnp.inf)
    worst = fold(jnp.minimum, fold(jnp.minimum, slacks, 2, jnp.inf), 3, jnp.inf)  # (a, o, d)
    total = jnp.full((worst.shape[0], choice.shape[0]), jnp.inf)
    for device in range(choice.shape[1]):
        total = jnp.minimum(total, worst[:, choice[:, device], device])
    if scene.grouped_cones.half_angle.shape[0]:
        coupled = _coupled_slacks(scene, lines, choice, wanted[1][:, None, None], edges)
        total = jnp.minimum(total, fold(jnp.minimum, coupled, 0, jnp.inf))
    return total


def _coupled_slacks(scene: Scene, lines: LinesOfSight, choice: Array, wanted: Array, edges: bool) -> Array:
    """Return the smallest slack over the rows that couple devices, on each interval, (k, a, m).

    The axes are ``k`` intervals, ``a`` attitude moves and ``m`` joint moves. It loops over the samples, since
    tables of all children at all samples would be large, and a kernel with every interval written out takes a
    minute to compile. The arguments are those of `_child_slacks`, but `wanted` (k, 1, 1, z) is of these ``z``
    rows only; ``k`` is 1 for ends alone.
    """
    rows = scene.grouped_cones
    devices = range(choice.shape[1])
    axes, body, joints = (jnp.asarray(part) for part in (lines.axes[1], lines.body, lines.joints))

    def chosen(values: Array) -> Array:
        """Return values of d devices in m joint moves (..., m, d), from those under o options (..., o, d)."""
        return jnp.stack([values[..., choice[:, device], device] for device in devices], axis=-1)

    def at(sample: ArrayLike) -> tuple[Array, Array | None]:
        """Return the scores (`model.constraints`) at a sample of the motions.

        They are (a, o, d, z) of each sight to the rows, and (a or 1, m, d, z) of each child's sights to each
        other, None where all rows are inertial.
        """
        seen = jnp.take(body, sample, axis=3)  # (3, a or 1, o, d)
        values = (
            constraints.joint_values(rows, scene.gimbals, jnp.take(joints, sample, axis=2))
            if rows.inner
            else None
        )
        along = jnp.take(axes, sample, axis=2)[:, :, None, None]
        alone = scores(rows, dot(along, seen[..., None]), values)
        if not rows.inner:
            return alone, None
        both = chosen(seen)  # they depend on the joints of two devices
        return alone, scores(rows, dot(both[..., None], both[..., None, rows.partner]), 0.0)

    def slack(alone: Array, between: Array | None, asked: Array) -> Array:
        """Return the slack (a, m) of each child's worst constraint.

        It follows from scores as returned by `at` and from those asked for (1, 1, z).
        """
        bound = jnp.where(rows.bound.T, alone, -jnp.inf)
        largest = reduce(jnp.maximum, [bound[:, choice[:, device], device] for device in devices])
        if between is not None:
            worst = fold(jnp.maximum, jnp.where(rows.bound.T, between, -jnp.inf), 2, -jnp.inf)
            largest = jnp.where(rows.frame == SIGHT, worst, largest)
        return jnp.asarray(constraints.worst_constraint(rows, asked - largest))

    if not edges:
        return slack(*at(-1), wanted[0])[None]
    own_error, error = lines.chord_error(rows), jnp.zeros(())
    if rows.inner:  # two sights are seen alike from wherever the platform turns
        error = score_curvature(rows, error, chosen(lines.rate), chosen(lines.bend)) / 2

    def step(before: tuple[Array, Array | None], each: tuple[Array, Array]) -> tuple[Any, Array]:
        sample, asked = each
        now = at(sample)
        alone = edge_bound(before[0], now[0], own_error)
        pairs = None
        if before[1] is not None and now[1] is not None:
            pairs = edge_bound(before[1], now[1], error)
        return now, slack(alone, pairs, asked)

    intervals = axes.shape[2] - 1
    asked = jnp.broadcast_to(wanted, (intervals, *wanted.shape[1:]))
    return jax.lax.scan(step, at(0), (jnp.arange(1, intervals + 1), asked))[1]
