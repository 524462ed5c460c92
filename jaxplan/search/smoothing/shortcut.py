"""Paths along straight motions between corners, and the cheapest chain of such.

Paths along straight motions between states, which are their corners.

A state is a row of ``4 + 2n`` numbers: the attitude relative to the start as a unit quaternion, and the
joints in radians. All of it is small and plain numpy.

Paths cut short: the cheapest chain of clear straight motions between nodes of a path.

Straight motions between all pairs of nodes are checked in one call, and a dynamic programme takes the
cheapest chain of those that are clear.
"""

from collections.abc import Sequence
from itertools import combinations

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.geometry import quaternion, rotations
from jaxplan.model.path import Path
from jaxplan.search.calls import Call, Kernel, Scenes
from jaxplan.search.problem import TAPER_STEPS, Scene, steps_between
from jaxplan.search.smoothing import sweeps

# A node this near to the goal, in steps, is the goal.
ARRIVED = 1e-9


def between(first: np.ndarray, second: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    """States (k, 4 + 2n) at fractions (k,) of straight motions."""
    states = first + fraction[:, None] * (second - first)
    states[:, :4] = np.stack(rotations.slerp(first[:, :4].T, second[:, :4].T, fraction), axis=-1)
    return states


def subdivide(scene: Scene, corners: np.ndarray) -> Path:
    """The path along straight motions between corners, cut into equal parts of at most one step.

    Args:
        scene: gives the steps, and its start and goal, which are the ends of the path to the last bit.
        corners: (k + 1, 4 + 2n) from start to goal; one alone if these are the same.
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
    """A path with the cost of its edges.

    Args:
        scene: gives the steps.
        attitudes: (m + 1, 3, 3).
        joints: (m + 1, 2n) rad.
    """
    costs = steps_between(scene, edge_rotations(attitudes), np.diff(joints, axis=0))
    return Path(attitudes=attitudes, joints=joints, edge_costs=costs)


def edge_rotations(attitudes: np.ndarray) -> np.ndarray:
    """(m,) rad, between neighbours of attitudes (m + 1, 3, 3)."""
    return np.asarray(so3.distance(attitudes[:-1], attitudes[1:]))


CORNERS = 10  # nodes between which straight motions are tried
_FIRST, _LAST = np.array(list(combinations(range(CORNERS), 2))).T
_HALVINGS = 4  # of each motion: 16 intervals


def shortcuts(scenes: Scenes, paths: Sequence[Path], clearances: Sequence[float]) -> list[np.ndarray]:
    """Nodes of paths that are left when each is cut short wherever that is clear.

    Args:
        scenes: the problems.
        paths: of each, with m edges, at least one.
        clearances: of each, rad, wanted of the motions, less near start and goal.

    Returns:
        Of each (k,) int, increasing from 0 to m. Between two that follow each other the straight motion is
        clear by `sweeps.motion_margins`, or they follow each other on the path.
    """
    calls = [_corner_call(*one) for one in zip(paths, clearances, strict=True)]
    return [_cheapest(*one) for one in zip(paths, scenes.answers(calls), strict=True)]


def _corners(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """(CORNERS,) nodes between which motions are tried, and the steps from the start to each."""
    tried = np.rint(np.linspace(0, path.edges, CORNERS)).astype(int)
    return tried, np.concatenate([[0.0], np.cumsum(path.edge_costs)])[tried]


def _corner_call(path: Path, clearance: float) -> Call:
    tried, passed = _corners(path)
    return Call(_costs, (path.attitudes[tried], path.joints[tried], passed, clearance))


def _cheapest(path: Path, costs: np.ndarray) -> np.ndarray:
    """(k,) nodes of the cheapest chain, by the steps that the motions between all pairs of corners cost."""
    tried, passed = _corners(path)
    table = np.full((CORNERS, CORNERS), np.inf)
    table[_FIRST, _LAST] = costs
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


@Kernel
def _costs(
    scene: Scene, attitudes: Array, joints: Array, passed: Array, clearance: Array, gate: Array
) -> Array:
    """Steps of the motions between all pairs of nodes, +inf where one is not clear, (pairs,).

    Args:
        scene: the problem.
        attitudes: (CORNERS, 3, 3).
        joints: (CORNERS, 2n) rad.
        passed: (CORNERS,) steps from the start along the path.
        clearance: rad.
        gate: see `motions.computed_once`.
    """
    q, j = sweeps.nodes(scene, attitudes, joints)
    start = q[:, _FIRST]
    turns = jnp.stack(rotations.relative(start, q[:, _LAST]))
    change = j[:, _LAST] - j[:, _FIRST]
    costs = sweeps.steps(scene, rotations.angle(turns), change)
    nearer = jnp.minimum(passed[_FIRST], passed[-1] - passed[_LAST])
    wanted = clearance * jnp.minimum(nearer / TAPER_STEPS, 1)
    _, slack = sweeps.motion_margins(
        scene, start, turns, j[:, _FIRST], change, wanted, gate, halvings=_HALVINGS
    )
    return jnp.where(slack >= 0, costs, jnp.inf)
