"""Planners on the same scenes, and the check of their paths by the exact bound."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import jax
import numpy as np

from jaxplan import so3
from jaxplan.cases import random_scenario
from jaxplan.model.path import Path, edge_margins
from jaxplan.model.scenario import Scenario
from jaxplan.planner.goals import find_goals
from jaxplan.planner.record import Plan
from jaxplan.runtime.batching import padded_count
from jaxplan.runtime.quick_jit import quick_jit
from jaxplan.search import PLANNERS, Scene, find_barrier, make_scene
from jaxplan.table4.rows import Row

TOLERANCE = 1e-9  # rad, by which a margin may be below zero: rounding
_INTERVALS = 32  # an edge is cut into, for the check
_REHEARSALS = 5  # searches before the clock runs, so that what they use is compiled


def make_problem(scenario: Scenario) -> Scene:
    """The search problem of a random scene: from its start to the nearest goal of step 1.

    Args:
        scenario: one of `random_scenario`.
    """
    goals = find_goals(scenario)
    if isinstance(goals, Plan):  # never: random scenes are made with a goal
        raise RuntimeError(f"{scenario.name}: {goals.message}")
    return make_scene(scenario, goals[0])


def compare(
    kinds: Iterable[str],
    planners: Iterable[str] = tuple(PLANNERS),
    *,
    count: int = 20,
    first_seed: int = 0,
    done: Callable[[], None] = lambda: None,
) -> tuple[Row, ...]:
    """Let planners search the same random scenes.

    Args:
        kinds: of `random_scenario`.
        planners: names in `PLANNERS`.
        count: scenes a kind.
        first_seed: of the first of them; the others follow.
        done: called after each search, for a progress bar.

    Returns:
        A row a kind and planner.
    """
    rows = []
    names = tuple(planners)
    for kind in kinds:
        scenarios = [random_scenario(seed, kind) for seed in range(first_seed, first_seed + count)]
        problems = [(scenario, make_problem(scenario)) for scenario in scenarios]
        feasible = [(scenario, scene) for scenario, scene in problems if find_barrier(scene) is None]
        for planner in names:
            rows.append(_row(kind, planner, feasible, done))
            for _ in range(count - len(feasible)):
                done()
    return tuple(rows)


def _row(
    kind: str, planner: str, problems: Sequence[tuple[Scenario, Scene]], done: Callable[[], None]
) -> Row:
    search = PLANNERS[planner]
    for scenario, scene in problems[:_REHEARSALS]:
        search(scene, scenario.search)
    found, seconds, solved, paths = 0, [], [], []
    for scenario, scene in problems:
        bare = replace(scene)  # with nothing of it computed by another planner
        begin = time.perf_counter()
        result = search(bare, scenario.search)
        seconds.append(time.perf_counter() - begin)
        clear = result.path is not None and is_clear(scene, result.path)
        if result.path is not None:
            found += 1
            paths += [result.path] if clear else []
        solved.append(clear)
        done()
    return Row(
        kind=kind,
        planner=planner,
        scenes=len(problems),
        found=found,
        clear=len(paths),
        solved=np.array(solved, dtype=bool),
        seconds=np.array(seconds),
        nodes=np.array([path.edges - 1 for path in paths]),
        steps=np.array([path.length for path in paths]),
    )


@quick_jit
def _edges(
    scene: Scene, first: jax.Array, last: jax.Array, joints: jax.Array, change: jax.Array
) -> jax.Array:
    def margins(start: jax.Array, end: jax.Array, q: jax.Array, dq: jax.Array) -> list[jax.Array]:
        turn = so3.log(start.T @ end)
        motion = (scene.sights, start, q, turn, dq, _INTERVALS)
        return [edge_margins(rows, *motion) for rows in (scene.cones, scene.grouped_cones)]

    single, grouped = jax.vmap(margins)(first, last, joints, change)
    return jax.numpy.concatenate([single, grouped], axis=-1)


def least_margins(scene: Scene, path: Path) -> np.ndarray:
    """Lower bound of the least margin along each whole edge of a path.

    Args:
        scene: the problem.
        path: between its start and goal.

    Returns:
        (m,) rad; +inf without zones.
    """
    rows = padded_count(path.edges)
    first, last = (np.tile(np.eye(3), (rows, 1, 1)) for _ in range(2))
    joints, change = np.zeros((2, rows, path.joints.shape[1]))
    first[: path.edges], last[: path.edges] = path.attitudes[:-1], path.attitudes[1:]
    joints[: path.edges], change[: path.edges] = path.joints[:-1], np.diff(path.joints, axis=0)
    with jax.enable_x64(True):
        margins = np.asarray(_edges(scene, first, last, joints, change))[: path.edges]
    return np.min(margins, axis=-1, initial=np.inf)


def is_clear(scene: Scene, path: Path) -> bool:
    """Whether no edge of a path breaks a zone, by a lower bound of the margins of whole edges.

    Args:
        scene: the problem.
        path: between its start and goal.
    """
    return bool(np.all(least_margins(scene, path) >= -TOLERANCE))
