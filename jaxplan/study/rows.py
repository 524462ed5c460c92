"""The table of a study: a row of each scene, as JSON lines and as data frames.

A scene's line in the table of a study, and what it took: plain numbers and texts in the units of files.

Rows are the same on every run; times are not, and stand apart. What a plan does not have is None. The status
is the plan's, or `CRASHED` where planning raised an error that it must not raise, or killed its process.

Reading a study's folder: nothing in it is taken on trust, and only whole lines count.

Studies as data frames and Parquet files, by pandas and pyarrow, which the extra ``study`` brings.
"""

import json
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxplan.planner import Plan
from jaxplan.runtime.files import replacing_file

if TYPE_CHECKING:
    import pandas as pd

    from jaxplan.study.result import Study


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


HEADER, TABLE, TIMINGS = "study.json", "table.jsonl", "timings.jsonl"
LARGEST_HEADER = 64 * 2**20  # bytes; seeds that do not follow one another take up to 43 each
_LONGEST_LINE = 2**20


class StudyFolderError(ValueError):
    """A folder that holds no study, or not the one that is wanted; the message says what is wrong."""


_HEADER: Mapping[str, tuple[type, ...]] = {
    "jaxplan": (str,),
    "kind": (str, type(None)),
    "planner": (str,),
    "settings": (dict,),
    "scenes": (int,),
}


def read_header(folder: Path) -> dict[str, Any]:
    """What a folder's study is, see `Task.describe`.

    Raises:
        StudyFolderError: if it is no folder of a study.
    """
    path = folder / HEADER
    try:
        with path.open("rb") as file:  # what a link leads to may have no end
            text = file.read(LARGEST_HEADER + 1)
        if len(text) > LARGEST_HEADER:
            raise ValueError(f"too large, at most {LARGEST_HEADER} bytes are read")
        content = json.loads(text, parse_constant=_refuse)
    except OSError as error:
        raise StudyFolderError(f"{folder}: holds no study: {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise StudyFolderError(f"{path}: not the head of a study ({error})") from error
    if not isinstance(content, dict):
        raise StudyFolderError(f"{path}: not the head of a study")
    for key, types in _HEADER.items():
        if not isinstance(content.get(key), types) or isinstance(content.get(key), bool):
            raise StudyFolderError(f"{path}: not the head of a study ({key} is missing or wrong)")
    if not 0 < content["scenes"] < 2**31:
        raise StudyFolderError(f"{path}: not the head of a study (scenes = {content['scenes']})")
    return content


def read_rows(path: Path, columns: Mapping[str, type], scenes: int, *, past: bool = False) -> list[Row]:
    """The rows of a file in the order of scenes; of those that are there twice the last.

    Args:
        path: the file; a missing one has no rows.
        columns: types of each column, beside None.
        scenes: how many the study has.
        past: as in `scan`.
    """
    rows = {row["scene"]: row for _, row in scan(path, columns, scenes, past=past)}
    return [rows[number] for number in sorted(rows)]


def whole_lines(path: Path, columns: Mapping[str, type], scenes: int, *, past: bool = False) -> int:
    """Where the last of the whole lines ends, bytes; the arguments are those of `scan`."""
    return max((end for end, _ in scan(path, columns, scenes, past=past)), default=0)


def scan(
    path: Path, columns: Mapping[str, type], scenes: int, *, past: bool = False
) -> Iterator[tuple[int, Row]]:
    """The rows of a file up to the first line that is not whole, each with where its line ends.

    Args:
        path: the file; a missing one has no rows.
        columns: types of each column, beside None.
        scenes: how many the study has.
        past: whether damaged lines are passed over, as where rows are not needed.
    """
    if not path.exists():
        return
    end = 0
    with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
        while line := file.readline(_LONGEST_LINE):
            row = _row(line, columns, scenes)
            if row is None and not (past and line.endswith(b"\n")):
                return
            end += len(line)
            if row is not None:
                yield end, row


def _row(line: bytes, columns: Mapping[str, type], scenes: int) -> Row | None:
    """A line's row; None where it is torn or damaged."""
    if not line.endswith(b"\n"):
        return None
    try:
        row = json.loads(line, parse_constant=_refuse)
    except (ValueError, RecursionError):
        return None
    if not isinstance(row, dict) or row.keys() != columns.keys() or not isinstance(row["scene"], int):
        return None
    right = all(row[name] is None or type(row[name]) is kind for name, kind in columns.items())
    return {name: row[name] for name in columns} if right and 0 <= row["scene"] < scenes else None


def _refuse(word: str) -> float:
    raise ValueError(f"{word} is not allowed")


_TYPES = {int: "Int64", float: "Float64", bool: "boolean", str: "string"}  # those of pandas that have NA


def to_pandas(study: "Study") -> "pd.DataFrame":
    """See `Study.to_pandas`."""
    try:
        import pandas as pd
    except ImportError as error:
        raise _missing("pandas") from error
    times = {row["scene"]: row for row in study.timings}
    columns = {**COLUMNS, **TIMES}
    rows = [{**times.get(row["scene"], {}), **row} for row in study.table]
    return pd.DataFrame(
        {
            name: pd.array([row.get(name) for row in rows], dtype=_TYPES[kind])
            for name, kind in columns.items()
        }
    )


def to_parquet(study: "Study", path: str | os.PathLike[str]) -> None:
    """See `Study.to_parquet`."""
    try:
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise _missing("pyarrow") from error
    frame = to_pandas(study)
    with replacing_file(Path(path)) as temporary:
        frame.to_parquet(temporary, engine="pyarrow", index=False)


def _missing(package: str) -> ImportError:
    return ImportError(
        f"{package} is missing: install the extra that brings it, pip install 'jaxplan[study]'"
    )
