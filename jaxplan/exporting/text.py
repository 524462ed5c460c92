"""Rows of numbers in text files, and free text that is fit for them."""

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from jaxplan.progress import progress_bar

T = TypeVar("T")

# 16 digits, as many as CCSDS allows and a double has.
_NUMBER = "% .15e"


def table_lines(columns: Sequence[np.ndarray], separator: str = " ") -> Iterator[str]:
    """Lines of numbers, with their ends.

    Args:
        columns: (k,) or (k, c), side by side.
        separator: between two numbers.
    """
    table = np.column_stack(columns)
    form = separator.join([_NUMBER] * table.shape[1]) + "\n"
    for first in range(0, len(table), 4096):  # a list of all would take several times the array's space
        for row in table[first : first + 4096].tolist():
            yield form % tuple(row)


def progress(rows: Iterable[T], total: int) -> Iterator[T]:
    """The rows, with a bar where writing them takes long."""
    with progress_bar("writing", "rows", total=total) as bar:
        for row in rows:
            yield row
            bar.update()


def plain(text: str, longest: int = 80) -> str:
    """A line of printable ASCII, with ``?`` for every other character, and for those that SPICE obeys."""
    return "".join(c if " " <= c <= "~" and c != "\\" else "?" for c in text)[:longest].strip() or "?"
