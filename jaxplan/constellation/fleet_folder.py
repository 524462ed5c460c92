"""The folder of a fleet, where each satellite's plan is safe as soon as it is there.

    fleet.json      what the fleet is, its head
    plans/0017.npz  the plan of a satellite, with its row of the table, see `plan_file`
    table.jsonl     the rows of all plans, in the order of satellites; written anew when a call ends
    timings.jsonl   the seconds of each satellite, in the order in which they were done

A plan is forced to disk under another name and then renamed: it is there as a whole or not at all. All files
but timings are the same bytes whoever plans, and however often that is interrupted.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jaxplan.constellation.orders import COLUMNS, Planned
from jaxplan.constellation.plan_file import SatellitePlan, read_plan, read_row
from jaxplan.study.folder import Head, StudyFolderError, force, open_file, refuse_constant

Row = dict[str, Any]

_NOUN = "fleet"
_PLANS, _TABLE, _TIMINGS = "plans", "table.jsonl", "timings.jsonl"
_PART = ".part"
_KEYS: Mapping[str, type] = {"jaxplan": str, "shell": str, "satellites": int, "epoch": str, "until_s": float}
_STEPS = ("timeline", "motions", "slews", "proof")
_LONGEST_LINE = 2**16  # bytes of a line of timings


def _check(content: Row) -> None:
    """Raise a ValueError for the head of what is no fleet."""
    for key, kind in _KEYS.items():
        if type(content.get(key)) is not kind:
            raise ValueError(f"{key} is missing or wrong")
    if not 0 < content["satellites"] <= 10**6:
        raise ValueError(f"satellites = {content['satellites']}")


_HEAD = Head(name="fleet.json", noun=_NOUN, check=_check)


class FleetFolder:
    """A fleet's folder.

    Args:
        path: of the folder.
        total: number of the fleet's satellites.
    """

    def __init__(self, path: Path, total: int) -> None:
        self.path, self.total = path, total

    @classmethod
    def of(cls, path: Path) -> tuple["FleetFolder", Row]:
        """A folder that is there, with its head; raises a StudyFolderError if it is none of a fleet."""
        head = _HEAD.read(path)
        return cls(path, head["satellites"]), head

    @contextmanager
    def claimed(self, description: Mapping[str, Any]) -> Iterator[None]:
        """Hold the folder for a fleet while a block runs; raises a StudyFolderError, see `Head.claimed`."""
        with _HEAD.claimed(self.path, description):
            plans = self.path / _PLANS
            if plans.is_symlink():
                raise StudyFolderError(f"{plans}: is a link, which fleets do not follow")
            plans.mkdir(exist_ok=True)
            for rest in plans.glob(f"*{_PART}"):  # of a call that was killed
                rest.unlink()
            yield

    def place(self, satellite: int) -> Path:
        """Path of a satellite's plan."""
        return self.path / _PLANS / f"{satellite:0{len(str(self.total - 1))}d}.npz"

    def plan(self, satellite: int) -> SatellitePlan:
        """The plan of a satellite; raises a PlanFileDamagedError if there is none."""
        return read_plan(self.place(satellite))

    def row(self, satellite: int) -> Row | None:
        """The row of a satellite; None where its plan is missing or damaged."""
        row = read_row(self.place(satellite), COLUMNS)
        return row if row is not None and row["satellite"] == satellite else None

    def rows(self) -> dict[int, Row]:
        """The rows of all plans, by satellite and in their order."""
        found: dict[int, Row] = {}
        plans = self.path / _PLANS
        names = sorted(entry.name for entry in os.scandir(plans)) if plans.is_dir() else []
        for name in names:
            number = name.removesuffix(".npz")
            if not number.isascii() or not number.isdecimal() or int(number) >= self.total:
                continue
            if self.place(int(number)).name == name and (row := self.row(int(number))) is not None:
                found[int(number)] = row
        return found

    def add(self, planned: Planned) -> None:
        """Write a satellite's plan to disk, its seconds first."""
        line: Row = {"satellite": planned.satellite, "total_s": planned.seconds}
        line |= {f"{step}_s": planned.steps.get(step) for step in _STEPS}
        with open_file(self.path / _TIMINGS, _NOUN) as file:
            file.write(json.dumps(line, allow_nan=False).encode() + b"\n")
            force(file)
        self._replace(self.place(planned.satellite), planned.data)

    def write_table(self, rows: Mapping[int, Row]) -> None:
        """Write the table anew, from rows in the order of satellites."""
        lines = [json.dumps(row, allow_nan=False).encode() + b"\n" for row in rows.values()]
        self._replace(self.path / _TABLE, b"".join(lines))

    def timings(self) -> list[Row]:
        """The seconds of satellites, of several lines of one the last; damaged lines are passed over."""
        found: dict[int, Row] = {}
        path = self.path / _TIMINGS
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
    def _replace(path: Path, data: bytes) -> None:
        """Write a file as a whole, forced to disk, in the place of what is there."""
        part = path.with_name(path.name + _PART)
        with open_file(part, _NOUN) as file:
            file.truncate(0)
            file.write(data)
            force(file)
        os.replace(part, path)
