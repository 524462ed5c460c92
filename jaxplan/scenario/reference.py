"""What there is to say about each key of a scenario file: value, unit, range, default and meaning.

All of it comes from the layout by which files are read. The manual shows it as tables, the template of a new
file as comments.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from jaxplan.scenario import toml
from jaxplan.scenario.tables import Either, Field, Rows, Table

_UNITS = {
    "_deg_s3": "deg/s³",
    "_deg_s2": "deg/s²",
    "_deg_s": "deg/s",
    "_deg": "deg",
    "_rad_s": "rad/s",
    "_rad": "rad",
    "_kg_m2": "kg m²",
    "_km": "km",
    "_nms": "N m s",
    "_nm": "N m",
    "_s": "s",
}


@dataclass(frozen=True)
class Entry:
    """A key of a table in words.

    Attributes:
        key: as the file spells it.
        value: what it must be, without its range.
        unit: that stands in the key; None if there is none.
        range: of its numbers, in the file's unit; None where there is none.
        required: whether the key, or an alternative, must be there.
        always: whether files that are written have it at its default, too.
        alternatives: keys that say the same in another way.
        default: what an absent key stands for, as a file would say it; None where that is nothing.
        meaning: one line.
    """

    key: str
    value: str
    unit: str | None
    range: str | None
    required: bool
    always: bool
    alternatives: tuple[str, ...]
    default: str | None
    meaning: str


def entries(table: Table) -> Iterator[Entry]:
    """The keys of a table that hold values, in the order of writing; those of its inner tables are theirs."""
    meaning = ""
    for field in table.fields:
        meaning = meaning if field.meaning == "likewise" else field.meaning
        if isinstance(field.kind, Table | Rows):
            continue
        others = tuple(other.key for other in table.fields if other.says == field.says)
        yield Entry(
            key=field.key,
            value=field.kind.wanted.replace(f" in {field.kind.range}", ""),
            unit=unit_of(field.key),
            range=field.kind.range,
            required=field.required,
            always=field.always,
            alternatives=tuple(key for key in others if key != field.key),
            default=_default(table, field),
            meaning=meaning,
        )


def unit_of(key: str) -> str | None:
    """The unit that stands in a key; None if there is none."""
    return next((unit for ending, unit in _UNITS.items() if key.endswith(ending)), None)


def _default(table: Table, field: Field) -> str | None:
    default = table.defaults().get(field.attribute)
    if field.required or default is None or default in ((), {}):
        return None
    return toml.value_text(field.kind.write(default))


def inner_table(table: Table, key: str) -> tuple[Table, str]:
    """The table under a key of another, or of its rows, and what that is; of several the first.

    Raises:
        KeyError: if there is none.
    """
    for field in table.fields:
        if field.key == key:
            kind = field.kind
            if isinstance(kind, Rows):
                return kind.table, field.meaning
            if isinstance(kind, Either):
                return next(iter(kind.tables.values())), field.meaning
            if isinstance(kind, Table):
                return kind, field.meaning
    raise KeyError(key)
