"""Values in a scenario: what each must be, and how it is read, written, and taken from Python.

Numbers that Python gives for those of a scenario, or faults that say at which place they are none.

Type and shape are judged here; whether numbers are finite and in range is for the kinds to say, as of a file.

Kinds of single values in a scenario file: what each must be, and how it is read and written.

A kind reads a value of the file to the model's units, noting every fault at its `Place` and answering None
where there was one, and writes it back so that reading again gives the same bits. ``wanted`` completes
"must be ..." in messages and in the reference of the file. What Python gives for the model it takes in: lists
become arrays, and what has the wrong type or shape is a fault, as is what no file may hold.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from jaxplan.runtime.arguments import as_floats
from jaxplan.schema.faults import Place, quote, show


def read_array(
    value: object, wanted: str, place: Place, *shapes: tuple[int | None, ...]
) -> np.ndarray | None:
    """An array of float64, or None after noting why it is none.

    Args:
        value: of any type.
        wanted: what it must be, to stand after "must be".
        place: where it stands.
        shapes: of which it must have one, None where any number will do.
    """
    array = as_floats(value)
    if array is None:
        _blame(value, wanted, place, max(map(len, shapes)))
    elif any(_fits(array.shape, shape) for shape in shapes):
        return array
    else:
        size = f"of shape {array.shape}" if array.ndim else "a single number"
        place.refuse(f"must be {wanted}, not {size}", value)
    return None


def read_number(value: object, wanted: str, place: Place) -> float | None:
    """A number, or None after noting why it is none."""
    number = read_array(value, wanted, place, ())
    return None if number is None else float(number)


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(shape) == len(wanted) and all(m in (None, n) for n, m in zip(shape, wanted, strict=True))


def _blame(value: Any, wanted: str, place: Place, depth: int) -> None:
    """Note a fault at the first entry of nested lists that is no number, or where all are, at the whole.

    Args:
        value: of which numpy makes no array of numbers.
        wanted: what it must be.
        place: where it stands.
        depth: of the lists that were wanted.
    """
    entries = isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)
    for i, entry in enumerate(value if entries else ()):
        if as_floats(entry) is None:
            of = "an array of real numbers" if depth > 1 else "a real number"
            _blame(entry, of, place.item(i), depth - 1)
            return
    place.refuse(f"must be {wanted}", value)


class Kind(ABC):
    """What a value of the file may be."""

    @property
    @abstractmethod
    def wanted(self) -> str:
        """What the value must be, to stand after "must be"."""

    @property
    def range(self) -> str | None:
        """Where its numbers must lie, in the file's units; None where that is no matter."""
        return None

    @abstractmethod
    def read(self, value: object, place: Place) -> Any:
        """The value in the model's units, or None after noting its faults."""

    def take(self, value: Any, place: Place) -> Any:
        """The model's value of one that was given in Python, or None after noting its faults."""
        return value

    def may_miss(self, place: Place) -> bool:
        """Whether a required value may be left out of this file."""
        return False

    def build(self, value: Any) -> Any:
        """The part of the model that a value read without fault stands for."""
        return value

    def holds(self, value: Any) -> bool:
        """Whether the file says the model's value in this way, where there are several."""
        return True

    def write(self, value: Any) -> Any:
        """The value as the file holds it."""
        return value


class Interval:
    """A range of numbers as mathematics writes it, such as ``(0, 180]``; infinite ends are open."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.low, self.high = (float(end) for end in text[1:-1].split(","))
        self.open_low, self.open_high = text[0] == "(", text[-1] == ")"

    def __contains__(self, value: float) -> bool:
        above = value > self.low if self.open_low else value >= self.low
        below = value < self.high if self.open_high else value <= self.high
        return above and below

    def wanted(self, factor: float = 1.0) -> str:
        """The range, to stand after "must"; its ends times a factor."""
        low, high = self.low * factor, self.high * factor
        if math.isinf(high):
            return f"be {'greater than' if self.open_low else 'at least'} {low:g}"
        return f"lie in {self.text if factor == 1 else f'{self.text[0]}{low:g}, {high:g}{self.text[-1]}'}"


def either(options: Sequence[str]) -> str:
    """The options as words: ``a, b or c``."""
    return " or ".join([", ".join(options[:-1]), options[-1]] if len(options) > 1 else options)


def shortest_degrees(angle: float) -> float:
    """The degrees with the fewest digits that `math.radians` turns into exactly this angle.

    Not every number of radians has such degrees: there are fewer of these just below a power of two. Of one
    that has none, as may come from a computation but not from a file, these are the nearest.
    """
    close = math.degrees(angle)
    for digits in range(1, 18):
        rounded = float(f"{close:.{digits}g}")
        if math.radians(rounded) == angle:
            return rounded
    neighbours = [math.nextafter(close, end) for end in (-math.inf, math.inf)]
    return min([close, *neighbours], key=lambda degrees: abs(math.radians(degrees) - angle))


def filed_angle(angle: float) -> float:
    """The angle, rad, that is read where this one was written: but for a last bit in a few cases the same."""
    close = math.degrees(angle)
    return angle if math.radians(close) == angle else math.radians(shortest_degrees(angle))


@dataclass(frozen=True)
class Text(Kind):
    """A name or title: one line that prints, since it goes into tables and figures."""

    wanted = "a line of text"

    def read(self, value: object, place: Place) -> str | None:
        """The text itself."""
        if isinstance(value, str) and value.strip() and value.isprintable():
            return value
        blank = isinstance(value, str) and not value.strip()
        place.fault("must not be empty" if blank else f"must be {self.wanted}", value)
        return None

    def take(self, value: Any, place: Place) -> str | None:
        """The text itself."""
        if isinstance(value, str):
            return self.read(value, place)
        place.refuse(f"must be {self.wanted}", value)
        return None


@dataclass(frozen=True)
class Choice(Kind):
    """One of a few words or whole numbers.

    Attributes:
        options: there are.
    """

    options: Sequence[str | int]

    @property
    def wanted(self) -> str:
        """The options."""
        return either([show(option) for option in self.options])

    def read(self, value: object, place: Place) -> str | int | None:
        """The option itself."""
        for option in self.options:
            if type(value) is type(option) and value == option:
                return option
        place.fault(f"must be {self.wanted}", value)
        return None

    def take(self, value: Any, place: Place) -> str | int | None:
        """The option itself."""
        if isinstance(value, str | int):
            return self.read(value, place)
        place.refuse(f"must be {self.wanted}", value)
        return None


def finite(
    value: object, place: Place, wanted: str = "a number", interval: Interval | None = None
) -> float | None:
    """A number of the file as a float, or None after noting why it is none.

    Args:
        value: as the file holds it.
        place: where it stands.
        wanted: what it must be, where it is no number at all.
        interval: where it must lie, for the fault of one that is not finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        place.fault(f"must be {wanted}", value)
        return None
    try:
        number = float(value)
    except OverflowError:  # an integer beyond the range of floats
        number = math.inf
    if math.isfinite(number):
        return number
    place.fault(
        f"must be finite and {interval.wanted(place.factor)}" if interval else "must be finite", value
    )
    return None


@dataclass(frozen=True)
class Number(Kind):
    """A real number.

    Attributes:
        interval: where it must lie, in the file's units.
        degrees: whether the file's unit is made of degrees and the model's of radians.
        words: words that may stand in its place, and what the model holds for them; with "inf" among them
            the number may be infinite too.
    """

    interval: Interval | None = None
    degrees: bool = False
    words: Mapping[str, Any] = field(default_factory=dict)

    @property
    def range(self) -> str | None:
        """The interval."""
        return self.interval.text if self.interval else None

    @property
    def wanted(self) -> str:
        """A number, the words, and the range."""
        number = f"a number in {self.interval.text}" if self.interval else "a number"
        return either([number, *map(quote, self.words)])

    def read(self, value: object, place: Place) -> Any:
        """The number in radians and seconds, or what its word stands for."""
        if isinstance(value, str) and value in self.words:
            return self.words[value]
        if value == math.inf and "inf" in self.words:
            return self.words["inf"]
        number = finite(value, place, self.wanted, self.interval)
        if number is None:
            return None
        if self.interval and number not in self.interval:
            place.fault(f"must {self.interval.wanted(place.factor)}", value)
            return None
        converted = math.radians(number) if self.degrees else number
        if number and not converted:
            place.fault("too small to tell from zero", value)
            return None
        return converted

    def take(self, value: Any, place: Place) -> Any:
        """The number as a float, or what its word stands for."""
        if isinstance(value, str) and value in self.words:
            return self.words[value]
        if type(value) is not float:
            number = "a number, in radians" if self.degrees else "a number"
            value = read_number(value, either([number, *map(quote, self.words)]), place)
        return None if value is None else self.checked(value, place)

    def checked(self, number: float, place: Place) -> Any:
        """A number in the model's unit, as it is read where it was written; None after noting its faults."""
        low, high = self._bounds
        if low < number < high:
            return filed_angle(number) if self.degrees else number
        if number in self.words.values():
            return number
        if not math.isfinite(number):
            where = f" and {self.interval.wanted(place.factor)}" if self.interval else ""
            place.fault(f"must be finite{where}", number)
            return None
        if self.interval and (shortest_degrees(number) if self.degrees else number) not in self.interval:
            place.fault(f"must {self.interval.wanted(place.factor)}", number)
            return None
        return filed_angle(number) if self.degrees else number

    def checked_array(self, array: np.ndarray, place: Place) -> np.ndarray | None:
        """An array of numbers in the model's unit; None after noting the faults of each."""
        low, high = self._bounds
        if all(low < number < high for number in array.ravel().tolist()):
            return array
        before = len(place.faults)
        for index in np.ndindex(array.shape):
            here = place
            for i in index:
                here = here.item(i)
            self.checked(float(array[index]), here)
        return array if len(place.faults) == before else None

    @cached_property
    def _bounds(self) -> tuple[float, float]:
        """Between which a number of the model's is surely in range."""
        if self.interval is None:
            return -math.inf, math.inf
        low, high = self.interval.low, self.interval.high
        return (math.radians(low), math.radians(high)) if self.degrees else (low, high)

    def write(self, value: Any) -> float | str:
        """The number in the file's units, or its word."""
        for word, meaning in self.words.items():
            if isinstance(value, str) == isinstance(meaning, str) and value == meaning:
                return word
        return shortest_degrees(float(value)) if self.degrees else float(value)


@dataclass(frozen=True)
class Integer(Kind):
    """A whole number in an interval."""

    interval: Interval

    @property
    def range(self) -> str:
        """The interval."""
        return self.interval.text

    @property
    def wanted(self) -> str:
        """An integer, and the range."""
        return f"an integer in {self.interval.text}"

    def read(self, value: object, place: Place) -> int | None:
        """The number itself."""
        if isinstance(value, bool) or not isinstance(value, int):
            place.fault(f"must be {self.wanted}", value)
        elif value not in self.interval:
            place.fault(f"must {self.interval.wanted()}", value)
        else:
            return value
        return None

    def take(self, value: Any, place: Place) -> int | None:
        """The number as Python's own."""
        if isinstance(value, int | np.integer) and not isinstance(value, bool):
            return self.read(int(value), place)
        place.refuse(f"must be {self.wanted}", value)
        return None

    def write(self, value: Any) -> int:
        """The number itself."""
        return int(value)


@dataclass(frozen=True)
class YesNo(Kind):
    """True or false."""

    wanted = "true or false"

    def read(self, value: object, place: Place) -> bool | None:
        """The value itself."""
        if isinstance(value, bool):
            return value
        place.fault(f"must be {self.wanted}", value)
        return None
