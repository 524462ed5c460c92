"""Instants: an epoch in UTC and seconds after it, as Julian dates of the scales that pyerfa counts in."""

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jaxplan.epochs import TT_MINUS_TAI, leaps
from jaxplan.given import floats

_UNIX_DAY_ZERO = 2440587.5  # Julian date of 1970-01-01T00:00
_DAY = 86400.0
_MOST_SECONDS = 4.1e9  # all the years that an epoch may lie in


def library(module: str) -> Any:
    """A module of the extra ``orbit``: ``erfa``, or one of ``sgp4``.

    Raises:
        ImportError: if it is not installed; the message names the extra.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = {"erfa": "pyerfa"}.get(module, module.partition(".")[0])
        raise ImportError(f"{package} is missing: pip install 'jaxplan[orbit]'") from error


def seconds(times: ArrayLike) -> np.ndarray:
    """Times after an epoch as an array, checked.

    Args:
        times: () or (k,) s.

    Raises:
        ValueError: if they are of another shape, not finite, or a century away.
    """
    array = floats("times", times, "a number of seconds, or (k,) of them")
    if array.ndim > 1:
        raise ValueError(f"times: must be a number or (k,) numbers of seconds, not of shape {array.shape}")
    wrong = array[~(np.abs(array) <= _MOST_SECONDS)]
    if wrong.size:
        raise ValueError(f"times = {wrong.flat[0]}: must lie in [{-_MOST_SECONDS:g}, {_MOST_SECONDS:g}] s")
    return array


def universal(epoch: np.datetime64, times: np.ndarray) -> tuple[float, np.ndarray]:
    """UTC as a Julian date in two parts, which stands for UT1 where a second does not matter.

    Args:
        epoch: UTC.
        times: (...) s after it.

    Returns:
        Midnight before the epoch, and (...) days from there on.
    """
    midnight = epoch.astype("datetime64[D]")
    since = float((epoch - midnight) / np.timedelta64(1, "ns")) * 1e-9
    return _UNIX_DAY_ZERO + float(midnight.astype(int)), (since + times) / _DAY


def terrestrial(epoch: np.datetime64, times: np.ndarray) -> tuple[float, np.ndarray]:
    """Terrestrial time as a Julian date in two parts; TDB is the same to 0.002 s."""
    day, since = universal(epoch, times)
    return day, since + (_leaps(epoch) + TT_MINUS_TAI) / _DAY


def elapsed(since: np.datetime64, epoch: np.datetime64, times: np.ndarray) -> np.ndarray:
    """SI seconds, leap seconds counted, from one epoch to (...) times after another."""
    apart = float((epoch - since) / np.timedelta64(1, "ns")) * 1e-9
    return apart + (_leaps(epoch) - _leaps(since) if epoch != since else 0.0) + times


def _leaps(epoch: np.datetime64) -> float:
    """Seconds that TAI is ahead of UTC."""
    library("erfa")  # for the message where it is missing
    return leaps(epoch)
