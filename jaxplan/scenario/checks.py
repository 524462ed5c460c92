"""What must go together in a scenario, beyond what each value must be by itself.

The checks look at attributes, of the dataclasses or of what could be read of them so far: a dict, in which
None stands for what is given and wrong, and has been told. Places go by the keys of a file.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from jaxplan.model.moving import DirectionPath
from jaxplan.model.scenario import MINIMUM, STRETCHED
from jaxplan.scenario.arrays import PerAxis
from jaxplan.scenario.faults import Place
from jaxplan.scenario.paths import TIMES
from jaxplan.scenario.states import PITCH_LIMIT, YAW_LIMIT

MOST_ZONES = 1000
ZONES = {"keep_out": "keep_out", "keep_in": "keep_in", "joint_bound": "joint_bounds"}
"""Keys of a file under which pointing constraints stand, and their attributes."""
_DEVICES = {"terminal": "terminals", "instrument": "instruments"}


def check_count(zones: Sequence[Any], root: Place) -> bool:
    """Whether there are no more zones than a scene may have; more are not worth reading."""
    count = sum(len(rows) for rows in zones if isinstance(rows, list | tuple))
    if count > MOST_ZONES:
        root.fault(f"{count} zones, more than the {MOST_ZONES} that are allowed")
    return count <= MOST_ZONES


def check_parts(whole: Any, root: Place) -> None:
    """Note where parts of a scenario do not go together.

    Args:
        whole: the scenario, or what could be read of it.
        root: its place.
    """
    check_spacecraft(part(whole, "spacecraft"), root.key("spacecraft"))
    _check_unique(whole, ZONES, root)
    for key, attribute in ZONES.items():
        for place, zone in _rows(whole, key, attribute, root):
            _check_zone(key, zone, place)
    _check_goal_limits(whole, root)
    _check_duration(whole, root)


def part(of: Any, name: str) -> Any:
    """An attribute of an object, or of what could be read of one; None where there is none."""
    return of.get(name) if isinstance(of, dict) else getattr(of, name, None)


def _has(of: Any, name: str) -> bool:
    """Whether an attribute is given, be it wrong."""
    value = part(of, name)
    if isinstance(value, tuple) and not value:
        return False
    return name in of if isinstance(of, dict) else value is not None


def _rows(of: Any, key: str, attribute: str, place: Place) -> Iterator[tuple[Place, Any]]:
    """The parts in a row that could be read, with their places."""
    for i, row in enumerate(part(of, attribute) or ()):
        if row is not None:
            yield place.key(key).item(i), row


def check_spacecraft(craft: Any, place: Place) -> None:
    """Devices need names of their own; torque and momentum follow from the motion only with the inertia."""
    _check_unique(craft, _DEVICES, place)
    limits = {"torque_limit": "torque_limit_nm", "wheel_momentum_limit": "wheel_momentum_limit_nms"}
    for attribute, key in limits.items():
        limit = part(craft, attribute)
        if limit is not None and not _has(craft, "inertia"):
            told = place.spelled(PerAxis(), limit)
            place.key(key).fault(f"needs {place.key('inertia_kg_m2').path}", told)


def _check_unique(of: Any, keys: dict[str, str], place: Place) -> None:
    first: dict[str, Place] = {}
    for key, attribute in keys.items():
        for here, row in _rows(of, key, attribute, place):
            name = part(row, "name")
            if name in first:
                here.key("name").fault(f"the same as {first[name].path}", name)
            elif isinstance(name, str):
                first[name] = here.key("name")


def _check_zone(key: str, zone: Any, place: Place) -> None:
    """A zone binds something, other than its own axis, and an entry is one of a group."""
    aside = key == "keep_in" or _has(zone, "axis_body") or _has(zone, "axis_device")
    if key != "joint_bound" and aside and not (_has(zone, "devices") or _has(zone, "vectors")):
        place.key("devices").fault("missing (or vector), must be an array of names of devices")
    axis = part(zone, "axis_device")
    if axis is not None and axis in (part(zone, "devices") or ()):
        complaint = "is the axis, so it must not be among the devices that are bound"
        place.key("axis_device").fault(complaint, axis)
    if part(zone, "entry") is not None and not _has(zone, "any_of"):
        place.key("entry").fault("needs any_of, the name of its group", part(zone, "entry"))


def _check_goal_limits(whole: Any, root: Place) -> None:
    """The goal's limits tighten those of every terminal, they do not widen any."""
    terminals = list(_rows(part(whole, "spacecraft"), "terminal", "terminals", root.key("spacecraft")))
    for attribute, kind in (("yaw_limit", YAW_LIMIT), ("pitch_limit", PITCH_LIMIT)):
        limit, key = part(part(whole, "goal"), attribute), f"{attribute}_deg"
        for place, terminal in terminals:
            own = part(terminal, attribute)
            if limit is not None and own is not None and limit > own:
                bound = place.key(key).told(root.spelled(kind, own))
                root.key("goal").key(key).fault(f"must not exceed {bound}", root.spelled(kind, limit))
                break


def _check_duration(whole: Any, root: Place) -> None:
    """The paper's method knows no shortest motion, and scales the time, with it the rates at both ends."""
    settings = part(whole, "trajectory")
    if part(settings, "method") != "paper":
        return
    given = _has(settings, "duration")
    duration, place = part(settings, "duration"), root.key("trajectory").key("duration_s")
    if duration == MINIMUM:
        place.fault('only trajectory.method = "global" has it', duration)
    if given and duration != STRETCHED:
        return
    moving = [
        root.key(table).key(f"{key}_rad_s").path
        for table in ("start", "goal")
        for key in ("angular_velocity", "joint_rates")
        if (rates := part(part(whole, table), key)) is not None and np.any(rates)
    ]
    if moving:
        complaint = f"must be a number of seconds, since stretching the time would change {', '.join(moving)}"
        place.fault(complaint, STRETCHED)


def check_paths(whole: Any, root: Place) -> None:
    """What moves must be known until the end, and the paper's method must know when that is."""
    settings = part(whole, "trajectory")
    duration = part(settings, "duration") or STRETCHED
    directions = [
        (part(zone, "direction"), place)
        for key in ("keep_out", "keep_in")
        for place, zone in _rows(whole, key, key, root)
    ]
    targets = part(part(whole, "goal"), "directions")
    if isinstance(targets, tuple):
        directions += [(one, root.key("goal").key("targets").item(i)) for i, one in enumerate(targets)]
    paths = [(one, place) for one, place in directions if isinstance(one, DirectionPath) and one.moves]
    if paths and part(settings, "method") == "paper" and isinstance(duration, str):
        complaint = 'must be a number of seconds with trajectory.method = "paper", since something moves'
        root.key("trajectory").key("duration_s").fault(complaint, duration)
    for path, place in paths:
        if not isinstance(duration, str) and not path.covers(duration):
            asked = root.key("trajectory").key("duration_s").path
            complaint = f"must reach {asked} = {duration:g}, ends at {np.max(path.times):g}"
            place.key(TIMES.key).fault(complaint)
        elif not path.covers(0.0):
            complaint = f"must reach from the start, 0, on, lies in [{path.times[0]:g}, {path.times[-1]:g}]"
            place.key(TIMES.key).fault(complaint)
