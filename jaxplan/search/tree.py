"""The tree of a search: nodes, the moves tried from one, and its children before they are made nodes."""

from dataclasses import dataclass

import jax
import numpy as np
from numpy.typing import ArrayLike

from jaxplan import so3
from jaxplan.path import Path, motion
from jaxplan.search.problem import Scene
from jaxplan.zones import capacity

_log, _motion = jax.jit(so3.log), jax.jit(motion)


# A node this near to the goal, in steps, is the goal.
ARRIVED = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A state of the search.

    Attributes:
        packed: (12 + 2n,) attitude, rotation vector to the goal, joints, as the kernel takes it.
        cost: ``g``, of the way from the start.
        parent: the node before, None for the start.
    """

    packed: np.ndarray
    cost: float
    parent: "Node | None"

    @property
    def attitude(self) -> np.ndarray:
        """(3, 3)."""
        return self.packed[:9].reshape(3, 3)

    @property
    def to_goal(self) -> np.ndarray:
        """(3,) rotation vector to the goal, body axes."""
        return self.packed[9:12]

    @property
    def joints(self) -> np.ndarray:
        """(2n,) rad."""
        return self.packed[12:]


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """What an expansion tries: every attitude move with every joint move.

    Attributes:
        turns: (A, 3) rotation vectors, body axes.
        options: (3, 2n) change of each joint under its three options, rad.
        choice: (M, 2n) int32, the option of each joint in each joint move.
        allowed: (A, M) bool.
    """

    turns: np.ndarray
    options: np.ndarray
    choice: np.ndarray
    allowed: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Children:
    """The children of a node, before any of them is made a node.

    Attributes:
        parent: their parent.
        nodes: (A, 14) of the attitude moves, as `kernels.expand` returns them.
        joints: (M, 2n) rad of the joint moves.
        costs: (A, M) ``g``.
    """

    parent: Node
    nodes: np.ndarray
    joints: np.ndarray
    costs: np.ndarray

    def make(self, child: int) -> Node:
        """The node of one child, numbered attitude move first."""
        attitude_move, joint_move = divmod(child, len(self.joints))
        packed = np.concatenate([self.nodes[attitude_move, :12], self.joints[joint_move]])
        return Node(packed, float(self.costs[attitude_move, joint_move]), self.parent)


def steps_between(scene: Scene, rotation: ArrayLike, joint_change: np.ndarray) -> np.ndarray:
    """Cost of straight motions in steps, `jaxplan.path.step_cost` in numpy.

    Args:
        scene: gives the steps.
        rotation: (...) rad.
        joint_change: (..., 2n) rad.
    """
    joint = np.max(np.abs(joint_change) / scene.joint_steps, axis=-1, initial=0.0)
    return np.maximum(np.asarray(rotation) / scene.attitude_step, joint)


def printed_heuristics(nodes: np.ndarray, joints_left: np.ndarray) -> np.ndarray:
    """The three heuristics of equation (15): rotation angle, Euclidean and Manhattan distance.

    Args:
        nodes: (A, 14) of the attitude moves, see `kernels.expand`.
        joints_left: (M, 2n) rad from each joint move to the goal.

    Returns:
        (3, A, M) rad.
    """
    absolute = np.sum(np.abs(joints_left), axis=-1)
    euclidean = np.linalg.norm(joints_left, axis=-1)
    attitude = np.stack([np.linalg.norm(nodes[:, 9:12], axis=1), nodes[:, 12], nodes[:, 13]])
    return attitude[:, :, None] + np.stack([absolute, euclidean, absolute])[:, None, :]


def make_root(scene: Scene) -> Node:
    """The start as a node."""
    to_goal = np.asarray(_log(scene.start_attitude.T @ scene.goal_attitude))
    return Node(np.concatenate([scene.start_attitude.ravel(), to_goal, scene.start_joints]), 0.0, None)


def to_go(scene: Scene, node: Node) -> float:
    """Cost in steps of the straight motion from a node to the goal, ``h_max``."""
    return float(steps_between(scene, np.linalg.norm(node.to_goal), scene.goal_joints - node.joints))


def trace(scene: Scene, arrival: Node) -> Path:
    """The path from the start through a node's ancestors, and straight on to the goal.

    The last straight motion is cut into equal parts of at most one step.

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
    steps = to_go(scene, arrival)
    parts = int(np.ceil(steps - ARRIVED)) if steps > ARRIVED else 0
    fractions = np.zeros(capacity(parts))
    fractions[:parts] = np.arange(1, parts + 1) / max(parts, 1)
    change = scene.goal_joints - arrival.joints
    onward = _motion(arrival.attitude, arrival.joints, arrival.to_goal, change, fractions)
    attitudes = np.concatenate([[n.attitude for n in chain], np.asarray(onward[0])[:parts]])
    joints = np.concatenate([[n.joints for n in chain], np.asarray(onward[1])[:parts]])
    attitudes[-1], joints[-1] = scene.goal_attitude, scene.goal_joints  # to the last bit
    return make_path(scene, attitudes, joints)


def make_path(scene: Scene, attitudes: np.ndarray, joints: np.ndarray) -> Path:
    """A path with the cost of its edges.

    Args:
        scene: gives the steps.
        attitudes: (m + 1, 3, 3).
        joints: (m + 1, 2n) rad.
    """
    chord = np.linalg.norm(np.diff(attitudes, axis=0), axis=(1, 2))  # 2 sqrt(2) sin(rotation / 2)
    rotation = 2 * np.arcsin(np.minimum(chord / np.sqrt(8), 1))
    costs = steps_between(scene, rotation, np.diff(joints, axis=0))
    return Path(attitudes=attitudes, joints=joints, edge_costs=costs)
