"""Texts that formats share: lines of numbers, and text that any format takes."""

from collections.abc import Iterator, Sequence

import numpy as np

_NUMBER = "% .15e"  # 16 digits, as many as CCSDS allows and a double has


def table_lines(columns: Sequence[np.ndarray], separator: str = " ") -> Iterator[str]:
    """Yield the lines of a table of numbers as text, each with its line end.

    Args:
        columns: (k,) or (k, c), side by side.
        separator: between two numbers.
    """
    table = np.column_stack(columns)
    form = separator.join([_NUMBER] * table.shape[1]) + "\n"
    for first in range(0, len(table), 4096):  # a list of all would take several times the array's space
        for row in table[first : first + 4096].tolist():
            yield form % tuple(row)


def plain(text: str, longest: int = 80) -> str:
    """Cut a text to `longest` characters, with ``?`` for what is no printable ASCII and for backslashes.

    To SPICE a backslash has a meaning. Of a text that is blank, ``?`` is left.
    """
    return "".join(c if " " <= c <= "~" and c != "\\" else "?" for c in text)[:longest].strip() or "?"
