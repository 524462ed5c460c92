"""Start and goal in a file: a state, or devices with what they point at.

Files have angles of joints as arrays of yaws, pitches and drives, in radians or degrees, or by names of
devices; and an attitude as a rotation vector or a quaternion. A goal is a state, or targets for which
planning step 1 finds one. The same is true of a start: its targets are those of the instant when the
manoeuvre begins.

A state may be given in the local orbital frame: z to nadir, y against the orbit's normal, x = y x z. A
scenario holds inertial attitudes, so it is converted when the file is read, for the instant of the state: the
start, or the end of a manoeuvre whose duration is given.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxplan import sky, so3
from jaxplan.model.goals import GivenState, Targets, Wish
from jaxplan.runtime.display import shown
from jaxplan.schema.arrays import QUATERNION, Array, each_drive, each_terminal
from jaxplan.schema.checks import check_targets, placed
from jaxplan.schema.faults import WRONG, Place, Reading, is_wrong, nearest
from jaxplan.schema.model_tables import ANGLE, ANGLE_DEG, KINDS, declared
from jaxplan.schema.sky import View
from jaxplan.schema.tables import Either, Field, Table
from jaxplan.schema.value_kinds import Choice, Kind

INERTIAL, LOCAL = "inertial", "local"
_JOINT_PARTS = ("yaws", "pitches", "drives")
# s to either side, over which the frame's turn is differenced; off by 1e-10 rad/s at most.
_DIFFERENCE_STEP = 0.5


@shown("rotation_vector deg", "joints deg", "angular_velocity deg/s", "joint_rates deg/s")
@dataclass(frozen=True, kw_only=True, eq=False)
class LocalState(GivenState):
    """A state whose attitude is relative to the observer's orbit, until it is converted to an inertial one.

    Its rotation vector takes body axes to the local orbital frame (`jaxplan.sky.local_axes`), and its angular
    velocity, in body axes, is relative to this frame: zero if the platform turns with it.
    """


def make_state(parts: dict[str, Any], place: Place) -> GivenState:
    """Make a state from what was read, by attribute, noting faults.

    Args:
        parts: values by attribute; angles of joints are given by yaws, pitches and drives, or by names of
            devices. Changed in place.
        place: place of the state.

    Returns:
        A `GivenState`, or a `LocalState` if its frame is the local one; an attribute with faults is `WRONG`.
    """
    model = LocalState if parts.pop("frame", INERTIAL) == LOCAL else GivenState
    by_name = parts.pop("joints_by_name", None)
    found = {of: parts.pop(f"{of}_deg", parts.pop(of, None)) for of in _JOINT_PARTS}
    given = [own for own in found.values() if own is not None]
    reading = place.reading
    if by_name is not None:
        if given:
            place["joints_deg"].fault("stands in the place of the arrays of angles, give either")
        joints = _joints_by_name(by_name, reading)
    else:
        terminals, drives = (reading.sizes.get(noun) for noun in ("terminal", "drive"))
        for of, key in (("yaws", "yaw_rad"), ("pitches", "pitch_rad")):
            if found[of] is None and terminals:
                given.append(
                    place[key].fault(_missing_message(key, reading.names.get("terminal"), terminals))
                )
        if found["drives"] is None and drives:
            given.append(WRONG if reading.ranges is None else np.clip(0.0, *reading.ranges[-drives:].T))
        joints = WRONG if any(own is WRONG for own in given) else np.concatenate([np.zeros(0), *given])
    turned = parts.pop("quaternion", None)
    return model(**parts | {"joints": joints} | ({} if turned is None else {"rotation_vector": turned}))


def _missing_message(key: str, names: Sequence[str] | None, count: int) -> str:
    """Return text on missing angles of terminals: what must be given, and which keys may stand for it.

    Args:
        key: key of the angles in radians.
        names: names of the terminals; None if they are not known.
        count: number of terminals.
    """
    by_name = f"joints_deg, such as {{ {names[0]} = [0.0, 0.0] }}" if names else "joints_deg"
    return f"missing (or {key.replace('rad', 'deg')}, or {by_name}), must be {_describe_array(count)}"


def _describe_array(count: int) -> str:
    """Return what an array with one number for each terminal must be, for messages."""
    return f"an array of {count} number{'s' * (count > 1)}, one a terminal"


def _joints_by_name(by_name: Any, reading: Reading) -> Any:
    """Return joint angles (number of joints,) rad from those given by names of devices; `WRONG` after faults.

    Joints of other devices are zero, or at the nearest angle in their range.
    """
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
class StateOf:
    """A state that is to be written, with the spacecraft's number of terminals."""

    state: GivenState
    terminals: int


def split_state(given: StateOf) -> dict[str, Any]:
    """Return the values of a state's keys in a file, by attribute; its joints as yaws, pitches and drives."""
    parts = _without_zero_rates(given.state)
    ends = [given.terminals, 2 * given.terminals]
    own = zip(_JOINT_PARTS, np.split(np.asarray(parts.pop("joints")), ends), strict=True)
    return parts | {of: angles for of, angles in own if len(angles)}


class JointsByName(Kind):
    """Angles of devices by name, in degrees: yaw and pitch of a terminal, one angle of a drive."""

    wanted = "a table from names of devices to arrays of their angles: yaw and pitch, or a drive's one"

    @property
    def range(self) -> str | None:
        return ANGLE_DEG.range

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
                found[name] = Array((count,), ANGLE_DEG, noun=f"{count} {noun}").read(angles, place[name])
        return WRONG if any(own is WRONG for own in found.values()) else found


def _without_zero_rates(state: GivenState | Targets) -> dict[str, Any]:
    """Return attributes of a state or targets without rates of zero, since that is what an absent key means.

    Rates of minus zero are kept.
    """
    parts = dict(vars(state))
    for name in ("angular_velocity", "joint_rates"):
        if parts[name] is None or not (np.any(parts[name]) or np.any(np.signbit(parts[name]))):
            del parts[name]
    return parts


def _angle_fields(axis: str, attribute: str) -> tuple[Field, Field]:
    """Return the keys, in rad and in deg, of the angles of one sort of joints: "yaw", "pitch" or "drive"."""
    meaning = f"angle of each terminal's {axis} joint"
    if axis == "drive":
        meaning = "angle of each drive; if absent zero, or the nearest in range"
    each = each_drive if axis == "drive" else each_terminal
    radians = Field(f"{axis}_rad", each(ANGLE), attribute, meaning, held="joints")
    degrees = Field(f"{axis}_deg", each(ANGLE_DEG), f"{attribute}_deg", meaning, held="joints")
    return radians, replace(degrees, instead_of=attribute)


_JOINTS_BY_NAME_FIELD = Field(
    "joints_deg",
    JointsByName(),
    "joints_by_name",
    "angles by names of devices, in place of the arrays; of others zero, or the nearest in range",
    held="joints",
)
_ANGLE_FIELDS = (
    *_angle_fields("yaw", "yaws"),
    *_angle_fields("pitch", "pitches"),
    *_angle_fields("drive", "drives"),
    _JOINTS_BY_NAME_FIELD,
)
_QUATERNION_FIELD = Field(
    "quaternion_wxyz",
    QUATERNION,
    "quaternion",
    "the attitude as a quaternion, scalar first",
    instead_of="rotation_vector",
)
_FRAME_FIELD = Field(
    "frame",
    Choice((INERTIAL, LOCAL)),
    "frame",
    "from which attitude and angular velocity count: with [sky] the local orbital frame, too, as it is then",
)
STATE = declared(
    GivenState,
    before={"angular_velocity_rad_s": (_QUATERNION_FIELD, _FRAME_FIELD, *_ANGLE_FIELDS)},
    make=make_state,
    split=split_state,
)
STATE_KEYS = ["attitude", *(entry.key for entry in (_QUATERNION_FIELD, _FRAME_FIELD, *_ANGLE_FIELDS))]
WISH = declared(Wish)


@shown("devices", "directions", "prefer", "joints deg")
@dataclass(frozen=True, kw_only=True, eq=False)
class Pointing(Targets):
    """A start that is given by what devices point at, until its state is found.

    Attributes:
        joints: (2n + d,) rad, angles for devices without a target; None for those nearest to zero.
    """

    joints: Any = None


def _make_pointing(parts: dict[str, Any], place: Place) -> Pointing:
    """Make a start with targets from what was read, by attribute.

    A device whose angles are given, and which has neither target nor wish, is held at these.
    """
    by_name = parts.pop("joints_by_name", None)
    joints = None if by_name is None else _joints_by_name(by_name, place.reading)
    targets = make_targets(parts, place)
    if isinstance(by_name, dict) and joints is not WRONG:
        asked = targets.devices or place.reading.names["terminal"] or ()
        wished = [wish.device for _, wish in placed(targets.prefer, place["prefer"])]
        told = tuple(name for name in by_name if name not in (*asked, *wished))
        targets = replace(targets, hold=told)
    return Pointing(**vars(targets) | {"joints": joints})


def make_targets(parts: dict[str, Any], place: Place) -> Targets:
    """Make targets from what was read, by attribute; a file may give them by names of devices."""
    if isinstance(parts.get("directions"), tuple) and len(parts["directions"]) == 2:
        names, directions = parts["directions"]
        if isinstance(names, tuple) and all(isinstance(name, str) for name in names):
            parts |= {"devices": names, "directions": directions}
    return Targets(**parts)


def _split_targets(targets: Targets) -> dict[str, Any]:
    """Return the values of the keys of targets in a file, by attribute."""
    parts = _without_zero_rates(targets)
    if targets.devices:
        parts["directions"] = dict(zip(targets.devices, targets.directions, strict=True))
    return parts


TARGETS = declared(
    Targets,
    make=make_targets,
    split=_split_targets,
    check=check_targets,
    refused=dict.fromkeys(
        STATE_KEYS, "the goal has targets, from which attitude and joints are found; give either"
    ),
)
POINTING = replace(
    TARGETS,
    fields=[
        *(entry for entry in TARGETS.fields if entry.attribute in ("directions", "prefer")),
        replace(
            _JOINTS_BY_NAME_FIELD,
            meaning="of devices without a target or a wish; of others zero, or the nearest in range",
        ),
    ],
    make=_make_pointing,
    refused=dict.fromkeys(
        (key for key in STATE_KEYS if key != "joints_deg"),
        "the start has targets, from which attitude and joints are found; give either",
    ),
)
GIVEN_GOAL = replace(
    STATE,
    refused=dict.fromkeys(
        (
            "yaw_limit_deg",
            "pitch_limit_deg",
            "prefer",
            "hold",
            "criterion",
            "tolerance_deg",
            "clearance_deg",
        ),
        "only a goal with targets has it",
    ),
)


# A goal that is neither: its keys are read to note their faults.
_UNDECIDED_GOAL = replace(
    STATE,
    fields=[
        replace(entry, required=False)
        for entry in (*TARGETS.fields, *STATE.fields)
        if entry.attribute not in ("angular_velocity", "joint_rates") or entry in STATE.fields
    ],
    make=lambda parts, place: WRONG,
)


class Goal(Either):
    """The kind of a goal in a file: a table with targets, or one with a state."""

    wanted = "a table with targets, or with attitude, yaw_rad and pitch_rad"

    @property
    def tables(self) -> dict[str, Table]:
        return {"with targets": TARGETS, "as a given state": GIVEN_GOAL}

    def read(self, value: Any, place: Place) -> Any:
        if place.reading.python:
            if isinstance(value, GivenState | Targets):
                return (STATE if isinstance(value, GivenState) else TARGETS).read(value, place)
            return place.refuse("must be Targets or a GivenState", value)
        if isinstance(value, dict) and not value.keys() & {"targets", *STATE_KEYS}:
            alone = "; a wish comes after targets: what it is alone is a target" * ("prefer" in value)
            place.fault(f"must be {self.wanted}{alone}")
            return _UNDECIDED_GOAL.read(value, place)
        return (TARGETS if isinstance(value, dict) and "targets" in value else GIVEN_GOAL).read(value, place)

    def write(self, value: Any) -> dict[str, Any]:
        return (STATE if isinstance(value, StateOf) else TARGETS).write(value)


class Start(Either):
    """The kind of a start in a file: a table with a state, or one with targets."""

    wanted = "a table with attitude and joints, or with targets"

    @property
    def tables(self) -> dict[str, Table]:
        return {"as a given state": STATE, "by what devices point at": POINTING}

    def read(self, value: Any, place: Place) -> Any:
        pointing = not place.reading.python and isinstance(value, dict) and "targets" in value
        return (POINTING if pointing else STATE).read(value, place)

    def write(self, value: Any) -> dict[str, Any]:
        return STATE.write(value)


KINDS |= {"goal": Goal(), "start": Start()}


def in_inertial(state: Any, view: Any, time: float | None, place: Place) -> Any:
    """Convert a state in the local orbital frame to an inertial one.

    Args:
        state: start or goal, as it was read; anything that is no `LocalState` is returned as it is.
        view: the table ``[sky]``, as it was read; None if the file has none.
        time: s from the epoch, when the state holds; None if it is not known.
        place: place of the state.

    Returns:
        A `GivenState`, or `WRONG` if there is none; why that is was noted.
    """
    if not isinstance(state, LocalState):
        return state
    here = place["frame"]
    if view is None:
        return here.fault("needs [sky], with epoch_utc and observer", LOCAL)
    if time is None:
        complaint = (
            "needs trajectory.duration_s to be a number, since the frame turns; else give targets, such as "
            'camera = "nadir", with a wish for "ram"'
        )
        return here.fault(complaint, LOCAL)
    if not isinstance(view, View) or is_wrong(view) or is_wrong(state):
        return WRONG  # noted before
    parts = dict(vars(state))
    times = time + _DIFFERENCE_STEP * np.array([-1.0, 0.0, 1.0])
    try:
        before, then, after = np.swapaxes(
            sky.local_axes(view.observer, epoch=view.epoch, times=times), -1, -2
        )
    except (ValueError, ImportError) as error:
        return here.fault(str(error), LOCAL)
    attitude = then @ so3.exp(parts["rotation_vector"])
    turning = so3.log(after @ before.T) / (2 * _DIFFERENCE_STEP)  # of the frame, inertial axes
    spin = parts["angular_velocity"] + attitude.T @ turning
    return GivenState(**parts | {"rotation_vector": so3.log(attitude), "angular_velocity": spin})
