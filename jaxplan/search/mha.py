"""The default planner: what is quickest first, then multi-heuristic A* and trees in a race.

1. The straight motion to the goal.
2. An elastic band that descends from it (`smoothing`): near the shortest, and often all that is needed.
3. Multi-heuristic A* (`astar`, with the moves and heuristics below), which tries the straight motion again
   from every child (analytic expansion) and, from time to time, expands a random open node, whatever its
   key. All edges are checked whole.
4. Where that takes long, RRT-Connect takes turns with it until one of the two has a path. Heuristics lead a
   search well or, now and then, long astray; trees that grow at random are seldom quick and seldom astray.
   Call by call in turn, the race is never much slower than the better of the two.

Each is a stage, run for all scenes that the stages before left without a path. The paths of 3 and 4 are
smoothed. If a path is a long way round, or if it is asked for, 3 and 4 are then repeated with other random
moves, for paths that pass the zones on other sides, and the shortest is kept.

**Moves**: each expansion offers moves toward the goal and moves that leave the goal's values again. Attitude
moves go toward the goal, stay, or go in random directions; each joint goes toward its goal, stays or goes
away from it, and a sample of the combinations is tried. The joints of a terminal that a keep-in zone holds
(`scene`) follow the zone instead of staying. Moves are `SCALES` steps long in turn, and clipped at goal and
limits, not dropped.

**Heuristics**: the cost of a move is the steps it takes, the largest over platform and joints, so the cost of
the straight motion, ``h_max``, never exceeds the true remaining cost and satisfies the triangle inequality:
it is the anchor's heuristic. (``h_0`` of equation 15 is admissible for the printed cost only.) With the
anchor consistent, a path found by the queues costs at most ``w1 w2`` times the cheapest in the graph of the
moves that were drawn; that graph is a sample of the continuous problem, for which this is no bound. The
further queues are the three heuristics of equation (15), and two that see the zones (`fields`), each scaled
to agree with the anchor at the start, so that the weight ``w2`` compares like with like.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import count, product
from typing import Any

import numpy as np

from jaxplan.geometry import rotations
from jaxplan.model.gimbals import angles_along, in_range
from jaxplan.model.path import Path
from jaxplan.model.scenario import SearchSettings
from jaxplan.model.status import Status
from jaxplan.runtime.stopwatch import working_time
from jaxplan.search.astar import Node, Rules, Search, unrotated
from jaxplan.search.expansion import Expansion, Moves
from jaxplan.search.fields import Fields
from jaxplan.search.kernel_calls import Scenes, SearchRun, completed, picked
from jaxplan.search.paths import straight_paths
from jaxplan.search.rrt_connect import Connect
from jaxplan.search.scene import JOINT_RESERVE, Scene, SearchResult, derived_seed
from jaxplan.search.smoothing import Band, smooth_results, straight_bands
from jaxplan.search.trees import Space

JOINT_MOVES = 48
# Lengths of the moves in steps, one after the other (multi-resolution A*).
SCALES = (8.0, 4.0, 8.0, 2.0)
# The anchor, the three heuristics of equation (15), and two that see the zones.
QUEUES = 6
_TOWARD, _STAY, _AWAY = 0, 1, 2
# A path within this factor of the straight motion's length is not improved further.
SHORT_ENOUGH = 1.001
# A clear band from the straight motion within this factor of its length is taken without a search.
BAND_ENOUGH = 1.05
# Where a path is longer than DETOUR times the straight motion, further searches look for a shorter one, as
# many as DETOUR_LOOKS times the ratio of the lengths, each of few expansions: which way round zones a search
# goes first is a matter of luck.
DETOUR, DETOUR_LOOKS, DETOUR_EXPANSIONS = 1.25, 3, 48
# Expansions after which trees join in.
HEAD_START = 48

Bands = Sequence[Band | None]


def rules(scene: Scene) -> Rules:
    """Return the rules by which the default planner proposes and prices children."""
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
    """Return factors (3,) that make the heuristics of equation (15) equal the anchor's at the start."""
    turn = scene.goal_coordinates  # of the goal about the start, where all of them are taken
    left = np.abs(scene.goal_joints - scene.start_joints)
    joints, angle = np.sum(left), np.linalg.norm(turn)
    printed = [angle + joints, angle + np.linalg.norm(left), np.sum(np.abs(turn)) + joints]
    return scene.straight_steps / np.maximum(printed, 1e-300)


def propose(
    scene: Scene, node: Node, rng: np.random.Generator, settings: SearchSettings, number: int
) -> Moves:
    """Draw the moves to try from a node, see the module's docstring.

    Args:
        scene: the problem.
        node: the node to be expanded.
        rng: where random numbers come from.
        settings: gives the number of random attitude moves.
        number: number of the expansion, from 0; it picks the length of the moves from `SCALES`.
    """
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
    low, high = scene.joint_ranges.T
    reserve = np.minimum(JOINT_RESERVE * scene.joint_steps, (high - low) / 2)
    bounds = np.minimum(low + reserve, node.joints), np.maximum(high - reserve, node.joints)
    options[_AWAY] = np.clip(away, *bounds) - node.joints
    choice = _draw_joint_moves(scene, rng)
    if not scene.held_axes:
        return Moves(turns, options[None], choice)
    every = np.repeat(options[None], len(turns), axis=0)
    every[:, _STAY] = _held_terminal_changes(scene, node, turns, bounds)
    return Moves(turns, every, choice)


def _held_terminal_changes(
    scene: Scene, node: Node, turns: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Return joint changes that turn held terminals onto the axis of their keep-in cone.

    Args:
        scene: the problem, with at least one held terminal.
        node: where the moves begin.
        turns: (A, 3) rotation vectors of the A attitude moves after which the terminals are to point so, rad.
        bounds: (J,) least and (J,) largest joint angles, rad, to which the changes are clipped.

    Returns:
        (A, J) rad; zero for joints of other devices.
    """
    held, axes = np.array(list(scene.held_axes)), np.stack(list(scene.held_axes.values()))
    now = unrotated(node.since, axes @ scene.start_attitude)  # (held, 3), body axes
    turned = np.stack(rotations.exp(turns.T), axis=-1)
    seen = unrotated(turned, now)
    joints = np.repeat(node.joints[None], len(turns), axis=0)
    azimuth, elevation = angles_along(scene.gimbals.frames[held], seen)
    yaw = in_range(azimuth, scene.joint_ranges[held], node.joints[held])
    joints[:, np.append(held, scene.gimbals.pitches[held])] = np.concatenate([yaw, elevation], axis=-1)
    return np.clip(joints, *bounds) - node.joints


def _draw_joint_moves(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Return the option of each joint in each of M joint moves, (M, 2n).

    These are all combinations where they are few, else a random sample.
    """
    joints = len(scene.joint_ranges)
    if 3**joints <= JOINT_MOVES:
        return np.array(list(product(range(3), repeat=joints)), dtype=np.int32)
    choice = rng.integers(0, 3, (JOINT_MOVES, joints), dtype=np.int32)
    choice[0] = _TOWARD
    for terminal in scene.held_axes:  # half of the moves keep every link
        choice[1 : JOINT_MOVES // 2, [terminal, scene.gimbals.pitches[terminal]]] = _STAY
    return choice


def price(
    scene: Scene, expansion: Expansion, fields: Fields, *, scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return costs (A, M) and heuristics (6, A, M) of A by M children in steps, the anchor's first.

    Args:
        scene: the problem.
        expansion: the children.
        fields: the distance fields; while they are not computed their two heuristics are infinite.
        scale: (3,) factors of the printed heuristics, from `_scale_to_anchor`.
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


class Race:
    """A run made of two searches, whose calls are answered in turn; the first to find a path wins.

    Args:
        first: a search.
        second: another search of the same scene.
        head_start: how many calls of the first are answered before the second begins.
    """

    def __init__(self, first: SearchRun, second: SearchRun, *, head_start: int) -> None:
        self._runs = first, second
        self._calls: dict[int, Any] = {}  # calls that the searches wait for, None once ended
        self._results: dict[int, SearchResult] = {}  # results of those that have ended
        self._turn, self._head_start = 0, head_start

    def next_request(self) -> Any:
        """Return the call of the search whose turn it is; None once one has a path, or both have ended."""
        if self._head_start > 0 and self._pending_call(0) is not None:
            self._head_start -= 1
            return self._pending_call(0)
        self._head_start = 0
        if self._has_path(0):
            return None
        other = 1 - self._turn
        if self._pending_call(other) is not None:
            self._turn = other
            return self._calls[other]
        return None if self._has_path(1) else self._pending_call(self._turn)

    def accept(self, answer: Any) -> None:
        """Hand the answer to the search whose call it was, and let it go on to its next call."""
        self._runs[self._turn].accept(answer)
        self._advance(self._turn)

    def result(self) -> SearchResult:
        """Return the result of the search that found a path; where neither has, that of the first."""
        return self._results[1 if self._has_path(1) else 0]

    def _pending_call(self, one: int) -> Any:
        """Return the call that search 0 or 1 waits for, None if it has ended; the first time, start it."""
        if one not in self._calls:
            self._advance(one)
        return self._calls[one]

    def _advance(self, one: int) -> None:
        """Ask search 0 or 1 for its next call; keep its result if it has ended."""
        self._calls[one] = self._runs[one].next_request()
        if self._calls[one] is None:
            self._results[one] = self._runs[one].result()

    def _has_path(self, one: int) -> bool:
        """Tell whether search 0 or 1 has ended with a path."""
        return one in self._results and self._results[one].path is not None


def search(scenes: Scenes, settings: Sequence[SearchSettings]) -> list[SearchResult]:
    """Search a path of each scene with the default planner.

    Args:
        scenes: the problems.
        settings: those of each search.

    Returns:
        For each scene OK with a path whose every edge is clear, or a status that says why there is none.
    """
    begin = working_time()

    def past_zones(rest: list[int]) -> list[SearchResult]:
        """Return results of the scenes of these numbers, from bands that are short enough or searches."""
        some, own = scenes.part(rest), picked(settings, rest)
        bands = straight_bands(some, own)

        def searched(left: list[int]) -> list[SearchResult]:
            return _search_repeatedly(some.part(left), picked(own, left), picked(bands, left), begin)

        return completed(
            [_near_straight_result(*one) for one in zip(some.scenes, own, bands, strict=True)], searched
        )

    return completed([_unexpanded_result(path) for path in straight_paths(scenes, settings)], past_zones)


def _near_straight_result(scene: Scene, settings: SearchSettings, band: Band | None) -> SearchResult | None:
    """Return the result of a clear band nearly as short as the straight motion; None for any other."""
    enough = (SHORT_ENOUGH if settings.improvements else BAND_ENOUGH) * scene.straight_steps
    near = band is not None and band.clear and band.length <= enough
    return _unexpanded_result(band.path(scene)) if near and band is not None else None


def _unexpanded_result(path: Path | None) -> SearchResult | None:
    """Return the result OK of a path found without expansions; None for None."""
    if path is None:
        return None
    return SearchResult(status=Status.OK, path=path, expansions=0, queue_expansions=(0,) * (QUEUES + 1))


def _search_repeatedly(
    scenes: Scenes, settings: Sequence[SearchSettings], bands: Bands, begin: float
) -> list[SearchResult]:
    """Search each scene, some repeatedly, for its shortest path.

    Where the first search finds no path, a clear band is taken.

    Args:
        scenes: the problems.
        settings: those of each search.
        bands: for each scene the band that descended from the straight motion, None without one.
        begin: `working_time` when the whole search began, s.
    """
    best = _race(scenes, settings, bands)
    for number, (scene, band) in enumerate(zip(scenes.scenes, bands, strict=True)):
        if best[number].path is None and band is not None and band.clear:
            best[number] = replace(best[number], status=Status.OK, path=band.path(scene))
    for attempt in count(1):
        spent = working_time() - begin
        efforts = {
            number: effort
            for number, scene in enumerate(scenes.scenes)
            if (effort := _further_settings(scene, settings[number], best[number], attempt, spent))
            is not None
        }
        if not efforts:
            break
        again = list(efforts)
        found = _race(scenes.part(again), list(efforts.values()), picked(bands, again))
        for number, result in zip(again, found, strict=True):
            best[number] = _shorter_result(best[number], result)
    return best


def _further_settings(
    scene: Scene, settings: SearchSettings, best: SearchResult, attempt: int, spent: float
) -> SearchSettings | None:
    """Return settings of a further search for a shorter path; None where the best one is left as it is.

    Args:
        scene: the problem.
        settings: those of the whole search of the scene.
        best: the result so far.
        attempt: number of the further search, from 1.
        spent: working time so far, s.
    """
    left, spare = settings.time_limit - spent, settings.max_expansions - best.expansions
    if best.path is None or spare <= 0 or left <= 0:
        return None
    length, shortest = best.path.length, scene.straight_steps
    if attempt <= settings.improvements:
        if length <= SHORT_ENOUGH * shortest:
            return None
    elif length <= DETOUR * shortest or attempt * shortest > DETOUR_LOOKS * length:
        return None
    else:
        spare = min(spare, DETOUR_EXPANSIONS)
    seed = derived_seed(settings.seed, 0, attempt)
    return replace(settings, seed=seed, max_expansions=spare, time_limit=left)


def _shorter_result(best: SearchResult, found: SearchResult) -> SearchResult:
    """Return the result with the shorter path, and the expansions of both added up."""
    assert best.path is not None
    shorter = found.path is not None and found.path.length < best.path.length
    return replace(
        best,
        path=found.path if shorter else best.path,
        expansions=best.expansions + found.expansions,
        queue_expansions=tuple(np.add(best.queue_expansions, found.queue_expansions).tolist()),
    )


def _race(scenes: Scenes, settings: Sequence[SearchSettings], bands: Bands) -> list[SearchResult]:
    """Search each scene by multi-heuristic A* and trees in a race, and smooth the paths.

    Args:
        scenes: the problems.
        settings: effort and seed of each search.
        bands: for each scene the band that descended from the straight motion, None without one.
    """
    runs = [_Race(*one) for one in zip(scenes.scenes, settings, strict=True)]
    scenes.run(runs)
    return smooth_results(scenes, settings, [run.result() for run in runs], bands)


class _Race(Race):
    """Race of multi-heuristic A* and trees; trees get half of the expansions after the head start."""

    def __init__(self, scene: Scene, settings: SearchSettings) -> None:
        for_trees = max(settings.max_expansions - HEAD_START, 0) // 2
        own = replace(settings, max_expansions=settings.max_expansions - for_trees)
        self.informed = Search(scene, own, rules(scene))
        self.trees = Space(scene, replace(settings, max_expansions=for_trees))
        super().__init__(self.informed, Connect(self.trees), head_start=HEAD_START)

    def result(self) -> SearchResult:
        """Return the result of the race, with the expansions of both."""
        counts = (*self.informed.counts, self.trees.extensions)
        return replace(super().result(), expansions=sum(counts), queue_expansions=counts)
