"""Faults of what is read: where a value stands, how it is shown, and the error that lists all of them.

A *fault* is one line, ``keep_out[2].half_angle_deg = 210: must lie in (0, 180)``: the key path as the file
spells it with zero-based indices, the value in the file's units, and what it must be. For a scenario that was
made in Python it names attributes instead, and the unit. A `Reading` is the state of reading one file or
object, a `Place` says where in it a value stands. To *note* a fault is to add it to the list of the `Reading`
by the `Place` of the value; `WRONG` then stands for the value, and reading continues to find other faults.
"""

import difflib
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from functools import lru_cache
from typing import Any, NamedTuple

# A longer name is not compared with the known ones, nor shown in full.
_LONGEST_NAME = 60
# Share of two names that must be alike for one to be suggested; "priority" has 0.62 of "point".
_ALIKE = 0.65
# Letters of a name that is suggested because the unknown one is its beginning.
_LEAST_BEGINNING = 3
# A file with more faults than this is not one that somebody mends by hand; reading stops.
_MOST_FAULTS = 1000
# Values of an array that are shown; nine are a matrix.
_MAX_SHOWN_NUMBERS = 9


class ScenarioError(ValueError):
    """A scenario or timeline that cannot be used, with all of its faults.

    Attributes:
        faults: one line each, in the order of the file's tables.
        source: name of the file, or of what else was read.
    """

    def __init__(self, faults: Iterable[str], source: str = "the scenario") -> None:
        self.faults = tuple(faults)
        self.source = source
        super().__init__(self.faults, source)  # what a copy in another process is made from

    def __str__(self) -> str:
        if len(self.faults) == 1:
            return f"{self.source}: {self.faults[0]}"
        lines = [f"{self.source} has {len(self.faults)} faults:", *self.faults]
        return "\n  ".join(lines)


_NO_VALUE = object()  # no value, since None is one that a JSON file may hold
WRONG: Any = object()
"""Stands for a value that is wrong, its fault being noted: what readers return, and what attributes have."""


def is_wrong(read: Any) -> bool:
    """Tell whether what was read is `WRONG`, or an attribute of it, an entry of a tuple, or one in these."""
    if isinstance(read, tuple):
        return any(map(is_wrong, read))
    return read is WRONG or (is_dataclass(read) and any(map(is_wrong, vars(read).values())))


def quote(text: str) -> str:
    """Return a string as TOML writes it, in quotes, with all characters escaped that do not print."""
    escapes = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t"}
    escaped = (escapes.get(c) or (c if c.isprintable() else f"\\U{ord(c):08x}") for c in text)
    return f'"{"".join(escaped)}"'


def _truncate(text: str) -> str:
    """Return a text, cut to `_LONGEST_NAME` characters and dots."""
    return text if len(text) <= _LONGEST_NAME else text[:_LONGEST_NAME] + "..."


@lru_cache(maxsize=1024)
def spell_key(key: str) -> str:
    """Return a key as TOML writes it, without quotes where that is allowed."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else quote(key)


def show(value: object) -> str:
    """Return a short text for a value, as a file would spell it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and value.bit_length() > 64:
        return "(a huge integer)"
    if isinstance(value, str):
        return quote(_truncate(value))
    if isinstance(value, dict):
        return "(a table)"
    if isinstance(value, list):
        inner = [entry for item in value for entry in (item if isinstance(item, list) else [item])]
        small = max(len(value), len(inner)) <= _MAX_SHOWN_NUMBERS
        plain = small and not any(isinstance(entry, list | dict) for entry in inner)
        return f"[{', '.join(map(show, value))}]" if plain else f"(an array of {len(value)})"
    return "null" if value is None else _truncate(str(value))


class Spelled(NamedTuple):
    """How messages name a place: its path, its value's unit, and the factor from the file's unit to that."""

    path: str
    unit: str = ""
    factor: float = 1.0


class Reading:
    """What is known and what was noted while a file, or an object of Python, is read.

    Attributes:
        python: whether an object of Python is read, with radians and attributes instead of a file's units and
            keys.
        faults: the faults noted so far, one line each.
        refused: how many of them are about a wrong type or shape.
        names: names that may be referred to, by what they name ("device", "terminal", ...); None where any
            may, since they are not known.
        sizes: lengths of axes of arrays by names of the axes such as "joint". None where any length may be; a
            name that is absent is given the length of the first array that has it.
        terminals: how many terminals there must be, None where that is not known.
        ranges: (number of joints, 2) rad, ranges of the joints; None where they are not known.
        folder: folder to which paths in the file are relative.
        root: what messages call the whole.
        taken: results of reading objects of Python that may be shared, by their `id`, each with the object
            itself, so that it lives as long as the entry.
    """

    python = False
    folder: str | os.PathLike[str] = ""
    root = "the file"

    def __init__(
        self,
        names: Mapping[str, tuple[str, ...] | None] | None = None,
        sizes: Mapping[str, int | None] | None = None,
    ) -> None:
        self.faults: list[str] = []
        self.refused = 0
        self.names = dict(names or {})
        self.sizes: dict[str, int | None] = dict(sizes or {"terminal": None, "joint": None})
        self.terminals: int | None = None
        self.ranges: Any = None
        self.taken: dict[int, tuple[Any, Any]] = {}

    def spelled(self, steps: Sequence[str | int]) -> Spelled:
        """Return how messages name the place to which keys and indices (`steps`) lead."""
        return Spelled(spell_path(steps))

    def show(self, value: object) -> str:
        """Return a short text for a value."""
        return show(value)


def spell_path(steps: Iterable[str | int]) -> str:
    """Return keys and indices as a path, such as ``keep_out[2].half_angle_deg``."""
    spelled = (f"[{s}]" if isinstance(s, int) else f".{spell_key(_truncate(s))}" for s in steps)
    return "".join(spelled).removeprefix(".")


class Place:
    """A place where a value stands, at which faults are noted; ``place["key"]`` and ``place[0]`` lie in it.

    There is one for every value that is read, and few have faults; so the path is put together only for
    messages.
    """

    __slots__ = ("_before", "_step", "reading")

    def __init__(self, reading: Reading, before: "Place | None" = None, step: str | int = "") -> None:
        self.reading, self._before, self._step = reading, before, step

    def __getitem__(self, step: str | int) -> "Place":
        return Place(self.reading, self, step)

    @property
    def spelled(self) -> Spelled:
        """How messages name this place: its path, unit and factor."""
        steps: list[str | int] = []
        place = self
        while place._before is not None:
            steps.append(place._step)
            place = place._before
        return self.reading.spelled(steps[::-1])

    @property
    def path(self) -> str:
        """Path of keys and indices; empty for the whole file."""
        return self.spelled.path

    def told(self, value: object, *, bare: bool = False) -> str:
        """Return text of the path with a value that stands here, and its unit unless `bare`."""
        path, unit, _ = self.spelled
        measured = isinstance(value, int | float) and not isinstance(value, bool) and not bare
        return f"{path or self.reading.root} = {self.reading.show(value)} {unit * measured}".rstrip()

    def fault(self, complaint: str, value: object = _NO_VALUE, *, bare: bool = False) -> Any:
        """Note that the value at this place is wrong or missing.

        Args:
            complaint: what it must be, such as "must be finite".
            value: the value to show; left out if it is missing.
            bare: whether to show it without its unit.

        Returns:
            `WRONG`.

        Raises:
            ScenarioError: when there are too many faults to continue.
        """
        faults = self.reading.faults
        if len(faults) == _MOST_FAULTS:
            raise ScenarioError([*faults, "too many faults, reading stopped here"])
        what = self.path or self.reading.root if value is _NO_VALUE else self.told(value, bare=bare)
        faults.append(f"{what}: {complaint}")
        return WRONG

    def refuse(self, complaint: str, value: object) -> Any:
        """Note that a value, shown without a unit, has a wrong type or shape; returns `WRONG`."""
        self.reading.refused += 1
        return self.fault(complaint, value, bare=True)


def closest(name: str, known: Sequence[str]) -> str | None:
    """Return the known name that an unknown one resembles or begins, None if there is none."""
    alike = [one for one in known if one.casefold() == name.casefold()]
    alike += [one for one in known if len(name) >= _LEAST_BEGINNING and one.startswith(name)]
    close = difflib.get_close_matches(name, known, 1, _ALIKE) if len(name) <= _LONGEST_NAME else []
    return next(iter([*alike, *close]), None)


def plural(noun: str) -> str:
    """Return the plural of a regular noun."""
    return f"{noun.removesuffix('y')}ies" if noun.endswith("y") else f"{noun}s"


def nearest(name: str, known: Sequence[str], kind: str) -> str:
    """Return advice on an unknown name: the known one that it resembles, or else all of them.

    Args:
        name: the unknown name.
        known: all names that would be right.
        kind: what they are names of, in the plural.
    """
    close = closest(name, known)
    if close is not None:
        return f"perhaps {spell_key(close)} is meant"
    each = dict.fromkeys(known)  # two may have one name, which is a fault of its own
    return f"the {kind} are {', '.join(map(spell_key, each))}" if known else f"there are no {kind}"
