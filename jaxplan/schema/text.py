"""Scenario files as text: TOML read and written, and a commented file to begin with.

TOML is read with `tomllib` behind a guard, which refuses what `tomllib` does not bound: its time grows with
the square of a dotted key's length, and it recurses into nested brackets. All numbers are written in full, so
they read back with the same bits.

Everything that is said about keys comes from the layout by which files are read: value, unit, range, default
and meaning of each. The manual shows it as tables, the template as comments. The scene of the template, and
examples for keys without default, are in ``template.toml``, whose own comments describe the scene.
"""

import re
import textwrap
import tomllib
from calendar import monthrange
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.resources import files
from typing import Any

from jaxplan.schema.faults import ScenarioError, quote, spell_key
from jaxplan.schema.layout import SCENARIO
from jaxplan.schema.tables import Either, Field, Rows, Table

LARGEST_FILE = 2**20  # bytes
LARGEST_TIMELINE = 2**26  # bytes; the path of a neighbour takes 0.8 MB for a day
_MAX_DEPTH = 16  # most nested brackets, or dots in a key; a scenario needs four
_LONGEST_WORD = 1000  # most characters of a bare key or a number
_WIDEST_LINE = 100  # characters; a longer array is written with an item a line

_TOKEN_PATTERN = re.compile(
    r"""(?P<skip> \"{3}(?:[^\\]|\\.)*?(?:\"{3,5}|\\?\Z) | '{3}.*?(?:'{3,5}|\Z) # strings over many lines
      | "(?:[^"\\\n]|\\[^\n])*"? | '[^'\n]*'? | \#[^\n]*)                     # strings on one line, comments
      | (?P<open>[\[{]) | (?P<close>[\]}]) | (?P<dot>\.) | (?P<end>[=,\n])
      | (?P<word>[A-Za-z0-9_+-]+)""",
    re.DOTALL | re.VERBOSE,
)

_COMMENT_COLUMN = 38  # column in which comments begin; a longer line has its comment above
_LINE_WIDTH = 118  # most characters of a line with its comment
_NO_BREAK = "\N{NO-BREAK SPACE}"

_HEADER_PATTERN = re.compile(r"(#?)\[+([\w.]+)\]+")
# A line whose value is meant as a date, or a date-time.
_DATE_PATTERN = re.compile(r"[^=]*=\s*(\d{4})-(\d{1,2})-(\d{1,2})(?:[T ](\d{1,2}):(\d{1,2})(?::(\d{1,2}))?)?")
_WORD_PATTERN = re.compile(r"[A-Za-z_][\w .-]*")  # text without quotes
_BOOLEANS = {"yes": "true", "on": "true", "true": "true", "no": "false", "off": "false", "false": "false"}
_ENTRY_PATTERN = re.compile(r"#?(\w+) = .*")


def parse(text: str, largest: int = LARGEST_FILE) -> dict[str, Any]:
    """Parse a TOML document of at most `largest` characters; returns nested dicts and lists.

    Raises:
        ScenarioError: if the text is no TOML, with line and column, or too large or too deep.
    """
    if len(text) > largest:
        raise too_large(largest)
    _refuse_bombs(text)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
    found = re.fullmatch(r"(.*) \(at line (\d+), column (\d+)\)", message, re.DOTALL)
    if found:
        advice = _advice(text.split("\n")[int(found[2]) - 1], int(found[3]) - 1)
        told = f"line {found[2]}, column {found[3]}: not TOML, {_uncapitalised(found[1])}{advice}"
        raise ScenarioError([told])
    reason = message.removesuffix(" (at end of document)")
    raise ScenarioError([f"{_position(text, len(text))}: not TOML, {_uncapitalised(reason)}"])


def _advice(line: str, index: int) -> str:
    """Return words on what may be meant by a line that is no TOML from an index on, to end a message.

    They are empty if there is no advice.
    """
    dated = _DATE_PATTERN.match(line)
    if dated is not None:
        return _date_advice(dated)
    word = _WORD_PATTERN.match(line[index:])
    if word is None or not line[:index].rstrip().endswith(("=", "[", ",")):
        return ""
    told = word[0].strip()
    meant = _BOOLEANS.get(told.lower())
    return f"; perhaps {meant} is meant" if meant else f"; text needs quotes, {quote(told)}"


def _date_advice(dated: re.Match[str]) -> str:
    """Return words on a date or date-time that is no TOML, to end a message.

    They name the part that does not exist, such as a month 13, or else the form; a date-time without seconds
    is no TOML either.
    """
    year, month, day, hour, minute, second = (None if own is None else int(own) for own in dated.groups())
    wrong = ""
    if month is not None and not 1 <= month <= 12:
        wrong = f"there is no month {month}"
    elif year and month and day is not None and not 1 <= day <= monthrange(year, month)[1]:
        wrong = f"{year}-{month:02d} has no day {day}"
    else:
        parts = (("hour", hour, 23), ("minute", minute, 59), ("second", second, 59))
        wrong = next((f"there is no {name} {n}" for name, n, most in parts if n is not None and n > most), "")
    return f"; {wrong or 'a date-time is written as 2026-01-01T00:00:00, with its seconds'}"


def too_large(largest: int = LARGEST_FILE) -> ScenarioError:
    """Make the error for a file that is larger than so many bytes."""
    what = "scenario" if largest == LARGEST_FILE else "timeline"
    return ScenarioError([f"larger than {largest >> 20} MiB, which no {what} is"])


def _refuse_bombs(text: str) -> None:
    """Raise ScenarioError if brackets or dotted keys are too deep, or a word too long, for `tomllib`."""
    depth = dots = 0
    for token in _TOKEN_PATTERN.finditer(text):
        kind = token.lastgroup
        if kind == "open":
            depth += 1
        elif kind == "close":
            depth -= 1
        elif kind == "dot":
            dots += 1
        elif kind == "end":
            dots = 0
        if depth > _MAX_DEPTH or dots > _MAX_DEPTH:
            raise ScenarioError([f"{_position(text, token.start())}: nested more than {_MAX_DEPTH} deep"])
        if kind == "word" and token.end() - token.start() > _LONGEST_WORD:
            raise ScenarioError([f"{_position(text, token.start())}: longer than {_LONGEST_WORD} characters"])


def _position(text: str, index: int) -> str:
    """Return text of line and column, counted from one, of an index into a text."""
    return f"line {text.count(chr(10), 0, index) + 1}, column {index - text.rfind(chr(10), 0, index)}"


def _uncapitalised(sentence: str) -> str:
    """Return a sentence with its first letter in lower case."""
    return sentence[:1].lower() + sentence[1:]


def write(document: Mapping[str, Any]) -> str:
    """Write a document as TOML.

    Args:
        document: values, then tables and arrays of tables, which may themselves contain arrays of tables.

    Returns:
        Text that `parse` reads back with the same bits in every number.
    """
    return "\n\n".join(_write_blocks(document, "", "", value_text)) + "\n"


def _write_blocks(
    table: Mapping[str, Any], path: str, header: str, spell: Callable[[Any], str]
) -> Iterator[str]:
    """Yield the lines of a table itself, then a block for each table in it.

    A dict that is not at the top is written as an inline table.

    Args:
        table: the table.
        path: dotted keys that lead to it.
        header: its first line; empty for none.
        spell: returns the text of a value.
    """
    lines = [header] if header else []
    inner: list[tuple[str, Any]] = []
    for key, value in table.items():
        rows = isinstance(value, list) and value and all(isinstance(item, dict) for item in value)
        if rows or (isinstance(value, dict) and not path):
            inner.append((key, value))
        else:
            lines.append(f"{spell_key(key)} = {spell(value)}")
    yield "\n".join(lines)
    for key, value in inner:
        name = f"{path}.{spell_key(key)}".lstrip(".")
        if isinstance(value, dict):
            yield from _write_blocks(value, name, f"[{name}]", spell)
        else:
            for row in value:
                yield from _write_blocks(row, name, f"[[{name}]]", spell)


def value_text(value: Any) -> str:
    """Return a value as TOML, for the right side of a line; a long array takes several lines."""
    if isinstance(value, str):
        return quote(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return _inline_table(value, value_text)
    if not isinstance(value, list):
        return repr(value)
    items = [value_text(item) for item in value]
    line = f"[{', '.join(items)}]"
    if len(line) <= _WIDEST_LINE and not any(isinstance(item, list | dict) for item in value):
        return line
    inner = (item.replace("\n", "\n    ") for item in items)
    return "[\n" + "".join(f"    {item},\n" for item in inner) + "]"


def entries(table: Table) -> list[Field]:
    """Return the keys of a table that hold values, in the order of writing, without its inner tables."""
    return [entry for entry in table.fields if not isinstance(entry.kind, Table | Rows)]


def alternatives(table: Table, entry: Field) -> list[str]:
    """Return the keys that may stand for a given one."""
    return [other.key for other in table.fields if other.says == entry.says and other is not entry]


def default(table: Table, entry: Field) -> str | None:
    """Return the default of a key, as TOML; None if it has none, or an empty one."""
    usual = table.defaults().get(entry.attribute)
    if entry.required or usual is None or usual in ((), {}):
        return None
    return value_text(entry.kind.write(usual))


def template(source: str = "template.toml", layout: Table = SCENARIO) -> str:
    """Make the text of a scenario file, or of another layout, that can be planned as it is.

    Lines that begin with ``#`` without a blank are options: each is valid without the ``#``, too. If the
    header of a block is such a line, the ``#`` must be removed from the whole block.

    Args:
        source: name of the file with the scene.
        layout: layout of the file.
    """
    return _add_comments(files("jaxplan.schema").joinpath(source).read_text(encoding="utf-8"), layout)


def commented(document: Mapping[str, Any], layout: Table = SCENARIO) -> str:
    """Write a document as TOML, with a comment on each key at its first occurrence, as a template has them.

    Args:
        document: tables and values with the keys of the layout.
        layout: layout of the file.
    """
    return _add_comments("\n\n".join(_write_blocks(document, "", "", _line_text)), layout)


def _line_text(value: Any) -> str:
    """Return a value as TOML on one line, however long."""
    if isinstance(value, dict):
        return _inline_table(value, _line_text)
    return f"[{', '.join(map(_line_text, value))}]" if isinstance(value, list) else value_text(value)


def _inline_table(table: Mapping[str, Any], spell: Callable[[Any], str]) -> str:
    """Return a dict as an inline table of TOML; `spell` returns the text of a value."""
    return f"{{ {', '.join(f'{spell_key(key)} = {spell(item)}' for key, item in table.items())} }}"


def _add_comments(text: str, layout: Table) -> str:
    """Add comments from the layout to a text that has one value on each line."""
    told: set[tuple[str, str]] = set()
    return "\n\n".join(_comment_block(block, layout, told) for block in text.strip().split("\n\n")) + "\n"


def _comment_block(block: str, layout: Table, told: set[tuple[str, str]]) -> str:
    """Add comments from the layout to a block of lines between blank ones.

    Args:
        block: the block of the source.
        layout: layout of the file.
        told: pairs of table and key that have had their comment; those of this block are added.
    """
    sections = re.split(r"\n(?=#?\[)", block)
    return "\n".join(
        line for section in sections for line in _comment_section(section.split("\n"), layout, told)
    )


def _comment_section(lines: list[str], layout: Table, told: set[tuple[str, str]]) -> Iterator[str]:
    """Yield a table's lines in the order of the layout, adding settings that the source does not have.

    Args:
        lines: lines of the source, with or without the header.
        layout: layout of the file.
        told: see `_comment_block`.

    Raises:
        KeyError: if the table does not have a key of the source.
    """
    header = next((found for line in lines if (found := _HEADER_PATTERN.fullmatch(line))), None)
    path = header[2] if header else ""
    given = {found[1]: line for line in lines if (found := _ENTRY_PATTERN.fullmatch(line))}
    yield from (line for line in lines if line not in given.values() and not _HEADER_PATTERN.fullmatch(line))
    if not header and not given:
        return
    table, meaning = table_at(path, layout, given)
    if header:
        yield header[0] if (path, "") in told else _attach_comment(header[0], meaning)
    inline = [entry for entry in table.fields if entry.key in given]  # tables may be written as values
    whole = {entry.key: entry for entry in table.fields if entry in inline or entry in entries(table)}
    unknown = given.keys() - whole.keys()
    if unknown:
        raise KeyError(f"{path} has no {', '.join(sorted(unknown))}")
    for key, entry in whole.items():
        line = given.get(key)
        usual = default(table, entry)
        if line is None and (path, "") not in told and usual is not None:
            line = f"{'' if entry.always else '#'}{key} = {usual}"
        if line is not None:
            yield line if (path, key) in told else _attach_comment(line, comment_on(table, entry))
            told.add((path, key))
    told.add((path, ""))


def table_at(path: str, layout: Table, given: Iterable[str]) -> tuple[Table, str]:
    """Return the table under a dotted header, and its meaning.

    Args:
        path: the header without brackets; empty for the top.
        layout: layout of the file.
        given: keys that are used; of alternative tables the first that has all of them is taken.
    """
    table, meaning = layout, ""
    for key in filter(None, path.split(".")):
        entry = next(entry for entry in table.fields if entry.key == key)
        kind, meaning = entry.kind, entry.meaning
        if isinstance(kind, Either):
            several = list(kind.tables.values())
            knowing = (one for one in several if {*given} <= {each.key for each in one.fields})
            kind = next(knowing, several[0])
        table = kind.table if isinstance(kind, Rows) else kind  # type: ignore[assignment]
    return table, meaning


def comment_on(table: Table, entry: Field) -> str:
    """Return the comment on a key: meaning, what it must be, unit, range, and keys that may stand for it."""
    unit = f", {entry.unit}" if entry.unit else ""
    interval = f" in {entry.kind.range.replace(' ', _NO_BREAK)}" if entry.kind.range else ""
    others = alternatives(table, entry)
    instead = f"; or {', '.join(others)}" if others else ""
    return f"{entry.meaning}; {entry.value}{unit}{interval}{instead}"


def _attach_comment(line: str, comment: str) -> str:
    """Put a comment to the right of a line, wrapped downwards, or above the line if that is too long."""
    above = len(line) > _COMMENT_COLUMN - 2
    width = _LINE_WIDTH - 2 if above else _LINE_WIDTH - _COMMENT_COLUMN - 2
    first, *more = (f"# {part.replace(_NO_BREAK, ' ')}" for part in textwrap.wrap(comment, width))
    if above:
        return "\n".join([first, *more, line])
    return "\n".join(
        [f"{line:{_COMMENT_COLUMN}}{first}", *(f"{'':{_COMMENT_COLUMN}}{rest}" for rest in more)]
    )
