"""The table ``[sky]``, and keep-out zones about a body, which reading resolves to plain ones.

A scenario holds directions and half angles only, so a file that is written, or a plan, has these and no
``[sky]``: it means the same on every machine, whatever its version of pyerfa, and without the extra too.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np

from jaxplan import sky
from jaxplan.epochs import parse_epoch
from jaxplan.scenario.faults import Place
from jaxplan.scenario.kinds import Interval, Kind, Number, shortest_degrees
from jaxplan.scenario.tables import Either, Field, Table

_ANGLE_DEG = Number(Interval("[-360, 360]"), degrees=True)


@dataclass(frozen=True, kw_only=True)
class View:
    """Who looks at the sky, and when.

    Attributes:
        epoch: UTC of the manoeuvre's start.
        observer: the satellite.
        for_duration: s, how long zones about bodies hold; None for the trajectory's duration.
        atmosphere: km that belong to the Earth's limb.
    """

    epoch: np.datetime64
    observer: sky.CircularOrbit | sky.Tle
    for_duration: float | None = None
    atmosphere: float = 0.0


@dataclass(frozen=True)
class Epoch(Kind):
    """A time in UTC, as text or as TOML's own date-time."""

    wanted = "a time in UTC such as 2026-01-01T00:00:00, from 1972 to 2099"

    def read(self, value: object, place: Place) -> np.datetime64 | None:
        """The instant, to the microsecond."""
        if isinstance(value, str | datetime):
            try:
                return parse_epoch(value)
            except ValueError:
                pass  # the fault says what is wanted
        place.fault(f"must be {self.wanted}", value)
        return None


@dataclass(frozen=True)
class TwoLines(Kind):
    """Two-line elements."""

    wanted = "an array of the two lines of a set of elements"

    def read(self, value: object, place: Place) -> sky.Tle | None:
        """The satellite."""
        texts = [line for line in value if isinstance(line, str)] if isinstance(value, list) else []
        if not isinstance(value, list) or len(texts) != 2 or len(value) != 2:
            place.fault(f"must be {self.wanted}", value)
            return None
        try:
            return sky.parse_tle("\n".join(texts))
        except sky.TleError as error:
            for fault in error.faults:
                place.fault(fault)
        return None


_ORBIT = Table(
    sky.CircularOrbit,
    (
        Field("altitude_km", Number(Interval("(0, 1e6]")), "altitude", "above 6378.137 km", required=True),
        Field("inclination_deg", _ANGLE_DEG, "inclination", "to the equator of J2000", required=True),
        Field("ascending_node_deg", _ANGLE_DEG, "node", "its right ascension", required=True),
        Field(
            "argument_of_latitude_deg",
            _ANGLE_DEG,
            "latitude",
            "from the node on, at epoch_utc",
            required=True,
        ),
    ),
    refused={"tle": "the observer has an altitude_km; give either two-line elements or a circular orbit"},
)
_TWO_LINES = Table(
    sky.Tle,
    (Field("tle", TwoLines(), "tle", "two-line elements", required=True),),
    make=lambda tle: tle,
    refused={field.key: "the observer has a tle, which says all of its orbit" for field in _ORBIT.fields},
)


@dataclass(frozen=True)
class Observer(Either):
    """A satellite: a table with two-line elements, or one with a circular orbit."""

    wanted = f"a table with tle, or with {', '.join(field.key for field in _ORBIT.fields)}"

    @property
    def tables(self) -> dict[str, Table]:
        """By what tells them apart."""
        return {"by two-line elements": _TWO_LINES, "on a circular orbit": _ORBIT}

    def read(self, value: object, place: Place) -> sky.CircularOrbit | sky.Tle | None:
        """The satellite, None if anything about it is wrong."""
        before = len(place.faults)
        table = _TWO_LINES if isinstance(value, dict) and "tle" in value else _ORBIT
        read = table.read(value, place)
        satellite: sky.CircularOrbit | sky.Tle | None = None
        if len(place.faults) == before:
            satellite = table.build(read)
        return satellite


SKY = Table(
    View,
    (
        Field("epoch_utc", Epoch(), "epoch", "UTC of the start", required=True),
        Field("observer", Observer(), "observer", "the satellite that looks", required=True),
        Field(
            "for_duration_s",
            Number(Interval("[0, 86400]")),
            "for_duration",
            "how long zones about bodies hold; trajectory.duration_s if that is a number",
        ),
        Field("atmosphere_km", Number(Interval("[0, 1000]")), "atmosphere", "belongs to the Earth's limb"),
    ),
)


def resolve_bodies(tables: Mapping[str, Any], read: Mapping[str, Any], root: Place) -> None:
    """Put a direction and a half angle in the place of each body, or note why there are none.

    Args:
        tables: of the file.
        read: what could be read of them; its keep-out zones are changed.
        root: the place of the file.
    """
    rows = tables.get("keep_out")
    rows = rows if isinstance(rows, list) else []  # whatever else it is has been noted
    zones = [
        (row, zone, root.key("keep_out").item(i))
        for i, (row, zone) in enumerate(zip(rows, read.get("keep_out") or [], strict=False))
        if isinstance(row, dict) and zone is not None
    ]
    for row, _, place in zones:
        if "exclusion_deg" in row and "body" not in row:
            place.key("exclusion_deg").fault("needs a body, from whose limb it counts", row["exclusion_deg"])
        if "body" in row and "sky" not in tables:
            place.key("body").fault("needs [sky], with epoch_utc and observer", row["body"])
    about = [entry for entry in zones if "body" in entry[0]]
    view = _view(tables, read, root) if about else None
    for row, zone, place in about:
        if view is None or not isinstance(zone.get("direction"), str) or "half_angle" not in zone:
            continue  # noted before
        angle, from_limb = shortest_degrees(zone["half_angle"]), "exclusion_deg" in row
        try:
            found = sky.keep_out(
                zone["direction"],
                epoch=view.epoch,
                observer=view.observer,
                half_angle_deg=None if from_limb else angle,
                exclusion_deg=angle if from_limb else None,
                atmosphere_km=view.atmosphere,
                for_duration_s=view.for_duration or 0.0,
            )
        except (ValueError, ImportError) as error:
            place.key("body").fault(str(error), row["body"])
        else:
            zone.update(direction=found.direction, half_angle=found.half_angle)


def _view(tables: Mapping[str, Any], read: Mapping[str, Any], root: Place) -> View | None:
    """The view with its duration, None if a part of it is wrong."""
    given, place = tables.get("sky"), root.key("sky")
    parts = read.get("sky") or {}
    if not isinstance(given, dict) or len(parts) < len(given) or not {"epoch", "observer"} <= parts.keys():
        return None  # noted before
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
    return View(**{**parts, "for_duration": wanted})
