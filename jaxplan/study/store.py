"""A study's folder: what is done stays done, whatever happens.

    study.json      what the study is, see `Task.describe`
    table.jsonl     a line a scene, in the order in which they were done
    timings.jsonl   likewise, the seconds of each
    .lock           held by the one process that works on the study; the kernel releases it at its death

Lines are appended and forced to disk a chunk at a time, timings first: a scene is done when its line in the
table is. A line of the table that was not written to its end is cut off with all behind it when the study
goes on, and its scene is planned again; damaged timings are passed over. Names of files are fixed and links
are not followed, so nothing is ever written elsewhere.
"""

import errno
import fcntl
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from jaxplan.study.blocks import Answer
from jaxplan.study.rows import (
    COLUMNS,
    HEADER,
    LARGEST_HEADER,
    TABLE,
    TIMES,
    TIMINGS,
    StudyFolderError,
    read_header,
    scan,
    whole_lines,
)
from jaxplan.study.task import Task

LOCK = ".lock"


class Store:
    """The folder of a study that is being made; a context that holds its lock.

    Args:
        folder: a new or empty one, or one that holds the same study.
        task: the study.

    Raises:
        StudyFolderError: if the folder holds anything else, is no folder, or is in use.
        OSError: if nothing can be written there.
    """

    def __init__(self, folder: str | os.PathLike[str], task: Task) -> None:
        if not os.fspath(folder):
            raise StudyFolderError("out is empty, it must name a folder")
        self.folder = Path(folder)
        self.done = bytearray(len(task.scenes))
        with ExitStack() as stack:
            _make(self.folder)
            stack.enter_context(_locked(self.folder))
            _claim(self.folder, task.describe())
            self._timings = stack.enter_context(_open(self.folder / TIMINGS))
            self._table = stack.enter_context(_open(self.folder / TABLE))
            _cut(self._timings, whole_lines(self.folder / TIMINGS, TIMES, len(self.done), past=True))
            _cut(self._table, self._resume())
            self._files = stack.pop_all()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self._files.close()

    def add(self, answer: Answer) -> None:
        """Keep the rows of a chunk, for good."""
        _append(self._timings, answer.timings)
        _append(self._table, answer.table)
        for row in answer.table:
            self.done[row["scene"]] = True

    def _resume(self) -> int:
        """Note which scenes are done; returns where the last whole line ends."""
        whole = 0
        for end, row in scan(self.folder / TABLE, COLUMNS, len(self.done)):
            self.done[row["scene"]], whole = True, end
        return whole


def _make(folder: Path) -> None:
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
    """The lock's file, locked as long as it is open."""
    lock = _open(folder / LOCK)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        lock.close()
        raise StudyFolderError(f"{folder}: another process is working on this study") from error
    return lock


_PART = f".{HEADER}.part"


def _claim(folder: Path, description: Mapping[str, Any]) -> None:
    """Say in the folder which study it is, or see that it is this one."""
    if not (folder / HEADER).exists():
        text = json.dumps(description, indent=1, allow_nan=False).encode() + b"\n"
        if len(text) > LARGEST_HEADER:
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
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."


def _open(path: Path) -> IO[bytes]:
    """A file of the folder to append to, made where it is missing; no link to another place."""
    try:
        return open(os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o666), "ab")
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise StudyFolderError(f"{path}: is a link, which studies do not follow") from error
        raise


def _cut(file: IO[bytes], end: int) -> None:
    if file.seek(0, os.SEEK_END) > end:
        file.truncate(end)


def _append(file: IO[bytes], rows: Iterable[Mapping[str, Any]]) -> None:
    file.write(b"".join(json.dumps(row, allow_nan=False).encode() + b"\n" for row in rows))
    _force(file)


def _force(file: IO[bytes]) -> None:
    file.flush()
    os.fsync(file.fileno())
