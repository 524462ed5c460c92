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
from jaxplan.search.kernels import Expansion, expand
from jaxplan.search.motions import STRAIGHT_INTERVALS
from jaxplan.search.problem import Scene, SearchResult
from jaxplan.search.queues import Block, LazyQueue
from jaxplan.search.tree import ARRIVED, Children, Moves, Node, make_root, trace
from jaxplan.status import Status

# The wanted clearance grows from nothing to its full value over this many steps from start and goal.
TAPER_STEPS = 4.0

_FRACTION = np.arange(STRAIGHT_INTERVALS + 1) / STRAIGHT_INTERVALS


@dataclass(frozen=True, slots=True)
class Rules:
    """How one variant proposes and prices children.

    Attributes:
        propose: (scene, node, random generator, settings) -> Moves.
        price: (scene, expansion) -> (A, M) costs of the moves and (queues, A, M) heuristics, the anchor's
            first.
        edges: whether zones hold along edges, or at nodes alone.
        shared: whether the queues share their nodes.
        direct: whether every expansion tries the straight motion to the goal.
        queues: number of queues, the anchor included.
    """

    propose: Callable[[Scene, Node, np.random.Generator, SearchSettings], Moves]
    price: Callable[[Scene, Expansion], tuple[np.ndarray, np.ndarray]]
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


_to_device = jax.jit(lambda scene: scene)  # a fifth of the time that jax.device_put takes for many leaves


class _Search:
    """One run: the queues, what has been expanded, and the best way to the goal so far."""

    def __init__(self, scene: Scene, settings: SearchSettings, rules: Rules) -> None:
        self.scene, self.settings, self.rules = scene, settings, rules
        self.on_device = _to_device(scene)
        self.rng = np.random.default_rng(np.random.SeedSequence(settings.seed))
        self.queues = [LazyQueue(row) for row in range(rules.queues)]
        self.best_costs: list[dict[bytes, float]] = [{} for _ in self.queues]
        self.expanded: list[Node] = []
        self.counts = [0] * rules.queues
        self.goal_cost = float("inf")
        self.arrival: Node | None = None

    def run(self) -> SearchResult:
        """Expand until the goal is reached or the effort is spent."""
        deadline = time.monotonic() + self.settings.time_limit
        root = make_root(self.scene)
        if root.ahead <= ARRIVED:
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
        if self.queues[queue].min_key() == np.inf:  # nothing open: try new moves from an old node
            return self.expanded[self.rng.integers(len(self.expanded))]
        block, child = self.queues[queue].pop()
        node = block.content.make(child)
        best = self.best_costs[0 if self.rules.shared else queue]
        state = node.state()
        if best.get(state, np.inf) <= node.cost:
            return None
        best[state] = node.cost
        return node

    def _expand(self, node: Node, queue: int) -> None:
        """Make a node's children and push those that keep clear."""
        moves = self.rules.propose(self.scene, node, self.rng, self.settings)
        expansion = expand(
            self.on_device,
            node.packed,
            moves.turns,
            moves.options,
            moves.choice,
            self._clearance(node),
            edges=self.rules.edges,
        )
        costs, heuristics = self.rules.price(self.scene, expansion)
        children = Children(node, moves, expansion, node.cost + costs)
        self.expanded.append(node)
        self.counts[queue] += 1
        if self.rules.direct and np.all(expansion.straight >= 0):
            self._arrive(node, node.cost + node.ahead)
        valid = (expansion.slacks >= 0) & (expansion.steps > 0)  # staying altogether leads nowhere
        if moves.allowed is not None:
            valid &= moves.allowed
        for child in np.flatnonzero(valid & (expansion.heuristics[0] <= ARRIVED)):
            arrived = children.make(int(child))
            self._arrive(arrived, arrived.cost)
        keys = children.costs + self.settings.heuristic_weight * heuristics
        block = Block(children, np.where(valid, keys, np.inf).reshape(len(self.queues), -1))
        for index in range(len(self.queues)) if self.rules.shared else (queue,):
            self.queues[index].push(block)

    def _arrive(self, node: Node, cost: float) -> None:
        """Remember the cheapest way to the goal."""
        if cost < self.goal_cost:
            self.goal_cost, self.arrival = cost, node

    def _clearance(self, node: Node) -> np.ndarray:
        """Clearance wanted of the children and along the straight motion, rad; none at start and goal."""
        if not self.rules.edges:  # the printed method knows no clearance
            return np.zeros(STRAIGHT_INTERVALS + 1)
        steps = np.empty(STRAIGHT_INTERVALS + 1)
        steps[0] = min(node.cost, node.ahead - 1)
        np.minimum(node.cost + _FRACTION[:-1] * node.ahead, (1 - _FRACTION[1:]) * node.ahead, out=steps[1:])
        return self.settings.clearance * np.maximum(np.minimum(steps / TAPER_STEPS, 1), 0)
