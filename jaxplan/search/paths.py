"""Paths along straight motions: from corners to nodes, the straight motion itself, and chains of shortcuts.

A state is a row of ``4 + 2n`` numbers: the attitude relative to the start as a unit quaternion, scalar first,
and all joints in radians. Motions between *corners* are straight; the path along them is cut into edges of at
most one step between its *nodes*. To shorten a path, straight motions between all pairs of some of its nodes
are checked in one call, and dynamic programming takes the cheapest chain of those that are clear. In kernels
a path is its states (k, 4 + 2n), with quaternions of neighbours of the same sign.
"""

from collections.abc import Sequence
from itertools import combinations

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.geometry import quaternion, rotations
from jaxplan.geometry.vectors import AnyArray, array_module, arrays
from jaxplan.model.constraints import constraint_margins, state_margins
from jaxplan.model.path import Path, step_cost
from jaxplan.model.scenario import SearchSettings
from jaxplan.model.scores import room
from jaxplan.search.edges import interval_slacks, motion_margins, straight_lines
from jaxplan.search.kernel_calls import Call, Kernel, Scenes
from jaxplan.search.scene import Scene, steps_between, tapered

# A node this near to the goal, in steps, is the goal.
ARRIVED = 1e-9
STRAIGHT_INTERVALS = 64
CORNERS = 10  # nodes between which shortcuts are tried
_PAIR_STARTS, _PAIR_ENDS = np.array(list(combinations(range(CORNERS), 2))).T
_CORNER_INTERVALS, _EDGE_INTERVALS = 16, 4  # of a shortcut, and of an edge of at most a few steps
_MIN_EDGE_COST = 1e-12  # steps
# Most by which a bound over an interval of a straight motion lies above the scores at its ends, where
# platform and joints turn by 2 pi each.
_MAX_BOUND_ERROR = (4 * np.pi / STRAIGHT_INTERVALS) ** 2 / 8


def between(first: AnyArray, second: AnyArray, fraction: AnyArray) -> AnyArray:
    """Return states at fractions (k,) of k straight motions, given their ends (k, 4 + 2n) each."""
    xp = array_module(first, second, fraction)
    joints = first[:, 4:] + fraction[:, None] * (second[:, 4:] - first[:, 4:])
    turned = rotations.slerp(first[:, :4].T, second[:, :4].T, fraction)
    return xp.concatenate([xp.stack(turned, axis=-1), joints], axis=-1)


def subdivide(scene: Scene, corners: np.ndarray) -> Path:
    """Return the path along straight motions between corners, each cut into equal parts of at most one step.

    Args:
        scene: gives the steps, and its start and goal, which are the ends of the path to the last bit.
        corners: (k + 1, 4 + 2n) states, ends of k straight motions from start to goal; one if these are the
            same.
    """
    first, second = corners[:-1], corners[1:]
    rotation = quaternion.distance(first[:, :4], second[:, :4])
    costs = steps_between(scene, rotation, second[:, 4:] - first[:, 4:])
    parts = np.maximum(np.ceil(costs - ARRIVED).astype(int), 1)
    edge = np.repeat(np.arange(len(parts)), parts)
    fraction = np.concatenate([np.zeros(0), *(np.arange(1, count + 1) / count for count in parts)])
    states = np.concatenate([corners[:1], between(first[edge], second[edge], fraction)])
    attitudes, joints = scene.start_attitude @ quaternion.to_matrix(states[:, :4]), states[:, 4:]
    attitudes[0], joints[0] = scene.start_attitude, scene.start_joints
    if len(parts):
        attitudes[-1], joints[-1] = scene.goal_attitude, scene.goal_joints
    return Path(attitudes=attitudes, joints=joints, edge_costs=(costs / parts)[edge])


def make_path(scene: Scene, attitudes: np.ndarray, joints: np.ndarray) -> Path:
    """Make a path of nodes, with the cost of its m edges.

    Args:
        scene: gives the steps.
        attitudes: (m + 1, 3, 3) body to inertial.
        joints: (m + 1, 2n) rad.
    """
    costs = steps_between(scene, edge_rotations(attitudes), np.diff(joints, axis=0))
    return Path(attitudes=attitudes, joints=joints, edge_costs=costs)


def edge_rotations(attitudes: np.ndarray) -> np.ndarray:
    """Return the m rotation angles (m,), rad, between neighbours of attitudes (m + 1, 3, 3)."""
    return np.asarray(so3.distance(attitudes[:-1], attitudes[1:]))


def straight_paths(scenes: Scenes, settings: Sequence[SearchSettings]) -> list[Path | None]:
    """Check the straight motion of each scene, and return its path where it keeps the settings' clearance.

    Where it does not, None stands in the path's place. Where start and goal are the same, the path is one
    node.
    """
    paths = [
        subdivide(scene, scene.ends[:1]) if scene.straight_steps <= ARRIVED else None
        for scene in scenes.scenes
    ]
    tried = [number for number, path in enumerate(paths) if path is None]
    passed = np.arange(STRAIGHT_INTERVALS) / STRAIGHT_INTERVALS
    wanted = {}
    for number in tried:
        scene, nearer = scenes.scenes[number], np.minimum(passed, passed[::-1])  # of start and goal
        wanted[number] = tapered(settings[number].clearance, scene.straight_steps * nearer)
    calls = [straight_call(scenes.scenes[number], wanted[number]) for number in tried]
    for number, slacks in zip(tried, scenes.part(tried).answers(calls), strict=True):
        unsure = np.flatnonzero(~(slacks >= 0))
        refinable = np.all(slacks >= -_MAX_BOUND_ERROR)
        if not len(unsure) or (refinable and _are_clear_when_refined(scenes, number, unsure, wanted[number])):
            paths[number] = subdivide(scenes.scenes[number], scenes.scenes[number].ends)
    return paths


def _are_clear_when_refined(scenes: Scenes, number: int, unsure: np.ndarray, wanted: np.ndarray) -> bool:
    """Tell whether some intervals of a straight motion are clear, each cut into as many intervals again.

    In a narrow zone bounds over long intervals do not show that a motion stays there, though it may: a roll
    about a boresight, or a terminal that stays on its link while the platform turns.

    Args:
        scenes: the problems.
        number: that of the scene.
        unsure: numbers of the intervals of which a bound does not tell.
        wanted: (STRAIGHT_INTERVALS,) rad of clearance.
    """
    scene = scenes.scenes[number]
    first, last = np.repeat(scene.ends[:, None], len(wanted) + 1, axis=1)
    corners = between(first, last, np.linspace(0, 1, len(wanted) + 1))
    states = scene.start_attitude @ quaternion.to_matrix(corners[:, :4]), corners[:, 4:]
    asked = np.append(wanted, 0.0)  # at the start of each interval, and at the goal
    for rows in scene.tables:
        left = constraint_margins(rows, state_margins(rows, scene.sights, *states))
        if not np.all(left >= np.minimum(asked[:, None], room(rows))):
            return False
    pieces = [Call(_straight_slacks, (corners[k : k + 2], np.full(len(wanted), wanted[k]))) for k in unsure]
    return all(np.all(slacks >= 0) for slacks in scenes.part([number] * len(pieces)).answers(pieces))


def straight_call(scene: Scene, clearance: np.ndarray) -> Call:
    """Make the call for the smallest slack on each interval of the straight motion from start to goal.

    Args:
        scene: the problem.
        clearance: (STRAIGHT_INTERVALS,) rad wanted.

    Returns:
        The call. Its answer is (STRAIGHT_INTERVALS,), +inf without zones.
    """
    return Call(_straight_slacks, (scene.ends, clearance))


@Kernel
def _straight_slacks(scene: Scene, ends: Array, clearance: Array) -> Array:
    """Return slacks (STRAIGHT_INTERVALS,) on the straight motion between the states `ends` (2, 4 + 2n).

    `clearance` (STRAIGHT_INTERVALS,) is wanted on the intervals, rad.
    """
    lines = straight_lines(scene, ends[:1], ends[1:], STRAIGHT_INTERVALS)
    return interval_slacks(scene, lines, clearance[None])[0]


def path_states(scene: Scene, attitudes: AnyArray, joints: AnyArray) -> AnyArray:
    """Return the states (k, 4 + 2n) of k attitudes (k, 3, 3), body to inertial, and joints (k, 2n).

    Neighbours have quaternions of the same sign.
    """
    xp, start, turned = arrays(scene.start_attitude, attitudes)
    # a product and a sum instead of small matrix products
    since = xp.sum(start[:, :, None] * turned[:, :, None, :], axis=1)
    return xp.concatenate([quaternion.continuous(since), joints], axis=-1)


def edge_costs(scene: Scene, states: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return costs of the m edges between states (m + 1, 4 + 2n), in steps.

    Returns:
        (m,) the largest number of steps over platform and joints, and (m,) the sum of all of them.
    """
    angles = quaternion.distance(states[:-1, :4], states[1:, :4])
    if states.shape[1] == 4:  # no joints; on one core XLA cannot compile a sum over none beside LAPACK
        return angles / scene.attitude_step, angles / scene.attitude_step
    change = states[1:, 4:] - states[:-1, 4:]
    every = abs(change / scene.joint_steps).sum(axis=-1)
    cost = step_cost(angles, change, scene.attitude_step, scene.joint_steps)
    return cost, angles / scene.attitude_step + every


def evenly(states: AnyArray, costs: AnyArray, count: AnyArray | int, nodes: int) -> AnyArray:
    """Return nodes at equal distances in cost along a path.

    Args:
        states: (k + 1, 4 + 2n) nodes of a path with k edges.
        costs: (k,) steps of the edges; zero for padding at the end, which repeats the last state.
        count: () number of equal edges wanted.
        nodes: static, number of nodes returned; those after the last state repeat it.

    Returns:
        (nodes, 4 + 2n); first and last state as given.
    """
    xp = array_module(states, costs)
    until = xp.concatenate([xp.zeros(1), xp.cumsum(costs)])
    at = np.arange(nodes) * (until[-1] / count)
    edge = xp.sum(at[:, None] >= until[None, 1:-1], axis=-1)
    part = xp.clip((at - until[edge]) / xp.maximum(costs[edge], _MIN_EDGE_COST), 0, 1)
    found = between(states[edge], states[edge + 1], part)
    return xp.where(np.arange(nodes)[:, None] >= count, states[-1], found)


def edges_of(scene: Scene, states: Array, clearance: Array) -> Array:
    """Return four numbers of each of the m edges between states, (4, m).

    They are the margin and the slack, rad, then the cost and the sum over the motions of platform and joints,
    steps. The slack is the margin less the clearance wanted. As in the search, less clearance is wanted near
    start and goal: the steps from the start are counted along the path, those to the goal along the straight
    motion, less the edge itself.

    Args:
        scene: the problem.
        states: (m + 1, 4 + 2n).
        clearance: rad wanted far from start and goal.
    """
    costs, every = edge_costs(scene, states)
    turn = quaternion.distance(states[:-1, :4], scene.goal_quaternion)
    left = step_cost(turn, scene.goal_joints - states[:-1, 4:], scene.attitude_step, scene.joint_steps)
    nearer = jnp.minimum(jnp.cumsum(costs) - costs, left - jnp.maximum(costs, 1))
    lines = straight_lines(scene, states[:-1], states[1:], _EDGE_INTERVALS)
    return jnp.stack([*motion_margins(scene, lines, tapered(clearance, nearer)), costs, every])


@Kernel
def edge_table(scene: Scene, attitudes: Array, joints: Array, clearance: Array) -> Array:
    """Return `edges_of` a path with m edges, attitudes (m + 1, 3, 3) and joints (m + 1, 2n)."""
    return edges_of(scene, path_states(scene, attitudes, joints), clearance)


def shortcuts(scenes: Scenes, paths: Sequence[Path], clearances: Sequence[float]) -> list[np.ndarray]:
    """Return the indices of the nodes that remain of each path when it is cut short wherever that is clear.

    Args:
        scenes: the problems.
        paths: one for each scene, with m edges, at least one.
        clearances: rad wanted for each scene; less is wanted near start and goal.

    Returns:
        For each path the indices (k,) of the k nodes that remain, increasing from 0 to m. The straight motion
        between two neighbours among them is clear by `edges.motion_margins`, or is an edge of the path.
    """
    calls = []
    for path, clearance in zip(paths, clearances, strict=True):
        tried, passed = _pick_corners(path)
        nearer = np.minimum(passed[_PAIR_STARTS], passed[-1] - passed[_PAIR_ENDS])
        calls.append(
            Call(_shortcut_costs, (path.attitudes[tried], path.joints[tried], tapered(clearance, nearer)))
        )
    return [_cheapest_chain(*one) for one in zip(paths, scenes.answers(calls), strict=True)]


def _pick_corners(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return indices (CORNERS,) of nodes between which to try shortcuts, and the steps to each node."""
    tried = np.rint(np.linspace(0, path.edges, CORNERS)).astype(int)
    return tried, np.concatenate([[0.0], np.cumsum(path.edge_costs)])[tried]


@Kernel
def _shortcut_costs(scene: Scene, attitudes: Array, joints: Array, clearance: Array) -> Array:
    """Return the steps (pairs,) of straight motions between all pairs of nodes, +inf where one is not clear.

    Args:
        scene: the problem.
        attitudes: (CORNERS, 3, 3) of the nodes, body to inertial.
        joints: (CORNERS, 2n) rad.
        clearance: (pairs,) rad wanted.
    """
    states = path_states(scene, attitudes, joints)
    first, second = states[_PAIR_STARTS], states[_PAIR_ENDS]
    turn, change = quaternion.distance(first[:, :4], second[:, :4]), second[:, 4:] - first[:, 4:]
    costs = step_cost(turn, change, scene.attitude_step, scene.joint_steps)
    _, slack = motion_margins(scene, straight_lines(scene, first, second, _CORNER_INTERVALS), clearance)
    return jnp.where(slack >= 0, costs, jnp.inf)


def _cheapest_chain(path: Path, costs: np.ndarray) -> np.ndarray:
    """Return the indices of the nodes on the cheapest chain of clear shortcuts and pieces of the path.

    Args:
        path: the path to be shortened.
        costs: (pairs,) steps between its corners, from `_shortcut_costs`.
    """
    tried, passed = _pick_corners(path)
    table = np.full((CORNERS, CORNERS), np.inf)
    table[_PAIR_STARTS, _PAIR_ENDS] = costs
    steps = np.arange(CORNERS - 1)
    along = np.diff(passed)
    on_path = along <= table[steps, steps + 1]
    table[steps[on_path], steps[on_path] + 1] = along[on_path]
    best, before = np.zeros(CORNERS), np.zeros(CORNERS, int)
    for end in range(1, CORNERS):
        ways = best[:end] + table[:end, end]
        before[end] = np.argmin(ways)
        best[end] = ways[before[end]]
    kept = np.zeros(path.edges + 1, bool)
    kept[-1], end = True, CORNERS - 1
    while end:
        start = before[end]
        follows = start == end - 1 and on_path[start]
        kept[tried[start] : tried[end] if follows else tried[start] + 1] = True
        end = start
    return np.flatnonzero(kept)
