"""Kinds of single values in a file: what each must be, and how it is read and written.

A kind converts a value to the model's units, notes every fault at its `Place`, and returns `WRONG` if there
was one. It reads what a file holds, and also what Python gives for the same attribute: there any type that
numpy takes for real numbers will do, angles are in radians, and the result has the bits that a file would
give back. ``wanted`` completes "must be ..." in messages and in the reference of the file.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from functools import cached_property
from typing import Any

import numpy as np

from jaxplan.model.epochs import parse_epoch
from jaxplan.runtime.arguments import as_floats
from jaxplan.schema.faults import WRONG, Place, Reading, closest, nearest, plural, quote, show


class Kind(ABC):
    """What a value may be, how it is read, and how it is written."""

    fields: Sequence[Any] = ()
    """The keys of a table; none of other kinds."""

    @property
    @abstractmethod
    def wanted(self) -> str:
        """Text on what the value must be, to follow "must be"."""

    @property
    def range(self) -> str | None:
        """Interval in which its numbers must lie, as text in the file's units; None for any numbers."""
        return None

    @abstractmethod
    def read(self, value: Any, place: Place) -> Any:
        """Read a value at its place; returns the model's value, or `WRONG` after noting its faults."""

    def absent(self, reading: Reading) -> Any:
        """Return the value that stands for one that is left out.

        None leaves it to the default of the model's class.
        """
        return None

    def may_miss(self, reading: Reading) -> bool:
        """Tell whether a required value may be left out in this file."""
        return False

    def write(self, value: Any) -> Any:
        """Return the value as a file holds it, such that reading it again gives the same bits."""
        return value


@dataclass(frozen=True)
class Interval:
    """A range of numbers as mathematics writes it, such as ``(0, 180]``; infinite ends are open."""

    text: str

    def __contains__(self, value: float) -> bool:
        above = value > self.low if self.open_low else value >= self.low
        below = value < self.high if self.open_high else value <= self.high
        return above and below

    @cached_property
    def low(self) -> float:
        """Lower end of the interval."""
        return float(self.text[1:-1].split(",")[0])

    @cached_property
    def high(self) -> float:
        """Upper end of the interval."""
        return float(self.text[1:-1].split(",")[1])

    @property
    def open_low(self) -> bool:
        """Whether the lower end does not belong to the interval."""
        return self.text[0] == "("

    @property
    def open_high(self) -> bool:
        """Whether the upper end does not belong to the interval."""
        return self.text[-1] == ")"

    def wanted(self, factor: float = 1.0) -> str:
        """Return text on the range, to follow "must"; its ends are multiplied by a factor."""
        low, high = self.low * factor, self.high * factor
        if math.isinf(high):
            return f"be {'greater than' if self.open_low else 'at least'} {low:g}"
        return f"lie in {self.text if factor == 1 else f'{self.text[0]}{low:g}, {high:g}{self.text[-1]}'}"


ANY = Interval("(-inf, inf)")


def either(options: Sequence[str]) -> str:
    """Return the options as text: ``a, b or c``."""
    return " or ".join([", ".join(options[:-1]), options[-1]] if len(options) > 1 else options)


def shortest_degrees(angle: float) -> float:
    """Return the degrees with the fewest digits that `math.radians` turns into exactly this angle, in rad.

    Not every number of radians has such degrees: they are too sparse just below a power of two. For an angle
    without any, which may come from a computation but not from a file, the nearest are returned.
    """
    close = math.degrees(angle)
    for digits in range(1, 18):
        rounded = float(f"{close:.{digits}g}")
        if math.radians(rounded) == angle:
            return rounded
    neighbours = [math.nextafter(close, end) for end in (-math.inf, math.inf)]
    return min([close, *neighbours], key=lambda degrees: abs(math.radians(degrees) - angle))


@dataclass(frozen=True)
class Text(Kind):
    """A name or title: one line of printable text, since it goes into tables and figures.

    Attributes:
        empty: whether it may be empty or blank.
    """

    empty: bool = False

    wanted = "a line of text"

    def read(self, value: Any, place: Place) -> Any:
        if not isinstance(value, str):
            return place.refuse(f"must be {self.wanted}", value)
        if not value.isprintable():
            return place.fault(f"must be {self.wanted}", value)
        return value if self.empty or value.strip() else place.fault("must not be empty", value)


@dataclass(frozen=True)
class Choice(Kind):
    """One of a few words or whole numbers.

    Attributes:
        options: the words and numbers.
        meanings: the model's value for each of them; empty if these are the same.
    """

    options: Sequence[str | int]
    meanings: Mapping[Any, Any] = field(default_factory=dict)

    @property
    def wanted(self) -> str:
        return either([show(option) for option in self.options])

    def read(self, value: Any, place: Place) -> Any:
        for option in self.options:
            if type(value) is type(option) and value == option:
                return self.meanings.get(value, option) if self.meanings else option
        words = [option for option in self.options if isinstance(option, str)]
        close = closest(value, words) if isinstance(value, str) else None
        hint = "" if close is None else f"; perhaps {show(close)} is meant"
        tell = place.fault if isinstance(value, str | int) else place.refuse
        return tell(f"must be {self.wanted}{hint}", value)


@dataclass(frozen=True)
class YesNo(Kind):
    """The kind of a value that is true or false."""

    wanted = "true or false"

    def read(self, value: Any, place: Place) -> Any:
        wrong = not isinstance(value, bool | np.bool_)
        return place.refuse(f"must be {self.wanted}", value) if wrong else bool(value)


@dataclass(frozen=True)
class Number(Kind):
    """A real number.

    Attributes:
        interval: where it must lie, in the file's units.
        degrees: whether the file's unit has degrees where the model's has radians.
        words: words that may stand for it, with the model's value for each; if "inf" is one of them the
            number may be infinite, too.
        hint: advice on a number outside of the interval, to follow "must lie in ...".
    """

    interval: Interval = ANY
    degrees: bool = False
    words: Mapping[str, Any] = field(default_factory=dict)
    hint: str = ""

    @property
    def range(self) -> str | None:
        return None if self.interval is ANY else self.interval.text

    @property
    def wanted(self) -> str:
        return self._describe_wanted(f"a number in {self.range}" if self.range else "a number")

    def _describe_wanted(self, number: str) -> str:
        """Return what the value must be: a number, in these words, or a word that may stand for it."""
        return either([number, *map(quote, self.words)])

    def read(self, value: Any, place: Place) -> Any:
        python = place.reading.python
        number = value if type(value) is float else _as_float(value, python)
        if number is None:
            if isinstance(value, str) and value in self.words:
                return self.words[value]
            noun = "a real number" if isinstance(value, complex) else "a number"
            return place.refuse(f"must be {self.asked(place, noun)}", value)
        if not math.isfinite(number):
            if number in self.words.values() and (python or ("inf" in self.words and value == number)):
                return number  # but not an integer that is too large for a float
            where = f" and {self.interval.wanted(place.spelled.factor)}" if self.range else ""
            return place.fault(f"must be finite{where}", number if python else value)
        in_radians = python and self.degrees
        filed = _exact_degrees(number) if in_radians else number
        if filed not in self.interval and not (in_radians and shortest_degrees(number) in self.interval):
            told = number if python else value
            hint = f": {self.hint}" if self.hint else ""
            return place.fault(f"must {self.interval.wanted(place.spelled.factor)}{hint}", told)
        held = math.radians(filed) if self.degrees else filed
        if filed and not held:
            return place.fault("too small to tell from zero", value)
        return number if python and held == number else held  # the same object tells that nothing changed

    def asked(self, place: Place, noun: str = "a number") -> str:
        """Return what the value must be, for messages.

        For a file that is told with the range, for Python by `noun` and the unit.
        """
        if not place.reading.python:
            return self.wanted
        unit = place.spelled.unit if self.degrees else None
        measured = "" if unit is None else f", in {'radians' if unit in ('', 'rad') else unit}"
        return self._describe_wanted(f"{noun}{measured}")

    def write(self, value: Any) -> float | str:
        for word, meaning in self.words.items():
            if isinstance(value, str) == isinstance(meaning, str) and value == meaning:
                return word
        return shortest_degrees(float(value)) if self.degrees else float(value)


@dataclass(frozen=True)
class FromZero(Number):
    """A number that lies in its interval or is zero; other keys may then forbid zero."""

    def read(self, value: Any, place: Place) -> Any:
        return 0.0 if _as_float(value, place.reading.python) == 0 else super().read(value, place)


NUMBER = Number()


def _exact_degrees(angle: float) -> float:
    """Return degrees that `math.radians` turns into the angle, in rad; the nearest ones if there are none."""
    close = math.degrees(angle)
    return close if math.radians(close) == angle else shortest_degrees(angle)


def _as_float(value: Any, python: bool) -> float | None:
    """Return a value as a float, or None if it is no number.

    If `python`, any type that numpy takes for a number is one.
    """
    if python:
        array = as_floats(value)
        return float(array) if array is not None and not array.ndim else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:  # an integer beyond the range of floats
        return math.inf


@dataclass(frozen=True)
class Integer(Kind):
    """The kind of a whole number in an interval."""

    interval: Interval

    @property
    def range(self) -> str:
        return self.interval.text

    @property
    def wanted(self) -> str:
        return f"an integer in {self.interval.text}"

    def read(self, value: Any, place: Place) -> Any:
        if isinstance(value, bool) or not isinstance(value, int | np.integer):
            return place.refuse(f"must be {self.wanted}", value)
        number = value if type(value) is int else int(value)
        if number not in self.interval:
            return place.fault(f"must {self.interval.wanted()}", value)
        return number


@dataclass(frozen=True)
class Epoch(Kind):
    """A time in UTC: ISO 8601 text, or a date-time or date of TOML, Python or numpy."""

    wanted = "a time in UTC such as 2026-01-01T00:00:00, from 1972 to 2099"

    def read(self, value: Any, place: Place) -> Any:
        text = self.write(value) if isinstance(value, np.datetime64) else value
        try:
            return parse_epoch(text if isinstance(text, str | date) else "")
        except ValueError:
            return place.fault(f"must be {self.wanted}", value)

    def write(self, value: np.datetime64) -> str:
        text = str(value.astype("datetime64[us]"))
        return text.rstrip("0").rstrip(".") if "." in text else text


_NOUNS_IN_MESSAGES = {"gimbal": "jointed device"}  # in messages


@dataclass(frozen=True)
class Name(Kind):
    """The name of something in the scenario, which must exist if the names are known.

    Attributes:
        noun: what it names: "device", "terminal", "gimbal" (a device with joints) or "zone".
    """

    noun: str

    @property
    def wanted(self) -> str:
        return f"the name of a {_NOUNS_IN_MESSAGES.get(self.noun, self.noun)}"

    def read(self, value: Any, place: Place) -> Any:
        if not isinstance(value, str):
            return place.refuse(f"must be {self.wanted}", value)
        known = place.reading.names.get(self.noun)
        if known is not None and value not in known:
            called = _NOUNS_IN_MESSAGES.get(self.noun, self.noun)
            return place.fault(f"no such {called}, {nearest(value, known, plural(called))}", value)
        return value


@dataclass(frozen=True)
class Names(Kind):
    """Names of devices: at least one in a file; in Python also none, or a single text."""

    wanted = "an array of names of devices"

    def read(self, value: Any, place: Place) -> Any:
        python = place.reading.python
        if python:
            value = [value] if isinstance(value, str) else value
            if not isinstance(value, list | tuple) or not all(isinstance(name, str) for name in value):
                return place.refuse("must be a tuple of names of devices", value)
        elif not isinstance(value, list) or not value:
            return place.refuse(f"must be {self.wanted}, at least one", value)
        read = tuple(Name("device").read(name, place[i]) for i, name in enumerate(value))
        twice = [i for i, name in enumerate(read) if name is not WRONG and name in read[:i]]
        for i in twice:
            place[i].fault("is named twice", value[i])
        return WRONG if twice or WRONG in read else read

    def write(self, value: Any) -> list[str]:
        return list(value)


@dataclass(frozen=True)
class ByName(Kind):
    """A table from names to values of one kind.

    Attributes:
        of: kind of the values.
        noun: what the names are of, as for `Name`; empty for any names.
    """

    of: Kind
    noun: str = ""

    @property
    def range(self) -> str | None:
        return self.of.range

    @property
    def wanted(self) -> str:
        called = _NOUNS_IN_MESSAGES.get(self.noun, self.noun)
        return f"a table {f'from names of {called}s to' if self.noun else 'of'} numbers"

    def read(self, value: Any, place: Place) -> Any:
        if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
            wanted = self.wanted.replace("a table", "a dict") if place.reading.python else self.wanted
            return place.refuse(f"must be {wanted}", value)
        known = place.reading.names.get(self.noun)
        unknown = [name for name in value if known is not None and name not in known]
        for name in unknown:
            called = _NOUNS_IN_MESSAGES.get(self.noun, self.noun)
            place[name].fault(f"no such {called}, {nearest(name, known or (), plural(called))}")
        read = {name: self.of.read(number, place[name]) for name, number in value.items()}
        return WRONG if unknown or WRONG in read.values() else read

    def write(self, value: Any) -> dict[str, Any]:
        return {name: self.of.write(entry) for name, entry in value.items()}


@dataclass(frozen=True)
class Several(Kind):
    """An array of any number of values of one kind."""

    of: Kind

    @property
    def wanted(self) -> str:
        return f"an array, each entry {self.of.wanted}"

    def read(self, value: Any, place: Place) -> Any:
        if not isinstance(value, list):
            return place.refuse(f"must be {self.wanted}", value)
        read = tuple(self.of.read(entry, place[i]) for i, entry in enumerate(value))
        return WRONG if WRONG in read else read


@dataclass(frozen=True)
class Nullable(Kind):
    """A value of a kind, or null, which is read as None."""

    of: Kind

    @property
    def wanted(self) -> str:
        return f"{self.of.wanted} or null"

    def read(self, value: Any, place: Place) -> Any:
        return None if value is None else self.of.read(value, place)
