"""Events of a planned day, in order of time.

Activities and slews begin and end. Targets of activities are hidden and seen again, whether they are tracked
then or not. A device comes near to a keep-out zone and leaves it, and each zone has an instant of its least
margin. A target that is not hidden passes through a keep-out cone that binds its device, an *outage*, since
no link to it is possible then. The Earth hides the Sun, where zones about both give their directions
(`jaxplan.timeline.eclipses`). Each wheel has an instant of largest stored momentum. Instants are found from
samples of the motion every few seconds: changes to a microsecond, extrema to 1e-5 s.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan.geometry.vectors import separation
from jaxplan.model.directions import DirectionPath
from jaxplan.model.wheel_reach import wheel_loads
from jaxplan.model.zones import KeepOut
from jaxplan.runtime.arguments import expect, number
from jaxplan.runtime.display import shown
from jaxplan.timeline.eclipses import eclipses, paths_of
from jaxplan.timeline.record import TimelinePlan
from jaxplan.timeline.sign_changes import changes, least
from jaxplan.trajectory import Trajectory, total_momentum
from jaxplan.trajectory.zone_margins import ZoneMargins

KINDS = (
    "activity_ends",
    "slew_ends",
    "slew_begins",
    "activity_begins",
    "activity_points",
    "sets",
    "rises",
    "zone_near",
    "zone_left",
    "least_margin",
    "outage_begins",
    "outage_ends",
    "eclipse_begins",
    "eclipse_ends",
    "wheel_peak",
)
"""What events may be; of those of one instant the order in which they are told."""
NEAR = np.deg2rad(5.0)
"""rad: margin to a keep-out zone below which a device is near to it, unless another one is asked for."""
_SAMPLE_STEP = 10.0  # s between samples of the motion, at most; a slew has more
_MIN_SAMPLES = 33  # least number of samples of a segment
_TARGET_STEP = 15.0  # s between samples of targets


@shown("time s", "kind", "what", "text")
@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happens at an instant of a day.

    Attributes:
        time: s, from the timeline's start on.
        kind: one of `KINDS`.
        what: name of the activity, target, device, zone or wheel to which it happens.
        text: for people, a sentence without its full stop.
    """

    time: float
    kind: str
    what: str
    text: str


def events(plan: TimelinePlan, *, near: float = NEAR) -> tuple[Event, ...]:
    """Find what happens on a planned day.

    Args:
        plan: plan of a timeline, of any status; there are no events of what could not be planned.
        near: rad, positive: a device with a smaller margin to a keep-out zone counts as near to it.

    Returns:
        The events in order of time, within the planned motion. A state that holds from the start on, such as
        a target that is hidden then, is not an event. Empty if the plan has no trajectory.

    Raises:
        TypeError: if `plan` is not a TimelinePlan.
        ValueError: if `near` is not a positive number.

    Example:
        >>> for event in events(plan):
        ...     print(f"{event.time:9.2f}  {event.text}")
    """
    expect("plan", plan, TimelinePlan, "jp.plan_timeline makes one")
    if not 0 < number("near", near, "a number of rad") < np.inf:
        raise ValueError(f"near = {near}: must be positive and finite, rad")
    trajectory = plan.trajectory
    if trajectory is None:
        return ()
    end = trajectory.duration
    found = [
        *_activity_events(plan),
        *_visibility_events(plan, end),
        *_outage_events(plan, end),
        *_eclipse_events(plan, end),
    ]
    times = _sample_times(plan, end)
    found += _margin_events(plan, trajectory, times, near)
    found += _wheel_events(plan, trajectory, times)
    return tuple(sorted(found, key=lambda event: (event.time, KINDS.index(event.kind))))


def _sample_times(plan: TimelinePlan, end: float) -> np.ndarray:
    """Return times (k,), s, at which the motion is sampled first: some in every segment, up to `end`."""
    parts = [
        np.linspace(one.start, one.end, max(_MIN_SAMPLES, 2 + int((one.end - one.start) / _SAMPLE_STEP)))
        for one in plan.segments
    ]
    return np.unique(np.clip(np.concatenate(parts), 0.0, end))


def _activity_events(plan: TimelinePlan) -> Iterator[Event]:
    """Yield the begins and ends of slews and activities."""
    for segment in plan.segments:
        if segment.kind == "slew":
            name, lasts = segment.name, segment.end - segment.start
            yield Event(time=segment.start, kind="slew_begins", what=name, text=f"the slew to {name} begins")
            text = f"the slew to {name} ends, after {lasts:.2f} s"
            yield Event(time=segment.end, kind="slew_ends", what=name, text=text)
    for one in plan.activities:
        if one.start is None or one.end is None:
            continue
        if one.kind == "point":
            text = f"devices point at the targets of {one.name}"
            yield Event(time=one.start, kind="activity_points", what=one.name, text=text)
            continue
        yield Event(time=one.start, kind="activity_begins", what=one.name, text=f"{one.name} begins")
        yield Event(time=one.end, kind="activity_ends", what=one.name, text=f"{one.name} ends")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Target:
    """A target, its name, and the names of all devices for which some activity has it as the target."""

    name: str
    path: DirectionPath
    devices: tuple[str, ...]


def _list_targets(plan: TimelinePlan) -> list[_Target]:
    """Return all targets of activities, each once even if several activities have it.

    A target whose path has no name is called after the device and the first activity that has it.
    """
    craft = plan.timeline.scene.spacecraft
    names: dict[Any, str] = {}
    paths: dict[Any, DirectionPath] = {}
    devices: dict[Any, list[str]] = {}
    keys: dict[int, Any] = {}
    for activity in plan.timeline.activities:
        targets = activity.targets
        for device, given in (
            ()
            if targets is None
            else zip(targets.names(craft), zip(targets.directions, targets.paths, strict=True), strict=True)
        ):
            origin, path = given
            key = keys.setdefault(id(origin), (path.times.tobytes(), path.samples.tobytes(), path.hidden))
            names.setdefault(key, path.target or f"the target of {device} in {activity.name}")
            paths.setdefault(key, path)
            if device not in devices.setdefault(key, []):
                devices[key].append(device)
    return [_Target(name=names[key], path=path, devices=tuple(devices[key])) for key, path in paths.items()]


def _visibility_events(plan: TimelinePlan, end: float) -> Iterator[Event]:
    """Yield when targets are hidden and when they are seen again, until `end`, s."""
    for target in _list_targets(plan):
        until = -np.inf
        spans = sorted(target.path.hidden, key=lambda span: span.start)
        for place, span in enumerate(spans):
            if span.start > until and 0 < span.start <= end:
                text = f"{target.name} is hidden by {span.by}"
                yield Event(time=span.start, kind="sets", what=target.name, text=text)
            until = max(until, span.end)
            last = place + 1 == len(spans) or spans[place + 1].start > until
            known = not target.path.moves or until < target.path.times[-1]
            if last and known and 0 < until <= end:
                yield Event(time=until, kind="rises", what=target.name, text=f"{target.name} is seen again")


def _outage_events(plan: TimelinePlan, end: float) -> Iterator[Event]:
    """Yield when targets enter and leave keep-out cones that bind their devices, until `end`, s."""
    zones = [
        zone
        for zone in plan.timeline.scene.keep_out
        if zone.path is not None and zone.any_of is None and not zone.of_field
    ]
    for target in _list_targets(plan):
        for zone in zones:
            bound = [name for name in target.devices if zone.binds_all or name in zone.devices]
            if bound:
                yield from _passage_events(target, zone, bound, end)


def _passage_events(target: _Target, zone: KeepOut, devices: Sequence[str], end: float) -> Iterator[Event]:
    """Yield when a target enters and leaves a keep-out cone while not hidden, until `end`, s.

    `devices` are the names of those that the cone binds and that have this target, for the text.
    """
    axis = zone.path
    assert axis is not None
    moving = [path for path in (target.path, axis) if path.moves]
    first = max([0.0, *(float(path.times[0]) for path in moving)])
    last = min([end, *(float(path.times[-1]) for path in moving)])
    if not moving or not last > first:
        return

    def clearance(times: np.ndarray, _: np.ndarray) -> np.ndarray:
        apart = separation(np.asarray(target.path.at(times)), np.asarray(axis.at(times)))
        return np.asarray(apart) - float(zone.half_angle)

    times = np.linspace(first, last, 2 + int((last - first) / _TARGET_STEP))
    found = changes(clearance(times, np.zeros(len(times), int))[:, None], times, clearance)
    whose = ", ".join(devices)
    for time, out in zip(found.times.tolist(), found.rising.tolist(), strict=True):
        if any(span.at(time) for span in target.path.hidden):
            continue
        way, kind = ("leaves", "outage_ends") if out else ("enters", "outage_begins")
        text = f"{target.name} {way} the keep-out cone {zone.name}, which binds {whose}"
        yield Event(time=time, kind=kind, what=target.name, text=text)


def _eclipse_events(plan: TimelinePlan, end: float) -> Iterator[Event]:
    """Yield when the Earth hides the Sun, until `end`, s; nothing if zones do not give their directions."""
    bodies = paths_of((*plan.timeline.scene.keep_out, *plan.timeline.scene.keep_in))
    found = None if bodies is None else eclipses(*bodies, end)
    if found is None:
        return
    for time, out in zip(found.times.tolist(), found.rising.tolist(), strict=True):
        way, kind = ("comes out from", "eclipse_ends") if out else ("goes", "eclipse_begins")
        yield Event(time=time, kind=kind, what="sun", text=f"the Sun's centre {way} behind the Earth")


def _margin_events(
    plan: TimelinePlan, trajectory: Trajectory, times: np.ndarray, near: float
) -> Iterator[Event]:
    """Yield when devices come nearer than `near`, rad, to keep-out zones, and each zone's least margin.

    `times`, s, are those at which the motion is sampled first.
    """
    scene = plan.timeline.scene
    margins = ZoneMargins(scene)
    pairs, names = margins.pairs, scene.sight_names
    if not pairs:
        return

    def every(at: np.ndarray) -> np.ndarray:
        state = trajectory.sample(at)
        return margins.at(at, state.attitude, state.joints)

    def values(at: np.ndarray, columns: np.ndarray) -> np.ndarray:
        return np.asarray(every(at)[np.arange(len(at)), columns])

    table = every(times)
    outside = np.array([isinstance(pair.leader, KeepOut) for pair in pairs])
    found = changes(
        np.where(outside, table, np.inf) - near, times, lambda at, columns: values(at, columns) - near
    )
    degrees = f"{np.rad2deg(near):.3g} deg"
    for time, column, out in zip(*(part.tolist() for part in found), strict=True):
        device, zone = names[pairs[column].device], pairs[column].zone
        text = (
            f"{device} is farther than {degrees} from {zone} again"
            if out
            else (f"{device} comes within {degrees} of {zone}")
        )
        yield Event(time=time, kind="zone_left" if out else "zone_near", what=zone, text=text)
    when, lowest = least(table, times, values)
    for zone in dict.fromkeys(pair.zone for pair in pairs):
        own = [place for place, pair in enumerate(pairs) if pair.zone == zone]
        worst = min(own, key=lambda place: lowest[place])
        if np.isfinite(lowest[worst]):
            margin, device = np.rad2deg(lowest[worst]), names[pairs[worst].device]
            text = f"least margin to {zone}: {margin:.3f} deg, of {device}"
            yield Event(time=float(when[worst]), kind="least_margin", what=zone, text=text)


def _wheel_events(plan: TimelinePlan, trajectory: Trajectory, times: np.ndarray) -> Iterator[Event]:
    """Yield for each wheel when the momentum that it stores is largest in size."""
    craft = plan.timeline.scene.spacecraft
    if not craft.wheels:
        return
    total, limits = total_momentum(trajectory, craft), np.array([wheel.momentum for wheel in craft.wheels])

    def shares(at: np.ndarray) -> np.ndarray:
        return np.abs(wheel_loads(trajectory.sample(at).kinematics(craft, total), craft)[1]).T / limits

    when, negative = least(
        -shares(times), times, lambda at, columns: -shares(at)[np.arange(len(at)), columns]
    )
    for wheel, time, share in zip(craft.wheels, when.tolist(), (-negative).tolist(), strict=True):
        held = f"{share * wheel.momentum:.4g} of {wheel.momentum:.6g} N m s"
        text = f"{wheel.name} holds its most, {held}, {100 * share:.1f} %"
        yield Event(time=time, kind="wheel_peak", what=wheel.name, text=text)
