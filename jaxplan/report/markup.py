"""HTML in which text stays text: whatever is not `Markup` already is escaped when it is put into a tag."""

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np

NONE = "\N{EN DASH}"
_VOID = ("img", "meta")
_NARROW = 3  # number of columns up to which a table is not spread over the page
_MOST_TILES = 5  # cards that have room beside each other
Row = Sequence[Any]


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def tag(name: str, *content: Any, **attributes: str | None) -> Markup:
    """An HTML element.

    Args:
        name: of the tag.
        content: what is in it, in order; all but `Markup` is escaped.
        attributes: by name, escaped; a name that Python or this function uses itself ends in an underscore,
            and an attribute that is None is left out.
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    if name in _VOID:
        return Markup(f"<{name}{given}>")
    return Markup(f"<{name}{given}>{join(content)}</{name}>")


def join(content: Iterable[Any]) -> Markup:
    """Join pieces of text, of which all but `Markup` is escaped."""
    return Markup("".join(part if isinstance(part, Markup) else escape(str(part)) for part in content))


def number(value: float | None, digits: int = 2) -> str:
    """Text of a number with `digits` after the point, a dash for None; never a minus before zeros alone."""
    if value is None:
        return NONE
    if not math.isfinite(value):
        return "not finite"
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "\N{MINUS SIGN}")


def share(value: float) -> str:
    """Text of a ratio in percent, without the sign."""
    return number(100 * value, 1)


def degrees(angle: Any, digits: int = 2) -> str:
    """Text of an angle, rad, in degrees, with `digits` after the point."""
    return number(float(np.rad2deg(angle)), digits)


def table(titles: Sequence[str], rows: Iterable[Row], caption: str, marked: int | None = None) -> Markup:
    """A table whose first column names its rows.

    Args:
        titles: of the columns, from left to right. One of numbers, which stand to the right, digit under
            digit, is followed by "|" and their unit, as in "Rate|deg/s", or "|" alone.
        rows: as many cells each.
        caption: over it.
        marked: number of a row to set off from the others.
    """
    heads, looks = [], []
    for text in titles:
        title, numeric, unit = text.partition("|")
        looks.append("number" if numeric else None)
        beside = [tag("span", unit, class_="unit")] * bool(unit)
        heads.append(tag("th", title, *beside, scope="col", class_=looks[-1]))
    lines = []
    for index, row in enumerate(rows):
        (_, first), *others = zip(looks, row, strict=True)
        cells = [tag("th", first, scope="row"), *(tag("td", cell, class_=look) for look, cell in others)]
        lines.append(tag("tr", *cells, class_="marked" if index == marked else None))
    parts = (tag("caption", caption), tag("thead", tag("tr", *heads)), tag("tbody", *lines))
    look = "narrow" if len(titles) <= _NARROW else None
    return tag("div", tag("table", *parts, class_=look), class_="scroll")


def facts(rows: Iterable[tuple[str, Any]], caption: str) -> Markup:
    """A table of single values with their labels."""
    lines = [tag("tr", tag("th", label, scope="row"), tag("td", value)) for label, value in rows]
    body = tag("table", tag("caption", caption), tag("tbody", *lines), class_="facts")
    return tag("div", body, class_="scroll")


def tiles(found: Sequence[tuple[str, str, str]]) -> Markup:
    """Cards of the numbers that matter most, in rows of nearly the same length.

    Args:
        found: label, value and unit of each; the unit may be empty.
    """
    cards = []
    for label, value, unit in found:
        beside = [" ", tag("span", unit, class_="unit")] * bool(unit)
        cards.append(tag("div", tag("dt", label), tag("dd", value, *beside)))
    rows = -(-len(cards) // _MOST_TILES)
    columns = -(-len(cards) // max(rows, 1))
    return tag("dl", *cards, class_="tiles", style=f"--columns: {columns}")


def framed(page: str, title: str) -> Markup:
    """A page in a frame of another one."""
    return tag("iframe", srcdoc=page, title=title, class_="view", loading="lazy")


def section(name: str, title: str, *content: Any) -> Markup:
    """A part of the page with its heading; `name` is what links go to."""
    return tag("section", tag("h2", title), *content, id=name)
