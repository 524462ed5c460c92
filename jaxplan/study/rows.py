"""Rows of a study's tables: one for each scene's outcome, and a separate one for its computation times.

A row holds numbers and texts in the units of scenario files. Outcomes are the same on every run, times are
not, so they are kept apart. Values that a plan does not have are None. The status is that of the plan, or
`CRASHED` where planning raised an unexpected error or killed its process. No error of a scene is raised in a
worker: if planning a block together raises one, its scenes are planned one by one.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from multiprocessing.reduction import ForkingPickler
from typing import Any

import numpy as np

from jaxplan.planner import Plan, plan, plan_batch
from jaxplan.runtime.stopwatch import working_time
from jaxplan.study.task import Chunk
from jaxplan.version import __version__

Row = dict[str, Any]

CRASHED = "crashed"
OK = "OK"

# Columns of a study's table with their types; a value may also be None where it is not known.
COLUMNS: Mapping[str, type] = {
    "scene": int,  # its place in the study, from 0
    "seed": int,  # of a random scene
    "name": str,
    "kind": str,  # of a random scene
    "planner": str,
    "status": str,
    "message": str,
    "certified": bool,
    "slew_deg": float,  # angle by which the platform turns from start to goal
    "expansions": int,  # of the last search
    "length_steps": float,
    "interior_nodes": int,
    "duration_s": float,
    "duration_bound_s": float,  # lower bound of the duration of any motion to its goal, zones ignored
    "min_margin_deg": float,  # lower bound proved for all times and zones, positive where all are kept
    "worst_device": str,
    "worst_zone": str,
    "peak": float,  # largest ratio of a quantity to its limit, upper bound proved for all times
}
STEPS = ("decompose", "search", "trajectory", "certificate")
# Columns of computation times. The total is that of the steps, without compiling, which a process does once.
TIMES: Mapping[str, type] = {
    "scene": int,
    "name": str,
    **{f"{step}_s": float for step in STEPS},
    "total_s": float,
    "compile_s": float,
}


def filled(columns: Mapping[str, type], known: Mapping[str, Any]) -> Row:
    """Make a row with all given columns; missing values, and floats that are not finite, become None.

    Args:
        columns: type of each column, by its name; values are converted to it.
        known: values by column name; names that are not columns are ignored.
    """
    row: Row = {}
    for name, kind in columns.items():
        value = known.get(name)
        lost = value is None or (kind is float and not math.isfinite(value))
        row[name] = None if lost else kind(value)
    return row


def columns_of(own: Iterable[str]) -> Mapping[str, type]:
    """The columns of a study's table, with its own columns added, whose type is float."""
    return {**COLUMNS, **dict.fromkeys(own, float)}


def check_columns(columns: object, *, sent: bool = False) -> None:
    """Check the columns that a user adds to a study.

    Args:
        columns: functions by column name.
        sent: whether the functions are to be pickled and sent to other processes.

    Raises:
        TypeError: if it is not a dict of functions.
        ValueError: if a name has blanks or is taken, or a function cannot be pickled.
    """
    if not isinstance(columns, Mapping):
        raise TypeError(f"columns must be a dict of functions by name, not {type(columns).__name__}")
    for name, function in columns.items():
        if not isinstance(name, str) or not name or any(letter.isspace() for letter in name):
            raise ValueError(f"columns: {name!r} must be a name without blanks")
        if name in COLUMNS or name in TIMES or name == "over_bound":
            raise ValueError(f"columns: {name} is a column that every study has, take another name")
        if not callable(function):
            raise TypeError(f"columns: {name} must be a function of a plan, not {type(function).__name__}")
        if sent:
            try:
                ForkingPickler.dumps(function)
            except Exception as error:
                raise ValueError(
                    f"columns: {name} cannot be sent to processes ({error}): define it with def in a module"
                ) from error


def _finite_float(value: Any) -> float:
    """Convert a value to a float; raises a ValueError if it is not one finite number."""
    if isinstance(value, str) or np.ndim(value) or not math.isfinite(value):
        raise ValueError(f"{value!r} is no finite number")
    return float(value)


def _own_values(columns: Mapping[str, Callable[[Plan], Any]], found: Plan) -> tuple[Row, list[str]]:
    """Compute a study's own columns for a plan.

    Returns:
        The values by column name, None where the function raised an error or returned no finite number; and a
        message for each such column.
    """
    row: Row = {}
    wrong = []
    for name, function in columns.items():
        try:
            row[name] = _finite_float(function(found))
        except Exception as error:
            row[name] = None
            wrong.append(f"column {name}: {type(error).__name__}: {error}")
    return row, wrong


def row_of(outcome: Plan | str, head: Row, own: Mapping[str, Callable[[Plan], Any]] | None = None) -> Row:
    """Make a scene's row for the study's table, with the columns `COLUMNS` and the study's own.

    Args:
        outcome: the plan, which may have failed, or the message of an error that was raised instead.
        head: values of the columns from scene to planner.
        own: functions of a plan for the study's own columns, by name; they are called for certified plans
            only.
    """
    columns = columns_of(own or {})
    if isinstance(outcome, str):
        return filled(columns, {**head, "status": CRASHED, "message": outcome, "certified": False})
    found = outcome.summary()
    edges, peaks = found["edges"], found["peaks"]
    found["interior_nodes"] = None if edges is None else max(edges - 1, 0)
    found["peak"] = max(peaks.values()) if peaks else None
    found["certified"] = bool(found["certified"])
    more, wrong = _own_values(own, outcome) if own and outcome.ok else ({}, [])
    found["message"] = "; ".join(filter(None, (found["message"], *wrong)))
    return filled(columns, {**found, **more, **head})


def times_of(timings: Mapping[str, float] | None, head: Row) -> Row:
    """Make a scene's row of computation times, with the columns `TIMES`.

    Args:
        timings: seconds of each planning step, by its name; a step that is missing counts as 0. None where
            planning crashed: then all times are None.
        head: values of the columns from scene to planner.
    """
    if timings is None:
        return filled(TIMES, head)
    seconds = {f"{step}_s": timings.get(step, 0.0) for step in STEPS}
    more = {"total_s": sum(seconds.values()), "compile_s": timings.get("compile", 0.0)}
    return filled(TIMES, {**head, **seconds, **more})


APART = "planned by itself, since a scene of its block killed its process"
"""Note in the rows of a block that is planned scene by scene."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Outcome of a chunk: rows for its scenes.

    Attributes:
        table: the rows of the scenes for the study's table.
        timings: the rows of their computation times.
        seconds: time that the whole chunk took, compilation excluded.
    """

    table: list[Row]
    timings: list[Row]
    seconds: float = 0.0


Work = Callable[[Chunk], Answer]


def plan_chunk(chunk: Chunk) -> Answer:
    """Plan the scenes of a chunk; the scenes of each block are planned together.

    Raises:
        RuntimeError: if the chunk is from another version of jaxplan, which may plan differently.
    """
    if chunk.version != __version__:
        raise RuntimeError(
            f"a worker has jaxplan {__version__}, the study is made by {chunk.version}: "
            "install the same on all machines"
        )
    began = working_time()
    answer = answer_of(chunk, [outcome for block in chunk.blocks() for outcome in _plan_block(block)])
    return replace(answer, seconds=working_time() - began)


def _plan_block(block: Chunk) -> list[Plan | str]:
    """Plan the scenes of a block together, or one by one if that raises an error, to find whose it is.

    Returns:
        For each scene its plan, or the message of the error that it raised.
    """
    places = range(len(block.numbers))
    try:
        return [*plan_batch([block.scenario(place) for place in places], progress=False)]
    except Exception:
        return [_plan_or_error(block, place) for place in places]


def _plan_or_error(block: Chunk, place: int) -> Plan | str:
    """Plan the scene at a place of a block, counted from 0; returns the plan, or the message of an error."""
    try:
        return plan(block.scenario(place), throw=False, progress=False)
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def answer_of(chunk: Chunk, outcomes: Iterable[Plan | str]) -> Answer:
    """Make the answer for a chunk.

    Args:
        chunk: the scenes.
        outcomes: for each scene, in order, its plan or the message of an error.
    """
    table, timings = [], []
    for place, outcome in enumerate(outcomes):
        head = chunk.head(place)
        row = row_of(outcome, head, chunk.columns)
        if chunk.apart:
            row["message"] = "; ".join(filter(None, (row["message"], APART)))
        table.append(row)
        timings.append(times_of(outcome.timings if isinstance(outcome, Plan) else None, head))
    return Answer(table, timings)
