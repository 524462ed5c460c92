"""All there is to say about the keys of a scenario: reference, template, and names in Python.

What there is to say about each key of a scenario file: value, unit, range, default and meaning.

All of it comes from the layout by which files are read. The manual shows it as tables, the template of a new
file as comments.

How faults of a scenario that was made in Python are told: by its attributes, with numbers in its units.

What a file calls ``keep_out[0].half_angle_deg = 401`` is ``keep_out[0].half_angle = 7.0 rad``, and must lie
in a range of radians. Names and units follow from the layout.

A commented scenario file to begin with: a scene, and every option with its meaning, unit and range.

The scene and examples of what has no default stand in ``template.toml``; its comments say what belongs to the
scene. All that is said of a key, and the settings with their defaults, come from the layout of the file.
"""

import math
import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files

from jaxplan.model.keys import unit_of
from jaxplan.runtime.arguments import show
from jaxplan.schema import toml
from jaxplan.schema.faults import Reading, Spelled, spell_path
from jaxplan.schema.kinds import Kind
from jaxplan.schema.layout import SCENARIO
from jaxplan.schema.tables import Either, Field, Rows, Table

_RAISED = str.maketrans("23", "²³", "^")


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
    for field in table.fields:
        if isinstance(field.kind, Table | Rows):
            continue
        others = tuple(other.key for other in table.fields if other.says == field.says)
        yield Entry(
            key=field.key,
            value=field.kind.wanted.replace(f" in {field.kind.range}", ""),
            unit=unit_of(field.key).translate(_RAISED) or None,
            range=field.kind.range,
            required=field.required,
            always=field.always,
            alternatives=tuple(key for key in others if key != field.key),
            default=_default(table, field),
            meaning=field.meaning,
        )


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


class PythonReading(Reading):
    """A scenario that was made in Python is read: faults are told by attributes, in the model's units."""

    python = True
    root = "the scenario"

    def spelled(self, steps: Sequence[str | int]) -> Spelled:
        """The attributes that keys stand for, with the unit in which Python has their numbers."""
        kind: Kind = SCENARIO
        path: list[str | int] = []
        unit = ""
        for step in steps:
            entry = next((entry for entry in kind.fields if step in (entry.key, entry.held)), None)
            if entry is None:
                path.append(step)
                continue
            path += (entry.held or entry.attribute).split(".")
            kind, unit = entry.kind, unit_of(entry.key)
        factor = math.pi / 180 if "deg" in unit else 1.0
        return Spelled(spell_path(path), unit.replace("deg", "rad").translate(_RAISED), factor)

    def show(self, value: object) -> str:
        """As Python spells it."""
        return show(value)


_COLUMN = 38  # where comments begin; a longer line has its comment above
_WIDTH = 118
_NO_BREAK = "\N{NO-BREAK SPACE}"

_HEADER = re.compile(r"(#?)\[+([\w.]+)\]+")
_LINE = re.compile(r"#?(\w+) = .*")


def template() -> str:
    """The text of a scenario file that can be planned as it is.

    Lines that begin with ``#`` and no blank are options. Each holds without the ``#``, too; of a block whose
    header is such a line, all together.
    """
    source = files("jaxplan.schema").joinpath("template.toml").read_text(encoding="utf-8")
    told: set[tuple[str, str]] = set()
    return "\n\n".join(_block(block, told) for block in source.strip().split("\n\n")) + "\n"


def _block(block: str, told: set[tuple[str, str]]) -> str:
    """Lines between blank ones, with all that the layout says of them.

    Args:
        block: of the source.
        told: tables and keys of which it was said before; those of this block are added.
    """
    sections = re.split(r"\n(?=#?\[)", block)
    return "\n".join(line for section in sections for line in _section(section.split("\n"), told))


def _section(lines: list[str], told: set[tuple[str, str]]) -> Iterator[str]:
    """A table's lines in the order of the layout, with the settings that the source leaves to it."""
    header = next((found for line in lines if (found := _HEADER.fullmatch(line))), None)
    path = header[2] if header else ""
    given = {found[1]: line for line in lines if (found := _LINE.fullmatch(line))}
    yield from (line for line in lines if line not in given.values() and not _HEADER.fullmatch(line))
    if not header and not given:
        return
    table, meaning = _table(path)
    if header:
        yield header[0] if (path, "") in told else _beside(header[0], meaning)
    whole = {entry.key: entry for entry in entries(table)}
    unknown = given.keys() - whole.keys()
    if unknown:
        raise KeyError(f"{path} has no {', '.join(sorted(unknown))}")
    for key, entry in whole.items():
        line = given.get(key)
        if line is None and (path, "") not in told and entry.default is not None:
            line = f"{'' if entry.always else '#'}{key} = {entry.default}"
        if line is not None:
            yield line if (path, key) in told else _beside(line, _comment(entry))
            told.add((path, key))
    told.add((path, ""))


def _table(path: str) -> tuple[Table, str]:
    """The table under a header, and what it is."""
    table, meaning = SCENARIO, ""
    for key in filter(None, path.split(".")):
        table, meaning = inner_table(table, key)
    return table, meaning


def _comment(entry: Entry) -> str:
    """What is to be said of a key."""
    unit = f", {entry.unit}" if entry.unit else ""
    interval = f" in {entry.range.replace(' ', _NO_BREAK)}" if entry.range else ""
    instead = f"; or {', '.join(entry.alternatives)}" if entry.alternatives else ""
    return f"{entry.meaning}; {entry.value}{unit}{interval}{instead}"


def _beside(line: str, comment: str) -> str:
    """A line with its comment to the right, going on below; above a line that is too long."""
    above = len(line) > _COLUMN - 2
    width = _WIDTH - 2 if above else _WIDTH - _COLUMN - 2
    first, *more = (f"# {part.replace(_NO_BREAK, ' ')}" for part in textwrap.wrap(comment, width))
    if above:
        return "\n".join([first, *more, line])
    return "\n".join([f"{line:{_COLUMN}}{first}", *(f"{'':{_COLUMN}}{rest}" for rest in more)])
