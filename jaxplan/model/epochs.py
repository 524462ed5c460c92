"""Conversions of times: UTC in files, seconds from the start in the program, and SPICE's ephemeris time.

The start of a manoeuvre is a ``datetime64[ns]`` in UTC, in 1972 or later, when UTC began to have leap
seconds. Elapsed seconds are SI seconds: a leap second within a manoeuvre is counted, and written as second
60. pyerfa knows which leap seconds there are; it is asked only where a leap second is possible, which has
only ever been at the end of June or December.
"""

import re
import warnings
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
from numpy.typing import ArrayLike

_FIRST_YEAR, _LAST_YEAR = 1972, 2099  # years within which epochs must lie
_FINER_THAN_MICROSECOND = re.compile(r"\.\d{6}\d*[1-9]")
_ONE_SECOND = np.timedelta64(1, "s")
_J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
TT_MINUS_TAI = 32.184  # s, terrestrial time less atomic time


def parse_epoch(text: object) -> np.datetime64:
    """Read a time in UTC from its ISO 8601 text.

    Args:
        text: such as ``2026-01-01T00:00:00``, with at most 6 digits of a second; in UTC unless it has an
            offset.

    Returns:
        The time in UTC as datetime64[ns].

    Raises:
        ValueError: if it is no such time, or lies outside 1972 to 2099.
    """
    if _FINER_THAN_MICROSECOND.search(str(text)):
        raise ValueError(f"epoch = {text!r}: must have at most 6 digits of a second")
    try:
        moment = datetime.fromisoformat(str(text).strip())
        if moment.tzinfo is not None:
            moment = moment.astimezone(UTC).replace(tzinfo=None)
    except (ValueError, OverflowError) as error:
        raise ValueError(
            f"epoch = {text!r}: must be a time in UTC such as 2026-01-01T00:00:00 ({error})"
        ) from error
    if not _FIRST_YEAR <= moment.year <= _LAST_YEAR:
        raise ValueError(f"epoch = {text!r}: must lie in the years {_FIRST_YEAR} to {_LAST_YEAR}")
    return np.datetime64(moment, "ns")


def utc_texts(start: np.datetime64, times: np.ndarray) -> list[str]:
    """Return calendar times in UTC to the nanosecond, without a zone: ``2026-01-01T00:00:00.100000000``.

    Args:
        start: UTC of the start of the manoeuvre.
        times: (k,) s after it, rising; at least one. They may lie long after the start.

    Returns:
        k texts; second 60 is a leap second.

    Raises:
        ValueError: if leap seconds may lie between, and pyerfa is not installed.
    """
    stamps = start + np.round(times * 1e9).astype("timedelta64[ns]")
    half_year = stamps[-1].astype("datetime64[6M]")
    leap = np.zeros(len(stamps), bool)
    if start.astype("datetime64[6M]") != half_year and leaps(stamps[-1]) > leaps(start):
        midnight = half_year.astype("datetime64[ns]")
        late = stamps >= midnight
        leap = late & (stamps < midnight + _ONE_SECOND)
        stamps = np.where(late, stamps - _ONE_SECOND, stamps)
    texts = np.datetime_as_string(stamps, unit="ns").tolist()
    return [f"{text[:17]}60{text[19:]}" if odd else text for text, odd in zip(texts, leap, strict=True)]


def utc_stamps(epoch: np.datetime64, times: Sequence[float]) -> list[str]:
    """Return calendar times in UTC to the millisecond: ``2026-06-20T09:30:00.000``.

    Args:
        epoch: UTC of the start.
        times: k times, s after it, in any order.

    Returns:
        k texts in the same order.
    """
    given = np.round(np.asarray(times, float), 3)
    order = np.argsort(given, kind="stable")
    texts = utc_texts(epoch.astype("datetime64[ns]"), given[order]) if len(given) else []
    found = [""] * len(given)
    for place, text in zip(order.tolist(), texts, strict=True):
        found[place] = text[:23]
    return found


def seconds_between(start: np.datetime64, stamp: np.datetime64) -> float:
    """Return the seconds from `start` to `stamp`, both UTC, with leap seconds; negative if it is earlier.

    Raises:
        ValueError: if leap seconds may lie between, and pyerfa is not installed.
    """
    seconds = float((stamp - start) / np.timedelta64(1, "ns")) / 1e9
    if stamp.astype("datetime64[6M]") != start.astype("datetime64[6M]"):
        seconds += leaps(stamp) - leaps(start)
    return seconds


def ephemeris_time(start: np.datetime64, elapsed: ArrayLike = 0.0) -> np.ndarray:
    """Return SPICE's ephemeris time, seconds of TDB since J2000, as SPICE's own ``str2et`` computes it.

    TDB - TT is the one-term formula of SPICE's leap second kernels (constants K, EB, M), since those who read
    a C-kernel ask for times that come from it; it is right to 3e-5 s. In a day it changes by as much, so it
    is evaluated at each instant.

    Args:
        start: UTC of the start of a manoeuvre.
        elapsed: (...) s after it.

    Returns:
        (...) s.

    Raises:
        ValueError: if pyerfa is not installed.
    """
    utc = float((start - _J2000) / np.timedelta64(1, "ns")) * 1e-9
    dynamical = utc + leaps(start) + TT_MINUS_TAI + np.asarray(elapsed, float)
    mean = 6.239996 + 1.99096871e-7 * dynamical
    return np.asarray(dynamical + 1.657e-3 * np.sin(mean + 1.671e-2 * np.sin(mean)))


def leaps(stamp: np.datetime64) -> float:
    """Return by how many seconds TAI is ahead of UTC at a time in UTC; for future years as far as is known.

    Raises:
        ValueError: if pyerfa is not installed.
    """
    try:
        import erfa
    except ImportError as error:
        raise ValueError(
            "leap seconds are needed, and pyerfa is absent: pip install 'jaxplan[orbit]'"
        ) from error
    day = stamp.astype("datetime64[D]").astype(datetime)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)  # that the year is not known yet
        return float(erfa.dat(day.year, day.month, day.day, 0.0))
