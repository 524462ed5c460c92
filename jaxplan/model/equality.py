"""Equality of scenarios, or of parts of them, by what they state."""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from jaxplan.model.directions import DirectionPath
from jaxplan.model.epochs import parse_epoch
from jaxplan.runtime.arguments import as_floats

# Relative difference up to which numbers are equal. It is twice what an angle can lose on the way to degrees
# and back, since for some radians there are no degrees that a file could hold.
_RELATIVE_TOLERANCE = 4 * np.finfo(float).eps
_INFINITY_WORDS = ("off", "inf")  # words that scenarios may have for an infinite number


def same(one: Any, other: Any) -> bool:
    """Tell whether two values of a scenario are equal; they are compared as trees of values.

    Lists, tuples and arrays are compared entry by entry, and numbers of any type as floats, up to rounding. A
    short form equals the full one: one number equals an array of it, a name equals a tuple of that name, and
    None equals zeros. NaN is equal to nothing, and a value that JAX traces is equal to itself alone.
    """
    if one is other:
        return True
    if isinstance(one, DirectionPath) or isinstance(other, DirectionPath):
        return _same_paths(one, other)
    if is_dataclass(one) or is_dataclass(other):
        return type(one) is type(other) and all(
            same(getattr(one, part.name), getattr(other, part.name)) for part in fields(one)
        )
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, np.datetime64) or isinstance(other, np.datetime64):
        instant = _as_utc(one)
        return instant is not None and instant == _as_utc(other)
    if isinstance(one, str) and isinstance(other, str):
        return one == other
    return _same_numbers(one, other) or _same_entries(one, other)


def _same_paths(one: Any, other: Any) -> bool:
    """Tell whether two paths, or a path and a fixed direction, are the same at all times."""
    if not (isinstance(one, DirectionPath) and isinstance(other, DirectionPath)):
        path, direction = (one, other) if isinstance(one, DirectionPath) else (other, one)
        return not path.moves and same(path.samples[0], direction)
    return same(one.samples, other.samples) and (
        not one.moves or (same(one.times, other.times) and same(one.hidden, other.hidden))
    )


def _as_utc(value: Any) -> Any:
    """Return the time in UTC that a value gives, as datetime64; None if it gives none."""
    try:
        return parse_epoch(value)
    except ValueError:
        return None


def _same_numbers(one: Any, other: Any) -> bool:
    """Tell whether two numbers, or arrays of them, are equal up to rounding; False if either is no number.

    None counts as zero, and the words "off" and "inf" as infinite. A single number equals an array if it
    equals each of its entries.
    """
    first, second = _as_numbers(one), _as_numbers(other)
    if first is None or second is None or not (first.shape == second.shape or 0 in (first.ndim, second.ndim)):
        return False
    with np.errstate(invalid="ignore"):  # differences of infinite numbers, which are compared below
        near = np.abs(first - second) <= _RELATIVE_TOLERANCE * np.abs(second)
    return bool(np.all((first == second) | (near & np.isfinite(second))))


def _as_numbers(value: Any) -> np.ndarray | None:
    """Return a value as an array of floats, or None if it is no number.

    None counts as zero, and "off" and "inf" as infinite.
    """
    if value is None:
        return np.zeros(())
    return np.array(math.inf) if isinstance(value, str) and value in _INFINITY_WORDS else as_floats(value)


def _same_entries(one: Any, other: Any) -> bool:
    """Tell whether two lists, tuples or arrays have equal entries; a single name counts as a tuple of one."""
    first, second = ((each,) if isinstance(each, str) else each for each in (one, other))
    if not (isinstance(first, list | tuple | np.ndarray) and isinstance(second, list | tuple | np.ndarray)):
        return False
    return len(first) == len(second) and all(map(same, first, second))
