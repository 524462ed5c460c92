"""The cheapest chain of clear straight motions between the nodes of a path.

Straight motions between all pairs of nodes are checked in one call, and a dynamic programme takes the
cheapest chain of those that are clear.
"""

from itertools import combinations

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry import rotations
from jaxplan.model.path import Path
from jaxplan.search.lockstep import Call, Kernel, Steps
from jaxplan.search.problem import TAPER_STEPS, Scene
from jaxplan.search.smoothing import sweeps

CORNERS = 10  # nodes between which straight motions are tried
_FIRST, _LAST = np.array(list(combinations(range(CORNERS), 2))).T
_HALVINGS = 4  # of each motion: 16 intervals


def cheapest(path: Path, clearance: float) -> Steps[np.ndarray]:
    """Nodes of a path that are left when it is cut short wherever that is clear.

    Args:
        path: with m edges, at least one.
        clearance: rad, wanted of the motions, less near start and goal.

    Returns:
        (k,) int, increasing from 0 to m. Between two that follow each other the straight motion is clear by
        `sweeps.motion_margins`, or they follow each other on the path.
    """
    tried = np.rint(np.linspace(0, path.edges, CORNERS)).astype(int)
    passed = np.concatenate([[0.0], np.cumsum(path.edge_costs)])[tried]
    table = np.full((CORNERS, CORNERS), np.inf)
    corners = path.attitudes[tried], path.joints[tried]
    table[_FIRST, _LAST] = yield Call(_costs, (*corners, passed, clearance))
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
