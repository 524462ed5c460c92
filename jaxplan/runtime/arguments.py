"""Checks of what a caller gives, and how messages show it.

A message names the argument and its value and says what it must be. Numbers may come in any type that numpy
takes for real numbers, including lists and arrays of other libraries, but not as text or truth values.
"""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np

Kind = TypeVar("Kind")

_MOST_NUMBERS = 9  # numbers of an array that messages show, enough for a matrix
_LONGEST_TEXT = 60  # characters of a value that messages show


def show(value: object) -> str:
    """Return a short text for a value, as Python spells it."""
    if isinstance(value, jax.core.Tracer):
        return "a value that JAX traces"
    if value is np.ma.masked:
        return "a masked value"
    if isinstance(value, np.generic | np.ndarray | jax.Array):
        array = np.asarray(value)
        text = repr(array.tolist()) if array.size <= _MOST_NUMBERS else ""
        return text if 0 < len(text) <= _LONGEST_TEXT else f"an array of shape {array.shape}"
    if isinstance(value, list | tuple):
        text = repr(value) if len(value) <= _MOST_NUMBERS else ""
        return text if 0 < len(text) <= _LONGEST_TEXT else f"a {type(value).__name__} of {len(value)}"
    if isinstance(value, str | int | float | complex | None):
        text = repr(value)
        return text if len(text) <= _LONGEST_TEXT else f"{text[:_LONGEST_TEXT]}..."
    name = getattr(value, "name", None)
    return a_or_an(type(value).__name__) + (f" ({name!r})" if isinstance(name, str) else "")


def a_or_an(noun: str) -> str:
    """Return a noun with its indefinite article."""
    return f"{'an' if noun[0] in 'AEIOUaeiou' else 'a'} {noun}"


def as_floats(value: object) -> np.ndarray | None:
    """Return a value as an array of float64; None if it is not made of real numbers, or some are masked."""
    if isinstance(value, np.ma.MaskedArray) and np.any(value.mask):
        return None  # numpy would take what is under the mask
    try:
        array = np.asarray(value)
    except Exception:  # rows of different lengths, traced values, or whatever another library raises
        return None
    return array.astype(float) if array.dtype.kind in "iuf" or not array.size else None


def floats(name: str, value: object, wanted: str) -> np.ndarray:
    """Return a number or an array of numbers as float64; they may be infinite or NaN.

    Args:
        name: name of the argument, for the message.
        value: a value of any type.
        wanted: what it must be: the words of the message after "must be".

    Raises:
        ValueError: if it is not made of real numbers.
    """
    array = as_floats(value)
    if array is None:
        raise ValueError(f"{name} = {show(value)}: must be {wanted}")
    return array


def number(name: str, value: object, wanted: str) -> float:
    """Return a single number as a float; arguments and errors are those of `floats`."""
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
    """Raise a TypeError, saying that `name` must be `wanted`, unless a value is of one of several classes."""
    if not isinstance(value, kinds):
        raise TypeError(f"{name} must be {wanted}, not {type(value).__name__}")


def expect_numbers(name: str, value: object, *last: int) -> None:
    """Raise a ValueError unless a value is an array of real numbers with the given last axes.

    Only shape and type are checked, so that the numbers may be traced.

    Args:
        name: name of the argument, for the message.
        value: a value of any type.
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
    """Return an iterable that is no text; raise a TypeError, calling its items `wanted`, for others."""
    if isinstance(value, Iterable) and not isinstance(value, str | bytes):
        return value
    raise TypeError(f"{name} must be several {wanted}, not {type(value).__name__}")


def file_path(name: str, value: object) -> Path:
    """Return a value as a path; raise a TypeError if it is neither text nor a path."""
    if isinstance(value, str | os.PathLike):
        return Path(value)
    raise TypeError(f"{name} must be a path, as text or a pathlib.Path, not {type(value).__name__}")
