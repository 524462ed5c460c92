"""How a file gives an orbit: circular, Keplerian, as two-line elements, by ephemeris files, or by samples."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxplan import sky
from jaxplan.schema.arrays import Array, rising
from jaxplan.schema.faults import WRONG, Place
from jaxplan.schema.tables import Either, Field, Table
from jaxplan.schema.value_kinds import Choice, Integer, Interval, Kind, Number
from jaxplan.sky.ephemeris import FARTHEST, FRAMES
from jaxplan.sky.frames import EARTH_RADIUS
from jaxplan.sky.orbits import HIGHEST_ALTITUDE

_ANGLE_DEG = Number(Interval("[-360, 360]"), degrees=True)
_INCLINATION_DEG = Number(Interval("[-180, 180]"), degrees=True)
_POSITION_KM = Number(Interval(f"[-{FARTHEST}, {FARTHEST}]"), hint="it is in km")
_VELOCITY_KM_S = Number(Interval("[-100, 100]"), hint="it is in km/s")
_LOWEST_ALTITUDE = 100.0  # km, below which no satellite stays in orbit for a revolution
_TIME_S = Number(Interval("[-1e7, 1e7]"))  # s
_ALTITUDE_KM = Number(
    Interval(f"(0, {HIGHEST_ALTITUDE:g}]"), hint="it is in km; higher orbits have semi_major_axis_km instead"
)


@dataclass(frozen=True)
class TwoLines(Kind):
    """An orbit as an array of the two lines of a set of two-line elements."""

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


@dataclass(frozen=True)
class Message(Kind):
    """The path of a CCSDS Orbit Ephemeris Message, relative to the folder of the scenario.

    Reading it gives the ephemeris itself.
    """

    wanted = "the path of an Orbit Ephemeris Message (CCSDS OEM), relative to this file"

    def read(self, value: Any, place: Place) -> Any:
        if not isinstance(value, str) or not value:
            return place.refuse(f"must be {self.wanted}", value)
        try:
            return sky.read_oem(Path(place.reading.folder) / value)
        except OSError as error:
            return place.fault(f"cannot be read: {error.strerror or error}", value)
        except (ValueError, ImportError) as error:
            return place.fault(str(error), value)


@dataclass(frozen=True)
class Kernels(Kind):
    """Paths of SPICE's ephemeris kernels (SPK), relative to the folder of the scenario."""

    wanted = "the path of an SPK kernel of SPICE (.bsp), or an array of such, relative to this file"

    def read(self, value: Any, place: Place) -> Any:
        paths = [value] if isinstance(value, str) else value
        if (
            not isinstance(paths, list)
            or not paths
            or not all(isinstance(each, str) and each for each in paths)
        ):
            return place.refuse(f"must be {self.wanted}", value)
        return [Path(place.reading.folder) / each for each in paths]


def _make_kernel_body(parts: dict[str, Any], place: Place) -> Any:
    """Make the body of SPICE kernels from what was read, by attribute.

    The result is `WRONG` if there is none, after noting why.
    """
    if WRONG in parts.values():
        return WRONG
    try:
        return sky.read_spk(parts["files"], parts["number"])
    except OSError as error:
        return place["spk"].fault(f"{error.filename}: cannot be read: {error.strerror or error}")
    except (ValueError, ImportError) as error:
        return place["spk"].fault(str(error))


def _make_circular(parts: dict[str, Any], place: Place) -> Any:
    """Make a circular orbit from what was read, by attribute; `WRONG` if a part of it is."""
    if WRONG in parts.values():
        return WRONG
    _warn_of_low_orbit(parts["altitude"], place["altitude_km"])
    return sky.CircularOrbit(**parts)


class LowOrbitWarning(UserWarning):
    """Warning that an orbit goes so low that no satellite stays on it."""


def _warn_of_low_orbit(lowest: float, place: Place) -> None:
    """Warn if an orbit goes down to air in which no satellite stays; `lowest` is its least altitude, km."""
    if lowest < _LOWEST_ALTITUDE:
        warnings.warn(
            f"{place.path}: the orbit goes down to {lowest:.6g} km, and below {_LOWEST_ALTITUDE:g} km air "
            "lets no satellite pass",
            LowOrbitWarning,
            stacklevel=2,
        )


def _make_keplerian(parts: dict[str, Any], place: Place) -> Any:
    """Make a Keplerian orbit from what was read, by attribute.

    The result is `WRONG` if a part of it is, or after noting a perigee inside the Earth.
    """
    if WRONG in parts.values():
        return WRONG
    lowest = parts["semi_major_axis"] * (1 - parts["eccentricity"])
    if not lowest > EARTH_RADIUS:
        complaint = f"with this eccentricity the perigee is {lowest:.6g} km from the Earth's centre, must be "
        return place["semi_major_axis_km"].fault(
            f"{complaint}beyond {EARTH_RADIUS}", parts["semi_major_axis"]
        )
    _warn_of_low_orbit(lowest - EARTH_RADIUS, place["semi_major_axis_km"])
    return sky.KeplerOrbit(**parts)


def _make_samples(parts: dict[str, Any], place: Place) -> Any:
    """Make the ephemeris through samples of position; `WRONG` after noting why there is none.

    Times count from the start of the manoeuvre.
    """
    place.reading.sizes.pop("sample", None)  # the next has its own number of them
    if any(part is WRONG for part in parts.values()):
        return WRONG
    try:
        return sky.Ephemeris.through(parts["times"], parts["positions"], parts.get("velocities"))
    except sky.EphemerisError as error:
        return place["position_samples_km"].fault(str(error))


_CIRCULAR_FIELDS = (
    # An altitude in metres is beyond the upper end wherever an orbit lasts.
    Field("altitude_km", _ALTITUDE_KM, "altitude", "above 6378.137 km", required=True),
    Field("inclination_deg", _INCLINATION_DEG, "inclination", "to the equator of J2000", required=True),
    Field("ascending_node_deg", _ANGLE_DEG, "node", "its right ascension", required=True),
    Field(
        "argument_of_latitude_deg", _ANGLE_DEG, "latitude", "from the node on, at epoch_utc", required=True
    ),
)
_KEPLERIAN_FIELDS = (
    Field(
        "semi_major_axis_km",
        Number(Interval("(0, 1e6]"), hint="it is in km"),
        "semi_major_axis",
        "half the length of the ellipse, whose perigee is outside the Earth",
        required=True,
    ),
    Field("eccentricity", Number(Interval("[0, 1)")), "eccentricity", "0 of a circle", required=True),
    *_CIRCULAR_FIELDS[1:3],
    Field("argument_of_perigee_deg", _ANGLE_DEG, "perigee", "from the node on", required=True),
    Field("true_anomaly_deg", _ANGLE_DEG, "anomaly", "from the perigee on, at epoch_utc", required=True),
)
_TLE_FIELDS = (Field("tle", TwoLines(), "tle", "two-line elements", required=True),)
_MESSAGE_FIELDS = (Field("ephemeris", Message(), "ephemeris", "needs the extra oem", required=True),)
_KERNEL_FIELDS = (
    Field("spk", Kernels(), "files", "later ones have precedence; needs the extra spice", required=True),
    Field(
        "naif_id",
        Integer(Interval("[-2147483647, 2147483647]")),
        "number",
        "SPICE's number of the satellite or body",
        required=True,
    ),
)
_SAMPLE_FIELDS = (
    Field(
        "position_samples_km",
        Array(("sample", 3), _POSITION_KM, noun="positions of 3 numbers, one a time"),
        "positions",
        "over times_s, from the Earth's centre",
        required=True,
    ),
    Field(
        "velocity_samples_km_s",
        Array(("sample", 3), _VELOCITY_KM_S, noun="velocities of 3 numbers, one a time"),
        "velocities",
        "over times_s; with them fewer samples do",
    ),
    Field(
        "times_s",
        Array(("sample",), _TIME_S, noun="rising numbers, the first at most 0", rule=rising),
        "times",
        "of the samples; 0 at epoch_utc",
        required=True,
    ),
    Field("frame", Choice(FRAMES), "frame", "axes of the samples, all the same to 1.2e-7 rad"),
)


def _make_tables() -> dict[str, Table]:
    """Make the tables of all kinds of orbits, by words for the kind.

    Each refuses the keys of the other kinds with a message of its own.
    """
    kinds: Mapping[str, tuple[Any, Any, Any]] = {
        "on a circular orbit": (sky.CircularOrbit, _CIRCULAR_FIELDS, _make_circular),
        "on a Keplerian orbit": (sky.KeplerOrbit, _KEPLERIAN_FIELDS, _make_keplerian),
        "by two-line elements": (sky.Tle, _TLE_FIELDS, lambda parts, place: parts["tle"]),
        "by an ephemeris": (sky.Ephemeris, _MESSAGE_FIELDS, lambda parts, place: parts["ephemeris"]),
        "by SPICE kernels": (sky.SpkBody, _KERNEL_FIELDS, _make_kernel_body),
        "by samples": (sky.Ephemeris, _SAMPLE_FIELDS, _make_samples),
    }
    every = [entry.key for _, fields, _ in kinds.values() for entry in fields]
    tables = {}
    for words, (model, fields, make) in kinds.items():
        first, own = fields[0].key, [entry.key for entry in fields]
        others = dict.fromkeys(
            [key for key in every if key not in own],
            f"the satellite has {'an' if first[0] in 'ae' else 'a'} {first}, which says all of its orbit",
        )
        tables[words] = Table(model, fields, make=make, refused=others)
    return tables


_TABLES = _make_tables()


class Orbit(Either):
    """A satellite's orbit: one of several tables, told apart by their keys."""

    wanted = "a table with tle, ephemeris, spk, position_samples_km, semi_major_axis_km or altitude_km"

    @property
    def tables(self) -> dict[str, Table]:
        return _TABLES

    def read(self, value: Any, place: Place) -> Any:
        before = len(place.reading.faults)
        table = self._choose_table(value)
        others = [key for key in value if key in table.refused] if isinstance(value, dict) else []
        if len(others) > 1:  # told once
            keys = f"{', '.join(others[:-1])} and {others[-1]}"
            place.fault(f"{keys} stand beside what says all of the orbit, {table.fields[0].key}: give either")
            value = {key: own for key, own in value.items() if key not in others}
        read = table.read(value, place)
        return read if len(place.reading.faults) == before else WRONG

    def _choose_table(self, value: Any) -> Table:
        """Return the table that a value is meant for.

        It is one whose first key the value has, or else the one that has most of its keys.
        """
        given = set(value) if isinstance(value, dict) else set()
        circular, keplerian, *others = _TABLES.values()
        named = [table for table in (*others, circular, keplerian) if table.fields[0].key in given]
        likely = max(_TABLES.values(), key=lambda table: sum(entry.key in given for entry in table.fields))
        return named[0] if named else likely
