"""Bodies and spacecraft of SPICE's ephemeris kernels (SPK), by their NAIF numbers.

CSPICE itself evaluates each segment at each instant that is asked for (`spkpvn`), so that nothing is sampled
and no accuracy is lost: a position is that of ``spkgeo`` to rounding. Kernels are read by handle, without
SPICE's pool: what a user has loaded there neither counts nor changes. As in SPICE, of two kernels the later
one has precedence, and within one the later segment.

A segment gives a body's motion from some centre. So positions are summed along a chain of centres, and so are
those of the Earth (399), until both chains meet: a spacecraft about the Earth needs its own kernel alone, one
about the Sun or a planet a planetary one beside it (such as ``de440s.bsp``), which has the Earth.

Times need no kernel: ephemeris time comes from UTC as in `jaxplan.model.epochs`, by the formula of SPICE's
own leap second kernels, which is right to 3e-5 s (0.2 m in low orbit) against TDB and to rounding against
``str2et``.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan.model.epochs import ephemeris_time
from jaxplan.runtime.arguments import file_path
from jaxplan.runtime.display import shown
from jaxplan.sky.ephemeris import EphemerisError
from jaxplan.sky.frames import library

_EARTH = 399
_J2000 = 1  # SPICE's number of the axes J2000
_LAST_INERTIAL_FRAME = 21  # the largest number of axes that SPICE knows to be inertial without a kernel
_LEAST_RADIUS = 6356.7  # km, radius of the Earth at its poles; nothing is inside
_TIME_TOLERANCE = 5e-7  # s, by which an instant may be beyond an end: ephemeris times are rounded to 1e-7 s
_LONGEST_CHAIN = 10  # centres; a spacecraft about a moon of a planet needs four


@shown("body", "center", "frame", "first s", "last s")
@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """A part of a kernel: the motion of a body from a centre over a span of time.

    Attributes:
        file: index of its kernel among the files.
        body: NAIF number of the body.
        center: NAIF number of the centre.
        frame: SPICE's number of its axes.
        first: begin of the span, s of ephemeris time.
        last: end of the span, s of ephemeris time.
        summary: its descriptor, as SPICE packs it.
    """

    file: int
    body: int
    center: int
    frame: int
    first: float
    last: float
    summary: np.ndarray


@shown("number", "files")
@dataclass(frozen=True, kw_only=True, eq=False)
class SpkBody:
    """A body or spacecraft of ephemeris kernels; made by `read_spk`.

    Attributes:
        name: SPICE's own name of its number; else "body" and the number.
        number: NAIF number.
        files: paths of the kernels, of which later ones have precedence.
        segments: those of all kernels, in order of precedence, the one to be used first coming first.
    """

    name: str
    number: int
    files: tuple[str, ...]
    segments: tuple[Segment, ...]


def read_spk(paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], number: int) -> SpkBody:
    """Read where a body or spacecraft is from SPICE's ephemeris kernels.

    Args:
        paths: path of a kernel (``.bsp``), or of several, of which later ones have precedence.
        number: the NAIF number of the body, such as -170 or 499.

    Returns:
        The body, which may serve as an observer or a target. The files are read again whenever positions are
        asked for.

    Raises:
        EphemerisError: if a file is no such kernel, or the kernels lack the number or the chain from it to
            the Earth's centre.
        OSError: if a file cannot be read.
        ImportError: if the extra ``spice`` is not installed.

    Example:
        >>> there = jp.sky.read_spk(["de440s.bsp", "mission.bsp"], -999)
        >>> jp.sky.directions(there, epoch="2026-06-20T09:30:00", observer=orbit)
    """
    spice = library("spiceypy")
    if isinstance(number, bool) or not isinstance(number, int | np.integer):
        raise EphemerisError(f"number = {number!r}: must be a whole number, as NAIF numbers bodies")
    if number == _EARTH:
        raise EphemerisError(f"number = {_EARTH}: is the Earth, from whose centre positions are: say 'earth'")
    several = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    if not several:
        raise EphemerisError("paths: must name a kernel at least")
    files = tuple(str(file_path("path", path)) for path in several)
    segments: list[Segment] = []
    for place, file in enumerate(files):
        with open(file, "rb"):  # SPICE's words for this are its own
            pass
        segments += _read_segments(spice, file, place)
    name, found = _body_name(spice, int(number)), tuple(segments[::-1])
    body = SpkBody(name=name, number=int(number), files=files, segments=found)
    _check_chain(body)
    return body


def _body_name(spice: Any, number: int) -> str:
    """Return SPICE's name of a number, or "body" and the number."""
    with spice.no_found_check():
        name, found = spice.bodc2n(number)
    return str(name) if found else f"body {number}"


def _read_segments(spice: Any, file: str, place: int) -> list[Segment]:
    """Return the segments of a kernel, in its order; raise an EphemerisError for a file that is no kernel.

    `place` is the index of the file.
    """
    try:
        kind = spice.getfat(file)
    except spice.exceptions.SpiceyError as error:
        raise EphemerisError(f"{file}: no SPK kernel ({_error_words(error)})") from error
    if tuple(kind) != ("DAF", "SPK"):
        known = "" if "?" in kind else f" but {' '.join(kind)}"  # SPICE's mark of what it does not know
        raise EphemerisError(f"{file}: no SPK kernel{known}")
    found = []
    with _open_kernels(spice, [file]) as (handle,):
        spice.dafbfs(handle)
        while spice.daffna():
            summary = spice.dafgs(5)
            times, numbers = spice.dafus(summary, 2, 6)
            found.append(
                Segment(
                    file=place,
                    body=int(numbers[0]),
                    center=int(numbers[1]),
                    frame=int(numbers[2]),
                    first=float(times[0]),
                    last=float(times[1]),
                    summary=np.array(summary),
                )
            )
    return found


@contextmanager
def _open_kernels(spice: Any, files: Sequence[str]) -> Iterator[list[int]]:
    """Open kernels for reading and yield their handles; raise an EphemerisError with SPICE's words."""
    handles: list[int] = []
    try:
        for file in files:
            handles.append(spice.dafopr(file))
        yield handles
    except spice.exceptions.SpiceyError as error:
        raise EphemerisError(f"{', '.join(files)}: SPICE refuses: {_error_words(error)}") from error
    finally:
        for handle in handles:
            spice.dafcls(handle)


def _error_words(error: Exception) -> str:
    """Return what SPICE says of an error, on one line."""
    return " ".join(str(getattr(error, "long", "") or getattr(error, "short", "") or error).split())


def _check_chain(body: SpkBody) -> None:
    """Raise an EphemerisError if kernels lack a body, or the chain from it to the Earth's centre."""
    own = [each for each in body.segments if each.body == body.number]
    where = ", ".join(body.files)
    if not own:
        known = ", ".join(str(number) for number in sorted({each.body for each in body.segments}))
        raise EphemerisError(f"{where}: have no {body.name} ({body.number}), but {known or 'nothing'}")
    reached, reached_by_earth = _reachable_centers(body, body.number), _reachable_centers(body, _EARTH)
    if not reached & reached_by_earth:
        raise EphemerisError(
            f"{where}: know {body.name} from {sorted(reached - {body.number})} and not from the Earth "
            f"({_EARTH}): give a planetary kernel, such as de440s.bsp, too"
        )
    for each in body.segments:
        if each.body in reached | reached_by_earth and not 1 <= each.frame <= _LAST_INERTIAL_FRAME:
            raise EphemerisError(
                f"{where}: axes number {each.frame} of {each.body} are not known to be inertial"
            )


def _reachable_centers(body: SpkBody, start: int) -> set[int]:
    """Return the numbers of all centres to which a body's position may be chained, with its own."""
    found, fresh = {start}, {start}
    while fresh:
        fresh = {each.center for each in body.segments if each.body in fresh} - found
        found |= fresh
    return found


def spk_state(body: SpkBody, epoch: np.datetime64, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity of a body of kernels.

    Args:
        body: a body, see `read_spk`.
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3) km and (..., 3) km/s from the Earth's centre, GCRS.

    Raises:
        EphemerisError: if a time is outside of the spans that the kernels cover, or the body inside the
            Earth.
        OSError: if a file is gone.
    """
    spice = library("spiceypy")
    asked = np.ravel(ephemeris_time(epoch, times))
    states = np.zeros((len(asked), 6))
    with _open_kernels(spice, body.files) as handles:
        for row, moment in enumerate(asked):
            states[row] = _state_from_earth(spice, body, handles, float(moment))
    radius = np.linalg.norm(states[:, :3], axis=1)
    if not np.all(radius > _LEAST_RADIUS):
        row = int(np.argmin(radius > _LEAST_RADIUS))
        raise EphemerisError(
            f"{body.name}: is {radius[row]:.6g} km from the Earth's centre, inside it, "
            f"{np.ravel(times)[row]:.9g} s after {str(epoch)[:19]}"
        )
    shape = (*np.shape(times), 3)
    return states[:, :3].reshape(shape), states[:, 3:].reshape(shape)


def _state_from_earth(spice: Any, body: SpkBody, handles: Sequence[int], moment: float) -> np.ndarray:
    """Return the state (6,) of a body from the Earth's centre, km and km/s along J2000.

    `moment` is the ephemeris time, s.
    """
    own, earth = (_chained_states(spice, body, handles, start, moment) for start in (body.number, _EARTH))
    for center, state in own.items():  # the first that both are known from
        if center in earth:
            return state - earth[center]
    ends = [next(reversed(chain)) for chain in (own, earth)]
    spans = [
        f"[{_tdb_date(each.first)}, {_tdb_date(each.last)}]"
        for each in body.segments[::-1]
        if each.body in ends
    ]
    raise EphemerisError(
        f"{body.name}: asked for {_tdb_date(moment)}, is known in {' and '.join(dict.fromkeys(spans))}, TDB"
    )


def _chained_states(
    spice: Any, body: SpkBody, handles: Sequence[int], start: int, moment: float
) -> dict[int, np.ndarray]:
    """Return the states (6,) of a body from itself, from its centre, from the centre of that, and so on.

    The states are keyed by the numbers of the centres, in km and km/s along J2000.
    """
    states = {start: np.zeros(6)}
    here = start
    for _ in range(_LONGEST_CHAIN):
        for each in body.segments:
            if each.body == here and each.first - _TIME_TOLERANCE <= moment <= each.last + _TIME_TOLERANCE:
                break
        else:
            return states
        frame, step, center = spice.spkpvn(
            handles[each.file], each.summary, min(max(moment, each.first), each.last)
        )
        if frame != _J2000:
            turn = np.asarray(spice.irfrot(frame, _J2000))
            step = np.concatenate([turn @ step[:3], turn @ step[3:]])
        states[int(center)] = states[here] + step
        here = int(center)
    return states


def _tdb_date(moment: float) -> str:
    """Return an ephemeris time as a date of TDB, to the microsecond without zeros at its end."""
    date = str(np.datetime64("2000-01-01T12:00:00", "us") + np.timedelta64(round(moment * 1e6), "us"))
    return date.rstrip("0").rstrip(".")
