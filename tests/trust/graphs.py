"""The multi-heuristic search on graphs so small that all of their ways can be looked at.

The platform turns about one axis and one terminal moves, all in whole steps within bounds: a lattice. Further
queues are led astray by random heuristics; the anchor's is consistent, so that a way found costs at most
``w1 w2`` times the cheapest. That is known from Dijkstra's algorithm (scipy) on edges that numpy samples. The
kernel's edges are clear by a bound, which refuses some that samples pass: so the cheapest way lies between
those on edges that are clear by `SURE`, and on edges that are clear at all.
"""

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise, product

import numpy as np
from builders import at_rest, make_spacecraft, scene_of
from reference import boresights, sampled_margin
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from jaxplan.model.scenario import Scenario, SearchSettings
from jaxplan.model.status import Status
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.runtime.batching import padded_count
from jaxplan.search import Scene, find_barrier
from jaxplan.search.astar import Rules, search_by
from jaxplan.search.expansion import Moves
from jaxplan.search.kernel_calls import Scenes

SIZE = np.array([5, 7, 5])  # values of turn, yaw and pitch
STEPS = np.array([0.25, 0.3, 0.12])  # rad, of a move
ATTITUDE_STEP, JOINT_STEP = 0.2, 0.3  # rad, that cost one: moves cost 1.25, 1 and 0.4
AXIS = np.array([0.48, -0.6, 0.64])
SURE = 0.02  # rad, by which the kernel's bound passes every edge
SAMPLES = 17
QUEUES = 4
ROWS = 8  # attitude moves of a kernel call, as many as the default planner's, whose kernel it is
CONES = 6


@dataclass(frozen=True, kw_only=True)
class Puzzle:
    """A scene on the lattice, from one of its nodes to another.

    Attributes:
        scene: the search problem.
        start: (3,) indices of the start.
        base: attitude at which the turn's index is 0.
        w1: weight of the heuristics.
        w2: of the anchor.
    """

    scene: Scene
    start: np.ndarray
    base: Rotation
    w1: float
    w2: float


@cache
def nodes() -> np.ndarray:
    """(N, 3) indices of all nodes."""
    return np.array(list(product(*map(range, SIZE))))


def values(index: np.ndarray) -> np.ndarray:
    """Turn, yaw and pitch, rad."""
    return (index - (SIZE - 1) / 2) * STEPS


def puzzle(seed: int, shrink: float = 1.0) -> Puzzle:
    """A random one, with its cones made smaller by a factor."""
    rng = np.random.default_rng([seed, 3])
    craft = make_spacecraft(1)
    base = Rotation.random(rng=rng)
    start, goal = (np.array([rng.integers(size) for size in SIZE]) for _ in range(2))
    places = values(np.array([start, goal]))
    states = [
        at_rest((base * Rotation.from_rotvec(turn * AXIS)).as_rotvec(), [yaw, pitch])
        for turn, yaw, pitch in places
    ]
    scenario = Scenario(
        name=f"puzzle {seed}",
        spacecraft=craft,
        start=states[0],
        goal=states[1],
        search=SearchSettings(attitude_step=ATTITUDE_STEP, joint_step=JOINT_STEP),
    )
    scene = scene_of(scenario)
    seen = looks(scene, base)
    ends = [int(np.flatnonzero(np.all(nodes() == index, axis=1))[0]) for index in (start, goal)]
    cones: list[KeepOut | KeepIn] = []
    while len(cones) < CONES:  # around what is seen somewhere, clear at both ends
        direction = seen[rng.integers(len(seen))] + 0.2 * rng.standard_normal(3)
        direction /= np.linalg.norm(direction)
        room = np.min(np.arccos(np.clip(seen[ends] @ direction, -1, 1))) - SURE
        half_angle = min(rng.uniform(0.08, 0.4), room)
        if half_angle > 0.05:
            cones.append(KeepOut(name=f"c{len(cones)}", direction=direction, half_angle=shrink * half_angle))
    assert padded_count(len(cones)) == 8
    return Puzzle(
        scene=scene_of(replace(scenario, keep_out=tuple(cones))),
        start=start,
        base=base,
        w1=float(rng.choice([1.0, 1.5, 3.0, 8.0])),
        w2=float(rng.choice([1.0, 1.3, 2.0])),
    )


def looks(scene: Scene, base: Rotation) -> np.ndarray:
    """(N, 3) inertial boresights at all nodes."""
    attitudes, joints = states_at(base, values(nodes()))
    return boresights(scene, attitudes, joints)[:, 0]


def states_at(base: Rotation, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return (base * Rotation.from_rotvec(places[:, :1] * AXIS)).as_matrix(), places[:, 1:]


def cheapest(one: Puzzle, clear: float) -> float:
    """Cost of the cheapest way along edges whose samples are clear by so much; infinity for none."""
    every = nodes()
    moves = np.array([move for move in product((-1, 0, 1), repeat=3) if move > (0, 0, 0)])  # one way
    first, second, cost = [], [], []
    fraction = np.linspace(0, 1, SAMPLES)[:, None]
    for move in moves:
        there = every + move
        inside = np.flatnonzero(np.all((there >= 0) & (there < SIZE), axis=1))
        along = values(every[inside])[:, None] + fraction * (move * STEPS)
        attitudes, joints = states_at(one.base, along.reshape(-1, 3))
        margin = sampled_margin(one.scene, attitudes, joints).reshape(len(inside), SAMPLES).min(axis=1)
        open_ = inside[margin >= clear]
        first.append(open_)
        second.append(np.ravel_multi_index((every[open_] + move).T, SIZE))
        rotation, *change = np.abs(move * STEPS)
        cost.append(np.full(len(open_), max(rotation / ATTITUDE_STEP, max(change) / JOINT_STEP)))
    size = (len(every), len(every))
    graph = coo_matrix((np.concatenate(cost), (np.concatenate(first), np.concatenate(second))), shape=size)
    begin = int(np.ravel_multi_index(one.start, SIZE))
    goal = np.argmin(
        np.linalg.norm(states_at(one.base, values(every))[0] - one.scene.goal_attitude, axis=(1, 2))
        + np.max(np.abs(values(every)[:, 1:] - one.scene.goal_joints), axis=1)
    )
    return float(dijkstra(graph.tocsr(), directed=False, indices=begin)[goal])


def rules(one: Puzzle, seed: int) -> Rules:
    """Whole steps on the lattice; heuristics of which only the anchor's is any good."""
    noise = np.random.default_rng([seed, 4])
    turns = np.zeros((ROWS, 3))
    turns[:2] = np.array([[1], [-1]]) * STEPS[0] * AXIS
    options = np.array([[STEPS[1:], [0, 0], -STEPS[1:]]])
    choice = np.array(list(product(range(3), repeat=2)), dtype=np.int32)
    low, high = values(np.zeros(3)), values(SIZE - 1)
    goal_turn = values(one.start)[0] + one.scene.goal_coordinates @ AXIS

    def propose(scene, node, rng, settings, number):
        turn = goal_turn - node.to_goal @ AXIS + np.append([STEPS[0], -STEPS[0]], np.zeros(ROWS - 2))
        joints = node.joints + options[0][choice, np.arange(2)]
        allowed = (np.abs(turn) <= high[0] + 1e-6)[:, None] & np.all(
            (joints >= low[1:] - 1e-6) & (joints <= high[1:] + 1e-6), axis=1
        )
        allowed[3:] = False  # these stay, as the one before
        return Moves(turns, options, choice, allowed)

    def price(scene, expansion, fields):
        anchor = expansion.heuristics[0]
        astray = noise.uniform(0, 4, (QUEUES - 1, *anchor.shape)) * (anchor + 1)
        return expansion.steps, np.concatenate([anchor[None], astray])

    return Rules(
        propose=propose,
        price=price,
        edges=True,
        shared=True,
        direct=False,
        queues=QUEUES,
        informed=False,
    )


def found(one: Puzzle, seed: int) -> float:
    """Cost of the way that the search finds; infinity for none."""
    settings = SearchSettings(
        heuristic_weight=one.w1, anchor_weight=one.w2, clearance=0.0, max_expansions=1500, time_limit=np.inf
    )
    result = search_by(rules(one, seed), Scenes([one.scene]), [settings])[0]
    assert (result.status is Status.OK) == (result.path is not None)
    return np.inf if result.path is None else result.path.length


def attempt(seed: int) -> str:
    """The bound holds, what is found is a way, and where there is none nothing is found."""
    one = puzzle(seed)
    sure, possible, cost = cheapest(one, SURE), cheapest(one, 0.0), found(one, seed)
    assert cost >= possible - 1e-9, "cheaper than the cheapest"
    if np.isfinite(sure):
        assert cost <= one.w1 * one.w2 * sure + 1e-9, (cost, sure, one.w1, one.w2)
    if find_barrier(one.scene) is not None:
        assert np.isinf(possible), "a barrier where there is a way"
    return (
        "without a way" if np.isinf(cost) else "the cheapest" if cost <= sure + 1e-9 else "within the bound"
    )


def shrinking(seed: int) -> str:
    """A scene that can be solved can be solved with smaller cones, and no barrier appears."""
    ways = []
    for shrink in (1.0, 0.85, 0.6):
        one = puzzle(seed, shrink)
        ways.append((np.isfinite(found(one, seed)), find_barrier(one.scene) is None))
    for (solved, free), (still, yet) in pairwise(ways):
        assert still or not solved, "unsolvable with smaller cones"
        assert yet or not free, "a barrier of smaller cones"
    return f"solved from size {sum(not solved for solved, _ in ways)} on"
