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
from jaxplan.model.keys import Key
from jaxplan.model.outlines import FORWARD
from jaxplan.model.scenario import GivenState, Scenario, SearchSettings, Targets, TrajectorySettings
from jaxplan.model.spacecraft import Instrument, Spacecraft, Terminal
from jaxplan.model.zones import FixedVector, JointBound, KeepIn, KeepOut
from jaxplan.schema.arrays import (
    DIRECTION,
    PLANE_DIRECTION,
    QUATERNION,
    Array,
    Numbers,
    PerAxis,
    Polygons,
    each_joint,
    each_terminal,
    inertia,
    rising,
    units,
)
from jaxplan.schema.checks import check_goal_rates, check_spacecraft
from jaxplan.schema.faults import WRONG, Place, Reading
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
        inline: whether a file may have it as a table of samples and times, or as a name of ``[sky]``; else
            these stand beside it.
        moving: whether it may move.
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
        if self.inline and not place.reading.python:
            if isinstance(value, str):
                return Followed(value)
            if isinstance(value, dict):
                return PATH.read(value, place)
        return DIRECTION.read(value, place)

    def write(self, value: Any) -> Any:
        if not isinstance(value, DirectionPath):
            return DIRECTION.write(value)
        return PATH.write(value) if value.moves else DIRECTION.write(value.samples[0])


@dataclass(frozen=True)
class TargetList(Kind):
    """A direction for each terminal: an array of them where none moves, else a tuple of what each is."""

    still = Array(("terminal", 3), noun="directions, one a terminal", rule=units)
    wanted = still.wanted
    fields = property(lambda self: PATH.attributes)

    def read(self, value: Any, place: Place) -> Any:
        entries = value if isinstance(value, list | tuple) else ()
        if not any(isinstance(one, str | dict | DirectionPath) for one in entries):
            read = self.still.read(value, place)
            return read.reshape(-1, 3) if isinstance(read, np.ndarray) else read  # also of no terminals
        count = place.reading.sizes["terminal"]
        if count not in (None, len(value)):
            complaint = f"must be an array of {count} {self.wanted}, not of {len(value)}"
            return place.refuse(complaint, value)
        each = tuple(Axis(inline=True).read(entry, place[i]) for i, entry in enumerate(value))
        if any(one is WRONG for one in each):
            return WRONG
        moving = any(isinstance(one, Followed | DirectionPath) for one in each)
        return each if moving else np.array(each)

    def may_miss(self, reading: Reading) -> bool:
        return self.still.may_miss(reading)

    def write(self, value: Any) -> list[Any]:
        return [Axis().write(direction) for direction in value]


def _path(parts: dict[str, Any], place: Place) -> Any:
    """The path through samples, or `WRONG` where they have faults, or after noting that there is none."""
    place.reading.sizes.pop("sample", None)  # the next path has its own number of them
    samples, times = parts["samples"], parts["times"]
    if samples is WRONG or times is WRONG:
        return WRONG
    try:
        return DirectionPath.through(times, samples)
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
    "targets": TargetList(),
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
    "devices": Names(),
    "two angles": _of_number(partial(Numbers, 2)),
    "polygons": _of_number(Polygons),
    "half angle": lambda told: FromZero(Interval(told.range), degrees=True),
    "factors": _of_number(lambda each: ByName(each, "terminal")),
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


PATH: Table = _table(DirectionPath, make=_path)
TERMINAL = _table(Terminal, check=partial(check_field, boresight=FORWARD))
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
    replace(entry, required=False, held=f"direction.{entry.attribute}") for entry in PATH.fields
)
_MOVING = (
    Field("satellite", Text(), "satellite", "the axis follows it; a name of [sky]", instead_of="direction"),
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


def _make_state(parts: dict[str, Any], place: Place) -> GivenState:
    """A state, whose joints a file has as yaws and pitches."""
    none = np.zeros(0)
    halves = [parts.pop(f"{of}_deg", parts.pop(of, none)) for of in ("yaws", "pitches")]
    joints = WRONG if any(half is WRONG for half in halves) else np.concatenate(halves)
    turned = parts.pop("quaternion", None)
    return GivenState(**parts | {"joints": joints} | ({} if turned is None else {"rotation_vector": turned}))


def _split_state(state: GivenState) -> dict[str, Any]:
    parts = _without_zero_rates(state)
    yaws, pitches = np.split(np.asarray(parts.pop("joints")), 2)
    return parts | ({"yaws": yaws, "pitches": pitches} if len(yaws) else {})


def _without_zero_rates(state: GivenState | Targets) -> dict[str, Any]:
    """The attributes of a state without rates of zero, which an absent key stands for (not minus zero)."""
    parts = dict(vars(state))
    for name in ("angular_velocity", "joint_rates"):
        if parts[name] is None or not (np.any(parts[name]) or np.any(np.signbit(parts[name]))):
            del parts[name]
    return parts


def _angles(axis: str, attribute: str) -> tuple[Field, Field]:
    """The two keys of a joint's angles."""
    meaning = f"angle of each terminal's {axis} joint"
    radians = Field(f"{axis}_rad", each_terminal(_ANGLE), attribute, meaning, required=True, held="joints")
    degrees = Field(f"{axis}_deg", each_terminal(_ANGLE_DEG), f"{attribute}_deg", meaning, held="joints")
    return radians, replace(degrees, instead_of=attribute)


_ANGLES = (*_angles("yaw", "yaws"), *_angles("pitch", "pitches"))
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
TARGETS = _table(
    Targets,
    split=_without_zero_rates,
    check=check_goal_rates,
    refused=dict.fromkeys(
        _STATE_KEYS, "the goal has targets, from which attitude and joints are found; give either"
    ),
)
GIVEN_GOAL = replace(
    STATE,
    refused=dict.fromkeys(
        ("yaw_limit_deg", "pitch_limit_deg", "clearance_deg"), "only a goal with targets has it"
    ),
)


# A goal that is neither: its keys are read to note their faults.
_UNDECIDED = replace(
    STATE,
    fields=[replace(entry, required=False) for entry in (*TARGETS.fields[:4], *STATE.fields)],
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
        return (STATE if isinstance(value, GivenState) else TARGETS).write(value)


def _make_scenario(parts: dict[str, Any], place: Place) -> tuple[Scenario, Any]:
    """The scenario, and its view of the sky, of which only the epoch is kept."""
    del parts["schema_version"]
    view = parts.pop("sky", None)
    return Scenario(**parts), view


def _split_scenario(scenario: Scenario) -> dict[str, Any]:
    return {"schema_version": SCHEMA_VERSION, **vars(scenario)}


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
