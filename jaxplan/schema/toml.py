"""TOML as text: read with `tomllib` behind a guard, and written so that it is pleasant to read.

The guard refuses what `tomllib` has no bound for: its time grows with the square of a dotted key's length,
and it recurses into nested brackets. All numbers are written in full, so they read back with the same bits.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

from jaxplan.schema.faults import ScenarioError, quote, spell_key

LARGEST_FILE = 2**20  # bytes
_DEEPEST = 16  # brackets, or parts of a dotted key; a scenario needs four
_LONGEST_WORD = 1000  # characters of a bare key or a number
_WIDEST_LINE = 100

_TOKENS = re.compile(
    r"""(?P<skip> \"{3}(?:[^\\]|\\.)*?(?:\"{3,5}|\\?\Z) | '{3}.*?(?:'{3,5}|\Z) # strings over many lines
      | "(?:[^"\\\n]|\\[^\n])*"? | '[^'\n]*'? | \#[^\n]*)                     # strings on one line, comments
      | (?P<open>[\[{]) | (?P<close>[\]}]) | (?P<dot>\.) | (?P<end>[=,\n])
      | (?P<word>[A-Za-z0-9_+-]+)""",
    re.DOTALL | re.VERBOSE,
)


def parse(text: str) -> dict[str, Any]:
    """The document as nested dicts and lists.

    Raises:
        ScenarioError: where the text is no TOML, or no document of sane size, with line and column.
    """
    if len(text) > LARGEST_FILE:
        raise too_large()
    _refuse_bombs(text)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
    found = re.fullmatch(r"(.*) \(at line (\d+), column (\d+)\)", message, re.DOTALL)
    if found:
        raise ScenarioError([f"line {found[2]}, column {found[3]}: not TOML, {_uncapitalised(found[1])}"])
    reason = message.removesuffix(" (at end of document)")
    raise ScenarioError([f"{_position(text, len(text))}: not TOML, {_uncapitalised(reason)}"])


def too_large() -> ScenarioError:
    """The error for a file that is too large to be a scenario or a plan."""
    return ScenarioError([f"larger than {LARGEST_FILE >> 20} MiB, which no scenario is"])


def _refuse_bombs(text: str) -> None:
    """Raise where brackets or dotted keys are too deep, or a word too long, for `tomllib` to cope."""
    depth = dots = 0
    for token in _TOKENS.finditer(text):
        kind = token.lastgroup
        if kind == "open":
            depth += 1
        elif kind == "close":
            depth -= 1
        elif kind == "dot":
            dots += 1
        elif kind == "end":
            dots = 0
        if depth > _DEEPEST or dots > _DEEPEST:
            raise ScenarioError([f"{_position(text, token.start())}: nested more than {_DEEPEST} deep"])
        if kind == "word" and token.end() - token.start() > _LONGEST_WORD:
            raise ScenarioError([f"{_position(text, token.start())}: longer than {_LONGEST_WORD} characters"])


def _position(text: str, index: int) -> str:
    """Line and column, counted from one."""
    return f"line {text.count(chr(10), 0, index) + 1}, column {index - text.rfind(chr(10), 0, index)}"


def _uncapitalised(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]


def write(document: Mapping[str, Any]) -> str:
    """The document as text.

    Args:
        document: values, then tables and arrays of tables, which may hold arrays of tables in turn.

    Returns:
        text that `parse` reads back with the same bits in every number.
    """
    return "\n\n".join(_blocks(document, "", "")) + "\n"


def _blocks(table: Mapping[str, Any], path: str, header: str) -> Iterator[str]:
    """A table's own lines, then a block for each table in it; a dict below the top is written in line."""
    lines = [header] if header else []
    inner: list[tuple[str, Any]] = []
    for key, value in table.items():
        rows = isinstance(value, list) and value and all(isinstance(item, dict) for item in value)
        if rows or (isinstance(value, dict) and not path):
            inner.append((key, value))
        else:
            lines.append(f"{spell_key(key)} = {value_text(value)}")
    yield "\n".join(lines)
    for key, value in inner:
        name = f"{path}.{spell_key(key)}".lstrip(".")
        if isinstance(value, dict):
            yield from _blocks(value, name, f"[{name}]")
        else:
            for row in value:
                yield from _blocks(row, name, f"[[{name}]]")


def value_text(value: Any) -> str:
    """A value as the right side of a line says it."""
    if isinstance(value, str):
        return quote(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{spell_key(key)} = {value_text(item)}' for key, item in value.items())} }}"
    if not isinstance(value, list):
        return repr(value)
    items = [value_text(item) for item in value]
    line = f"[{', '.join(items)}]"
    if len(line) <= _WIDEST_LINE and not any(isinstance(item, list | dict) for item in value):
        return line
    return "[\n" + "".join(f"    {item},\n" for item in items) + "]"
