"""The table ``[sky]`` and the names of devices: what a scenario file may refer to by name.

The table ``[sky]``: who looks at the sky, when, and which satellites there are to be looked at.

Kinds of values in a scenario file that name devices: lists of them, and factors for some.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import date
from typing import Any

import numpy as np

from jaxplan import sky
from jaxplan.epochs import parse_epoch
from jaxplan.schema.faults import Place, nearest
from jaxplan.schema.kinds import Interval, Kind, Number, Text
from jaxplan.schema.tables import Either, Field, Rows, Table

_ANGLE_DEG = Number(Interval("[-360, 360]"), degrees=True)
_INCLINATION = Number(Interval("[-180, 180]"), degrees=True)


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

    epoch: np.datetime64
    observer: sky.CircularOrbit | sky.Tle
    for_duration: float | None = None
    atmosphere: float = 0.0
    satellites: tuple["Satellite", ...] = ()


@dataclass(frozen=True, kw_only=True)
class Satellite:
    """A satellite that is looked at: a zone is about it, or a target.

    Attributes:
        name: unique.
        orbit: of the satellite.
    """

    name: str
    orbit: sky.CircularOrbit | sky.Tle


@dataclass(frozen=True)
class Epoch(Kind):
    """A time in UTC, as text or as TOML's own date-time or date."""

    wanted = "a time in UTC such as 2026-01-01T00:00:00, from 1972 to 2099"

    def read(self, value: object, place: Place) -> np.datetime64 | None:
        """The instant, to the microsecond."""
        if isinstance(value, str | date):
            try:
                return parse_epoch(value)
            except ValueError:
                pass  # the fault says what is wanted
        place.fault(f"must be {self.wanted}", value)
        return None

    def take(self, value: Any, place: Place) -> Any:
        """The instant, of numpy's or in any way that a file may have it."""
        return self.read(self.write(value) if isinstance(value, np.datetime64) else value, place)

    def write(self, value: np.datetime64) -> str:
        """Text, without zeros at its end."""
        text = str(value.astype("datetime64[us]"))
        return text.rstrip("0").rstrip(".") if "." in text else text


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
    refused={"tle": "the satellite has an altitude_km; give either two-line elements or a circular orbit"},
)
_TWO_LINES = Table(
    sky.Tle,
    (Field("tle", TwoLines(), "tle", "two-line elements", required=True),),
    make=lambda tle: tle,
    refused={field.key: "the satellite has a tle, which says all of its orbit" for field in _ORBIT.fields},
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


SATELLITES = Rows(
    Table(
        Satellite,
        (
            Field("name", Text(), "name", "unique, and no body's", required=True),
            Field("orbit", Observer(), "orbit", "of the satellite", required=True),
        ),
    )
)

SKY = Table(
    View,
    (
        Field("epoch_utc", Epoch(), "epoch", "UTC of the start", required=True),
        Field("observer", Observer(), "observer", "the satellite that looks", required=True),
        Field(
            "for_duration_s",
            Number(Interval("[0, 86400]")),
            "for_duration",
            "how long zones about bodies hold and what moves is known; trajectory.duration_s if a number",
        ),
        Field("atmosphere_km", Number(Interval("[0, 1000]")), "atmosphere", "belongs to the Earth's limb"),
        Field("satellite", SATELLITES, "satellites", "others, for zones and targets to follow"),
    ),
)


_FACTOR = Number(Interval("[1e-3, 1e3]"))


@dataclass(frozen=True)
class DeviceList(Kind):
    """Names of terminals and instruments, at least one."""

    wanted = "an array of names of devices"

    def read(self, value: object, place: Place) -> tuple[str, ...] | None:
        """The names."""
        if not isinstance(value, list) or not value:
            place.fault(f"must be {self.wanted}, at least one", value)
            return None
        before = len(place.faults)
        known = place.devices.all
        seen: set[str] = set()
        for i, name in enumerate(value):
            if not isinstance(name, str):
                place.item(i).fault("must be the name of a device", name)
            elif name in seen:
                place.item(i).fault("is named twice", name)
            elif known is not None and name not in known:
                place.item(i).fault(f"no such device, {nearest(name, known, 'devices')}", name)
            else:
                seen.add(name)
        return tuple(value) if len(place.faults) == before else None

    def take(self, value: Any, place: Place) -> tuple[str, ...] | None:
        """The names; one by itself may be given as it is, and none."""
        names = [value] if isinstance(value, str) else value
        if isinstance(names, list | tuple) and all(isinstance(name, str) for name in names):
            return self.read(list(names), place) if names else ()
        place.refuse("must be a tuple of names of devices", value)
        return None

    def write(self, value: Any) -> list[str]:
        """A list."""
        return list(value)


@dataclass(frozen=True)
class DeviceName(Kind):
    """The name of a device.

    Attributes:
        with_joints: whether it must be a terminal.
    """

    with_joints: bool = False

    @property
    def wanted(self) -> str:
        """What it names."""
        return f"the name of a {self._noun}"

    @property
    def _noun(self) -> str:
        return "terminal" if self.with_joints else "device"

    def read(self, value: object, place: Place) -> str | None:
        """The name."""
        known = place.devices.terminals if self.with_joints else place.devices.all
        if not isinstance(value, str):
            place.fault(f"must be {self.wanted}", value)
        elif known is not None and value not in known:
            place.fault(f"no such {self._noun}, {nearest(value, known, f'{self._noun}s')}", value)
        else:
            return value
        return None

    def take(self, value: Any, place: Place) -> str | None:
        """The name."""
        if isinstance(value, str):
            return self.read(value, place)
        place.refuse(f"must be {self.wanted}", value)
        return None


@dataclass(frozen=True)
class TerminalFactors(Kind):
    """A positive factor for some of the terminals."""

    wanted = "a table from names of terminals to numbers"
    range = _FACTOR.range

    def read(self, value: object, place: Place) -> dict[str, float] | None:
        """The factors by name."""
        if not isinstance(value, dict):
            place.fault(f"must be {self.wanted}", value)
            return None
        return self._each(_FACTOR.read, value, place)

    def _each(self, make: Callable[[Any, Place], Any], value: Mapping[str, Any], place: Place) -> Any:
        """The factors of terminals that there are."""
        before = len(place.faults)
        known = place.devices.terminals
        for name in value:
            if known is not None and name not in known:
                place.key(name).fault(f"no such terminal, {nearest(name, known, 'terminals')}")
        read = {name: make(number, place.key(name)) for name, number in value.items()}
        return read if len(place.faults) == before else None

    def take(self, value: Any, place: Place) -> dict[str, float] | None:
        """The factors by name."""
        if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
            place.refuse("must be a dict from names of terminals to numbers", value)
            return None
        return self._each(_FACTOR.take, value, place)

    def write(self, value: Any) -> dict[str, float]:
        """A table."""
        return {name: float(factor) for name, factor in value.items()}
