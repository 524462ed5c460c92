"""How results are displayed: as one line in a console, as a small table in a notebook, and in which colours.

Debuggers ask for line and table, even for objects that are half made or hold values traced by JAX. So
displaying never raises and never needs a traced value; what cannot be shown is a question mark. Angles are in
degrees.

A *quantity* is an attribute to be shown, with its unit. Colours of devices and zones are the same in figures,
viewer and exports.
"""

import math
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from html import escape
from itertools import islice
from numbers import Integral, Real
from pathlib import PurePath
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np
from jax.core import Tracer

T = TypeVar("T")
Rows = Iterable[tuple[str, str]]
Cells = Sequence[Sequence[str]]

UNKNOWN = "?"
COLOURS = (
    *("#0072B2", "#E69F00", "#882255", "#56B4E9", "#332288", "#117733"),
    *("#CC79A7", "#9F00FF", "#A9A960", "#4C004C", "#9F66FF"),
)
"""Colours of devices, in the order of a spacecraft's devices; told apart by the colour-blind, too."""
KEEP_OUT, KEEP_IN = "#B2182B", "#1B7837"
"""Colours of zones to stay out of, and of zones to stay in."""
_LONGEST_LINE = 200  # characters of a line
_LONGEST_HEADING = 80  # characters of the heading of a line or table
_LONGEST_ITEM = 60  # characters of a label or value on a line
_LONGEST_VALUE = 500  # characters of a value in a table
_LONGEST_TABLE = 5300  # characters of a table's rows, tags included
_MOST_LISTED = 12  # numbers of an array that are shown one by one


def shown(*quantities: str, heading: str | None = None) -> Callable[[type[T]], type[T]]:
    """Decorate a class so that it has a short `repr` and a table for notebooks.

    Args:
        quantities: what is shown, the most important first: names of attributes, also of attributes of
            attributes, each with its unit after a blank, as in "trajectory.duration s", which is labelled
            "duration". Without a unit, a field with a ``key`` in its metadata has the key's unit. Where the
            unit contains "deg", radians are converted to degrees. If there are none, all fields of a
            dataclass are shown.
        heading: a format string for the object, as in "Plan of {0.scenario.name}"; None for the name of the
            class and, where it has one, the object's own.

    A line leaves out what is None, empty, or has its default value. If the class has its own ``_repr_html_``
    or ``__str__``, these are kept, and replaced by the quantities only where they raise.

    Example:
        >>> @shown("half_angle deg", "devices")
        ... @dataclass(frozen=True)
        ... class Cone: ...
    """

    def dressed(cls: type[T]) -> type[T]:
        def line(self: T) -> str:
            return _format_line(_heading(self, heading), _read_quantities(self, quantities))

        def table(self: T) -> str:
            return as_table(_heading(self, heading), _table_rows(_read_quantities(self, quantities)))

        told = {name: getattr(cls, name, None) for name in ("__str__", "_repr_html_")}
        own = {name: tell for name, tell in told.items() if tell not in (None, object.__str__)}
        for name, tell in ({"__repr__": line, "_repr_html_": table} | own).items():
            setattr(cls, name, _with_fallback(tell, table if name == "_repr_html_" else line))
        return cls

    return dressed


def _with_fallback(tell: Callable[[T], str], otherwise: Callable[[T], str]) -> Callable[[T], str]:
    """Return a function that shows an object by `tell`, or by `otherwise` if that raises; it never warns."""

    def told(self: T) -> str:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                return tell(self)
            except Exception:
                return otherwise(self)

    return told


def aligned(rows: Rows) -> list[str]:
    """Return lines of text for pairs of label and value, with the values aligned."""
    pairs = list(rows)
    width = max(len(label) for label, _ in pairs)
    return [f"{label:<{width}}  {value}" for label, value in pairs]


def in_columns(rows: Cells, sides: str) -> list[str]:
    """Return lines of text for a table, with aligned columns.

    Args:
        rows: rows of cells, all of the same length; the first one may be a head.
        sides: a character for each column: "<" aligns left, as for text, ">" aligns right, as for numbers.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            f"{cell:{side}{width}}" for cell, side, width in zip(row, sides, widths, strict=True)
        ).rstrip()
        for row in rows
    ]


def as_table(caption: str, rows: Rows, cells: Cells = ()) -> str:
    """Return a table for notebooks as HTML, in the colours of the page that it is on.

    Args:
        caption: above the table.
        rows: pairs of label and value, one a line.
        cells: a second table below, row by row, the first row its head.

    Returns:
        HTML of fewer than 6,000 characters; rows beyond that are left out, and the last one says how many.
    """
    left = "style='text-align:left'"
    across = f" colspan='{len(cells[0]) - 1}'" if cells else ""
    lines = [
        f"<tr><th {left}>{_escape_html(label, _LONGEST_HEADING)}</th>"
        f"<td{across} {left}>{_escape_html(value)}</td></tr>"
        for label, value in rows
    ]
    for number, row in enumerate(cells):
        tag = "td" if number else "th"
        values = "".join(f"<{tag}>{_escape_html(cell)}</{tag}>" for cell in row[1:])
        lines.append(f"<tr><th {left}>{_escape_html(row[0])}</th>{values}</tr>")
    kept = _take_fitting(lines, _LONGEST_TABLE)
    if len(kept) < len(lines):
        kept.append(f"<tr><th></th><td{across} {left}>and {len(lines) - len(kept)} more rows</td></tr>")
    return f"<table><caption>{_escape_html(caption, _LONGEST_HEADING)}</caption>{''.join(kept)}</table>"


class _Quantity(NamedTuple):
    """A labelled value of an object as text, its unit, and whether it is the default (`usual`)."""

    label: str
    text: str
    unit: str
    usual: bool


def _heading(thing: Any, form: str | None) -> str:
    """Return the heading of a line or table: by the format `form`, or class and name; class if that fails."""
    kind = type(thing).__name__
    try:
        if form is not None:
            return _to_one_line(form.format(thing))
        name = getattr(thing, "name", None)
        return _to_one_line(f"{kind} {name}") if isinstance(name, str) else kind
    except Exception:
        return kind


def _read_quantities(thing: Any, wanted: Sequence[str]) -> list[_Quantity]:
    """Return the quantities of an object, without those that are None or empty; `wanted` as for `shown`."""
    own = {field.name: field for field in fields(thing)} if is_dataclass(thing) else {}
    found = []
    for entry in wanted or own:
        path, _, unit = entry.partition(" ")
        label = path.rpartition(".")[2].replace("_", " ")
        if path in own:
            unit = unit or getattr(own[path].metadata.get("key"), "unit", "")
        try:
            value = thing
            for name in path.split("."):
                value = None if value is None else getattr(value, name)
            if value is None or (isinstance(value, Mapping | Sequence) and len(value) == 0):
                continue
            text, measured = _value_text(value, unit)
            plain = path in own and isinstance(value, bool | int | float | str)
            usual = plain and bool(value == own[path].default)
            found.append(_Quantity(label, text, unit if measured else "", usual))
        except Exception:
            found.append(_Quantity(label, UNKNOWN, "", False))
    return found


def _format_line(heading: str, quantities: Sequence[_Quantity]) -> str:
    """Return a line ``<heading: label value unit; ...>`` without defaults, at most `_LONGEST_LINE` long."""
    told = [quantity for quantity in quantities if not quantity.usual]
    items = [
        f"{_truncate(one.label, _LONGEST_ITEM)} {_truncate(one.text, _LONGEST_ITEM)} {one.unit}".rstrip()
        for one in told
    ]
    if quantities and not told:
        items = ["all by default"]
    start = _truncate(heading, _LONGEST_HEADING)
    kept = _take_fitting([f"; {item}" for item in items], _LONGEST_LINE - len(start) - len("<; ...>"))
    if len(kept) < len(items):
        kept.append("; ...")
    return f"<{start}{':' * bool(kept)}{''.join(kept).removeprefix(';')}>"


def _table_rows(quantities: Sequence[_Quantity]) -> Rows:
    """Yield label and value of each row of a table; defaults come last and are marked as such."""
    for one in sorted(quantities, key=lambda one: one.usual):
        label = f"{one.label} ({one.unit})" if one.unit else one.label
        yield label, f"{one.text} (default)" if one.usual else one.text


def _value_text(value: Any, unit: str) -> tuple[str, bool]:
    """Return a value as text, and whether that is of numbers, so that the unit is to be shown."""
    if isinstance(value, Tracer):
        return f"traced {value.dtype}{list(value.shape)}", False
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no", False
    if isinstance(value, Enum):
        return value.name, False
    if isinstance(value, np.datetime64):
        text = str(value)
        return text.rstrip("0").rstrip(".") if "." in text else text, False
    if isinstance(value, str | PurePath):
        return _to_one_line(str(value)), False
    if isinstance(value, Real):
        return _format_number(value, unit), True
    if isinstance(value, np.ndarray | jax.Array):
        return _array_text(np.asarray(value), unit)
    if hasattr(value, "shape") and hasattr(value, "dtype"):  # what stands for an array, as in jax.eval_shape
        return f"{value.dtype}{list(value.shape)}", False
    if isinstance(value, Mapping):
        parts = [f"{key} {_value_text(part, '')[0]}" for key, part in islice(value.items(), _MOST_LISTED)]
        return _to_one_line(", ".join(parts + ["..."] * (len(value) > _MOST_LISTED))), False
    if isinstance(value, Sequence):
        return _sequence_text(value, unit)
    if hasattr(type(value), "_repr_html_"):
        return repr(value), False
    return type(value).__name__, False


def _format_number(value: Any, unit: str, digits: int = 6) -> str:
    """Format a number with some digits, integers with all; radians as degrees if the unit contains "deg"."""
    if isinstance(value, Integral) and "deg" not in unit:
        return f"{int(value)}"
    factor = 180 / math.pi if "deg" in unit else 1.0
    return f"{float(value) * factor + 0.0:.{digits}g}"  # never a minus before zeros alone


def _array_text(array: np.ndarray, unit: str) -> tuple[str, bool]:
    """Return an array as text, and whether that is of numbers in the unit.

    Few numbers are listed, with semicolons between the rows of a matrix; else shape and range are given.
    """
    if array.ndim == 0 and array.dtype.kind in "biuf":
        return _value_text(array.item(), unit)
    size = " x ".join(map(str, array.shape))
    if array.dtype.kind == "b":
        return f"{size}, {int(np.sum(array))} true", False
    if array.dtype.kind not in "iuf":
        return f"{array.dtype} {size}", False
    if array.size <= _MOST_LISTED and (array.ndim == 1 or (array.ndim == 2 and array.size)):
        rows = [
            " ".join(_format_number(value, unit, 4) for value in row) for row in np.atleast_2d(array).tolist()
        ]
        return f"[{'; '.join(rows)}]", True
    finite = array[np.isfinite(array)]
    if finite.size < array.size:
        return f"{size}, {array.size - finite.size} not finite", False
    if not array.size:
        return size, False
    low, high = (_format_number(end, unit, 4) for end in (np.min(array).item(), np.max(array).item()))
    return f"{size}, {low} to {high}", True


def _sequence_text(values: Sequence[Any], unit: str) -> tuple[str, bool]:
    """Return a sequence as text, and whether that is of numbers; few items are listed, many counted."""
    few, many = list(values[: _MOST_LISTED + 1]), len(values) > _MOST_LISTED
    if not many and all(type(value) in (int, float) for value in few):
        return f"[{' '.join(_format_number(value, unit) for value in few)}]", True
    words = [value if isinstance(value, str) else getattr(value, "name", None) for value in few]
    if all(isinstance(word, str) for word in words):
        more = ", ..." if len(values) > len(words) else ""
        count = "" if all(isinstance(value, str) for value in few) and not more else f"{len(values)}: "
        return _to_one_line(f"{count}{', '.join(map(str, words))}{more}"), False
    if many:
        return f"{len(values)}", False
    kinds = Counter(type(value).__name__ for value in few)
    return ", ".join(f"{count} {kind}" for kind, count in kinds.items()), False


def _to_one_line(text: str) -> str:
    """Return a text on one line, with question marks for characters that cannot be printed."""
    return "".join(c if c.isprintable() else UNKNOWN for c in " ".join(text[:2000].split()))


def _truncate(text: str, most: int) -> str:
    """Cut a text to at most `most` characters; "..." replaces its end."""
    if len(text) <= most:
        return text
    end = "...>" if text.startswith("<") and text.endswith(">") else "..."
    return f"{text[: most - len(end)]}{end}"


def _escape_html(text: str, most: int = _LONGEST_VALUE) -> str:
    """Return a text on one line, of at most `most` characters, then escaped for HTML."""
    return escape(_truncate(_to_one_line(text), most))


def _take_fitting(parts: Sequence[str], most: int) -> list[str]:
    """Return the first parts, as many as have at most `most` characters together."""
    kept: list[str] = []
    for part in parts:
        most -= len(part)
        if most < 0:
            break
        kept.append(part)
    return kept
