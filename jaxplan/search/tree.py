"""The tree of a search: nodes, and the children of one before they are made nodes."""

from dataclasses import dataclass

import numpy as np

from jaxplan.model.path import Path
from jaxplan.search.kernels import Expansion, Moves
from jaxplan.search.problem import Scene
from jaxplan.search.smoothing.shortcut import ARRIVED, subdivide


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A state of the search.

    Attributes:
        packed: (7 + 2n,) attitude relative to the start as a unit quaternion, rotation vector to the goal in
            body axes, joints, as the kernel takes it.
        cost: ``g``, of the way from the start.
        ahead: cost in steps of the straight motion to the goal, ``h_max``.
        parent: the node before, None for the start.
    """

    packed: np.ndarray
    cost: float
    ahead: float
    parent: "Node | None"

    @property
    def since(self) -> np.ndarray:
        """(4,) unit quaternion of the attitude relative to the start."""
        return self.packed[:4]

    @property
    def to_goal(self) -> np.ndarray:
        """(3,) rotation vector to the goal, body axes."""
        return self.packed[4:7]

    @property
    def joints(self) -> np.ndarray:
        """(2n,) rad."""
        return self.packed[7:]

    def state(self) -> bytes:
        """The same for nodes of the same state; the way to the goal tells the attitude."""
        return (np.rint(self.packed[4:] * 1e9) + 0.0).tobytes()  # + 0.0: no negative zero


@dataclass(frozen=True, slots=True, eq=False)
class Children:
    """The children of a node, before any of them is made a node.

    Attributes:
        parent: their parent.
        moves: what was tried.
        expansion: what the kernel says of it.
        costs: (A, M) ``g``.
    """

    parent: Node
    moves: Moves
    expansion: Expansion
    costs: np.ndarray

    def make(self, child: int) -> Node:
        """The node of one child, numbered attitude move first."""
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


def chosen(options: np.ndarray, choice: np.ndarray) -> np.ndarray:
    """Changes of the joints, (..., 2n), of choices (..., 2n) among options (3, 2n)."""
    return options[choice, np.arange(options.shape[-1])]


# The rows, flattened, are the matrices that take the vector product with e_x, e_y and e_z from the right.
_PRODUCTS = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], float
)


def unrotated(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (k, 3) turned by the inverses of unit quaternions (..., 4): (..., k, 3)."""
    across = (quaternions[..., 1:] @ _PRODUCTS).reshape(*quaternions.shape[:-1], 3, 3)
    twice = 2 * (vectors @ across)
    return vectors + quaternions[..., :1, None] * twice + twice @ across


def make_root(scene: Scene) -> Node:
    """The start as a node."""
    packed = np.concatenate([[1.0, 0.0, 0.0, 0.0], scene.goal_coordinates, scene.start_joints])
    return Node(packed, 0.0, scene.straight_steps, None)


def trace(scene: Scene, arrival: Node) -> Path:
    """The path from the start through a node's ancestors, and straight on to the goal.

    Args:
        scene: the problem.
        arrival: the node from which the straight motion is clear, or the goal itself.
    """
    corners: list[np.ndarray] = []
    if arrival.ahead > ARRIVED:
        corners.append(np.concatenate([scene.goal_quaternion, scene.goal_joints]))
    node: Node | None = arrival
    while node is not None:
        corners.append(np.concatenate([node.since, node.joints]))
        node = node.parent
    return subdivide(scene, np.array(corners[::-1]))
