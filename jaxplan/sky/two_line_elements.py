"""Satellites by two-line elements (TLE), which are read here and propagated by SGP4.

A set of two-line elements is two lines of 69 columns, perhaps with a name above. Every column is checked,
since sgp4 is silent about most of what is wrong: digits off by one column, or a line of another satellite,
would put the satellite anywhere. Each fault names line, columns and value; all come at once.
"""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np

from jaxplan.runtime.display import shown
from jaxplan.sky.frames import elapsed, library, teme_to_gcrs

COLUMNS = 69  # characters of a line
STALE_DAYS = 7.0  # days from the elements' epoch: from here on SGP4 is likely tens of km off in low orbit
LAST_DAYS = 30.0  # days from the elements' epoch: beyond, it is hundreds of km off, and is not used
_SECONDS_PER_DAY = 86400.0

# What SGP4 answers instead of a position, by its codes.
_SGP4_ERRORS = {
    1: "the mean eccentricity leaves [0, 1)",
    2: "the mean motion is not positive",
    3: "the perturbed eccentricity leaves [0, 1]",
    4: "the semi-latus rectum is negative",
    6: "the satellite has decayed",
}

_NUMBER_PATTERN = r"[ 0-9A-HJ-NP-Z][ 0-9]{3}[0-9]"  # the letter stands for two digits: alpha-5
_ANGLE_PATTERN = r"(?=.{8}) *\d{1,3}\.\d{4}"


@dataclass(frozen=True)
class _Column:
    """A field of a line: its columns, counted from one, both ends included, and what may stand there.

    Attributes:
        first: its first column.
        last: its last column.
        name: its name in messages.
        pattern: regular expression that the field's text must match.
        example: a text that matches, for messages.
        range: least and largest number that it may be; None for any.
    """

    first: int
    last: int
    name: str
    pattern: str
    example: str
    range: tuple[float, float] | None = None

    def fault(self, here: str, line: str) -> str | None:
        """Return a message about what is wrong with the field in a line; None if nothing is.

        The message begins with the words `here`.
        """
        value = line[self.first - 1 : self.last]
        several = self.last > self.first
        span = f"columns {self.first} to {self.last}" if several else f"column {self.first}"
        place = f"{here}, {span} ({self.name}) = {value!r}"
        if not re.fullmatch(self.pattern, value, re.ASCII):
            return f"{place}: must be written as in {self.example!r}"
        if self.range is not None and not self.range[0] <= float(value) <= self.range[1]:
            return f"{place}: must lie in [{self.range[0]:.15g}, {self.range[1]:.15g}]"
        return None


_LAYOUT = {
    1: (
        _Column(3, 7, "catalogue number", _NUMBER_PATTERN, "25544"),
        _Column(8, 8, "classification", "[UCS ]", "U"),
        _Column(19, 20, "year of the epoch", r"\d\d", "26"),
        _Column(21, 32, "day of the epoch", r" *\d{1,3}\.\d{8}", "079.50000000", (1, 366.99999999)),
        _Column(34, 43, "first derivative of the mean motion", r"[ +0-]\.\d{8}", " .00016717"),
        _Column(45, 52, "second derivative of the mean motion", r"[ +-]\d{5}[ +-]\d", " 00000-0"),
        _Column(54, 61, "drag term B*", r"[ +-]\d{5}[ +-]\d", " 10270-3"),
        _Column(63, 63, "type of ephemeris", r"[ 0-9]", "0"),
        _Column(65, 68, "number of the set", r"[ 0-9]{4}", " 999"),
    ),
    2: (
        _Column(3, 7, "catalogue number", _NUMBER_PATTERN, "25544"),
        _Column(9, 16, "inclination", _ANGLE_PATTERN, " 51.6400", (0, 180)),
        _Column(18, 25, "right ascension of the ascending node", _ANGLE_PATTERN, "208.9163", (0, 360)),
        _Column(27, 33, "eccentricity after the decimal point", r"\d{7}", "0006317"),
        _Column(35, 42, "argument of perigee", _ANGLE_PATTERN, " 69.9862", (0, 360)),
        _Column(44, 51, "mean anomaly", _ANGLE_PATTERN, "290.2224", (0, 360)),
        _Column(53, 63, "mean motion", r" *\d{1,2}\.\d{8}", "15.49560532", (1e-3, 18)),
        _Column(64, 68, "number of the revolution", r"[ 0-9]{5}", "12345"),
    ),
}
_BLANK_COLUMNS = {1: (2, 9, 18, 33, 44, 53, 62, 64), 2: (2, 8, 17, 26, 34, 43, 52)}


class TleError(ValueError):
    """Raised for two-line elements that cannot be used.

    Attributes:
        faults: messages, one line of text each.
    """

    def __init__(self, *faults: str) -> None:
        self.faults = faults
        super().__init__(*faults)  # what a copy in another process is made from

    def __str__(self) -> str:
        if len(self.faults) == 1:
            return f"two-line elements: {self.faults[0]}"
        return "\n  ".join([f"two-line elements with {len(self.faults)} faults:", *self.faults])


class StaleTleWarning(UserWarning):
    """Warns that a time is so far from the epoch of two-line elements that SGP4 is many km off."""


@shown("epoch", "line1", "line2")
@dataclass(frozen=True)
class Tle:
    """A satellite of two-line elements; made by `parse_tle`, which checks them.

    Attributes:
        name: text of the line above the two, or else the catalogue number.
        line1: 69 characters.
        line2: 69 characters.
        epoch: UTC of the elements, ``datetime64[ns]``.
    """

    name: str
    line1: str
    line2: str
    epoch: np.datetime64


def parse_tle(text: str) -> Tle:
    """Read a satellite from its two-line elements.

    Args:
        text: the two lines, perhaps with a line above that has the name. Blank lines and blanks at the end of
            lines are ignored.

    Raises:
        TleError: if a line has the wrong number, length, characters, value or check sum, or the two are of
            different satellites; all faults at once, with line, columns and value.
    """
    given: object = text  # whatever its type says
    if not isinstance(given, str):
        raise TleError(f"must be a text, not {type(given).__name__}")
    lines = [line.rstrip() for line in text.splitlines() if line.strip()]
    if len(lines) not in (2, 3):
        raise TleError(f"must be two lines, or three with a name first, not {len(lines)}")
    pair = {1: lines[-2], 2: lines[-1]}
    faults = [fault for number, line in pair.items() for fault in _line_faults(number, line)]
    if not faults and pair[1][2:7] != pair[2][2:7]:
        faults.append(f"line 2 is of satellite {pair[2][2:7]!r}, line 1 of {pair[1][2:7]!r}")
    epoch = None if faults else _read_epoch(pair[1])
    if epoch is not None and epoch < np.datetime64("1972-01-01"):
        faults.append(f"line 1, columns 19 to 20 (year of the epoch) = {pair[1][18:20]!r}: before 1972")
    if epoch is not None and epoch.astype("datetime64[Y]") != _read_year(pair[1]):
        place = f"line 1, columns 21 to 32 (day of the epoch) = {pair[1][20:32]!r}"
        faults.append(f"{place}: must be below 366, since {_read_year(pair[1])} has 365 days")
    if faults or epoch is None:
        raise TleError(*faults)
    name = lines[0].removeprefix("0 ").strip() if len(lines) == 3 else ""
    return Tle(name=name or pair[1][2:7].strip(), line1=pair[1], line2=pair[2], epoch=epoch)


def check_sum(line: str) -> int:
    """Return the last digit that a line should have, from the 68 characters before it.

    It is the last digit of the sum of the digits, where minus signs count as one.
    """
    return sum(int(c) if c.isdigit() else c == "-" for c in line[: COLUMNS - 1]) % 10


def _line_faults(number: int, line: str) -> list[str]:
    """Return messages on what is wrong with a line by itself, which should be line `number`, 1 or 2."""
    here = f"line {number}"
    if not line.isascii():
        place = next(place for place, character in enumerate(line, 1) if not character.isascii())
        return [f"{here}, column {place} = {line[place - 1]!r}: must be ASCII"]
    if not line.startswith(f"{number} "):
        return [f"{here} = {line[:12]!r}...: must begin with '{number} '"]
    if len(line) != COLUMNS:
        return [f"{here} has {len(line)} characters, must have {COLUMNS}"]
    faults = [
        f"{here}, column {place} = {line[place - 1]!r}: must be blank"
        for place in _BLANK_COLUMNS[number]
        if line[place - 1] != " "
    ]
    faults += [fault for column in _LAYOUT[number] if (fault := column.fault(here, line))]
    if not line[-1].isdigit():
        faults.append(f"{here}, column {COLUMNS} (check sum) = {line[-1]!r}: must be a digit")
    elif int(line[-1]) != check_sum(line):
        faults.append(
            f"{here}, column {COLUMNS} (check sum) = {line[-1]}: the line adds up to {check_sum(line)}"
        )
    return faults


def _read_year(line: str) -> np.datetime64:
    """Return the year of the epoch of line 1."""
    year = int(line[18:20])
    return np.datetime64(
        year - 1970 + (1900 if year >= 57 else 2000), "Y"
    )  # the first satellite flew in 1957


def _read_epoch(line: str) -> np.datetime64:
    """Return the epoch, UTC, of line 1, to its last digit of 1e-8 days."""
    whole, fraction = line[20:32].split(".")
    since = (int(whole) - 1) * 86_400_000_000_000 + int(fraction) * 864_000
    return _read_year(line).astype("datetime64[ns]") + np.timedelta64(since, "ns")


def tle_state(tle: Tle, epoch: np.datetime64, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity by SGP4, with the constants of WGS 72 to which elements are fitted.

    Args:
        tle: the satellite's elements.
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3) km and (..., 3) km/s, GCRS.

    Raises:
        TleError: if a time is more than 30 days from the elements' epoch, or SGP4 finds that the satellite
            has decayed or has no orbit.

    Warns:
        StaleTleWarning: if a time is more than 7 days from the elements' epoch.
    """
    position, velocity = tle_state_teme(tle, elapsed(tle.epoch, epoch, times))
    rotation = teme_to_gcrs(epoch, times)
    return (rotation @ position[..., None])[..., 0], (rotation @ velocity[..., None])[..., 0]


def tle_state_teme(tle: Tle, since: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity by SGP4 in its own frame, TEME of each instant.

    It raises and warns as `tle_state` does.

    Args:
        tle: the satellite's elements.
        since: (...) s after their epoch.

    Returns:
        (..., 3) km and (..., 3) km/s, TEME.
    """
    _check_age(tle, since)
    record = library("sgp4.api").Satrec.twoline2rv(tle.line1, tle.line2)
    days = np.atleast_1d(since) / _SECONDS_PER_DAY
    codes, position, velocity = record.sgp4_array(
        np.full(days.shape, record.jdsatepoch), record.jdsatepochF + days
    )
    bad = (codes != 0) | ~np.all(np.isfinite(position) & np.isfinite(velocity), axis=-1)
    if np.any(bad):
        first = int(np.argmax(bad))
        reason = _SGP4_ERRORS.get(int(codes[first]), f"SGP4 has no answer (code {codes[first]})")
        raise TleError(f"{tle.name}: {reason}, {days[first]:.6g} days from the elements' epoch {tle.epoch}")
    return position.reshape(*since.shape, 3), velocity.reshape(*since.shape, 3)


# Elements that have warned of their age in the block of `stale_once` that runs; None outside of such blocks.
_told: ContextVar[set[Tle] | None] = ContextVar("told", default=None)


@contextmanager
def stale_once() -> Iterator[None]:
    """Let each set of elements warn of its age only once while a block runs, or what this decorates."""
    token = _told.set(set())
    try:
        yield
    finally:
        _told.reset(token)


def _check_age(tle: Tle, since: np.ndarray) -> None:
    """Raise a TleError, or warn, where times (...) s are too far from the epoch of the elements.

    The limits are `LAST_DAYS` and `STALE_DAYS`.
    """
    if not since.size:
        return
    days = np.abs(since) / _SECONDS_PER_DAY
    oldest = float(since.flat[int(np.argmax(days))]) / _SECONDS_PER_DAY
    far = f"{tle.name}: {oldest:.1f} days from the elements' epoch {str(tle.epoch)[:19]}"
    if not np.all(days <= LAST_DAYS):
        raise TleError(f"{far}, must lie in [{-LAST_DAYS:g}, {LAST_DAYS:g}]")
    told = _told.get()
    if np.any(days > STALE_DAYS) and (told is None or tle not in told):
        if told is not None:
            told.add(tle)
        advice = f"beyond {STALE_DAYS:g} the position may be tens of km off; take newer elements"
        warnings.warn(f"{far}, {advice}", StaleTleWarning, stacklevel=2)
