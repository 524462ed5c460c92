"""Faults of a scenario file: where a value stands, how it is shown, and the error that lists them all.

A fault is one line, ``keep_out[2].half_angle_deg = 210: must lie in (0, 180)``: the key path as the file
spells it with zero-based indices, the value in the file's units, and what it must be.
"""

import difflib
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

# A longer name is not compared with the known ones, nor shown in full.
_LONGEST_NAME = 60
# A file with more faults than this is not one that somebody mends by hand; reading stops.
_MOST_FAULTS = 1000
# Values of an array that are shown; nine are a matrix.
_MOST_SHOWN = 9


class ScenarioError(ValueError):
    """A scenario that cannot be used, with all of its faults.

    Attributes:
        faults: one line each, in the order of the file's tables.
        source: name of the file, or what else was read.
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


class DeviceNames(NamedTuple):
    """Names that other tables refer to; None where the file is too wrong to tell."""

    terminals: tuple[str, ...] | None
    instruments: tuple[str, ...] | None

    @property
    def all(self) -> tuple[str, ...] | None:
        """Terminals, then instruments."""
        if self.terminals is None or self.instruments is None:
            return None
        return self.terminals + self.instruments


class _Nothing:
    """Stands for no value, since None is one that a JSON file may hold."""


_NOTHING = _Nothing()


def quote(text: str) -> str:
    """A string as TOML writes it, with everything that does not print escaped."""
    escapes = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t"}
    escaped = (escapes.get(c) or (c if c.isprintable() else f"\\U{ord(c):08x}") for c in text)
    return f'"{"".join(escaped)}"'


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST_NAME else text[:_LONGEST_NAME] + "..."


@lru_cache(maxsize=1024)
def spell_key(key: str) -> str:
    """A key as TOML writes it, bare where that is allowed."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else quote(key)


def show(value: object) -> str:
    """A short text for a value, as the file would spell it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and value.bit_length() > 64:
        return "(a huge integer)"
    if isinstance(value, str):
        return quote(_cut(value))
    if isinstance(value, dict):
        return "(a table)"
    if isinstance(value, list):
        inner = [entry for item in value for entry in (item if isinstance(item, list) else [item])]
        small = max(len(value), len(inner)) <= _MOST_SHOWN
        plain = small and not any(isinstance(entry, list | dict) for entry in inner)
        return f"[{', '.join(map(show, value))}]" if plain else f"(an array of {len(value)})"
    return "null" if value is None else _cut(str(value))


@dataclass(slots=True)
class Place:
    """A place in the file, where faults are noted.

    There is one for every value that is read, and few have faults, so the path is spelled where it is told.

    Attributes:
        faults: the list that all places of a file share.
        devices: the names that other places refer to.
        steps: keys and indices from the file to here, none for the file itself.
        show: a short text for a value.
        factor: what takes numbers of the file to the unit in which they are told.
    """

    faults: list[str]
    devices: DeviceNames
    steps: tuple[str | int, ...] = ()
    show: Callable[[object], str] = show
    factor: float = 1.0

    @property
    def path(self) -> str:
        """Key path, empty for the file itself."""
        spelled = (f"[{s}]" if isinstance(s, int) else f".{spell_key(_cut(s))}" for s in self.steps)
        return "".join(spelled).removeprefix(".")

    def key(self, name: str) -> "Place":
        """The place of a key of this table."""
        return Place(self.faults, self.devices, (*self.steps, name), self.show)

    def item(self, index: int) -> "Place":
        """The place of an entry of this array."""
        return Place(self.faults, self.devices, (*self.steps, index), self.show)

    def fault(self, complaint: str, value: object = _NOTHING) -> None:
        """Note that this value, or what stands here, is wrong.

        Raises:
            ScenarioError: when there are too many faults to go on.
        """
        if len(self.faults) == _MOST_FAULTS:
            raise ScenarioError([*self.faults, "too many faults, reading stopped here"])
        what = self.name if value is _NOTHING else self.told(value)
        self.faults.append(f"{what}: {complaint}")

    def refuse(self, complaint: str, value: object) -> None:
        """Note that what Python gave is of a wrong type or shape, so that nothing can be made of it."""
        self.fault(complaint, value)

    def spelled(self, kind: Any, value: Any) -> Any:
        """A value of the model as it is told here: as the file holds it."""
        return kind.write(value)

    @property
    def name(self) -> str:
        """The key path, or what has none."""
        return self.path or "the file"

    def told(self, value: object) -> str:
        """The name with a value of the file that stands here."""
        return f"{self.name} = {self.show(value)}"


class Ear(Place):
    """Hears that there are faults, and not where: for a first look, which is quick where there are none.

    Attributes:
        refused: how many of the faults are of type or shape.
    """

    refused: int = 0

    def key(self, name: str) -> Place:
        """Here."""
        return self

    def item(self, index: int) -> Place:
        """Here."""
        return self

    def fault(self, complaint: str, value: object = _NOTHING) -> None:
        """Count a fault."""
        self.faults.append("")

    def refuse(self, complaint: str, value: object) -> None:
        """Count a fault of type or shape."""
        self.refused += 1
        self.faults.append("")


def nearest(name: str, known: Sequence[str], kind: str) -> str:
    """Advice on an unknown name: the known one it resembles, or else all of them.

    Args:
        name: what the file says.
        known: what it may say.
        kind: what they are, in the plural.
    """
    close = difflib.get_close_matches(name, known, n=1) if len(name) <= _LONGEST_NAME else []
    if close:
        return f"perhaps {spell_key(close[0])} is meant"
    return f"the {kind} are {', '.join(map(spell_key, known))}" if known else f"there are no {kind}"
