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

from functools import partial
from itertools import product

import numpy as np

from jaxplan.scenario.model import SearchSettings
from jaxplan.search.multi_heuristic import Rules, run
from jaxplan.search.problem import Scene, SearchResult
from jaxplan.search.tree import Moves, Node, make_root, printed_heuristics, steps_between, to_go

JOINT_MOVES = 48
# Steps that moves away from the goal keep from the joint limits: a trajectory swings past its nodes.
JOINT_RESERVE = 0.2
_TOWARD = 0  # option 1 is to stay, 2 to go away


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
    root = make_root(scene)
    coordinates = root.to_goal  # the goal in exponential coordinates about the start
    node = np.concatenate([root.packed[:12], [np.linalg.norm(coordinates), np.sum(np.abs(coordinates))]])
    printed = printed_heuristics(node[None], (scene.goal_joints - root.joints)[None])[:, 0, 0]
    return to_go(scene, root) / np.maximum(printed, 1e-300)


def propose(scene: Scene, node: Node, rng: np.random.Generator, settings: SearchSettings) -> Moves:
    """Moves from a node, see the module's text."""
    turns = np.zeros((settings.attitude_moves + 2, 3))
    angle = float(np.linalg.norm(node.to_goal))
    turns[0] = node.to_goal * min(1.0, scene.attitude_step / max(angle, 1e-300))
    vectors = rng.standard_normal((settings.attitude_moves, 3))
    turns[2:] = scene.attitude_step * vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    remaining = scene.goal_joints - node.joints
    toward = np.clip(remaining, -scene.joint_steps, scene.joint_steps)
    away = np.where(remaining > 0, -scene.joint_steps, scene.joint_steps)
    bound = np.maximum(scene.joint_limits - JOINT_RESERVE * scene.joint_steps, np.abs(node.joints))
    away = np.clip(node.joints + away, -bound, bound) - node.joints
    options = np.stack([toward, np.zeros_like(toward), away])

    choice = _joint_moves(len(remaining), rng)
    joint_moves = np.any(np.take_along_axis(options, choice, axis=0) != 0, axis=1)
    allowed = np.any(turns != 0, axis=1)[:, None] | joint_moves  # staying altogether leads nowhere
    return Moves(turns, options, choice, allowed)


def _joint_moves(joints: int, rng: np.random.Generator) -> np.ndarray:
    """(M, joints) options of each joint move: all combinations where they are few, else a sample."""
    if 3**joints <= JOINT_MOVES:
        return np.array(list(product(range(3), repeat=joints)), dtype=np.int32)
    choice = rng.integers(0, 3, (JOINT_MOVES, joints), dtype=np.int32)
    choice[0] = _TOWARD
    return choice


def price(
    scene: Scene, moves: Moves, nodes: np.ndarray, joints: np.ndarray, *, scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Step costs and heuristics of the children, in steps.

    Args:
        scene: the problem.
        moves: what was tried.
        nodes: (A, 14) of the attitude moves, see `kernels.expand`.
        joints: (M, 2n) rad of the joint moves.
        scale: (3,) factors of the printed heuristics.

    Returns:
        (A, M) costs and (4, A, M) heuristics, the anchor first.
    """
    changes = np.take_along_axis(moves.options, moves.choice, axis=0)
    cost = steps_between(scene, np.linalg.norm(moves.turns, axis=1)[:, None], changes)
    left = scene.goal_joints - joints
    anchor = steps_between(scene, np.linalg.norm(nodes[:, 9:12], axis=1)[:, None], left)
    return cost, np.concatenate([anchor[None], printed_heuristics(nodes, left) * scale[:, None, None]])
