"""Lines of sight: when a target is hidden by the Earth with its air, by its horizon, or by something else.

There are three rules. A line is blocked by a sphere that the segment from observer to target meets; the Earth
is one, with its equatorial radius and a height that counts as air, and others may be added (`Occulter`). A
point of the ground is seen from its least elevation upward, measured from the plane at right angles to the
ellipsoid's normal; for it this replaces the Earth's sphere. Bodies and directions such as ``nadir`` are never
hidden: an array may face the Sun in the Earth's shadow, too.

Light is taken to go straight and at once: refraction, which lifts the horizon by 0.5 deg, is left out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from jaxplan.model.directions import DirectionPath
from jaxplan.model.epochs import parse_epoch
from jaxplan.model.hidden_spans import UNNAMED, Hidden
from jaxplan.runtime.arguments import number
from jaxplan.runtime.display import shown
from jaxplan.sky.body_zones import path
from jaxplan.sky.frames import RADII
from jaxplan.sky.ground import GroundPoint, elevation
from jaxplan.sky.sights import Epoch, Thing, drift_times, positions

_GUARD = 1e-6  # s, by which spans are longer than found, so that at their ends nothing is hidden any more
_TERNARY_ITERATIONS = 40  # iterations of ternary search for an extremum, to 2e-6 s of the 20 s about it
_BISECTION_ITERATIONS = 34  # iterations of bisection for an end of a span, to 1e-9 s
EARTH, HORIZON = "the Earth", "its horizon"  # what hides, in messages

Height: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""How far a line is above what may hide it, from times (k,) s to (k,); negative where it is hidden."""


@shown("name", "radius km")
@dataclass(frozen=True, kw_only=True)
class Occulter:
    """A sphere that may hide targets.

    Attributes:
        name: its name in messages.
        thing: what is at its centre: a satellite or a body's name.
        radius: km.
    """

    name: str
    thing: Thing
    radius: float


def occulter(name: str, thing: Thing | None = None, *, radius_km: float | None = None) -> Occulter:
    """Make a sphere that may hide targets, beside the Earth, which always does.

    Args:
        name: the name of a body, "sun" or "moon"; or what messages are to call the satellite given.
        thing: a satellite at the centre; None for the body of that name.
        radius_km: radius of the sphere, in (0, 1e6]; None for the body's own, but a satellite needs a number.

    Raises:
        ValueError: if it is the Earth, or its radius is not known or out of range.
    """
    if thing is None and name not in ("sun", "moon"):
        raise ValueError(f"name = {name!r}: must be 'sun' or 'moon', or that of a satellite that is given")
    radius = RADII.get(name) if radius_km is None and thing is None else radius_km
    if radius is None:
        raise ValueError("radius_km: missing, since a satellite has none that is known")
    if not 0 < number("radius_km", radius, "a number of km") <= 1e6:
        raise ValueError(f"radius_km = {radius}: must lie in (0, 1e6]")
    return Occulter(name=name, thing=name if thing is None else thing, radius=float(radius))


def target(
    thing: Thing,
    *,
    epoch: Epoch,
    observer: Thing,
    duration_s: float,
    name: str = UNNAMED,
    atmosphere_km: float = 0.0,
    occulters: Sequence[Occulter] = (),
) -> DirectionPath:
    """Find the direction to a target over a manoeuvre, and when it is hidden; plans end while it is seen.

    Args:
        thing: what is looked at: a satellite, a point of the ground, a body's name, or one of `LOCAL`.
        epoch: UTC of the manoeuvre's start.
        observer: the satellite that looks.
        duration_s: s, in (0, 86400].
        name: what messages and figures call the target.
        atmosphere_km: height of air that counts as the Earth, in [0, 1000]; some 100 km matter to optics.
        occulters: spheres that may hide the target, beside the Earth.

    Returns:
        The path as from `path`, with the spans in which the target is hidden; none for a body or one of
        `LOCAL`.

    Raises:
        ValueError: as `path`, and if the observer is not outside the Earth's air and the occulters.
    """
    found = path(thing, epoch=epoch, observer=observer, duration_s=duration_s)
    called = "" if name == UNNAMED else name
    if isinstance(thing, str):
        return replace(found, called=called or thing)
    spans = hidden(
        thing,
        epoch=epoch,
        observer=observer,
        duration_s=duration_s,
        name=name,
        atmosphere_km=atmosphere_km,
        occulters=occulters,
    )
    return replace(found, hidden=spans, called=called)


def hidden(
    thing: Thing,
    *,
    epoch: Epoch,
    observer: Thing,
    duration_s: float,
    name: str = UNNAMED,
    atmosphere_km: float = 0.0,
    occulters: Sequence[Occulter] = (),
) -> tuple[Hidden, ...]:
    """Find the spans of time in which a target is hidden; the arguments are those of `target`.

    The clearance of each line is evaluated every 10 s or oftener, and its least and greatest values between
    are found, so that short spans are found too, unless several fall between two evaluations.

    Returns:
        Spans in the order of their beginnings, for each thing that hides the target; they may overlap. Empty
        where it is never hidden.
    """
    times = drift_times(observer, duration_s)
    heights = _height_functions(thing, times, epoch, observer, atmosphere_km, occulters)
    found = [
        Hidden(target=name, by=by, start=start, end=end)
        for by, height in heights
        for start, end in _find_negative_spans(height, times)
    ]
    return tuple(sorted(found, key=lambda span: span.start))


def seen_between(
    thing: Thing,
    times: np.ndarray,
    *,
    epoch: Epoch,
    observer: Thing,
    atmosphere_km: float = 0.0,
    occulters: Sequence[Occulter] = (),
) -> list[tuple[float, float]]:
    """Find the spans (start, end) s in which nothing hides a target, in order.

    Args:
        thing: what is looked at: a satellite or a point of the ground.
        times: (n,) s, rising: the span to be searched, and where lines are evaluated first, as in `hidden`.
        epoch: UTC, from which times count.
        observer: the satellite that looks.
        atmosphere_km: as for `hidden`.
        occulters: as for `hidden`.
    """
    heights = _height_functions(thing, times, epoch, observer, atmosphere_km, occulters)
    hiding = sorted(span for _, height in heights for span in _find_negative_spans(height, times))
    seen, begin = [], float(times[0])
    for start, end in [*hiding, (float(times[-1]), np.inf)]:
        if start > begin:
            seen.append((begin, start))
        begin = max(begin, end)
    return seen


def _height_functions(
    thing: Thing,
    times: np.ndarray,
    epoch: Epoch,
    observer: Thing,
    atmosphere_km: float,
    occulters: Sequence[Occulter],
) -> list[tuple[str, Height]]:
    """Return how far the line to a target is above each thing that may hide it, with the names of these.

    Raises:
        ValueError: if the air has no such height, or the observer is inside of a sphere at one of the times.
    """
    if not 0 <= number("atmosphere_km", atmosphere_km, "a number of km") <= 1000:
        raise ValueError(f"atmosphere_km = {atmosphere_km}: must lie in [0, 1000]")
    spheres = [one for one in occulters if one.thing is not thing]
    heights: list[tuple[str, Height]] = []
    if isinstance(thing, GroundPoint):
        heights.append((HORIZON, partial(_elevation_margin, thing, observer, parse_epoch(epoch))))
    else:
        spheres.insert(0, Occulter(name=EARTH, thing="earth", radius=RADII["earth"] + atmosphere_km))
    for sphere in spheres:
        nearest = float(np.min(_sphere_distance(sphere, observer, observer, epoch, times))) + sphere.radius
        if not nearest > sphere.radius:
            raise ValueError(
                f"observer: {nearest:.6g} km from the centre of {sphere.name}, "
                f"must be beyond {sphere.radius:.6g}"
            )
        heights.append((sphere.name, partial(_sphere_distance, sphere, thing, observer, epoch)))
    return heights


def _elevation_margin(
    point: GroundPoint, observer: Thing, epoch: np.datetime64, times: np.ndarray
) -> np.ndarray:
    """Return the elevation of an observer above the least one of a point of the ground, (k,) rad.

    `times` (k,) are in s. The result is negative where the observer is not seen.
    """
    here = positions(observer, epoch=epoch, times=times)
    return elevation(point, here, epoch, times) - point.minimum_elevation


def _sphere_distance(
    sphere: Occulter, thing: Thing, observer: Thing, epoch: Epoch, times: np.ndarray
) -> np.ndarray:
    """Return the distance (k,) km of the segment from observer to thing from a sphere; negative inside it.

    `times` (k,) are in s after the epoch.
    """
    places = [positions(one, epoch=epoch, times=times) for one in (sphere.thing, observer, thing)]
    return clearance(*places) - sphere.radius


def clearance(centre: np.ndarray, observer: np.ndarray, thing: np.ndarray) -> np.ndarray:
    """Return the least distance (...) km of a centre from the segment from observer to thing.

    All positions are (..., 3) km.
    """
    start, way = observer - centre, thing - observer
    square = np.sum(way * way, axis=-1)
    along = np.clip(-np.sum(start * way, axis=-1) / np.where(square > 0, square, 1), 0, 1)
    return np.asarray(np.linalg.norm(start + along[..., None] * way, axis=-1))


def least_between(
    function: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return the times (k,) s at which a function of time is least between bounds.

    Args:
        function: function of times (k,) s, which falls and then rises between the bounds.
        low: (k,) s, lower bounds.
        high: (k,) s, upper bounds.
    """
    for _ in range(_TERNARY_ITERATIONS):
        first, second = low + (high - low) / 3, high - (high - low) / 3
        later = function(first) > function(second)
        low, high = np.where(later, first, low), np.where(later, high, second)
    return np.asarray((low + high) / 2)


def _find_negative_spans(
    height: Callable[[np.ndarray], np.ndarray], times: np.ndarray
) -> list[tuple[float, float]]:
    """Return the spans (start, end) s in which a smooth function of time is negative.

    They are longer than found by `_GUARD` at both ends.

    Args:
        height: function from times (k,) s to values (k,).
        times: (n,) s, rising: where it is evaluated first, to find its extrema.
    """
    values = height(times)
    before, middle, after = values[:-2], values[1:-1], values[2:]
    sign = np.where(middle > 0, 1.0, -1.0)  # dips where positive, peaks where negative, may cross zero
    turning = 1 + np.flatnonzero((sign * middle <= sign * before) & (sign * middle <= sign * after))
    if len(turning):
        side = sign[turning - 1]
        extrema = least_between(lambda at: side * height(at), times[turning - 1], times[turning + 1])
        times = np.union1d(times, extrema)
    negative = height(times) < 0
    changes = np.flatnonzero(negative[1:] != negative[:-1])
    low, high, below = times[changes], times[changes + 1], negative[changes]
    for _ in range(_BISECTION_ITERATIONS if len(changes) else 0):
        middle = (low + high) / 2
        same = (height(middle) < 0) == below
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    edges = [*times[:1][negative[:1]], *((low + high) / 2), *times[-1:][negative[-1:]]]
    starts, ends = np.maximum(np.array(edges[::2]) - _GUARD, times[0]), np.array(edges[1::2]) + _GUARD
    return list(zip(starts.tolist(), ends.tolist(), strict=True))
