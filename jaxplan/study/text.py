"""Results as text: a title, lines of a label and a value, and a table whose columns line up."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

from jaxplan.runtime.display import Cells, as_table

Lines = Sequence[tuple[str, str]]


class Printed(ABC):
    """A result that prints itself, and shows itself as a table in notebooks."""

    @property
    @abstractmethod
    def title(self) -> str:
        """Title above the lines and the table."""

    def lines(self) -> Lines:
        """Lines above the table, as (label, value)."""
        return ()

    @abstractmethod
    def cells(self) -> Cells:
        """The table as rows of texts, the first of them its head."""

    def __str__(self) -> str:
        return aligned(self.title, self.lines(), self.cells())

    def _repr_html_(self) -> str:
        return as_table(self.title, self.lines(), self.cells())


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
