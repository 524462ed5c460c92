"""Find when functions of time change sign and where they are least, for many functions at once.

The functions are columns of a table of samples at common times, close enough together that between two
samples a function has at most one extremum. Values that are NaN count as positive and infinite.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

Values: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""From times (k,) s and numbers of columns (k,) to the values (k,) of these columns then."""

_PARTS_PER_ROUND = 8  # into which the span about a change of sign, or an extremum, is cut
_CUT_ROUNDS = 11  # from 60 s to 7e-9 s at a change, to 1e-5 s at an extremum, which keeps two parts
_INFINITY_STAND_IN = 1e9  # stands for values that are not finite
_DIP_TOLERANCE = 1e-9  # by which a function must be able to dip below its least sample to be looked at
_MAX_DIP = 2.0  # times the larger step to its neighbours: most by which a function may dip below a sample


class Changes(NamedTuple):
    """Changes of sign.

    Attributes:
        times: (k,) s.
        columns: (k,) indices of the columns that change sign.
        rising: (k,) bool, whether the change is from negative to positive.
    """

    times: np.ndarray
    columns: np.ndarray
    rising: np.ndarray


def changes(table: np.ndarray, times: np.ndarray, values: Values) -> Changes:
    """Find all changes of sign, also the two of a short dip or peak between samples.

    Args:
        table: (n, c) samples of c functions.
        times: (n,) s, rising, of the samples.
        values: evaluates the same functions at any times.

    Returns:
        The changes, to 1e-6 s, sorted by column, then by time. Zero counts as positive.
    """
    known = np.where(np.isfinite(table), table, _INFINITY_STAND_IN)
    negative = known < 0
    place, column = np.nonzero(negative[1:] != negative[:-1])
    low, high, columns = times[place], times[place + 1], column
    below = negative[place, column]
    found, found_at, extreme = _find_crossing_extrema(known, times, values)
    if len(found):
        low = np.concatenate([low, times[extreme - 1], found])
        high = np.concatenate([high, found, times[extreme + 1]])
        columns = np.concatenate([columns, found_at, found_at])
        first, last = negative[extreme - 1, found_at], ~negative[extreme, found_at]
        below = np.concatenate([below, first, last])
    for _ in range(_CUT_ROUNDS if len(columns) else 0):
        inner = _cut_times(low, high)
        same = (_column_values(inner, columns, values) < 0) == below[:, None]
        place = np.where(np.all(same, axis=1), _PARTS_PER_ROUND - 1, np.argmin(same, axis=1))[:, None]
        edges = np.concatenate([low[:, None], inner, high[:, None]], axis=1)
        low, high = (np.take_along_axis(edges, place + side, axis=1)[:, 0] for side in (0, 1))
    order = np.lexsort((low, columns))
    return Changes(times=((low + high) / 2)[order], columns=columns[order], rising=below[order])


def _find_crossing_extrema(
    table: np.ndarray, times: np.ndarray, values: Values
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find extrema that have the other sign than the samples around them.

    Returns:
        Their times (k,) s, their columns (k,), and the indices (k,) of the samples they are next to.
    """
    before, middle, after = table[:-2], table[1:-1], table[2:]
    sign = np.where(middle < 0, -1.0, 1.0)
    alike = (np.sign(before) * sign >= 0) & (np.sign(after) * sign >= 0)
    turning = alike & (sign * middle <= sign * before) & (sign * middle <= sign * after)
    turning &= middle < _INFINITY_STAND_IN
    steps = np.maximum(np.abs(before - middle), np.abs(after - middle))
    turning &= np.abs(middle) < _MAX_DIP * steps  # else it cannot come to zero between
    place, column = np.nonzero(turning)
    side = sign[place, column]
    where = _minimize_columns(times[place], times[place + 2], column, side, values)
    own = values(where, column) if len(where) else np.zeros(0)
    other = (own < 0) != (side < 0)
    return where[other], column[other], place[other] + 1


def _minimize_columns(
    low: np.ndarray, high: np.ndarray, columns: np.ndarray, side: np.ndarray, values: Values
) -> np.ndarray:
    """Find where columns are least, each between its own two times.

    Args:
        low: (k,) s.
        high: (k,) s.
        columns: (k,) indices of the columns.
        side: (k,) +1 to minimize the column, -1 to maximize it.
        values: evaluates the columns.

    Returns:
        Times (k,) s.
    """
    for _ in range(_CUT_ROUNDS if len(columns) else 0):
        inner = _cut_times(low, high)
        place = np.argmin(side[:, None] * _column_values(inner, columns, values), axis=1)[:, None]
        edges = np.concatenate([low[:, None], inner, high[:, None]], axis=1)
        low, high = (np.take_along_axis(edges, place + end, axis=1)[:, 0] for end in (0, 2))
    return (low + high) / 2


def _cut_times(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return times (k, _PARTS_PER_ROUND - 1) that cut spans from `low` to `high`, (k,) s, in equal parts."""
    shares = np.arange(1, _PARTS_PER_ROUND) / _PARTS_PER_ROUND
    return low[:, None] + (high - low)[:, None] * shares


def _column_values(times: np.ndarray, columns: np.ndarray, values: Values) -> np.ndarray:
    """Return values (k, m) of columns (k,) at times (k, m) s; infinite in place of NaN."""
    found = values(times.ravel(), np.repeat(columns, times.shape[1])).reshape(times.shape)
    return np.where(np.isnan(found), np.inf, found)


def least(table: np.ndarray, times: np.ndarray, values: Values) -> tuple[np.ndarray, np.ndarray]:
    """Find when each column is least; arguments as of `changes`.

    Returns:
        Times (c,) s, to 1e-5 s, the first ones of equal minima, and values (c,) there; infinite for a column
        that is NaN everywhere.
    """
    known = np.where(np.isnan(table), np.inf, table)
    place, column = _find_lowest_dips(np.clip(known, -_INFINITY_STAND_IN, _INFINITY_STAND_IN))
    low, high = times[np.maximum(place - 1, 0)], times[np.minimum(place + 1, len(times) - 1)]
    found = _minimize_columns(low, high, column, np.ones(len(column)), values)
    own = values(found, column) if len(column) else np.zeros(0)
    own = np.where(np.isnan(own), np.inf, own)
    sampled = known[place, column]
    found, own = np.where(own <= sampled, found, times[place]), np.minimum(own, sampled)
    order = np.lexsort((found, own, column))
    _, first = np.unique(column[order], return_index=True)  # each column has a dip at its least sample
    return found[order][first], own[order][first]


def _find_lowest_dips(table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the samples next to which columns (n, c) may be least: of near-equal minima all are candidates.

    Returns:
        Indices (k,) of these samples and of their columns. The least sample of each column is among them.
    """
    padded = np.pad(table, ((1, 1), (0, 0)), mode="edge")
    before, after = padded[:-2] - table, padded[2:] - table
    steps = np.maximum(np.abs(before), np.abs(after))
    lowest = np.min(table, axis=0, initial=_INFINITY_STAND_IN)
    deep = table - _MAX_DIP * steps < lowest - _DIP_TOLERANCE
    found = (before >= 0) & (after >= 0) & deep
    found[np.argmin(table, axis=0), np.arange(table.shape[1])] = True
    place, column = np.nonzero(found)
    return place, column
