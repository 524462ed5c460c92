"""The folder of a fleet, in which each satellite's plan is safe as soon as it is written.

    fleet.json      the head: describes the fleet
    plans/0017.npz  the plan of a satellite's timeline
    rows/0017.json  its row of the table
    table.jsonl     all rows, ordered by satellite; rewritten when a call ends
    timings.jsonl   the computation times of each satellite, in the order in which they were done

Every file but the timings is first forced to disk under another name and then renamed, so that it is there as
a whole or not at all. A satellite's row is written after its plan, so a satellite is done when it has a row.
On one machine all files but the timings are the same bytes whatever the workers, and however often planning
is interrupted.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jaxplan.constellation.orders import COLUMNS, CRASHED, Planned
from jaxplan.runtime.files import is_day_plan
from jaxplan.study.folder import Head, StudyFolderError, force, open_file, refuse_constant
from jaxplan.timeline import TimelinePlan, load_timeline_plan

Row = dict[str, Any]

_NOUN = "fleet"
_PLANS_FOLDER, _ROWS_FOLDER, _TABLE_FILE, _TIMINGS_FILE = "plans", "rows", "table.jsonl", "timings.jsonl"
_PART_SUFFIX = ".part"
_HEAD_KEYS: Mapping[str, type] = {
    "jaxplan": str,
    "shell": str,
    "satellites": int,
    "epoch": str,
    "until_s": float,
}
_TIMED_STEPS = ("timeline", "motions", "slews", "proof")
_LONGEST_LINE = 2**20  # bytes of a row, or of a line of timings, that are read at most


def _check_head(content: Row) -> None:
    """Raise a ValueError if a head, as read from JSON, is not that of a fleet."""
    for key, kind in _HEAD_KEYS.items():
        if type(content.get(key)) is not kind:
            raise ValueError(f"{key} is missing or wrong")
    if not 0 < content["satellites"] <= 10**6:
        raise ValueError(f"satellites = {content['satellites']}")


_HEAD = Head(name="fleet.json", noun=_NOUN, check=_check_head)


class FleetFolder:
    """Reader and writer of a fleet's folder.

    Args:
        path: of the folder.
        total: number of satellites of the shell, which sets the number of digits in file names.
    """

    def __init__(self, path: Path, total: int) -> None:
        self.path, self.total = path, total

    @classmethod
    def of(cls, path: Path) -> tuple["FleetFolder", Row]:
        """Open an existing folder; returns it with its head.

        Raises:
            StudyFolderError: if it is not the folder of a fleet.
        """
        head = _HEAD.read(path)
        return cls(path, head["satellites"]), head

    @contextmanager
    def claimed(self, description: Mapping[str, Any]) -> Iterator[None]:
        """Make the folder if it is missing, and lock it for a fleet while a block runs.

        Args:
            description: the fleet's head, which is written to a new folder, and must equal that of an old
                one.

        Raises:
            StudyFolderError: see `Head.claimed`; also if the folder of plans or rows is a symbolic link.
        """
        with _HEAD.claimed(self.path, description):
            for name in (_PLANS_FOLDER, _ROWS_FOLDER):
                inner = self.path / name
                if inner.is_symlink():
                    raise StudyFolderError(f"{inner}: is a link, which fleets do not follow")
                inner.mkdir(exist_ok=True)
                for rest in inner.glob(f"*{_PART_SUFFIX}"):  # left over from a call that was killed
                    rest.unlink()
            yield

    def place(self, satellite: int) -> Path:
        """Path of a satellite's plan."""
        return self.path / _PLANS_FOLDER / f"{self._padded_number(satellite)}.npz"

    def _row_path(self, satellite: int) -> Path:
        """Path of a satellite's row."""
        return self.path / _ROWS_FOLDER / f"{self._padded_number(satellite)}.json"

    def _padded_number(self, satellite: int) -> str:
        """A satellite's number as file names have it, with leading zeros."""
        return f"{satellite:0{len(str(self.total - 1))}d}"

    def plan(self, satellite: int) -> TimelinePlan:
        """Read the plan of a satellite; raises a PlanFileError if it is missing or damaged."""
        return load_timeline_plan(self.place(satellite))

    def row(self, satellite: int) -> Row | None:
        """Read the row of a satellite.

        Returns:
            The row; None if it is missing or damaged, or if the plan file that it belongs to is missing or
            damaged.
        """
        try:
            handle = os.open(self._row_path(satellite), os.O_RDONLY | os.O_NOFOLLOW)
            with open(handle, "rb") as file:
                row = json.loads(file.read(_LONGEST_LINE), parse_constant=refuse_constant)
        except (OSError, ValueError, RecursionError):
            return None
        if not isinstance(row, dict) or row.keys() != COLUMNS.keys() or row["satellite"] != satellite:
            return None
        if not all(row[name] is None or type(row[name]) is kind for name, kind in COLUMNS.items()):
            return None
        there = row["status"] == CRASHED or is_day_plan(self.place(satellite))
        return {name: row[name] for name in COLUMNS} if there else None

    def planned(self) -> list[int]:
        """Return the numbers of the satellites that have a plan file, in ascending order."""
        names = [path.stem for path in (self.path / _PLANS_FOLDER).glob("*.npz")]
        return sorted(int(name) for name in names if name.isascii() and name.isdecimal())

    def rows(self) -> dict[int, Row]:
        """Read the rows of all satellites that are done, by satellite number in ascending order."""
        found: dict[int, Row] = {}
        folder = self.path / _ROWS_FOLDER
        for name in sorted(entry.name for entry in os.scandir(folder)) if folder.is_dir() else []:
            number = name.removesuffix(".json")
            if not number.isascii() or not number.isdecimal() or int(number) >= self.total:
                continue
            if self._row_path(int(number)).name == name and (row := self.row(int(number))) is not None:
                found[int(number)] = row
        return found

    def add(self, planned: Planned) -> None:
        """Write a satellite's computation times, plan (if it has one) and row to disk, in this order."""
        line: Row = {"satellite": planned.satellite, "total_s": planned.seconds}
        line |= {f"{step}_s": planned.steps.get(step) for step in _TIMED_STEPS}
        with open_file(self.path / _TIMINGS_FILE, _NOUN) as file:
            file.write(_json_line(line))
            force(file)
        if planned.data is not None:
            self._replace_file(self.place(planned.satellite), planned.data)
        self._replace_file(self._row_path(planned.satellite), _json_line(planned.row))

    def write_table(self, rows: Mapping[int, Row]) -> None:
        """Write the table file anew, with the rows in the order given."""
        self._replace_file(self.path / _TABLE_FILE, b"".join(_json_line(row) for row in rows.values()))

    def timings(self) -> list[Row]:
        """Read the computation times of satellites, a row for each, ordered by satellite number.

        Of several lines for one satellite the last counts. Damaged lines are ignored; a missing file has no
        rows.
        """
        found: dict[int, Row] = {}
        path = self.path / _TIMINGS_FILE
        if not path.exists():
            return []
        with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
            while line := file.readline(_LONGEST_LINE):
                try:
                    row = json.loads(line, parse_constant=refuse_constant)
                except (ValueError, RecursionError):
                    continue
                if isinstance(row, dict) and isinstance(row.get("satellite"), int):
                    found[row["satellite"]] = row
        return [found[number] for number in sorted(found)]

    @staticmethod
    def _replace_file(path: Path, data: bytes) -> None:
        """Write a file as a whole, forced to disk; an existing file is replaced."""
        part = path.with_name(path.name + _PART_SUFFIX)
        with open_file(part, _NOUN) as file:
            file.truncate(0)
            file.write(data)
            force(file)
        os.replace(part, path)


def _json_line(row: Row) -> bytes:
    """A row as a line of JSON."""
    return json.dumps(row, allow_nan=False).encode() + b"\n"
