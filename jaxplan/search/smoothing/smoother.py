"""Path smoothing after the search: bands descend from the straight motion, and from the path cut short.

Elastic bands that descend from paths: nodes in, nodes and what is to be known of their edges out.

What comes out is cut anew into equal edges of at most one step, and its margins are taken of the attitudes
and joints that are handed out, by the exact bound of `jaxplan.model.path`.

The straight motion is the first start, zones or not: the descent often pushes it out of them, and to a
shorter way than the search has found. Where that fails, or is not near the shortest there can be, the other
start is the path itself without what can be left out. What comes out of a descent counts only if every edge
is clear, by as much as is wanted or by as much as in the path that was given.
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
from jaxplan.search.calls import Call, Kernel, Scenes, completed, picked
from jaxplan.search.problem import Scene, SearchResult
from jaxplan.search.smoothing import band, sweeps
from jaxplan.search.smoothing.shortcut import ARRIVED, edge_rotations, make_path, shortcuts

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
    q, j = band.descend(problem, q, j, gate, ITERATIONS)
    j = jnp.clip(j, -problem.limits[:, None], problem.limits[:, None])

    costs, _ = sweeps.edge_costs(scene, q, j)
    edges = attitudes.shape[0] - 1
    count = jnp.clip(jnp.ceil(jnp.sum(costs) - ARRIVED), 1, edges)
    q, j = sweeps.evenly(q, j, costs, count, edges + 1)
    since = quaternion.to_matrix(q.T)
    turned = jnp.sum(jnp.asarray(scene.start_attitude)[:, :, None] * since[:, None], axis=2)
    rows = jnp.concatenate([turned.reshape(-1, 9), j.T], axis=-1)
    return jnp.concatenate([rows, jnp.full((1, rows.shape[1]), count)])


# A length within this factor of the straight motion's is not worth another start.
NEAR_SHORTEST = 1.01
# A path may be longer than the one given by this factor, and only where it is better in score.
LENGTHENING = 1.005


def straight_bands(scenes: Scenes, settings: Sequence[SearchSettings]) -> list[Band | None]:
    """Elastic bands that descend from the straight motions, which may be the whole answer.

    Args:
        scenes: the problems; start and goal of none are the same.
        settings: of each; they give the clearance.
    """
    starts = [
        (
            np.stack([scene.start_attitude, scene.goal_attitude]),
            np.stack([scene.start_joints, scene.goal_joints]),
        )
        for scene in scenes.scenes
    ]
    edges = [edges_for(np.inf, scene) for scene in scenes.scenes]
    return descended_bands(scenes, starts, [own.clearance for own in settings], edges)


def smooth_results(
    scenes: Scenes,
    settings: Sequence[SearchSettings],
    results: Sequence[SearchResult],
    bands: Sequence[Band | None] | None = None,
) -> list[SearchResult]:
    """Results with their paths, where they have one, made shorter and smoother; arguments as of `smooth`."""
    found = [number for number, result in enumerate(results) if result.path is not None]
    paths = [result.path for result in results if result.path is not None]
    known = None if bands is None else picked(bands, found)
    smoothed = dict(
        zip(found, smooth(scenes.part(found), picked(settings, found), paths, known), strict=True)
    )
    return [replace(result, path=smoothed.get(number)) for number, result in enumerate(results)]


def smooth(
    scenes: Scenes,
    settings: Sequence[SearchSettings],
    paths: Sequence[Path],
    bands: Sequence[Band | None] | None = None,
) -> list[Path]:
    """Paths between the same ends that are shorter and smoother, or the paths themselves.

    Args:
        scenes: the problems.
        settings: of each; its clearance is wanted beyond the zones.
        paths: of each from start to goal, at least one node.
        bands: `straight_bands`, if they are known already.

    Returns:
        Paths with edges of about the same cost, at most one step, that are clear by the exact bound: with
        the wanted clearance, which tapers to nothing at both ends as in the search; or, where the path given
        has edges with less than that, with at least what the worst of these has. In steps one is shorter,
        or longer by up to 0.5 % where platform and joints travel less for it. It is the path given if that
        is straight, or if no better one was found.
    """

    def shorter(rest: list[int]) -> list[Path]:
        some, own = scenes.part(rest), picked(settings, rest)
        known = straight_bands(some, own) if bands is None else picked(bands, rest)
        return _smooth_detours(some, own, picked(paths, rest), known)

    straight = [
        path if _is_straight(scene, path) else None for scene, path in zip(scenes.scenes, paths, strict=True)
    ]
    return completed(straight, shorter)


def _smooth_detours(
    scenes: Scenes,
    settings: Sequence[SearchSettings],
    paths: Sequence[Path],
    bands: Sequence[Band | None],
) -> list[Path]:
    """The best of paths that are not straight, of bands, and of what descends from the paths cut short."""
    best = [_Best(*one) for one in zip(scenes.scenes, settings, paths, strict=True)]
    _enter(scenes, best, bands)
    far = [number for number, one in enumerate(best) if not one.near_shortest]
    some, clearances = scenes.part(far), [settings[number].clearance for number in far]
    own = picked(best, far)
    edges = [edges_for(LENGTHENING * one.path.length, one.scene) for one in own]
    kept = shortcuts(some, [one.path for one in own], clearances)
    starts = [
        (one.path.attitudes[nodes], one.path.joints[nodes]) for one, nodes in zip(own, kept, strict=True)
    ]
    descended = descended_bands(some, starts, clearances, edges)
    _enter(some, own, descended)
    # Often a little more descent is all that lacks.
    further = {
        number: band for number, band in enumerate(descended) if own[number].band is None and band is not None
    }
    again = list(further)
    starts = [(band.attitudes, band.joints) for band in further.values()]
    some = some.part(again)
    last = descended_bands(some, starts, picked(clearances, again), picked(edges, again))
    _enter(some, picked(own, again), last)
    return [one.path if one.band is None else one.band.path(one.scene) for one in best]


class _Best:
    """The best band so far, and the path that it must beat.

    Attributes:
        scene: the problem.
        path: the path that is to be smoothed.
        clearance: rad wanted.
        score: of the best so far, see `score`.
        band: None as long as the path itself is the best.
    """

    def __init__(self, scene: Scene, settings: SearchSettings, path: Path) -> None:
        self.scene, self.path, self.clearance = scene, path, settings.clearance
        self.score = score(path.length, _travel(scene, path))
        self.band: Band | None = None

    @property
    def near_shortest(self) -> bool:
        """Whether there is a band that another start is not worth while beside."""
        return self.band is not None and self.band.length <= NEAR_SHORTEST * self.scene.straight_steps

    def beaten_by(self, band: Band | None) -> bool:
        """Whether a band is better, if it is as clear as it must be."""
        if band is None or band.length > LENGTHENING * self.path.length or band.score >= self.score:
            return False
        return bool(np.all(band.margins >= 0))

    def take(self, band: Band) -> None:
        """Take a band for the best."""
        self.band, self.score = band, band.score

    def edge_call(self) -> Call:
        """The call that tells of the edges of the path, see `as_clear`."""
        nodes = padded(self.path.attitudes, self.path.joints, EDGES)
        return Call(edge_table, (*nodes, self.clearance))

    def as_clear(self, band: Band, answer: np.ndarray) -> bool:
        """Whether what lacks of the wanted clearance on a band lacks on the path, too."""
        margins, slacks = answer[:2, : self.path.edges]
        floor = np.min(margins[~(slacks >= 0)], initial=np.inf)
        return bool(np.all((band.slacks >= 0) | (band.margins >= max(floor, 0))))


def _enter(scenes: Scenes, best: Sequence[_Best], bands: Sequence[Band | None]) -> None:
    """Take each band that is better than the best so far, and as clear as wanted or as the path given."""
    unsure: list[tuple[int, Band]] = []
    for number, (one, found) in enumerate(zip(best, bands, strict=True)):
        if found is None or not one.beaten_by(found):
            continue
        if found.clear:
            one.take(found)
        elif one.path.edges <= EDGES:  # longer paths would compile kernels of their own
            unsure.append((number, found))
    numbers = [number for number, _ in unsure]
    answers = scenes.part(numbers).answers([best[number].edge_call() for number in numbers])
    for (number, found), answer in zip(unsure, answers, strict=True):
        if best[number].as_clear(found, answer):
            best[number].take(found)


def _is_straight(scene: Scene, path: Path) -> bool:
    """Whether the nodes lie on the straight motion, at the places that their costs say."""
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


def _travel(scene: Scene, path: Path) -> float:
    """Steps of the platform and of all joints, added up."""
    joints = np.abs(np.diff(path.joints, axis=0)) / scene.joint_steps
    return float(np.sum(edge_rotations(path.attitudes)) / scene.attitude_step + np.sum(joints))
