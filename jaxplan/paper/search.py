"""The printed planner, multi-heuristic A*, and the weighted A* that the paper's Table 4 compares it with.

The *printed* planner is the paper's, of section 3.2.2, corrected by the errata. Every joint moves by a whole
step up or down (equation 9), or onto its goal once that is within a step, and stays there; the platform turns
by a whole step about random axes (equation 10), or onto the goal attitude once that is within a step, and
stays there. Every edge costs the sum of all steps (equation 16), nodes are checked and edges are not, the
queues are independent, and the heuristics are those of equation (15). It is incomplete, since no joint can
leave its goal value again.

Of weighted A* the paper says no more than its name and that steps, time and expansions are limited alike. So
it is the printed planner with a single queue, keyed by ``g + w1 h_0`` with ``h_0`` of equation (15), which is
admissible and consistent for the cost (16). A path found costs at most ``w1`` times the cheapest in the graph
of the moves that were drawn.

An *expansion* tries each of A turns of the platform combined with each of M moves of the 2n joints. Results
are OK, NODE_LIMIT or TIME_LIMIT.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from jaxplan.model.scenario import SearchSettings
from jaxplan.search.astar import Node, Rules, search_by, unrotated
from jaxplan.search.expansion import Expansion, Moves, chosen
from jaxplan.search.fields import Fields
from jaxplan.search.kernel_calls import Scenes
from jaxplan.search.scene import Scene, SearchResult

# Up to three terminals all 2^(2n) joint moves are tried, beyond that a sample of as many as three have.
JOINT_MOVES = 64
_UP, _STAY, _DOWN = 0, 1, 2


def search_mha(scenes: Scenes, settings: Sequence[SearchSettings]) -> list[SearchResult]:
    """Search a path for each scene with the printed planner.

    Args:
        scenes: the problems.
        settings: one for each scene; the clearance is not used.

    Returns:
        For each scene OK with a path whose nodes are clear, or the limit that ended the search. Edges may cut
        a zone.
    """
    rules = Rules(
        propose=propose, price=price, edges=False, shared=False, direct=False, queues=3, informed=False
    )
    return search_by(rules, scenes, settings)


def propose(
    scene: Scene, node: Node, rng: np.random.Generator, settings: SearchSettings, number: int
) -> Moves:
    """Draw the moves to try from a node by equations (9) and (10).

    Args:
        scene: the problem.
        node: to be expanded.
        rng: source of random numbers; its state advances.
        settings: give the number of turns of the platform.
        number: of the expansion; not used.

    Returns:
        The moves. Those that leave a joint's range, and those that repeat another, are not allowed.
    """
    del number  # all expansions are alike
    vectors = rng.standard_normal((settings.attitude_moves, 3))
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    # (10) turns on the left of the attitude relative to the start; on the right of it, it is the same
    # turn in body axes
    turns = scene.attitude_step * unrotated(node.since, unit)
    reached = np.linalg.norm(node.to_goal) < scene.attitude_step
    if reached:
        turns[:] = node.to_goal

    left = scene.goal_joints - node.joints
    snap = np.abs(left) <= scene.joint_steps
    options = np.stack(
        [
            np.where(snap, left, scene.joint_steps),
            np.zeros_like(left),
            np.where(snap, left, -scene.joint_steps),
        ]
    )
    choice = _joint_moves(len(left), rng)
    moved = node.joints + chosen(options, choice)
    inside = (moved >= scene.joint_ranges[:, 0]) & (moved <= scene.joint_ranges[:, 1])
    repeated = snap & (choice == _DOWN)  # a joint on its way to the goal has one move, not two
    allowed = np.broadcast_to(np.all(inside & ~repeated, axis=1), (len(turns), len(choice))).copy()
    if reached:
        allowed[1:] = False  # likewise the attitude
    return Moves(turns, options[None], choice, allowed)


def _joint_moves(joints: int, rng: np.random.Generator) -> np.ndarray:
    """Option of each joint in each of M joint moves, (M, joints): all combinations if few, or random ones.

    Options are `_UP` and `_DOWN`; there are at most `JOINT_MOVES` moves.
    """
    if 2**joints <= JOINT_MOVES:
        return np.array(list(product((_UP, _DOWN), repeat=joints)), dtype=np.int32)
    return rng.choice(np.array([_UP, _DOWN], dtype=np.int32), (JOINT_MOVES, joints))


def price(scene: Scene, expansion: Expansion, fields: Fields) -> tuple[np.ndarray, np.ndarray]:
    """Costs of moves by equation (16), and heuristics of their children by equation (15), in rad.

    Returns:
        (A, M) costs of A turns of the platform by M joint moves, and (3, A, M) heuristics, one for each
        queue.
    """
    del fields  # the printed planner does not use distance fields
    whole = scene.attitude_step + np.sum(scene.joint_steps)
    return np.full(expansion.steps.shape, whole), expansion.heuristics[1:]


def search_wastar(scenes: Scenes, settings: Sequence[SearchSettings]) -> list[SearchResult]:
    """Search a path for each scene with weighted A*.

    Args:
        scenes: the problems.
        settings: one for each scene; the clearance and the anchor's weight are not used.

    Returns:
        For each scene OK with a path whose nodes are clear, or the limit that ended the search. Edges may cut
        a zone.
    """
    # an anchor, and one queue that is its equal and so is always followed
    rules = Rules(
        propose=propose,
        price=price_alone,
        edges=False,
        shared=True,
        direct=False,
        queues=2,
        informed=False,
    )
    results = search_by(rules, scenes, settings)
    return [replace(result, queue_expansions=(result.expansions,)) for result in results]


def price_alone(scene: Scene, expansion: Expansion, fields: Fields) -> tuple[np.ndarray, np.ndarray]:
    """Costs of moves by equation (16), and the heuristic ``h_0`` of their children by equation (15), in rad.

    Returns:
        (A, M) costs of A turns of the platform by M joint moves, and (2, A, M) the same ``h_0`` for two
        queues.
    """
    costs, heuristics = price(scene, expansion, fields)
    return costs, heuristics[[0, 0]]
