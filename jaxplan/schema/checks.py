"""What must go together in a scenario, and what names of the sky stand for.

What must go together in a scenario, beyond what each value must be by itself.

The checks look at attributes, of the dataclasses or of what could be read of them so far: a dict, in which
None stands for what is given and wrong, and has been told. Places go by the keys of a file.

What bodies and satellites of ``[sky]`` stand for in zones and targets: directions, perhaps over time.

A scenario holds directions and half angles only, so a file that is written, or a plan, has these and no
``[sky]``: it means the same on every machine, whatever its version of pyerfa, and without the extra too.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from jaxplan import sky
from jaxplan.model.directions import DirectionPath
from jaxplan.model.scenario import MINIMUM, STRETCHED
from jaxplan.schema.arrays import PerAxis
from jaxplan.schema.bodies import SATELLITES, View
from jaxplan.schema.faults import Place, nearest
from jaxplan.schema.kinds import shortest_degrees
from jaxplan.schema.states import PITCH_LIMIT, TIMES, YAW_LIMIT, join_path

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


Zones = list[tuple[dict[str, Any], dict[str, Any], Place]]


def resolve_directions(tables: Mapping[str, Any], read: Mapping[str, Any], root: Place) -> None:
    """Put directions in the place of samples, bodies and satellites, or note why there are none.

    Args:
        tables: of the file.
        read: what could be read of them; its zones and targets are changed.
        root: the place of the file.
    """
    out, inside = (list(_zones(tables, read, root, key)) for key in ("keep_out", "keep_in"))
    for row, zone, place in (*out, *inside):
        _check_keys(row, place, "sky" in tables)
        join_path(row, zone, place)
    goal = read.get("goal") or {}
    given = goal.get("directions")
    targets = given if isinstance(given, tuple) else ()
    places = [root.key("goal").key("targets").item(i) for i in range(len(targets))]
    named = [i for i, target in enumerate(targets) if isinstance(target, str)]
    if "sky" not in tables:
        for i in named:
            places[i].fault("needs [sky], with epoch_utc and observer", targets[i])
    about = [entry for entry in (*out, *inside) if entry[0].keys() & {"body", "satellite"}]
    view = _view(tables, read, root) if about or named else None
    if view is not None:
        for row, zone, place in about:
            if isinstance(zone.get("direction"), str) and zone.get("half_angle") is not None:
                _resolve_zone(row, zone, place, view)
    for _, zone, _ in out:
        zone.pop("moving", None)
    if view is not None and named:
        goal["directions"] = tuple(
            _path(target, place, view, sky.BODIES) if isinstance(target, str) else target
            for target, place in zip(targets, places, strict=True)
        )


def _zones(
    tables: Mapping[str, Any], read: Mapping[str, Any], root: Place, key: str
) -> Iterator[tuple[dict[str, Any], dict[str, Any], Place]]:
    """The zones of one kind that could be read: as the file has each, what was read of it, and its place."""
    rows = tables.get(key)
    rows = rows if isinstance(rows, list) else []  # whatever else it is has been noted
    for i, (row, zone) in enumerate(zip(rows, read.get(key) or [], strict=False)):
        if isinstance(row, dict) and zone is not None:
            yield row, zone, root.key(key).item(i)


def _check_keys(row: Mapping[str, Any], place: Place, has_sky: bool) -> None:
    """Note keys of a zone that need others."""
    if "exclusion_deg" in row and "body" not in row:
        place.key("exclusion_deg").fault("needs a body, from whose limb it counts", row["exclusion_deg"])
    if "moving" in row and "body" not in row:
        place.key("moving").fault("needs a body, which the axis follows or not", row["moving"])
    for key in ("body", "satellite"):
        if key in row and not has_sky:
            place.key(key).fault("needs [sky], with epoch_utc and observer", row[key])


def _resolve_zone(row: Mapping[str, Any], zone: dict[str, Any], place: Place, view: View) -> None:
    """Give a zone about a body or a satellite its direction, and its half angle."""
    if "satellite" in row:
        zone["direction"] = _path(zone["direction"], place.key("satellite"), view, ())
        return
    angle, from_limb = shortest_degrees(zone["half_angle"]), "exclusion_deg" in row
    found = _tried(
        partial(
            sky.keep_out,
            zone["direction"],
            epoch=view.epoch,
            observer=view.observer,
            half_angle_deg=None if from_limb else angle,
            exclusion_deg=angle if from_limb else None,
            atmosphere_km=view.atmosphere,
            for_duration_s=view.for_duration or 0.0,
            moving=zone.get("moving", False),
        ),
        place.key("body"),
        row["body"],
    )
    if found is not None:
        zone.update(direction=found.direction, half_angle=found.half_angle)


def _path(name: str, place: Place, view: View, bodies: tuple[str, ...]) -> DirectionPath | None:
    """The path of a satellite, or of a body where there may be one, or None after noting why not."""
    known = {one.name: one.orbit for one in view.satellites}
    if name not in known and name not in bodies:
        place.fault(f"no such satellite, {nearest(name, [*known, *bodies], 'satellites')}", name)
        return None
    make = partial(
        sky.path,
        known.get(name, name),
        epoch=view.epoch,
        observer=view.observer,
        duration_s=view.for_duration or 0.0,
    )
    path: DirectionPath | None = _tried(make, place, name)
    return path


def _tried(make: Callable[[], Any], place: Place, value: object) -> Any:
    """What the sky answers, or None after noting why it has no answer."""
    try:
        return make()
    except (ValueError, ImportError) as error:
        place.fault(str(error), value)
        return None


def _view(tables: Mapping[str, Any], read: Mapping[str, Any], root: Place) -> View | None:
    """The view with its duration, None if a part of it is wrong."""
    given, place = tables.get("sky"), root.key("sky")
    parts = dict(read.get("sky") or {})
    if not isinstance(given, dict) or None in parts.values() or not {"epoch", "observer"} <= parts.keys():
        return None  # noted before
    rows = parts.pop("satellites", [])
    if not all(row is not None and None not in (row.get("name"), row.get("orbit")) for row in rows):
        return None  # likewise
    names = [row["name"] for row in rows]
    for i, name in enumerate(names):
        if name in sky.BODIES or name in names[:i]:
            place.key("satellite").item(i).key("name").fault("must be unique, and no body's", name)
            return None
    duration = (read.get("trajectory") or {}).get("duration")
    number = duration if isinstance(duration, float) else None
    wanted = parts.get("for_duration", number)
    if wanted is None:
        complaint = "missing, must be a number of seconds, since trajectory.duration_s is not one"
        place.key("for_duration_s").fault(complaint)
        return None
    if number is not None and wanted < number:
        place.key("for_duration_s").fault(f"must be at least trajectory.duration_s = {number}", wanted)
        return None
    try:
        sky.positions(parts["observer"], epoch=parts["epoch"], times=[0.0, wanted])
    except (ValueError, ImportError) as error:
        place.key("observer").fault(str(error))
        return None
    satellites = SATELLITES.build(rows)
    return View(**{**parts, "for_duration": wanted, "satellites": satellites})
