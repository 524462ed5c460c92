"""The paper's Table 4 reproduced: success rate, time and path length of each planner.

The paper plans in three steps: goal, path and trajectory; Table 4 compares planners of step 2. Each of its
rows is a study in which scenes are searched but not planned: one search for each scene, from its start to the
nearest goal of step 1, without retries. Every planner gets the same scenes, goals and settings.

A path is *found* when the planner returns one, and *clear* when none of its edges violates a zone, which is
checked here along each whole edge by the bound of `path.edge_margins`. Scenes that are proved to have no path
are left out of the rate. Times are those of the search alone on this machine, compilation excluded. Lengths
are those of clear paths: in interior nodes (nodes other than start and goal), which is what the paper seems
to count, and in steps (`path.step_cost`).
"""

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby
from typing import Any

import jax
import numpy as np

from jaxplan import so3
from jaxplan.cases import random_scenario
from jaxplan.model.path import Path, edge_margins
from jaxplan.model.scenario import Scenario
from jaxplan.model.status import Status
from jaxplan.planner.record import Plan
from jaxplan.planner.steps import find_goals
from jaxplan.runtime.batching import padded_count
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import quick_jit
from jaxplan.search import PLANNERS, Scene, find_barrier, make_scene, search_batch
from jaxplan.study.result import Study, aligned, success_interval
from jaxplan.study.rows import COLUMNS, OK, Answer, filled, times_of
from jaxplan.study.run import run_task
from jaxplan.study.task import Chunk, Task

TOLERANCE = 1e-9
"""rad, by which a margin may be below zero: rounding."""
PAPER_KINDS = ("keep_out", "keep_in")
_EDGE_INTERVALS = 32  # intervals into which an edge is cut for the check
_WARM_UP_SCENES = 5  # scenes that are searched once before times are taken, so that kernels are compiled
_PROBLEM_CACHE_SIZE = 256  # problems kept in memory, so that goals are not computed for each planner
_HEAD = [
    *("planner", "found", "95 %", "clear", "95 %", "MinT", "MaxT", "AT", "MinL", "MaxL", "AL"),
    *("steps: min", "max", "mean"),
]


@shown("kind", "planner", "scenes", "found", "clear", "seconds s", "nodes", "steps")
@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """Results of one planner on the scenes of one kind: a row of Table 4.

    In the paper's own rows, arrays of values hold only their least, largest and mean.

    Attributes:
        kind: of the scenes.
        planner: its name in `PLANNERS`, or that of a planner in the paper.
        scenes: number of scenes tried, those proved infeasible left out.
        found: number of scenes in which it found a path.
        seconds: (scenes,) time of each search, successful or not; for the paper (3,).
        nodes: (clear,) numbers of interior nodes of the clear paths; for the paper (3,).
        clear: number of scenes with a path that is clear; None for the paper, where it is not known.
        solved: (scenes,) bool, whether each scene has a clear path; None for the paper.
        steps: (clear,) lengths in steps of the clear paths; None for the paper.
    """

    kind: str
    planner: str
    scenes: int
    found: int
    seconds: np.ndarray
    nodes: np.ndarray
    clear: int | None = None
    solved: np.ndarray | None = None
    steps: np.ndarray | None = None

    def interval(self, successes: int) -> tuple[float, float]:
        """95 % Wilson confidence interval (from 0 to 1) for a number of successes in this row's scenes."""
        return success_interval(successes, self.scenes)

    def spread(self, values: np.ndarray | None) -> tuple[float, ...] | None:
        """Least, largest and mean of the row's times or lengths; None if there are no values."""
        if values is None or not len(values):
            return None
        printed = self.solved is None
        return tuple(map(float, values if printed else (np.min(values), np.max(values), np.mean(values))))

    def summary(self) -> dict[str, Any]:
        """The row as a dict for JSON: counts, intervals; least, largest and mean of times (s) and lengths."""
        return {
            "kind": self.kind,
            "planner": self.planner,
            "scenes": self.scenes,
            "found": self.found,
            "clear": self.clear,
            "found_95_percent": self.interval(self.found),
            "clear_95_percent": None if self.clear is None else self.interval(self.clear),
            "seconds": self.spread(self.seconds),
            "interior_nodes": self.spread(self.nodes),
            "steps": self.spread(self.steps),
        }

    def cells(self) -> list[str]:
        """The row as texts for the columns `_HEAD`; dashes for no values, blanks for unknown ones."""
        digits = 1 if self.solved is None else 4
        return [
            self.planner,
            *self._rate_texts(self.found),
            *self._rate_texts(self.clear),
            *_format_spread(self.spread(self.seconds), digits, digits),
            *_format_spread(self.spread(self.nodes), 0, 1),
            *([""] * 3 if self.steps is None else _format_spread(self.spread(self.steps), 2, 2)),
        ]

    def _rate_texts(self, count: int | None) -> list[str]:
        """Texts of a count out of all scenes, and of its Wilson interval in percent; two blanks for None."""
        if count is None:
            return ["", ""]
        low, high = (100 * bound for bound in self.interval(count))
        return [f"{count}/{self.scenes:<4}", f"{low:5.1f} to {high:5.1f}"]


def _format_spread(values: tuple[float, ...] | None, digits: int, of_mean: int) -> list[str]:
    """Format least, largest and mean as texts; three dashes for None.

    Args:
        values: (least, largest, mean).
        digits: number of digits after the point of least and largest.
        of_mean: number of digits after the point of the mean.
    """
    if values is None:
        return ["-"] * 3
    return [f"{value:.{places}f}" for value, places in zip(values, (digits, digits, of_mean), strict=True)]


def _paper_row(kind: str, planner: str, found: int, seconds: Sequence[float], nodes: Sequence[float]) -> Row:
    """Make a row from the paper, where seconds and nodes are (least, largest, mean)."""
    values: dict[str, Any] = {"seconds": np.array(seconds), "nodes": np.array(nodes)}
    return Row(kind=kind, planner=planner, scenes=20, found=found, **values)


# The rows printed in the paper; they are of other scenes of the same kinds, on another machine.
PAPER = (
    _paper_row("keep_out", "paper's MHA*", 19, (0.1, 0.7, 0.3), (15, 49, 27.6)),
    _paper_row("keep_out", "paper's WA*", 15, (0.1, 0.6, 0.2), (17, 42, 26.6)),
    _paper_row("keep_out", "paper's RRT*", 15, (1.5, 25.6, 6.0), (13, 26, 20.5)),
    _paper_row("keep_in", "paper's MHA*", 19, (0.2, 0.5, 0.2), (11, 38, 24.4)),
    _paper_row("keep_in", "paper's WA*", 18, (0.1, 1.7, 0.3), (13, 38, 24.2)),
    _paper_row("keep_in", "paper's RRT*", 17, (0.7, 13.1, 3.2), (11, 28, 16.8)),
)


def printed_rows(kinds: Iterable[str]) -> tuple[Row, ...]:
    """The paper's rows for some kinds of scenes; it only has rows for `PAPER_KINDS`."""
    wanted = set(kinds)
    return tuple(row for row in PAPER if row.kind in wanted)


def format_table(rows: Iterable[Row]) -> str:
    """Format rows as a table, grouped by kind, with the paper's rows of the kind first.

    Columns are counts with 95 % Wilson intervals, then least, largest and mean of time (s), of length in
    interior nodes, and of length in steps. Rows of a kind must follow one another.
    """
    cells: list[list[str]] = []
    for kind, of_kind in groupby(rows, lambda row: row.kind):
        cells += [[kind, *[""] * len(_HEAD[1:])], _HEAD, *(row.cells() for row in printed_rows([kind]))]
        cells += [row.cells() for row in of_kind]
    title = "Searches: time in s, length in interior nodes and in steps"
    return "\n".join(line.rstrip() for line in aligned(title, (), cells).splitlines())


def compare(
    kinds: Iterable[str],
    planners: Iterable[str] = tuple(PLANNERS),
    *,
    count: int = 20,
    first_seed: int = 0,
    progress: bool = False,
) -> tuple[Row, ...]:
    """Let planners search the same random scenes.

    Args:
        kinds: kinds of `random_scenario`.
        planners: names in `PLANNERS`.
        count: number of scenes of each kind.
        first_seed: seed of the first scene; the others follow.
        progress: show a bar on stderr for each kind and planner that takes longer than a second.

    Returns:
        A row for each kind and planner, ordered by kind.

    Raises:
        KeyboardInterrupt: if it is interrupted.
    """
    seeds, names = range(first_seed, first_seed + count), tuple(planners)
    studies = [search_study(seeds, kind, planner, progress=progress) for kind in kinds for planner in names]
    return tuple(map(row_of_study, studies))


def search_study(seeds: range, kind: str, planner: str, *, progress: bool = False) -> Study:
    """Search random scenes one by one; in the study's rows "certified" means that the path is clear.

    Args:
        seeds: of the scenes.
        kind: of the scenes.
        planner: its name in `PLANNERS`.
        progress: show a bar on stderr once it takes longer than a second.

    Raises:
        KeyboardInterrupt: if it is interrupted.
    """
    for some, bar in ((seeds[:_WARM_UP_SCENES], False), (seeds, progress)):  # the second study counts
        task = Task(kind=kind, scenes=some, planner=planner)
        study = run_task(task, None, None, None, bar, search_chunk)
        if not study.complete:  # a study ends early where it is interrupted
            raise KeyboardInterrupt
    return study


def row_of_study(study: Study) -> Row:
    """Make the row of Table 4 for a study of `search_study`; scenes with status NO_PATH are left out."""
    known = {row["scene"]: row for row in study.table if row["status"] != Status.NO_PATH.name}
    clear = [row for row in known.values() if row["certified"]]
    return Row(
        kind=str(study.kind),
        planner=study.planner,
        scenes=len(known),
        found=sum(row["status"] == OK for row in known.values()),
        clear=len(clear),
        solved=np.array([row["certified"] for row in known.values()], dtype=bool),
        seconds=np.array([row["search_s"] for row in study.timings if row["scene"] in known]),
        nodes=np.array([row["interior_nodes"] for row in clear]),
        steps=np.array([row["length_steps"] for row in clear]),
    )


def search_chunk(chunk: Chunk) -> Answer:
    """Search the scenes of a chunk one by one; those proved to have no path get the status NO_PATH."""
    table, timings = [], []
    for place in range(len(chunk.numbers)):
        head = chunk.head(place)
        scenario, scene = _cached_problem(head["seed"], head["kind"])
        known, seconds = {"status": Status.NO_PATH.name, "certified": False}, 0.0
        if find_barrier(scene) is None:
            bare = replace(scene)  # a copy without what earlier searches cached in it
            settings = replace(scenario.search, method=chunk.planner, time_limit=math.inf)
            began = time.perf_counter()
            (result,) = search_batch([bare], [settings])
            seconds = time.perf_counter() - began
            known |= {"status": result.status.name, "expansions": result.expansions}
            if result.path is not None:
                margin = float(np.min(least_margins(scene, result.path), initial=np.inf))
                known |= {"length_steps": result.path.length, "interior_nodes": result.path.edges - 1}
                known |= {"min_margin_deg": np.rad2deg(margin), "certified": margin >= -TOLERANCE}
        table.append(filled(COLUMNS, {**head, "message": "", **known}))
        timings.append(times_of({"search": seconds}, head))
    return Answer(table, timings, sum(row["search_s"] for row in timings))


@lru_cache(maxsize=_PROBLEM_CACHE_SIZE)
def _cached_problem(seed: int, kind: str) -> tuple[Scenario, Scene]:
    """The random scenario of a seed and kind, and its search problem."""
    scenario = random_scenario(seed, kind)
    return scenario, make_problem(scenario)


def make_problem(scenario: Scenario) -> Scene:
    """Make the search problem of a random scene: from its start to the nearest goal of step 1.

    Args:
        scenario: from `random_scenario`.

    Raises:
        RuntimeError: if the scenario has no goal, which random scenes always have.
    """
    goals = find_goals(scenario)
    if isinstance(goals, Plan):  # does not happen: random scenes have a goal
        raise RuntimeError(f"{scenario.name}: {goals.message}")
    return make_scene(scenario, goals[0])


def least_margins(scene: Scene, path: Path) -> np.ndarray:
    """Compute a lower bound of the smallest margin along each whole edge of a path.

    Args:
        scene: the search problem, with its zones.
        path: with m edges.

    Returns:
        (m,) rad, negative where a zone may be violated; +inf without zones.
    """
    rows = padded_count(path.edges)
    first, last = (np.tile(np.eye(3), (rows, 1, 1)) for _ in range(2))
    joints, change = np.zeros((2, rows, path.joints.shape[1]))
    first[: path.edges], last[: path.edges] = path.attitudes[:-1], path.attitudes[1:]
    joints[: path.edges], change[: path.edges] = path.joints[:-1], np.diff(path.joints, axis=0)
    with jax.enable_x64(True):
        margins = np.asarray(_edge_margin_bounds(scene, first, last, joints, change))[: path.edges]
    return np.min(margins, axis=-1, initial=np.inf)


@quick_jit
def _edge_margin_bounds(
    scene: Scene, first: jax.Array, last: jax.Array, joints: jax.Array, change: jax.Array
) -> jax.Array:
    """Lower bounds (m, Z) in rad of the margins to Z zones along m whole edges, by `edge_margins`.

    Args:
        scene: the search problem.
        first: (m, 3, 3) attitudes at the starts of edges, body to inertial.
        last: (m, 3, 3) attitudes at their ends.
        joints: (m, J) rad, joint angles at their starts.
        change: (m, J) rad, change of the joint angles along each edge.
    """

    def margins(start: jax.Array, end: jax.Array, q: jax.Array, dq: jax.Array) -> list[jax.Array]:
        turn = so3.log(start.T @ end)
        motion = (scene.sights, start, q, turn, dq, _EDGE_INTERVALS)
        return [edge_margins(rows, *motion) for rows in (scene.cones, scene.grouped_cones)]

    single, grouped = jax.vmap(margins)(first, last, joints, change)
    return jax.numpy.concatenate([single, grouped], axis=-1)
