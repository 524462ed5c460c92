"""Kinds of arrays in a file: numbers in any shape, and conditions on all of them together.

A *rule* (`Rule`) is a function of an array, what it was read from and its place. It checks the array, notes
faults, and returns it as the model has it, or `WRONG`. Directions and quaternions whose length is within
`UNIT_TOLERANCE` of one, as published ones with four digits are, are scaled to unit length without a message.
Others are refused, since an error in the file is more likely.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan.geometry import quaternion
from jaxplan.model import outlines
from jaxplan.runtime.arguments import as_floats
from jaxplan.schema.faults import WRONG, Place, Reading
from jaxplan.schema.value_kinds import NUMBER, Kind, Number

UNIT_TOLERANCE = 1e-3  # by which the length of a unit vector may differ from one
_UNIT_TOLERANCE = 8 * np.finfo(float).eps  # by which a vector's length may differ from one and keep its bits
_TURN_TOLERANCE = 1e-9  # share of a turn by which a rotation vector may be longer, for rounding
# By which entries of R^T R may differ from the identity; the certificate is stricter.
ORTHONORMAL = 1e-6
# Least and greatest length of an axis, by its name, where the first array that has it sets the length.
LENGTHS = {"sample": (2, 100_000)} | dict.fromkeys(
    ("pieces", "terms", "joint pieces", "joint terms"), (1, math.inf)
)
_MOST_FAULTS = 20  # faults of one array that are noted; a damaged one has thousands

Rule = Callable[[np.ndarray, Any, Place], Any]
"""Function of an array, what it was read from and its place: checks it and returns it as the model has it.

It returns `WRONG` after noting faults.
"""


@dataclass(frozen=True)
class Array(Kind):
    """Numbers in an array, or in arrays of arrays.

    Attributes:
        shape: the length of each axis: a number, a name, or a name and what is added, as "edges + 1". A name
            has the same length in all arrays that are read together (`Reading.sizes`).
        of: kind of each number.
        noun: what they are, for messages, in the plural, such as "numbers, one a terminal"; with an article
            ("a unit vector ...") it describes the whole array.
        hint: advice in messages on arrays from Python.
        rule: checks and converts the whole array; None for no rule.
        zero: whether an array that is left out means zeros.
    """

    shape: tuple[int | str, ...]
    of: Number = NUMBER
    noun: str = ""
    hint: str = ""
    rule: Rule | None = None
    zero: bool = False

    @property
    def range(self) -> str | None:
        return self.of.range

    @property
    def wanted(self) -> str:
        count = f"{self.shape[0]} " if isinstance(self.shape[0], int) else ""
        return self.noun or f"{count}{'numbers' if len(self.shape) == 1 else 'arrays'}"

    def absent(self, reading: Reading) -> Any:
        if not self.zero:
            return None
        lengths = [_known_length(axis, reading) for axis in self.shape]
        return WRONG if None in lengths else np.zeros(lengths)  # why the length is not known was noted before

    def may_miss(self, reading: Reading) -> bool:
        axis = self.shape[0]
        return isinstance(axis, str) and axis in reading.sizes and not reading.sizes[axis]

    def read(self, value: Any, place: Place) -> Any:
        reading = place.reading
        array = as_floats(value) if reading.python or _is_numeric(value) else None
        if array is None:
            return self._refuse_malformed(value, place)
        if array.shape == (0,) and len(self.shape) == 2:  # no rows
            array = array.reshape(0, _known_length(self.shape[1], reading) or 0)
        if array.ndim != len(self.shape):
            size = f", not of shape {array.shape}" if array.ndim else ""
            return place.refuse(f"must be {self._describe_wanted(reading)}{size}", value)
        lengths = [self._required_length(i, size, reading) for i, size in enumerate(array.shape)]
        if lengths != list(array.shape):
            size = f"shape {array.shape}" if len(array) == lengths[0] else f"{len(array)}"
            return place.refuse(f"must be {self._describe_wanted(reading)}, not of {size}", value)
        outside = [i for i, number in enumerate(array.ravel().tolist()) if number not in self.of.interval]
        for i in outside[:_MOST_FAULTS]:
            index = np.unravel_index(i, array.shape)
            self.of.read(float(array[index]), _place_of_entry(place, index))
        if outside:
            return WRONG
        if self.of.degrees and not reading.python:
            array = np.radians(array)
        return array if self.rule is None else self.rule(array, value, place)

    def write(self, value: Any) -> Any:
        array = np.asarray(value, float)
        if not self.of.degrees:
            return array.tolist()
        return np.reshape([self.of.write(number) for number in array.ravel().tolist()], array.shape).tolist()

    def _required_length(self, number: int, size: int, reading: Reading) -> int:
        """Return the length that an axis, given by its number, must have.

        A name of an axis that is not known yet gets the array's length, `size`.
        """
        axis = self.shape[number]
        if isinstance(axis, str) and axis not in reading.sizes:
            name, _, more = axis.partition(" + ")
            low, high = LENGTHS.get(name, (0, math.inf))
            reading.sizes.setdefault(name, int(min(max(size - int(more or 0), low), high)))
        known = _known_length(axis, reading)
        return size if known is None else known

    def _describe_wanted(self, reading: Reading, depth: int = 0) -> str:
        """Return what the array must be, for messages, with its length if that is known.

        With a `depth` it is that of the arrays so many axes down.
        """
        count = _known_length(self.shape[depth], reading)
        text = self.noun if not depth else ""
        if text.startswith("a "):
            return f"{text}{self.hint}" if reading.python else text
        if not text:
            text = "numbers" if depth == len(self.shape) - 1 else "arrays"
        if count == 1:
            first, comma, rest = text.partition(",")
            text = f"{first.removesuffix('s')}{comma}{rest}"
        counted = "" if count is None or text[0].isdigit() else f"{count} "
        return f"an array of {counted}{text}{self.hint if reading.python else ''}"

    def _refuse_malformed(self, value: Any, place: Place) -> Any:
        """Note where something that is no number stands, or lists have a wrong length; returns `WRONG`."""
        faults = place.reading.faults
        before = len(faults)
        self._note_faults(value, 0, place, before + _MOST_FAULTS)
        if len(faults) == before:
            place.refuse(f"must be {self._describe_wanted(place.reading)}", value)
        return WRONG

    def _note_faults(self, value: Any, depth: int, place: Place, most: int) -> None:
        """Note faults of nested lists that are `depth` axes down, until there are `most` faults in all."""
        if depth == len(self.shape):
            self.of.read(value, place)
            return
        wanted = self._describe_wanted(place.reading, depth)
        if not isinstance(value, list | tuple) and not (isinstance(value, np.ndarray) and value.ndim):
            place.refuse(f"must be {wanted}", value)
            return
        if len(value) != self._required_length(depth, len(value), place.reading):
            place.refuse(f"must be {wanted}, not of {len(value)}", value)
        for i, entry in enumerate(value):
            if len(place.reading.faults) < most:
                self._note_faults(entry, depth + 1, place[i], most)


@dataclass(frozen=True)
class PerAxis(Kind):
    """One number for all body axes, or three numbers; the model keeps the form in which it was given.

    Attributes:
        of: kind of each number.
    """

    of: Number

    @property
    def range(self) -> str | None:
        return self.of.range

    @property
    def wanted(self) -> str:
        return f"{self.of.wanted}{_OR_THREE}"

    def read(self, value: Any, place: Place) -> Any:
        array = as_floats(value) if place.reading.python else None
        if isinstance(value, list | tuple) or (array is not None and array.ndim):
            return self._read_three(value, place)
        if array is None and not isinstance(value, int | float):
            return place.refuse(f"must be {self.of.asked(place)}{_OR_THREE}", value)
        return self.of.read(value, place)

    def _read_three(self, value: Any, place: Place) -> Any:
        """Read three numbers to an array (3,), or to `WRONG`."""
        if len(value) != 3:
            return place.refuse(f"must be {self.of.asked(place)}{_OR_THREE}, not {len(value)}", value)
        read = [self.of.read(number, place[i]) for i, number in enumerate(value)]
        return WRONG if WRONG in read else np.array(read)

    def write(self, value: Any) -> Any:
        numbers = np.asarray(value, float).tolist()
        return (
            [self.of.write(number) for number in numbers]
            if isinstance(numbers, list)
            else self.of.write(numbers)
        )


@dataclass(frozen=True)
class Numbers(Kind):
    """An array of a fixed count of numbers.

    Attributes:
        count: how many there must be.
        of: kind of each number.
    """

    count: int
    of: Number

    @property
    def range(self) -> str | None:
        return self.of.range

    @property
    def wanted(self) -> str:
        return f"{self.count} numbers"

    def read(self, value: Any, place: Place) -> Any:
        array = as_floats(value) if place.reading.python or isinstance(value, list) else None
        listed = isinstance(value, list | tuple) or (array is not None and array.ndim == 1)
        if not listed or len(value) != self.count:
            size = f", not {len(value)}" if listed else ""
            return place.refuse(f"must be an array of {self.wanted}{size}", value)
        read = [self.of.read(number, place[i]) for i, number in enumerate(value)]
        if WRONG in read:
            return WRONG
        same = isinstance(value, np.ndarray) and value.dtype == float and value.tolist() == read
        return value if same else np.array(read)

    def write(self, value: Any) -> list[Any]:
        return [self.of.write(number) for number in np.asarray(value, float).tolist()]


@dataclass(frozen=True)
class Polygons(Kind):
    """Convex polygons, each an array of corners [yaw, pitch].

    Attributes:
        of: kind of each coordinate.
    """

    of: Number
    wanted = "an array of polygons, each of 3 corners [yaw, pitch] or more"

    @property
    def range(self) -> str | None:
        return self.of.range

    def read(self, value: Any, place: Place) -> Any:
        if not isinstance(value, list | tuple):
            return place.refuse(f"must be {self.wanted}", value)
        if len(value) >= 3 and all(_is_corner(one) for one in value):
            return place.refuse(
                f"must be {self.wanted}; of one polygon too, within brackets of its own", value
            )
        read = tuple(self._read_polygon(polygon, place[i]) for i, polygon in enumerate(value))
        same = isinstance(value, tuple) and all(one is given for one, given in zip(read, value, strict=True))
        return WRONG if any(one is WRONG for one in read) else value if same else read

    def _read_polygon(self, value: Any, place: Place) -> Any:
        """Read one polygon to an array (k, 2) of corners, or to `WRONG`."""
        given = as_floats(value) if place.reading.python else None
        listed = value if given is None else given
        if not isinstance(listed, list | tuple | np.ndarray) or not np.ndim(np.asarray(listed, object)):
            return place.refuse("must be an array of corners [yaw, pitch]", value)
        corners = [Numbers(2, self.of).read(corner, place[i]) for i, corner in enumerate(listed)]
        if any(corner is WRONG for corner in corners):
            return WRONG
        array = np.array(corners).reshape(-1, 2)
        complaint = outlines.fault(array)
        if complaint is not None:
            return place.fault(f"must {complaint}", shown_value(np.asarray(value, float), value, place))
        same = isinstance(value, np.ndarray) and value.dtype == float and np.array_equal(value, array)
        return value if same else array

    def write(self, value: Any) -> list[Any]:
        return [[Numbers(2, self.of).write(corner) for corner in polygon] for polygon in value]


def _is_corner(value: Any) -> bool:
    """Tell whether a value is two numbers, a corner where a polygon should stand."""
    return (
        isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(n, int | float) for n in value)
    )


_OR_THREE = ", or 3, one a body axis"


def _known_length(axis: int | str, reading: Reading) -> int | None:
    """Return the length that an axis of an `Array` must have; None if it may have any."""
    if isinstance(axis, int) or axis in reading.sizes:
        return axis if isinstance(axis, int) else reading.sizes[axis]
    name, _, more = axis.partition(" + ")
    known = reading.sizes.get(name)
    return None if known is None else known + int(more or 0)


def _is_numeric(value: Any) -> bool:
    """Tell whether a value of a file is a number, or nested lists of numbers."""
    if type(value) is list:
        return all(type(entry) is float or _is_numeric(entry) for entry in value)
    return type(value) is float or type(value) is int


def _place_of_entry(place: Place, index: Any) -> Place:
    """Return the place of an array's entry, given its indices."""
    for i in index:
        place = place[int(i)]
    return place


def shown_value(array: np.ndarray, value: Any, place: Place) -> Any:
    """Return what messages show of an array: its numbers if it comes from Python, else the file's value."""
    return array.tolist() if place.reading.python else value


def unit(vector: np.ndarray, value: Any, place: Place, what: str = "a unit vector") -> Any:
    """Check that a vector (n,) has unit length to `UNIT_TOLERANCE`, and scale it to length one; a `Rule`.

    One that has unit length to rounding keeps its bits, so that it is written back as it was.
    """
    norm = math.hypot(*vector.tolist())
    if norm == 0:
        return place.fault(f"must be {what}, not zero", shown_value(vector, value, place))
    if abs(norm - 1) > UNIT_TOLERANCE:
        return place.fault(f"must be {what}, its norm is {norm:.6g}", shown_value(vector, value, place))
    return vector if abs(norm - 1) <= _UNIT_TOLERANCE else vector / norm


def units(vectors: np.ndarray, value: Any, place: Place) -> Any:
    """Check that vectors (k, n) have unit length, and scale them to length one; a `Rule`."""
    told = shown_value(vectors, value, place)
    read = [unit(vector, told[i], place[i]) for i, vector in enumerate(vectors)]
    return WRONG if any(vector is WRONG for vector in read) else np.array(read)


def rotation_vector(numbers: np.ndarray, value: Any, place: Place) -> Any:
    """Check a unit quaternion w x y z (scalar first), and convert it to a rotation vector (3,); a `Rule`.

    The rotation vector, rad, is at most half a turn long.
    """
    read = unit(numbers, value, place, "a unit quaternion in the order w x y z")
    return WRONG if read is WRONG else np.asarray(quaternion.log(-read if read[0] < 0 else read))


def within_a_turn(vector: np.ndarray, value: Any, place: Place) -> Any:
    """Check that a rotation vector (3,) rad is at most a turn long; a `Rule`.

    It is longer if it was given in degrees by mistake.
    """
    size = float(np.linalg.norm(vector))
    if size <= 2 * np.pi * (1 + _TURN_TOLERANCE):
        return vector
    return place.fault(
        f"is {size:.4g} rad long, must be at most a turn, 6.28319 rad: rotation vectors are not in deg",
        shown_value(vector, value, place),
    )


def rotations(matrices: np.ndarray, value: Any, place: Place) -> Any:
    """Check that the last two axes hold rotation matrices; notes the first that is none; a `Rule`."""
    gram = np.swapaxes(matrices, -1, -2) @ matrices
    good = np.all(np.abs(gram - np.eye(3)) <= ORTHONORMAL, axis=(-1, -2)) & (np.linalg.det(matrices) > 0)
    if np.all(good):
        return matrices
    index = np.argwhere(~good)[0]
    return _place_of_entry(place, index).fault(
        f"must be a rotation matrix, to {ORTHONORMAL:g}", matrices[tuple(index)].tolist()
    )


def not_falling(times: np.ndarray, value: Any, place: Place) -> Any:
    """Check that times (k,) never decrease; a `Rule`."""
    falls = np.flatnonzero(np.diff(times) < 0)
    if not len(falls):
        return times
    at = int(falls[0]) + 1
    return place[at].fault("must not be before the one in front of it", float(times[at]))


def rising(times: np.ndarray, value: Any, place: Place) -> Any:
    """Check that times (k,) s rise strictly, the first being at most 0, the manoeuvre's start; a `Rule`."""
    falls = np.flatnonzero(np.diff(times) <= 0)
    if len(falls):
        at = int(falls[0]) + 1
        place[at].fault(f"must be later than the one before, {times[at - 1]:g}", float(times[at]))
    if times[0] > 0:
        place[0].fault("must be at most 0, where the manoeuvre starts", float(times[0]))
    return WRONG if len(falls) or times[0] > 0 else times


def range_of(ends: np.ndarray, value: Any, place: Place) -> Any:
    """Check that the first end of a range (2,) is below the second; a `Rule`."""
    if ends[0] < ends[1]:
        return ends
    return place.fault("must be two numbers, the first below the second", shown_value(ends, value, place))


DIRECTION = Array((3,), noun="a unit vector of 3 numbers", rule=unit)
PLANE_DIRECTION = Array((2,), noun="a unit vector of 2 numbers", rule=unit)
QUATERNION = Array((4,), noun="a unit quaternion of 4 numbers, w x y z", rule=rotation_vector)


def each_terminal(of: Number) -> Array:
    """Return the kind of an array with one number for each terminal."""
    return Array(("terminal",), of, noun="numbers, one a terminal")


def each_drive(of: Number) -> Array:
    """Return the kind of an array with one number for each drive."""
    return Array(("drive",), of, noun="numbers, one a drive")


def each_joint(of: Number, *, zero: bool = False) -> Array:
    """Return the kind of an array with one number for each joint; if `zero`, it may be left out for zeros."""
    return Array(("joint",), of, noun="numbers, one a joint, all yaws, all pitches, all drives", zero=zero)
