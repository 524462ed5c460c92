"""RRT*: a tree from the start whose nodes are reconnected to the parents that make their paths cheapest.

After Karaman and Frazzoli (2011). In each turn the tree grows by at most `RANGE` steps towards a random state
(with probability `GOAL_BIAS` the goal) as far as the motion is clear. Of the nodes within `RANGE` steps, at
most the `NEIGHBOURS` nearest, the one with the cheapest path to the new node becomes its parent, and those to
which the path through the new node is cheaper take it as theirs. All these motions, and the straight motion
from the new node to the goal, are checked in one call: a motion is clear both ways or neither.

Once there is a path, the search goes on for as many extensions as that took, but at least `IMPROVE`, and only
towards states that can be on a shorter path (informed RRT*). The straight motion from start to goal is tried
first, and the path is smoothed at the end.

The clearance wanted of a motion between two nodes is that of the path through the older one. Costs only ever
become less, and the wanted clearance with them, so that what has been clear remains so. A *state* is a row of
``4 + 2n`` numbers, as in `trees`: the attitude relative to the start as a unit quaternion, scalar first, and
the joint angles. Costs and distances are in *steps*: a straight motion takes the largest of its rotation over
``attitude_step`` and its joint changes over their steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxplan.model.scenario import SearchSettings
from jaxplan.model.status import Status
from jaxplan.search.kernel_calls import Call, Scenes
from jaxplan.search.paths import ARRIVED, between
from jaxplan.search.rrt_connect import LEAST
from jaxplan.search.scene import SearchResult
from jaxplan.search.trees import FEW, MANY, Space, Tree, reached, search_by_trees

RANGE = 10.0  # steps, most of an extension, and most to a neighbour
GOAL_BIAS = 0.05  # probability that the tree grows towards the goal
NEIGHBOURS = MANY - 1  # most neighbours; with the motion on to the goal the call is full
IMPROVE = 100  # least number of extensions after the first path
# Most draws for a state that can be on a shorter path, before any state is taken.
PATIENCE = 20


def search(scenes: Scenes, settings: Sequence[SearchSettings]) -> list[SearchResult]:
    """Search a path for each scene with RRT*.

    Args:
        scenes: the problems.
        settings: one for each scene: limits of the effort, clearance and seed; weights and moves are not
            used.

    Returns:
        For each scene OK with a path whose every edge is clear, or the limit that ended the search without
        one. It is OK, too, where a limit ends the search after a path has been found.
    """
    return search_by_trees(Star, scenes, settings)


@dataclass(frozen=True, slots=True, eq=False)
class _Extension:
    """A straight motion by which the tree is to grow, not checked yet.

    Attributes:
        nearest: index of the node where it begins.
        end: (1, 4 + 2n) state where it would end.
        length: of the motion, steps.
    """

    nearest: int
    end: np.ndarray
    length: float


@dataclass(frozen=True, slots=True, eq=False)
class _NewNode:
    """A new node with the motions between it and its neighbours, and on to the goal, not checked yet.

    Attributes:
        state: (4 + 2n,) of the node.
        parent: index of the node from which it was reached.
        cost: steps from the start through that node.
        near: (k,) indices of its k neighbours.
        length: (k + 1,) steps of the motions, that to the goal last.
    """

    state: np.ndarray
    parent: int
    cost: float
    near: np.ndarray
    length: np.ndarray


class Star:
    """A search under way: the tree, and for each node the length of a clear straight motion to the goal.

    It is a `jaxplan.runtime.batching.Run`. Each turn has one call, on how far the tree can grow towards a
    state, and if it grows a second one, on the motions between the new node and its neighbours.

    Args:
        space: the problem.
    """

    def __init__(self, space: Space) -> None:
        self.space = space
        self.tree = Tree(space.start)
        self.to_goal = [np.inf]  # steps of the straight motion, where it is clear
        self.best, self.last = np.inf, 0  # cost of the path, and the node from which it goes straight on
        self.shortest = float(space.distance(space.start, space.goal))
        self.drawn: list[np.ndarray] = []
        self._max_extensions = np.inf  # extensions after which the path has been improved long enough
        self._pending: _Extension | _NewNode | None = None  # what the last call checks
        self._reached_limit: Status | None = None

    def next_request(self) -> Call | None:
        """Return the next call; None at a limit, or once the path is shortest or improved long enough."""
        if isinstance(self._pending, _NewNode):
            return self._connections_call(self._pending)
        self._reached_limit = self.space.spent()
        short = self.best <= self.shortest + ARRIVED
        if self._reached_limit is not None or short or self.space.extensions >= self._max_extensions:
            return None
        return self._extension_call(self._draw_target())

    def accept(self, answer: np.ndarray) -> None:
        """Grow the tree by the answer, which tells how far the motions of the last call are clear."""
        pending, self._pending = self._pending, None
        if isinstance(pending, _NewNode):
            self._add_node(pending, reached(answer, len(pending.length)))
        elif pending is not None:
            self._pending = self._make_node(pending, reached(answer, 1))
        if self._pending is None and self.best < np.inf:
            extensions = self.space.extensions
            self._max_extensions = min(self._max_extensions, extensions + max(extensions, IMPROVE))

    def result(self) -> SearchResult:
        """Return OK with the path, not smoothed; or the limit that was reached before there was one.

        Raises:
            RuntimeError: if neither is there yet.
        """
        if self.best == np.inf:
            if self._reached_limit is None:
                raise RuntimeError("the tree is growing: there is no result yet")
            return self.space.result(self._reached_limit)
        branch = self.tree.states[self.tree.branch(self.last)]
        return self.space.found(np.concatenate([branch, self.space.goal[None]]))

    def _draw_target(self) -> np.ndarray:
        """Draw the state (4 + 2n,) to grow towards: the goal, or a random one that may shorten the path.

        After `PATIENCE` draws without success it is any random state.
        """
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

    def _extension_call(self, target: np.ndarray) -> Call:
        """Store the motion to a state (4 + 2n,) from its nearest node, and return the call that checks it."""
        space, tree = self.space, self.tree
        space.extensions += 1
        away = space.distance(tree.states[: tree.size], target)
        nearest = int(np.argmin(away))
        begin, cost = tree.states[nearest][None], float(tree.costs[nearest])
        part = np.array([min(1.0, RANGE / max(float(away[nearest]), 1e-300))])
        end, length = between(begin, target[None], part), part * away[nearest]
        self._pending = _Extension(nearest, end, float(length[0]))
        from_start = np.stack([[cost], cost + length])
        from_goal = space.distance(np.stack([begin, end]), space.goal)
        return space.reach_call(begin, end, from_start, from_goal)

    def _make_node(self, motion: _Extension, clear: np.ndarray) -> _NewNode | None:
        """Make the new node at the end of the clear part of a motion; None where that part is too short.

        `clear` (1,) is the fraction of the motion that is clear.
        """
        space, tree = self.space, self.tree
        gone = float(clear[0] * motion.length)
        if gone < LEAST:
            return None
        state = between(tree.states[motion.nearest][None], motion.end, clear)[0]
        away = space.distance(tree.states[: tree.size], state)
        near = np.argsort(away, kind="stable")[:NEIGHBOURS]
        near = near[away[near] <= RANGE]
        ends = np.concatenate([tree.states[near], space.goal[None]])
        length = space.distance(ends, np.broadcast_to(state, ends.shape))
        return _NewNode(state, motion.nearest, float(tree.costs[motion.nearest]) + gone, near, length)

    def _connections_call(self, node: _NewNode) -> Call:
        """Make the call that checks the motions between a new node, its neighbours and the goal."""
        space, costs = self.space, self.tree.costs[node.near]
        first = np.concatenate([self.tree.states[node.near], space.goal[None]])
        second = np.broadcast_to(node.state, first.shape)
        rest = float(node.length[-1])
        from_start = np.stack([[*costs, node.cost + rest], [*(costs + node.length[:-1]), node.cost]])
        from_goal = space.distance(np.stack([first, second]), space.goal)
        return space.reach_call(first, second, from_start, from_goal)

    def _add_node(self, node: _NewNode, fractions: np.ndarray) -> None:
        """Connect a new node to its cheapest parent, rewire neighbours, and update the best path.

        A neighbour to which a way by the new node is cheaper than its own gets it as its parent.

        Args:
            node: the new node, with its k neighbours.
            fractions: (k + 1,) how much of each motion between it and a neighbour is clear, then of that to
                the goal; 1 where all of it is.
        """
        tree, near, length = self.tree, node.near, node.length
        clear, costs = fractions == 1, tree.costs[near]
        ways = np.where(clear[:-1], costs + length[:-1], np.inf)
        parent, cost = node.parent, node.cost
        if len(near) and ways.min() < cost:
            parent, cost = int(near[np.argmin(ways)]), float(ways.min())
        new = tree.add(node.state, parent, cost)
        self.to_goal.append(float(length[-1]) if clear[-1] else np.inf)
        for i in np.flatnonzero(clear[:-1] & (cost + length[:-1] < costs - ARRIVED)):
            self._rewire(int(near[i]), new, cost + float(length[i]))
        through = tree.costs[: tree.size] + self.to_goal
        self.last = int(np.argmin(through))
        self.best = float(through[self.last])

    def _rewire(self, place: int, parent: int, cost: float) -> None:
        """Give the node at index `place` another parent and a lower cost, and lower its descendants' costs.

        Nothing is done if its cost would not become lower.
        """
        tree = self.tree
        gain = tree.costs[place] - cost
        if gain <= 0:  # its cost has been lowered already, through an ancestor
            return
        tree.parents[place] = parent
        level = np.array([place])
        while len(level):
            tree.costs[level] -= gain
            level = np.flatnonzero(np.isin(tree.parents[: tree.size], level))
