"""Start and goal in a scenario file: states, targets, and directions that move.

The tables ``[start]`` and ``[goal]``: a state, or directions to point at.

The file lists yaws and pitches apart, the model joins them; rates that the file leaves out are zero.

Directions that move, in a scenario file: samples over times, of a zone's axis or a terminal's target.

A zone has the two keys beside its others. A target has them in a table that stands in the place of its
direction, or is the name of a body or of a satellite of ``[sky]``, which is resolved to such a table.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jaxplan.model.directions import DirectionPath, as_path
from jaxplan.model.scenario import GivenState, Targets
from jaxplan.schema.arrays import Direction, Each, Quaternion, Vector
from jaxplan.schema.faults import Place
from jaxplan.schema.kinds import Interval, Kind, Number, read_array
from jaxplan.schema.tables import Either, Field, Table

_TIME = Number(Interval("[-1e7, 1e7]"))
MOST_SAMPLES = 10_000
_SLOPE_ROUNDING = 1e-3  # rad between two samples, of slopes that were held with fewer digits


def _entries(kind: Kind, wanted: str, value: object, place: Place) -> list[Any] | None:
    """At least two entries of an array, read by one kind; None after noting what is wrong with them."""
    if not isinstance(value, list) or not 2 <= len(value) <= MOST_SAMPLES:
        place.fault(f"must be {wanted}, 2 to {MOST_SAMPLES}", value)
        return None
    before = len(place.faults)
    read = [kind.read(entry, place.item(i)) for i, entry in enumerate(value)]
    return read if len(place.faults) == before else None


@dataclass(frozen=True)
class DirectionSamples(Kind):
    """Unit vectors, one a time."""

    wanted = "an array of unit vectors, one a time"

    def read(self, value: object, place: Place) -> np.ndarray | None:
        """(n, 3)."""
        read = _entries(Direction(), self.wanted, value, place)
        return None if read is None else np.array(read)

    def take(self, value: Any, place: Place) -> DirectionPath | None:
        """The path, of arrays."""
        times = read_array(value.times, "an array of numbers", place.key(TIMES.key), (None,))
        if times is None:
            return None
        vectors = f"an array of {len(times)} vectors of 3 numbers, one a time"
        shape = (len(times), 3)
        samples = read_array(value.samples, vectors, place.key(SAMPLES.key), shape)
        slopes = read_array(value.slopes, vectors, place.key("slopes"), shape)
        if samples is None or slopes is None:
            return None
        if len(times) > MOST_SAMPLES:
            place.key(SAMPLES.key).fault(f"must be {self.wanted}, 2 to {MOST_SAMPLES}", samples)
            return None
        at, seen = place.key(TIMES.key), place.key(SAMPLES.key)
        rising = rising_times(times, at)
        units = [Direction().checked(one, seen.item(i)) for i, one in enumerate(samples)]
        if rising is None or any(unit is None for unit in units):
            return None
        path = _through(rising, np.array(units), seen, samples)
        if path is None:
            return None
        off = (slopes - path.slopes) * np.gradient(times)[:, None]
        wrong = ~np.all(np.abs(off) <= _SLOPE_ROUNDING, axis=1)
        if np.any(wrong):
            i = int(np.argmax(wrong))
            complaint = "must be that of the spline; DirectionPath.through finds it"
            place.key("slopes").item(i).fault(complaint, slopes[i])
            return None
        return path

    def holds(self, value: Any) -> bool:
        """A direction that moves."""
        return isinstance(value, DirectionPath) and value.moves

    def write(self, value: Any) -> list[list[float]]:
        """A list of vectors."""
        return [Direction().write(sample) for sample in value.samples]


@dataclass(frozen=True)
class SampleTimes(Kind):
    """Seconds that rise, from the start of the manoeuvre or before it on."""

    wanted = "an array of rising numbers, the first at most 0"
    range = _TIME.range

    def read(self, value: object, place: Place) -> np.ndarray | None:
        """(n,)."""
        read = _entries(_TIME, self.wanted, value, place)
        return None if read is None else rising_times(np.array(read), place)

    def write(self, value: Any) -> list[float]:
        """A list."""
        return [float(time) for time in value]


def rising_times(times: np.ndarray, place: Place) -> np.ndarray | None:
    """Times of samples, or None after noting what is wrong with them."""
    if _TIME.checked_array(times, place) is None:
        return None
    falls = np.flatnonzero(np.diff(times) <= 0)
    if len(falls):
        at = int(falls[0]) + 1
        place.item(at).fault(f"must be later than the one before, {times[at - 1]:g}", float(times[at]))
    if not times[0] <= 0:
        place.item(0).fault("must be at most 0, where the manoeuvre starts", float(times[0]))
    return None if len(falls) or not times[0] <= 0 else times


def _through(times: np.ndarray, samples: np.ndarray, place: Place, told: object) -> DirectionPath | None:
    """The path through samples, or None after noting at their place that there is none."""
    try:
        return DirectionPath.through(times, samples)
    except ValueError as error:
        place.fault(str(error).removeprefix("samples: "), told)
        return None


SAMPLES = Field(
    "direction_samples",
    DirectionSamples(),
    "direction",
    "unit vectors over times_s, of an axis that moves",
    held="direction.samples",
)
TIMES = Field(
    "times_s",
    SampleTimes(),
    "times",
    "of direction_samples; 0 where the manoeuvre starts",
    held="direction.times",
)
# In the order of a table of their own.
PATH = Table(
    DirectionPath,
    (
        replace(SAMPLES, held="samples", required=True),
        replace(TIMES, held="times", required=True),
    ),
    split=lambda path: {"direction": path, "times": path.times},
)


def join_path(given: Mapping[str, Any], read: dict[str, Any], place: Place) -> None:
    """Make one path of the samples and times of a table, or note why they do not go together.

    Args:
        given: the table of the file.
        read: what could be read of it; its direction becomes the path, and its times are gone.
        place: where it stands.
    """
    times = read.pop("times", None)
    if TIMES.key in given and SAMPLES.key not in given:
        place.key(TIMES.key).fault(f"needs {SAMPLES.key}, whose times they are", given[TIMES.key])
    if SAMPLES.key not in given:
        return
    if TIMES.key not in given:
        place.key(TIMES.key).fault(f"missing, must be {TIMES.kind.wanted}")
    samples = read.get("direction")
    if times is None or not isinstance(samples, np.ndarray):
        return  # noted before
    if samples.shape != (len(times), 3):
        complaint = f"must have as many numbers as {SAMPLES.key}, {len(samples)}, not {len(times)}"
        place.key(TIMES.key).fault(complaint, given[TIMES.key])
        return
    read["direction"] = _through(times, samples, place.key(SAMPLES.key), given[SAMPLES.key])


def split_zone(zone: Any) -> dict[str, Any]:
    """What a zone holds, its times apart from its direction."""
    parts = dict(vars(zone))
    return parts | ({"times": zone.direction.times} if zone.moves else {})


@dataclass(frozen=True)
class Target(Direction):
    """A unit vector; a table of samples and times; or a name of ``[sky]``."""

    def read(self, value: object, place: Place) -> Any:
        """(3,), the path, or the name as it stands."""
        if isinstance(value, str):
            return value
        if not isinstance(value, dict):
            return super().read(value, place)
        before = len(place.faults)
        read = PATH.read(value, place) or {}
        if len(place.faults) == before:
            join_path(value, read, place)
        return read["direction"] if len(place.faults) == before else None

    def take(self, value: Any, place: Place) -> Any:
        """(3,), or the path."""
        kind = SAMPLES.kind if SAMPLES.kind.holds(value) else Direction()
        return kind.take(value, place)

    def write(self, value: Any) -> Any:
        """A list, or a table."""
        return PATH.write(value) if SAMPLES.kind.holds(value) else super().write(value)


@dataclass(frozen=True)
class TargetList(Each):
    """A target for each terminal."""

    of: Kind = field(default_factory=Target)

    def read(self, value: object, place: Place) -> Any:
        """(n, 3) where none moves, else a tuple of what each is."""
        read = self.entries(value, place)
        if read is None or any(isinstance(one, str | DirectionPath) for one in read):
            return None if read is None else tuple(read)
        return np.array(read).reshape(len(read), 3)

    def take(self, value: Any, place: Place) -> Any:
        """(n, 3) where none moves, else a tuple of what each is."""
        if not (isinstance(value, list | tuple) and any(map(SAMPLES.kind.holds, value))):
            still = isinstance(value, list | tuple) and any(isinstance(one, DirectionPath) for one in value)
            return super().take([as_path(one).samples[0] for one in value] if still else value, place)
        before, count = len(place.faults), self.count(place)
        if count not in (None, len(value)):
            place.refuse(f"must be {count} {self.wanted}, not {len(value)}", value)
        read = tuple(self.of.take(one, place.item(i)) for i, one in enumerate(value))
        return read if len(place.faults) == before else None


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
