"""What bodies and satellites of ``[sky]`` stand for in zones and targets: directions, perhaps over time.

A scenario holds directions and half angles only, so a file that is written, or a plan, has these and no
``[sky]``: it means the same on every machine, whatever its version of pyerfa, and without the extra too.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

from jaxplan import sky
from jaxplan.model.moving import DirectionPath
from jaxplan.scenario.bodies import SATELLITES, View
from jaxplan.scenario.faults import Place, nearest
from jaxplan.scenario.kinds import shortest_degrees
from jaxplan.scenario.paths import join_path

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
