"""A study's folder: a scene that is done stays done, even if the process is killed.

    study.json      the head: describes the study, see `Task.describe`
    table.jsonl     a row for each scene, one to a line, in the order in which they were done
    timings.jsonl   likewise the computation times of each scene by step
    .lock           locked by the process that works on the study; the kernel releases it at its death

Lines are appended and forced to disk a chunk at a time, first the timings and then the table: a scene is done
when its line in the table is written. When a study goes on, the table is cut before its first line that is
incomplete or damaged, and the scenes from there on are planned again; damaged timings are ignored. A study
that begins with the scenes of the one in the folder continues it; a last block that was not full is planned
again, since its scenes are planned together with those that come after.

Everything that is read from a folder is checked. File names are fixed and symbolic links are not followed, so
that nothing is written outside the folder.
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
_LONGEST_LINE = 2**20  # bytes of a row at most
_HEAD_KEYS: Mapping[str, Any] = {  # keys of the head, with their types
    "jaxplan": str,
    "kind": str | None,
    "planner": str,
    "settings": dict,
    "scenes": int,
}


def _check_header(content: dict[str, Any]) -> None:
    """Raise a ValueError if a head, as read from JSON, is not that of a study."""
    for key, kind in _HEAD_KEYS.items():
        if not isinstance(content.get(key), kind) or isinstance(content.get(key), bool):
            raise ValueError(f"{key} is missing or wrong")
    own = content.get("columns", [])
    if not isinstance(own, list) or not all(isinstance(name, str) for name in own):
        raise ValueError("columns is wrong")
    if not 0 < content["scenes"] < 2**31:
        raise ValueError(f"scenes = {content['scenes']}")


_HEAD = Head(name=HEADER, noun=NOUN, check=_check_header)


def read_header(folder: Path) -> dict[str, Any]:
    """Read the head of a study's folder, see `Task.describe`.

    Raises:
        StudyFolderError: if it is not the folder of a study.
    """
    return _HEAD.read(folder)


def scan(folder: Path, name: str, scenes: int, own: Iterable[str] = ()) -> Iterator[tuple[int, Row]]:
    """Read the rows of a file, up to the first line that is incomplete or damaged.

    Args:
        folder: of a study.
        name: `TABLE` or `TIMINGS`; in the latter damaged lines are skipped. A missing file has no rows.
        scenes: number of the study's scenes.
        own: names of the study's own columns.

    Yields:
        (end, row): the position in bytes behind the row's line, and the row.
    """
    columns = columns_of(own) if name == TABLE else TIMES
    if not (folder / name).exists():
        return
    end = 0
    with open(os.open(folder / name, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
        while line := file.readline(_LONGEST_LINE):
            row = _parse_row(line, columns, scenes)
            if row is None and not (name == TIMINGS and line.endswith(b"\n")):
                return
            end += len(line)
            if row is not None:
                yield end, row


def _parse_row(line: bytes, columns: Mapping[str, type], scenes: int) -> Row | None:
    """Parse a line of a file; returns None if it is incomplete or damaged.

    Args:
        line: with its end of line.
        columns: type of each column that the row must have, by name.
        scenes: number of the study's scenes, below which the row's scene must be.
    """
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
    """Keeps the rows of a study in a folder or in memory; as a context manager it holds the folder's lock.

    Args:
        folder: a new or empty folder, or one that holds the same study, or the first scenes of it; None to
            keep rows in memory.
        task: the study.

    Attributes:
        done: (scenes,) whether each scene has a row in the table.
        rows: without a folder, the rows of `TABLE` and `TIMINGS` by these names; empty lists with one.

    Raises:
        StudyFolderError: if the folder holds anything else, is not a folder, or is in use.
        OSError: if nothing can be written there.
    """

    def __init__(self, folder: str | os.PathLike[str] | None, task: Task) -> None:
        self.done = bytearray(len(task.scenes))
        self.rows: dict[str, list[Row]] = {TIMINGS: [], TABLE: []}  # without a folder
        self._files: dict[str, IO[bytes]] = {}
        self._exit_stack = ExitStack()
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
            self._exit_stack = stack.pop_all()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self._exit_stack.close()

    def add(self, answer: Answer) -> list[Row]:
        """Write the rows of a chunk to disk, or keep them in memory.

        Returns:
            The rows of the table that are new; scenes that had a row before are ignored.
        """
        fresh: list[Row] = []
        for name, rows in ((TIMINGS, answer.timings), (TABLE, answer.table)):
            fresh = [row for row in rows if not self.done[row["scene"]]]
            if self._files:
                _append_rows(self._files[name], fresh)
            else:
                self.rows[name] += fresh
        for row in fresh:
            self.done[row["scene"]] = True
        return fresh


def _keep_full_blocks(folder: Path, scenes: int, own: Iterable[str]) -> None:
    """Remove the rows of a last block that is not full from the files of a study.

    Args:
        folder: of the study.
        scenes: number of its scenes.
        own: names of its own columns.
    """
    full = scenes - scenes % BLOCK
    for name in (TABLE, TIMINGS):  # table first: a scene without a row there is planned again
        if full < scenes and (folder / name).exists():
            with replacing_file(folder / name) as fresh, fresh.open("wb") as file:
                _append_rows(file, (row for _, row in scan(folder, name, scenes, own) if row["scene"] < full))


def _append_rows(file: IO[bytes], rows: Iterable[Mapping[str, Any]]) -> None:
    """Append rows to a file as lines of JSON, and force them to disk."""
    file.write(b"".join(json.dumps(row, allow_nan=False).encode() + b"\n" for row in rows))
    force(file)
