"""The planner by way of one random state as a run, so that the kernel calls of many searches are shared."""

import numpy as np

import jaxplan as jp
from jaxplan.schema import with_settings
from jaxplan.search import add_planner
from jaxplan.search.kernel_calls import Scenes
from jaxplan.search.smoothing import smooth_results
from jaxplan.search.trees import Space, reached

TRIES = 8  # random states that are looked at together, two motions each


class ByWayOf:
    """A search of a path that bends once."""

    def __init__(self, scene, settings):
        self.space = Space(scene, settings)
        self.answer = None

    def next_request(self):
        """The next call; None at the end."""
        space, limit = self.space, self.space.spent()
        if self.answer is None and limit is not None:
            self.answer = space.result(limit)
        if self.answer is not None:
            return None
        self.via = space.draw(min(TRIES, space.left))
        space.extensions += len(self.via)
        start, goal = (np.tile(end, (len(self.via), 1)) for end in (space.start, space.goal))
        none, whole = np.zeros(len(self.via)), space.distance(start, goal)
        self.out, self.back = space.distance(start, self.via), space.distance(self.via, goal)
        from_start = np.stack([[*none, *self.out], [*self.out, *whole]])
        from_goal = np.stack([[*whole, *self.back], [*self.back, *none]])
        first, second = np.concatenate([start, self.via]), np.concatenate([self.via, goal])
        return space.reach_call(first, second, from_start, from_goal)

    def accept(self, answer):
        """Take a way whose two motions are clear, if there is one."""
        there, onward = np.split(reached(answer, 2 * len(self.via)), 2)
        clear = (there == 1) & (onward == 1)
        if np.any(clear):
            best = np.argmin(np.where(clear, self.out + self.back, np.inf))
            self.answer = self.space.found(np.stack([self.space.start, self.via[best], self.space.goal]))

    def result(self):
        """The result, at the end."""
        space = self.space
        return smooth_results(Scenes([space.scene]), [space.settings], [self.answer])[0]


add_planner("by-way-of-run", ByWayOf)

scenarios = [jp.paper_case(number) for number in (1, 2)]
settings = {"search.method": "by-way-of-run", "search.max_expansions": 20000}
plans = jp.plan_batch([with_settings(scenario, settings) for scenario in scenarios])
print([plan.status.name for plan in plans])
