"""The tables ``[start]`` and ``[goal]``: a state, or directions to point at.

The file lists yaws and pitches apart, the model joins them; rates that the file leaves out are zero.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxplan.model.scenario import GivenState, Targets
from jaxplan.scenario.arrays import Each, Quaternion, Vector
from jaxplan.scenario.faults import Place
from jaxplan.scenario.kinds import Interval, Number
from jaxplan.scenario.paths import TargetList
from jaxplan.scenario.tables import Either, Field, Table
from jaxplan.scenario.values import read_array

YAW_LIMIT = Number(Interval("(0, 180]"), degrees=True)  # beyond half a turn an angle would have two values
ANGLE = Number(Interval("[-1e3, 1e3]"))  # rad, or rad/s: any number of turns that a file may mean
ANGLE_DEG = Number(Interval("[-5e4, 5e4]"), degrees=True)
PITCH_LIMIT = Number(Interval("(0, 90)"), degrees=True)  # at a right angle the yaw loses its meaning

_RATES = (
    Field(
        "angular_velocity_rad_s",
        Vector(3, ANGLE),
        "angular_velocity",
        "of the platform, body axes; zero if absent",
    ),
    Field("joint_rates_rad_s", Each(ANGLE, "joint"), "joint_rates", "zero if absent"),
)


_FOLLOWS = "follows from the targets, of which some move; leave it out"


class _RotationVector(Vector):
    """Three numbers, for which Python may have a matrix or a quaternion."""

    def take(self, value: Any, place: Place) -> np.ndarray | None:
        """(3,) rad."""
        wanted = "a rotation vector of 3 numbers, as scipy's Rotation has by as_rotvec()"
        read = read_array(value, wanted, place, (3,))
        return None if read is None else self.of.checked_array(read, place)


def _with_rates(joints: int, parts: Mapping[str, Any]) -> dict[str, Any]:
    return {"angular_velocity": np.zeros(3), "joint_rates": np.zeros(joints), **parts}


def _without_zero_rates(state: GivenState | Targets) -> dict[str, Any]:
    """What the state holds, less the rates that an absent key stands for (minus zero is not)."""
    parts = dict(vars(state))
    for name in ("angular_velocity", "joint_rates"):
        if parts[name] is None or not (np.any(parts[name]) or np.any(np.signbit(parts[name]))):
            del parts[name]
    return parts


def _make_state(
    *, rotation_vector: np.ndarray, yaws: Sequence[float] = (), pitches: Sequence[float] = (), **rates: Any
) -> GivenState:
    joints = np.concatenate([yaws, pitches])
    return GivenState(rotation_vector=rotation_vector, joints=joints, **_with_rates(len(joints), rates))


def _split_state(state: GivenState) -> dict[str, Any]:
    parts = _without_zero_rates(state)
    yaws, pitches = np.split(np.asarray(parts.pop("joints")), 2)
    return parts | ({"yaws": yaws, "pitches": pitches} if len(yaws) else {})


def _make_targets(*, directions: Any, **parts: Any) -> Targets:
    return Targets(directions=directions, **_with_rates(2 * len(directions), parts))


STATE = Table(
    GivenState,
    (
        Field(
            "attitude",
            _RotationVector(3, ANGLE),
            "rotation_vector",
            "rotation vector, rad, body to inertial",
            required=True,
        ),
        Field("quaternion_wxyz", Quaternion(), "rotation_vector", "the same as a quaternion, scalar first"),
        Field(
            "yaw_rad", Each(ANGLE), "yaws", "angle of each terminal's yaw joint", required=True, held="joints"
        ),
        Field("yaw_deg", Each(ANGLE_DEG), "yaws", "the same in degrees", held="joints"),
        Field(
            "pitch_rad",
            Each(ANGLE),
            "pitches",
            "angle of each terminal's pitch joint",
            required=True,
            held="joints",
            half=1,
        ),
        Field("pitch_deg", Each(ANGLE_DEG), "pitches", "the same in degrees", held="joints", half=1),
        *_RATES,
    ),
    make=_make_state,
    split=_split_state,
    whole={"joints": Each(ANGLE, "joint")},
    fill=lambda parts: _with_rates(len(parts["joints"]), parts),
)

_TARGET_FIELDS = (
    Field(
        "targets",
        TargetList(),
        "directions",
        "where each terminal shall point, inertial; one that moves as { direction_samples, times_s }, or the "
        "name of a satellite or body of [sky]",
        required=True,
    ),
    Field("yaw_limit_deg", YAW_LIMIT, "yaw_limit", "tighter than the joints' own, at the goal"),
    Field("pitch_limit_deg", PITCH_LIMIT, "pitch_limit", "likewise"),
)
_STATE_KEYS = [field.key for field in STATE.fields if field not in _RATES]

TARGETS = Table(
    Targets,
    (*_TARGET_FIELDS, *_RATES),
    make=_make_targets,
    split=_without_zero_rates,
    fill=lambda parts: _with_rates(2 * len(parts["directions"]), parts),
    refused=dict.fromkeys(
        _STATE_KEYS, "the goal has targets, from which attitude and joints are found; give either"
    ),
)

GIVEN_GOAL = replace(
    STATE,
    refused={field.key: "only a goal with targets has it" for field in _TARGET_FIELDS[1:]},
)

# A goal that is neither: its keys are read to note their faults.
_UNDECIDED = Table(
    Targets, tuple(replace(field, required=False) for field in (*_TARGET_FIELDS, *STATE.fields))
)


@dataclass(frozen=True)
class Goal(Either):
    """A goal: a table with targets, or one with a state."""

    wanted = "a table with targets, or with attitude, yaw_rad and pitch_rad"

    @property
    def tables(self) -> dict[str, Table]:
        """By what tells them apart."""
        return {"with targets": TARGETS, "as a given state": GIVEN_GOAL}

    def read(self, value: object, place: Place) -> dict[str, Any] | None:
        """What could be read, by attribute; it has ``directions`` only if the goal has targets."""
        if isinstance(value, dict) and not value.keys() & {"targets", *_STATE_KEYS}:
            place.fault(f"must be {self.wanted}")
            return _UNDECIDED.read(value, place)
        if isinstance(value, dict) and "targets" in value:
            read = TARGETS.read(value, place) or {}
            if isinstance(read.get("directions"), tuple):
                for entry in _RATES:
                    if entry.key in value:
                        place.key(entry.key).fault(_FOLLOWS, value[entry.key])
            return read
        return GIVEN_GOAL.read(value, place)

    def take(self, value: Any, place: Place) -> Any:
        """The targets or the state."""
        if isinstance(value, GivenState):
            return STATE.take(value, place)
        if not isinstance(value, Targets):
            place.refuse("must be Targets or a GivenState", value)
            return None
        goal = TARGETS.take(value, place)
        if isinstance(goal, Targets) and goal.moves:
            for entry in _RATES:
                if entry.attribute in _without_zero_rates(goal):
                    place.key(entry.key).fault(_FOLLOWS, getattr(goal, entry.attribute))
        return goal

    def build(self, value: Any) -> Targets | GivenState:
        """The targets or the state."""
        goal: Targets | GivenState = (TARGETS if "directions" in value else STATE).build(value)
        return goal

    def write(self, value: Any) -> dict[str, Any]:
        """Its table."""
        return (STATE if isinstance(value, GivenState) else TARGETS).write(value)
