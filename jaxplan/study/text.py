"""Lines and numbers of a study as aligned text, and as HTML for notebooks."""

from collections.abc import Sequence
from html import escape

Lines = Sequence[tuple[str, str]]
Cells = Sequence[Sequence[str]]


def aligned(title: str, lines: Lines, cells: Cells) -> str:
    """Labels and values, and below them a table whose columns line up.

    Args:
        title: above all.
        lines: (label, value).
        cells: rows of the table, the first of them its head.
    """
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    widths[0] = max([widths[0], *(len(label) for label, _ in lines)])
    text = [title, *(f"  {label:<{widths[0]}}  {value}" for label, value in lines)]
    for row in cells:
        numbers = (f"{cell:>{width}}" for cell, width in zip(row[1:], widths[1:], strict=True))
        text.append(f"  {row[0]:<{widths[0]}}  {'  '.join(numbers)}")
    return "\n".join(text)


def as_html(title: str, lines: Lines, cells: Cells) -> str:
    """The same for a notebook."""
    span, left = len(cells[0]) - 1, "text-align:left"
    rows = [
        f"<tr><th style='{left}'>{escape(label)}</th>"
        f"<td colspan='{span}' style='{left}'>{escape(value)}</td></tr>"
        for label, value in lines
    ]
    for number, row in enumerate(cells):
        tag = "td" if number else "th"
        numbers = "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in row[1:])
        rows.append(f"<tr><th style='{left}'>{escape(row[0])}</th>{numbers}</tr>")
    return f"<table><caption>{escape(title)}</caption>{''.join(rows)}</table>"
