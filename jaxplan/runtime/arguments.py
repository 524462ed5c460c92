"""What a caller gives: how it is shown in messages, and what is refused by the name of its argument.

A message names argument and value and says what it must be. Numbers may come as any type that numpy takes for
real numbers, a list or an array of another library among them; text and truth values are none.
"""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np

Kind = TypeVar("Kind")

_MOST_SHOWN = 9  # numbers of an array that messages show, enough for a matrix
_LONGEST = 60  # characters of a value that messages show


def show(value: object) -> str:
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


def as_floats(value: object) -> np.ndarray | None:
    """A value as an array of float64; None if numpy makes no real numbers of it, or some are masked."""
    if isinstance(value, np.ma.MaskedArray) and np.any(value.mask):
        return None  # numpy would take what is under the mask
    try:
        array = np.asarray(value)
    except Exception:  # rows of different lengths, traced values, or whatever another library raises
        return None
    return array.astype(float) if array.dtype.kind in "iuf" or not array.size else None


def floats(name: str, value: object, wanted: str) -> np.ndarray:
    """A number or an array of them, as float64; whether they are finite is not checked.

    Args:
        name: of the argument, for the message.
        value: of any type.
        wanted: what it must be, the words of the message after "must be".

    Raises:
        ValueError: if it is not made of real numbers.
    """
    array = as_floats(value)
    if array is None:
        raise ValueError(f"{name} = {show(value)}: must be {wanted}")
    return array


def number(name: str, value: object, wanted: str) -> float:
    """A single number as a float; arguments and errors as of `floats`."""
    array = as_floats(value)
    if array is None or array.ndim:
        raise ValueError(f"{name} = {show(value)}: must be {wanted}")
    return float(array)


def expect(name: str, value: object, kind: type[Kind], advice: str = "") -> Kind:
    """Return a value of the class `kind`; raise a TypeError, with `advice` on how to get one, for others."""
    if isinstance(value, kind):
        return value
    hint = f"; {advice}" if advice else ""
    raise TypeError(f"{name} must be {a_or_an(kind.__name__)}, not {type(value).__name__}{hint}")


def expect_any(name: str, value: object, kinds: tuple[type, ...], wanted: str) -> None:
    """Raise a TypeError, saying that `name` must be `wanted`, for a value of none of the classes `kinds`."""
    if not isinstance(value, kinds):
        raise TypeError(f"{name} must be {wanted}, not {type(value).__name__}")


def expect_numbers(name: str, value: object, *last: int) -> None:
    """Raise a ValueError for what is no array of real numbers with the given last axes.

    The numbers themselves are not looked at, so that they may be traced.

    Args:
        name: of the argument, for the message.
        value: of any type.
        last: lengths of its last axes; any others may come before.
    """
    if isinstance(value, jax.Array) or (isinstance(value, np.ndarray) and value.dtype.kind == "f"):
        shape: tuple[int, ...] | None = None if value.dtype.kind in "bc" else value.shape
    else:
        array = as_floats(value)
        shape = None if array is None else array.shape
    if shape is None or shape[max(len(shape) - len(last), 0) :] != last:
        wanted = f"of shape ({', '.join(['...', *map(str, last)])})" if last else "of any shape"
        raise ValueError(f"{name} = {show(value)}: must be real numbers {wanted}")


def several(name: str, value: object, wanted: str) -> Iterable[Any]:
    """Return an iterable that is no text; raise a TypeError, naming the items `wanted`, for all else."""
    if isinstance(value, Iterable) and not isinstance(value, str | bytes):
        return value
    raise TypeError(f"{name} must be several {wanted}, not {type(value).__name__}")


def file_path(name: str, value: object) -> Path:
    """A value as a path; raises a TypeError if it is neither text nor a path."""
    if isinstance(value, str | os.PathLike):
        return Path(value)
    raise TypeError(f"{name} must be a path, as text or a pathlib.Path, not {type(value).__name__}")
