"""Kinds of arrays in a scenario file: vectors, directions and inertia.

Directions and quaternions are brought to unit length silently when they are within `UNIT_TOLERANCE` of it,
as published ones with four digits are, and refused beyond, where an error of the file is more likely.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jaxplan.geometry import quaternion
from jaxplan.model.directions import DirectionPath
from jaxplan.schema.faults import Place
from jaxplan.schema.kinds import Interval, Kind, Number, finite, read_array

UNIT_TOLERANCE = 1e-3

_POSITIVE = Number(Interval("[1e-12, 1e12]"))
_ANY = Number()
_MOMENT = Number(Interval("[-1e12, 1e12]"))


def _read_entries(
    kind: Kind, count: int | None, wanted: str, value: object, place: Place
) -> list[Any] | None:
    """All entries of an array, read by one kind; None after noting what is wrong with them or their number.

    Args:
        kind: of each entry.
        count: how many there must be, None for any number.
        wanted: what they must be, for the message.
        value: the array, as the file holds it.
        place: where it stands.
    """
    if count == 1:  # one number, one direction
        wanted = wanted.replace("s, ", ", ", 1)
    array = f"must be an array of {wanted if count is None else f'{count} {wanted}'}"
    if not isinstance(value, list):
        place.fault(array, value)
        return None
    before = len(place.faults)
    if count is not None and len(value) != count:
        place.fault(f"{array}, not of {len(value)}", value)
    read = [kind.read(entry, place.item(i)) for i, entry in enumerate(value)]
    return read if len(place.faults) == before else None


@dataclass(frozen=True)
class Vector(Kind):
    """A fixed number of numbers, of a kind."""

    length: int
    of: Number = field(default_factory=Number)

    @property
    def range(self) -> str | None:
        """That of each."""
        return self.of.range

    @property
    def wanted(self) -> str:
        """How many."""
        return f"{self.length} numbers"

    def read(self, value: object, place: Place) -> np.ndarray | None:
        """(length,)."""
        read = _read_entries(self.of, self.length, "numbers", value, place)
        return None if read is None else np.array(read)

    def take(self, value: Any, place: Place) -> np.ndarray | None:
        """(length,)."""
        read = read_array(value, f"an array of {self.wanted}", place, (self.length,))
        return None if read is None else self.of.checked_array(read, place)

    def write(self, value: Any) -> list[float]:
        """A list."""
        return [float(number) for number in value]


@dataclass(frozen=True)
class Each(Kind):
    """One value each for all terminals, or for all joints.

    Attributes:
        of: kind of the values.
        per: "terminal" or "joint".
    """

    of: Kind
    per: str = "terminal"

    @property
    def range(self) -> str | None:
        """That of each."""
        return self.of.range

    @property
    def wanted(self) -> str:
        """What, and in which order."""
        noun = "directions" if isinstance(self.of, Direction) else "numbers"
        order = ", all yaws and then all pitches" if self.per == "joint" else ""
        return f"{noun}, one a {self.per}{order}"

    def entries(self, value: object, place: Place) -> list[Any] | None:
        """The values, each by itself; of any number where the file's terminals cannot be told."""
        return _read_entries(self.of, self.count(place), self.wanted, value, place)

    def count(self, place: Place) -> int | None:
        """How many there must be; None where the terminals cannot be told."""
        terminals = place.devices.terminals
        return None if terminals is None else len(terminals) * (2 if self.per == "joint" else 1)

    def read(self, value: object, place: Place) -> np.ndarray | None:
        """(count, ...)."""
        read = self.entries(value, place)
        if read is None:
            return None
        return np.array(read).reshape(len(read), *([3] if isinstance(self.of, Direction) else []))

    def take(self, value: Any, place: Place) -> Any:
        """(count, ...)."""
        count, each = self.count(place), (3,) if isinstance(self.of, Direction) else ()
        wanted = self.wanted if count is None else f"{count} {self.wanted}"
        wanted += ", in rows of 3 numbers" if each else ""
        none = [(0,)] if not count else []  # as an empty list has it
        read = read_array(value, f"an array of {wanted}", place, (count, *each), *none)
        if read is None:
            return None
        if isinstance(self.of, Number):
            return self.of.checked_array(read.reshape(len(read)), place)
        assert isinstance(self.of, Direction)
        rows = [self.of.checked(row, place.item(i)) for i, row in enumerate(read.reshape(len(read), 3))]
        return None if any(row is None for row in rows) else np.array(rows).reshape(len(rows), 3)

    def may_miss(self, place: Place) -> bool:
        """Without terminals there is nothing to say."""
        return not place.devices.terminals

    def write(self, value: Any) -> list[Any]:
        """A list."""
        return [self.of.write(entry) for entry in value]


def _unit(vector: np.ndarray, value: object, what: str, place: Place) -> np.ndarray | None:
    """The vector at unit length; one that has it to rounding keeps its bits, to be written back as it was."""
    norm = math.hypot(*vector.tolist())
    if norm == 0:
        place.fault(f"must be {what}, not zero", value)
    elif abs(norm - 1) > UNIT_TOLERANCE:
        place.fault(f"must be {what}, its norm is {norm:.6g}", value)
    else:
        return vector if abs(norm - 1) <= 8 * np.finfo(float).eps else vector / norm
    return None


@dataclass(frozen=True)
class Direction(Kind):
    """A unit vector, of three numbers unless told."""

    length: int = 3

    @property
    def wanted(self) -> str:
        """How many numbers."""
        return f"a unit vector of {self.length} numbers"

    def read(self, value: object, place: Place) -> np.ndarray | None:
        """(length,)."""
        vector = Vector(self.length).read(value, place)
        return None if vector is None else _unit(vector, value, "a unit vector", place)

    def take(self, value: Any, place: Place) -> Any:
        """(length,); of a path that stands still, where it is."""
        moving = isinstance(value, DirectionPath) and value.moves
        if moving:
            place.refuse(f"must be {self.wanted}, not a direction that moves", value)
            return None
        given = value.samples[0] if isinstance(value, DirectionPath) else value
        vector = read_array(given, self.wanted, place, (self.length,))
        return None if vector is None else self.checked(vector, place)

    def checked(self, vector: np.ndarray, place: Place) -> np.ndarray | None:
        """The vector at unit length, or None after noting its faults."""
        if _ANY.checked_array(vector, place) is None:
            return None
        return _unit(vector, vector.tolist(), "a unit vector", place)

    def holds(self, value: Any) -> bool:
        """A direction, and none that moves."""
        return not isinstance(value, DirectionPath) or not value.moves

    def write(self, value: Any) -> list[float]:
        """A list."""
        return Vector(self.length).write(value)


@dataclass(frozen=True)
class Quaternion(Kind):
    """A unit quaternion, which the model holds as a rotation vector of at most half a turn."""

    wanted = "a unit quaternion of 4 numbers, w x y z"

    def read(self, value: object, place: Place) -> np.ndarray | None:
        """(3,) rad."""
        vector = Vector(4).read(value, place)
        what = "a unit quaternion in the order w x y z"
        unit = None if vector is None else _unit(vector, value, what, place)
        if unit is None:
            return None
        return np.asarray(quaternion.log(-unit if unit[0] < 0 else unit))


@dataclass(frozen=True)
class PerAxis(Kind):
    """A positive number for all body axes, or three."""

    wanted = "a number, or 3 numbers, one a body axis"
    of = _POSITIVE
    range = _POSITIVE.range

    def read(self, value: object, place: Place) -> np.ndarray | None:
        """(3,)."""
        if isinstance(value, list):
            read = _read_entries(_POSITIVE, 3, "numbers, one a body axis", value, place)
            return None if read is None else np.array(read)
        if finite(value, place, self.wanted, _POSITIVE.interval) is None:
            return None
        number = _POSITIVE.read(value, place)
        return None if number is None else np.full(3, number)

    def take(self, value: Any, place: Place) -> np.ndarray | None:
        """(3,)."""
        read = read_array(value, self.wanted, place, (), (3,))
        if read is None:
            return None
        numbers = np.full(3, read)
        if len(set(map(repr, numbers))) > 1:
            return self.of.checked_array(numbers, place)
        return None if self.of.checked(float(numbers[0]), place) is None else numbers

    def write(self, value: Any) -> float | list[float]:
        """One number where all three are the same."""
        numbers = Vector(3).write(value)
        return numbers[0] if len(set(map(repr, numbers))) == 1 else numbers  # NaN does not equal NaN


@dataclass(frozen=True)
class Inertia(Kind):
    """A matrix of inertia that a body can have."""

    wanted = "3 rows of 3 numbers"
    range = _MOMENT.range

    def read(self, value: object, place: Place) -> np.ndarray | None:
        """(3, 3)."""
        rows = _read_entries(Vector(3, _MOMENT), 3, "rows of 3 numbers", value, place)
        if rows is None:
            return None
        return self._checked(np.array(rows), value, place)

    def _checked(self, matrix: np.ndarray, value: object, place: Place) -> np.ndarray | None:
        """The matrix, or None after noting why no body has it."""
        scaled = matrix / (np.max(np.abs(matrix)) or 1)  # so that the thresholds below are relative
        small, middle, large = np.linalg.eigvalsh((scaled + scaled.T) / 2)
        if np.max(np.abs(scaled - scaled.T)) > 1e-9:
            place.fault("must be symmetric", value)
        elif small <= 1e-12:  # rounding may leave a singular one slightly positive
            place.fault("must be positive definite", value)
        elif np.max(matrix) < 1e-12:
            place.fault("must have its largest moment in [1e-12, 1e12]", value)
        elif large > (small + middle) * (1 + 1e-9):
            place.fault("must have no principal moment above the sum of the other two, as no body has", value)
        else:
            return matrix
        return None

    def take(self, value: Any, place: Place) -> np.ndarray | None:
        """(3, 3)."""
        read = read_array(value, f"{self.wanted}; np.diag makes them of principal moments", place, (3, 3))
        if read is None or _MOMENT.checked_array(read, place) is None:
            return None
        return self._checked(read, read.tolist(), place)

    def write(self, value: Any) -> list[list[float]]:
        """A list of rows."""
        return [Vector(3).write(row) for row in value]
