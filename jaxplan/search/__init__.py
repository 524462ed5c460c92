"""Step 2: a sequence of clear states from start to goal. Every planner has the same call and result."""

from collections.abc import Callable, Mapping

from jaxplan.scenario.model import SearchSettings
from jaxplan.search import mha, mha_paper, rrt_connect, rrt_star, wastar
from jaxplan.search.barriers import Barrier, find_barrier, most_obstructive
from jaxplan.search.problem import Scene, SearchResult, make_scene

Planner = Callable[[Scene, SearchSettings], SearchResult]

PLANNERS: Mapping[str, Planner] = {
    "mha": mha.search,
    "mha-paper": mha_paper.search,
    "wastar": wastar.search,
    "rrt_star": rrt_star.search,
    "rrt_connect": rrt_connect.search,
}

__all__ = [
    "PLANNERS",
    "Barrier",
    "Planner",
    "Scene",
    "SearchResult",
    "find_barrier",
    "make_scene",
    "most_obstructive",
]
