"""Positions of things, directions in which they are seen, how fast these turn, and how large bodies look.

The observer and what is looked at are each a satellite (`CircularOrbit`, `KeplerOrbit`, `Tle`, `Ephemeris` or
`SpkBody`), a `GroundPoint`, a body's name or a position in km from the Earth's centre: (3,), or (k, 3) for k
times. Times are (...) s after the epoch, a number or (k,).

Directions that depend on the observer's own motion have names, too, with ``r`` its position from the Earth's
centre and ``v`` its velocity, both inertial, in the GCRS:

    nadir         -r, to the Earth's centre; not at right angles to the ellipsoid (0.19 deg off at most)
    zenith        r
    ram           v; at right angles to nadir on a circular orbit alone
    orbit_normal  r x v

They make the local orbital frame (`local_axes`): z to nadir, y against the orbit's normal, and x = y x z,
which completes the right-handed set and is along the velocity on a circular orbit. STK calls it VVLH.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from jaxplan.geometry.vectors import separation
from jaxplan.model.epochs import parse_epoch
from jaxplan.runtime.arguments import floats, number
from jaxplan.sky.ephemeris import Ephemeris, ephemeris_state
from jaxplan.sky.frames import BODIES, RADII, body_state, seconds
from jaxplan.sky.ground import GroundPoint, ground_state
from jaxplan.sky.orbits import CircularOrbit, KeplerOrbit, kepler_state, orbit_state
from jaxplan.sky.spk import SpkBody, spk_state
from jaxplan.sky.two_line_elements import Tle, tle_state

Satellite: TypeAlias = CircularOrbit | KeplerOrbit | Tle | Ephemeris | SpkBody
Thing: TypeAlias = Satellite | GroundPoint | str | np.ndarray | Sequence[float]
Epoch: TypeAlias = str | np.datetime64

LOCAL = ("nadir", "zenith", "ram", "orbit_normal")
"""Names of the directions that go with the observer's own motion."""
_STATE_FUNCTIONS: dict[type, Callable[[Any, np.datetime64, np.ndarray], tuple[np.ndarray, np.ndarray]]] = {
    CircularOrbit: orbit_state,
    KeplerOrbit: kepler_state,
    Tle: tle_state,
    Ephemeris: ephemeris_state,
    SpkBody: spk_state,
    GroundPoint: ground_state,
}

DRIFT_SAMPLES = 512  # intervals over a duration, at least; more make a drift's bound sharper
LONGEST_DRIFT = 86400.0  # s, beyond which a duration is refused
_LONGEST_STEP = 10.0  # s between samples of a drift, at most
_RATE_STEP = (
    0.5  # s to either side, over which ram and orbit_normal are differenced; off by 1e-10 rad/s at most
)


def positions(thing: Thing, *, epoch: Epoch, times: ArrayLike = 0.0) -> np.ndarray:
    """Return positions of a thing at times.

    With these, `jaxplan.sky.orbits.earth_blocks` tells whether the Earth is in between two satellites.

    Args:
        thing: a satellite, a point of the ground, a body's name, or a position.
        epoch: UTC, such as ``"2026-03-20T12:00:00"``.
        times: (...) s after it.

    Returns:
        (..., 3) km from the Earth's centre, GCRS.

    Raises:
        ValueError: if an argument is not valid; a `TleError` where SGP4 has no answer, an `EphemerisError` at
            a time outside of an ephemeris.
        ImportError: if the extra ``orbit`` is needed and not installed.
    """
    return _state(thing, epoch, times)[0]


def velocities(thing: Thing, *, epoch: Epoch, times: ArrayLike = 0.0) -> np.ndarray:
    """Return velocities of a thing at times; the arguments are those of `positions`.

    Returns:
        (..., 3) km/s relative to the Earth's centre, GCRS.

    Raises:
        ValueError: as for `positions`, and for a given position, whose motion is not known.
    """
    velocity = _state(thing, epoch, times)[1]
    if velocity is None:
        raise ValueError("of a given position the velocity is not known: give a satellite or a body")
    return velocity


def directions(target: Thing, *, epoch: Epoch, observer: Thing, times: ArrayLike = 0.0) -> np.ndarray:
    """Return directions in which a target is seen, for the axis of a zone or the target of a terminal.

    Args:
        target: what is looked at, or one of `LOCAL`.
        epoch: UTC.
        observer: who looks, anything with a position.
        times: (...) s after the epoch.

    Returns:
        (..., 3) unit vectors from observer to target, GCRS; geometric, as described in `jaxplan.sky`.

    Raises:
        ValueError: as for `positions`, and if the two are in one place.
    """
    if isinstance(target, str) and target in LOCAL:
        return _local_direction(target, observer, epoch, times)
    between, distance = _vector_and_distance(target, observer, epoch, times)
    return between / distance[..., None]


def local_axes(observer: Thing, *, epoch: Epoch, times: ArrayLike = 0.0) -> np.ndarray:
    """Return the rotation from inertial axes (GCRS) to the local orbital frame.

    Its axis z points to nadir, y against the orbit's normal, and x = y x z, about along the velocity.

    Args:
        observer: a satellite.
        epoch: UTC.
        times: (...) s after the epoch.

    Returns:
        (..., 3, 3) whose rows are the frame's axes x, y and z, GCRS.

    Raises:
        ValueError: as for `directions`, and if the orbit has no normal: the
            observer's velocity is not known, or vertical.
    """
    down = _local_direction("nadir", observer, epoch, times)
    across = -_local_direction("orbit_normal", observer, epoch, times)
    return np.stack([np.cross(across, down), across, down], axis=-2)


def direction_rates(target: Thing, *, epoch: Epoch, observer: Thing, times: ArrayLike = 0.0) -> np.ndarray:
    """Return the time derivative of `directions`, of the same arguments: how fast the direction turns.

    The angular velocity of a line that follows the target, without spin about itself, is the cross product of
    the direction and this.

    Returns:
        (..., 3) 1/s, perpendicular to the direction; its length is the rate of turn in rad/s.

    Raises:
        ValueError: as for `directions`, and where either is a given position, whose motion is not known.
    """
    if isinstance(target, str) and target in LOCAL:
        after = np.asarray(times, float)
        ahead, behind = (
            _local_direction(target, observer, epoch, after + step) for step in (_RATE_STEP, -_RATE_STEP)
        )
        return (ahead - behind) / (2 * _RATE_STEP)
    between, distance = _vector_and_distance(target, observer, epoch, times)
    unit = between / distance[..., None]
    moving = velocities(target, epoch=epoch, times=times) - velocities(observer, epoch=epoch, times=times)
    across = moving - np.sum(moving * unit, axis=-1, keepdims=True) * unit
    rates: np.ndarray = across / distance[..., None]
    return rates


def angular_radius(
    body: str, *, epoch: Epoch, observer: Thing, times: ArrayLike = 0.0, atmosphere_km: float = 0.0
) -> np.ndarray:
    """Return the angle between the centre of a body and its limb.

    Args:
        body: ``"sun"``, ``"moon"`` or ``"earth"``.
        epoch: UTC.
        observer: who looks, anything with a position.
        times: (...) s after the epoch.
        atmosphere_km: height of air that counts as the Earth, in [0, 1000]; some 100 km matter to optics.

    Returns:
        (...) rad, ``asin(radius / distance)``.

    Raises:
        ValueError: as for `directions`, and if the observer is not outside the body.
    """
    check_body(body)
    if not 0 <= number("atmosphere_km", atmosphere_km, "a number of km") <= 1000:
        raise ValueError(f"atmosphere_km = {atmosphere_km}: must lie in [0, 1000]")
    radius = RADII[body] + (atmosphere_km if body == "earth" else 0.0)
    _, distance = _vector_and_distance(body, observer, epoch, times)
    if not np.all(distance > radius):
        raise ValueError(
            f"observer: {np.min(distance):.6g} km from the centre of the {body}, must be beyond {radius:.6g}"
        )
    return np.asarray(np.arcsin(radius / distance))


def drift(target: Thing, *, epoch: Epoch, observer: Thing, duration_s: float) -> float:
    """Return the largest angle by which the direction to a target departs from that at the epoch.

    Args:
        target: what is looked at.
        epoch: UTC.
        observer: who looks, a satellite or a body.
        duration_s: how long from the epoch on, s, in [0, 86400].

    Returns:
        rad, rounded up by as much as may happen between samples.

    Raises:
        ValueError: as for `directions`.
    """
    times = drift_times(observer, duration_s)
    seen = directions(target, epoch=epoch, observer=observer, times=times)
    return float(np.max(separation(seen[0], seen)) + half_step(seen))


def drift_times(observer: Thing, duration_s: float) -> np.ndarray:
    """Return evenly spaced times (k,) s over a duration, with its ends and middle; a single one for zero.

    Raises:
        ValueError: if the duration is out of range, or not zero for an observer whose motion is not known.
    """
    if not 0 <= number("duration", duration_s, "a number of s") <= LONGEST_DRIFT:
        raise ValueError(f"duration = {duration_s}: must lie in [0, {LONGEST_DRIFT:g}] s")
    if duration_s == 0:
        return np.zeros(1)
    if not isinstance(observer, (*_STATE_FUNCTIONS, str)):
        raise ValueError(
            f"observer: a given position says nothing of its motion over {duration_s:g} s; give a satellite"
        )
    intervals = max(DRIFT_SAMPLES, 2 * int(np.ceil(duration_s / _LONGEST_STEP / 2)))
    return np.linspace(0.0, duration_s, intervals + 1)


def half_step(seen: np.ndarray) -> float:
    """Return half of the largest angle, rad, between neighbours among unit vectors (k, 3).

    On the arc between two of them no direction is farther from the nearer one.
    """
    return float(np.max(separation(seen[1:], seen[:-1]), initial=0.0)) / 2


def _state(thing: Thing, epoch: Epoch, times: ArrayLike) -> tuple[np.ndarray, np.ndarray | None]:
    """Return position (..., 3) km and velocity (..., 3) km/s of a thing, GCRS.

    The velocity is None for a given position.

    Raises:
        ValueError: as for `positions`.
    """
    start, after = parse_epoch(epoch), seconds(times)
    if type(thing) in _STATE_FUNCTIONS:
        return _STATE_FUNCTIONS[type(thing)](thing, start, after)
    if isinstance(thing, str):
        check_body(thing)
        return body_state(thing, start, after)
    position = floats("position", thing, "3 numbers of km, a satellite or the name of a body")
    if position.shape not in ((3,), (*after.shape, 3)):
        wanted = "(3,)" if after.ndim == 0 else f"(3,) or {(*after.shape, 3)}"
        raise ValueError(f"position: must be of shape {wanted}, km, not {position.shape}")
    if not np.all(np.isfinite(position)):
        raise ValueError(f"position = {position[~np.isfinite(position)][0]}: must be finite")
    return np.broadcast_to(position, (*after.shape, 3)).copy(), None


def check_body(body: object) -> None:
    """Raise a ValueError for what is not the name of a body."""
    if not isinstance(body, str) or body not in BODIES:
        raise ValueError(f"body = {body!r}: must be 'sun', 'moon' or 'earth'")


def _vector_and_distance(
    target: Thing, observer: Thing, epoch: Epoch, times: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Return the vector (..., 3) km from observer to target, GCRS, and its length (...) km.

    Raises:
        ValueError: as for `positions`, and where the length is zero.
    """
    between = positions(target, epoch=epoch, times=times) - positions(observer, epoch=epoch, times=times)
    distance = np.linalg.norm(between, axis=-1)
    if not np.all(distance > 0):
        raise ValueError("target and observer are in one place, so that there is no direction")
    return between, distance


def _local_direction(name: str, observer: Thing, epoch: Epoch, times: ArrayLike) -> np.ndarray:
    """Return unit vectors (..., 3), GCRS, of the direction of `LOCAL` that has a given name.

    Raises:
        ValueError: as for `positions`, and where there is no such direction.
    """
    position = positions(observer, epoch=epoch, times=times)
    if name in ("nadir", "zenith"):
        along = position if name == "zenith" else -position
    else:
        velocity = velocities(observer, epoch=epoch, times=times)
        along = velocity if name == "ram" else np.cross(position, velocity)
    length = np.linalg.norm(along, axis=-1, keepdims=True)
    if not np.all(length > 0):
        raise ValueError(f"target = {name!r}: the observer is at the Earth's centre, or does not move")
    unit: np.ndarray = along / length
    return unit
