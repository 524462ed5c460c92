"""Conversions of times: UTC in files, seconds from the start inside, and SPICE's ephemeris time.

A start is a ``datetime64[ns]`` in UTC, from 1972 on, when UTC got its leap seconds. Elapsed seconds are SI
seconds, so a leap second within a manoeuvre is counted, and written as second 60. Which leap seconds there
are is asked of pyerfa, and only where it matters: none has ever come but at the end of June or December.
"""

import re
import warnings
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
from numpy.typing import ArrayLike

_FIRST, _LAST = 1972, 2099  # years within which epochs must lie
_TOO_FINE = re.compile(r"\.\d{6}\d*[1-9]")
_SECOND = np.timedelta64(1, "s")
_J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
TT_MINUS_TAI = 32.184  # s, terrestrial time less atomic time


def parse_epoch(text: object) -> np.datetime64:
    """Read a time in UTC from its ISO 8601 text.

    Args:
        text: such as ``2026-01-01T00:00:00``, with fractions down to 1e-6 s; UTC unless it names its offset.

    Raises:
        ValueError: if it is no such time, or lies outside 1972 to 2099.
    """
    if _TOO_FINE.search(str(text)):
        raise ValueError(f"epoch = {text!r}: must have at most 6 digits of a second")
    try:
        moment = datetime.fromisoformat(str(text).strip())
        if moment.tzinfo is not None:
            moment = moment.astimezone(UTC).replace(tzinfo=None)
    except (ValueError, OverflowError) as error:
        raise ValueError(
            f"epoch = {text!r}: must be a time in UTC such as 2026-01-01T00:00:00 ({error})"
        ) from error
    if not _FIRST <= moment.year <= _LAST:
        raise ValueError(f"epoch = {text!r}: must lie in the years {_FIRST} to {_LAST}")
    return np.datetime64(moment, "ns")


def utc_texts(start: np.datetime64, times: np.ndarray) -> list[str]:
    """Calendar times, to the nanosecond and without a zone, as in ``2026-01-01T00:00:00.100000000``.

    Args:
        start: of the manoeuvre.
        times: (k,) s after it, in order; they may be a part of a manoeuvre, long after its start.

    Returns:
        k texts; second 60 is a leap second.
    """
    stamps = start + np.round(times * 1e9).astype("timedelta64[ns]")
    half_year = stamps[-1].astype("datetime64[6M]")
    leap = np.zeros(len(stamps), bool)
    if start.astype("datetime64[6M]") != half_year and leaps(stamps[-1]) > leaps(start):
        midnight = half_year.astype("datetime64[ns]")
        late = stamps >= midnight
        leap = late & (stamps < midnight + _SECOND)
        stamps = np.where(late, stamps - _SECOND, stamps)
    texts = np.datetime_as_string(stamps, unit="ns").tolist()
    return [f"{text[:17]}60{text[19:]}" if odd else text for text, odd in zip(texts, leap, strict=True)]


def utc_stamps(epoch: np.datetime64, times: Sequence[float]) -> list[str]:
    """UTC of times, s after an epoch and in any order, to the millisecond, as in ``2026-06-20T09:30:00.000``.

    Args:
        epoch: of the start.
        times: k of them.
    """
    given = np.round(np.asarray(times, float), 3)
    order = np.argsort(given, kind="stable")
    texts = utc_texts(epoch.astype("datetime64[ns]"), given[order]) if len(given) else []
    found = [""] * len(given)
    for place, text in zip(order.tolist(), texts, strict=True):
        found[place] = text[:23]
    return found


def seconds_between(start: np.datetime64, stamp: np.datetime64) -> float:
    """Seconds from one UTC time to another, leap seconds included; negative where it is before.

    Raises:
        ValueError: if leap seconds may lie between, and pyerfa is not installed.
    """
    seconds = float((stamp - start) / np.timedelta64(1, "ns")) / 1e9
    if stamp.astype("datetime64[6M]") != start.astype("datetime64[6M]"):
        seconds += leaps(stamp) - leaps(start)
    return seconds


def ephemeris_time(start: np.datetime64, elapsed: ArrayLike = 0.0) -> np.ndarray:
    """SPICE's ephemeris time, seconds of TDB from J2000 on, as its own ``str2et`` finds it.

    TDB - TT is the one-term formula of SPICE's leap second kernels (constants K, EB, M), since whoever reads
    a C-kernel asks at times that come from it; it is right to 3e-5 s. Over a day it changes by as much, so it
    is taken at each instant.

    Args:
        start: UTC of a manoeuvre's start.
        elapsed: (...) s after it.

    Returns:
        (...) s.
    """
    utc = float((start - _J2000) / np.timedelta64(1, "ns")) * 1e-9
    dynamical = utc + leaps(start) + TT_MINUS_TAI + np.asarray(elapsed, float)
    mean = 6.239996 + 1.99096871e-7 * dynamical
    return np.asarray(dynamical + 1.657e-3 * np.sin(mean + 1.671e-2 * np.sin(mean)))


def leaps(stamp: np.datetime64) -> float:
    """Seconds that TAI is ahead of UTC at a UTC time; in years to come, as far as is known.

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
