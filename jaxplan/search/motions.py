"""The first half of an expansion: where moves lead, what they cost, and what devices see on the way.

A child is one of ``A`` attitude moves combined with one of ``M`` joint moves, so nothing here is computed per
child: attitude moves and joint moves are priced apart, and lines of sight are tabulated as the zones' axes
in body coordinates along each attitude move, and the boresights in body coordinates under each option
pair of a device's joints. `jaxplan.search.kernels` puts the two together. Attitudes are unit quaternions
relative to the start.

Axes: a attitude move, o option pair (3 * yaw option + pitch option), m joint move, k sample along the
motion, d device, z zone. Components of vectors come first and small products are written out, so that
loops run over the batch.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import cross, dot
from jaxplan.model.constraints import INERTIAL, Constraints, score_curvature, thresholds
from jaxplan.search.problem import Scene

EDGE_INTERVALS = 8
ONWARD_INTERVALS = 16
STRAIGHT_INTERVALS = 64


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Sight:
    """What is needed to tell the angles between boresights and zones along motions.

    Attributes:
        axes: (3, a, k + 1, z) axes of the rows in body coordinates; anything where a sight is the axis.
        grouped_axes: likewise for the rows that are looked at together.
        body: (3, a or 1, o, k + 1, d) sights in body coordinates.
        joints: (a or 1, o, k + 1, 2n) rad.
        turn: (a,) rad, angle of the turn on each interval.
        rate: (a or 1, o, d) of `Sights.bounds` on each interval.
        bend: (a or 1, o, d) likewise.
    """

    axes: Array
    grouped_axes: Array
    body: Array
    joints: Array
    turn: Array
    rate: Array
    bend: Array

    def sag(self, rows: Constraints) -> Array:
        """(a, o, d, z or 1) of each interval, ``C h^2 / 2`` of `edge_bound`."""
        half: Array = score_curvature(rows, self.turn[:, None], self.rate, self.bend) / 2
        return half


def computed_once(gate: ArrayLike, values: Any) -> Any:
    """The same values, kept by the compiler as arrays instead of being fused into the loops that read them.

    Without it the sines and cosines of a few angles are taken anew for every zone, device and move. A
    conditional whose outcome cannot be foreseen ends the fusion; `jax.lax.optimization_barrier` does not on
    the CPU.

    Args:
        gate: () bool, true, and an argument of the jitted function.
        values: any tree of floating-point arrays.
    """
    return jax.lax.cond(
        gate, lambda v: v, lambda v: jax.tree.map(lambda x: jnp.full_like(x, jnp.nan), v), values
    )


def _body_axes(cones: Constraints, start: Array, since: Array) -> Array:
    """(3, a, z) axes of the rows, all taken for inertial, in body coordinates at attitudes (a, 4)."""
    inertial = jnp.asarray(cones.axis).T[:, None]
    at_start = dot(start[:, :, None], inertial)
    return dot(jnp.moveaxis(quaternion.to_matrix(since), 0, -1)[..., None], at_start[:, None, None])


def _turned(vectors: Array, axis: Array, cosine: Array, sine: Array) -> Array:
    """Body coordinates of fixed directions while the platform turns about a body axis, (3, a, k + 1, z).

    Args:
        vectors: (3, a or 1, z) directions in body coordinates before the turn.
        axis: (3, a) unit vectors, or zero for no turn.
        cosine: (a, k + 1) of the angles turned.
        sine: likewise.
    """
    across = jnp.stack(cross(axis[:, :, None], vectors))
    along = axis[:, :, None] * dot(axis[:, :, None], vectors)
    rest = vectors - along
    return (
        along[:, :, None, :]
        + rest[:, :, None, :] * cosine[None, :, :, None]
        - across[:, :, None, :] * sine[None, :, :, None]
    )


def _own_axes(rows: Constraints, turned: Array) -> Array:
    """Axes (3, a, k, z) of the rows, those of the body as they are, from all taken for inertial."""
    if not rows.inner:
        return turned
    return jnp.where(rows.frame == INERTIAL, turned, jnp.asarray(rows.axis).T[:, None, None])


def _sight(
    scene: Scene,
    axes: tuple[Array, Array],
    joints: Array,
    turns: Array,
    changes: Array,
    intervals: int,
    gate: Array,
) -> tuple[Sight, Array]:
    """Lines of sight along motions, and the unit quaternions of the whole turns.

    Args:
        scene: the problem.
        axes: (3, a or 1, z) axes of the zones, and of those of groups, in body coordinates where the
            motions start.
        joints: (a or 1, o or 1, 2n) there.
        turns: (a, 3) rotation vectors, body axes.
        changes: (a or 1, o, 2n) of the joints.
        intervals: of equal length.
        gate: see `computed_once`.

    Returns:
        The lines of sight; (4, a).
    """
    fraction = jnp.arange(intervals + 1) / intervals
    vectors = turns.T
    angle = jnp.sqrt(dot(vectors, vectors))
    axis = vectors / jnp.where(angle > 0, angle, 1)
    angles = jnp.concatenate([angle[:, None] * fraction, angle[:, None] / 2], axis=-1)
    cosines, sines = computed_once(gate, (jnp.cos(angles), jnp.sin(angles)))
    tables = [
        _own_axes(rows, _turned(vector, axis, cosines[:, :-1], sines[:, :-1]))
        for rows, vector in zip((scene.cones, scene.grouped_cones), axes, strict=True)
    ]
    path = joints[:, :, None, :] + fraction[:, None] * changes[:, :, None, :]
    rate, bend = scene.sights.bounds(changes / intervals)
    sight = Sight(
        axes=tables[0],
        grouped_axes=tables[1],
        body=jnp.moveaxis(scene.sights.in_body(path), -1, 0),
        joints=path,
        turn=angle / intervals,
        rate=rate,
        bend=bend,
    )
    return sight, jnp.concatenate([cosines[None, :, -1], axis * sines[:, -1]])


def _attitude_moves(scene: Scene, since: Array, whole_turns: Array, turns: Array) -> tuple[Array, Array]:
    """Where attitude moves lead, (a, 7), and their cost and distances to the goal, (4, a)."""
    ends = quaternion.product(since, whole_turns.T)
    to_goal = quaternion.log(quaternion.product(quaternion.conjugate(ends), scene.goal_quaternion))
    difference = (quaternion.log(ends) - scene.goal_coordinates).T
    onward = to_goal.T
    size = jnp.abs(difference)
    rows = [
        jnp.sqrt(dot(turns.T, turns.T)) / scene.attitude_step,
        jnp.sqrt(dot(onward, onward)),
        jnp.sqrt(dot(difference, difference)),
        size[0] + size[1] + size[2],
    ]
    return jnp.concatenate([ends, to_goal], axis=-1), jnp.stack(rows)


def _joint_moves(scene: Scene, joints: Array, changes: Array) -> Array:
    """Cost and distances to the goal of joint moves, (4, a or 1, m): steps, steps left, L1 and L2 left."""
    left = jnp.abs(scene.goal_joints - joints - changes)
    steps = jnp.asarray(scene.joint_steps)
    return jnp.stack([
        jnp.max(jnp.abs(changes) / steps, axis=-1, initial=0.0),
        jnp.max(left / steps, axis=-1, initial=0.0),
        jnp.sum(left, axis=-1),
        jnp.sqrt(jnp.sum(left * left, axis=-1)),
    ])  # fmt: skip


def _zone_axes(scene: Scene, since: Array) -> tuple[Array, Array]:
    """(3, a, z) axes of the zones, and of those of groups, in body coordinates at attitudes (a, 4)."""
    start = jnp.asarray(scene.start_attitude)
    return _body_axes(scene.cones, start, since), _body_axes(scene.grouped_cones, start, since)


def _thresholds(scene: Scene, clearance: Array) -> tuple[Array, Array]:
    """(k, z) cosines that the zones, and those of groups, ask for at clearances (k,)."""
    return (
        thresholds(scene.cones, clearance),
        thresholds(scene.grouped_cones, clearance),
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Motions:
    """Everything about an expansion that is not per child.

    Attributes:
        moved: lines of sight of the moves.
        onward: lines of sight of the straight motions from where the moves lead to the goal, or None.
        places: (a, 7) where attitude moves lead, see `kernels.Expansion`.
        reach: (4, a) cost of attitude moves in steps, and angle, Euclidean and Manhattan distance to go.
        ways: (4, a or 1, m) cost of joint moves in steps, and steps, L1 and L2 distance to go.
        wanted: (k, z) cosines that the zones, and those of groups, ask for on the intervals of the moves and
            then onward.
    """

    moved: Sight
    onward: Sight | None
    places: Array
    reach: Array
    ways: Array
    wanted: tuple[Array, Array]


def motions(
    scene: Scene,
    node: Array,
    turns: Array,
    options: Array,
    choice: Array,
    clearance: Array,
    gate: Array,
    *,
    onward: bool,
) -> Motions:
    """The moves from a node; arguments as for `kernels.expansion_call`, and the gate."""
    terminals = scene.mounts.shape[0]
    since, joints = node[:4], node[None, None, 7:]
    yaw = jnp.repeat(options[..., :terminals], 3, axis=1)
    pitch = jnp.tile(options[..., terminals:], (1, 3, 1))
    pairs = jnp.concatenate([yaw, pitch], axis=-1)  # (a or 1, o, 2n)
    axes = _zone_axes(scene, since[None])
    moved, whole_turns = _sight(scene, axes, joints, turns, pairs, EDGE_INTERVALS, gate)
    places, reach = _attitude_moves(scene, since, whole_turns, turns)
    rest = None
    if onward:
        ends, to_goal = joints + pairs, places[:, 4:]
        axes = moved.axes[:, :, -1], moved.grouped_axes[:, :, -1]
        left = jnp.asarray(scene.goal_joints) - ends
        rest, _ = _sight(scene, axes, ends, to_goal, left, ONWARD_INTERVALS, gate)
    ways = _joint_moves(scene, joints, jnp.take_along_axis(options, choice[None], axis=1))
    answer = Motions(
        moved=moved,
        onward=rest,
        places=places,
        reach=reach,
        ways=ways,
        wanted=_thresholds(scene, clearance),
    )
    return computed_once(gate, answer)


def sight_between(
    scene: Scene, since: Array, joints: Array, turns: Array, ends: Array, intervals: int, gate: Array
) -> Sight:
    """Lines of sight along straight motions, each by itself.

    Args:
        scene: the problem.
        since: (a, 4) attitudes where they start, relative to the start.
        joints: (a, 2n) there.
        turns: (a, 3) rotation vectors, body axes.
        ends: (a, 2n) joints where they end.
        intervals: of equal length, static.
        gate: see `computed_once`.
    """
    start = jnp.asarray(joints)[:, None]
    change = jnp.asarray(ends)[:, None] - start
    sight, _ = _sight(scene, _zone_axes(scene, since), start, turns, change, intervals, gate)
    return computed_once(gate, sight)
