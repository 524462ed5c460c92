"""The layout of a scenario file: its tables, from what the model's fields say of their keys.

Key, range and meaning of an attribute stand with the attribute. Here is what no single field can say: kinds
of values that have a name, and what files hold in other ways than the model does. Those are few: angles of
yaw and pitch apart, or in degrees; a quaternion; directions that move, as samples over times or by the name
of a body or satellite of ``[sky]``; and a goal, which is one of two tables.

Ranges that nature does not give are wider than any spacecraft needs, and narrow enough that nothing computed
from the numbers overflows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from jaxplan.model.directions import DirectionPath
from jaxplan.model.hidden import Hidden
from jaxplan.model.keys import Key
from jaxplan.model.outlines import FORWARD
from jaxplan.model.scenario import (
    GivenState,
    Scenario,
    SearchSettings,
    Targets,
    TrajectorySettings,
    Wish,
)
from jaxplan.model.spacecraft import Drive, Instrument, Mount, Spacecraft, Terminal
from jaxplan.model.zones import FixedVector, JointBound, KeepIn, KeepOut
from jaxplan.schema.arrays import (
    DIRECTION,
    PLANE_DIRECTION,
    QUATERNION,
    Array,
    Numbers,
    PerAxis,
    Polygons,
    each_drive,
    each_joint,
    each_terminal,
    inertia,
    range_of,
    rising,
    units,
)
from jaxplan.schema.checks import (
    check_drive,
    check_mount,
    check_spacecraft,
    check_targets,
    check_terminal,
)
from jaxplan.schema.faults import WRONG, Place, Reading, nearest
from jaxplan.schema.fields import check_field
from jaxplan.schema.kinds import (
    ByName,
    Choice,
    Epoch,
    FromZero,
    Interval,
    Kind,
    Name,
    Names,
    Number,
    Text,
    YesNo,
    shortest_degrees,
)
from jaxplan.schema.sky import SKY, Followed
from jaxplan.schema.tables import Either, Field, Table, table
from jaxplan.sky import BODIES

SCHEMA_VERSION = 1
_ANGLE = Number(Interval("[-1e3, 1e3]"))  # rad, or rad/s: any number of turns that a file may mean
_ANGLE_DEG = Number(Interval("[-5e4, 5e4]"), degrees=True)
_SLOPE_ROUNDING = 1e-3  # rad between two samples, by which slopes held with fewer digits may be off


@dataclass(frozen=True)
class Axis(Kind):
    """A direction: a unit vector, or a path where it moves.

    Attributes:
        inline: whether a file may have it as a table of samples and times; else these stand beside it.
        moving: whether it may move; then a file may have a name of ``[sky]``, too.
    """

    inline: bool = False
    moving: bool = True

    @property
    def wanted(self) -> str:
        return DIRECTION.wanted

    @property
    def fields(self) -> Sequence[Field]:  # type: ignore[override]
        return PATH.attributes

    def read(self, value: Any, place: Place) -> Any:
        if isinstance(value, DirectionPath):
            if value.moves and not self.moving:
                return place.refuse(f"must be {self.wanted}, not a direction that moves", value)
            return _taken_path(value, place) if value.moves else DIRECTION.read(value.samples[0], place)
        if not place.reading.python:
            if isinstance(value, str) and self.moving:
                return Followed(value, "" if self.inline else "direction")
            if isinstance(value, dict) and self.inline:
                return PATH.read(value, place)
        return DIRECTION.read(value, place)

    def write(self, value: Any) -> Any:
        if not isinstance(value, DirectionPath):
            return DIRECTION.write(value)
        return PATH.write(value) if value.moves else DIRECTION.write(value.samples[0])


class TargetDevices(Names):
    """Names of the devices that have targets, in Python; none for the terminals."""

    def read(self, value: Any, place: Place) -> Any:
        read = super().read(value, place)
        reading = place.reading
        reading.sizes["target"] = len(read) if read and read is not WRONG else reading.sizes["terminal"]
        return read


@dataclass(frozen=True)
class TargetList(Kind):
    """A direction for each terminal, or by names of devices: an array of them, or a tuple where some move."""

    still = Array(("target", 3), noun="directions, one a terminal", rule=units)
    wanted = f"an array of {still.wanted}, or a table of them by names of devices"
    fields = property(lambda self: PATH.attributes)

    @property
    def tables(self) -> dict[str, Table]:
        """The table of an entry that moves, by words for it, for the reference."""
        return {"of one that moves": PATH}

    def read(self, value: Any, place: Place) -> Any:
        if isinstance(value, dict) and not place.reading.python:
            return self._by_name(value, place)
        if not place.reading.python:
            place.reading.sizes["target"] = place.reading.sizes["terminal"]
        entries = value if isinstance(value, list | tuple) else ()
        if not any(isinstance(one, str | dict | DirectionPath) for one in entries):
            read = self.still.read(value, place)
            return read.reshape(-1, 3) if isinstance(read, np.ndarray) else read  # also of no terminals
        count = place.reading.sizes["target"]
        if count not in (None, len(value)):
            complaint = f"must be an array of {count} {self.still.wanted}, not of {len(value)}"
            return place.refuse(complaint, value)
        return _together([Axis(inline=True).read(entry, place[i]) for i, entry in enumerate(value)])

    def _by_name(self, value: dict[str, Any], place: Place) -> Any:
        """The names and directions of a table of a file."""
        known = place.reading.names.get("device")
        for name in value:
            if known is not None and name not in known:
                place[name].fault(f"no such device, {nearest(name, known, 'devices')}")
        return tuple(value), _together(
            [Axis(inline=True).read(own, place[name]) for name, own in value.items()]
        )

    def may_miss(self, reading: Reading) -> bool:
        return reading.sizes.get("terminal") == 0

    def write(self, value: Any) -> Any:
        if isinstance(value, dict):
            return {name: Axis().write(direction) for name, direction in value.items()}
        return [Axis().write(direction) for direction in value]


def _together(each: Sequence[Any]) -> Any:
    """Directions as targets hold them."""
    if any(one is WRONG for one in each):
        return WRONG
    moving = any(isinstance(one, Followed | DirectionPath) for one in each)
    return tuple(each) if moving else np.array(each).reshape(-1, 3)


def _path(parts: dict[str, Any], place: Place) -> Any:
    """The path through samples, or `WRONG` where they have faults, or after noting that there is none."""
    place.reading.sizes.pop("sample", None)  # the next path has its own number of them
    samples, times, hidden = parts["samples"], parts["times"], parts.get("hidden", ())
    if samples is WRONG or times is WRONG or WRONG in hidden:
        return WRONG
    try:
        return replace(DirectionPath.through(times, samples), hidden=hidden)
    except ValueError as error:
        return place["direction_samples"].fault(str(error).removeprefix("samples: "), samples.tolist())


def _taken_path(path: DirectionPath, place: Place) -> Any:
    """The path of one made in Python, made anew from its samples as a file's is."""
    parts = {
        entry.attribute: entry.kind.read(getattr(path, entry.attribute), place[entry.key])
        for entry in PATH.attributes
    }
    made = _path(parts, place)
    slopes = parts["slopes"]
    if made is WRONG or slopes is WRONG:
        return WRONG
    off = (slopes - made.slopes) * np.gradient(made.times)[:, None]
    wrong = np.flatnonzero(~np.all(np.abs(off) <= _SLOPE_ROUNDING, axis=1))
    if len(wrong):
        i = int(wrong[0])
        complaint = "must be that of the spline; DirectionPath.through finds it"
        return place["slopes"][i].fault(complaint, slopes[i])
    return made


def _of_number(make: Callable[[Number], Kind]) -> Callable[[Key], Kind]:
    return lambda told: make(Number(Interval(told.range), degrees="_deg" in told.name))


_KINDS: dict[Any, Any] = {
    "unit vector": Axis(moving=False),
    "plane unit vector": PLANE_DIRECTION,
    "axis": Axis(),
    "aim": Axis(inline=True),
    "targets": TargetList(),
    "target devices": TargetDevices(),
    "rotation vector": Array(
        (3,),
        _ANGLE,
        noun="a rotation vector of 3 numbers",
        hint=", as scipy's Rotation has by as_rotvec()",
    ),
    "angular velocity": Array((3,), _ANGLE, zero=True),
    "joints": each_joint(_ANGLE),
    "joint rates": each_joint(_ANGLE, zero=True),
    "per axis": _of_number(PerAxis),
    "range": _of_number(lambda each: Array((2,), each, noun="2 numbers, least and largest", rule=range_of)),
    "inertia": _of_number(
        lambda each: Array(
            (3, 3),
            each,
            noun="3 rows of 3 numbers",
            hint="; np.diag makes them of principal moments",
            rule=inertia,
        )
    ),
    "device": Name("device"),
    "terminal": Name("terminal"),
    "gimbal": Name("gimbal"),
    "devices": Names(),
    "two angles": _of_number(partial(Numbers, 2)),
    "polygons": _of_number(Polygons),
    "half angle": lambda told: FromZero(Interval(told.range), degrees=True),
    "factors": _of_number(lambda each: ByName(each, "gimbal")),
    "epoch": Epoch(),
    "samples": Array(("sample", 3), noun="unit vectors of 3 numbers, one a time", rule=units),
    "slopes": Array(("sample", 3), noun="vectors of 3 numbers, one a time"),
    "sample times": _of_number(
        lambda each: Array(("sample",), each, noun="rising numbers, the first at most 0", rule=rising)
    ),
}


def _table(model: type, **more: Any) -> Table:
    """The table of a class of the model, which tables of others may have in them."""
    _KINDS[model] = table(model, _KINDS, **more)
    return _KINDS[model]


def _check_terminal(terminal: Terminal, place: Place) -> None:
    check_terminal(terminal, place)
    check_field(terminal, place, FORWARD)


def _check_span(span: Hidden, place: Place) -> None:
    if WRONG not in (span.start, span.end) and not span.start < span.end:
        place["to_s"].fault(f"must be later than {place['from_s'].told(span.start)}", span.end)


HIDDEN = _table(Hidden, check=_check_span)
PATH: Table = _table(DirectionPath, make=_path)
MOUNT = _table(Mount, check=check_mount)
TERMINAL = _table(Terminal, check=_check_terminal)
DRIVE = _table(Drive, check=check_drive)
INSTRUMENT = _table(Instrument, check=check_field)
SPACECRAFT = _table(Spacecraft, check=check_spacecraft)
VECTOR = _table(FixedVector)
SEARCH = _table(SearchSettings)
TRAJECTORY = _table(TrajectorySettings)


def _make_zone(model: type, parts: dict[str, Any], place: Place) -> Any:
    """A zone, whose axis a file may have as samples over times, or by a name that ``[sky]`` knows."""
    samples, times = parts.pop("samples", None), parts.pop("times", None)
    if samples is not None:
        if times is None:
            times = place["times_s"].fault(f"missing, must be {_TIMES.kind.wanted}")
        parts["direction"] = _path({"samples": samples, "times": times}, place)
    elif times is not None:
        place["times_s"].fault("needs direction_samples, whose times they are")
        place.reading.sizes.pop("sample", None)
    body, moving = parts.pop("body", None), parts.pop("moving", None)
    exclusion, satellite = parts.pop("exclusion", None), parts.pop("satellite", None)
    if body is None and exclusion not in (None, WRONG):
        complaint = "needs a body, from whose limb it counts"
        place["exclusion_deg"].fault(complaint, shortest_degrees(exclusion))
    if body is None and moving not in (None, WRONG):
        place["moving"].fault("needs a body, which the axis follows or not", moving)
    if exclusion is not None:
        parts["half_angle"] = exclusion
    if body is not None or satellite is not None:
        name, key = (satellite, "satellite") if body is None else (body, "body")
        found = Followed(name, key, from_limb=exclusion is not None, moving=bool(moving))
        parts["direction"] = WRONG if name is WRONG else found
    return model(**parts)


def _split_zone(zone: Any) -> dict[str, Any]:
    """The keys of a zone in a file, which has samples and times of an axis that moves."""
    if not zone.moves:
        return vars(zone)
    return vars(zone) | {"direction": None, "samples": zone.direction.samples, "times": zone.direction.times}


_SAMPLES, _TIMES = (
    replace(entry, required=False, held=f"direction.{entry.attribute}") for entry in PATH.fields[:2]
)
_MOVING = (
    Field(
        "satellite",
        Text(),
        "satellite",
        "the axis follows it; a satellite or ground point of [sky]",
        instead_of="direction",
    ),
    replace(_SAMPLES, instead_of="direction"),
    _TIMES,
)
_ABOUT_BODIES = (
    Field("body", Choice(BODIES), "body", "the axis points to it, as [sky] has it", instead_of="direction"),
    Field(
        "exclusion_deg",
        Number(Interval("[0, 180)"), degrees=True),
        "exclusion",
        "from the body's limb to the edge",
        instead_of="half_angle",
    ),
    Field(
        "moving",
        YesNo(),
        "moving",
        "whether the axis follows the body; if false or absent, a wider zone stands still for as long",
    ),
)
KEEP_OUT, KEEP_IN = (
    _table(model, before={"devices": further}, make=partial(_make_zone, model), split=_split_zone)
    for model, further in ((KeepOut, (*_ABOUT_BODIES, *_MOVING)), (KeepIn, _MOVING))
)
JOINT_BOUND = _table(JointBound)


_JOINT_PARTS = ("yaws", "pitches", "drives")


def _make_state(parts: dict[str, Any], place: Place) -> GivenState:
    """A state, whose joints a file has as yaws, pitches and angles of drives, or by names of devices."""
    by_name = parts.pop("joints_by_name", None)
    found = {of: parts.pop(f"{of}_deg", parts.pop(of, None)) for of in _JOINT_PARTS}
    given = [own for own in found.values() if own is not None]
    reading = place.reading
    if by_name is not None:
        if given:
            place["joints_deg"].fault("stands in the place of the arrays of angles, give either")
        joints = _joints_by_name(by_name, reading)
    else:
        for of, own in found.items():
            count = reading.sizes.get("drive" if of == "drives" else "terminal")
            if own is None and count:
                key = {"yaws": "yaw_rad", "pitches": "pitch_rad", "drives": "drive_rad"}[of]
                alternatives = f"{key.replace('rad', 'deg')}, joints_deg"
                wrong = place[key].fault(f"missing (or {alternatives}), must be {_counted(key, count)}")
                given.append(wrong)
        joints = WRONG if any(own is WRONG for own in given) else np.concatenate([np.zeros(0), *given])
    turned = parts.pop("quaternion", None)
    return GivenState(**parts | {"joints": joints} | ({} if turned is None else {"rotation_vector": turned}))


def _counted(key: str, count: int) -> str:
    what = "drive" if key.startswith("drive") else "terminal"
    return (
        f"an array of {count} numbers, one a {what}" if count > 1 else f"an array of 1 number, one a {what}"
    )


def _joints_by_name(by_name: Any, reading: Reading) -> Any:
    """Joints (J,) of devices by name; those that are not named at zero, or at what is nearest in range."""
    gimbals, terminals, ranges = (reading.names.get("gimbal"), reading.names.get("terminal"), reading.ranges)
    if by_name is WRONG or gimbals is None or terminals is None or ranges is None:
        return WRONG
    joints = np.clip(0.0, *ranges.T)
    for name, angles in by_name.items():
        number = gimbals.index(name)
        if number < len(terminals):
            joints[[number, number + len(terminals)]] = angles
        else:
            joints[number + len(terminals)] = angles[0]
    return joints


@dataclass(frozen=True)
class _StateOf:
    """A state that is to be written, and for how many terminals it is."""

    state: GivenState
    terminals: int


def _split_state(given: _StateOf) -> dict[str, Any]:
    parts = _without_zero_rates(given.state)
    ends = [given.terminals, 2 * given.terminals]
    own = zip(_JOINT_PARTS, np.split(np.asarray(parts.pop("joints")), ends), strict=True)
    return parts | {of: angles for of, angles in own if len(angles)}


class JointsByName(Kind):
    """Angles of devices by name: two of a terminal, one of a drive."""

    wanted = "a table from names of devices to arrays of their angles: yaw and pitch, or a drive's one"

    @property
    def range(self) -> str | None:
        return _ANGLE_DEG.range

    def read(self, value: Any, place: Place) -> Any:
        if not isinstance(value, dict):
            return place.refuse(f"must be {self.wanted}", value)
        gimbals, terminals = (place.reading.names.get(noun) for noun in ("gimbal", "terminal"))
        found: dict[str, Any] = {}
        for name, angles in value.items():
            if gimbals is not None and name not in gimbals:
                place[name].fault(f"no such device with joints, {nearest(name, gimbals, 'devices')}")
                found[name] = WRONG
            elif terminals is not None:
                count = 2 if name in terminals else 1
                noun = "numbers, yaw and pitch" if count == 2 else "number, the angle of a drive"
                found[name] = Array((count,), _ANGLE_DEG, noun=f"{count} {noun}").read(angles, place[name])
        return WRONG if any(own is WRONG for own in found.values()) else found


def _without_zero_rates(state: GivenState | Targets) -> dict[str, Any]:
    """The attributes of a state without rates of zero, which an absent key stands for (not minus zero)."""
    parts = dict(vars(state))
    for name in ("angular_velocity", "joint_rates"):
        if parts[name] is None or not (np.any(parts[name]) or np.any(np.signbit(parts[name]))):
            del parts[name]
    return parts


def _angles(axis: str, attribute: str) -> tuple[Field, Field]:
    """The two keys of a joint's angles."""
    meaning = "angle of each drive" if axis == "drive" else f"angle of each terminal's {axis} joint"
    each = each_drive if axis == "drive" else each_terminal
    radians = Field(f"{axis}_rad", each(_ANGLE), attribute, meaning, held="joints")
    degrees = Field(f"{axis}_deg", each(_ANGLE_DEG), f"{attribute}_deg", meaning, held="joints")
    return radians, replace(degrees, instead_of=attribute)


_ANGLES = (
    *_angles("yaw", "yaws"),
    *_angles("pitch", "pitches"),
    *_angles("drive", "drives"),
    Field(
        "joints_deg",
        JointsByName(),
        "joints_by_name",
        "angles by names of devices, in place of the arrays; of others zero, or the nearest in range",
        held="joints",
    ),
)
_QUATERNION = Field(
    "quaternion_wxyz",
    QUATERNION,
    "quaternion",
    "the attitude as a quaternion, scalar first",
    instead_of="rotation_vector",
)
STATE = _table(
    GivenState,
    before={"angular_velocity_rad_s": (_QUATERNION, *_ANGLES)},
    make=_make_state,
    split=_split_state,
)
_STATE_KEYS = ["attitude", *(entry.key for entry in (_QUATERNION, *_ANGLES))]
WISH = _table(Wish)


def _make_targets(parts: dict[str, Any], place: Place) -> Targets:
    """Targets, which a file may have by names of devices."""
    if isinstance(parts.get("directions"), tuple) and len(parts["directions"]) == 2:
        names, directions = parts["directions"]
        if isinstance(names, tuple) and all(isinstance(name, str) for name in names):
            parts |= {"devices": names, "directions": directions}
    return Targets(**parts)


def _split_targets(targets: Targets) -> dict[str, Any]:
    parts = _without_zero_rates(targets)
    if targets.devices:
        parts["directions"] = dict(zip(targets.devices, targets.directions, strict=True))
    return parts


TARGETS = _table(
    Targets,
    make=_make_targets,
    split=_split_targets,
    check=check_targets,
    refused=dict.fromkeys(
        _STATE_KEYS, "the goal has targets, from which attitude and joints are found; give either"
    ),
)
GIVEN_GOAL = replace(
    STATE,
    refused=dict.fromkeys(
        ("yaw_limit_deg", "pitch_limit_deg", "prefer", "hold", "tolerance_deg"),
        "only a goal with targets has it",
    ),
)


# A goal that is neither: its keys are read to note their faults.
_UNDECIDED = replace(
    STATE,
    fields=[
        replace(entry, required=False)
        for entry in (*TARGETS.fields, *STATE.fields)
        if entry.attribute not in ("angular_velocity", "joint_rates") or entry in STATE.fields
    ],
    make=lambda parts, place: WRONG,
)


class Goal(Either):
    """A goal: a table with targets, or one with a state."""

    wanted = "a table with targets, or with attitude, yaw_rad and pitch_rad"

    @property
    def tables(self) -> dict[str, Table]:
        return {"with targets": TARGETS, "as a given state": GIVEN_GOAL}

    def read(self, value: Any, place: Place) -> Any:
        if place.reading.python:
            if isinstance(value, GivenState | Targets):
                return (STATE if isinstance(value, GivenState) else TARGETS).read(value, place)
            return place.refuse("must be Targets or a GivenState", value)
        if isinstance(value, dict) and not value.keys() & {"targets", *_STATE_KEYS}:
            place.fault(f"must be {self.wanted}")
            return _UNDECIDED.read(value, place)
        return (TARGETS if isinstance(value, dict) and "targets" in value else GIVEN_GOAL).read(value, place)

    def write(self, value: Any) -> dict[str, Any]:
        return (STATE if isinstance(value, _StateOf) else TARGETS).write(value)


def _make_scenario(parts: dict[str, Any], place: Place) -> tuple[Scenario, Any]:
    """The scenario, and its view of the sky, of which only the epoch is kept."""
    del parts["schema_version"]
    view = parts.pop("sky", None)
    return Scenario(**parts), view


def _split_scenario(scenario: Scenario) -> dict[str, Any]:
    terminals = len(scenario.spacecraft.terminals)
    ends = {
        name: _StateOf(end, terminals) if isinstance(end, GivenState) else end
        for name, end in (("start", scenario.start), ("goal", scenario.goal))
    }
    return {"schema_version": SCHEMA_VERSION, **vars(scenario), **ends}


_KINDS["goal"] = Goal()
SCENARIO = _table(
    Scenario,
    before={
        "name": (
            Field(
                "schema_version", Choice((SCHEMA_VERSION,)), "schema_version", "of this layout", required=True
            ),
        ),
        "keep_out": (
            Field(
                "sky", SKY, "sky", "whence and when bodies and satellites are seen; resolved, never written"
            ),
        ),
    },
    make=_make_scenario,
    split=_split_scenario,
)
