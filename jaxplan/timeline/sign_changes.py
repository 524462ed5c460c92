"""Instants at which functions of time change their sign, and where they are least, of many at once.

Functions are columns of a table at common times, close enough together that between two of them a function
has one extremum at most. What is not a number counts as positive and infinite.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

Values: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""From times (k,) s and numbers of columns (k,) to the values (k,) of these columns then."""

_PARTS = 8  # into which the span about a change of sign, or about an extremum, is cut at a time
_ROUNDS = 11  # of cutting: of 60 s at a change to 7e-9 s, at an extremum, where two parts stay, to 1e-5 s
_FAR = 1e9  # what stands for a value that is no number
_DEEP = 2.0  # steps of a function to the samples before and after, by which it may dip deeper between


class Changes(NamedTuple):
    """Changes of sign: times (k,) s, numbers of columns (k,), and whether each is to positive (k,) bool."""

    times: np.ndarray
    columns: np.ndarray
    rising: np.ndarray


def changes(table: np.ndarray, times: np.ndarray, values: Values) -> Changes:
    """Find all changes of sign, those of short dips and peaks between two times too.

    Args:
        table: (n, c) values of the columns.
        times: (n,) s, rising.
        values: the same functions at any times.

    Returns:
        The changes, to 1e-6 s, column by column. A zero counts as positive.
    """
    known = np.where(np.isfinite(table), table, _FAR)
    negative = known < 0
    place, column = np.nonzero(negative[1:] != negative[:-1])
    low, high, columns = times[place], times[place + 1], column
    below = negative[place, column]
    found, found_at, extreme = _turned(known, times, values)
    if len(found):
        low = np.concatenate([low, times[extreme - 1], found])
        high = np.concatenate([high, found, times[extreme + 1]])
        columns = np.concatenate([columns, found_at, found_at])
        first, last = negative[extreme - 1, found_at], ~negative[extreme, found_at]
        below = np.concatenate([below, first, last])
    for _ in range(_ROUNDS if len(columns) else 0):
        inner = _inner(low, high)
        same = (_at(inner, columns, values) < 0) == below[:, None]
        place = np.where(np.all(same, axis=1), _PARTS - 1, np.argmin(same, axis=1))[:, None]
        edges = np.concatenate([low[:, None], inner, high[:, None]], axis=1)
        low, high = (np.take_along_axis(edges, place + side, axis=1)[:, 0] for side in (0, 1))
    order = np.lexsort((low, columns))
    return Changes(times=((low + high) / 2)[order], columns=columns[order], rising=below[order])


def _turned(
    table: np.ndarray, times: np.ndarray, values: Values
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Extrema between samples of one sign that have the other: times, columns, and places of samples."""
    before, middle, after = table[:-2], table[1:-1], table[2:]
    sign = np.where(middle < 0, -1.0, 1.0)
    alike = (np.sign(before) * sign >= 0) & (np.sign(after) * sign >= 0)
    turning = alike & (sign * middle <= sign * before) & (sign * middle <= sign * after)
    turning &= middle < _FAR
    steps = np.maximum(np.abs(before - middle), np.abs(after - middle))
    turning &= np.abs(middle) < _DEEP * steps  # else it cannot come to zero between
    place, column = np.nonzero(turning)
    side = sign[place, column]
    where = _least(times[place], times[place + 2], column, side, values)
    own = values(where, column) if len(where) else np.zeros(0)
    other = (own < 0) != (side < 0)
    return where[other], column[other], place[other] + 1


def _least(
    low: np.ndarray, high: np.ndarray, columns: np.ndarray, side: np.ndarray, values: Values
) -> np.ndarray:
    """Times (k,) s between two each at which columns, times +1 or -1 (`side`), are least."""
    for _ in range(_ROUNDS if len(columns) else 0):
        inner = _inner(low, high)
        place = np.argmin(side[:, None] * _at(inner, columns, values), axis=1)[:, None]
        edges = np.concatenate([low[:, None], inner, high[:, None]], axis=1)
        low, high = (np.take_along_axis(edges, place + end, axis=1)[:, 0] for end in (0, 2))
    return (low + high) / 2


def _inner(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The times (k, _PARTS - 1) that cut spans from `low` to `high`, (k,) s, into equal parts."""
    shares = np.arange(1, _PARTS) / _PARTS
    return low[:, None] + (high - low)[:, None] * shares


def _at(times: np.ndarray, columns: np.ndarray, values: Values) -> np.ndarray:
    """Values (k, m) of columns (k,) at times (k, m), infinite where they are no number."""
    found = values(times.ravel(), np.repeat(columns, times.shape[1])).reshape(times.shape)
    return np.where(np.isnan(found), np.inf, found)


def least(table: np.ndarray, times: np.ndarray, values: Values) -> tuple[np.ndarray, np.ndarray]:
    """Find when each column is least: times (c,) s to 1e-5 s, and the values (c,); arguments as of `changes`.

    A column that is nowhere a number is infinite.
    """
    known = np.where(np.isnan(table), np.inf, table)
    columns = np.arange(table.shape[1])
    place = np.argmin(known, axis=0) if len(times) else np.zeros(len(columns), int)
    last = len(times) - 1
    low, high = times[np.maximum(place - 1, 0)], times[np.minimum(place + 1, last)]
    found = _least(low, high, columns, np.ones(len(columns)), values)
    own = values(found, columns) if len(columns) else np.zeros(0)
    own = np.where(np.isnan(own), np.inf, own)
    sampled = known[place, columns]
    return np.where(own <= sampled, found, times[place]), np.minimum(own, sampled)
