"""The table ``[sky]``, and what its names stand for in zones and targets.

A scenario holds directions, half angles and when targets are hidden; so files that are written, and plans,
have these and no ``[sky]``: they mean the same on every machine, with any version of pyerfa, and without the
extra. `direction_by_name` is the only place where a name becomes a direction.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from jaxplan import sky
from jaxplan.model.directions import DirectionPath
from jaxplan.model.file_keys import key, keyed
from jaxplan.model.goals import Targets
from jaxplan.model.scenario import Scenario
from jaxplan.schema.checks import check_unique, placed
from jaxplan.schema.faults import WRONG, Place, is_wrong, nearest
from jaxplan.schema.orbits import Orbit
from jaxplan.schema.tables import table
from jaxplan.schema.value_kinds import Epoch, shortest_degrees


@dataclass(frozen=True)
class Followed:
    """Name of what a direction follows, which stands for the direction until `resolve` finds it.

    Attributes:
        name: name of a satellite, a point of the ground, a body, or one of `sky.LOCAL`.
        key: key of the file that has the name; empty where the name is written in place of the direction.
        from_limb: whether the half angle of a zone is measured from the body's limb.
        moving: whether the axis of a zone about a body moves.
    """

    name: str
    key: str = ""
    from_limb: bool = False
    moving: bool = False


_NAME_KEY = key("name", "unique, and no body's nor of nadir, zenith, ram, orbit_normal")


@dataclass(frozen=True, kw_only=True)
class Satellite:
    """A satellite that is looked at: the axis of a zone, or a target."""

    name: str = field(metadata=_NAME_KEY)
    orbit: sky.Satellite = field(metadata=key("orbit", "of the satellite", kind="orbit"))


@dataclass(frozen=True, kw_only=True)
class Ground:
    """A point of the ground that is looked at, geodetic on WGS 84; it turns with the Earth."""

    name: str = field(metadata=_NAME_KEY)
    latitude: float = field(metadata=key("latitude_deg", "geodetic, WGS 84", "[-90, 90]"))
    longitude: float = field(metadata=key("longitude_deg", "to the east", "[-360, 360]"))
    altitude: float = keyed(0.0, "altitude_m", "above the ellipsoid", "[-1000, 100000]")
    minimum_elevation: float = keyed(
        0.0, "minimum_elevation_deg", "above its horizon, from which on it is seen as a target", "[0, 90)"
    )

    @property
    def thing(self) -> sky.GroundPoint:
        """The point of the ground as an object of `jaxplan.sky`."""
        return sky.GroundPoint(
            **{name: part for name, part in vars(self).items() if name in _GROUND_POINT_ATTRIBUTES}
        )


_GROUND_POINT_ATTRIBUTES = ("latitude", "longitude", "altitude", "minimum_elevation")


@dataclass(frozen=True, kw_only=True)
class Sphere:
    """A sphere that may hide targets, in addition to the Earth, which always may."""

    name: str = field(metadata=key("name", '"sun", "moon", or a satellite of [sky]'))
    radius: float | None = keyed(None, "radius_km", "of the sphere; the body's own if absent", "(0, 1e6]")


@dataclass(frozen=True, kw_only=True)
class View:
    """The table ``[sky]``: who looks at the sky, and when.

    Attributes:
        epoch: UTC of the manoeuvre's start.
        observer: the satellite that looks.
        for_duration: s from the epoch, for how long zones about bodies hold and motion is known; None for the
            trajectory's duration.
        atmosphere: km, height of air that counts as part of the Earth's limb, and hides targets.
        satellites: satellites that are looked at.
        ground: points of the ground that are looked at.
        spheres: what hides targets, in addition to the Earth.
    """

    epoch: np.datetime64 = field(metadata=key("epoch_utc", "UTC of the start", kind="epoch"))
    observer: sky.Satellite = field(metadata=key("observer", "the satellite that looks", kind="orbit"))
    for_duration: float | None = keyed(
        None,
        "for_duration_s",
        "how long zones about bodies hold and what moves is known; trajectory.duration_s if a number",
        "[0, 86400]",
    )
    atmosphere: float = keyed(
        0.0,
        "atmosphere_km",
        "belongs to the Earth's limb, and hides satellites that are targets",
        "[0, 1000]",
    )
    satellites: tuple[Satellite, ...] = keyed((), "satellite", "others, for zones and targets to follow")
    ground: tuple[Ground, ...] = keyed((), "ground", "points of the ground, for zones and targets to follow")
    spheres: tuple[Sphere, ...] = keyed((), "occulter", "spheres that hide targets, beside the Earth")


@dataclass(frozen=True)
class Known:
    """A view with what its names stand for, from which directions are found.

    Attributes:
        view: the view, with a number for its duration.
        things: satellites and points of the ground, by name.
        occulters: what hides targets, in addition to the Earth.
        found: paths found so far, by name and by whether they are those of targets, since many may be the
            same.
    """

    view: View
    things: Mapping[str, sky.Satellite | sky.GroundPoint]
    occulters: tuple[sky.Occulter, ...] = ()
    found: dict[tuple[str, bool], Any] = field(default_factory=dict)


_KINDS: dict[Any, Any] = {"orbit": Orbit(), "epoch": Epoch()}
_KINDS |= {row: table(row, _KINDS) for row in (Satellite, Ground, Sphere)}
SKY = table(View, _KINDS)


@dataclass(frozen=True)
class Aim:
    """Targets and wishes that may be names of ``[sky]``, and where they stand.

    Attributes:
        targets: what was read; if it is no `Targets`, it has no names.
        place: place of the table that has them.
        key: key of the targets in this table.
    """

    targets: Any
    place: Place
    key: str = "targets"


@dataclass(frozen=True)
class Lasting:
    """For how long names of ``[sky]`` are followed if ``for_duration_s`` is not given.

    Attributes:
        seconds: s, how long at least; None if that is not given as a number.
        key: key of the file that gives it.
    """

    seconds: float | None
    key: str


def resolve(scenario: Scenario, view: View | None, root: Place) -> Scenario:
    """Replace names of bodies and satellites by directions, noting faults if there are none.

    Args:
        scenario: the scenario as it was read.
        view: the table ``[sky]`` as it was read; None if the file has none.
        root: the place of the file.

    Returns:
        The scenario; names are left in it if ``[sky]`` has faults.
    """
    duration = getattr(scenario.trajectory, "duration", None)
    lasting = Lasting(duration if isinstance(duration, float) else None, "trajectory.duration_s")
    ends = [Aim(getattr(scenario, name), root[name]) for name in ("start", "goal")]
    scenario, (start, goal) = resolve_all(scenario, ends, view, lasting, root)
    return replace(scenario, start=start, goal=goal)


def resolve_all(
    scenario: Scenario, aims: Sequence[Aim], view: View | None, lasting: Lasting, root: Place
) -> tuple[Scenario, list[Any]]:
    """Replace names by directions, as `resolve` does, in zones and in any number of targets.

    Args:
        scenario: the scenario, whose zones may have names.
        aims: targets and wishes that may have names.
        view: as for `resolve`.
        lasting: for how long names are followed.
        root: as for `resolve`.

    Returns:
        The scenario, and for each of the aims its targets.
    """
    zones = _placed_zones(scenario, root)
    named = [list(_names_in_aim(aim)) for aim in aims]
    looked_up = looked_up_names(scenario, aims, root)
    if view is None:
        for place, axis in looked_up:
            vector = "must be a unit vector of 3 numbers; a name " * (axis.key == "direction")
            place.fault(f"{vector}needs [sky], with epoch_utc and observer", axis.name)
    seen = None
    if view is not None and looked_up:
        seen = known(view, lasting, root["sky"])
    elif view is not None:
        _read_names(view, root["sky"])  # for its faults
    if seen is None:
        return scenario, [aim.targets for aim in aims]
    for kind, rows in zones.items():
        found = {
            id(zone): _resolve_zone(zone, axis, place, seen) for place, zone, axis in _followed_zones(rows)
        }
        given = getattr(scenario, kind)
        if found:
            changed: dict[str, Any] = {kind: tuple(found.get(id(zone), zone) for zone in given)}
            scenario = replace(scenario, **changed)
    aimed = [_resolve_aim(aim, seen) if own else aim.targets for aim, own in zip(aims, named, strict=True)]
    return scenario, aimed


def looked_up_names(scenario: Scenario, aims: Sequence[Aim], root: Place) -> list[tuple[Place, Followed]]:
    """Return the names of ``[sky]`` in zones, targets and wishes, each after its place."""
    of_zones = [
        (place[axis.key], axis)
        for rows in _placed_zones(scenario, root).values()
        for place, _, axis in _followed_zones(rows)
    ]
    return [*of_zones, *(one for aim in aims for one in _names_in_aim(aim))]


def _placed_zones(scenario: Scenario, root: Place) -> dict[str, list[tuple[Place, Any]]]:
    """Return the zones that may be about names, by attribute of the scenario, each after its place."""
    return {kind: placed(getattr(scenario, kind), root[kind]) for kind in ("keep_out", "keep_in")}


def _names_in_aim(aim: Aim) -> Iterator[tuple[Place, Followed]]:
    """Yield the targets and wishes of an aim that are names of ``[sky]``, each after its place."""
    if not isinstance(aim.targets, Targets):
        return
    directions = aim.targets.directions  # only a tuple may contain names
    each = directions if isinstance(directions, tuple) else ()
    names: Sequence[str | int] = aim.targets.devices or range(len(each))
    for name, target in zip(names, each, strict=False):
        if isinstance(target, Followed):
            yield aim.place[aim.key][name], target
    for here, wish in placed(aim.targets.prefer, aim.place["prefer"]):
        if isinstance(wish.direction, Followed):
            yield here["direction"], wish.direction


def _resolve_aim(aim: Aim, seen: Known) -> Targets:
    """Return the targets of an aim with directions instead of names; notes faults."""
    end, place = aim.targets, aim.place
    directions, wishes = end.directions, end.prefer
    if isinstance(directions, tuple):  # only then may there be names
        names: Sequence[str | int] = end.devices or range(len(directions))
        each = tuple(
            direction_by_name(target.name, place[aim.key][name], seen, target=True)
            if isinstance(target, Followed)
            else target
            for name, target in zip(names, directions, strict=True)
        )
        moving = any(isinstance(one, DirectionPath) or one is WRONG for one in each)
        directions = each if moving else np.array(each)
    if isinstance(wishes, tuple):  # it is `WRONG` if that is no array
        wishes = tuple(_resolve_wish(wish, place["prefer"][i], seen) for i, wish in enumerate(wishes))
    return replace(end, directions=directions, prefer=wishes)


def _resolve_wish(wish: Any, place: Place, seen: Known) -> Any:
    """Return a wish with a direction instead of a name; notes faults."""
    if wish is WRONG or not isinstance(wish.direction, Followed):
        return wish
    return replace(wish, direction=direction_by_name(wish.direction.name, place["direction"], seen))


def _followed_zones(rows: Iterable[tuple[Place, Any]]) -> Iterator[tuple[Place, Any, Followed]]:
    """Yield place, zone and name of each zone whose axis is a name of ``[sky]``."""
    for place, zone in rows:
        if isinstance(zone.direction, Followed):
            yield place, zone, zone.direction


def _resolve_zone(zone: Any, axis: Followed, place: Place, seen: Known) -> Any:
    """Return a zone with a direction instead of the name of its axis; for a body also with its half angle."""
    if axis.key == "satellite" and axis.name not in seen.things:
        known = nearest(axis.name, [*seen.things], "satellites and ground points")
        place["satellite"].fault(f"no such satellite or ground point, {known}", axis.name)
        return replace(zone, direction=WRONG)
    if axis.key != "body":
        return replace(zone, direction=direction_by_name(axis.name, place[axis.key], seen))
    view = seen.view
    if zone.half_angle is WRONG:
        return zone
    angle = shortest_degrees(zone.half_angle)
    found = _call_or_fault(
        partial(
            sky.keep_out,
            axis.name,
            epoch=view.epoch,
            observer=view.observer,
            half_angle_deg=None if axis.from_limb else angle,
            exclusion_deg=angle if axis.from_limb else None,
            atmosphere_km=view.atmosphere,
            for_duration_s=view.for_duration or 0.0,
            moving=axis.moving,
        ),
        place["body"],
        axis.name,
    )
    return (
        zone
        if found is WRONG
        else replace(
            zone,
            direction=found.direction,
            half_angle=found.half_angle,
            lasts=min(zone.lasts, found.lasts),
        )
    )


def direction_by_name(name: str, place: Place, seen: Known, *, target: bool = False) -> Any:
    """Return the path of the direction that a name stands for; `WRONG` after noting why there is none.

    Args:
        name: name of a satellite, a point of the ground, a body, or one of `sky.LOCAL`.
        place: where the name stands.
        seen: the view with what its names stand for.
        target: whether a device points there, so that the path must tell when it is hidden.
    """
    if (name, target) in seen.found:
        return seen.found[name, target]
    names = [*seen.things, *sky.BODIES, *sky.LOCAL]
    if name not in names:
        kinds = "satellite, ground point, body or direction"
        return place.fault(f"no such {kinds}, {nearest(name, names, 'names')}", name)
    asked: dict[str, Any] = {
        "epoch": seen.view.epoch,
        "observer": seen.view.observer,
        "duration_s": seen.view.for_duration or 0.0,
    }
    if target:
        asked |= {"name": name, "atmosphere_km": seen.view.atmosphere, "occulters": seen.occulters}
    thing = seen.things.get(name, name)
    path = _call_or_fault(partial(sky.target if target else sky.path, thing, **asked), place, name)
    if path is not WRONG:
        seen.found[name, target] = path
    return path


def _call_or_fault(make: Callable[[], Any], place: Place, *value: object) -> Any:
    """Call a function of `jaxplan.sky`; returns its result, or `WRONG` after noting its error at a place."""
    try:
        return make()
    except (ValueError, ImportError) as error:
        return place.fault(str(error), *value)


def known(view: View, lasting: Lasting, place: Place) -> Known | None:
    """Find what the view's names stand for; None, after noting why, if a part of it is wrong.

    Args:
        view: the view as it was read.
        lasting: for how long names are followed if the view does not say.
        place: place of the view.
    """
    named = _read_names(view, place)
    if named is None:
        return None
    wanted = lasting.seconds if view.for_duration is None else view.for_duration
    if wanted is None:
        complaint = f"missing, must be a number of seconds, since {lasting.key} is not one"
        place["for_duration_s"].fault(complaint)
        return None
    if lasting.seconds is not None and wanted < lasting.seconds:
        complaint = f"must be at least {lasting.key} = {lasting.seconds}"
        place["for_duration_s"].fault(complaint, wanted)
        return None
    there = _call_or_fault(
        partial(sky.positions, view.observer, epoch=view.epoch, times=[0.0, wanted]), place["observer"]
    )
    return None if there is WRONG else Known(replace(view, for_duration=wanted), *named)


def _read_names(view: View, place: Place) -> tuple[dict[str, Any], tuple[sky.Occulter, ...]] | None:
    """Return what a view's names stand for, and its spheres; None, after noting why, if a part is wrong.

    This needs neither the extra nor a duration, so that a view of which nothing is used is checked as well.
    `place` is that of the view.
    """
    if is_wrong(view):
        return None  # noted before
    before = len(place.reading.faults)
    things: dict[str, Any] = {}
    for place_key, rows in (("satellite", view.satellites), ("ground", view.ground)):
        for here, row in placed(rows, place[place_key]):
            if row.name in (*sky.BODIES, *sky.LOCAL, *things):
                here["name"].fault("must be unique, and no body's nor a direction's", row.name)
            else:
                things[row.name] = row.orbit if isinstance(row, Satellite) else row.thing
    spheres = [_make_sphere(row, things, here) for here, row in placed(view.spheres, place["occulter"])]
    check_unique(placed(view.spheres, place["occulter"]))
    return None if len(place.reading.faults) > before else (things, tuple(spheres))


def _make_sphere(row: Sphere, things: Mapping[str, Any], place: Place) -> Any:
    """Make the sphere of a row that may hide targets; returns `WRONG` after noting why there is none."""
    if row.name == "earth":
        return place["name"].fault("the Earth hides targets always, with sky.atmosphere_km", row.name)
    thing = things.get(row.name)
    if row.name not in ("sun", "moon") and (thing is None or isinstance(thing, sky.GroundPoint)):
        known = [
            "sun",
            "moon",
            *(name for name, one in things.items() if not isinstance(one, sky.GroundPoint)),
        ]
        return place["name"].fault(
            f"no such satellite or body, {nearest(row.name, known, 'names')}", row.name
        )
    if thing is not None and row.radius is None:
        return place["radius_km"].fault("missing, since that of a satellite is not known")
    return sky.occulter(row.name, thing, radius_km=row.radius)
