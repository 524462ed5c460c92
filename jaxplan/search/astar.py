"""The multi-heuristic A* of the paper's section 3.2.2: one anchor queue and any number of others.

It is plain Python around the jitted expansion. A `Rules` object says how children are proposed and priced;
the method as printed in the paper and the default planner are two sets of rules for the same loop. Queue 0 is
the anchor; queue i is keyed by ``g + w1 h_i``, with the cost ``g`` from the start and the heuristic ``h_i``.
The other queues take turns. The one whose turn it is gives the next node if its best key is at most ``w2``
times the anchor's; otherwise the anchor does. Queues are shared (a node leaves all of them when it is
expanded) or, as printed, independent. The search ends when the best path found to the goal costs no more than
the next key. A node is *open* while it is in a queue.

Costs are in steps, and 2n stands for the number of all joints, see `jaxplan.search`. An expansion tries A
attitude moves with M joint moves.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from jaxplan.model.path import Path
from jaxplan.model.scenario import SearchSettings
from jaxplan.model.status import Status
from jaxplan.runtime.stopwatch import working_time
from jaxplan.search.expansion import (
    EDGE_INTERVALS,
    ONWARD_INTERVALS,
    Expansion,
    Moves,
    chosen,
    expansion,
    expansion_call,
)
from jaxplan.search.fields import Fields, distance_fields, no_fields
from jaxplan.search.kernel_calls import Call, Scenes
from jaxplan.search.paths import ARRIVED, subdivide
from jaxplan.search.queues import Block, ExplorationQueue, LazyQueue
from jaxplan.search.scene import Scene, SearchResult, tapered

# Every so many turns the exploration queue gives the node to expand.
EXPLORE_EVERY = 6

_EDGE_FRACTIONS = np.arange(EDGE_INTERVALS + 1) / EDGE_INTERVALS
_ONWARD_FRACTIONS = np.arange(ONWARD_INTERVALS + 1) / ONWARD_INTERVALS


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A node of the search: a state, how it was reached, and what is ahead.

    Attributes:
        packed: (7 + 2n,) the state as the kernel takes it: attitude relative to the start as a unit
            quaternion (4), rotation vector to the goal in body axes, rad (3), joints, rad.
        cost: ``g``, steps from the start along the path to the node.
        ahead: cost in steps of the straight motion to the goal, ``h_max``.
        parent: the node before, None for the start.
    """

    packed: np.ndarray
    cost: float
    ahead: float
    parent: "Node | None"

    @property
    def since(self) -> np.ndarray:
        """The unit quaternion (4,), scalar first, of the attitude relative to the start."""
        return self.packed[:4]

    @property
    def to_goal(self) -> np.ndarray:
        """The rotation vector (3,) rad to the goal, in body axes."""
        return self.packed[4:7]

    @property
    def joints(self) -> np.ndarray:
        """The joint angles (2n,) rad."""
        return self.packed[7:]

    def state(self) -> bytes:
        """Return a key that nodes share if rotations to the goal and joints agree to about 1e-9 rad."""
        return (np.rint(self.packed[4:] * 1e9) + 0.0).tobytes()  # + 0.0: no negative zero


@dataclass(frozen=True, slots=True, eq=False)
class Children:
    """The children of a node, A attitude moves by M joint moves, before any of them is made a node.

    Attributes:
        parent: their parent.
        moves: the moves that were tried.
        expansion: their places, slacks, costs and heuristics, from the kernel.
        costs: (A, M) ``g``, steps from the start.
    """

    parent: Node
    moves: Moves
    expansion: Expansion
    costs: np.ndarray

    def make(self, child: int) -> Node:
        """Return the node of the child numbered ``attitude move * M + joint move``."""
        attitude_move, joint_move = divmod(child, len(self.moves.choice))
        options = self.moves.options[attitude_move if len(self.moves.options) > 1 else 0]
        change = chosen(options, self.moves.choice[joint_move])
        packed = np.concatenate([self.expansion.places[attitude_move], self.parent.joints + change])
        return Node(
            packed,
            float(self.costs[attitude_move, joint_move]),
            float(self.expansion.heuristics[0, attitude_move, joint_move]),
            self.parent,
        )


# The rows, flattened, are the matrices that take the vector product with e_x, e_y and e_z from the right.
_CROSS_PRODUCT_MATRICES = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], float
)


def unrotated(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return k vectors (k, 3) rotated by the inverses of unit quaternions (..., 4), as (..., k, 3)."""
    across = (quaternions[..., 1:] @ _CROSS_PRODUCT_MATRICES).reshape(*quaternions.shape[:-1], 3, 3)
    twice = 2 * (vectors @ across)
    return vectors + quaternions[..., :1, None] * twice + twice @ across


def make_root(scene: Scene) -> Node:
    """Return the start of a scene as a node."""
    packed = np.concatenate([[1.0, 0.0, 0.0, 0.0], scene.goal_coordinates, scene.start_joints])
    return Node(packed, 0.0, scene.straight_steps, None)


def trace(scene: Scene, arrival: Node) -> Path:
    """Return the path from the start through a node's ancestors to the node, and straight on to the goal.

    Args:
        scene: the problem.
        arrival: the node from which the straight motion to the goal is clear, or the goal itself.
    """
    corners = [scene.ends[1]] if arrival.ahead > ARRIVED else []
    node: Node | None = arrival
    while node is not None:
        corners.append(np.concatenate([node.since, node.joints]))
        node = node.parent
    return subdivide(scene, np.array(corners[::-1]))


@dataclass(frozen=True, slots=True)
class Rules:
    """How one variant of the search proposes and prices children.

    Attributes:
        propose: function (scene, node, random generator, settings, number of the expansion) -> Moves.
        price: function (scene, expansion, fields) -> costs of the moves in steps (A, M), for A attitude moves
            and M joint moves, and heuristics (queues, A, M), the anchor's first.
        edges: True to check zones along whole edges, False to check them at nodes alone.
        shared: whether the queues share their nodes.
        direct: whether the straight motion from every child to the goal is tried.
        queues: number of queues, the anchor included.
        informed: whether distance fields are computed if the first expansion does not reach the goal, and a
            random child is expanded every few turns, whatever its key.
    """

    propose: Callable[[Scene, Node, np.random.Generator, SearchSettings, int], Moves]
    price: Callable[[Scene, Expansion, Fields], tuple[np.ndarray, np.ndarray]]
    edges: bool
    shared: bool
    direct: bool
    queues: int
    informed: bool


def search_by(rules: Rules, scenes: Scenes, settings: Sequence[SearchSettings]) -> list[SearchResult]:
    """Search a path of each scene by one variant of multi-heuristic A*.

    Args:
        rules: the variant.
        scenes: the problems.
        settings: those of each search: weights, limits of the effort, seed.

    Returns:
        For each scene OK with the path, or NODE_LIMIT or TIME_LIMIT without one.
    """
    runs = [Search(scene, own, rules) for scene, own in zip(scenes.scenes, settings, strict=True)]
    scenes.run(runs)
    return [run.result() for run in runs]


class Search:
    """A search under way: the queues, what has been expanded, and the best path to the goal so far.

    It is a `jaxplan.runtime.batching.Run` that asks for one expansion after the other.

    Attributes:
        expanded: the nodes expanded, in this order.
        asked: for each of them the queue that asked for it, the anchor being 0.
    """

    def __init__(self, scene: Scene, settings: SearchSettings, rules: Rules) -> None:
        self.scene, self.settings, self.rules = scene, settings, rules
        self.rng = np.random.default_rng(np.random.SeedSequence(settings.seed))
        self.queues = [LazyQueue(row) for row in range(rules.queues)]
        self.best_costs: list[dict[bytes, float]] = [{} for _ in self.queues]
        self.expanded: list[Node] = []
        self.asked: list[int] = []
        self.exploration = ExplorationQueue()
        self.fields = no_fields(scene)
        self.goal_cost = float("inf")
        self.arrival: Node | None = None
        self._root = make_root(scene)
        self._root_queues = list(
            range(1 if rules.shared else rules.queues)
        )  # queues that have yet to expand it
        self._fields_missing = rules.informed  # the distance fields are still to be computed
        self._turn = 0
        self._pending: tuple[Node, int, Moves] | None = None  # node, queue and moves that are being expanded
        self._status: Status | None = None
        self._deadline = working_time() + settings.time_limit

    def next_request(self) -> Call | None:
        """Return the call that expands the next node; None once there is a path, or a limit is reached."""
        if self._root.ahead <= ARRIVED:
            self.arrival, self._status = self._root, Status.OK
        while self._status is None:
            chosen = self._choose_node()
            if chosen is not None:
                return self._request_expansion(*chosen)
        return None

    def result(self) -> SearchResult:
        """Return OK with the path, or NODE_LIMIT or TIME_LIMIT without one."""
        assert self._status is not None, "the search is under way"
        found = self._status is Status.OK and self.arrival is not None
        path = trace(self.scene, self.arrival) if found and self.arrival is not None else None
        return SearchResult(
            status=self._status, path=path, expansions=len(self.expanded), queue_expansions=self.counts
        )

    def _choose_node(self) -> tuple[Node, int] | None:
        """Take the next node to expand, and the queue that asks for it; None if this turn has no node.

        At the end of the search it sets the status, and returns None.
        """
        if self._root_queues and not self._is_spent():
            return self._root, self._root_queues.pop(0)
        if self._fields_missing and self.arrival is None and not self._is_spent():
            self._fields_missing, self.fields = False, distance_fields(self.scene)
            return self._root, 0
        self._turn += 1
        queue = (self._turn - 1) % (len(self.queues) - 1) + 1
        if self.queues[queue].min_key() > self.settings.anchor_weight * self.queues[0].min_key():
            queue = 0
        self._status = self._end_status(self.queues[queue].min_key())
        if self._status is not None:
            return None
        explore = self.rules.informed and self._turn % EXPLORE_EVERY == 0
        node = self._pop_random() if explore else self._pop_least_key(queue)
        return None if node is None else (node, queue)

    def _end_status(self, key: float) -> Status | None:
        """Return the status with which the search ends before it expands a node of this key, or None."""
        if self.arrival is not None and self.goal_cost <= key:
            return Status.OK
        if self._is_spent():
            return Status.NODE_LIMIT
        return Status.TIME_LIMIT if working_time() >= self._deadline else None

    @property
    def counts(self) -> tuple[int, ...]:
        """The number of expansions that each queue has asked for, the anchor's first."""
        return tuple(self.asked.count(queue) for queue in range(len(self.queues)))

    def _is_spent(self) -> bool:
        """Tell whether the allowed number of expansions has been made."""
        return len(self.expanded) >= self.settings.max_expansions

    def _pop_random(self) -> Node | None:
        """Draw an open node, whatever its key; None if there is none, or `_make_node` refuses it."""
        drawn = self.exploration.pop(self.rng)
        return None if drawn is None else self._make_node(*drawn, 0)

    def _pop_least_key(self, queue: int) -> Node | None:
        """Take the open node of least key from a queue; None if its state was reached before as cheaply.

        If nothing is open, it is a random node that was expanded before, to try new moves from it.
        """
        if self.queues[queue].min_key() == np.inf:  # nothing open: try new moves from an old node
            return self.expanded[self.rng.integers(len(self.expanded))]
        return self._make_node(*self.queues[queue].pop(), 0 if self.rules.shared else queue)

    def _make_node(self, block: Block, child: int, closed: int) -> Node | None:
        """Make a child's node and record its cost; None if its state was expanded before at no higher cost.

        Args:
            block: the block that holds the child.
            child: its number there.
            closed: index of the table that holds the costs of expanded states: 0, or that of the queue if
                each queue has its own.
        """
        node = block.content.make(child)
        best = self.best_costs[closed]
        state = node.state()
        if best.get(state, np.inf) <= node.cost:
            return None
        best[state] = node.cost
        return node

    def _request_expansion(self, node: Node, queue: int) -> Call:
        """Propose moves from a node, for the queue that asks; return the call that computes its children."""
        moves = self.rules.propose(self.scene, node, self.rng, self.settings, len(self.expanded))
        self._pending = node, queue, moves
        return expansion_call(
            node.packed, moves, self._wanted_clearance(node, moves), self.fields.table, edges=self.rules.edges
        )

    def accept(self, answer: np.ndarray) -> None:
        """Push the clear children of the node being expanded onto the queues, and keep a path to the goal."""
        assert self._pending is not None
        (node, queue, moves), self._pending = self._pending, None
        made = expansion(answer, moves, edges=self.rules.edges)
        costs, heuristics = self.rules.price(self.scene, made, self.fields)
        children = Children(node, moves, made, node.cost + costs)
        ahead = made.heuristics[0]
        self.expanded.append(node)
        self.asked.append(queue)
        valid = (made.slacks >= 0) & (made.steps > 0)  # a move of zero length leads nowhere
        if moves.allowed is not None:
            valid &= moves.allowed
        arrived = ahead <= ARRIVED
        if self.rules.direct and made.onward is not None:
            arrived |= made.onward >= 0
        arrived &= valid
        if arrived.any():
            best = int(np.argmin(np.where(arrived, children.costs + ahead, np.inf)))
            self._update_arrival(children.make(best))
        keys = children.costs + self.settings.heuristic_weight * heuristics
        block = Block(children, np.where(valid, keys, np.inf).reshape(len(self.queues), -1))
        for index in range(len(self.queues)) if self.rules.shared else (queue,):
            self.queues[index].push(block)
        self.exploration.push(block, (int(node.cost), int(node.ahead)))

    def _update_arrival(self, node: Node) -> None:
        """Keep a node if the path through it and straight on to the goal is the cheapest so far."""
        if node.cost + node.ahead < self.goal_cost:
            self.goal_cost, self.arrival = node.cost + node.ahead, node

    def _wanted_clearance(self, node: Node, moves: Moves) -> np.ndarray:
        """Return the clearance, rad, wanted on the intervals of a node's moves, then of motions onward."""
        if not self.rules.edges:  # the printed method knows no clearance
            return np.zeros(EDGE_INTERVALS + ONWARD_INTERVALS)
        # the longest move stands for all, and the node's own way to the goal for its children's
        longest = np.sqrt(np.max(np.sum(moves.turns * moves.turns, axis=1))) / self.scene.attitude_step
        onward = _tapered_clearance(self.settings, node, _ONWARD_FRACTIONS, max(node.ahead - longest, 0.0))
        return np.concatenate([_tapered_clearance(self.settings, node, _EDGE_FRACTIONS, longest), onward])


def _tapered_clearance(
    settings: SearchSettings, node: Node, fraction: np.ndarray, length: float
) -> np.ndarray:
    """Return the clearance, rad, wanted on intervals of a straight motion from a node.

    It shrinks to zero near start and goal.

    Args:
        settings: gives the clearance wanted far from start and goal.
        node: where the motion begins.
        fraction: (k + 1,) ends of the k intervals, as fractions of the motion.
        length: steps of the whole motion.

    Returns:
        (k,) rad.
    """
    steps = np.minimum(node.cost + fraction[:-1] * length, node.ahead - fraction[1:] * length)
    return np.asarray(tapered(settings.clearance, steps))
