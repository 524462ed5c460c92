"""RRT*: a tree from the start whose nodes take the cheapest way to them that is at hand.

After Karaman and Frazzoli (2011). In each turn the tree grows by at most `RANGE` steps towards a random state
(with probability `GOAL_BIAS` the goal) as far as the motion is clear. Of the nodes within `RANGE` steps, at
most the `NEIGHBOURS` nearest, the one that offers the cheapest way becomes the new node's parent, and
those to which the new node offers a cheaper way take it as theirs. All these motions, and the straight
motion from the new node to the goal, are checked in one call: a motion is clear both ways or neither.

Once there is a path, the search goes on for as many extensions as that took, but at least `IMPROVE`, and only
towards states that can be on a shorter path (informed RRT*). The straight motion from start to goal is tried
first, and the path is smoothed at the end.

The clearance wanted of a motion between two nodes is that of the way through the older one. Costs only ever
become less, and the wanted clearance with them, so that what has been clear remains so.
"""

import numpy as np

from jaxplan.model.scenario import SearchSettings
from jaxplan.search.corners import ARRIVED, between
from jaxplan.search.lockstep import Steps
from jaxplan.search.problem import Scene, SearchResult
from jaxplan.search.rrt import FEW, LEAST, MANY, Space, Tree

RANGE = 10.0
GOAL_BIAS = 0.05
NEIGHBOURS = MANY - 1  # the motion on to the goal makes the call full
IMPROVE = 100
# Draws for a state that can be on a shorter path, before any will do.
PATIENCE = 20


def search(scene: Scene, settings: SearchSettings) -> Steps[SearchResult]:
    """Search a path with RRT*.

    Args:
        scene: the problem.
        settings: limits of the effort, clearance and seed; the weights and moves are not used.

    Returns:
        OK with a path whose every edge is clear, or why there is none; OK, too, where a limit ends
        the search after a path has been found.
    """
    space = Space(scene, settings)
    straight = yield from space.straight()
    return straight or (yield from _Star(space).run())


class _Star:
    """One run: the tree, and how far the goal is from those nodes that see it."""

    def __init__(self, space: Space) -> None:
        self.space = space
        self.tree = Tree(space.start)
        self.to_goal = [np.inf]  # steps of the straight motion, where it is clear
        self.best, self.last = np.inf, 0  # cost of the path, and the node from which it goes straight on
        self.shortest = float(space.distance(space.start, space.goal))
        self.drawn: list[np.ndarray] = []

    def run(self) -> Steps[SearchResult]:
        """Grow the tree until a limit is reached or the path has been improved long enough."""
        space, enough = self.space, np.inf
        while (limit := space.spent()) is None and space.extensions < enough:
            place = yield from self._grow(self._target())
            if place is not None:
                costs = self.tree.costs[: self.tree.size] + self.to_goal
                self.last = int(np.argmin(costs))
                self.best = float(costs[self.last])
            if self.best < np.inf:
                enough = min(enough, space.extensions + max(space.extensions, IMPROVE))
            if self.best <= self.shortest + ARRIVED:
                break
        if self.best == np.inf and limit is not None:
            return space.result(limit)
        corners = np.concatenate([self.tree.states[self.tree.branch(self.last)], space.goal[None]])
        return (yield from space.found(corners))

    def _target(self) -> np.ndarray:
        """The goal, or a random state that can be on a path shorter than the best one."""
        space = self.space
        if space.rng.random() < GOAL_BIAS:
            return space.goal
        for _ in range(PATIENCE):
            if not self.drawn:
                states = space.draw(MANY)
                if self.best < np.inf:
                    through = space.distance(states, space.start) + space.distance(states, space.goal)
                    states = states[through < self.best]
                self.drawn = list(states)
            if self.drawn:
                return self.drawn.pop()
        return space.draw(FEW)[-1]

    def _grow(self, target: np.ndarray) -> Steps[int | None]:
        """Grow towards a state; the place of the new node, None where there was no way."""
        space, tree = self.space, self.tree
        space.extensions += 1
        away = space.distance(tree.states[: tree.size], target)
        nearest = int(np.argmin(away))
        begin, cost = tree.states[nearest][None], float(tree.costs[nearest])
        part = np.array([min(1.0, RANGE / max(float(away[nearest]), 1e-300))])
        end, length = between(begin, target[None], part), part * away[nearest]
        from_start = np.stack([[cost], cost + length])
        from_goal = space.distance(np.stack([begin, end]), space.goal)
        clear = yield from space.reach(begin, end, from_start, from_goal)
        if clear[0] * length[0] < LEAST:
            return None
        state = between(begin, end, clear)[0]
        return (yield from self._join(state, nearest, cost + float(clear[0] * length[0])))

    def _join(self, state: np.ndarray, parent: int, cost: float) -> Steps[int]:
        """Add a node under the best parent, and let its neighbours come under it; its place."""
        space, tree = self.space, self.tree
        away = space.distance(tree.states[: tree.size], state)
        near = np.argsort(away, kind="stable")[:NEIGHBOURS]
        near = near[away[near] <= RANGE]
        first = np.concatenate([tree.states[near], space.goal[None]])
        second = np.broadcast_to(state, first.shape)
        length = space.distance(first, second)
        costs, rest = tree.costs[near], float(length[-1])
        from_start = np.stack([[*costs, cost + rest], [*(costs + length[:-1]), cost]])
        from_goal = space.distance(np.stack([first, second]), space.goal)
        reached = yield from space.reach(first, second, from_start, from_goal)
        clear = reached == 1
        ways = np.where(clear[:-1], costs + length[:-1], np.inf)
        if len(near) and ways.min() < cost:
            parent, cost = int(near[np.argmin(ways)]), float(ways.min())
        place = tree.add(state, parent, cost)
        self.to_goal.append(rest if clear[-1] else np.inf)
        for i in np.flatnonzero(clear[:-1] & (cost + length[:-1] < costs - ARRIVED)):
            self._rewire(int(near[i]), place, cost + float(length[i]))
        return place

    def _rewire(self, place: int, parent: int, cost: float) -> None:
        """Give a node another parent, and its descendants their lower costs."""
        tree = self.tree
        gain = tree.costs[place] - cost
        if gain <= 0:  # an ancestor has been given a new parent, too
            return
        tree.parents[place] = parent
        level = np.array([place])
        while len(level):
            tree.costs[level] -= gain
            level = np.flatnonzero(np.isin(tree.parents[: tree.size], level))
