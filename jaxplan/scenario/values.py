"""Numbers that Python gives for those of a scenario, or faults that say at which place they are none.

Type and shape are judged here; whether numbers are finite and in range is for the kinds to say, as of a file.
"""

from typing import Any

import numpy as np

from jaxplan.given import as_floats
from jaxplan.scenario.faults import Place


def read_array(
    value: object, wanted: str, place: Place, *shapes: tuple[int | None, ...]
) -> np.ndarray | None:
    """An array of float64, or None after noting why it is none.

    Args:
        value: of any type.
        wanted: what it must be, to stand after "must be".
        place: where it stands.
        shapes: of which it must have one, None where any number will do.
    """
    array = as_floats(value)
    if array is None:
        _blame(value, wanted, place, max(map(len, shapes)))
    elif any(_fits(array.shape, shape) for shape in shapes):
        return array
    else:
        size = f"of shape {array.shape}" if array.ndim else "a single number"
        place.refuse(f"must be {wanted}, not {size}", value)
    return None


def read_number(value: object, wanted: str, place: Place) -> float | None:
    """A number, or None after noting why it is none."""
    number = read_array(value, wanted, place, ())
    return None if number is None else float(number)


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(shape) == len(wanted) and all(m in (None, n) for n, m in zip(shape, wanted, strict=True))


def _blame(value: Any, wanted: str, place: Place, depth: int) -> None:
    """Note a fault at the first entry of nested lists that is no number, or where all are, at the whole.

    Args:
        value: of which numpy makes no array of numbers.
        wanted: what it must be.
        place: where it stands.
        depth: of the lists that were wanted.
    """
    entries = isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)
    for i, entry in enumerate(value if entries else ()):
        if as_floats(entry) is None:
            of = "an array of real numbers" if depth > 1 else "a real number"
            _blame(entry, of, place.item(i), depth - 1)
            return
    place.refuse(f"must be {wanted}", value)
