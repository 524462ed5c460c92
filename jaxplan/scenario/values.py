"""Values that Python gives: numbers as numpy takes them, and how a value is shown in a fault.

Lists, arrays of any library that numpy takes, and numbers of any type are as good as arrays of float64. Their
type and shape are told here; whether they are finite and in range is for the kinds to say, as of a file.
"""

from typing import Any

import jax
import numpy as np

from jaxplan.scenario.faults import Place

_MOST_SHOWN = 9  # numbers of an array; that is a matrix
_LONGEST = 60  # characters


def show_python(value: object) -> str:
    """A short text for a value, as Python spells it."""
    if isinstance(value, jax.core.Tracer):
        return "a value that JAX traces"
    if value is np.ma.masked:
        return "a masked value"
    if isinstance(value, np.generic | np.ndarray | jax.Array):
        array = np.asarray(value)
        text = repr(array.tolist()) if array.size <= _MOST_SHOWN else ""
        return text if 0 < len(text) <= _LONGEST else f"an array of shape {array.shape}"
    if isinstance(value, list | tuple):
        text = repr(value) if len(value) <= _MOST_SHOWN else ""
        return text if 0 < len(text) <= _LONGEST else f"a {type(value).__name__} of {len(value)}"
    if isinstance(value, str | int | float | complex | None):
        text = repr(value)
        return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    name = getattr(value, "name", None)
    return a_or_an(type(value).__name__) + (f" ({name!r})" if isinstance(name, str) else "")


def a_or_an(noun: str) -> str:
    """The noun with its article."""
    return f"{'an' if noun[0] in 'AEIOUaeiou' else 'a'} {noun}"


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
    array = _as_floats(value)
    if array is None:
        _blame(value, wanted, place, max(map(len, shapes)))
    elif any(_fits(array.shape, shape) for shape in shapes):
        return array
    else:
        size = f"of shape {array.shape}" if array.ndim else "a single number"
        place.fault(f"must be {wanted}, not {size}", value)
    return None


def read_number(value: object, wanted: str, place: Place) -> float | None:
    """A number, or None after noting why it is none."""
    number = read_array(value, wanted, place, ())
    return None if number is None else float(number)


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(shape) == len(wanted) and all(m in (None, n) for n, m in zip(shape, wanted, strict=True))


def _as_floats(value: object) -> np.ndarray | None:
    """What numpy makes of it, None where that is not made of real numbers."""
    if isinstance(value, np.ma.MaskedArray):
        return None  # numpy would drop the mask
    try:
        array = np.asarray(value)
    except Exception:  # rows of different lengths, traced values, or whatever another library raises
        return None
    return array.astype(float) if array.dtype.kind in "iuf" or not array.size else None


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
        if _as_floats(entry) is None:
            of = "an array of real numbers" if depth > 1 else "a real number"
            _blame(entry, of, place.item(i), depth - 1)
            return
    place.fault(f"must be {wanted}", value)
