"""Paths cut short: the cheapest chain of clear straight motions between nodes of a path.

Straight motions between all pairs of nodes are checked in one call, and a dynamic programme takes the
cheapest chain of those that are clear.
"""

from collections.abc import Sequence
from itertools import combinations

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry import rotations
from jaxplan.model.path import Path
from jaxplan.search.calls import Call, Kernel, Scenes
from jaxplan.search.problem import TAPER_STEPS, Scene
from jaxplan.search.smoothing import sweeps

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
