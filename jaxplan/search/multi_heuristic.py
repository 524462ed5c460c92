"""The multi-heuristic A* of the paper's section 3.2.2: one anchor queue and any number of others.

Plain Python around the jitted expansion. A `Rules` object says how children are proposed and priced, so the
printed method and the default planner are two sets of rules over this loop. Queue 0 is the anchor; queue
i is keyed by ``g + w1 h_i``. The others take turns, and each is followed while its best key is at most ``w2``
times the anchor's; else the anchor is. Queues are shared (a node leaves all of them when it is expanded)
or, as printed, independent. The search ends when the best way found to the goal costs no more than the
next key.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import jax
import numpy as np

from jaxplan.path import Path
from jaxplan.scenario.model import SearchSettings
from jaxplan.search import kernels
from jaxplan.search.problem import Scene, SearchResult
from jaxplan.search.queues import Block, LazyQueue
from jaxplan.search.tree import ARRIVED, Children, Moves, Node, make_root, to_go, trace
from jaxplan.status import Status

# The wanted clearance grows from nothing to its full value over this many steps from start and goal.
TAPER_STEPS = 4.0


@dataclass(frozen=True, slots=True)
class Rules:
    """How one variant proposes and prices children.

    Attributes:
        propose: (scene, node, random generator, settings) -> Moves.
        price: (scene, moves, (A, 14) nodes, (M, 2n) joints) -> (A, M) step costs and (queues, A, M)
            heuristics, the anchor's first.
        edges: whether zones hold along edges, or at nodes alone.
        shared: whether the queues share their nodes.
        direct: whether every expansion tries the straight motion to the goal.
        queues: number of queues, the anchor included.
    """

    propose: Callable[[Scene, Node, np.random.Generator, SearchSettings], Moves]
    price: Callable[[Scene, Moves, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
    edges: bool
    shared: bool
    direct: bool
    queues: int


def run(scene: Scene, settings: SearchSettings, rules: Rules) -> SearchResult:
    """Search a path from the scene's start to its goal.

    Args:
        scene: the problem.
        settings: weights, limits of the effort, seed.
        rules: the variant.

    Returns:
        OK with the path, or NODE_LIMIT or TIME_LIMIT without.
    """
    with jax.enable_x64(True):
        return _Search(scene, settings, rules).run()


class _Search:
    """One run: the queues, what has been expanded, and the best way to the goal so far."""

    def __init__(self, scene: Scene, settings: SearchSettings, rules: Rules) -> None:
        self.scene, self.settings, self.rules = scene, settings, rules
        self.on_device = jax.device_put(scene)
        self.rng = np.random.default_rng(np.random.SeedSequence(settings.seed))
        self.queues = [LazyQueue() for _ in range(rules.queues)]
        self.best_costs: list[dict[bytes, float]] = [{} for _ in self.queues]
        self.expanded: list[Node] = []
        self.counts = [0] * rules.queues
        self.goal_cost = float("inf")
        self.arrival: Node | None = None

    def run(self) -> SearchResult:
        """Expand until the goal is reached or the effort is spent."""
        deadline = time.monotonic() + self.settings.time_limit
        root = make_root(self.scene)
        if to_go(self.scene, root) <= ARRIVED:
            return self._result(Status.OK, trace(self.scene, root))
        for queue in range(1 if self.rules.shared else len(self.queues)):
            self._expand(root, queue)
        turn = 0
        while True:
            turn = turn % (len(self.queues) - 1) + 1
            queue = turn
            if self.queues[turn].min_key() > self.settings.anchor_weight * self.queues[0].min_key():
                queue = 0
            if self.arrival is not None and self.goal_cost <= self.queues[queue].min_key():
                return self._result(Status.OK, trace(self.scene, self.arrival))
            if sum(self.counts) >= self.settings.max_expansions:
                return self._result(Status.NODE_LIMIT)
            if time.monotonic() >= deadline:
                return self._result(Status.TIME_LIMIT)
            node = self._next(queue)
            if node is not None:
                self._expand(node, queue)

    def _result(self, status: Status, path: Path | None = None) -> SearchResult:
        counts = tuple(self.counts)
        return SearchResult(status=status, path=path, expansions=sum(counts), queue_expansions=counts)

    def _next(self, queue: int) -> Node | None:
        """The best open node of a queue; None if its state has been expanded at no higher cost before."""
        if np.isinf(
            self.queues[queue].min_key()
        ):  # nothing open: look again from an old node, with new moves
            return self.expanded[self.rng.integers(len(self.expanded))]
        block, child = self.queues[queue].pop()
        node = block.content.make(child)
        best = self.best_costs[0 if self.rules.shared else queue]
        state = np.round(node.packed, 9).tobytes()
        if best.get(state, np.inf) <= node.cost:
            return None
        best[state] = node.cost
        return node

    def _expand(self, node: Node, queue: int) -> None:
        """Make a node's children and push those that keep clear."""
        moves = self.rules.propose(self.scene, node, self.rng, self.settings)
        nodes, slacks, straight = kernels.expand(
            self.on_device,
            node.packed,
            moves.turns,
            moves.options,
            moves.choice,
            self._clearance(node),
            edges=self.rules.edges,
        )
        joints = node.joints + np.take_along_axis(moves.options, moves.choice, axis=0)
        step_costs, heuristics = self.rules.price(self.scene, moves, nodes, joints)
        children = Children(node, nodes, joints, node.cost + step_costs)
        self.expanded.append(node)
        self.counts[queue] += 1
        if self.rules.direct and np.all(straight >= 0):
            self._arrive(node, node.cost + to_go(self.scene, node))
        valid = np.flatnonzero(moves.allowed & (slacks >= 0))
        costs = children.costs.ravel()[valid]
        to_goal = heuristics.reshape(len(self.queues), -1)[:, valid]
        for child in valid[to_goal[0] <= ARRIVED]:
            arrived = children.make(int(child))
            self._arrive(arrived, arrived.cost)
        block = Block(children, np.zeros(children.costs.size, dtype=bool))
        for index in range(len(self.queues)) if self.rules.shared else (queue,):
            self.queues[index].push(block, valid, costs + self.settings.heuristic_weight * to_goal[index])

    def _arrive(self, node: Node, cost: float) -> None:
        """Remember the cheapest way to the goal."""
        if cost < self.goal_cost:
            self.goal_cost, self.arrival = cost, node

    def _clearance(self, node: Node) -> np.ndarray:
        """Clearance wanted of the children and along the straight motion, rad; none at start and goal."""
        if not self.rules.edges:  # the printed method knows no clearance
            return np.zeros(kernels.STRAIGHT_INTERVALS + 1)
        ahead = to_go(self.scene, node)
        fraction = np.arange(kernels.STRAIGHT_INTERVALS + 1) / kernels.STRAIGHT_INTERVALS
        along = np.minimum(node.cost + fraction[:-1] * ahead, (1 - fraction[1:]) * ahead)
        steps = np.append(min(node.cost, ahead - 1), along)
        return self.settings.clearance * np.clip(steps / TAPER_STEPS, 0, 1)
