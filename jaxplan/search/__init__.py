"""Step 2: a sequence of clear states from start to goal. Every planner has the same call and result."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from jaxplan.scenario.model import SearchSettings
from jaxplan.search import mha, mha_paper, rrt_connect, rrt_star, wastar
from jaxplan.search.barriers import Barrier, find_barrier, most_obstructive
from jaxplan.search.lockstep import Steps, alone, together
from jaxplan.search.problem import Scene, SearchResult, alone_and_grouped, derived_seed, make_scene

Planner = Callable[[Scene, SearchSettings], SearchResult]

_SEARCHES: Mapping[str, Callable[[Scene, SearchSettings], Steps[SearchResult]]] = {
    "mha": mha.search,
    "mha-paper": mha_paper.search,
    "wastar": wastar.search,
    "rrt_star": rrt_star.search,
    "rrt_connect": rrt_connect.search,
}


def _search(method: str, scene: Scene, settings: SearchSettings) -> SearchResult:
    return alone(scene, _SEARCHES[method](scene, settings))


PLANNERS: Mapping[str, Planner] = {method: partial(_search, method) for method in _SEARCHES}
"""By name; a planner searches a scene with some settings, of which `method` does not count."""


def search_batch(
    scenes: Sequence[Scene], settings: Sequence[SearchSettings], spent: np.ndarray | None = None
) -> list[SearchResult]:
    """Search many scenes in lockstep, each by the method of its settings.

    Args:
        scenes: the problems; those of equal padded sizes share their kernel calls.
        settings: of each search. A time limit stands for its share: it ends a search after as many times
            that long as there are scenes.
        spent: see `lockstep.together`.

    Returns:
        The same answers as one by one, on the CPU to the last bit, as long as no time limit ends a search.

    Raises:
        ValueError: if there are not as many settings as scenes.
    """
    if len(settings) != len(scenes):
        raise ValueError(f"settings: must be one a scene, {len(scenes)}, not {len(settings)}")
    shared = [replace(one, time_limit=one.time_limit * len(scenes)) for one in settings]
    searches = [_SEARCHES[one.method](scene, one) for scene, one in zip(scenes, shared, strict=True)]
    return together(scenes, searches, spent)


__all__ = [
    "PLANNERS",
    "Barrier",
    "Planner",
    "Scene",
    "SearchResult",
    "alone_and_grouped",
    "derived_seed",
    "find_barrier",
    "make_scene",
    "most_obstructive",
    "search_batch",
]
