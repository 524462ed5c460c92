"""RRT-Connect: two trees that grow towards random states and each other.

The method is that of Kuffner and LaValle (2000), with batches. One tree grows from the start, the other from
the goal. In each turn one tree grows towards `SAMPLES` random states, each from its nearest node, by at most
`RANGE` steps and as far as the motion is clear; then the other tree grows towards all its new nodes, as far
as it gets, and where it arrives the two branches make a path. Then the trees change places. Long motions
leave nodes on their way, so that what comes later finds a near one. The straight motion from start to goal is
tried first, and the path is smoothed at the end (`smoothing`). An expansion counts one extension, the attempt
of either tree to grow towards one state.

Samples, trees and checks are those of `trees`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxplan.model.scenario import SearchSettings
from jaxplan.model.status import Status
from jaxplan.search.kernel_calls import Call, Scenes
from jaxplan.search.paths import between
from jaxplan.search.scene import SearchResult
from jaxplan.search.trees import FEW, Space, Tree, reached, search_by_trees

# Random states towards which a tree grows in a turn.
SAMPLES = FEW
# Steps that a tree grows at most towards a random state.
RANGE = 10.0
# A motion longer than two of these, in steps, leaves nodes on its way.
SPACING = 5.0
# A tree does not grow by less than this many steps, unless it arrives.
LEAST = 0.1


def search(scenes: Scenes, settings: Sequence[SearchSettings]) -> list[SearchResult]:
    """Search a path of each scene with RRT-Connect.

    Args:
        scenes: the problems.
        settings: those of each search: limits of the effort, clearance and seed; the weights and moves are
            not used.

    Returns:
        For each scene OK with a path whose every edge is clear, or a status that says why there is none.
    """
    return search_by_trees(Connect, scenes, settings)


class Connect:
    """Two trees that grow until they meet or a limit of the effort is reached.

    It is a `jaxplan.runtime.batching.Run`. A turn has two calls: one tree grows towards random states, then
    the other towards the new nodes of the first.

    Args:
        space: the problem.
    """

    def __init__(self, space: Space) -> None:
        self.space = space
        self.trees = Tree(space.start), Tree(space.goal)
        self._side = 0  # number of the tree whose turn it is
        self._new_nodes: np.ndarray | None = None  # its new nodes, which the other tree grows towards next
        self._growth: _Growth | None = None  # the growth that the last call is about
        self._corners: np.ndarray | None = None  # corners of the path
        self._limit: Status | None = None

    def next_request(self) -> Call | None:
        """Return the call that tells how far a tree can grow; None once the trees have met, or at a limit."""
        space, side = self.space, self._side
        if self._corners is not None:
            return None
        if self._new_nodes is not None:
            targets = self.trees[side].states[self._new_nodes]
            self._growth = _Growth.towards(space, self.trees[1 - side], targets, np.inf, 1 - side)
        elif (limit := space.spent()) is not None:
            self._limit = limit
            return None
        else:
            targets = space.draw(min(SAMPLES, space.left))
            self._growth = _Growth.towards(space, self.trees[side], targets, RANGE, side)
        return self._growth.call

    def accept(self, answer: np.ndarray) -> None:
        """Add nodes along the clear parts of the motions asked about; keep the path if the trees have met."""
        assert self._growth is not None
        nodes, whole = self._growth.add(answer)
        if self._new_nodes is None:
            new = nodes[nodes >= 0][: self.space.left]
            if len(new):
                self._new_nodes = new
                return
        elif np.any(whole):
            self._corners = self._join_branches(self._new_nodes, nodes, whole)
        self._new_nodes, self._side = None, 1 - self._side

    def result(self) -> SearchResult:
        """Return OK with the path, not smoothed; or the limit that was reached, without a path."""
        if self._corners is not None:
            return self.space.found(self._corners)
        assert self._limit is not None, "the trees are growing"
        return self.space.result(self._limit)

    def _join_branches(self, new: np.ndarray, met: np.ndarray, whole: np.ndarray) -> np.ndarray:
        """Return the corners (m, 4 + 2n), start to goal, of the cheapest path on which the trees have met.

        Args:
            new: (k,) indices of the k new nodes of the tree whose turn it is.
            met: (k,) indices of the nodes of the other tree that grew towards these.
            whole: (k,) bool, whether the other tree arrived there.
        """
        tree, other = self.trees[self._side], self.trees[1 - self._side]
        best = int(np.argmin(np.where(whole, tree.costs[new] + other.costs[met], np.inf)))
        mine = tree.states[tree.branch(int(new[best]))]
        rest = other.states[other.branch(int(met[best]))][-2::-1]  # what they share is there once
        corners = np.concatenate([mine, rest])
        return corners if self._side == 0 else corners[::-1]


@dataclass(frozen=True, slots=True, eq=False)
class _Growth:
    """Motions of a tree towards k states, each from the tree's nearest node.

    Attributes:
        tree: the tree that grows.
        near: (k,) indices of the nodes where the motions begin.
        end: (k, 4 + 2n) where they would end.
        length: (k,) steps of the motions.
        final: (k,) whether the ends are the states themselves, rather than on the way to them.
        call: the kernel call that tells how far the motions are clear.
    """

    tree: Tree
    near: np.ndarray
    end: np.ndarray
    length: np.ndarray
    final: np.ndarray
    call: Call

    @classmethod
    def towards(cls, space: Space, tree: Tree, targets: np.ndarray, longest: float, side: int) -> "_Growth":
        """Make the motions towards states, and count them as extensions of the space.

        Args:
            space: the problem.
            tree: the tree that grows, from the start or the goal.
            targets: (k, 4 + 2n) the k states to grow towards.
            longest: most steps of a motion.
            side: 0 if the tree's root is the start, 1 if it is the goal.
        """
        space.extensions += len(targets)
        near = space.nearest(tree, targets)
        begin, costs = tree.states[near], tree.costs[near]
        distance = space.distance(begin, targets)
        part = np.minimum(1.0, longest / np.maximum(distance, 1e-300))
        end, length = between(begin, targets, part), part * distance
        far_root = space.start if side else space.goal
        ways = [np.stack([costs, costs + length]), space.distance(np.stack([begin, end]), far_root)]
        call = space.reach_call(begin, end, ways[side], ways[1 - side])
        return cls(tree, near, end, length, part == 1, call)

    def add(self, answer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Add nodes to the tree along the clear parts of the motions, given the answer to `call`.

        Returns:
            For each of k motions the index of its last new node (k,), -1 where none was added; and (k,) bool,
            whether the state itself was reached.
        """
        tree, clear = self.tree, reached(answer, len(self.near))
        begin, costs = tree.states[self.near], tree.costs[self.near]
        whole = (clear == 1) & self.final
        last = np.full(len(self.near), -1)
        for i in np.flatnonzero(whole | (clear * self.length >= LEAST)):
            count = max(int(clear[i] * self.length[i] / SPACING), 1)
            fraction = clear[i] * np.arange(1, count + 1) / count
            nodes = between(np.tile(begin[i], (count, 1)), np.tile(self.end[i], (count, 1)), fraction)
            node = int(self.near[i])
            for state, cost in zip(nodes, costs[i] + fraction * self.length[i], strict=True):
                node = tree.add(state, node, float(cost))
            last[i] = node
        return last, whole
