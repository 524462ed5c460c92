"""RRT-Connect: two trees that grow from start and goal towards random states and towards each other.

After Kuffner and LaValle (2000), with batches: in each turn one tree grows towards `SAMPLES` random states,
each from its nearest node, by at most `RANGE` steps and as far as the motion is clear; then the other tree
grows towards all its new nodes, as far as it gets, and where it arrives the two ways make a path. Then the
trees change places. Long motions leave nodes on their way, so that what comes later finds a near one. The
straight motion from start to goal is tried first, and the path is smoothed at the end (`smoothing`).

An expansion is one extension, the attempt of either tree to grow towards one state.
"""

import numpy as np

from jaxplan.model.scenario import SearchSettings
from jaxplan.search.corners import between
from jaxplan.search.lockstep import Steps
from jaxplan.search.problem import Scene, SearchResult
from jaxplan.search.rrt import FEW, LEAST, Space, Tree

SAMPLES = FEW
# Steps that a tree grows at most towards a random state.
RANGE = 10.0
# A motion longer than two of these, in steps, leaves nodes on its way.
SPACING = 5.0


def search(scene: Scene, settings: SearchSettings) -> Steps[SearchResult]:
    """Search a path with RRT-Connect.

    Args:
        scene: the problem.
        settings: limits of the effort, clearance and seed; the weights and moves are not used.

    Returns:
        OK with a path whose every edge is clear, or why there is none.
    """
    space = Space(scene, settings)
    straight = yield from space.straight()
    return straight or (yield from connect(space))


def connect(space: Space) -> Steps[SearchResult]:
    """Grow the trees until they meet or the effort is spent."""
    trees, side = (Tree(space.start), Tree(space.goal)), 0
    while (limit := space.spent()) is None:
        tree, other = trees[side], trees[1 - side]
        grown, _ = yield from _grow(space, tree, space.draw(min(SAMPLES, space.left)), RANGE, side)
        new = grown[grown >= 0][: space.left]
        if len(new):
            met, whole = yield from _grow(space, other, tree.states[new], np.inf, 1 - side)
            if np.any(whole):
                costs = np.where(whole, tree.costs[new] + other.costs[met], np.inf)
                best = int(np.argmin(costs))
                mine = tree.states[tree.branch(int(new[best]))]
                rest = other.states[other.branch(int(met[best]))][-2::-1]  # what they share is there once
                corners = np.concatenate([mine, rest])
                return (yield from space.found(corners if side == 0 else corners[::-1]))
        side = 1 - side
    return space.result(limit)


def _grow(
    space: Space, tree: Tree, targets: np.ndarray, longest: float, side: int
) -> Steps[tuple[np.ndarray, np.ndarray]]:
    """Grow a tree towards states, from the nearest node each, as far as the motion is clear.

    Args:
        space: the problem.
        tree: from the start or the goal.
        targets: (k, 4 + 2n).
        longest: steps.
        side: 0 if the tree's root is the start, 1 if it is the goal.

    Returns:
        (k,) places of the new nodes, -1 where there was no way; (k,) whether the targets themselves were
        reached.
    """
    space.extensions += len(targets)
    near = space.nearest(tree, targets)
    begin, costs = tree.states[near], tree.costs[near]
    distance = space.distance(begin, targets)
    part = np.minimum(1.0, longest / np.maximum(distance, 1e-300))
    end, length = between(begin, targets, part), part * distance
    far_root = space.start if side else space.goal
    ways = [np.stack([costs, costs + length]), space.distance(np.stack([begin, end]), far_root)]
    clear = yield from space.reach(begin, end, ways[side], ways[1 - side])
    whole = (clear == 1) & (part == 1)
    places = np.full(len(targets), -1)
    for i in np.flatnonzero(whole | (clear * length >= LEAST)):
        count = max(int(clear[i] * length[i] / SPACING), 1)
        fraction = clear[i] * np.arange(1, count + 1) / count
        nodes = between(np.tile(begin[i], (count, 1)), np.tile(end[i], (count, 1)), fraction)
        place = int(near[i])
        for node, cost in zip(nodes, costs[i] + fraction * length[i], strict=True):
            place = tree.add(node, place, float(cost))
        places[i] = place
    return places, whole
