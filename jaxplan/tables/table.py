"""A table of attitudes, and perhaps of joints, as other tools have it, and what it tells about a scene.

Times are seconds from the table's epoch, quaternions have the scalar first and map body to inertial
coordinates, angular velocities are in body axes, and joints are in rad and have names. How the spacecraft
moves between two rows depends on the program that reads the table (`jaxplan.tables.interpolation`). A table
tells all about a scene or, if it has no joints, about the platform and what is fixed to it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxplan.geometry import quaternion
from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.arguments import floats, show
from jaxplan.runtime.display import shown

SLERP, LINEAR, RODRIGUES = "slerp", "quaternion_linear", "mrp_linear"
RATE, HERMITE = "constant_rate", "hermite"
INTERPOLATIONS = (SLERP, LINEAR, RODRIGUES, RATE, HERMITE)
"""What readers make of two neighbouring rows, see `jaxplan.tables.interpolation`."""

_LENGTH_TOLERANCE = 1e-4  # by how much the length of a quaternion may differ from one, since files round
_LARGEST_TURN = np.deg2rad(179.0)  # rad: turn between two rows, above which readers may turn either way round


def column_name(name: str) -> str:
    """Return the name of a joint or wheel as a column's heading, with underscores for blanks."""
    return name.replace(" ", "_")


@shown("name", "epoch", "interpolation", "joint_names")
@dataclass(frozen=True, kw_only=True, eq=False)
class AttitudeTable:
    """Attitudes at k instants, and J joints where the table has them.

    Quaternions are scaled to unit length when the table is made, and get the sign nearer to the row before.

    Attributes:
        times: (k,) s from the epoch, rising; two at least.
        quaternions: (k, 4) body to inertial, scalar first.
        angular_velocity: (k, 3) rad/s in body axes; None where the table has none.
        joints: (k, J) rad; None where it has none.
        joint_rates: (k, J) rad/s; None where it has none.
        joint_names: names of the J joints, such as "terminal-1_yaw".
        spacecraft: the one whose joints these are, in its order; None where they are in the order of a file.
        epoch: UTC of time zero; None where that is the start of whatever the table is compared with.
        interpolation: what readers of the table's format do between rows, one of `INTERPOLATIONS`.
        alternative: what some of these readers do instead, another of them; None where all do the same.
        name: name of the table in messages, such as that of its file.
    """

    times: np.ndarray
    quaternions: np.ndarray
    angular_velocity: np.ndarray | None = None
    joints: np.ndarray | None = None
    joint_rates: np.ndarray | None = None
    joint_names: tuple[str, ...] = ()
    spacecraft: Spacecraft | None = None
    epoch: np.datetime64 | None = None
    interpolation: str = SLERP
    alternative: str | None = None
    name: str = "table"

    def __post_init__(self) -> None:
        for name in ("times", "quaternions", "angular_velocity", "joints", "joint_rates"):
            given = getattr(self, name)
            if given is not None:
                object.__setattr__(self, name, np.asarray(given, np.float64))
        faults = list(_table_faults(self))
        if faults:
            told = "\n  ".join([f"{len(faults)} faults:", *faults]) if len(faults) > 1 else faults[0]
            raise ValueError(f"{self.name}: {told}")
        length = np.linalg.norm(self.quaternions, axis=1, keepdims=True)
        flips = np.where(np.sum(self.quaternions[1:] * self.quaternions[:-1], axis=1) < 0, -1.0, 1.0)
        signs = np.concatenate([np.ones(1), np.cumprod(flips)])
        object.__setattr__(self, "quaternions", self.quaternions / length * signs[:, None])
        turns = self.turns
        if not np.all(turns <= _LARGEST_TURN):
            row = int(np.argmax(turns))
            begin, end = self.times[row : row + 2]
            raise ValueError(
                f"{self.name}: rows {row} and {row + 1}, of {begin:g} and {end:g} s, are "
                f"{np.rad2deg(turns[row]):.1f} deg apart, and readers may take either way round: must be "
                f"at most {np.rad2deg(_LARGEST_TURN):g} deg"
            )

    @property
    def duration(self) -> float:
        """Time from the first row to the last, s."""
        return float(self.times[-1] - self.times[0])

    @property
    def attitudes(self) -> np.ndarray:
        """(k, 3, 3) rotation matrices, body to inertial."""
        return np.asarray(quaternion.to_matrix(self.quaternions))

    @property
    def turns(self) -> np.ndarray:
        """(k - 1,) rad, angles from row to row, the shorter way."""
        return np.asarray(quaternion.distance(self.quaternions[:-1], self.quaternions[1:]))

    @property
    def numbers(self) -> int:
        """How many numbers the table holds in all its columns, times included."""
        columns = (self.quaternions, self.angular_velocity, self.joints, self.joint_rates)
        return len(self.times) * (1 + sum(c.shape[1] for c in columns if c is not None))

    def state(self, row: int, joints: Sequence[float] | None = None) -> GivenState:
        """Return a row as the start or the goal of a scenario.

        Args:
            row: its index, negative ones from the end.
            joints: (J,) rad, for a table without joints; None only for a spacecraft without joints, or for a
                table that has them.

        Raises:
            ValueError: if there is no such row; if joints are no numbers, or are given and the table has its
                own; or if it has several and was read without the spacecraft, so that their order is not
                known.
        """
        given: object = row  # whatever its type says
        whole = isinstance(given, int | np.integer) and not isinstance(given, bool)
        if not (whole and -len(self.times) <= row < len(self.times)):
            span = f"[{-len(self.times)}, {len(self.times) - 1}]"
            raise ValueError(f"row = {show(row)}: must be a whole number in {span}")
        if self.joints is not None and joints is not None:
            raise ValueError(f"joints: {self.name} has joints of its own")
        if len(self.joint_names) > 1 and self.spacecraft is None:
            raise ValueError(
                f"{self.name}: has the joints {', '.join(self.joint_names)} in an order of its own: read it "
                "with the spacecraft, as by jp.load_attitude(path, scenario.spacecraft)"
            )
        q = self.quaternions[row]
        own = np.zeros(0) if joints is None else floats("joints", joints, "a vector of angles in rad")
        return GivenState(
            rotation_vector=np.asarray(quaternion.log(-q if q[0] < 0 else q)),
            joints=own if self.joints is None else self.joints[row],
        )

    def of(self, craft: Spacecraft) -> "AttitudeTable":
        """Return the table with joints, found by name, in the order of a spacecraft; unchanged without any.

        Raises:
            ValueError: if it has no column for one of the spacecraft's joints.
        """
        if self.joints is None:
            return self
        own = {column_name(name): number for number, name in enumerate(self.joint_names)}
        asked = [column_name(name) for name in craft.joint_names]
        there = ", ".join(self.joint_names)
        for name, known in zip(craft.joint_names, asked, strict=True):
            if known not in own:
                raise ValueError(f"{self.name}: has no column of {name}, only of {there}")
        order = [own[known] for known in asked]
        return replace(
            self,
            joints=self.joints[:, order],
            joint_rates=None if self.joint_rates is None else self.joint_rates[:, order],
            joint_names=craft.joint_names,
            spacecraft=craft,
        )


def _table_faults(table: AttitudeTable) -> Iterator[str]:
    """Yield a sentence for each fault of a table's shapes, names, numbers, times or quaternions."""
    if table.interpolation not in INTERPOLATIONS:
        yield f"interpolation = {table.interpolation!r}: must be one of {', '.join(INTERPOLATIONS)}"
    if table.alternative not in (None, *INTERPOLATIONS):
        yield f"alternative = {table.alternative!r}: must be None or one of {', '.join(INTERPOLATIONS)}"
    rows, joints = len(np.atleast_1d(table.times)), len(table.joint_names)
    if table.times.ndim != 1:
        yield f"times has the shape {table.times.shape}: must be (k,), a time for each row"
        return
    if rows < 2:
        told = "1 row" if rows else "no rows"
        yield f"has {told}: must have two or more; repeat an attitude that is held in a later row"
        return
    shapes = {"quaternions": 4, "angular_velocity": 3, "joints": joints, "joint_rates": joints}
    given = {name: getattr(table, name) for name in shapes if getattr(table, name) is not None}
    for name, array in given.items():
        if array.shape != (rows, shapes[name]):
            yield f"{name} has the shape {array.shape}: must be {(rows, shapes[name])}"
        else:
            finite = np.isfinite(array).all(axis=1)
            if not np.all(finite):
                row = int(np.argmin(finite))
                yield f"{name} is not finite in row {row}, at {table.times[row]:g} s"
    if table.joint_rates is not None and table.joints is None:
        yield "joint_rates: there are no joints that they are of"
    if not np.all(np.isfinite(table.times)):
        yield f"times: not finite in row {int(np.argmin(np.isfinite(table.times)))}"
    elif not np.all(np.diff(table.times) > 0):
        row = int(np.argmin(np.diff(table.times) > 0))
        later, before = table.times[row + 1], table.times[row]
        yield f"times: must rise, and row {row + 1} is at {later:g} s after {before:g} s"
    if table.quaternions.shape == (rows, 4):
        length = np.linalg.norm(table.quaternions, axis=1)
        if not np.all(np.abs(length - 1) <= _LENGTH_TOLERANCE):
            row = int(np.argmax(np.where(np.isfinite(length), np.abs(length - 1), np.inf)))
            at = f"row {row}, at {table.times[row]:g} s"
            yield f"quaternions: {at}, has the length {length[row]:.6g}: must be 1"


def as_known(table: AttitudeTable, scene: Scenario) -> tuple[AttitudeTable, Scenario, list[str]]:
    """Reduce a scene to what a table tells about, and put the table's joints in the scene's order.

    Args:
        table: as it was read.
        scene: the scene that the table is compared with.

    Returns:
        The table, the scene, and a sentence for each thing that the table does not tell about.

    Raises:
        ValueError: if the table has some of the scene's joints and not the others.
    """
    names = scene.spacecraft.joint_names
    if table.joints is not None and names:
        return table.of(scene.spacecraft), scene, []
    bare = replace(table, joints=None, joint_rates=None, joint_names=(), spacecraft=None)
    if not names:
        return bare, scene, []
    craft = scene.spacecraft
    moving = craft.device_names[: craft.gimbals.count]
    rest = replace(craft, terminals=(), drives=())
    left, dropped = _restrict_zones(scene, rest)
    found = [f"{', '.join(moving)}: the table has no joints, so what they point at is not known"]
    if dropped:
        found.append(f"zones of these devices alone: {', '.join(dropped)}")
    no_joints = replace(scene.start, joints=np.zeros(0), joint_rates=np.zeros(0))
    return bare, replace(left, spacecraft=rest, start=no_joints, goal=no_joints), found


def _restrict_zones(scene: Scenario, rest: Spacecraft) -> tuple[Scenario, list[str]]:
    """Return a scene whose zones bind only what the spacecraft `rest` has, and names of zones dropped.

    A whole group of zones is dropped where one of its zones binds a device that `rest` does not have.
    """
    known, gone = set(rest.device_names), set[str]()
    every: tuple[Any, ...] = (*scene.keep_out, *scene.keep_in, *scene.joint_bounds)
    kept: dict[str, list[Any]] = {"keep_out": [], "keep_in": []}
    unsure = {zone.any_of for zone in every if zone.any_of is not None and not _binds_only(zone, known)}
    for kind, zones in kept.items():
        for zone in getattr(scene, kind):
            names = tuple(name for name in zone.devices if name in known)
            vectors = tuple(vector for vector in zone.vectors if vector.to is None)
            fixed = zone.axis_device is None or zone.axis_device in known
            bound = (zone.binds_all and known) or names or vectors
            if not fixed or not bound or zone.any_of in unsure - {None}:
                gone.add(zone.name)
            else:
                zones.append(replace(zone, devices=names, vectors=vectors))
    gone |= {zone.name for zone in scene.joint_bounds}
    changed = replace(
        scene, keep_out=tuple(kept["keep_out"]), keep_in=tuple(kept["keep_in"]), joint_bounds=()
    )
    return changed, [zone.name for zone in every if zone.name in gone]


def _binds_only(zone: Any, known: set[str]) -> bool:
    """Tell whether a zone of a group binds only devices named in `known`, and axes of the body."""
    devices = getattr(zone, "devices", None)
    if devices is None:  # a bound of joints
        return False
    axis = getattr(zone, "axis_device", None)
    vectors = getattr(zone, "vectors", ())
    return (
        not getattr(zone, "binds_all", False)
        and set(devices) <= known
        and (axis is None or axis in known)
        and all(vector.to is None for vector in vectors)
    )
