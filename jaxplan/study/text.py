"""Lines and numbers of a study as aligned text."""

from collections.abc import Sequence

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
