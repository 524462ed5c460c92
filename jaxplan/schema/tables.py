"""Tables of a scenario file: which keys they have, and what part of the model they make.

A table is described once, as a list of fields. Reading, writing and the reference of the file all follow
from that description: unknown and missing keys are found by it, and a default is that of the model's class.
"""

import re
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cached_property
from typing import Any

from jaxplan.runtime.arguments import a_or_an
from jaxplan.schema.faults import Place, nearest
from jaxplan.schema.kinds import Kind


@dataclass(frozen=True)
class Field:
    """A key of a table.

    Attributes:
        key: as the file spells it, with the unit.
        kind: what its value may be.
        attribute: what the model calls it. Fields that share it are alternatives, of which a file gives one;
            the first that can hold the value is the one that is written.
        meaning: one line for the reference.
        required: whether the key, or an alternative, must be there.
        always: whether it is written at its default too, because a later version may change that.
        resolved: whether reading puts something else in its place, so that it is never written.
        instead_of: another attribute in whose place it stands, of which one must be given.
        held: what holds it in the model, where that is not the attribute by itself.
        half: which half of that it is, where there are two.
    """

    key: str
    kind: Kind
    attribute: str
    meaning: str
    required: bool = False
    always: bool = False
    resolved: bool = False
    instead_of: str = ""
    held: str = ""
    half: int = 0

    @property
    def says(self) -> str:
        """The attribute that keys which are alternatives to each other share."""
        return self.instead_of or self.attribute


@dataclass(frozen=True)
class Table(Kind):
    """A table with known keys.

    It is read to a dict of attributes, as complete as the faults allow, so that checks across tables can
    look at it; `build` turns that into the model.

    Attributes:
        model: the class it makes.
        fields: its keys, in the order in which they are written.
        make: builds the model from attributes, the class itself unless told.
        split: gives the attributes of a model, what it holds unless told.
        refused: keys that are refused with a reason of their own.
        whole: kinds of the model's attributes that a file has in parts, for which `split` gives others.
        fill: gives the attributes of what Python gave, with those that were left out; all unless told.
    """

    model: type
    fields: tuple[Field, ...]
    make: Callable[..., Any] | None = None
    split: Callable[[Any], Mapping[str, Any]] = vars
    refused: Mapping[str, str] = field(default_factory=dict)
    whole: Mapping[str, Kind] = field(default_factory=dict)
    fill: Callable[[dict[str, Any]], dict[str, Any]] | None = None

    wanted = "a table"

    def read(self, value: object, place: Place) -> dict[str, Any] | None:
        """What could be read, by attribute, None for what is wrong; None if it is no table."""
        if not isinstance(value, dict):
            place.fault(f"must be {self.wanted}", value)
            return None
        self._refuse_unknown(value, place)
        read: dict[str, Any] = {}
        given: dict[str, str] = {}
        for entry in self.fields:
            if entry.key not in value:
                continue
            here = place.key(entry.key)
            if entry.says in given:
                here.fault(_second(entry, given[entry.says]))
            given[entry.says] = entry.key
            before = len(place.faults)
            content = entry.kind.read(value[entry.key], here)
            if content is not None or len(place.faults) > before:
                read[entry.attribute] = content
        self._note_missing(given, place)
        return read

    def _refuse_unknown(self, value: Mapping[str, object], place: Place) -> None:
        known = [entry.key for entry in self.fields]
        for key in value:
            if key in self.refused:
                place.key(key).fault(self.refused[key])
            elif key not in known:
                place.key(key).fault(f"unknown key, {nearest(key, known, 'keys')}")

    def _note_missing(self, given: Mapping[str, str], place: Place) -> None:
        for entry in self.fields:
            if entry.required and entry.attribute not in given and not entry.kind.may_miss(place):
                self._note_absent(entry, place)

    def _note_absent(self, entry: Field, place: Place) -> None:
        here = place.key(entry.key)
        alike = [place.key(f.key).path for f in self.fields if f.says == entry.says]
        others = [path for path in alike if path != here.path and not path.startswith(f"{here.path}.")]
        named = [path.removeprefix(f"{place.path}.") for path in others]
        instead = f" (or {', '.join(named)})" if named else ""
        here.fault(f"missing{instead}, must be {entry.kind.wanted}")

    def take(self, value: Any, place: Place) -> Any:
        """The model, each attribute as its kind takes it; where some are wrong its parts, of these None."""
        model: Any = self.model
        if not isinstance(value, model):
            place.refuse(f"must be {a_or_an(model.__name__)}", value)
            return None
        before = len(place.faults)
        parts: dict[str, Any] = {}
        same = True
        for name, may_miss, key, kinds in self._attributes:
            content = getattr(value, name)
            if content is None and may_miss:
                continue
            kind = kinds[0]
            if len(kinds) > 1:
                kind = next((kind for kind in kinds if kind.holds(content)), kind)
            parts[name] = kind.take(content, place.key(key))
            same = same and parts[name] is content
        for alike in self._choices:
            given = [entry for entry in alike if entry.attribute in parts]
            if not given:
                self._note_absent(alike[0], place)
            for entry in given[1:]:
                place.key(entry.key).fault(_second(entry, given[0].key))
        if len(place.faults) > before:
            return parts
        if same and not self.fill:
            return value  # of which nothing can be changed by those who made it
        return replace(value, **(self.fill(parts) if self.fill else parts))

    @cached_property
    def _attributes(self) -> tuple[tuple[str, bool, str, tuple[Kind, ...]], ...]:
        """The model's attributes: whether each may be left at None, its key, and the kinds it may be of."""
        found = []
        for part in fields(self.model):
            written = [entry for entry in self.fields if not entry.resolved]
            own = [entry for entry in written if entry.attribute == part.name]
            halves = [entry for entry in written if entry.held == part.name]
            kinds = tuple(entry.kind for entry in own) or (self.whole[part.name],)
            found.append((part.name, part.default is None, (own or halves)[0].key, kinds))
        return tuple(found)

    @cached_property
    def _choices(self) -> tuple[tuple[Field, ...], ...]:
        """Keys of attributes of which one must be given, the first of which is the usual one."""
        others = {entry.instead_of for entry in self.fields if entry.instead_of}
        first = [entry for entry in self.fields if entry.required and entry.attribute in others]
        return tuple(
            (usual, *(entry for entry in self.fields if entry.instead_of == usual.attribute))
            for usual in first
        )

    def build(self, value: Any) -> Any:
        """The model of attributes read without fault; the class fills in its defaults."""
        kinds = {entry.attribute: entry.kind for entry in self.fields}
        parts = {attribute: kinds[attribute].build(content) for attribute, content in value.items()}
        return (self.make or self.model)(**parts)

    def write(self, value: Any) -> dict[str, Any]:
        """The table as the file holds it, without what the class fills in by itself."""
        values = self.split(value)
        written: dict[str, Any] = {}
        done: set[str] = set()
        for entry in self.fields:
            content = values.get(entry.attribute)
            passed = content is None or entry.attribute in done or entry.resolved
            if passed or not entry.kind.holds(content):
                continue
            done.add(entry.attribute)
            text = entry.kind.write(content)
            if entry.key not in self._usual or repr(text) != self._usual[entry.key]:
                written[entry.key] = text
        return written

    @cached_property
    def _usual(self) -> dict[str, str]:
        """By key, what is not written since the class fills it in."""
        usual = {}
        for entry in self.fields:
            default = self.defaults().get(entry.attribute)
            if not entry.always and default is not None and entry.kind.holds(default):
                usual[entry.key] = repr(entry.kind.write(default))
        return usual

    def defaults(self) -> dict[str, Any]:
        """What the model's class fills in, by attribute."""
        given = {f.name: f.default for f in fields(self.model) if f.default is not MISSING}
        made = {f.name: f.default_factory() for f in fields(self.model) if f.default_factory is not MISSING}
        return given | made


def _second(entry: Field, first: str) -> str:
    """What is wrong with a key, as another one is given that says the same."""
    same = "stands in the place of" if entry.instead_of else "says the same as"
    return f"{same} {first}, only one of them can be given"


class Either(Kind):
    """One of several tables, told apart by their keys."""

    @property
    @abstractmethod
    def tables(self) -> Mapping[str, Table]:
        """The tables by words that tell them apart, for the reference."""


@dataclass(frozen=True)
class Rows(Kind):
    """An array of tables, each under the same ``[[header]]``."""

    table: Table
    wanted = "an array of tables"

    def read(self, value: object, place: Place) -> list[dict[str, Any] | None] | None:
        """What could be read of each table; None for the entries that are none."""
        if not isinstance(value, list):
            header = re.sub(r"\[\d+\]", "", place.path)
            place.fault(f"must be an array of tables, each under [[{header}]]", value)
            return None
        return [self.table.read(row, place.item(i)) for i, row in enumerate(value)]

    def take(self, value: Any, place: Place) -> tuple[Any, ...] | None:
        """The models, in their order."""
        if not isinstance(value, list | tuple):
            place.refuse(f"must be a tuple of {self.table.model.__name__}, or a list", value)
            return None
        return tuple(self.table.take(row, place.item(i)) for i, row in enumerate(value))

    def build(self, value: Any) -> tuple[Any, ...]:
        """The models, in the file's order."""
        return tuple(self.table.build(row) for row in value)

    def write(self, value: Any) -> list[dict[str, Any]]:
        """A list of tables."""
        return [self.table.write(row) for row in value]
