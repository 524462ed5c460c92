"""All there is to say about the keys of a scenario file, and a commented file to begin with.

It comes from the layout by which files are read: value, unit, range, default and meaning of each key. The
manual shows it as tables, the template as comments. The scene of the template and examples of what has no
default stand in ``template.toml``, whose comments say what belongs to the scene.
"""

import re
import textwrap
from collections.abc import Iterator
from importlib.resources import files

from jaxplan.schema import toml
from jaxplan.schema.layout import SCENARIO
from jaxplan.schema.tables import Either, Field, Rows, Table

_COLUMN = 38  # where comments begin; a longer line has its comment above
_WIDTH = 118
_NO_BREAK = "\N{NO-BREAK SPACE}"

_HEADER = re.compile(r"(#?)\[+([\w.]+)\]+")
_LINE = re.compile(r"#?(\w+) = .*")


def entries(table: Table) -> list[Field]:
    """The keys of a table that hold values, in the order of writing; those of its inner tables are theirs."""
    return [entry for entry in table.fields if not isinstance(entry.kind, Table | Rows)]


def alternatives(table: Table, entry: Field) -> list[str]:
    """Keys that may stand in the place of one."""
    return [other.key for other in table.fields if other.says == entry.says and other is not entry]


def default(table: Table, entry: Field) -> str | None:
    """What an absent key stands for, as a file would say it; None where that is nothing."""
    usual = table.defaults().get(entry.attribute)
    if entry.required or usual is None or usual in ((), {}):
        return None
    return toml.value_text(entry.kind.write(usual))


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
        usual = default(table, entry)
        if line is None and (path, "") not in told and usual is not None:
            line = f"{'' if entry.always else '#'}{key} = {usual}"
        if line is not None:
            yield line if (path, key) in told else _beside(line, _comment(table, entry))
            told.add((path, key))
    told.add((path, ""))


def _table(path: str) -> tuple[Table, str]:
    """The table under a header, of several the first, and what it is."""
    table, meaning = SCENARIO, ""
    for key in filter(None, path.split(".")):
        entry = next(entry for entry in table.fields if entry.key == key)
        kind, meaning = entry.kind, entry.meaning
        if isinstance(kind, Either):
            kind = next(iter(kind.tables.values()))
        table = kind.table if isinstance(kind, Rows) else kind  # type: ignore[assignment]
    return table, meaning


def _comment(table: Table, entry: Field) -> str:
    """What is to be said of a key."""
    unit = f", {entry.unit}" if entry.unit else ""
    interval = f" in {entry.kind.range.replace(' ', _NO_BREAK)}" if entry.kind.range else ""
    others = alternatives(table, entry)
    instead = f"; or {', '.join(others)}" if others else ""
    return f"{entry.meaning}; {entry.value}{unit}{interval}{instead}"


def _beside(line: str, comment: str) -> str:
    """A line with its comment to the right, going on below; above a line that is too long."""
    above = len(line) > _COLUMN - 2
    width = _WIDTH - 2 if above else _WIDTH - _COLUMN - 2
    first, *more = (f"# {part.replace(_NO_BREAK, ' ')}" for part in textwrap.wrap(comment, width))
    if above:
        return "\n".join([first, *more, line])
    return "\n".join([f"{line:{_COLUMN}}{first}", *(f"{'':{_COLUMN}}{rest}" for rest in more)])
