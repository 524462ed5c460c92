"""Path smoothing after the search: bands descend from the straight motion, and from the path cut short.

The straight motion is the first start, zones or not: the descent often pushes it out of them, and to a
shorter way than the search has found. Where that fails, or is not near the shortest there can be, the other
start is the path itself without what can be left out. What comes out of a descent counts only if every edge
is clear, by as much as is wanted or by as much as in the path that was given.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jaxplan.model.path import Path
from jaxplan.model.scenario import SearchSettings
from jaxplan.search.calls import Call, Scenes, completed, picked
from jaxplan.search.corners import ARRIVED, edge_rotations
from jaxplan.search.problem import Scene, SearchResult
from jaxplan.search.smoothing.bands import (
    EDGES,
    Band,
    descended_bands,
    edge_table,
    edges_for,
    padded,
    score,
)
from jaxplan.search.smoothing.shortcut import shortcuts

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
        score: of the best so far, see `bands.score`.
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
    for number, (one, band) in enumerate(zip(best, bands, strict=True)):
        if band is None or not one.beaten_by(band):
            continue
        if band.clear:
            one.take(band)
        elif one.path.edges <= EDGES:  # longer paths would compile kernels of their own
            unsure.append((number, band))
    numbers = [number for number, _ in unsure]
    answers = scenes.part(numbers).answers([best[number].edge_call() for number in numbers])
    for (number, band), answer in zip(unsure, answers, strict=True):
        if best[number].as_clear(band, answer):
            best[number].take(band)


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
