"""Passes: when a satellite or a point of the ground can be seen, and how it is seen then.

A pass is a span of time in which nothing hides the target, see `jaxplan.sky.line_of_sight`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxplan.geometry.vectors import separation
from jaxplan.model.epochs import parse_epoch
from jaxplan.runtime.arguments import number
from jaxplan.runtime.display import shown
from jaxplan.sky.ground import GroundPoint, elevation
from jaxplan.sky.line_of_sight import Occulter, least_between, seen_between
from jaxplan.sky.sights import Epoch, Satellite, Thing, directions, positions
from jaxplan.sky.two_line_elements import stale_once

LONGEST = 31 * 86400.0
"""s, the longest time over which passes are looked for."""
_CHECK_STEP = 10.0  # s, largest time between checks of whether something is seen
_CHECKS_PER_PASS = 64  # number of checks within a pass of how it is seen


@shown("target", "start s", "end s", "best s", "elevation deg", "distance km", "off_nadir deg")
@dataclass(frozen=True, kw_only=True)
class Pass:
    """A span of time in which a target can be seen; times are in s after the epoch.

    Attributes:
        target: name of the target.
        start: s, when it comes into sight, or 0 if it is in sight at the epoch.
        end: s, when it goes out of sight, or the end of the time searched.
        best: s, when the observer is highest above the horizon of a point of the ground, or a satellite is
            nearest.
        elevation: rad, of the observer above the horizon of a point of the ground at `best`; None for a
            satellite.
        distance: km, at `best`.
        off_nadir: rad, the angle at the observer between the Earth's centre and the target at `best`.
    """

    target: str
    start: float
    end: float
    best: float
    elevation: float | None
    distance: float
    off_nadir: float

    @property
    def duration(self) -> float:
        """Duration of the pass, s."""
        return self.end - self.start


@stale_once()
def passes(
    thing: Satellite | GroundPoint,
    *,
    epoch: Epoch,
    observer: Satellite,
    duration_s: float,
    name: str = "target",
    atmosphere_km: float = 0.0,
    occulters: Sequence[Occulter] = (),
) -> tuple[Pass, ...]:
    """Find when a satellite or a point of the ground can be seen.

    A point of the ground is seen from its least elevation upward, a satellite past the Earth with its air and
    past the occulters, as targets of a plan are. The line is evaluated every 10 s, and its least and greatest
    clearance between are found, so that short passes are found, too.

    Args:
        thing: what is looked at.
        epoch: UTC, from which times count.
        observer: the satellite that looks.
        duration_s: how long to search from the epoch on, s, in (0, 31 * 86400].
        name: name of the target.
        atmosphere_km: height of air that counts as the Earth, in [0, 1000].
        occulters: spheres that may hide the target, beside the Earth.

    Returns:
        The passes in order, empty if there are none; the first may have begun before, and the last may go on.

    Raises:
        TypeError: if `thing` is neither a satellite nor a point of the ground, or the observer no satellite.
        ValueError: if a number is out of range, or a motion not known for so long.

    Example:
        >>> lisbon = jp.sky.GroundPoint(latitude=0.676, longitude=-0.159, minimum_elevation=0.17)
        >>> jp.sky.passes(lisbon, epoch="2026-03-20T12:00:00", observer=here, duration_s=86400.0)
    """
    for argument, given, kinds in (
        ("thing", thing, (Satellite, GroundPoint)),
        ("observer", observer, (Satellite,)),
    ):
        if not isinstance(given, kinds):
            raise TypeError(
                f"{argument} must be a satellite{' or a GroundPoint' * (len(kinds) > 1)}, not {given!r}"
            )
    if not 0 < number("duration_s", duration_s, "a number of s") <= LONGEST:
        raise ValueError(f"duration_s = {duration_s}: must lie in (0, {LONGEST:.0f}]")
    times = np.linspace(0.0, duration_s, max(3, int(np.ceil(duration_s / _CHECK_STEP)) + 1))
    spans = seen_between(
        thing, times, epoch=epoch, observer=observer, atmosphere_km=atmosphere_km, occulters=occulters
    )
    if not spans:
        return ()
    starts, ends = np.array(spans).T
    best = _best_times(thing, starts, ends, epoch, observer)
    here, there = (positions(one, epoch=epoch, times=best) for one in (observer, thing))
    toward = directions(thing, epoch=epoch, observer=observer, times=best)
    down = directions("nadir", epoch=epoch, observer=observer, times=best)
    high = [None] * len(best)
    if isinstance(thing, GroundPoint):
        high = elevation(thing, here, parse_epoch(epoch), best).tolist()
    return tuple(
        Pass(target=name, start=start, end=end, best=at, elevation=up, distance=far, off_nadir=off)
        for start, end, at, up, far, off in zip(
            starts.tolist(),
            ends.tolist(),
            best.tolist(),
            high,
            np.linalg.norm(there - here, axis=-1).tolist(),
            separation(toward, down).tolist(),
            strict=True,
        )
    )


def _best_times(
    thing: Thing, starts: np.ndarray, ends: np.ndarray, epoch: Epoch, observer: Thing
) -> np.ndarray:
    """Return the times (k,) s within k spans when a point is seen highest, or a satellite is nearest."""

    def cost(times: np.ndarray) -> np.ndarray:
        here, flat = positions(observer, epoch=epoch, times=times.ravel()), times.ravel()
        if isinstance(thing, GroundPoint):
            found = -elevation(thing, here, parse_epoch(epoch), flat)
        else:
            found = np.linalg.norm(positions(thing, epoch=epoch, times=flat) - here, axis=-1)
        return found.reshape(times.shape)

    looks = np.linspace(starts, ends, _CHECKS_PER_PASS + 1, axis=-1)
    place = np.argmin(cost(looks), axis=-1)[:, None]
    low, high = (
        np.take_along_axis(looks, np.clip(place + side, 0, _CHECKS_PER_PASS), axis=-1)[:, 0]
        for side in (-1, 1)
    )
    return least_between(cost, low, high)
