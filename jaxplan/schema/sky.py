"""The table ``[sky]``, and what bodies and satellites of it stand for in zones and targets.

A scenario holds directions and half angles only, so a file that is written, or a plan, has these and no
``[sky]``: it means the same on every machine, whatever its version of pyerfa, and without the extra too.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from jaxplan import sky
from jaxplan.model.keys import key, keyed
from jaxplan.model.scenario import Scenario
from jaxplan.schema.checks import placed
from jaxplan.schema.faults import WRONG, Place, nearest
from jaxplan.schema.kinds import Epoch, Interval, Kind, Number, shortest_degrees
from jaxplan.schema.tables import Either, Field, Table, table

_ANGLE_DEG = Number(Interval("[-360, 360]"), degrees=True)
_INCLINATION = Number(Interval("[-180, 180]"), degrees=True)


@dataclass(frozen=True)
class Followed:
    """What a direction follows, until it is looked up.

    Attributes:
        name: of a body or satellite.
        key: under which it stands; empty where the name itself stands for the direction.
        from_limb: whether the half angle of a zone counts from the body's limb.
        moving: whether a zone about a body moves.
    """

    name: str
    key: str = ""
    from_limb: bool = False
    moving: bool = False


@dataclass(frozen=True, kw_only=True)
class Satellite:
    """A satellite that is looked at: a zone is about it, or a target."""

    name: str = field(metadata=key("name", "unique, and no body's"))
    orbit: sky.CircularOrbit | sky.Tle = field(metadata=key("orbit", "of the satellite", kind="orbit"))


@dataclass(frozen=True, kw_only=True)
class View:
    """Who looks at the sky, and when.

    Attributes:
        epoch: UTC of the manoeuvre's start.
        observer: the satellite.
        for_duration: s, how long zones about bodies hold, and motion is known; None for the trajectory's
            duration.
        atmosphere: km that belong to the Earth's limb.
        satellites: others, that are looked at.
    """

    epoch: np.datetime64 = field(metadata=key("epoch_utc", "UTC of the start", kind="epoch"))
    observer: sky.CircularOrbit | sky.Tle = field(
        metadata=key("observer", "the satellite that looks", kind="orbit")
    )
    for_duration: float | None = keyed(
        None,
        "for_duration_s",
        "how long zones about bodies hold and what moves is known; trajectory.duration_s if a number",
        "[0, 86400]",
    )
    atmosphere: float = keyed(0.0, "atmosphere_km", "belongs to the Earth's limb", "[0, 1000]")
    satellites: tuple[Satellite, ...] = keyed((), "satellite", "others, for zones and targets to follow")


@dataclass(frozen=True)
class TwoLines(Kind):
    """Two-line elements."""

    wanted = "an array of the two lines of a set of elements"

    def read(self, value: Any, place: Place) -> Any:
        lines = value if isinstance(value, list) else []
        if len(lines) != 2 or not all(isinstance(line, str) for line in lines):
            return place.refuse(f"must be {self.wanted}", value)
        try:
            return sky.parse_tle("\n".join(lines))
        except sky.TleError as error:
            for fault in error.faults:
                place.fault(fault)
        return WRONG


_ORBIT = Table(
    sky.CircularOrbit,
    (
        Field("altitude_km", Number(Interval("(0, 1e6]")), "altitude", "above 6378.137 km", required=True),
        Field("inclination_deg", _INCLINATION, "inclination", "to the equator of J2000", required=True),
        Field("ascending_node_deg", _ANGLE_DEG, "node", "its right ascension", required=True),
        Field(
            "argument_of_latitude_deg",
            _ANGLE_DEG,
            "latitude",
            "from the node on, at epoch_utc",
            required=True,
        ),
    ),
    make=lambda parts, place: WRONG if WRONG in parts.values() else sky.CircularOrbit(**parts),
    refused={"tle": "the satellite has an altitude_km; give either two-line elements or a circular orbit"},
)
_TWO_LINES = Table(
    sky.Tle,
    (Field("tle", TwoLines(), "tle", "two-line elements", required=True),),
    make=lambda parts, place: parts["tle"],
    refused={entry.key: "the satellite has a tle, which says all of its orbit" for entry in _ORBIT.fields},
)


class Orbit(Either):
    """A satellite: a table with two-line elements, or one with a circular orbit."""

    wanted = f"a table with tle, or with {', '.join(entry.key for entry in _ORBIT.fields)}"

    @property
    def tables(self) -> dict[str, Table]:
        return {"by two-line elements": _TWO_LINES, "on a circular orbit": _ORBIT}

    def read(self, value: Any, place: Place) -> Any:
        before = len(place.reading.faults)
        read = (_TWO_LINES if isinstance(value, dict) and "tle" in value else _ORBIT).read(value, place)
        return read if len(place.reading.faults) == before else WRONG


_KINDS = {"orbit": Orbit(), "epoch": Epoch()}
SKY = table(View, {**_KINDS, Satellite: table(Satellite, _KINDS)})


def resolve(scenario: Scenario, view: View | None, root: Place) -> Scenario:
    """The scenario with directions in the place of bodies and satellites, noting where there are none.

    Args:
        scenario: as far as it could be read.
        view: the table ``[sky]`` as far as it could be read; None where the file has none.
        root: the place of the file.
    """
    goal: Any = scenario.goal
    targets = getattr(goal, "directions", WRONG)
    zones = {kind: placed(getattr(scenario, kind), root[kind]) for kind in ("keep_out", "keep_in")}
    looked_up = [(place[axis.key], axis) for rows in zones.values() for place, _, axis in _followed(rows)]
    looked_up += [
        (place, target)
        for place, target in placed(targets, root["goal"]["targets"])
        if isinstance(target, Followed)
    ]
    if view is None:
        for place, axis in looked_up:
            place.fault("needs [sky], with epoch_utc and observer", axis.name)
    seen = _known(view, scenario.trajectory, root["sky"]) if view is not None and looked_up else None
    if seen is None:
        return scenario
    for kind, rows in zones.items():
        found = {id(zone): _zone(zone, axis, place, seen) for place, zone, axis in _followed(rows)}
        given = getattr(scenario, kind)
        if found:
            changed: dict[str, Any] = {kind: tuple(found.get(id(zone), zone) for zone in given)}
            scenario = replace(scenario, **changed)
    if any(isinstance(target, Followed) for _, target in placed(targets, root)):
        directions = tuple(
            _path(target.name, root["goal"]["targets"][i], seen, sky.BODIES)
            if isinstance(target, Followed)
            else target
            for i, target in enumerate(targets)
        )
        scenario = replace(scenario, goal=replace(goal, directions=directions))
    return scenario


def _followed(rows: Iterable[tuple[Place, Any]]) -> Iterator[tuple[Place, Any, Followed]]:
    """The zones whose axis is to be looked up, with their places."""
    for place, zone in rows:
        if isinstance(zone.direction, Followed):
            yield place, zone, zone.direction


def _zone(zone: Any, axis: Followed, place: Place, view: View) -> Any:
    """A zone about a body or a satellite, with its direction and half angle."""
    if axis.key == "satellite":
        return replace(zone, direction=_path(axis.name, place["satellite"], view, ()))
    if zone.half_angle is WRONG:
        return zone
    angle = shortest_degrees(zone.half_angle)
    found = _tried(
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
    return zone if found is WRONG else replace(zone, direction=found.direction, half_angle=found.half_angle)


def _path(name: str, place: Place, view: View, bodies: tuple[str, ...]) -> Any:
    """The path of a satellite, or of a body where there may be one, or `WRONG` after noting why not."""
    known = {one.name: one.orbit for one in view.satellites}
    if name not in known and name not in bodies:
        return place.fault(f"no such satellite, {nearest(name, [*known, *bodies], 'satellites')}", name)
    make = partial(
        sky.path,
        known.get(name, name),
        epoch=view.epoch,
        observer=view.observer,
        duration_s=view.for_duration or 0.0,
    )
    return _tried(make, place, name)


def _tried(make: Callable[[], Any], place: Place, *value: object) -> Any:
    """The answer of a call to `jaxplan.sky`, or `WRONG` after noting why there is none."""
    try:
        return make()
    except (ValueError, ImportError) as error:
        return place.fault(str(error), *value)


def _known(view: View, settings: Any, place: Place) -> View | None:
    """The view with its duration, None if a part of it is wrong.

    Args:
        view: as far as it could be read.
        settings: of the trajectory, likewise.
        place: of the view.
    """
    rows = () if view is WRONG else view.satellites
    wrong = view is WRONG or any(part is WRONG for part in vars(view).values())
    if wrong or any(row is WRONG or WRONG in (row.name, row.orbit) for row in rows):
        return None  # noted before
    names = [row.name for row in rows]
    for i, name in enumerate(names):
        if name in sky.BODIES or name in names[:i]:
            place["satellite"][i]["name"].fault("must be unique, and no body's", name)
            return None
    duration = getattr(settings, "duration", None)
    number = duration if isinstance(duration, float) else None
    wanted = number if view.for_duration is None else view.for_duration
    if wanted is None:
        complaint = "missing, must be a number of seconds, since trajectory.duration_s is not one"
        place["for_duration_s"].fault(complaint)
        return None
    if number is not None and wanted < number:
        place["for_duration_s"].fault(f"must be at least trajectory.duration_s = {number}", wanted)
        return None
    there = _tried(
        partial(sky.positions, view.observer, epoch=view.epoch, times=[0.0, wanted]), place["observer"]
    )
    return None if there is WRONG else replace(view, for_duration=wanted)
