"""Text that several formats share: lines of numbers, and text in plain ASCII."""

from collections.abc import Iterator, Sequence

import numpy as np

_NUMBER_FORMAT = "% .15e"  # 16 digits, as many as CCSDS allows and a double has


def table_lines(columns: Sequence[np.ndarray], separator: str = " ") -> Iterator[str]:
    """Yield the lines of a table of numbers as text, each with its line end.

    Args:
        columns: arrays (k,) or (k, c), side by side.
        separator: text between two numbers.
    """
    table = np.column_stack(columns)
    form = separator.join([_NUMBER_FORMAT] * table.shape[1]) + "\n"
    for first in range(0, len(table), 4096):  # a list of all would take several times the array's space
        for row in table[first : first + 4096].tolist():
            yield form % tuple(row)


def plain(text: str, longest: int = 80) -> str:
    """Return a text cut to `longest` characters, with ``?`` for backslashes and all but printable ASCII.

    Backslashes have a meaning in SPICE's kernels. A blank text becomes ``?``.
    """
    return "".join(c if " " <= c <= "~" and c != "\\" else "?" for c in text)[:longest].strip() or "?"
