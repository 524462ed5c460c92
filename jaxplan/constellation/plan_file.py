"""Files of satellites' plans: the motion's arrays, and what became of each activity, packed as one npz.

The same plan makes the same bytes. A file is read without trusting it: no code in it is run, and one that is
damaged, or of another kind, is none.
"""

import io
import json
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.model.status import Status
from jaxplan.runtime.display import shown
from jaxplan.study.folder import refuse_constant
from jaxplan.timeline import PlannedActivity, Segment, TimelinePlan
from jaxplan.trajectory import Trajectory

FORMAT = 1
_ROW, _RECORD = "row", "record"
_STATIC = ("smoothness", "method")
_TIMES = ("start", "end", "slew", "pointing_error")
_ERRORS = (  # of reading what is no such file
    OSError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    EOFError,
    NotImplementedError,
    RecursionError,
    zipfile.BadZipFile,
    zlib.error,
)


class PlanFileDamagedError(ValueError):
    """A file that holds no satellite's plan; the message says which."""


@shown("status", "message", "activities", "trajectory.duration s", heading="Plan of satellite {0.satellite}")
@dataclass(frozen=True, kw_only=True, eq=False)
class SatellitePlan:
    """The plan of one satellite of a fleet, as its file has it.

    Attributes:
        row: that of the table, by column.
        trajectory: all of the motion as a function of time; None where nothing is planned.
        segments: slews and activities in order, without gaps.
        activities: what became of each time between changes of links.
    """

    row: Mapping[str, Any]
    trajectory: Trajectory | None
    segments: tuple[Segment, ...]
    activities: tuple[PlannedActivity, ...]

    @property
    def satellite(self) -> int:
        """Number of the satellite."""
        return int(self.row["satellite"])

    @property
    def status(self) -> str:
        """Name of the status, or "crashed"."""
        return str(self.row["status"])

    @property
    def message(self) -> str:
        """What is in the way; empty when all is well."""
        return str(self.row["message"])


def packed(row: Mapping[str, Any], plan: TimelinePlan | None) -> bytes:
    """The bytes of a plan's file.

    Args:
        row: of the table.
        plan: of the timeline; None where planning crashed.
    """
    arrays: dict[str, Any] = {}
    record: dict[str, Any] = {"format": FORMAT, "segments": [], "activities": []}
    if plan is not None:
        record["segments"] = [[one.name, one.kind, one.start, one.end] for one in plan.segments]
        record["activities"] = [_activity(one) for one in plan.activities]
        if plan.trajectory is not None:
            own = plan.trajectory
            arrays = {name: np.asarray(getattr(own, name)) for name in _array_names()}
            record["trajectory"] = {name: getattr(own, name) for name in _STATIC}
    target = io.BytesIO()
    arrays |= {_ROW: _text(row), _RECORD: _text(record)}
    np.savez_compressed(target, **arrays)
    return target.getvalue()


def _activity(one: PlannedActivity) -> list[Any]:
    """What became of an activity, as the record has it."""
    times = (getattr(one, key) for key in _TIMES)
    known = [None if time is None or not np.isfinite(time) else float(time) for time in times]
    return [one.name, one.kind, one.status.name, one.message, *known]


def _array_names() -> list[str]:
    """Names of a trajectory's arrays."""
    return [one.name for one in fields(Trajectory) if one.name not in _STATIC]


def _text(value: Any) -> np.ndarray:
    """Bytes (k,) of a value as JSON."""
    return np.frombuffer(json.dumps(value, allow_nan=False).encode(), np.uint8)


def _value(text: np.ndarray) -> Any:
    """The value of bytes (k,) of JSON; NaN and infinities are refused."""
    return json.loads(bytes(np.asarray(text, np.uint8)), parse_constant=refuse_constant)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The arrays of a file while a block runs; links are not followed."""
    with (
        open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file,
        np.load(file, allow_pickle=False) as arrays,
    ):
        yield arrays


def read_row(path: Path, columns: Mapping[str, type]) -> dict[str, Any] | None:
    """The row in a plan's file; None where there is no such file, or it is damaged."""
    try:
        with _opened(path) as file:
            if set(file.files) < {_ROW, _RECORD}:
                return None
            row = _value(file[_ROW])
    except _ERRORS:
        return None
    if not isinstance(row, dict) or row.keys() != columns.keys():
        return None
    right = all(row[name] is None or type(row[name]) is kind for name, kind in columns.items())
    return {name: row[name] for name in columns} if right else None


def read_plan(path: Path) -> SatellitePlan:
    """Read a plan's file.

    Raises:
        PlanFileDamagedError: if it is none.
    """
    try:
        with _opened(path) as file:
            row, record = _value(file[_ROW]), _value(file[_RECORD])
            arrays = {name: file[name] for name in file.files if name not in (_ROW, _RECORD)}
        if record["format"] != FORMAT:
            raise ValueError(f"format {record['format']}, must be {FORMAT}")
        trajectory = None
        if "trajectory" in record:
            if not all(np.all(np.isfinite(array)) for array in arrays.values()):
                raise ValueError("numbers that are not finite")
            static = {name: record["trajectory"][name] for name in _STATIC}
            trajectory = Trajectory(**{name: arrays[name] for name in _array_names()}, **static)
        return SatellitePlan(
            row=row,
            trajectory=trajectory,
            segments=tuple(
                Segment(name=name, kind=kind, start=start, end=end)
                for name, kind, start, end in record["segments"]
            ),
            activities=tuple(
                PlannedActivity(
                    name=name,
                    kind=kind,
                    status=Status[status],
                    message=message,
                    **dict(zip(_TIMES, times, strict=True)),
                )
                for name, kind, status, message, *times in record["activities"]
            ),
        )
    except _ERRORS as error:
        raise PlanFileDamagedError(f"{path}: holds no plan of a satellite ({error})") from error
