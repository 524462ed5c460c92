"""Directions that move, in a scenario file: samples over times, of a zone's axis or a terminal's target.

A zone has the two keys beside its others. A target has them in a table that stands in the place of its
direction, or is the name of a body or of a satellite of ``[sky]``, which is resolved to such a table.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jaxplan.model.moving import DirectionPath, as_path
from jaxplan.scenario.arrays import Direction, Each
from jaxplan.scenario.faults import Place
from jaxplan.scenario.kinds import Interval, Kind, Number
from jaxplan.scenario.tables import Field, Table
from jaxplan.scenario.values import read_array

_TIME = Number(Interval("[-1e7, 1e7]"))
MOST_SAMPLES = 10_000
_SLOPE_ROUNDING = 1e-3  # rad between two samples, of slopes that were held with fewer digits


def _entries(kind: Kind, wanted: str, value: object, place: Place) -> list[Any] | None:
    """At least two entries of an array, read by one kind; None after noting what is wrong with them."""
    if not isinstance(value, list) or not 2 <= len(value) <= MOST_SAMPLES:
        place.fault(f"must be {wanted}, 2 to {MOST_SAMPLES}", value)
        return None
    before = len(place.faults)
    read = [kind.read(entry, place.item(i)) for i, entry in enumerate(value)]
    return read if len(place.faults) == before else None


@dataclass(frozen=True)
class DirectionSamples(Kind):
    """Unit vectors, one a time."""

    wanted = "an array of unit vectors, one a time"

    def read(self, value: object, place: Place) -> np.ndarray | None:
        """(n, 3)."""
        read = _entries(Direction(), self.wanted, value, place)
        return None if read is None else np.array(read)

    def take(self, value: Any, place: Place) -> DirectionPath | None:
        """The path, of arrays."""
        times = read_array(value.times, "an array of numbers", place.key(TIMES.key), (None,))
        if times is None:
            return None
        vectors = f"an array of {len(times)} vectors of 3 numbers, one a time"
        shape = (len(times), 3)
        samples = read_array(value.samples, vectors, place.key(SAMPLES.key), shape)
        slopes = read_array(value.slopes, vectors, place.key("slopes"), shape)
        if samples is None or slopes is None:
            return None
        if len(times) > MOST_SAMPLES:
            place.key(SAMPLES.key).fault(f"must be {self.wanted}, 2 to {MOST_SAMPLES}", samples)
            return None
        at, seen = place.key(TIMES.key), place.key(SAMPLES.key)
        rising = rising_times(times, at)
        units = [Direction().checked(one, seen.item(i)) for i, one in enumerate(samples)]
        if rising is None or any(unit is None for unit in units):
            return None
        path = _through(rising, np.array(units), seen, samples)
        if path is None:
            return None
        off = (slopes - path.slopes) * np.gradient(times)[:, None]
        wrong = ~np.all(np.abs(off) <= _SLOPE_ROUNDING, axis=1)
        if np.any(wrong):
            i = int(np.argmax(wrong))
            complaint = "must be that of the spline; DirectionPath.through finds it"
            place.key("slopes").item(i).fault(complaint, slopes[i])
            return None
        return path

    def holds(self, value: Any) -> bool:
        """A direction that moves."""
        return isinstance(value, DirectionPath) and value.moves

    def write(self, value: Any) -> list[list[float]]:
        """A list of vectors."""
        return [Direction().write(sample) for sample in value.samples]


@dataclass(frozen=True)
class SampleTimes(Kind):
    """Seconds that rise, from the start of the manoeuvre or before it on."""

    wanted = "an array of rising numbers, the first at most 0"
    range = _TIME.range

    def read(self, value: object, place: Place) -> np.ndarray | None:
        """(n,)."""
        read = _entries(_TIME, self.wanted, value, place)
        return None if read is None else rising_times(np.array(read), place)

    def write(self, value: Any) -> list[float]:
        """A list."""
        return [float(time) for time in value]


def rising_times(times: np.ndarray, place: Place) -> np.ndarray | None:
    """Times of samples, or None after noting what is wrong with them."""
    if _TIME.checked_array(times, place) is None:
        return None
    falls = np.flatnonzero(np.diff(times) <= 0)
    if len(falls):
        at = int(falls[0]) + 1
        place.item(at).fault(f"must be later than the one before, {times[at - 1]:g}", float(times[at]))
    if not times[0] <= 0:
        place.item(0).fault("must be at most 0, where the manoeuvre starts", float(times[0]))
    return None if len(falls) or not times[0] <= 0 else times


def _through(times: np.ndarray, samples: np.ndarray, place: Place, told: object) -> DirectionPath | None:
    """The path through samples, or None after noting at their place that there is none."""
    try:
        return DirectionPath.through(times, samples)
    except ValueError as error:
        place.fault(str(error).removeprefix("samples: "), told)
        return None


SAMPLES = Field(
    "direction_samples",
    DirectionSamples(),
    "direction",
    "unit vectors over times_s, of an axis that moves",
    held="direction.samples",
)
TIMES = Field(
    "times_s",
    SampleTimes(),
    "times",
    "of direction_samples; 0 where the manoeuvre starts",
    held="direction.times",
)
# In the order of a table of their own.
PATH = Table(
    DirectionPath,
    (
        replace(SAMPLES, held="samples", required=True),
        replace(TIMES, held="times", required=True),
    ),
    split=lambda path: {"direction": path, "times": path.times},
)


def join_path(given: Mapping[str, Any], read: dict[str, Any], place: Place) -> None:
    """Make one path of the samples and times of a table, or note why they do not go together.

    Args:
        given: the table of the file.
        read: what could be read of it; its direction becomes the path, and its times are gone.
        place: where it stands.
    """
    times = read.pop("times", None)
    if TIMES.key in given and SAMPLES.key not in given:
        place.key(TIMES.key).fault(f"needs {SAMPLES.key}, whose times they are", given[TIMES.key])
    if SAMPLES.key not in given:
        return
    if TIMES.key not in given:
        place.key(TIMES.key).fault(f"missing, must be {TIMES.kind.wanted}")
    samples = read.get("direction")
    if times is None or not isinstance(samples, np.ndarray):
        return  # noted before
    if samples.shape != (len(times), 3):
        complaint = f"must have as many numbers as {SAMPLES.key}, {len(samples)}, not {len(times)}"
        place.key(TIMES.key).fault(complaint, given[TIMES.key])
        return
    read["direction"] = _through(times, samples, place.key(SAMPLES.key), given[SAMPLES.key])


def split_zone(zone: Any) -> dict[str, Any]:
    """What a zone holds, its times apart from its direction."""
    parts = dict(vars(zone))
    return parts | ({"times": zone.direction.times} if zone.moves else {})


@dataclass(frozen=True)
class Target(Direction):
    """A unit vector; a table of samples and times; or a name of ``[sky]``."""

    def read(self, value: object, place: Place) -> Any:
        """(3,), the path, or the name as it stands."""
        if isinstance(value, str):
            return value
        if not isinstance(value, dict):
            return super().read(value, place)
        before = len(place.faults)
        read = PATH.read(value, place) or {}
        if len(place.faults) == before:
            join_path(value, read, place)
        return read["direction"] if len(place.faults) == before else None

    def take(self, value: Any, place: Place) -> Any:
        """(3,), or the path."""
        kind = SAMPLES.kind if SAMPLES.kind.holds(value) else Direction()
        return kind.take(value, place)

    def write(self, value: Any) -> Any:
        """A list, or a table."""
        return PATH.write(value) if SAMPLES.kind.holds(value) else super().write(value)


@dataclass(frozen=True)
class TargetList(Each):
    """A target for each terminal."""

    of: Kind = field(default_factory=Target)

    def read(self, value: object, place: Place) -> Any:
        """(n, 3) where none moves, else a tuple of what each is."""
        read = self.entries(value, place)
        if read is None or any(isinstance(one, str | DirectionPath) for one in read):
            return None if read is None else tuple(read)
        return np.array(read).reshape(len(read), 3)

    def take(self, value: Any, place: Place) -> Any:
        """(n, 3) where none moves, else a tuple of what each is."""
        if not (isinstance(value, list | tuple) and any(map(SAMPLES.kind.holds, value))):
            still = isinstance(value, list | tuple) and any(isinstance(one, DirectionPath) for one in value)
            return super().take([as_path(one).samples[0] for one in value] if still else value, place)
        before, count = len(place.faults), self.count(place)
        if count not in (None, len(value)):
            place.refuse(f"must be {count} {self.wanted}, not {len(value)}", value)
        read = tuple(self.of.take(one, place.item(i)) for i, one in enumerate(value))
        return read if len(place.faults) == before else None
