"""Elastic bands that descend from paths: nodes in, nodes and what is to be known of their edges out.

What comes out is cut anew into equal edges of at most one step, and its margins are taken of the attitudes
and joints that are handed out, by the exact bound of `jaxplan.model.path`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import quaternion
from jaxplan.model.path import Path
from jaxplan.runtime.batching import padded_count
from jaxplan.search.calls import Call, Kernel, Scenes
from jaxplan.search.corners import ARRIVED, make_path
from jaxplan.search.problem import Scene
from jaxplan.search.smoothing import band, descent, sweeps

ITERATIONS = 6
# Paths are compared by their length and this much of the steps of all their motions added up.
TRAVEL_SHARE = 0.05
# Nothing longer than so many times the straight motion is looked for where the kernels would grow for it.
LONGEST = 1.5
EDGES = 64  # paths of up to this many share their compiled kernels


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """An elastic band after its descent.

    Attributes:
        attitudes: (m + 1, 3, 3), ends as they were.
        joints: (m + 1, 2n) rad.
        margins: (m,) lower bound of each edge, rad.
        slacks: (m,) likewise, less the clearance that is wanted there.
        length: steps.
        score: what is compared: the length, and a share of all motions.
    """

    attitudes: np.ndarray
    joints: np.ndarray
    margins: np.ndarray
    slacks: np.ndarray
    length: float
    score: float

    @property
    def clear(self) -> bool:
        """Whether every edge is as clear as wanted."""
        return bool(np.all(self.slacks >= 0))

    def path(self, scene: Scene) -> Path:
        """As a path."""
        return make_path(scene, self.attitudes, self.joints)


def score(length: float, travel: float) -> float:
    """What is compared, of steps and of the steps of all motions added up."""
    return length + TRAVEL_SHARE * travel


def edges_for(length: float, scene: Scene) -> int:
    """Size of the kernels that take a path of some length, steps."""
    longest = min(length, LONGEST * scene.straight_steps)
    return max(EDGES, padded_count(math.ceil(longest)))


def descended_bands(
    scenes: Scenes,
    starts: Sequence[tuple[np.ndarray, np.ndarray]],
    clearances: Sequence[float],
    edges: Sequence[int],
) -> list[Band | None]:
    """Let a band of each scene descend from a path.

    Args:
        scenes: the problems.
        starts: of each, attitudes (k + 1, 3, 3), at least two, and joints (k + 1, 2n) rad; some nodes are
            left out where they are more than `edges` allows.
        clearances: of each, rad wanted.
        edges: of each, see `edges_for`; what comes out has at most as many.

    Returns:
        What came out, clear or not; None where that is no path of edges of at most a step.
    """
    calls = [
        Call(_descended, (*padded(*start, most), clearance))
        for start, clearance, most in zip(starts, clearances, edges, strict=True)
    ]
    nodes = [_unpacked(answer) for answer in scenes.answers(calls)]
    finite = [number for number, one in enumerate(nodes) if one is not None]
    made = [one for one in nodes if one is not None]
    checks = [
        Call(edge_table, (attitudes, joints, clearances[number]))
        for number, (attitudes, joints, _) in zip(finite, made, strict=True)
    ]
    bands: list[Band | None] = [None] * len(starts)
    tables = scenes.part(finite).answers(checks)
    for number, one, table in zip(finite, made, tables, strict=True):
        bands[number] = _band(starts[number], *one, table)
    return bands


def _unpacked(answer: np.ndarray) -> tuple[np.ndarray, np.ndarray, int] | None:
    """Attitudes, joints and the number of edges that `_descended` tells of; None if one is not finite."""
    if not np.all(np.isfinite(answer)):
        return None
    return answer[:-1, :9].reshape(-1, 3, 3), answer[:-1, 9:], int(answer[-1, -1])


def _band(
    start: tuple[np.ndarray, np.ndarray],
    attitudes: np.ndarray,
    joints: np.ndarray,
    count: int,
    table: np.ndarray,
) -> Band | None:
    """The band with so many edges, whose ends are those it started from; None if an edge is too long.

    Args:
        start: attitudes and joints of the path that it has descended from.
        attitudes: (m + 1, 3, 3), of which those of `count` edges matter.
        joints: (m + 1, 2n) rad.
        count: of the edges.
        table: (4, m) answer of `edge_table`.
    """
    margins, slacks, costs, every = table[:, :count]
    if not np.all(costs <= 1 + ARRIVED):
        return None
    attitudes, joints = attitudes[: count + 1].copy(), joints[: count + 1].copy()
    for end in (0, -1):  # to the last bit
        attitudes[end], joints[end] = start[0][end], start[1][end]
    length = float(np.sum(costs))
    return Band(attitudes, joints, margins, slacks, length, score(length, float(np.sum(every))))


def padded(attitudes: np.ndarray, joints: np.ndarray, edges: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes with the last repeated until there are as many edges; of more nodes only some, evenly."""
    kept = np.rint(np.linspace(0, len(joints) - 1, min(len(joints), edges + 1))).astype(int)
    places = kept[np.minimum(np.arange(edges + 1), len(kept) - 1)]
    return attitudes[places], joints[places]


@Kernel
def edge_table(scene: Scene, attitudes: Array, joints: Array, clearance: Array, gate: Array) -> Array:
    """(4, m) margin, slack, cost and the steps of all motions of the edges between nodes.

    Args:
        scene: the problem.
        attitudes: (m + 1, 3, 3).
        joints: (m + 1, 2n) rad.
        clearance: rad wanted.
        gate: see `motions.computed_once`.
    """
    q, j = sweeps.nodes(scene, attitudes, joints)
    costs, every = sweeps.edge_costs(scene, q, j)
    wanted = sweeps.wanted_clearance(scene, q, j, costs, clearance)
    return jnp.stack([*sweeps.edge_margins(scene, q, j, wanted, gate), costs, every])


@Kernel
def _descended(scene: Scene, attitudes: Array, joints: Array, clearance: Array, gate: Array) -> Array:
    """One descent, and its nodes at equal costs.

    Args:
        scene: the problem.
        attitudes: (m + 1, 3, 3) of the nodes to start from, the last repeated as often as need be.
        joints: (m + 1, 2n) rad.
        clearance: rad wanted.
        gate: see `motions.computed_once`.

    Returns:
        (m + 2, 9 + 2n) attitude and joints of each node, the last repeated; in the last row the number of
        edges.
    """
    q, j = sweeps.nodes(scene, attitudes, joints)
    costs, _ = sweeps.edge_costs(scene, q, j)
    length = jnp.sum(costs)
    q, j = sweeps.evenly(q, j, costs, band.PIECES, band.PIECES + 1)
    problem = band.make_problem(scene, length, clearance)
    q, j = descent.descend(problem, q, j, gate, ITERATIONS)
    j = jnp.clip(j, -problem.limits[:, None], problem.limits[:, None])

    costs, _ = sweeps.edge_costs(scene, q, j)
    edges = attitudes.shape[0] - 1
    count = jnp.clip(jnp.ceil(jnp.sum(costs) - ARRIVED), 1, edges)
    q, j = sweeps.evenly(q, j, costs, count, edges + 1)
    since = quaternion.to_matrix(q.T)
    turned = jnp.sum(jnp.asarray(scene.start_attitude)[:, :, None] * since[:, None], axis=2)
    rows = jnp.concatenate([turned.reshape(-1, 9), j.T], axis=-1)
    return jnp.concatenate([rows, jnp.full((1, rows.shape[1]), count)])
