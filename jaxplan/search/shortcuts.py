"""Shortcuts through a path: straight motions between any two points of it that are clear.

A search's path is made of the moves that it happened to draw. Points are laid along it at even cost, the
straight motions between all pairs of them are judged in one call by the exact edge bound, and the cheapest
chain of clear ones replaces the path. A few rounds, with the points shifted, take most of what can be taken.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import quaternion, so3
from jaxplan.path import Path
from jaxplan.scenario.model import SearchSettings
from jaxplan.search.kernels import interval_slacks
from jaxplan.search.motions import sight_between
from jaxplan.search.multi_heuristic import TAPER_STEPS
from jaxplan.search.problem import Scene
from jaxplan.search.tree import make_root, steps_between, subdivide

POINTS = 18
ROUNDS = 4
_INTERVALS = 20
_FRACTION = np.arange(_INTERVALS + 1) / _INTERVALS
_FIRST, _LAST = np.triu_indices(POINTS, 1)


@jax.jit
def _judge(
    scene: Scene, attitudes: Array, joints: Array, clearance: Array, gate: Array
) -> tuple[Array, Array]:
    """Whether they are clear (p,) and the rotation (p,) of straight motions between all pairs of points."""
    since = quaternion.from_matrix(jnp.asarray(scene.start_attitude).T @ attitudes)
    turns = quaternion.log(quaternion.product(quaternion.conjugate(since[_FIRST]), since[_LAST]))
    sight = sight_between(scene, since[_FIRST], joints[_FIRST], turns, joints[_LAST], _INTERVALS, gate)
    slacks = interval_slacks(scene, sight, clearance)
    return jnp.all(slacks >= 0, axis=-1), so3.length(turns)


def shorten(scene: Scene, settings: SearchSettings, path: Path) -> Path:
    """The path with shortcuts taken, cut into edges of at most one step.

    Args:
        scene: the problem.
        settings: gives the clearance, which shortcuts keep, tapering to the ends.
        path: of at least one edge.

    Returns:
        A path that is not longer; the same one if no shortcut is clear.
    """
    best, shortest = path, make_root(scene).ahead * (1 + 1e-9)
    for round_ in range(ROUNDS):
        if best.length <= shortest:  # than the straight motion nothing is shorter
            break
        attitudes, joints, places = _spread(best, 0.5 * (round_ % 2))
        length = (places[_LAST] - places[_FIRST])[:, None]
        since = places[_FIRST, None] + _FRACTION[:-1] * length
        ahead = (places[-1] - places[_LAST])[:, None] + (1 - _FRACTION[1:]) * length
        wanted = settings.clearance * np.minimum(np.minimum(since, ahead) / TAPER_STEPS, 1)
        change = joints[_LAST] - joints[_FIRST]
        answer = _judge(scene, attitudes, joints, wanted, True)
        clear, rotation = (np.asarray(part) for part in answer)
        chain = _cheapest(np.where(clear, steps_between(scene, rotation, change), np.inf))
        if chain is not None:
            candidate = subdivide(scene, attitudes[chain], joints[chain])
            if candidate.length < best.length - 1e-9:
                best = candidate
    return best


def _spread(path: Path, shift: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """POINTS nodes of a path at even cost, both ends among them, and the cost before each."""
    places = np.concatenate([[0.0], np.cumsum(path.edge_costs)])
    at = np.linspace(0, places[-1], POINTS)
    at[1:-1] += shift * (at[1] - at[0])
    nodes = np.abs(places[:, None] - at).argmin(axis=0)
    nodes[0], nodes[-1] = 0, len(places) - 1
    return path.attitudes[nodes], path.joints[nodes], places[nodes]


def _cheapest(price: np.ndarray) -> np.ndarray | None:
    """Places of the points on the cheapest chain from the first to the last; None where there is none."""
    table = np.full((POINTS, POINTS), np.inf)
    table[_FIRST, _LAST] = price
    cost, before = np.full(POINTS, np.inf), np.zeros(POINTS, dtype=int)
    cost[0] = 0
    for point in range(1, POINTS):
        ways = cost[:point] + table[:point, point] + 1e-9  # of equal chains the one with fewer links
        before[point] = int(ways.argmin())
        cost[point] = ways[before[point]]
    if cost[-1] == np.inf:
        return None
    chain = [POINTS - 1]
    while chain[-1] != 0:
        chain.append(int(before[chain[-1]]))
    return np.array(chain[::-1])
