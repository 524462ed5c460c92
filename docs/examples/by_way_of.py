"""A planner of one's own: fly straight, or by way of one random state."""

import numpy as np

import jaxplan as jp
from jaxplan.schema import with_settings
from jaxplan.search import add_planner
from jaxplan.search.kernel_calls import Scenes
from jaxplan.search.paths import straight_paths
from jaxplan.search.scene import SearchResult
from jaxplan.search.smoothing import smooth_results
from jaxplan.search.trees import Space

TRIES = 16  # random states that are looked at together


def search(scene, settings):
    """Search a path that bends at most once."""
    alone = Scenes([scene]), [settings]
    (straight,) = straight_paths(*alone)
    if straight is not None:
        return SearchResult(status=jp.Status.OK, path=straight, expansions=0)
    space = Space(scene, settings)
    while (limit := space.spent()) is None:
        via = space.draw(min(TRIES, space.left))
        space.extensions += len(via)
        start = np.tile(space.start, (len(via), 1))
        goal = np.tile(space.goal, (len(via), 1))
        # In steps; they say how much clearance is wanted along the motions.
        none, whole = np.zeros(len(via)), space.distance(start, goal)
        out, back = space.distance(start, via), space.distance(via, goal)
        there = space.reach(start, via, (none, out), (whole, back))
        onward = space.reach(via, goal, (out, whole), (back, none))
        clear = (there == 1) & (onward == 1)
        if np.any(clear):
            best = np.argmin(np.where(clear, out + back, np.inf))
            corners = np.stack([space.start, via[best], space.goal])
            return smooth_results(*alone, [space.found(corners)])[0]
    return space.result(limit)


add_planner("by-way-of", search)

scenario = jp.paper_case(2)
settings = {"search.method": "by-way-of", "search.max_expansions": 20000}
plan = jp.plan(with_settings(scenario, settings))
print(plan)
