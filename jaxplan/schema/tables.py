"""Tables of a file: which keys they have, and which objects of the model they make.

A table is derived from a dataclass of the model whose fields declare their keys (`jaxplan.model.file_keys`).
Reading, writing and the reference of the file use it: unknown and missing keys are found by it, and defaults
are those of the dataclass. An object that was made in Python is read by the same table, attribute by
attribute.
"""

import re
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from datetime import date, time
from functools import cached_property
from numbers import Real
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

from jaxplan.model.file_keys import Key, unit_of
from jaxplan.runtime.arguments import a_or_an
from jaxplan.schema.faults import WRONG, Place, nearest
from jaxplan.schema.value_kinds import ANY, Choice, Epoch, Integer, Interval, Kind, Number, Text, YesNo

_DUPLICATE_FAULT = "stands in the place of {}, only one of them can be given"
_CHECKED_MARK = "_schema_checked"  # attribute that is set on objects whose numbers and texts were found good


@dataclass(frozen=True)
class Field:
    """A key of a table.

    Attributes:
        key: the key as the file spells it, with the unit.
        kind: what its value may be.
        attribute: name of the model's attribute, or a name that only `Table.make` and `Table.split` know.
        meaning: one line for the reference.
        required: whether the key, or one that may stand for it, must be there.
        always: whether it is written even if it has its default.
        instead_of: the attribute instead of which it may be given; empty for none.
        held: dotted path of the model's attributes that holds the value, if that is not `attribute`.
    """

    key: str
    kind: Kind
    attribute: str
    meaning: str = ""
    required: bool = False
    always: bool = False
    instead_of: str = ""
    held: str = ""

    @property
    def says(self) -> str:
        """The attribute that the key sets; it is the same for keys that are alternatives to each other."""
        return self.instead_of or self.attribute

    @property
    def value(self) -> str:
        """Text on what the value must be, without its range."""
        return self.kind.wanted.replace(f" in {self.kind.range}", "")

    @property
    def unit(self) -> str:
        """The unit in which the key's name ends; empty if there is none."""
        return unit_of(self.key)


@dataclass(frozen=True)
class Table(Kind):
    """A table with known keys, which makes an object of the model.

    Attributes of the object that have faults are `WRONG`, and the others are as they were read.

    Attributes:
        model: the class of the objects it makes.
        fields: its keys, in the order in which they are written.
        attributes: attributes of the model, by which an object of Python is read.
        make: makes the object from what was read, by attribute; None for the class itself.
        split: returns what is written of an object, by attribute; by default all of its attributes.
        check: notes what does not go together in an object that was read; None for nothing.
        exact: returns what stands for an object whose numbers were read, where a few digits cannot say it
            exactly; None for the object itself.
        refused: keys that are refused, each with its reason.
    """

    model: type
    fields: Sequence[Field]
    attributes: Sequence[Field] = ()
    make: Callable[[dict[str, Any], Place], Any] | None = None
    split: Callable[[Any], Mapping[str, Any]] = vars
    check: Callable[[Any, Place], None] | None = None
    exact: Callable[[Any], Any] | None = None
    refused: Mapping[str, str] = field(default_factory=dict)

    wanted = "a table"

    def read(self, value: Any, place: Place) -> Any:
        read = self._read_object(value, place) if place.reading.python else self._read_table(value, place)
        if read is WRONG:
            return WRONG
        if self.check is not None:
            self.check(read, place)
        if self.exact is not None and all(part is not WRONG for part in vars(read).values()):
            return self.exact(read)
        return read

    def _read_table(self, value: Any, place: Place) -> Any:
        """Read the table from a file; notes unknown and missing keys, and keys given twice."""
        if not isinstance(value, dict):
            return place.refuse(f"must be {self.wanted}", value)
        self._refuse_unknown(value, place)
        parts: dict[str, Any] = {}
        given: dict[str, str] = {}
        for entry in self.fields:
            if entry.key not in value:
                continue
            here = place[entry.key]
            if entry.says in given:
                here.fault(_DUPLICATE_FAULT.format(given[entry.says]))
            given[entry.says] = entry.key
            clock = self._refuse_other_clock(entry, value[entry.key], here)
            parts[entry.attribute] = clock or entry.kind.read(value[entry.key], here)
        for entry in self.fields:
            if entry.says not in given:
                if entry.required and not entry.kind.may_miss(place.reading):
                    parts[entry.attribute] = self._refuse_missing(entry, place)
                elif (usual := entry.kind.absent(place.reading)) is not None:
                    parts[entry.attribute] = usual
        return self.model(**parts) if self.make is None else self.make(parts, place)

    def _refuse_other_clock(self, entry: Field, value: object, here: Place) -> Any:
        """Note seconds where UTC is wanted, and UTC where seconds are, with the key that takes what is given.

        Returns:
            `WRONG` after that; None if the value may be right, or no key would take it.
        """
        utc = isinstance(entry.kind, Epoch)
        if not (
            isinstance(value, Real) and not isinstance(value, bool) if utc else isinstance(value, date | time)
        ):
            return None
        for other in self.fields:
            if other.says == entry.says and isinstance(other.kind, Number if utc else Epoch):
                what = "seconds" if utc else "a time in UTC"
                return here.fault(f"must be {entry.kind.wanted}; {other.key} takes {what}", value)
        return None

    def _refuse_unknown(self, value: Mapping[str, object], place: Place) -> None:
        """Note a fault for each key of a file that the table does not have, or that it refuses."""
        known = [entry.key for entry in self.fields]
        for key in value:
            if key in self.refused:
                place[key].fault(self.refused[key])
            elif key not in known:
                place[key].fault(f"unknown key, {nearest(key, known, 'keys')}")

    def _refuse_missing(self, entry: Field, place: Place) -> Any:
        """Note that a key is missing; returns `WRONG`."""
        known = self.attributes if place.reading.python else self.fields
        others = [place[other.key] for other in known if other.says == entry.says and other is not entry]
        names = [here.path.removeprefix(f"{place.path}.") for here in others]
        instead = f" (or {', '.join(names)})" if names else ""
        return place[entry.key].fault(f"missing{instead}, must be {entry.kind.wanted}")

    def _read_object(self, value: Any, place: Place) -> Any:
        """Read an object made in Python; returns it with the model's own types, or itself if it has them."""
        if not isinstance(value, self.model):
            return place.refuse(f"must be {a_or_an(self.model.__name__)}", value)
        own = value.__dict__
        checked = _CHECKED_MARK in own
        changed: dict[str, Any] = {}
        for name, key, kind, read, may_miss in (
            self._rechecked_attributes if checked else self._python_attributes
        ):
            content = own[name]
            if content is None and may_miss:
                content = kind.absent(place.reading)
            else:
                content = read(content, place[key])
            if content is not own[name]:
                changed[name] = content
        if not checked and not changed.keys() & self._immutable_names:
            own[_CHECKED_MARK] = True
        for alike in self._alternatives:
            given = [entry for entry in alike if own[entry.attribute] is not None]
            if not given:
                self._refuse_missing(alike[0], place)
            for entry in given[1:]:
                place[entry.key].fault(_DUPLICATE_FAULT.format(place[given[0].key].path))
        if not changed:
            return value
        return self.model(**{name: changed.get(name, own[name]) for name, *_ in self._python_attributes})

    @cached_property
    def _python_attributes(self) -> list[tuple[str, str, Kind, Callable[[Any, Place], Any], bool]]:
        """The attributes by which an object of Python is read.

        For each of them its name, key, kind, the kind's `read`, and whether it may be None.
        """
        usual = {part.name: part.default for part in fields(self.model)}
        return [
            (e.attribute, e.key, e.kind, e.kind.read, usual[e.attribute] is None) for e in self.attributes
        ]

    @cached_property
    def _immutable_names(self) -> set[str]:
        """Names of attributes whose values are immutable and checked by themselves, so once is enough."""
        return {
            entry.attribute for entry in self.attributes if isinstance(entry.kind, Number | Integer | Text)
        }

    @cached_property
    def _rechecked_attributes(self) -> list[tuple[str, str, Kind, Callable[[Any, Place], Any], bool]]:
        """Those attributes of `_python_attributes` that are read again each time an object is checked."""
        return [entry for entry in self._python_attributes if entry[0] not in self._immutable_names]

    @cached_property
    def _alternatives(self) -> list[list[Field]]:
        """Groups of attributes of which exactly one must be given, the usual one first."""
        named = [entry.instead_of for entry in self.attributes if entry.instead_of]
        return [[entry for entry in self.attributes if entry.says == usual] for usual in dict.fromkeys(named)]

    def write(self, value: Any) -> dict[str, Any]:
        parts = self.split(value)
        written: dict[str, Any] = {}
        for entry in self.fields:
            content = parts.get(entry.attribute)
            if content is None:
                continue
            text = entry.kind.write(content)
            if entry.always or repr(text) != self._default_texts.get(entry.key):
                written[entry.key] = text
        return written

    @cached_property
    def _default_texts(self) -> dict[str, str]:
        """The default of each key that has one, as `repr` of what is written.

        Such values are left out of files.
        """
        usual = self.defaults()
        return {
            entry.key: repr(entry.kind.write(usual[entry.attribute]))
            for entry in self.fields
            if usual.get(entry.attribute) is not None
        }

    def defaults(self) -> dict[str, Any]:
        """Return the defaults of the model's class, by attribute."""
        if self.model is dict:
            return {}
        given = {f.name: f.default for f in fields(self.model) if f.default is not MISSING}
        made = {f.name: f.default_factory() for f in fields(self.model) if f.default_factory is not MISSING}
        return given | made


def table(
    model: type,
    kinds: Mapping[Any, Any],
    *,
    before: Mapping[str, Sequence[Field]] | None = None,
    **more: Any,
) -> Table:
    """Make the table that the fields of a dataclass declare.

    Args:
        model: the dataclass.
        kinds: for a name or a type the kind of its values, or a function that makes the kind from a `Key`.
        before: further keys of the file, by the key in front of which they stand; those at the end by "".
        more: other attributes of `Table`.
    """
    hints = get_type_hints(model)
    attributes = [_make_field(part, hints[part.name], kinds) for part in fields(model)]
    further = dict(before or {})
    filed: list[Field] = []
    for part, entry in zip(fields(model), attributes, strict=True):
        filed += further.pop(entry.key, ())
        filed += [entry] if part.metadata["key"].name else ()
    return Table(model, (*filed, *further.pop("", ())), tuple(attributes), **more)


def _make_field(part: Any, hint: Any, kinds: Mapping[Any, Any]) -> Field:
    """Return the `Field` of a dataclass field with the type `hint`; without a key it has the field's name."""
    told: Key = part.metadata["key"]
    return Field(
        told.name or part.name,
        _find_kind(told, hint, kinds),
        part.name,
        told.meaning,
        required=told.required or (part.default is MISSING and part.default_factory is MISSING),
        always=told.always,
        instead_of=told.instead_of,
    )


def _find_kind(told: Key, hint: Any, kinds: Mapping[Any, Any]) -> Kind:
    """Return the kind of a field's values, by its `Key.kind` or its type, from `kinds` or the usual ones."""
    types = [each for each in get_args(hint) or (hint,) if each is not NoneType]
    if told.kind or types[0] in kinds:
        found = kinds[told.kind or types[0]]
        kind: Kind = found if isinstance(found, Kind) else found(told)
        return Rows(kind) if get_origin(hint) is tuple and isinstance(kind, Table) else kind
    interval = Interval(told.range) if told.range else ANY
    if float in types:
        return Number(interval, degrees="_deg" in told.name, words=told.words)
    if int in types:
        return Integer(interval)
    if bool in types:
        return YesNo()
    return Choice(told.options) if told.options else Text()  # type: ignore[arg-type]


class Either(Kind):
    """One of several tables, told apart by their keys."""

    @property
    @abstractmethod
    def tables(self) -> Mapping[str, Table]:
        """The tables, by words that tell them apart, for the reference."""

    @property
    def fields(self) -> Sequence[Field]:  # type: ignore[override]
        return [entry for table in self.tables.values() for entry in (*table.fields, *table.attributes)]


@dataclass(frozen=True)
class Rows(Kind):
    """An array of tables, each under the same ``[[header]]``."""

    table: Table
    wanted = "an array of tables"

    @property
    def fields(self) -> Sequence[Field]:  # type: ignore[override]
        return self.table.fields

    def read(self, value: Any, place: Place) -> Any:
        if place.reading.python:
            if not isinstance(value, list | tuple):
                return place.refuse(f"must be a tuple of {self.table.model.__name__}, or a list", value)
        elif not isinstance(value, list):
            header = re.sub(r"\[\d+\]", "", place.path)
            return place.refuse(f"must be an array of tables, each under [[{header}]]", value)
        read = tuple(self.table.read(row, place[i]) for i, row in enumerate(value))
        same = isinstance(value, tuple) and all(one is row for one, row in zip(read, value, strict=True))
        return value if same else read

    def write(self, value: Any) -> list[dict[str, Any]]:
        return [self.table.write(row) for row in value]
