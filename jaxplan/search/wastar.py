"""Weighted A*: what the paper's Table 4 compares with.

The paper says of it no more than its name and that steps, time and expansions are limited alike. So it is the
printed planner without what makes that one multi-heuristic: the moves of equations (9) and (10), the cost
(16), nodes checked and edges not, one queue keyed by ``g + w1 h_0`` with ``h_0`` of equation (15), which is
admissible and consistent for the cost (16). A path found costs at most ``w1`` times the cheapest in the
graph of the moves that were drawn.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jaxplan.model.scenario import SearchSettings
from jaxplan.search import mha_paper
from jaxplan.search.calls import Scenes
from jaxplan.search.fields import Fields
from jaxplan.search.kernels import Expansion
from jaxplan.search.multi_heuristic import Rules, search_by
from jaxplan.search.problem import Scene, SearchResult


def search(scenes: Scenes, settings: Sequence[SearchSettings]) -> list[SearchResult]:
    """Search a path of each scene with weighted A*.

    Args:
        scenes: the problems.
        settings: of each; the clearance and the anchor's weight are not used.

    Returns:
        OK with a path whose nodes are clear, or why there is none. Edges may cut a zone.
    """
    # an anchor, and one queue that is its equal and so is always followed
    rules = Rules(
        propose=mha_paper.propose,
        price=price,
        edges=False,
        shared=True,
        direct=False,
        queues=2,
        informed=False,
    )
    results = search_by(rules, scenes, settings)
    return [replace(result, queue_expansions=(result.expansions,)) for result in results]


def price(scene: Scene, expansion: Expansion, fields: Fields) -> tuple[np.ndarray, np.ndarray]:
    """Costs (A, M) by equation (16) and ``h_0`` (2, A, M) by equation (15), rad."""
    costs, heuristics = mha_paper.price(scene, expansion, fields)
    return costs, heuristics[[0, 0]]
