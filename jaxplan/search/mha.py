"""The default planner: what is quickest first, then multi-heuristic A* and trees in a race.

1. The straight motion to the goal.
2. What an elastic band makes of it (`smoothing`): near the shortest, and often all that is needed.
3. Multi-heuristic A* (`multi_heuristic`, with the moves and heuristics of `mha_rules`), which tries the
   straight motion again from every child (analytic expansion) and, from time to time, expands any node,
   whatever its key. All edges are checked whole.
4. Where that takes long, RRT-Connect takes turns with it until one of the two has a path.

The path is smoothed. If it is a long way round, or if it is asked for, 3 and 4 are then repeated with other
random moves, for paths that pass the zones on other sides, and the shortest is kept.
"""

from dataclasses import replace
from itertools import count

import numpy as np

from jaxplan.model.path import Path
from jaxplan.model.scenario import SearchSettings
from jaxplan.model.status import Status
from jaxplan.runtime.stopwatch import working_time
from jaxplan.search.lockstep import Steps
from jaxplan.search.mha_rules import QUEUES, rules
from jaxplan.search.multi_heuristic import Search, try_straight
from jaxplan.search.problem import Scene, SearchResult, derived_seed
from jaxplan.search.race import race
from jaxplan.search.rrt import Space
from jaxplan.search.rrt_connect import connect
from jaxplan.search.smoothing import Bend, bend_straight, smooth

# No improvement is looked for of a path within this factor of the straight motion's length.
SHORT_ENOUGH = 1.001
# A bent straight motion within this factor of its length is taken without a search.
BENT_ENOUGH = 1.05
# Instead of a path beyond this factor of its length others are looked for, so many times the factor, and not
# for long: which way round zones a search goes first is a matter of luck.
DETOUR, DETOUR_LOOKS, DETOUR_EXPANSIONS = 1.25, 3, 48
# Expansions after which trees join in.
HEAD_START = 48


def search(scene: Scene, settings: SearchSettings) -> Steps[SearchResult]:
    """Search a path with the default planner.

    Args:
        scene: the problem.
        settings: see `SearchSettings`.

    Returns:
        OK with a path whose every edge is clear, or why there is none.
    """
    begin = working_time()
    straight = yield from try_straight(scene, settings)
    if straight is not None:
        return _without_expansion(straight)
    shortest = scene.straight_steps
    bent = yield from bend_straight(scene, settings)
    enough = (SHORT_ENOUGH if settings.improvements else BENT_ENOUGH) * shortest
    clear = bent if bent is not None and bent.clear else None
    if clear is not None and clear.length <= enough:
        return _without_expansion(clear.path(scene))
    best = yield from _search(scene, settings, bent)
    if clear is not None and best.path is None:
        best = replace(best, status=Status.OK, path=clear.path(scene))
    for attempt in count(1):
        left = settings.time_limit - (working_time() - begin)
        spare = settings.max_expansions - best.expansions
        if best.path is None or spare <= 0 or left <= 0:
            break
        length = best.path.length
        if attempt > settings.improvements:
            spare = min(spare, DETOUR_EXPANSIONS)
            if length <= DETOUR * shortest or attempt * shortest > DETOUR_LOOKS * length:
                break
        elif length <= SHORT_ENOUGH * shortest:
            break
        seed = derived_seed(settings.seed, 0, attempt)
        effort = replace(settings, seed=seed, max_expansions=spare, time_limit=left)
        again = yield from _search(scene, effort, bent)
        shorter = again.path is not None and again.path.length < best.path.length
        best = replace(
            best,
            path=again.path if shorter else best.path,
            expansions=best.expansions + again.expansions,
            queue_expansions=tuple(np.add(best.queue_expansions, again.queue_expansions).tolist()),
        )
    return best


def _without_expansion(path: Path) -> SearchResult:
    return SearchResult(status=Status.OK, path=path, expansions=0, queue_expansions=(0,) * (QUEUES + 1))


def _search(scene: Scene, settings: SearchSettings, bent: Bend | None) -> Steps[SearchResult]:
    """Multi-heuristic A*, from some point on in a race with trees, and the path smoothed.

    Args:
        scene: the problem.
        settings: effort and seed.
        bent: what has become of the straight motion.
    """
    for_trees = max(settings.max_expansions - HEAD_START, 0) // 2
    informed = Search(
        scene, replace(settings, max_expansions=settings.max_expansions - for_trees), rules(scene)
    )
    trees = Space(scene, replace(settings, max_expansions=for_trees))
    answer = yield from race(informed.run(), connect(trees), head_start=HEAD_START)
    path = answer.path
    if path is not None:
        path = yield from smooth(scene, settings, path, bent)
    counts = (*informed.counts, trees.extensions)
    return SearchResult(status=answer.status, path=path, expansions=sum(counts), queue_expansions=counts)
