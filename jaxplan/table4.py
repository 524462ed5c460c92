"""The paper's Table 4 again: how often, how fast and how near the shortest each planner of step 2 is.

Every planner gets the same scenes, goals and settings, and one search for each scene: the nearest goal of
step 1, no retries. A path is *found* when its planner says so, and *clear* when no edge of it breaks a
zone: checked here over every whole edge by the bound of `path.edge_margins`, whatever the planner itself has
looked at. Scenes that are proved to have no path are counted apart and left out of the rate. Times are those
of the search alone, compiled before, on the machine at hand; lengths are those of the paths that are clear,
in interior nodes, which is what the paper seems to count, and in steps (`path.step_cost`).
"""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np

from jaxplan import so3
from jaxplan.cases import random_scenario
from jaxplan.model.path import Path, edge_margins
from jaxplan.model.scenario import Scenario
from jaxplan.planner.goals import find_goals
from jaxplan.planner.record import Plan
from jaxplan.proportions import success_interval
from jaxplan.runtime.batching import padded_count
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import quick_jit
from jaxplan.search import PLANNERS, Scene, find_barrier, make_scene

PAPER_KINDS = ("keep_out", "keep_in")


@shown("kind", "planner", "scenes", "found", "clear", "seconds s", "nodes", "steps")
@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """What one planner did on the scenes of one kind.

    Attributes:
        kind: of the scenes.
        planner: its name in `PLANNERS`, or the paper's.
        scenes: how many were tried, those proved infeasible left out.
        found: in how many of them it found a path.
        clear: in how many of them no edge of the path breaks a zone; None where nobody knows.
        solved: (scenes,) bool, in which of them that is so; None for the paper.
        seconds: (scenes,) each search took, successful or not; for the paper (3,) least, largest, mean.
        nodes: (clear,) interior nodes; for the paper (3,) likewise.
        steps: (clear,) length in steps; None for the paper.
    """

    kind: str
    planner: str
    scenes: int
    found: int
    clear: int | None
    solved: np.ndarray | None
    seconds: np.ndarray
    nodes: np.ndarray
    steps: np.ndarray | None

    def interval(self, successes: int) -> tuple[float, float]:
        """95 % Wilson interval of a success rate in these scenes."""
        return success_interval(successes, self.scenes)

    def summary(self) -> dict[str, Any]:
        """The row for machines: least, largest and mean of times (s) and lengths."""
        printed = self.steps is None
        return {
            "kind": self.kind,
            "planner": self.planner,
            "scenes": self.scenes,
            "found": self.found,
            "clear": self.clear,
            "found_95_percent": self.interval(self.found),
            "clear_95_percent": None if self.clear is None else self.interval(self.clear),
            "seconds": spread(self.seconds, printed),
            "interior_nodes": spread(self.nodes, printed),
            "steps": None if self.steps is None else spread(self.steps, False),
        }


def _printed(kind: str, planner: str, found: int, seconds: Sequence[float], nodes: Sequence[float]) -> Row:
    return Row(
        kind=kind,
        planner=planner,
        scenes=20,
        found=found,
        clear=None,
        solved=None,
        seconds=np.array(seconds),
        nodes=np.array(nodes),
        steps=None,
    )


# As printed, from other scenes of the same description, on another machine.
PAPER = (
    _printed("keep_out", "paper's MHA*", 19, (0.1, 0.7, 0.3), (15, 49, 27.6)),
    _printed("keep_out", "paper's WA*", 15, (0.1, 0.6, 0.2), (17, 42, 26.6)),
    _printed("keep_out", "paper's RRT*", 15, (1.5, 25.6, 6.0), (13, 26, 20.5)),
    _printed("keep_in", "paper's MHA*", 19, (0.2, 0.5, 0.2), (11, 38, 24.4)),
    _printed("keep_in", "paper's WA*", 18, (0.1, 1.7, 0.3), (13, 38, 24.2)),
    _printed("keep_in", "paper's RRT*", 17, (0.7, 13.1, 3.2), (11, 28, 16.8)),
)


def printed_rows(kinds: Iterable[str]) -> tuple[Row, ...]:
    """The paper's rows of some kinds of scenes; it has none of most."""
    wanted = set(kinds)
    return tuple(row for row in PAPER if row.kind in wanted)


def spread(values: np.ndarray, printed: bool) -> tuple[float, float, float] | None:
    """Least, largest and mean; of the paper's rows they are given. None of nothing."""
    if not len(values):
        return None
    if printed:
        return float(values[0]), float(values[1]), float(values[2])
    return float(np.min(values)), float(np.max(values)), float(np.mean(values))


def format_table(rows: Iterable[Row]) -> str:
    """The rows as text, those of a kind together with the paper's.

    Rates with their 95 % Wilson intervals; times in seconds, lengths in interior nodes and in steps: least,
    largest and mean.
    """
    lines, kind = [], None
    for row in rows:
        if row.kind != kind:
            kind = row.kind
            lines += ["", f"{kind}", _HEAD, *(_line(paper) for paper in printed_rows([kind]))]
        lines.append(_line(row))
    return "\n".join(lines[1:])


_HEAD = (
    f"  {'planner':<14}{'found':>10}  {'95 %':>14}{'clear':>11}  {'95 %':>14}"
    f"{'MinT':>9}{'MaxT':>9}{'AT':>9}{'MinL':>6}{'MaxL':>6}{'AL':>7}{'steps: min':>12}{'max':>7}{'mean':>7}"
)


def _line(row: Row) -> str:
    printed = row.steps is None
    seconds = [9, 9, 9], (".1f" if printed else ".4f")
    return (
        f"  {row.planner:<14}"
        + _rate(row, row.found, 10)
        + (_rate(row, row.clear, 11) if row.clear is not None else " " * 27)
        + _numbers(spread(row.seconds, printed), *seconds)
        + _numbers(spread(row.nodes, printed), [6, 6, 7], ".0f", ".1f")
        + ("" if row.steps is None else _numbers(spread(row.steps, False), [12, 7, 7], ".2f"))
    ).rstrip()


def _rate(row: Row, count: int, width: int) -> str:
    """A count with its Wilson interval."""
    low, high = row.interval(count)
    return f"{f'{count}/{row.scenes:<4}':>{width}}  {100 * low:5.1f} to {100 * high:5.1f}"


def _numbers(
    values: tuple[float, float, float] | None, widths: list[int], form: str, mean_form: str | None = None
) -> str:
    """Least, largest and mean in columns; dashes where there is nothing."""
    if values is None:
        return "".join(f"{'-':>{width}}" for width in widths)
    forms = [form, form, mean_form or form]
    return "".join(f"{value:{width}{f}}" for value, width, f in zip(values, widths, forms, strict=True))


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
