"""Keep-out zones about Sun, Moon and Earth, and the direction to a target over a manoeuvre.

Over 80 s in low orbit the Earth's direction turns by 5 deg. So a zone that stands still has its axis where
the body is in the middle of the zone's time, and is wide enough to contain the body's cone at every instant.
The axis of a zone that moves follows the body, and its half angle is that of the largest cone.
"""

import math
from collections.abc import Sequence

import numpy as np

from jaxplan.geometry.vectors import separation
from jaxplan.model.directions import DirectionPath
from jaxplan.model.zones import KeepOut
from jaxplan.runtime.arguments import number, several
from jaxplan.sky.sights import (
    Epoch,
    Thing,
    angular_radius,
    check_body,
    directions,
    drift_times,
    half_step,
)

ACCURACY = 1e-9  # rad: how far a path may be from the direction in the middle between two samples
_INITIAL_INTERVALS = 8  # intervals of a path to begin with; they are halved until it is accurate
_MAX_SAMPLES = 4096  # samples of a path, or one a second of a longer one
_ROUNDING_SCALE = 1e9  # half angles are rounded up to 1e-9 deg, so that files hold them exactly


def path(target: Thing, *, epoch: Epoch, observer: Thing, duration_s: float) -> DirectionPath:
    """Sample the direction to a target over a manoeuvre, until a spline through the samples is accurate.

    Args:
        target: what is looked at: a satellite, a point of the ground, a body's name, one of `LOCAL`, or a
            position.
        epoch: UTC of the manoeuvre's start.
        observer: who looks, a satellite or a body.
        duration_s: s, in (0, 86400].

    Returns:
        The path, as the axis of a zone or the target of a terminal. Samples are so dense that in the middle
        between any two it is within 1e-9 rad of `directions`.

    Raises:
        ValueError: as for `directions`; and if the target passes so close that 4,096 samples, or one a
            second, are not enough, or its velocity jumps, as in an ephemeris with a burn.
        ImportError: if the extra ``orbit`` is needed and not installed.

    Example:
        >>> zone = KeepIn(name="link", direction=sky.path(neighbour, epoch=epoch, observer=here,
        ...     duration_s=80.0), half_angle=0.1, devices=("terminal-1",))
    """
    if not number("duration_s", duration_s, "a number of s") > 0:
        raise ValueError(f"duration_s = {duration_s}: must lie in (0, 86400] s")
    drift_times(observer, duration_s)  # for its errors
    times = np.linspace(0.0, duration_s, _INITIAL_INTERVALS + 1)
    seen = directions(target, epoch=epoch, observer=observer, times=times)
    most = max(_MAX_SAMPLES, int(duration_s))
    while len(times) <= most:
        middle = (times[1:] + times[:-1]) / 2
        between = directions(target, epoch=epoch, observer=observer, times=middle)
        try:
            found = DirectionPath.through(times, seen)
            rough = separation(found.at(middle), between) > ACCURACY
            if not np.any(rough):
                return found
        except ValueError:  # it turns too far between samples
            rough = np.ones(len(middle), bool)
        rough[:-1] |= rough[1:]  # neighbours, too, since the spline goes through all
        rough[1:] |= rough[:-1]
        order = np.argsort(np.concatenate([times, middle[rough]]))
        times = np.concatenate([times, middle[rough]])[order]
        seen = np.concatenate([seen, between[rough]])[order]
    raise ValueError(
        f"target: passes so close, or with such a jump of its velocity, that {most} samples over "
        f"{duration_s:g} s do not follow it"
    )


def keep_out(
    body: str,
    *,
    epoch: Epoch,
    observer: Thing,
    half_angle_deg: float | None = None,
    exclusion_deg: float | None = None,
    atmosphere_km: float = 0.0,
    for_duration_s: float = 0.0,
    moving: bool = False,
    name: str | None = None,
    devices: str | Sequence[str] = (),
) -> KeepOut:
    """Make a keep-out zone about a body. Exactly one of the two angles must be given.

    Args:
        body: ``"sun"``, ``"moon"`` or ``"earth"``.
        epoch: UTC of the manoeuvre's start.
        observer: the satellite; for a duration of zero also its position.
        half_angle_deg: half angle of the zone from the body's centre, deg, in (0, 180).
        exclusion_deg: angle from the body's limb, deg, in [0, 180): the half angle is this and the body's
            angular radius.
        atmosphere_km: height of air that belongs to the Earth's limb, in [0, 1000].
        for_duration_s: how long the zone shall hold from the epoch on, s, in [0, 86400]. A zone that stands
            still is made wide enough to contain the body's cone at every instant of this time.
        moving: whether the axis follows the body for that long, so that the zone is not widened.
        name: name of the zone; None for the body's.
        devices: names of the devices that it binds, or one name; empty for all.

    Returns:
        The zone, its half angle rounded up to 1e-9 deg. Its axis is the body's direction at half the
        duration, and the zone lasts for the duration, if that is not zero; or, if `moving`, the axis is the
        body's path.

    Raises:
        ValueError: if an argument is out of its range, both or none of the angles are given, a device is
            named twice, or the zone would be half a turn wide or more.
        ImportError: if the extra ``orbit`` is needed and not installed.
    """
    if (half_angle_deg is None) == (exclusion_deg is None):
        raise ValueError(
            "give either half_angle_deg, from the body's centre, or exclusion_deg, from its limb"
        )
    check_body(body)
    names = (devices,) if isinstance(devices, str) else tuple(several("devices", devices, "names, or one"))
    for place, device in enumerate(names):
        if device in names[:place]:
            raise ValueError(f"devices[{place}] = {device!r}: is named twice")
    from_limb = half_angle_deg is None
    what, given = ("exclusion_deg", exclusion_deg) if from_limb else ("half_angle_deg", half_angle_deg)
    angle = number(what, given, "a number")
    if not 0 <= angle < 180 or (angle == 0 and not from_limb):
        raise ValueError(f"{what} = {given}: must lie in {'[' if from_limb else '('}0, 180)")
    if moving and not number("for_duration_s", for_duration_s, "a number of s") > 0:
        raise ValueError(f"for_duration_s = {for_duration_s}: must be positive for a zone that is moving")
    times = drift_times(observer, for_duration_s)
    seen = directions(body, epoch=epoch, observer=observer, times=times)
    if moving:
        direction: np.ndarray | DirectionPath = path(
            body, epoch=epoch, observer=observer, duration_s=for_duration_s
        )
        reach, slack = np.zeros(len(times)), 0.0
    else:
        direction = axis = seen[len(times) // 2]
        reach, slack = separation(axis, seen), half_step(seen)
    limb = angular_radius(body, epoch=epoch, observer=observer, times=times, atmosphere_km=atmosphere_km)
    if from_limb:
        reach = reach + limb
        slack += float(np.max(np.abs(np.diff(limb)), initial=0.0)) / 2
    added = math.degrees(float(np.max(reach)) + slack)
    # what was given stays as it is
    half_angle = math.ceil((angle + added) * _ROUNDING_SCALE - 1e-3) / _ROUNDING_SCALE
    if not half_angle < 180:
        raise ValueError(
            f"{what} = {given}: with the {added:.4g} deg of the {body} itself and of its drift "
            "it must stay below 180"
        )
    return KeepOut(
        name=body if name is None else name,
        direction=direction,
        half_angle=math.radians(half_angle),
        devices=names,
        lasts=float(for_duration_s) if for_duration_s > 0 and not moving else math.inf,
    )
