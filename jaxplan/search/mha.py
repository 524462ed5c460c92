"""The default planner: what is quickest first, then multi-heuristic A* and trees in a race.

1. The straight motion to the goal.
2. An elastic band that descends from it (`smoothing`): near the shortest, and often all that is needed.
3. Multi-heuristic A* (`multi_heuristic`, with the moves and heuristics of `mha_rules`), which tries the
   straight motion again from every child (analytic expansion) and, from time to time, expands any node,
   whatever its key. All edges are checked whole.
4. Where that takes long, RRT-Connect takes turns with it until one of the two has a path.

Each is a stage of all scenes that the one before has not settled. The paths that are searched are smoothed.
If one is a long way round, or if it is asked for, 3 and 4 are then repeated with other random moves, for
paths that pass the zones on other sides, and the shortest is kept.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import count

import numpy as np

from jaxplan.model.path import Path
from jaxplan.model.scenario import SearchSettings
from jaxplan.model.status import Status
from jaxplan.runtime.stopwatch import working_time
from jaxplan.search.calls import Scenes, completed, picked
from jaxplan.search.mha_rules import QUEUES, rules
from jaxplan.search.multi_heuristic import Search, straight_paths
from jaxplan.search.problem import Scene, SearchResult, derived_seed
from jaxplan.search.race import Race
from jaxplan.search.rrt import Space
from jaxplan.search.rrt_connect import Connect
from jaxplan.search.smoothing import Band, smooth_results, straight_bands

# No improvement is looked for of a path within this factor of the straight motion's length.
SHORT_ENOUGH = 1.001
# A clear band from the straight motion within this factor of its length is taken without a search.
BAND_ENOUGH = 1.05
# Instead of a path beyond this factor of its length others are looked for, so many times the factor, and not
# for long: which way round zones a search goes first is a matter of luck.
DETOUR, DETOUR_LOOKS, DETOUR_EXPANSIONS = 1.25, 3, 48
# Expansions after which trees join in.
HEAD_START = 48

Bands = Sequence[Band | None]


def search(scenes: Scenes, settings: Sequence[SearchSettings]) -> list[SearchResult]:
    """Search a path of each scene with the default planner.

    Args:
        scenes: the problems.
        settings: of each.

    Returns:
        OK with a path whose every edge is clear, or why there is none.
    """
    begin = working_time()
    straight = [_without_expansion(path) for path in straight_paths(scenes, settings)]

    def past_zones(rest: list[int]) -> list[SearchResult]:
        return _past_zones(scenes.part(rest), picked(settings, rest), begin)

    return completed(straight, past_zones)


def _past_zones(scenes: Scenes, settings: Sequence[SearchSettings], begin: float) -> list[SearchResult]:
    """Paths where the straight motion is not clear: bands that are nearly as short, or searched paths."""
    bands = straight_bands(scenes, settings)
    near = [_near_straight(*one) for one in zip(scenes.scenes, settings, bands, strict=True)]

    def searched(rest: list[int]) -> list[SearchResult]:
        return _searched(scenes.part(rest), picked(settings, rest), picked(bands, rest), begin)

    return completed(near, searched)


def _near_straight(scene: Scene, settings: SearchSettings, band: Band | None) -> SearchResult | None:
    """A band as the result, if it is clear and nearly as short as the straight motion."""
    enough = (SHORT_ENOUGH if settings.improvements else BAND_ENOUGH) * scene.straight_steps
    near = band is not None and band.clear and band.length <= enough
    return _without_expansion(band.path(scene)) if near and band is not None else None


def _without_expansion(path: Path | None) -> SearchResult | None:
    if path is None:
        return None
    return SearchResult(status=Status.OK, path=path, expansions=0, queue_expansions=(0,) * (QUEUES + 1))


def _searched(
    scenes: Scenes, settings: Sequence[SearchSettings], bands: Bands, begin: float
) -> list[SearchResult]:
    """The shortest path of a few searches of each scene; a clear band where none of them finds one."""
    best = _race(scenes, settings, bands)
    for number, (scene, band) in enumerate(zip(scenes.scenes, bands, strict=True)):
        if best[number].path is None and band is not None and band.clear:
            best[number] = replace(best[number], status=Status.OK, path=band.path(scene))
    for attempt in count(1):
        spent = working_time() - begin
        efforts = {
            number: effort
            for number, scene in enumerate(scenes.scenes)
            if (effort := _further_effort(scene, settings[number], best[number], attempt, spent)) is not None
        }
        if not efforts:
            break
        again = list(efforts)
        found = _race(scenes.part(again), list(efforts.values()), picked(bands, again))
        for number, result in zip(again, found, strict=True):
            best[number] = _shorter(best[number], result)
    return best


def _further_effort(
    scene: Scene, settings: SearchSettings, best: SearchResult, attempt: int, spent: float
) -> SearchSettings | None:
    """Settings of a further search for a shorter path, None where the best one is left as it is.

    Args:
        scene: the problem.
        settings: of the whole.
        best: the result so far.
        attempt: number of the further search, from 1.
        spent: s, so far.
    """
    left, spare = settings.time_limit - spent, settings.max_expansions - best.expansions
    if best.path is None or spare <= 0 or left <= 0:
        return None
    length, shortest = best.path.length, scene.straight_steps
    if attempt <= settings.improvements:
        if length <= SHORT_ENOUGH * shortest:
            return None
    elif length <= DETOUR * shortest or attempt * shortest > DETOUR_LOOKS * length:
        return None
    else:
        spare = min(spare, DETOUR_EXPANSIONS)
    seed = derived_seed(settings.seed, 0, attempt)
    return replace(settings, seed=seed, max_expansions=spare, time_limit=left)


def _shorter(best: SearchResult, found: SearchResult) -> SearchResult:
    """The result with the shorter path, and the expansions of both."""
    assert best.path is not None
    shorter = found.path is not None and found.path.length < best.path.length
    return replace(
        best,
        path=found.path if shorter else best.path,
        expansions=best.expansions + found.expansions,
        queue_expansions=tuple(np.add(best.queue_expansions, found.queue_expansions).tolist()),
    )


def _race(scenes: Scenes, settings: Sequence[SearchSettings], bands: Bands) -> list[SearchResult]:
    """Multi-heuristic A*, from some point on in a race with trees, and the paths smoothed.

    Args:
        scenes: the problems.
        settings: effort and seed of each.
        bands: those that descended from the straight motions.
    """
    runs = [_Race(*one) for one in zip(scenes.scenes, settings, strict=True)]
    scenes.run(runs)
    return smooth_results(scenes, settings, [run.result() for run in runs], bands)


class _Race(Race):
    """Multi-heuristic A* and trees, with half of the expansions after the head start for the trees."""

    def __init__(self, scene: Scene, settings: SearchSettings) -> None:
        for_trees = max(settings.max_expansions - HEAD_START, 0) // 2
        own = replace(settings, max_expansions=settings.max_expansions - for_trees)
        self.informed = Search(scene, own, rules(scene))
        self.trees = Space(scene, replace(settings, max_expansions=for_trees))
        super().__init__(self.informed, Connect(self.trees), head_start=HEAD_START)

    def result(self) -> SearchResult:
        """The result of the race, with the expansions of both."""
        counts = (*self.informed.counts, self.trees.extensions)
        return replace(super().result(), expansions=sum(counts), queue_expansions=counts)
