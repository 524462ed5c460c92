"""Kinds of values that plan files have and scenario files have not: large arrays, and what may be null.

Of an array the first fault alone is noted, since a damaged one has thousands.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan.schema.faults import Place, nearest
from jaxplan.schema.kinds import Integer, Interval, Kind, Number

# Beyond any angle, rate or coefficient of a manoeuvre, and small enough for what is computed from them.
SANE = Interval("[-1e6, 1e6]")
_TIME = Interval("[0, 1e12]")
# Of a rotation matrix; the certificate, which is not for reading files, is stricter.
ORTHONORMAL = 1e-6
# The shortest an axis may be, if not zero.
_SHORTEST = {"pieces": 1, "terms": 1, "joint pieces": 1, "joint terms": 1}


@dataclass(frozen=True)
class Array(Kind):
    """Numbers in an array, or in arrays of arrays.

    Attributes:
        sizes: lengths by their names, which the arrays of a file share; those that are not yet known are
            set by the first array that has them.
        shape: the length of each axis: a number, a name, or a name and what is added, as "edges + 1".
        interval: where each number must lie.
        whole: whether they are integers.
    """

    sizes: dict[str, int]
    shape: tuple[int | str, ...]
    interval: Interval = SANE
    whole: bool = False

    @property
    def wanted(self) -> str:
        """How many numbers."""
        return f"{' x '.join(str(axis) for axis in self.shape)} numbers"

    def read(self, value: object, place: Place) -> np.ndarray | None:
        """Of the shape."""
        numbers = self._numbers(value, self.shape, place)
        if numbers is None:
            return None
        lengths = [self._length(axis, 0) for axis in self.shape]
        array = np.array(numbers, dtype=int if self.whole else float).reshape(lengths)
        fault = self.first_fault(array)
        if fault is None:
            return array
        index, complaint = fault
        for i in index:
            value, place = value[i], place.item(i)  # type: ignore[index]
        place.fault(complaint, value)
        return None

    def first_fault(self, array: np.ndarray) -> tuple[tuple[int, ...], str] | None:
        """Where numbers that are well by themselves are wrong together, and what they must be."""
        return None

    def _length(self, axis: int | str, given: int) -> int:
        """How long an axis must be; one that is not known yet is as long as the one that is given."""
        if isinstance(axis, int):
            return axis
        name, _, more = axis.partition(" + ")
        extra = int(more or 0)
        return self.sizes.setdefault(name, max(given - extra, _SHORTEST.get(name, 0))) + extra

    def _numbers(self, value: object, shape: tuple[int | str, ...], place: Place) -> Any:
        """The numbers in nested lists, or None after noting the first fault."""
        if not shape:
            kind = Integer(self.interval) if self.whole else Number(self.interval)
            return kind.read(value, place)
        if not isinstance(value, list):
            place.fault(f"must be an array of {'numbers' if len(shape) == 1 else 'arrays'}", value)
            return None
        length = self._length(shape[0], len(value))
        if len(value) != length:
            place.fault(
                f"must have {length} {'entry' if length == 1 else 'entries'}, not {len(value)}", value
            )
            return None
        numbers = []
        for i, entry in enumerate(value):
            if type(entry) is float and len(shape) == 1 and not self.whole and entry in self.interval:
                number: Any = entry  # the common case, quickly
            else:
                number = self._numbers(entry, shape[1:], place.item(i))
            if number is None:
                return None
            numbers.append(number)
        return numbers


@dataclass(frozen=True)
class Rotations(Array):
    """Rotation matrices, in the last two axes."""

    def first_fault(self, array: np.ndarray) -> tuple[tuple[int, ...], str] | None:
        """The first matrix that is none."""
        gram = np.swapaxes(array, -1, -2) @ array
        good = np.all(np.abs(gram - np.eye(3)) <= ORTHONORMAL, axis=(-1, -2)) & (np.linalg.det(array) > 0)
        if np.all(good):
            return None
        index = tuple(int(i) for i in np.argwhere(~good)[0])
        return index, f"must be a rotation matrix, to {ORTHONORMAL:g}"


@dataclass(frozen=True)
class Times(Array):
    """Seconds that do not fall."""

    interval: Interval = _TIME

    def first_fault(self, array: np.ndarray) -> tuple[tuple[int, ...], str] | None:
        """The first that falls."""
        falls = np.flatnonzero(np.diff(array) < 0)
        return (
            None if len(falls) == 0 else ((int(falls[0]) + 1,), "must not be before the one in front of it")
        )


@dataclass(frozen=True)
class Nullable(Kind):
    """A value, or null for none; None, which it is read to, leaves it to the model's default."""

    of: Kind

    @property
    def wanted(self) -> str:
        """What, or null."""
        return f"{self.of.wanted} or null"

    def read(self, value: object, place: Place) -> Any:
        """The value."""
        return None if value is None else self.of.read(value, place)

    def build(self, value: Any) -> Any:
        """The part of the model that the value stands for."""
        return self.of.build(value)


@dataclass(frozen=True)
class Known(Kind):
    """A name that the scenario has.

    Attributes:
        what: it names.
        names: that there are.
    """

    what: str
    names: tuple[str, ...]

    @property
    def wanted(self) -> str:
        """What it names."""
        return f"the name of a {self.what}"

    def read(self, value: object, place: Place) -> str | None:
        """The name itself."""
        if isinstance(value, str) and value in self.names:
            return value
        if isinstance(value, str):
            place.fault(f"no such {self.what}, {nearest(value, self.names, f'{self.what}s')}", value)
        else:
            place.fault(f"must be {self.wanted}", value)
        return None


@dataclass(frozen=True)
class Tables(Kind):
    """A table that somebody else reads."""

    wanted = "a table"

    def read(self, value: object, place: Place) -> dict[str, Any] | None:
        """The table itself."""
        if isinstance(value, dict):
            return value
        place.fault(f"must be {self.wanted}", value)
        return None


@dataclass(frozen=True)
class Words(Kind):
    """Text that prints, or none at all."""

    wanted = "text"

    def read(self, value: object, place: Place) -> str | None:
        """The text itself."""
        if isinstance(value, str) and value.isprintable():
            return value
        place.fault(f"must be {self.wanted}{' that prints' * isinstance(value, str)}", value)
        return None


@dataclass(frozen=True)
class Lines(Kind):
    """Any number of texts."""

    wanted = "an array of texts"

    def read(self, value: object, place: Place) -> tuple[str, ...] | None:
        """The texts."""
        if not isinstance(value, list):
            place.fault(f"must be {self.wanted}", value)
            return None
        read = [Words().read(line, place.item(i)) for i, line in enumerate(value)]
        return None if None in read else tuple(line for line in read if line is not None)


@dataclass(frozen=True)
class ByName(Kind):
    """A number for each of some names."""

    of: Number

    wanted = "a table of numbers"

    def read(self, value: object, place: Place) -> dict[str, float] | None:
        """The numbers by name."""
        if not isinstance(value, dict):
            place.fault(f"must be {self.wanted}", value)
            return None
        read = {name: self.of.read(number, place.key(name)) for name, number in value.items()}
        return None if None in read.values() else read
