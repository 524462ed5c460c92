"""Rows of a study's table: what becomes of the scenes of a chunk, and apart from it the seconds that it took.

A row holds plain numbers and texts in the units of files. Rows are the same on every run; times are not, and
stand apart. What a plan does not have is None. The status is the plan's, or `CRASHED` where planning raised
an error that it must not raise, or killed its process: nothing that a scene raises gets out of a worker, and
the others of its block are planned one by one.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from multiprocessing.reduction import ForkingPickler
from typing import Any

import numpy as np

from jaxplan.planner import Plan, plan, plan_batch
from jaxplan.runtime.jit import working_time
from jaxplan.study.task import Chunk
from jaxplan.version import __version__

Row = dict[str, Any]

CRASHED = "crashed"
OK = "OK"

# Of each column the type, beside None.
COLUMNS: Mapping[str, type] = {
    "scene": int,  # its place in the study, from 0
    "seed": int,  # of a random scene
    "name": str,
    "kind": str,  # of a random scene
    "planner": str,
    "status": str,
    "message": str,
    "certified": bool,
    "slew_deg": float,  # of the platform, from start to goal
    "expansions": int,  # of the last search
    "length_steps": float,
    "interior_nodes": int,
    "duration_s": float,
    "duration_bound_s": float,  # no motion to its goal is shorter, zones aside
    "min_margin_deg": float,  # proved for all times and zones
    "worst_device": str,
    "worst_zone": str,
    "peak": float,  # the largest share of a limit that is used, proved for all times
}
STEPS = ("decompose", "search", "trajectory", "certificate")
# The total is that of the steps. A process compiles what it needs once, so that is no matter of a scene.
TIMES: Mapping[str, type] = {
    "scene": int,
    "name": str,
    **{f"{step}_s": float for step in STEPS},
    "total_s": float,
    "compile_s": float,
}


def filled(columns: Mapping[str, type], known: Mapping[str, Any]) -> Row:
    """A row of the columns from the values known; None for the others, and for floats that are not finite."""
    row: Row = {}
    for name, kind in columns.items():
        value = known.get(name)
        lost = value is None or (kind is float and not math.isfinite(value))
        row[name] = None if lost else kind(value)
    return row


def columns_of(own: Iterable[str]) -> Mapping[str, type]:
    """Columns of a table with those of a study's own, whose values are numbers."""
    return {**COLUMNS, **dict.fromkeys(own, float)}


def check_columns(columns: object, *, sent: bool = False) -> None:
    """Raise a TypeError or ValueError for columns that are none, or have a name that is taken.

    Args:
        columns: functions by name.
        sent: whether they must get to processes of their own.
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


def _number(value: Any) -> float:
    """A value as a number; raises a ValueError if it is none, or not finite."""
    if isinstance(value, str) or np.ndim(value) or not math.isfinite(value):
        raise ValueError(f"{value!r} is no finite number")
    return float(value)


def _own_values(columns: Mapping[str, Callable[[Plan], Any]], found: Plan) -> tuple[Row, list[str]]:
    """The numbers that a study's own functions make of a plan, and a sentence for each that makes none."""
    row: Row = {}
    wrong = []
    for name, function in columns.items():
        try:
            row[name] = _number(function(found))
        except Exception as error:
            row[name] = None
            wrong.append(f"column {name}: {type(error).__name__}: {error}")
    return row, wrong


def row_of(outcome: Plan | str, head: Row, own: Mapping[str, Callable[[Plan], Any]] | None = None) -> Row:
    """A scene's row of `COLUMNS`: numbers and words about its plan, no arrays.

    Args:
        outcome: a plan, also one that failed, or the message of an error that was raised instead.
        head: values of the columns from scene to planner.
        own: functions for further columns, called with certified plans alone.
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
    """Row of `TIMES`: seconds of a plan by step, 0 for those that it did not come to.

    Args:
        timings: of the plan; None where the scene crashed, whose times are None.
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
    """Rows of the scenes of a chunk.

    Attributes:
        table: a row a scene.
        timings: the seconds of each scene.
        seconds: time that the chunk took, without that of compiling.
    """

    table: list[Row]
    timings: list[Row]
    seconds: float = 0.0


Work = Callable[[Chunk], Answer]


def plan_chunk(chunk: Chunk) -> Answer:
    """Plan the scenes of a chunk, those of a block together.

    Raises:
        RuntimeError: if the chunk is from another version of jaxplan, which may plan otherwise.
    """
    if chunk.version != __version__:
        raise RuntimeError(
            f"a worker has jaxplan {__version__}, the study is made by {chunk.version}: "
            "install the same on all machines"
        )
    began = working_time()
    answer = answer_of(chunk, [outcome for block in chunk.blocks() for outcome in _outcomes(block)])
    return replace(answer, seconds=working_time() - began)


def _outcomes(block: Chunk) -> list[Plan | str]:
    """Plan the scenes of a block together; after an unexpected error one by one, to find whose it is.

    Returns:
        A plan for each scene, or the message of its error.
    """
    places = range(len(block.numbers))
    try:
        return [*plan_batch([block.scenario(place) for place in places], progress=False)]
    except Exception:
        return [_plan_or_error(block, place) for place in places]


def _plan_or_error(block: Chunk, place: int) -> Plan | str:
    """Plan the scene at a place of a block; returns the plan, or the message of an error."""
    try:
        return plan(block.scenario(place), throw=False, progress=False)
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def answer_of(chunk: Chunk, outcomes: Iterable[Plan | str]) -> Answer:
    """Rows and times of a chunk's scenes, from a plan or the message of an error for each."""
    table, timings = [], []
    for place, outcome in enumerate(outcomes):
        head = chunk.head(place)
        row = row_of(outcome, head, chunk.columns)
        if chunk.apart:
            row["message"] = "; ".join(filter(None, (row["message"], APART)))
        table.append(row)
        timings.append(times_of(outcome.timings if isinstance(outcome, Plan) else None, head))
    return Answer(table, timings)
