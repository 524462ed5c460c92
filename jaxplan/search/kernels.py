"""The jitted expansion: every child of a node with its slack and distances, in one call.

A child is one of ``A`` attitude moves combined with one of ``M`` joint moves. What a device sees depends only
on the attitude move and on its own terminal's two joints, each of which has three options. So zones are
looked at once for every (attitude move, option pair, device) and the children read the result: nine
entries a device instead of M. Edges are checked whole: each is cut into intervals, and on each of these
a bound of the boresight's curvature makes its ends speak for what lies between. Slack is a difference
of cosines, >= 0 where the wanted clearance is kept (`zones.cosine_slack`).

Axes: a attitude move, o option pair (3 * yaw option + pitch option), m joint move, k sample or interval
along the edge, d device, z zone.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3, spacecraft, zones
from jaxplan.path import direction_curvature, interval_cosines
from jaxplan.search.problem import Scene

EDGE_INTERVALS = 3
STRAIGHT_INTERVALS = 64
NODE_COLUMNS = 14  # attitude (9), rotation vector to the goal (3), the two norms of equation (15)


def _option_cosines(
    scene: Scene, cones: zones.Cones, attitudes: Array, joints: Array, curvature: Array, edges: bool
) -> Array:
    """Each device's signed cosines under every option: worst of each interval, or at the edge's end alone.

    Args:
        scene: the problem.
        cones: the zones asked about.
        attitudes: (a, k + 1, 3, 3).
        joints: (o, k + 1, 2n).
        curvature: (a, o, d) of the boresight over the whole edge.
        edges: whether the whole edge counts.

    Returns:
        (a, o, k, d, z), -inf where the zone does not bind the device; k is 1 without edges.
    """
    body = spacecraft.body_boresights(scene.mounts, scene.fixed_boresights, joints)
    # products and sums instead of small matrix products: they fuse into one loop
    axes = jnp.sum(attitudes[:, :, None, :, :] * cones.direction[:, :, None], axis=-2)  # (a, k, z, 3), body
    dots = jnp.sum(axes[:, None, :, None] * body[:, :, :, None, :], axis=-1)  # (a, o, k, d, z)
    if edges:
        intervals = joints.shape[1] - 1
        local = curvature[:, :, None, :, None] / (2 * intervals**2)
        cosines = zones.swept_cosines(cones, dots[:, :, :-1], dots[:, :, 1:], local)
    else:
        cosines = jnp.asarray(cones.side) * dots[:, :, -1:]
    return jnp.where(cones.bound.T, cosines, -jnp.inf)


def _child_slacks(
    scene: Scene, moved: tuple[Array, Array, Array], choice: Array, clearance: Array, edges: bool
) -> Array:
    """Smallest slack of every child, (a, m); +inf without zones.

    Args:
        scene: the problem.
        moved: attitudes, joints and curvature as `_option_cosines` takes them.
        choice: (m, d) the option pair of each device's joints.
        clearance: () rad.
        edges: whether the whole edge counts.
    """
    device = jnp.arange(choice.shape[1])
    cosines = jnp.max(_option_cosines(scene, scene.cones, *moved, edges), axis=2)  # (a, o, d, z)
    worst = jnp.min(zones.cosine_slack(scene.cones, cosines, clearance), axis=-1, initial=jnp.inf)
    total = jnp.min(worst[:, choice, device], axis=-1, initial=jnp.inf)
    if scene.grouped_cones.half_angle.shape[0]:  # a group's zone couples its devices at each instant
        grouped = _option_cosines(scene, scene.grouped_cones, *moved, edges)
        per_child = jnp.moveaxis(grouped, 2, 3)[:, choice, device]  # (a, m, d, k, z)
        held = _group_slacks(scene, jnp.max(per_child, axis=2, initial=-jnp.inf), clearance)
        total = jnp.minimum(total, jnp.min(held, axis=-1))
    return total


def _group_slacks(scene: Scene, cosines: Array, clearance: Array) -> Array:
    """Smallest slack over all groups, (...), each group's best zone counting; cosines are (..., z)."""
    slack = zones.cosine_slack(scene.grouped_cones, cosines, clearance)
    return jnp.min(zones.group_margins(scene.grouped_cones, slack), axis=-1)


def _straight_slacks(scene: Scene, attitude: Array, joints: Array, to_goal: Array, clearance: Array) -> Array:
    """Smallest slack on each interval of the straight motion to the goal, (k,)."""
    motion = (scene.mounts, scene.fixed_boresights, attitude, joints, to_goal, scene.goal_joints - joints)
    cosines = interval_cosines(scene.cones, *motion, STRAIGHT_INTERVALS)
    total = jnp.min(zones.cosine_slack(scene.cones, cosines, clearance), axis=-1, initial=jnp.inf)
    if scene.grouped_cones.half_angle.shape[0]:
        grouped = interval_cosines(scene.grouped_cones, *motion, STRAIGHT_INTERVALS)
        total = jnp.minimum(total, _group_slacks(scene, grouped, clearance))
    return total


@partial(jax.jit, static_argnames="edges")
def _expand(
    scene: Scene, node: Array, turns: Array, options: Array, moves: Array, clearance: Array, *, edges: bool
) -> Array:
    terminals = scene.mounts.shape[0]
    attitude, to_goal, joints = node[:9].reshape(3, 3), node[9:12], node[12:]
    fraction = jnp.arange(EDGE_INTERVALS + 1) / EDGE_INTERVALS
    steps = so3.exp(fraction[:, None] * turns[:, None, :])
    attitudes = jnp.sum(attitude[:, :, None] * steps[:, :, None], axis=-2)
    yaw = jnp.repeat(options[:, :terminals], 3, axis=0)
    pitch = jnp.tile(options[:, terminals:], (3, 1))
    changes = jnp.concatenate([yaw, pitch], axis=-1)  # (o, 2n)
    rotation = jnp.sqrt(jnp.sum(turns * turns, axis=-1))
    curvature = direction_curvature(rotation[:, None], changes, scene.fixed_boresights.shape[0])
    pairs = 3 * moves[:, :terminals] + moves[:, terminals:]
    still = jnp.zeros((moves.shape[0], scene.fixed_boresights.shape[0]), pairs.dtype)
    choice = jnp.concatenate([pairs, still], axis=-1)
    moved = (attitudes, joints + fraction[:, None] * changes[:, None, :], curvature)
    slacks = _child_slacks(scene, moved, choice, clearance[0], edges)

    ends = attitudes[:, -1]
    onward = jnp.sum(ends[:, :, :, None] * scene.goal_attitude[:, None], axis=-3)
    since = jnp.sum(scene.start_attitude[:, :, None] * ends[:, :, None], axis=-3)
    whole = scene.start_attitude.T @ scene.goal_attitude
    logs = so3.log(jnp.concatenate([onward, since, whole[None]]))
    count = turns.shape[0]
    difference = logs[count : 2 * count] - logs[2 * count]
    euclidean = jnp.sqrt(jnp.sum(difference**2, axis=-1))
    manhattan = jnp.sum(jnp.abs(difference), axis=-1)
    nodes = [ends.reshape(-1, 9), logs[:count], euclidean[:, None], manhattan[:, None]]

    straight = _straight_slacks(scene, attitude, joints, to_goal, clearance[1:])
    return jnp.concatenate([jnp.concatenate(nodes, axis=-1).ravel(), slacks.ravel(), straight])


def expand(
    scene: Scene,
    node: np.ndarray,
    turns: np.ndarray,
    options: np.ndarray,
    moves: np.ndarray,
    clearance: np.ndarray,
    *,
    edges: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All children of a node, and the straight motion from it to the goal.

    Args:
        scene: the problem.
        node: (12 + 2n,) attitude (9), rotation vector to the goal in body axes (3), joints.
        turns: (A, 3) rotation vectors of the attitude moves, body axes.
        options: (3, 2n) change of each joint under each of its three options, rad.
        moves: (M, 2n) int, the option of each joint in each joint move.
        clearance: (1 + STRAIGHT_INTERVALS,) rad wanted of the children, and along the straight motion.
        edges: whether zones hold over the whole edge or at its end alone.

    Returns:
        (A, 14) of each attitude move: attitude (9), rotation vector to the goal (3), and the Euclidean and
        the Manhattan norm of the difference to the goal in exponential coordinates about the start (15);
        (A, M) smallest slack of each child, +inf without zones; (STRAIGHT_INTERVALS,) the same along the
        straight motion to the goal.
    """
    packed = np.asarray(_expand(scene, node, turns, options, moves, clearance, edges=edges))
    count, joint_moves = len(turns), len(moves)
    nodes = packed[: count * NODE_COLUMNS].reshape(count, NODE_COLUMNS)
    slacks = packed[count * NODE_COLUMNS : -STRAIGHT_INTERVALS].reshape(count, joint_moves)
    return nodes, slacks, packed[-STRAIGHT_INTERVALS:]
