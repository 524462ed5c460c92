"""Texts that formats share: lines of numbers, and names that hold only what a format takes."""

import re
from collections.abc import Iterable, Iterator, Sequence

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


def labels(names: Iterable[str], taken: Iterable[str], longest: int) -> list[str]:
    """Short names of letters, digits, ``-`` and ``_`` that differ also where case does not count.

    Args:
        names: any text, such as names of devices.
        taken: names that they must not have.
        longest: characters of one at most, 10 or more.

    Returns:
        For each name itself with other characters made ``_``, or ``device_3`` where that is too long, empty
        or taken.
    """
    used = {name.lower() for name in taken}
    result = []
    for number, name in enumerate(names, start=1):
        label = re.sub(r"[^A-Za-z0-9_-]", "_", name)
        spare = (f"device_{k}" for k in range(number, 10**9))
        while not label.strip("_-") or len(label) > longest or label.lower() in used:
            label = next(spare)
        used.add(label.lower())
        result.append(label)
    return result
