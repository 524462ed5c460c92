"""HTML in which text stays text: what is put into a tag is escaped, unless it is `Markup`, which is HTML.

A document around the content of a page loads nothing, and no script runs in it unless it holds a viewer in a
frame of its own. `ALONG_ORBIT` is shared by the reports on plans and on days: captions of figures along the
orbit, by the names of the figures.
"""

import math
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np

NONE = "\N{EN DASH}"
_VOID_TAGS = ("img", "meta")
_MAX_NARROW_COLUMNS = 3  # number of columns up to which a table does not take the whole width of the page
_MAX_TILES_IN_ROW = 5  # number of cards in a row at most
Row = Sequence[Any]

# Content security policy: a browser may use only images and styles that are in the page itself.
_STATIC_POLICY = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
)
# The policy of a page with a viewer, which frames inherit; the viewer's library names fonts it never uses.
_VIEWER_POLICY = f"{_STATIC_POLICY}; script-src 'unsafe-inline'; font-src data: 'self' file:"


ALONG_ORBIT = {
    "orbital_sphere": "The sphere in the local orbital frame, which turns with the spacecraft: the half "
    "sphere about nadir, with the Earth to its limb, and that about the zenith, on both ahead up and the "
    "right to the right. What stands still in space moves in it.",
    "attitude": "The body in that frame (x about along the velocity, y against the orbit's normal, z to "
    "nadir), by yaw, then pitch, then roll; and how far boresights are from nadir.",
    "ground_track": "Where the spacecraft is overhead, and where boresights meet the ellipsoid of WGS 84.",
}


class Markup(str):
    """Text that is HTML and must not be escaped."""

    __slots__ = ()


def tag(name: str, *content: Any, **attributes: str | None) -> Markup:
    """Make an HTML element.

    Args:
        name: of the tag.
        content: what is in it, in order; all but `Markup` is escaped.
        attributes: values by name, escaped; None leaves an attribute out. In names an underscore stands for a
            hyphen, and one at the end is dropped, for names that Python or this function uses itself.
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    if name in _VOID_TAGS:
        return Markup(f"<{name}{given}>")
    return Markup(f"<{name}{given}>{join(content)}</{name}>")


def join(content: Iterable[Any]) -> Markup:
    """Join pieces of text to HTML; all but `Markup` is escaped."""
    return Markup("".join(part if isinstance(part, Markup) else escape(str(part)) for part in content))


def number(value: float | None, digits: int = 2) -> str:
    """Text of a number with `digits` digits after the point.

    It is a dash for None and "not finite" for infinity or NaN; zero has no minus sign.
    """
    if value is None:
        return NONE
    if not math.isfinite(value):
        return "not finite"
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "\N{MINUS SIGN}")


def share(value: float) -> str:
    """Text of a ratio in percent, without the percent sign."""
    return number(100 * value, 1)


def degrees(angle: Any, digits: int = 2) -> str:
    """Text of an angle, given in rad, in degrees with `digits` digits after the point."""
    return number(float(np.rad2deg(angle)), digits)


def table(titles: Sequence[str], rows: Iterable[Row], caption: str, marked: int | None = None) -> Markup:
    """Make a table whose first column holds the titles of its rows.

    Args:
        titles: of the columns, from left to right. The title of a column of numbers, which are aligned at the
            right, is followed by "|" and their unit, as in "Rate|deg/s", or by "|" alone.
        rows: the cells of each row, as many as there are titles.
        caption: stands above the table.
        marked: index of a row to highlight; None for none.
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
    look = "narrow" if len(titles) <= _MAX_NARROW_COLUMNS else None
    return tag("div", tag("table", *parts, class_=look), class_="scroll")


def facts(rows: Iterable[tuple[str, Any]], caption: str) -> Markup:
    """Make a table of single values, each with its label."""
    lines = [tag("tr", tag("th", label, scope="row"), tag("td", value)) for label, value in rows]
    body = tag("table", tag("caption", caption), tag("tbody", *lines), class_="facts")
    return tag("div", body, class_="scroll")


def tiles(found: Sequence[tuple[str, str, str]]) -> Markup:
    """Make cards with the most important numbers, arranged in rows of nearly the same length.

    Args:
        found: (label, value, unit) of each; the unit may be empty.
    """
    cards = []
    for label, value, unit in found:
        beside = [" ", tag("span", unit, class_="unit")] * bool(unit)
        cards.append(tag("div", tag("dt", label), tag("dd", value, *beside)))
    rows = -(-len(cards) // _MAX_TILES_IN_ROW)
    columns = -(-len(cards) // max(rows, 1))
    return tag("dl", *cards, class_="tiles", style=f"--columns: {columns}")


def framed(page: str, title: str) -> Markup:
    """Make a frame that holds a complete HTML page; `title` describes it to readers."""
    return tag("iframe", srcdoc=page, title=title, class_="view", loading="lazy")


def section(name: str, title: str, *content: Any) -> Markup:
    """Make a section of the page with its heading; `name` is the anchor that links go to."""
    return tag("section", tag("h2", title), *content, id=name)


def document(title: str, main: Markup, *, running: bool = False) -> str:
    """Make the text of an HTML document in the style of all pages.

    Args:
        title: of the document.
        main: its content.
        running: whether it holds a viewer, whose scripts must be allowed to run.
    """
    style = Markup(files("jaxplan.report").joinpath("page.css").read_text(encoding="utf-8"))
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag(
            "meta",
            http_equiv="Content-Security-Policy",
            content=_VIEWER_POLICY if running else _STATIC_POLICY,
        ),
        tag("meta", name_="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name_="color-scheme", content="light dark"),
        tag("title", title),
        tag("style", style),
    )
    return f"<!DOCTYPE html>\n{tag('html', head, tag('body', main), lang='en')}\n"
