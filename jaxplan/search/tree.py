"""The tree of a search: nodes, the moves tried from one, and its children before they are made nodes."""

from dataclasses import dataclass

import jax
import numpy as np
from jax import Array
from numpy.typing import ArrayLike

from jaxplan import quaternion, so3
from jaxplan.path import Path
from jaxplan.search.kernels import Expansion
from jaxplan.search.problem import Scene
from jaxplan.zones import capacity

# A node this near to the goal, in steps, is the goal.
ARRIVED = 1e-9
# Paths of up to this many nodes share their compiled kernels.
_ROWS = 32


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
class Moves:
    """What an expansion tries: every attitude move with every joint move.

    Attributes:
        turns: (A, 3) rotation vectors, body axes.
        options: (A or 1, 3, 2n) change of each joint under its three options, rad.
        choice: (M, 2n) int32, the option of each joint in each joint move.
        allowed: (A, M) bool, or None where nothing is ruled out beforehand.
    """

    turns: np.ndarray
    options: np.ndarray
    choice: np.ndarray
    allowed: np.ndarray | None = None


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


def unrotated(quaternion: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (k, 3) turned by the inverse of a unit quaternion."""
    scalar, vector = quaternion[0], quaternion[1:]
    twice = 2 * np.cross(vectors, vector)
    return vectors + scalar * twice + np.cross(twice, vector)


def steps_between(scene: Scene, rotation: ArrayLike, joint_change: np.ndarray) -> np.ndarray:
    """Cost of straight motions in steps, `jaxplan.path.step_cost` in numpy.

    Args:
        scene: gives the steps.
        rotation: (...) rad.
        joint_change: (..., 2n) rad.
    """
    joint = np.max(np.abs(joint_change) / scene.joint_steps, axis=-1, initial=0.0)
    return np.maximum(np.asarray(rotation) / scene.attitude_step, joint)


def make_root(scene: Scene) -> Node:
    """The start as a node."""
    packed = np.concatenate([[1.0, 0.0, 0.0, 0.0], scene.goal_coordinates, scene.start_joints])
    change = scene.goal_joints - scene.start_joints
    ahead = float(steps_between(scene, np.linalg.norm(scene.goal_coordinates), change))
    return Node(packed, 0.0, ahead, None)


@jax.jit
def _attitudes(scene: Scene, since: Array) -> Array:
    return jax.numpy.asarray(scene.start_attitude) @ quaternion.to_matrix(since)


def attitudes(scene: Scene, nodes: list[Node]) -> np.ndarray:
    """(k, 3, 3) body to inertial, of k nodes."""
    since = np.tile([1.0, 0.0, 0.0, 0.0], (max(_ROWS, capacity(len(nodes))), 1))
    since[: len(nodes)] = [node.since for node in nodes]
    return np.array(_attitudes(scene, since))[: len(nodes)]


def trace(scene: Scene, arrival: Node) -> Path:
    """The path from the start through a node's ancestors, and straight on to the goal.

    Every straight motion is cut into equal parts of at most one step.

    Args:
        scene: the problem.
        arrival: the node from which the straight motion is clear, or the goal itself.
    """
    chain: list[Node] = []
    node: Node | None = arrival
    while node is not None:
        chain.append(node)
        node = node.parent
    chain.reverse()
    nodes = attitudes(scene, chain)
    nodes[0] = scene.start_attitude  # both ends to the last bit
    corners = np.array([node.joints for node in chain])
    if arrival.ahead > ARRIVED:
        nodes = np.concatenate([nodes, scene.goal_attitude[None]])
        corners = np.concatenate([corners, scene.goal_joints[None]])
    elif len(chain) > 1:
        nodes[-1], corners[-1] = scene.goal_attitude, scene.goal_joints
    return subdivide(scene, nodes, corners)


@jax.jit
def _between(first: Array, second: Array, fraction: Array) -> Array:
    return so3.geodesic(first, second, fraction)


def subdivide(scene: Scene, corners: np.ndarray, joints: np.ndarray) -> Path:
    """The path along straight motions between corners, cut into equal parts of at most one step.

    Args:
        scene: gives the steps.
        corners: (k + 1, 3, 3) attitudes.
        joints: (k + 1, 2n) rad.
    """
    rough = make_path(scene, corners, joints)
    parts = np.maximum(np.ceil(rough.edge_costs - ARRIVED).astype(int), 1)
    if np.all(parts == 1):
        return rough
    edge = np.repeat(np.arange(len(parts)), parts)
    fraction = np.concatenate([np.arange(1, count + 1) / count for count in parts])
    size = max(_ROWS, capacity(len(edge)))
    ends = [np.broadcast_to(np.eye(3), (size, 3, 3)).copy() for _ in range(2)]
    ends[0][: len(edge)], ends[1][: len(edge)] = corners[edge], corners[edge + 1]
    padded = np.zeros(size)
    padded[: len(edge)] = fraction
    new = np.asarray(_between(ends[0], ends[1], padded))[: len(edge)].copy()
    whole = fraction == 1
    new[whole] = corners[1:]
    change = joints[edge + 1] - joints[edge]
    new_joints = np.where(whole[:, None], joints[edge + 1], joints[edge] + fraction[:, None] * change)
    return make_path(scene, np.concatenate([corners[:1], new]), np.concatenate([joints[:1], new_joints]))


def make_path(scene: Scene, path_attitudes: np.ndarray, joints: np.ndarray) -> Path:
    """A path with the cost of its edges.

    Args:
        scene: gives the steps.
        path_attitudes: (m + 1, 3, 3).
        joints: (m + 1, 2n) rad.
    """
    chord = np.linalg.norm(np.diff(path_attitudes, axis=0), axis=(1, 2))  # 2 sqrt(2) sin(rotation / 2)
    rotation = 2 * np.arcsin(np.minimum(chord / np.sqrt(8), 1))
    costs = steps_between(scene, rotation, np.diff(joints, axis=0))
    return Path(attitudes=path_attitudes, joints=joints, edge_costs=costs)
