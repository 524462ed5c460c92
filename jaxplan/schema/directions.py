"""Directions in a file: unit vectors, samples over times of what moves, and names that ``[sky]`` knows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxplan.model.directions import DirectionPath
from jaxplan.model.hidden_spans import Hidden
from jaxplan.schema.arrays import DIRECTION, Array, units
from jaxplan.schema.faults import WRONG, Place, Reading, nearest
from jaxplan.schema.model_tables import KINDS, declared
from jaxplan.schema.sky import Followed
from jaxplan.schema.tables import Field, Table
from jaxplan.schema.value_kinds import Kind, Names

_SLOPE_TOLERANCE = 1e-3  # rad between two samples, by which slopes may be off, as they may have few digits


@dataclass(frozen=True)
class Axis(Kind):
    """A direction: a unit vector, or a path if it moves.

    Attributes:
        inline: whether a file may give a path as a table of samples and times in place of the vector;
            otherwise these are keys beside it.
        moving: whether it may move; a file may then also give a name of ``[sky]``.
    """

    inline: bool = False
    moving: bool = True

    @property
    def wanted(self) -> str:
        return DIRECTION.wanted

    @property
    def fields(self) -> Sequence[Field]:  # type: ignore[override]
        return PATH.attributes

    def read(self, value: Any, place: Place) -> Any:
        if isinstance(value, DirectionPath):
            if value.moves and not self.moving:
                return place.refuse(f"must be {self.wanted}, not a direction that moves", value)
            return _take_in_path(value, place) if value.moves else DIRECTION.read(value.samples[0], place)
        if not place.reading.python:
            if value == "hold" and self.inline:
                complaint = "is no direction: name a device that keeps its joints in goal.hold"
                return place.refuse(complaint, value)
            if isinstance(value, str) and self.moving:
                return Followed(value, "" if self.inline else "direction")
            if isinstance(value, dict) and self.inline:
                return PATH.read(value, place)
        return DIRECTION.read(value, place)

    def write(self, value: Any) -> Any:
        if isinstance(value, Followed):
            return value.name
        if not isinstance(value, DirectionPath):
            return DIRECTION.write(value)
        return PATH.write(value) if value.moves else DIRECTION.write(value.samples[0])


class TargetDevices(Names):
    """Names of the devices that have targets, in Python; none for all terminals."""

    def read(self, value: Any, place: Place) -> Any:
        read = super().read(value, place)
        reading = place.reading
        if read is WRONG:  # so many were named; which ones has been told
            reading.sizes["target"] = len(value) if isinstance(value, list | tuple) else None
        else:
            reading.sizes["target"] = len(read) if read else reading.sizes["terminal"]
        return read


@dataclass(frozen=True)
class TargetList(Kind):
    """A direction for each terminal, or by names of devices; read to an array, or to a tuple if some move."""

    still = Array(("target", 3), noun="directions, one a terminal", rule=units)
    wanted = f"an array of {still.wanted}, or a table of them by names of devices"
    fields = property(lambda self: PATH.attributes)

    @property
    def tables(self) -> dict[str, Table]:
        """The table of a target that moves, by words for it, for the reference."""
        return {"of one that moves": PATH}

    def read(self, value: Any, place: Place) -> Any:
        if isinstance(value, dict) and not place.reading.python:
            return self._read_by_name(value, place)
        if not place.reading.python:
            place.reading.sizes["target"] = place.reading.sizes["terminal"]
        entries = value if isinstance(value, list | tuple) else ()
        if not any(isinstance(one, str | dict | DirectionPath) for one in entries):
            read = self.still.read(value, place)
            return read.reshape(-1, 3) if isinstance(read, np.ndarray) else read  # also of no terminals
        count = place.reading.sizes["target"]
        if count not in (None, len(value)):
            complaint = f"must be an array of {count} {self.still.wanted}, not of {len(value)}"
            return place.refuse(complaint, value)
        return _combine_directions([Axis(inline=True).read(entry, place[i]) for i, entry in enumerate(value)])

    def _read_by_name(self, value: dict[str, Any], place: Place) -> Any:
        """Read a table of a file from names of devices to directions.

        Returns:
            The names, and the directions as `Targets` has them.
        """
        known = place.reading.names.get("device")
        if not value:
            return place.refuse("must name a device at least, and what it points at", value)
        for name in value:
            if known is not None and name not in known:
                place[name].fault(f"no such device, {nearest(name, known, 'devices')}")
        return tuple(value), _combine_directions(
            [Axis(inline=True).read(own, place[name]) for name, own in value.items()]
        )

    def may_miss(self, reading: Reading) -> bool:
        return reading.sizes.get("terminal") == 0

    def write(self, value: Any) -> Any:
        if isinstance(value, dict):
            return {name: Axis().write(direction) for name, direction in value.items()}
        return [Axis().write(direction) for direction in value]


def _combine_directions(each: Sequence[Any]) -> Any:
    """Return directions as `Targets` has them: (k, 3), or a tuple if one moves; `WRONG` if one is wrong."""
    if any(one is WRONG for one in each):
        return WRONG
    moving = any(isinstance(one, Followed | DirectionPath) for one in each)
    return tuple(each) if moving else np.array(each).reshape(-1, 3)


def path_of(parts: dict[str, Any], place: Place) -> Any:
    """Make the path through samples at times.

    Args:
        parts: values that were read, by attribute: samples and times, perhaps the target's name and when it
            is hidden.
        place: place of the path, where a fault is noted.

    Returns:
        The path; `WRONG` if a part of it has faults, or there is no such path.
    """
    place.reading.sizes.pop("sample", None)  # the next path has its own number of them
    samples, times, hidden = parts["samples"], parts["times"], parts.get("hidden", ())
    called = parts.get("called", "")
    if samples is WRONG or times is WRONG or WRONG in hidden or called is WRONG:
        return WRONG
    try:
        return replace(DirectionPath.through(times, samples), hidden=hidden, called=called)
    except ValueError as error:
        return place["direction_samples"].fault(str(error).removeprefix("samples: "), samples.tolist())


def _take_in_path(path: DirectionPath, place: Place) -> Any:
    """Check a path made in Python, and make it anew as if from a file; a path used many times only once."""
    taken = place.reading.taken
    if id(path) not in taken:
        taken[id(path)] = path, _remake_path(path, place)
    return taken[id(path)][1]


def _remake_path(path: DirectionPath, place: Place) -> Any:
    """Make the path through the samples of another; `WRONG` after noting what is wrong with that."""
    parts = {
        entry.attribute: entry.kind.read(getattr(path, entry.attribute), place[entry.key])
        for entry in PATH.attributes
    }
    made = path_of(parts, place)
    slopes = parts["slopes"]
    if made is WRONG or slopes is WRONG:
        return WRONG
    off = (slopes - made.slopes) * np.gradient(made.times)[:, None]
    wrong = np.flatnonzero(~np.all(np.abs(off) <= _SLOPE_TOLERANCE, axis=1))
    if len(wrong):
        i = int(wrong[0])
        complaint = "must be that of the spline; DirectionPath.through finds it"
        return place["slopes"][i].fault(complaint, slopes[i])
    return made


def _check_span(span: Hidden, place: Place) -> None:
    """Note a fault if a span does not end after its start."""
    if WRONG not in (span.start, span.end) and not span.start < span.end:
        place["to_s"].fault(f"must be later than {place['from_s'].told(span.start)}", span.end)


KINDS |= {
    "unit vector": Axis(moving=False),
    "axis": Axis(),
    "aim": Axis(inline=True),
    "targets": TargetList(),
    "target devices": TargetDevices(),
}
HIDDEN = declared(Hidden, check=_check_span)
PATH: Table = declared(DirectionPath, make=path_of)
