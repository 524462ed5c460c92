"""A scene's line in the table of a study, and what it took: plain numbers and texts in the units of files.

Rows are the same on every run; times are not, and stand apart. What a plan does not have is None. The status
is the plan's, or `CRASHED` where planning raised an error that it must not raise, or killed its process.
"""

import math
from collections.abc import Mapping
from typing import Any

from jaxplan.planner import Plan

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
    "duration_bound_s": float,  # no motion to its goal is shorter
    "min_margin_deg": float,  # proved for all times and zones
    "worst_device": str,
    "worst_zone": str,
    "peak": float,  # the largest share of a limit that is used, proved likewise
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


def row_of(plan: Plan, head: Row) -> Row:
    """A plan's row, without the plan's arrays.

    Args:
        plan: any, also one that failed.
        head: the columns from scene to planner.
    """
    found = plan.summary()
    edges, peaks = found["edges"], found["peaks"]
    found["interior_nodes"] = None if edges is None else max(edges - 1, 0)
    found["peak"] = max(peaks.values()) if peaks else None
    found["certified"] = bool(found["certified"])
    return {name: _plain({**found, **head}[name], kind) for name, kind in COLUMNS.items()}


def _plain(value: Any, kind: type) -> Any:
    """A value as JSON has it; of a number that is none, such as a margin of a failed proof, None."""
    if value is None or (kind is float and not math.isfinite(value)):
        return None
    return kind(value)


def crashed(message: str, head: Row) -> Row:
    """The row of a scene that nothing is known of, but why."""
    known = {**head, "status": CRASHED, "message": message, "certified": False}
    return {name: known.get(name) for name in COLUMNS}


def times_of(timings: Mapping[str, float], head: Row) -> Row:
    """The seconds of a plan by step, 0 for those that it did not come to."""
    seconds = {f"{step}_s": timings.get(step, 0.0) for step in STEPS}
    known = {**head, **seconds, "total_s": sum(seconds.values()), "compile_s": timings.get("compile", 0.0)}
    return {name: _plain(known[name], kind) for name, kind in TIMES.items()}


def no_times(head: Row) -> Row:
    """Likewise of a scene that crashed."""
    return {name: head.get(name) for name in TIMES}
