"""How the default planner proposes and prices children: an expansion that can leave the goal's values again.

Attitude moves: toward the goal, stay, and random directions; each joint goes toward its goal, stays or goes
away, of which a sample of combinations is tried. The joints of a terminal that a keep-in zone holds follow
the zone instead of staying. Moves are `SCALES` steps long in turn, and clipped at goal and limits, not
dropped.

The cost of a move is the steps it takes, the largest over platform and joints, so the cost of the straight
motion, ``h_max``, never exceeds the true remaining cost and satisfies the triangle inequality: it is the
anchor. (``h_0`` of equation 15 is admissible for the printed cost only.) With the anchor consistent, a path
found by the queues costs at most ``w1 w2`` times the cheapest in the graph of the moves that were drawn; of
the continuous problem that graph is a sample, so there it is no bound.

The further queues are the three heuristics of equation (15), and two that see the zones (`fields`), each
scaled to agree with the anchor at the start, so that the weight ``w2`` compares like with like.
"""

import math
from functools import partial
from itertools import product

import numpy as np

from jaxplan.geometry import rotations
from jaxplan.model.scenario import SearchSettings
from jaxplan.model.spacecraft import joints_along
from jaxplan.search.fields import Fields
from jaxplan.search.kernels import Expansion, Moves
from jaxplan.search.multi_heuristic import Rules
from jaxplan.search.problem import JOINT_RESERVE, Scene
from jaxplan.search.tree import Node, unrotated

JOINT_MOVES = 48
# Lengths of the moves in steps, one after the other (multi-resolution A*).
SCALES = (8.0, 4.0, 8.0, 2.0)
# The anchor, the three heuristics of equation (15), and two that see the zones.
QUEUES = 6
_TOWARD, _STAY, _AWAY = 0, 1, 2


def rules(scene: Scene) -> Rules:
    """How the default planner proposes and prices children."""
    return Rules(
        propose=propose,
        price=partial(price, scale=_scale_to_anchor(scene)),
        edges=True,
        shared=True,
        direct=True,
        queues=QUEUES,
        informed=True,
    )


def _scale_to_anchor(scene: Scene) -> np.ndarray:
    """(3,) factors that make the heuristics of equation (15) equal the anchor at the start."""
    turn = scene.goal_coordinates  # of the goal about the start, where all of them are taken
    left = np.abs(scene.goal_joints - scene.start_joints)
    joints, angle = np.sum(left), np.linalg.norm(turn)
    printed = [angle + joints, angle + np.linalg.norm(left), np.sum(np.abs(turn)) + joints]
    return scene.straight_steps / np.maximum(printed, 1e-300)


def propose(
    scene: Scene, node: Node, rng: np.random.Generator, settings: SearchSettings, number: int
) -> Moves:
    """Moves from a node, see the module's text."""
    scale = SCALES[number % len(SCALES)]
    attitude_step, joint_steps = scale * scene.attitude_step, scale * scene.joint_steps
    turns = np.zeros((settings.attitude_moves + 2, 3))
    angle = math.hypot(*node.to_goal.tolist())
    turns[0] = node.to_goal * min(1.0, attitude_step / max(angle, 1e-300))
    vectors = rng.standard_normal((settings.attitude_moves, 3))
    turns[2:] = vectors * (attitude_step / np.sqrt(np.sum(vectors * vectors, axis=1)))[:, None]

    remaining = scene.goal_joints - node.joints
    options = np.zeros((3, len(remaining)))
    options[_TOWARD] = np.maximum(np.minimum(remaining, joint_steps), -joint_steps)
    away = node.joints + np.where(remaining > 0, -joint_steps, joint_steps)
    bound = np.maximum(scene.joint_limits - JOINT_RESERVE * scene.joint_steps, np.abs(node.joints))
    options[_AWAY] = np.maximum(np.minimum(away, bound), -bound) - node.joints
    held = np.flatnonzero(scene.held)
    choice = _joint_moves(scene, rng)
    if not len(held):
        return Moves(turns, options[None], choice)
    every = np.repeat(options[None], len(turns), axis=0)
    every[:, _STAY] = _following(scene, node, turns, held, bound)
    return Moves(turns, every, choice)


def _following(
    scene: Scene, node: Node, turns: np.ndarray, held: np.ndarray, bound: np.ndarray
) -> np.ndarray:
    """Joint changes, (A, 2n), that turn held terminals onto the axis of their keep-in cone; else zero."""
    now = unrotated(node.since, scene.held_axes[held] @ scene.start_attitude)  # (held, 3), body axes
    turned = np.stack(rotations.exp(turns.T), axis=-1)
    seen = unrotated(turned, now)
    joints = np.repeat(node.joints[None], len(turns), axis=0)
    joints[:, np.append(held, held + len(scene.mounts))] = joints_along(scene.mounts[held], seen)
    return np.maximum(np.minimum(joints, bound), -bound) - node.joints


def _joint_moves(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """(M, 2n) options of each joint move: all combinations where they are few, else a sample."""
    joints = len(scene.joint_limits)
    if 3**joints <= JOINT_MOVES:
        return np.array(list(product(range(3), repeat=joints)), dtype=np.int32)
    choice = rng.integers(0, 3, (JOINT_MOVES, joints), dtype=np.int32)
    choice[0] = _TOWARD
    if np.any(scene.held):
        held = np.tile(scene.held, 2)
        choice[1 : JOINT_MOVES // 2, held] = _STAY  # half of the moves keep every link
    return choice


def price(
    scene: Scene, expansion: Expansion, fields: Fields, *, scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Costs (A, M) and heuristics (6, A, M) of the children in steps, the anchor first.

    Args:
        scene: the problem.
        expansion: the children.
        fields: the distance fields; until there are any their two heuristics are infinite.
        scale: (3,) factors of the printed heuristics.
    """
    heuristics = np.empty((QUEUES, *expansion.steps.shape))
    heuristics[0] = ahead = expansion.heuristics[0]
    np.multiply(expansion.heuristics[1:], scale[:, None, None], out=heuristics[1:4])
    if fields.known:
        halves = scene.straight_steps / 2 / np.maximum([fields.start.sum(), fields.start.max()], 1e-300)
        np.multiply(expansion.fields, halves[:, None, None], out=heuristics[4:])
        heuristics[4] += ahead / 2
        heuristics[5] += heuristics[2] / 2
    else:
        heuristics[4:] = np.inf
    return expansion.steps, heuristics
