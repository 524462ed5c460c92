"""A study's folder: what is done stays done, whatever happens.

    study.json      what the study is, see `Task.describe`
    table.jsonl     a line a scene, in the order in which they were done
    timings.jsonl   a line a scene, its seconds by step
    .lock           held by the one process that works on the study; the kernel releases it at its death

Lines are appended and forced to disk a chunk at a time, timings first: a scene is done when its line in the
table is. A line of the table that was not written to its end is cut off with all behind it when the study
goes on, and its scene is planned again; damaged timings are passed over. Nothing in a folder is taken on
trust, and only whole lines count. Names of files are fixed and links are not followed, so nothing is ever
written elsewhere.
"""

import errno
import fcntl
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from jaxplan.study.rows import COLUMNS, TIMES, Answer, Row
from jaxplan.study.task import Task

HEADER, TABLE, TIMINGS, LOCK = "study.json", "table.jsonl", "timings.jsonl", ".lock"
_PART = f".{HEADER}.part"  # the header while it is written
_LARGEST_HEADER = 64 * 2**20  # bytes; seeds that do not follow one another take up to 43 each
_LONGEST_LINE = 2**20  # most bytes of a row
_FILES = {TABLE: COLUMNS, TIMINGS: TIMES}
_KEYS: Mapping[str, Any] = {  # of the header, with their types
    "jaxplan": str,
    "kind": str | None,
    "planner": str,
    "settings": dict,
    "scenes": int,
}


class StudyFolderError(ValueError):
    """A folder that holds no study, or not the one that is wanted; the message says what is wrong."""


def read_header(folder: Path) -> dict[str, Any]:
    """Read the description of a folder's study, see `Task.describe`.

    Raises:
        StudyFolderError: if it is no folder of a study.
    """
    path = folder / HEADER
    try:
        with path.open("rb") as file:  # what a link leads to may have no end
            text = file.read(_LARGEST_HEADER + 1)
        if len(text) > _LARGEST_HEADER:
            raise ValueError(f"too large, at most {_LARGEST_HEADER} bytes are read")
        content = json.loads(text, parse_constant=_refuse)
        if not isinstance(content, dict):
            raise ValueError("it is no table")
        for key, kind in _KEYS.items():
            if not isinstance(content.get(key), kind) or isinstance(content.get(key), bool):
                raise ValueError(f"{key} is missing or wrong")
        if not 0 < content["scenes"] < 2**31:
            raise ValueError(f"scenes = {content['scenes']}")
    except OSError as error:
        raise StudyFolderError(f"{folder}: holds no study: {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise StudyFolderError(f"{path}: not the head of a study ({error})") from error
    return content


def scan(folder: Path, name: str, scenes: int) -> Iterator[tuple[int, Row]]:
    """Yield the rows of a file up to the first line that is not whole, each after its line's end in bytes.

    Args:
        folder: of a study.
        name: `TABLE`, or `TIMINGS`, of which damaged lines are passed over; a missing file has no rows.
        scenes: how many the study has.
    """
    if not (folder / name).exists():
        return
    end = 0
    with open(os.open(folder / name, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
        while line := file.readline(_LONGEST_LINE):
            row = _row(line, _FILES[name], scenes)
            if row is None and not (name == TIMINGS and line.endswith(b"\n")):
                return
            end += len(line)
            if row is not None:
                yield end, row


def _row(line: bytes, columns: Mapping[str, type], scenes: int) -> Row | None:
    """The row of a line, with these columns and a number below `scenes`; None where it is torn or damaged."""
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
    """Raise a ValueError for NaN or an infinity in JSON."""
    raise ValueError(f"{word} is not allowed")


class Store:
    """Store of a study's rows, in a folder or in memory; a context that holds the folder's lock.

    Args:
        folder: a new or empty one, or one that holds the same study; None to keep rows in memory.
        task: the study.

    Attributes:
        done: (scenes,) whether each scene has a row in the table.
        rows: without a folder, the rows of each file by its name.

    Raises:
        StudyFolderError: if the folder holds anything else, is no folder, or is in use.
        OSError: if nothing can be written there.
    """

    def __init__(self, folder: str | os.PathLike[str] | None, task: Task) -> None:
        self.done = bytearray(len(task.scenes))
        self.rows: dict[str, list[Row]] = {TIMINGS: [], TABLE: []}  # without a folder
        self._files: dict[str, IO[bytes]] = {}
        self._open = ExitStack()
        if folder is None:
            return
        if not os.fspath(folder):
            raise StudyFolderError("out is empty, it must name a folder")
        path = Path(folder)
        with ExitStack() as stack:
            _make(path)
            stack.enter_context(_locked(path))
            _claim(path, task.describe())
            for name in self.rows:
                file = self._files[name] = stack.enter_context(_open(path / name))
                whole = 0
                for end, row in scan(path, name, len(self.done)):
                    whole = end
                    if name == TABLE:
                        self.done[row["scene"]] = True
                if file.seek(0, os.SEEK_END) > whole:
                    file.truncate(whole)
            self._open = stack.pop_all()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def add(self, answer: Answer) -> list[Row]:
        """Write the rows of a chunk to disk, or keep them; returns those of scenes that had none before."""
        fresh: list[Row] = []
        for name, rows in ((TIMINGS, answer.timings), (TABLE, answer.table)):
            fresh = [row for row in rows if not self.done[row["scene"]]]
            if self._files:
                _append(self._files[name], fresh)
            else:
                self.rows[name] += fresh
        for row in fresh:
            self.done[row["scene"]] = True
        return fresh


def _make(folder: Path) -> None:
    """Make a folder where it is missing; raise a StudyFolderError if it holds something else than a study."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        file = next(place for place in (folder, *folder.parents) if place.exists())
        raise StudyFolderError(f"{folder}: cannot be a folder, {file} is a file") from error
    names = {entry.name for entry in os.scandir(folder)}
    if HEADER not in names and names - {LOCK, _PART}:
        raise StudyFolderError(
            f"{folder}: holds {min(names - {LOCK, _PART})}, but no study: take a new or an empty folder"
        )


def _locked(folder: Path) -> IO[bytes]:
    """Open and lock the folder's lock file, until it is closed; raise StudyFolderError if it is taken."""
    lock = _open(folder / LOCK)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        lock.close()
        raise StudyFolderError(f"{folder}: another process is working on this study") from error
    return lock


def _claim(folder: Path, description: Mapping[str, Any]) -> None:
    """Write a study's description to a folder that has none; raise StudyFolderError if it has another."""
    if not (folder / HEADER).exists():
        text = json.dumps(description, indent=1, allow_nan=False).encode() + b"\n"
        if len(text) > _LARGEST_HEADER:
            raise StudyFolderError(
                f"{folder}: seeds that do not follow one another are too many to be kept: take range(n)"
            )
        with _open(folder / _PART) as file:
            file.truncate(0)
            file.write(text)
            _force(file)
        os.replace(folder / _PART, folder / HEADER)
        return
    there = read_header(folder)
    differing = [
        f"{key} {_short(there.get(key))} there, {_short(description.get(key))} here"
        for key in dict.fromkeys([*description, *there])
        if there.get(key) != description.get(key)
    ]
    if differing:
        raise StudyFolderError(
            f"{folder}: holds another study ({'; '.join(differing)}): take another folder, or the same study"
        )


def _short(value: Any) -> str:
    """A value as JSON, cut to 80 characters."""
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."


def _open(path: Path) -> IO[bytes]:
    """Open a file to append to, made where it is missing; raise StudyFolderError if it is a link."""
    try:
        return open(os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o666), "ab")
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise StudyFolderError(f"{path}: is a link, which studies do not follow") from error
        raise


def _append(file: IO[bytes], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows as lines of JSON, and force them to disk."""
    file.write(b"".join(json.dumps(row, allow_nan=False).encode() + b"\n" for row in rows))
    _force(file)


def _force(file: IO[bytes]) -> None:
    """Force what was written to a file to disk."""
    file.flush()
    os.fsync(file.fileno())
