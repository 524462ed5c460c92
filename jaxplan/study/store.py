"""A study's folder: what is done stays done, whatever happens.

    study.json      what the study is, see `Task.describe`
    table.jsonl     a line a scene, in the order in which they were done
    timings.jsonl   a line a scene, its seconds by step
    .lock           held by the one process that works on the study; the kernel releases it at its death

Lines are appended and forced to disk a chunk at a time, timings first: a scene is done when its line in the
table is. A line of the table that was not written to its end is cut off with all behind it when the study
goes on, and its scene is planned again; damaged timings are passed over. A study that begins with the scenes
of the one in the folder goes on from it; a last block that was not full is planned again, since its scenes
are planned together with those that come after. Nothing in a folder is taken on
trust, and only whole lines count. Names of files are fixed and links are not followed, so nothing is ever
written elsewhere.
"""

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from jaxplan.runtime.files import replacing_file
from jaxplan.study.folder import Head, StudyFolderError, force, open_file, refuse_constant
from jaxplan.study.rows import TIMES, Answer, Row, columns_of
from jaxplan.study.task import BLOCK, Task

HEADER, TABLE, TIMINGS = "study.json", "table.jsonl", "timings.jsonl"
NOUN = "study"
_LONGEST_LINE = 2**20  # most bytes of a row
_KEYS: Mapping[str, Any] = {  # of the header, with their types
    "jaxplan": str,
    "kind": str | None,
    "planner": str,
    "settings": dict,
    "scenes": int,
}


def _check_header(content: dict[str, Any]) -> None:
    """Raise a ValueError for the head of what is no study."""
    for key, kind in _KEYS.items():
        if not isinstance(content.get(key), kind) or isinstance(content.get(key), bool):
            raise ValueError(f"{key} is missing or wrong")
    own = content.get("columns", [])
    if not isinstance(own, list) or not all(isinstance(name, str) for name in own):
        raise ValueError("columns is wrong")
    if not 0 < content["scenes"] < 2**31:
        raise ValueError(f"scenes = {content['scenes']}")


_HEAD = Head(name=HEADER, noun=NOUN, check=_check_header)


def read_header(folder: Path) -> dict[str, Any]:
    """Read the description of a folder's study, see `Task.describe`.

    Raises:
        StudyFolderError: if it is no folder of a study.
    """
    return _HEAD.read(folder)


def scan(folder: Path, name: str, scenes: int, own: Iterable[str] = ()) -> Iterator[tuple[int, Row]]:
    """Yield the rows of a file up to the first line that is not whole, each after its line's end in bytes.

    Args:
        folder: of a study.
        name: `TABLE`, or `TIMINGS`, of which damaged lines are passed over; a missing file has no rows.
        scenes: how many the study has.
        own: names of columns that it has besides those of every study.
    """
    columns = columns_of(own) if name == TABLE else TIMES
    if not (folder / name).exists():
        return
    end = 0
    with open(os.open(folder / name, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
        while line := file.readline(_LONGEST_LINE):
            row = _row(line, columns, scenes)
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
        row = json.loads(line, parse_constant=refuse_constant)
    except (ValueError, RecursionError):
        return None
    if not isinstance(row, dict) or row.keys() != columns.keys() or not isinstance(row["scene"], int):
        return None
    right = all(row[name] is None or type(row[name]) is kind for name, kind in columns.items())
    return {name: row[name] for name in columns} if right and 0 <= row["scene"] < scenes else None


class Store:
    """Store of a study's rows, in a folder or in memory; a context that holds the folder's lock.

    Args:
        folder: a new or empty one, or one that holds the same study, or the first scenes of it; None to keep
            rows in memory.
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
            wanted = task.describe()
            stack.enter_context(
                _HEAD.claimed(path, wanted, lambda there: task.first(there["scenes"]).describe())
            )
            scenes = read_header(path)["scenes"]
            if scenes < len(task.scenes):
                _keep_full_blocks(path, scenes, task.columns)
                _HEAD.write(path, wanted)
            for name in self.rows:
                file = self._files[name] = stack.enter_context(open_file(path / name, NOUN))
                whole = 0
                for end, row in scan(path, name, len(self.done), task.columns):
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


def _keep_full_blocks(folder: Path, scenes: int, own: Iterable[str]) -> None:
    """Take the rows of a last block that is not full out of the files of a study of that many scenes."""
    full = scenes - scenes % BLOCK
    for name in (TABLE, TIMINGS):  # the table first: a scene without a row there is planned
        if full < scenes and (folder / name).exists():
            with replacing_file(folder / name) as fresh, fresh.open("wb") as file:
                _append(file, (row for _, row in scan(folder, name, scenes, own) if row["scene"] < full))


def _append(file: IO[bytes], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows as lines of JSON, and force them to disk."""
    file.write(b"".join(json.dumps(row, allow_nan=False).encode() + b"\n" for row in rows))
    force(file)
