"""Instants, frames and bodies: everything that pyerfa computes.

**Instants** are an epoch in UTC and seconds after it. pyerfa takes Julian dates of several time scales, each
in two parts to keep all digits.

**Frames.** Directions are along the axes of the GCRS. SGP4 computes in TEME, which has its z axis along the
Earth's true axis of date (Celestial Ephemeris Pole), and its x axis in the true equator where sidereal time
is the mean one of 1982: it differs from the true equator and equinox of date by a turn about z, the equation
of the equinoxes. That it goes with GMST of 1982 is how its authors define it (Vallado and others, AIAA
2006-6753, appendix C):

    r_Earth = R3(GMST82) r_TEME = R3(GAST) r_true,     r_true = N P B r_GCRS,

so that r_GCRS = (N P B)^T R3(GMST82 - GAST) r_TEME. N P B is IAU 2006/2000A's. The turn is the difference of
two sidereal times of one instant, in which UT1 - UTC does not matter.

**The turning Earth.** Points of the ground are fixed to axes that turn with the Earth (ITRS), about the
Celestial Intermediate Pole by the Earth rotation angle, IAU 2006/2000A. Left out are polar motion, 0.6 arc
seconds or 20 m at most, and UT1 - UTC: the Earth is turned as if UT1 were UTC, by which a place at the
equator is off to east or west by 46 m for each 0.1 s between the two, which are at most 0.9 s apart (420 m).

**Bodies.** The Earth's orbit about the Sun is pyerfa's ``epv00`` (1900 to 2100, 1e-7 of the distance), the
Moon's ``moon98`` (Meeus, 10 arc seconds). Radii are IAU's: nominal of the Sun (2015 B3), mean of the Moon
(2015), equatorial of the Earth, so that the flattened Earth lies within the sphere.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jaxplan.model.epochs import TT_MINUS_TAI, leaps
from jaxplan.runtime.arguments import floats

BODIES = ("sun", "moon", "earth")
# World Geodetic System 1984 (NGA.STND.0036): equatorial radius, and GM of the Earth with its atmosphere.
EARTH_RADIUS = 6378.137  # km
EARTH_MU = 398600.4418  # km^3/s^2

RADII = {"sun": 695_700.0, "moon": 1737.4, "earth": EARTH_RADIUS}  # km, see the module
_UNIX_DAY_ZERO = 2440587.5  # Julian date of 1970-01-01T00:00
_SECONDS_PER_DAY = 86400.0
EARTH_RATE = 2 * np.pi * 1.00273781191135448 / _SECONDS_PER_DAY  # rad/s, Earth's rotation (IERS 2010, 5.15)
_POLE_NODES = 12  # instants between which precession and nutation are interpolated
_MAX_POLE_SPAN = 1.1  # days, most that one polynomial covers
_MAX_SECONDS = 4.1e9  # s, which span all years that an epoch may lie in; times beyond are refused


def library(module: str) -> Any:
    """Import and return a module that comes with one of the extras.

    It is ``erfa`` or a module of ``sgp4`` (extra ``orbit``), ``ccsds_ndm`` (``oem``), or ``spiceypy``
    (``spice``).

    Raises:
        ImportError: if it is not installed; the message names the extra.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = {"erfa": "pyerfa", "ccsds_ndm": "ccsds-ndm-py"}.get(module, module.partition(".")[0])
        extra = {"ccsds_ndm": "oem", "spiceypy": "spice"}.get(module, "orbit")
        raise ImportError(f"{package} is missing: pip install 'jaxplan[{extra}]'") from error


def seconds(times: ArrayLike) -> np.ndarray:
    """Check times after an epoch and return them as an array.

    Args:
        times: () or (k,) s.

    Raises:
        ValueError: if they have another shape, are not finite, or are more than 4.1e9 s (130 years) away.
    """
    array = floats("times", times, "a number of seconds, or (k,) of them")
    if array.ndim > 1:
        raise ValueError(f"times: must be a number or (k,) numbers of seconds, not of shape {array.shape}")
    wrong = array[~(np.abs(array) <= _MAX_SECONDS)]
    if wrong.size:
        raise ValueError(f"times = {wrong.flat[0]}: must lie in [{-_MAX_SECONDS:g}, {_MAX_SECONDS:g}] s")
    return array


def universal(epoch: np.datetime64, times: np.ndarray) -> tuple[float, np.ndarray]:
    """Return UTC as a Julian date in two parts, which stands for UT1 where a second does not matter.

    Args:
        epoch: UTC.
        times: (...) s after it.

    Returns:
        The Julian date of the midnight before the epoch, and (...) days from there on.
    """
    midnight = epoch.astype("datetime64[D]")
    since = float((epoch - midnight) / np.timedelta64(1, "ns")) * 1e-9
    return _UNIX_DAY_ZERO + float(midnight.astype(int)), (since + times) / _SECONDS_PER_DAY


def terrestrial(epoch: np.datetime64, times: np.ndarray) -> tuple[float, np.ndarray]:
    """Return Terrestrial Time as a Julian date in two parts; arguments and parts are those of `universal`.

    It also stands for TDB, which is the same to 0.002 s.
    """
    day, since = universal(epoch, times)
    return day, since + (_leap_seconds(epoch) + TT_MINUS_TAI) / _SECONDS_PER_DAY


def elapsed(since: np.datetime64, epoch: np.datetime64, times: np.ndarray) -> np.ndarray:
    """Return the SI seconds (...) from `since` to times (...) s after `epoch`, leap seconds counted.

    Both instants are UTC.
    """
    apart = float((epoch - since) / np.timedelta64(1, "ns")) * 1e-9
    return apart + (_leap_seconds(epoch) - _leap_seconds(since) if epoch != since else 0.0) + times


def _leap_seconds(epoch: np.datetime64) -> float:
    """Return the seconds by which TAI is ahead of UTC at an epoch; raise an ImportError without pyerfa."""
    library("erfa")  # for the message where it is missing
    return leaps(epoch)


def teme_to_gcrs(epoch: np.datetime64, times: np.ndarray) -> np.ndarray:
    """Return the rotation from TEME of each instant to the axes of the GCRS.

    It changes by some 8e-12 rad/s (precession), which is negligible for a velocity in orbit.

    Args:
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3, 3).
    """
    erfa = library("erfa")
    (day, since), (_, universal_since) = terrestrial(epoch, times), universal(epoch, times)

    def slow_numbers(since: np.ndarray) -> np.ndarray:
        true_of_date = erfa.pnm06a(day, since)  # from the GCRS
        ut = day, since - ahead
        turn = erfa.anpm(erfa.gmst82(*ut) - erfa.gst06(*ut, day, since, true_of_date))
        return np.concatenate([true_of_date.reshape(*since.shape, 9), turn[..., None]], axis=-1)

    ahead = (since - universal_since).flat[0] if np.size(since) else 0.0
    slow = _interpolated(slow_numbers, since)
    true_of_date, turn = slow[..., :9].reshape(*np.shape(since), 3, 3), slow[..., 9]
    c, s, o = np.cos(turn), np.sin(turn), np.zeros(np.shape(turn))
    about_z = np.stack([c, s, o, -s, c, o, o, o, o + 1], axis=-1).reshape(*np.shape(turn), 3, 3)
    rotation: np.ndarray = np.swapaxes(true_of_date, -1, -2) @ about_z
    return rotation


def earth_fixed_state(
    place: np.ndarray, epoch: np.datetime64, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity of a place that turns with the Earth.

    Args:
        place: (3,) km, along the axes that are fixed to the Earth (ITRS).
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3) km and (..., 3) km/s, GCRS.
    """
    to_sky = np.swapaxes(gcrs_to_earth(epoch, times), -1, -2)
    return to_sky @ place, to_sky @ np.cross([0.0, 0.0, EARTH_RATE], place)


def gcrs_to_earth(epoch: np.datetime64, times: np.ndarray) -> np.ndarray:
    """Return the rotation from the axes of the GCRS to those that are fixed to the Earth (ITRS).

    Args:
        epoch: UTC, which stands for UT1.
        times: (...) s after it.

    Returns:
        (..., 3, 3).
    """
    erfa = library("erfa")
    instant = terrestrial(epoch, times)
    celestial = erfa.c2ixys(*_celestial_pole(*instant))
    moved = erfa.pom00(0.0, 0.0, erfa.sp00(*instant))
    rotation: np.ndarray = erfa.c2tcio(celestial, erfa.era00(*universal(epoch, times)), moved)
    return rotation


def _celestial_pole(day: float, since: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the Celestial Intermediate Pole's X, Y and the locator s, each (...) rad, of IAU 2006/2000A.

    Args:
        day: Terrestrial Time as a Julian date, its first part.
        since: (...) days, its second part.
    """
    erfa = library("erfa")
    found = _interpolated(lambda since: np.stack(erfa.xys06a(day, since), axis=-1), since)
    return found[..., 0], found[..., 1], found[..., 2]


def _interpolated(slow: Callable[[np.ndarray], np.ndarray], since: np.ndarray) -> np.ndarray:
    """Return numbers (..., c) that change slowly, at instants (...) in days.

    Precession and nutation have thousands of terms, and change by 5e-9 rad in an hour, so many instants are
    interpolated, by one polynomial a day, which is off by less than rounding.

    Args:
        slow: the function from instants (...) to numbers (..., c).
        since: the instants.
    """
    low, high = float(np.min(since, initial=np.inf)), float(np.max(since, initial=-np.inf))
    span = high - low if low < high else 0.0
    days = max(1, int(np.ceil(min(span / _MAX_POLE_SPAN, np.size(since)))))
    if np.size(since) <= 2 * _POLE_NODES * days or not span:
        return slow(np.asarray(since))
    width = span / days
    day = np.minimum(((since - low) / width).astype(int), days - 1)
    nodes = np.polynomial.chebyshev.chebpts1(_POLE_NODES)
    found: np.ndarray = np.empty(0)
    for each in range(days):
        middle = low + (each + 0.5) * width
        fits = np.polynomial.chebyshev.chebfit(nodes, slow(middle + nodes * width / 2), _POLE_NODES - 1)
        if not each:
            found = np.empty((*since.shape, fits.shape[1]))
        own = day == each
        found[own] = np.polynomial.chebyshev.chebval(2 * (since[own] - middle) / width, fits).T
    return found


def body_state(body: str, epoch: np.datetime64, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity of a body.

    Args:
        body: one of `BODIES`.
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3) km from the Earth's centre and (..., 3) km/s, GCRS.
    """
    if body == "earth":
        return np.zeros((*times.shape, 3)), np.zeros((*times.shape, 3))
    erfa = library("erfa")
    instant = terrestrial(epoch, times)
    if body == "sun":
        heliocentric, _ = erfa.epv00(*instant)
        sign, pv = -1.0, heliocentric
    else:
        sign, pv = 1.0, erfa.moon98(*instant)
    unit = sign * erfa.DAU * 1e-3  # km
    return unit * pv["p"], unit / erfa.DAYSEC * pv["v"]
