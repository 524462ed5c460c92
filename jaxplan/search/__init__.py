"""Step 2: a sequence of clear states from start to goal. Every planner has the same call and result."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from jaxplan.model.scenario import SEARCH_METHODS, SearchSettings
from jaxplan.model.status import Status
from jaxplan.search import mha, mha_paper, rrt_connect, rrt_star, wastar
from jaxplan.search.barriers import Barrier, find_barrier, most_obstructive
from jaxplan.search.lockstep import Steps, alone, together
from jaxplan.search.problem import Scene, SearchResult, derived_seed, make_scene

Planner = Callable[[Scene, SearchSettings], SearchResult]
Search = Callable[[Scene, SearchSettings], Steps[SearchResult]]

_SEARCHES: dict[str, Search] = {
    "mha": mha.search,
    "mha-paper": mha_paper.search,
    "wastar": wastar.search,
    "rrt_star": rrt_star.search,
    "rrt_connect": rrt_connect.search,
}


def _steps(method: str, scene: Scene, settings: SearchSettings) -> Steps[SearchResult]:
    """A search by a method; where an end is not made of numbers, it is over at once, without a path."""
    if not np.isfinite(scene.straight_steps):
        return SearchResult(status=Status.NODE_LIMIT, path=None, expansions=0)
    return (yield from _SEARCHES[method](scene, settings))


def _search(method: str, scene: Scene, settings: SearchSettings) -> SearchResult:
    return alone(scene, _steps(method, scene, settings))


PLANNERS: dict[str, Planner] = {method: partial(_search, method) for method in _SEARCHES}
"""By name; a planner searches a scene with some settings, of which `method` does not count."""


def add_planner(method: str, search: Search) -> None:
    """Let scenarios of this process name a planner of one's own in ``search.method``.

    Args:
        method: its name.
        search: a generator; from a scene and settings it yields a `lockstep.Call` wherever it needs a kernel,
            is sent the answer, and returns the result.

    Raises:
        ValueError: if there is a planner of that name.
    """
    if method in PLANNERS:
        raise ValueError(f"method = {method!r}: there is a planner of that name")
    _SEARCHES[method], PLANNERS[method] = search, partial(_search, method)
    SEARCH_METHODS.append(method)


def remove_planner(method: str) -> None:
    """Forget a planner that `add_planner` added."""
    del _SEARCHES[method], PLANNERS[method]
    SEARCH_METHODS.remove(method)


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
    searches = [_steps(one.method, scene, one) for scene, one in zip(scenes, shared, strict=True)]
    return together(scenes, searches, spent)


__all__ = [
    "PLANNERS",
    "Barrier",
    "Planner",
    "Scene",
    "SearchResult",
    "add_planner",
    "derived_seed",
    "find_barrier",
    "make_scene",
    "most_obstructive",
    "remove_planner",
    "search_batch",
]
