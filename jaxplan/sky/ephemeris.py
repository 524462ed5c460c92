"""Satellites whose positions are given as samples over time, by hand or by a CCSDS Orbit Ephemeris Message.

**Between samples** a position follows a polynomial of degree 7: through the four nearest samples with their
velocities (CCSDS: HERMITE, 7), or through the eight nearest where there are none (LAGRANGE, 7); with fewer
samples the degree is less. On a circular orbit of radius r, whose samples are phi rad apart as seen from the
Earth's centre, it is off by at most

    3e-5 r phi^8 with velocities, 1.2e-3 r phi^8 without (0.02 r phi^8 within the first and last three steps).

In low orbit that is far below a millimetre at 60 s; at 180 s below a millimetre, or without velocities 2 cm
(and 30 cm near the ends). On an eccentric orbit, with r and phi at the perigee, it is twice that for an
eccentricity of 0.01 and a hundred times for 0.7. Steps of more than 45 deg are refused, and nothing is
extrapolated.

**Velocities must agree with positions.** Over a step of h s the positions differ by h times the mean of the
two velocities, up to the acceleration's part in ``h |v1 - v0| / (2 cos(phi / 2))``: an acceleration whose
direction turns by no more than phi, as gravity's does, cannot do more, however it is spread over the step.
Samples farther apart than that, by 1 % of the way and 0.1 km for rounding and noise, are refused: velocities
of the wrong sign, unit, row or axes, or a burn between two samples, which belongs between two segments.

**Messages** are read by ccsds-ndm-py, which knows both notations (KVN and XML) and the versions 1 to 3 of
the standard (CCSDS 502.0-B), and needs nothing but numpy. A message may have several segments, as before and
after a burn; each is interpolated by itself, within its useable times. Axes are those of GCRF, ICRF or
EME2000, which are 1.2e-7 rad apart (0.8 m in low orbit) and taken as the same; positions are from the Earth's
centre.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from jaxplan.model.epochs import TT_MINUS_TAI, leaps, parse_epoch
from jaxplan.runtime.arguments import file_path, floats
from jaxplan.runtime.display import shown
from jaxplan.sky.frames import elapsed, library

FRAMES = ("GCRS", "GCRF", "ICRF", "EME2000", "J2000")
"""Names of the axes that samples may have."""
_AHEAD_OF_TAI = {"TAI": 0.0, "TT": TT_MINUS_TAI, "TDB": TT_MINUS_TAI, "GPS": -19.0}  # s, TDB to 0.002 s
_TIME_SYSTEMS = ("UTC", *_AHEAD_OF_TAI)
_POLYNOMIAL_DEGREE = 7  # degree of the polynomial between samples
_MAX_SAMPLE_ANGLE = np.deg2rad(45.0)  # rad, largest angle between neighbouring samples, seen from the centre
FARTHEST = 3_000_000
"""km, greatest coordinate of a position, beyond all that circles the Earth. In metres no position passes: the
largest of its three numbers is at least the Earth's radius over the root of three."""
_ROUNDING_SHARE, _ROUNDING_KM = 0.01, 0.1  # of the way between samples, in which velocities may contradict it
_LEAST_RADIUS = 6356.7  # km, radius of the Earth at its poles; nothing flies below
_MAX_FILE_BYTES = 64 * 2**20  # most bytes of a message, some 500,000 samples
_SECOND = np.timedelta64(1, "s")
_DATE_PATTERN = re.compile(
    r"(\d{4})-(?:(\d\d)-(\d\d)|(\d{3}))T(\d\d):(\d\d):(\d\d(?:\.\d*)?)Z?", re.ASCII
)  # calendar date, or day of the year


class EphemerisError(ValueError):
    """Raised for an ephemeris that cannot be used, or that is asked for a time that it does not cover."""


@shown("times s", "positions km", "velocities km/s", "first s", "last s")
@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Samples of one smooth motion, GCRS, from the Earth's centre.

    Attributes:
        times: (n,) s, rising.
        positions: (n, 3) km.
        velocities: (n, 3) km/s; None where they are not known.
        first: s, begin of the span in which states may be asked for; earlier samples only serve
            interpolation.
        last: s, end of that span, likewise.
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray | None
    first: float
    last: float

    def state(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (k, 3) km and velocities (k, 3) km/s at times (k,) s, from `first` to `last`."""
        from scipy.interpolate import KroghInterpolator  # slow to import, so not at the top

        each = 1 if self.velocities is None else 2  # conditions for each sample
        count = min((_POLYNOMIAL_DEGREE + 1) // each, len(self.times))
        after = np.searchsorted(self.times, times, side="right")
        begin = np.clip(after - count // 2, 0, len(self.times) - count)
        position, velocity = np.zeros((len(times), 3)), np.zeros((len(times), 3))
        for i in np.unique(begin):
            here, part = begin == i, slice(i, i + count)
            middle, half = self.times[part].mean(), np.ptp(self.times[part]) / 2
            wanted = [self.positions[part]]
            if self.velocities is not None:
                wanted.append(self.velocities[part] * half)
            curve = KroghInterpolator(
                np.repeat((self.times[part] - middle) / half, each),
                np.stack(wanted, axis=1).reshape(-1, 3),
            )
            share = (times[here] - middle) / half
            position[here], velocity[here] = curve(share), curve.derivative(share) / half
        return position, velocity


@shown("name", "epoch", "pieces")
@dataclass(frozen=True, kw_only=True, eq=False)
class Ephemeris:
    """A satellite whose positions are known at some times; made by `through` or `read_oem`.

    Attributes:
        name: name of the satellite; empty if it has none.
        epoch: UTC from which the times of the samples count; None for the epoch given in each call.
        pieces: motions, each smooth by itself, in the order of their times.
    """

    name: str
    epoch: np.datetime64 | None
    pieces: tuple[Samples, ...]

    @classmethod
    def through(
        cls,
        times: ArrayLike,
        positions: ArrayLike,
        velocities: ArrayLike | None = None,
        *,
        epoch: str | np.datetime64 | None = None,
        name: str = "",
    ) -> Self:
        """Make the ephemeris through samples, given along the axes of the GCRS from the Earth's centre.

        Args:
            times: (n,) s, rising; at least 2 with velocities, and 4 without.
            positions: (n, 3) km.
            velocities: (n, 3) km/s; None if they are not known.
            epoch: UTC from which times count; None for the epoch given in each call.
            name: name of the satellite.

        Raises:
            EphemerisError: if shapes or numbers are wrong, a coordinate is beyond 3,000,000 km, neighbours
                are more than 45 deg apart as seen from the Earth's centre, or velocities contradict the
                positions.
        """
        piece = _make_samples(times, positions, velocities)
        return cls(name=name, epoch=None if epoch is None else parse_epoch(epoch), pieces=(piece,))


def ephemeris_state(
    ephemeris: Ephemeris, epoch: np.datetime64, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity of a satellite of an ephemeris, by interpolation.

    Args:
        ephemeris: the ephemeris of the satellite.
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3) km and (..., 3) km/s, GCRS.

    Raises:
        EphemerisError: if a time is outside of the spans that the ephemeris covers; nothing is extrapolated.
    """
    asked = times if ephemeris.epoch is None else elapsed(ephemeris.epoch, epoch, times)
    flat = np.ravel(asked)
    position, velocity = np.full((len(flat), 3), np.nan), np.full((len(flat), 3), np.nan)
    for piece in ephemeris.pieces:  # of two that both know a time, the later one has it
        known = (piece.first <= flat) & (flat <= piece.last)
        if np.any(known):
            position[known], velocity[known] = piece.state(flat[known])
    unknown = np.isnan(position[:, 0])
    if np.any(unknown):
        spans = " and ".join(f"[{piece.first:.9g}, {piece.last:.9g}]" for piece in ephemeris.pieces)
        since = "the epoch" if ephemeris.epoch is None else str(ephemeris.epoch)[:19]
        raise EphemerisError(
            f"ephemeris{f' of {ephemeris.name}' * bool(ephemeris.name)}: asked for {flat[unknown][0]:.9g} s "
            f"after {since}, is known in {spans} s"
        )
    shape = (*np.shape(asked), 3)
    return position.reshape(shape), velocity.reshape(shape)


def read_oem(path: str | os.PathLike[str]) -> Ephemeris:
    """Read the ephemeris of a CCSDS Orbit Ephemeris Message.

    Args:
        path: path of the file, in the notation of keywords (KVN) or XML, of at most 64 MiB.

    Raises:
        EphemerisError: if it is no such message, or one about another centre, with axes that are not
            inertial, in an unknown time system, or with states that are no motion, as in
            `Ephemeris.through`; it names the segment and the state, counted from 0.
        OSError: if the file cannot be read.
        ImportError: if the extra ``oem`` is not installed.
    """
    target = file_path("path", path)
    reader = library("ccsds_ndm")
    with target.open("rb") as file:
        content = file.read(_MAX_FILE_BYTES + 1)
    if len(content) > _MAX_FILE_BYTES:
        raise EphemerisError(f"{target}: too large, at most {_MAX_FILE_BYTES} bytes are read")
    try:
        message = reader.Oem.from_str(content.decode())
    except (ValueError, reader.NdmError) as error:
        reason = " ".join(str(error).split())
        raise EphemerisError(f"{target}: no Orbit Ephemeris Message ({reason})") from error
    try:
        epoch, pieces = _read_segments(message.segments)
    except ValueError as error:
        raise EphemerisError(f"{target}: {error}") from error
    return Ephemeris(name=message.segments[0].metadata.object_name, epoch=epoch, pieces=pieces)


def _read_segments(segments: Sequence[Any]) -> tuple[np.datetime64, tuple[Samples, ...]]:
    """Check the segments of a message, and return their samples with the epoch from which their times count.

    The epoch is a midnight of UTC.

    Raises:
        EphemerisError: if a segment cannot be used.
    """
    if not segments:
        raise EphemerisError("has no segment")
    pieces: list[Samples] = []
    epoch: Any = None
    for i, segment in enumerate(segments):
        told = segment.metadata
        for key, value, known in (
            ("CENTER_NAME", told.center_name.upper(), ("EARTH",)),
            ("REF_FRAME", told.ref_frame.upper(), FRAMES),
            ("TIME_SYSTEM", told.time_system.upper(), _TIME_SYSTEMS),
            ("OBJECT_NAME", told.object_name, (segments[0].metadata.object_name,)),
        ):
            if value not in known:
                raise EphemerisError(f"segment {i}, {key} = {value}: must be {' or '.join(known)}")
        dates = [*segment.data.state_vector_epochs]
        ends = [told.useable_start_time or dates[0], told.useable_stop_time or dates[-1]]
        days, seconds = atomic([*dates, *ends], told.time_system.upper())
        if epoch is None:
            epoch = days[0].astype("datetime64[ns]")
        times = (days - epoch) / _SECOND + seconds - leaps(epoch)
        table = np.asarray(segment.data.state_vector_numpy, float)
        try:
            pieces.append(_make_samples(times[:-2], table[:, :3], table[:, 3:6], *times[-2:]))
        except EphemerisError as error:
            raise EphemerisError(f"segment {i}, {error}") from error
    assert epoch is not None
    return epoch, tuple(sorted(pieces, key=lambda piece: piece.first))


def atomic(dates: Sequence[str], system: str) -> tuple[np.ndarray, np.ndarray]:
    """Convert dates to International Atomic Time: midnights (n,), and seconds (n,) from there on.

    Args:
        dates: n dates as CCSDS writes them, by calendar or by day of the year; second 60 is a leap second.
        system: their time system, one of `_TIME_SYSTEMS`.

    Raises:
        EphemerisError: (a ValueError) for text that is not a date, or a day that its year does not have.
    """
    midnights, seconds = [], []
    for date in dates:
        found = _DATE_PATTERN.fullmatch(date.strip())
        if found is None:
            raise EphemerisError(f"{date!r}: must be a time such as 2026-01-01T00:00:00.0")
        year, month, day, of_year, hour, minute, second = found.groups()
        first = parse_epoch(f"{year}-{month or '01'}-{day or '01'}").astype("datetime64[D]")
        midnight = first + np.timedelta64(int(of_year or 1) - 1, "D")
        if midnight.astype("datetime64[Y]") != first.astype("datetime64[Y]"):
            raise EphemerisError(f"{date!r}: the year {year} has no day {of_year}")
        midnights.append(midnight)
        seconds.append(int(hour) * 3600 + int(minute) * 60 + float(second))
    ahead = {day: -leaps(day) if system == "UTC" else _AHEAD_OF_TAI[system] for day in set(midnights)}
    return np.array(midnights), np.array(seconds) - [ahead[day] for day in midnights]


def _make_samples(
    times: ArrayLike,
    positions: ArrayLike,
    velocities: ArrayLike | None,
    first: float | None = None,
    last: float | None = None,
) -> Samples:
    """Check samples and return them as `Samples`.

    `first` and `last`, s, bound the span in which states may be asked for; None for all of the samples' span.

    Raises:
        EphemerisError: if shapes or numbers are wrong.
    """
    t = floats("times", times, "an array of numbers of seconds")
    p = floats("positions", positions, "an array of positions, km")
    v = None if velocities is None else floats("velocities", velocities, "an array of velocities, km/s")
    least = 4 if v is None else 2
    if t.ndim == 1 and len(t) < least and p.shape == (len(t), 3) and (v is None or v.shape == p.shape):
        beside = ", or 2 with velocities" if v is None else ""
        raise EphemerisError(f"positions: must be at {least} times or more{beside}, not {len(t)}")
    if t.ndim != 1 or len(t) < least or p.shape != (len(t), 3) or (v is not None and v.shape != p.shape):
        raise EphemerisError(
            f"times, positions and velocities: must be (n,), (n, 3) and (n, 3) or None, n at least {least}, "
            f"not {t.shape}, {p.shape} and {None if v is None else v.shape}"
        )
    for name, array in (("times", t), ("positions", p), ("velocities", v)):
        if array is not None and not np.all(np.isfinite(array)):
            i = int(np.argwhere(~np.isfinite(array))[0][0])
            raise EphemerisError(f"{name}[{i}] = {array[i].tolist()}: must be finite")
    if not np.all(np.diff(t) > 0):
        i = int(np.argmin(np.diff(t) > 0)) + 1
        raise EphemerisError(f"times[{i}] = {t[i]:.9g}: must be later than the one before, {t[i - 1]:.9g}")
    radius = np.linalg.norm(p, axis=1)
    if not np.all(radius > _LEAST_RADIUS):
        i = int(np.argmin(radius > _LEAST_RADIUS))
        raise EphemerisError(
            f"positions[{i}] = {p[i].tolist()}: is {radius[i]:.6g} km from the Earth's centre, inside it"
        )
    if not np.all(np.abs(p) <= FARTHEST):
        i = int(np.argmax(np.any(np.abs(p) > FARTHEST, axis=1)))
        raise EphemerisError(
            f"positions[{i}] = {p[i].tolist()}: must lie in [-{FARTHEST}, {FARTHEST}], it is in km"
        )
    unit = p / radius[:, None]
    apart = 2 * np.arcsin(np.clip(np.linalg.norm(np.diff(unit, axis=0), axis=1) / 2, 0, 1))
    if not np.all(apart <= _MAX_SAMPLE_ANGLE):
        i = int(np.argmax(apart > _MAX_SAMPLE_ANGLE))
        raise EphemerisError(
            f"positions[{i + 1}]: is {np.rad2deg(apart[i]):.4g} deg from the one before, seen from the "
            f"Earth's centre, at most {np.rad2deg(_MAX_SAMPLE_ANGLE):g}: give more samples"
        )
    if v is not None:
        _check_velocities(t, p, v, apart)
    begin, end = t[0] if first is None else first, t[-1] if last is None else last
    if not t[0] <= begin < end <= t[-1]:
        raise EphemerisError(
            f"useable times [{begin:.9g}, {end:.9g}] s: must lie in [{t[0]:.9g}, {t[-1]:.9g}]"
        )
    return Samples(times=t, positions=p, velocities=v, first=float(begin), last=float(end))


def _check_velocities(t: np.ndarray, p: np.ndarray, v: np.ndarray, apart: np.ndarray) -> None:
    """Raise an EphemerisError where positions and velocities contradict each other (module's docstring).

    Args:
        t: (n,) s, rising.
        p: (n, 3) km.
        v: (n, 3) km/s.
        apart: (n - 1,) rad between neighbouring positions, seen from the Earth's centre.
    """
    step, moved = np.diff(t), np.diff(p, axis=0)
    way = step[:, None] * (v[1:] + v[:-1]) / 2
    most = step * np.linalg.norm(np.diff(v, axis=0), axis=1) / (2 * np.cos(apart / 2))
    most += _ROUNDING_SHARE * np.linalg.norm(moved, axis=1) + _ROUNDING_KM
    off = np.linalg.norm(moved - way, axis=1)
    if np.all(off <= most):
        return
    i = int(np.argmax(off > most))
    told = [", ".join(f"{number:.6g}" for number in vector) for vector in (moved[i], way[i])]
    raise EphemerisError(
        f"positions[{i}] and [{i + 1}]: are [{told[0]}] km apart, but in {step[i]:.6g} s the velocities "
        f"there lead [{told[1]}] km, which is {off[i]:.4g} km off, at most {most[i]:.4g} can be: give "
        "velocities in km/s, of the same times and along the same axes as the positions"
    )
