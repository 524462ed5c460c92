"""Reading a study's folder: nothing in it is taken on trust, and only whole lines count."""

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from jaxplan.study.rows import Row

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
