"""The default planner: multi-heuristic A* with an expansion that can leave the goal's values again.

Attitude moves: toward the goal, stay, and random directions; each joint goes toward its goal, stays or goes
away, of which a sample of combinations is tried that always holds all-toward. Moves are clipped at goal
and limits, not dropped. The cost of a move is the steps it takes, the largest over platform and joints,
so the cost of the straight motion, ``h_max``, never exceeds the true remaining cost and satisfies the
triangle inequality: it is the anchor. (``h_0`` of equation 15 is admissible for the printed cost only.) Each
expansion tries the straight motion to the goal, and all edges are checked whole.

The further queues are the three heuristics of equation (15), each scaled to agree with the anchor at the
start, so that the weight ``w2`` compares like with like.
"""

import math
from functools import partial
from itertools import product

import numpy as np

from jaxplan.scenario.model import SearchSettings
from jaxplan.search.kernels import Expansion
from jaxplan.search.multi_heuristic import Rules, run
from jaxplan.search.problem import Scene, SearchResult
from jaxplan.search.tree import Moves, Node, make_root

JOINT_MOVES = 48
# Steps that moves away from the goal keep from the joint limits: a trajectory swings past its nodes.
JOINT_RESERVE = 0.2
_TOWARD, _AWAY = 0, 2  # option 1 is to stay


def search(scene: Scene, settings: SearchSettings) -> SearchResult:
    """Search a path with the default planner.

    Args:
        scene: the problem.
        settings: see `SearchSettings`.

    Returns:
        OK with a path whose every edge is clear, or why there is none.
    """
    return run(scene, settings, rules(scene))


def rules(scene: Scene) -> Rules:
    """How the default planner proposes and prices children."""
    scale = _scale_to_anchor(scene)
    return Rules(
        propose=propose,
        price=partial(price, scale=scale),
        edges=True,
        shared=True,
        direct=True,
        queues=1 + len(scale),
    )


def _scale_to_anchor(scene: Scene) -> np.ndarray:
    """(3,) factors that make the heuristics of equation (15) equal the anchor at the start."""
    turn = scene.goal_coordinates  # of the goal about the start, where all of them are taken
    left = np.abs(scene.goal_joints - scene.start_joints)
    joints, angle = np.sum(left), np.linalg.norm(turn)
    printed = [angle + joints, angle + np.linalg.norm(left), np.sum(np.abs(turn)) + joints]
    return make_root(scene).ahead / np.maximum(printed, 1e-300)


def propose(scene: Scene, node: Node, rng: np.random.Generator, settings: SearchSettings) -> Moves:
    """Moves from a node, see the module's text."""
    turns = np.zeros((settings.attitude_moves + 2, 3))
    angle = math.hypot(*node.to_goal.tolist())
    turns[0] = node.to_goal * min(1.0, scene.attitude_step / max(angle, 1e-300))
    vectors = rng.standard_normal((settings.attitude_moves, 3))
    turns[2:] = vectors * (scene.attitude_step / np.sqrt(np.sum(vectors * vectors, axis=1)))[:, None]

    remaining = scene.goal_joints - node.joints
    options = np.zeros((3, len(remaining)))
    options[_TOWARD] = np.maximum(np.minimum(remaining, scene.joint_steps), -scene.joint_steps)
    away = node.joints + np.where(remaining > 0, -scene.joint_steps, scene.joint_steps)
    bound = np.maximum(scene.joint_limits - JOINT_RESERVE * scene.joint_steps, np.abs(node.joints))
    options[_AWAY] = np.maximum(np.minimum(away, bound), -bound) - node.joints
    return Moves(turns, options, _joint_moves(len(remaining), rng))


def _joint_moves(joints: int, rng: np.random.Generator) -> np.ndarray:
    """(M, joints) options of each joint move: all combinations where they are few, else a sample."""
    if 3**joints <= JOINT_MOVES:
        return np.array(list(product(range(3), repeat=joints)), dtype=np.int32)
    choice = rng.integers(0, 3, (JOINT_MOVES, joints), dtype=np.int32)
    choice[0] = _TOWARD
    return choice


def price(scene: Scene, expansion: Expansion, *, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Costs (A, M) and heuristics (4, A, M) of the children in steps, the anchor first.

    Args:
        scene: the problem.
        expansion: the children.
        scale: (3,) factors of the printed heuristics.
    """
    del scene  # the kernel has counted the steps
    return expansion.steps, expansion.heuristics * np.concatenate([[1.0], scale])[:, None, None]
