"""Path smoothing after the search: shorter paths with smoother nodes, as clear as before.

Elastic bands (`jaxplan.search.elastic_band`) descend from paths. The resulting bands are cut anew into equal
edges of at most one step, whose margins are computed from the attitudes and joints that are returned, edge by
edge.

The straight motion is the first start, even through zones: the descent often pushes it out of them, and to a
shorter path than the search has found. Where that fails, or is not near the shortest there can be, the other
start is the path itself, cut short where that is clear. The result of a descent counts only if every edge is
clear, by as much as is wanted or by as much as in the path that was given.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry import quaternion
from jaxplan.model.path import Path
from jaxplan.model.scenario import SearchSettings
from jaxplan.runtime.batching import padded_count
from jaxplan.search import elastic_band as elastic
from jaxplan.search.kernel_calls import Call, Kernel, Scenes, picked
from jaxplan.search.paths import (
    ARRIVED,
    edge_costs,
    edge_rotations,
    edge_table,
    edges_of,
    evenly,
    make_path,
    path_states,
    shortcuts,
)
from jaxplan.search.scene import Scene, SearchResult

ITERATIONS = 6
# Paths are compared by their length plus this share of the steps of platform and joints added up.
TRAVEL_SHARE = 0.05
# A path longer than so many times the straight motion is not looked for if it would need larger kernels.
LONGEST = 1.5
EDGES = 64  # paths of up to this many share their compiled kernels
# A length within this factor of the straight motion's is not worth another start.
NEAR_SHORTEST = 1.01
# A path may be longer than the one given by this factor, and only where it is better in score.
LENGTHENING = 1.005

Nodes = tuple[np.ndarray, np.ndarray]
"""Attitudes (k + 1, 3, 3) and joints (k + 1, 2n), rad."""


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """An elastic band after its descent, with m edges.

    Attributes:
        attitudes: (m + 1, 3, 3) body to inertial; the ends are those of the path it started from.
        joints: (m + 1, 2n) rad.
        margins: (m,) lower bound of the margin on each edge, rad, positive where constraints hold.
        slacks: (m,) likewise, less the clearance that is wanted there.
        length: steps.
        score: steps, by which bands are compared: the length plus `TRAVEL_SHARE` times the sum over the
            motions of platform and joints.
    """

    attitudes: np.ndarray
    joints: np.ndarray
    margins: np.ndarray
    slacks: np.ndarray
    length: float
    score: float

    @property
    def clear(self) -> bool:
        """Whether every edge keeps the wanted clearance."""
        return bool(np.all(self.slacks >= 0))

    def path(self, scene: Scene) -> Path:
        """Return the path along the nodes of the band."""
        return make_path(scene, self.attitudes, self.joints)


def descended_bands(
    scenes: Scenes, starts: Sequence[Nodes], clearances: Sequence[float], lengths: Sequence[float]
) -> list[Band | None]:
    """Let a band of each scene descend from a path.

    Args:
        scenes: the problems.
        starts: the path of each, at least two nodes.
        clearances: clearance wanted in each, rad.
        lengths: steps of the longest path that is looked for in each.

    Returns:
        For each scene the band after its descent, clear or not; None where it would need edges of more than a
        step.
    """
    calls = []
    for scene, start, clearance, length in zip(scenes.scenes, starts, clearances, lengths, strict=True):
        most = max(EDGES, padded_count(math.ceil(min(length, LONGEST * scene.straight_steps))))
        states = path_states(scene, *start)
        costs, _ = edge_costs(scene, states)
        nodes = evenly(states, costs, elastic.PIECES, elastic.PIECES + 1)
        calls.append(Call(_descend_band, (nodes, np.sum(costs), clearance, np.zeros(most))))
    return [_read_band(*one) for one in zip(starts, scenes.answers(calls), strict=True)]


def _read_band(start: Nodes, answer: np.ndarray) -> Band | None:
    """Read the band in an answer of `_descend_band`, with the exact ends of `start`.

    The result is None if an edge is too long.
    """
    if not np.isfinite(answer[-1, 0]):
        return None
    count = int(answer[-1, 0])
    margins, slacks, costs, every = answer[:count, -4:].T
    if not np.all(costs <= 1 + ARRIVED):
        return None
    attitudes, joints = answer[: count + 1, :9].reshape(-1, 3, 3).copy(), answer[: count + 1, 9:-4].copy()
    for end in (0, -1):
        attitudes[end], joints[end] = start[0][end], start[1][end]
    length = float(np.sum(costs))
    return Band(attitudes, joints, margins, slacks, length, length + TRAVEL_SHARE * float(np.sum(every)))


def padded(attitudes: np.ndarray, joints: np.ndarray, edges: int) -> Nodes:
    """Return nodes for exactly `edges` edges.

    The last node is repeated as needed; of too many nodes some are picked evenly.
    """
    kept = np.rint(np.linspace(0, len(joints) - 1, min(len(joints), edges + 1))).astype(int)
    places = kept[np.minimum(np.arange(edges + 1), len(kept) - 1)]
    return attitudes[places], joints[places]


@Kernel
def _descend_band(scene: Scene, states: Array, length: Array, clearance: Array, edges: Array) -> Array:
    """Return the band after one descent, cut at equal costs, with margins, slacks and costs of its edges.

    Args:
        scene: the problem.
        states: (PIECES + 1, 4 + 2n) of a path, at equal costs.
        length: steps of the path.
        clearance: rad wanted.
        edges: (m,) array of which only the length m counts: at most m edges are made.

    Returns:
        (m + 2, 9 + 2n + 4). Each row but the last has the attitude and joints of a node, the last node being
        repeated, and `edges_of` for the edge that begins there; the last row has the number of edges.
    """
    problem = elastic.make_problem(scene, length, clearance)
    q, j = elastic.descend(problem, states[:, :4].T, states[:, 4:].T, ITERATIONS)
    j = jnp.clip(j, *problem.ranges[..., None])

    states, most = jnp.concatenate([q, j]).T, edges.shape[0]
    costs, _ = edge_costs(scene, states)
    count = jnp.clip(jnp.ceil(jnp.sum(costs) - ARRIVED), 1, most)
    states = evenly(states, costs, count, most + 1)
    since = quaternion.to_matrix(states[:, :4])
    turned = jnp.sum(jnp.asarray(scene.start_attitude)[:, :, None] * since[:, None], axis=2)
    table = edges_of(scene, states, clearance).T
    rows = jnp.concatenate([turned.reshape(-1, 9), states[:, 4:], jnp.pad(table, [(0, 1), (0, 0)])], axis=-1)
    return jnp.concatenate([rows, jnp.full((1, rows.shape[1]), count)])


def straight_bands(scenes: Scenes, settings: Sequence[SearchSettings]) -> list[Band | None]:
    """Return the elastic bands that descend from the straight motions of scenes, see `descended_bands`.

    Args:
        scenes: the problems; in none of them start and goal are the same.
        settings: those of each search; they give the clearance.
    """
    starts = [
        (
            np.stack([scene.start_attitude, scene.goal_attitude]),
            np.stack([scene.start_joints, scene.goal_joints]),
        )
        for scene in scenes.scenes
    ]
    return descended_bands(scenes, starts, [own.clearance for own in settings], [np.inf] * len(starts))


def smooth_results(
    scenes: Scenes,
    settings: Sequence[SearchSettings],
    results: Sequence[SearchResult],
    bands: Sequence[Band | None] | None = None,
) -> list[SearchResult]:
    """Return results with shorter and smoother paths between the same ends, where they have a path.

    Args:
        scenes: the problems.
        settings: those of each search; the clearance is wanted beyond the zones.
        results: the result of each search.
        bands: `straight_bands`, if they are known already; None to compute them.

    Returns:
        Results whose paths have edges of about the same cost, at most one step, that are clear by the exact
        bound: with the wanted clearance, which tapers to nothing at both ends as in the search; or, where the
        path given has edges with less than that, with at least the clearance of the worst of these. In steps
        a new path is shorter than the given one, or longer by up to 0.5 % where platform and joints travel
        less for it. The given path is kept if it is straight, or if no better one was found.
    """
    detours = {
        number: result.path
        for number, (scene, result) in enumerate(zip(scenes.scenes, results, strict=True))
        if result.path is not None and not _is_straight(scene, result.path)
    }
    smoothed = list(results)
    if detours:
        numbers = list(detours)
        some, own = scenes.part(numbers), picked(settings, numbers)
        known = straight_bands(some, own) if bands is None else picked(bands, numbers)
        clearances = [setting.clearance for setting in own]
        paths = _smooth_detours(some, clearances, list(detours.values()), known)
        for number, path in zip(numbers, paths, strict=True):
            smoothed[number] = replace(results[number], path=path)
    return smoothed


def _smooth_detours(
    scenes: Scenes, clearances: Sequence[float], paths: Sequence[Path], bands: Sequence[Band | None]
) -> list[Path]:
    """Return the best of each scene's path, its band, and the bands that descend from the path cut short.

    Args:
        scenes: the problems.
        clearances: clearance wanted in each, rad.
        paths: the path of each, not straight.
        bands: the band of each from `straight_bands`.
    """
    best: list[Band | None] = [None] * len(paths)
    _keep_better_bands(scenes, clearances, paths, best, bands, range(len(paths)))
    far = [
        number
        for number, (scene, own) in enumerate(zip(scenes.scenes, best, strict=True))
        if own is None or own.length > NEAR_SHORTEST * scene.straight_steps
    ]
    kept = shortcuts(scenes.part(far), picked(paths, far), picked(clearances, far))
    starts = [
        (paths[number].attitudes[nodes], paths[number].joints[nodes])
        for number, nodes in zip(far, kept, strict=True)
    ]
    for _ in range(2):  # often a little more descent suffices
        lengths = [LENGTHENING * paths[number].length for number in far]
        descended = descended_bands(scenes.part(far), starts, picked(clearances, far), lengths)
        _keep_better_bands(scenes, clearances, paths, best, descended, far)
        further = [
            (number, band)
            for number, band in zip(far, descended, strict=True)
            if best[number] is None and band is not None
        ]
        far, starts = [number for number, _ in further], [(one.attitudes, one.joints) for _, one in further]
    return [
        path if band is None else band.path(scene)
        for scene, path, band in zip(scenes.scenes, paths, best, strict=True)
    ]


def _keep_better_bands(
    scenes: Scenes,
    clearances: Sequence[float],
    paths: Sequence[Path],
    best: list[Band | None],
    bands: Sequence[Band | None],
    numbers: Sequence[int],
) -> None:
    """Put into `best` those bands that are better, and as clear as wanted or as the path given.

    Args:
        scenes: the problems.
        clearances: clearance wanted in each, rad.
        paths: the path of each, to be smoothed.
        best: the best band of each, None as long as the path itself is the best; changed in place.
        bands: bands of some scenes, None for a scene without one.
        numbers: the numbers of these scenes.
    """
    unsure: list[tuple[int, Band]] = []
    for number, found in zip(numbers, bands, strict=True):
        path, own = paths[number], best[number]
        if found is None or found.length > LENGTHENING * path.length or not np.all(found.margins >= 0):
            continue
        if found.score >= (_path_score(scenes.scenes[number], path) if own is None else own.score):
            continue
        if found.clear:
            best[number] = found
        elif path.edges <= EDGES:  # longer paths would compile kernels of their own
            unsure.append((number, found))
    calls = [
        Call(edge_table, (*padded(paths[number].attitudes, paths[number].joints, EDGES), clearances[number]))
        for number, _ in unsure
    ]
    answers = scenes.part([number for number, _ in unsure]).answers(calls)
    for (number, found), answer in zip(unsure, answers, strict=True):
        margins, slacks = answer[:2, : paths[number].edges]
        floor = np.min(margins[~(slacks >= 0)], initial=np.inf)
        if np.all((found.slacks >= 0) | (found.margins >= max(floor, 0))):
            best[number] = found


def _path_score(scene: Scene, path: Path) -> float:
    """Return the score of a path as in `Band`, steps: its length plus a share of all motions added up."""
    joints = np.abs(np.diff(path.joints, axis=0)) / scene.joint_steps
    travel = np.sum(edge_rotations(path.attitudes)) / scene.attitude_step + np.sum(joints)
    return path.length + TRAVEL_SHARE * float(travel)


def _is_straight(scene: Scene, path: Path) -> bool:
    """Tell whether the nodes lie on the straight motion, each as far along it as the edges' costs say."""
    straight = scene.straight_steps
    if straight <= ARRIVED:
        return True
    if path.length > straight + ARRIVED:
        return False
    passed = np.concatenate([[0.0], np.cumsum(path.edge_costs)])[:, None] / straight
    joints = scene.start_joints + passed * (scene.goal_joints - scene.start_joints)
    turned = np.sum(edge_rotations(path.attitudes))
    return bool(
        np.all(np.abs(path.joints - joints) <= ARRIVED)
        and turned <= np.linalg.norm(scene.goal_coordinates) + ARRIVED
    )
