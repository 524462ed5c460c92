"""What a manoeuvre begins or ends with: a given state, or targets and wishes of devices.

A *target* is an inertial direction along which a device must point at the goal. A *wish* is one that a device
without a target shall come near to. Frozen dataclasses, in radians and seconds, as all of a scenario
(`jaxplan.model.scenario`). Joint vectors ``(2n + d,)`` hold the yaws of the n terminals, their pitches, and
the angles of the d drives.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, array_module
from jaxplan.model.directions import DirectionPath, as_path
from jaxplan.model.file_keys import key, keyed
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.arguments import as_floats, show
from jaxplan.runtime.compute_once import made_once
from jaxplan.runtime.display import shown

LEAST_TIME, LEAST_ROTATION = "least_time", "least_rotation"
CRITERIA = (LEAST_TIME, LEAST_ROTATION)

# Value of rates that are left out. Planning puts zeros there, since only then is the number of joints known.
_AT_REST: Any = None
_SPIN_KEY = key(
    "angular_velocity_rad_s", "of the platform, body axes; zero if absent", kind="angular velocity"
)
_JOINT_RATES_KEY = key("joint_rates_rad_s", "zero if absent", kind="joint rates")


@shown("rotation_vector deg", "joints deg", "angular_velocity deg/s", "joint_rates deg/s")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class GivenState:
    """An attitude with joint angles and rates: the start, or a goal that is given as a state.

    Attributes:
        rotation_vector: (3,) rad, rotation from body to inertial axes; its exponential is the attitude.
        joints: (2n + d,) rad: all yaws, all pitches, all drives' angles.
        angular_velocity: (3,) rad/s of the platform, body axes; zero if left out.
        joint_rates: (2n + d,) rad/s; zero if left out.
    """

    rotation_vector: np.ndarray = field(
        metadata=key("attitude", "rotation vector, rad, body to inertial", kind="rotation vector")
    )
    joints: np.ndarray = field(metadata=key("", kind="joints"))
    angular_velocity: np.ndarray = field(default=_AT_REST, metadata=_SPIN_KEY)
    joint_rates: np.ndarray = field(default=_AT_REST, metadata=_JOINT_RATES_KEY)

    paths: ClassVar[tuple[DirectionPath, ...]] = ()  # like `Targets.paths`: it has no targets that move
    moves: ClassVar[bool] = False

    @property
    @made_once
    def attitude(self) -> np.ndarray:
        """Rotation matrix (3, 3) from body to inertial axes."""
        attitude: np.ndarray = so3.exp(self.rotation_vector)
        return attitude


@shown("device", "direction")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Wish:
    """A direction that a device without a target shall come near to at the goal.

    Attributes:
        device: name of the device.
        direction: (3,) inertial unit vector, or the path of one that moves, which is taken at the time of the
            goal.
    """

    device: str = field(metadata=key("device", "without a target", kind="device", static=True))
    direction: np.ndarray | DirectionPath = field(
        metadata=key("direction", "that it shall come near to, inertial", kind="aim")
    )


@shown(
    "directions",
    "devices",
    "prefer",
    "hold",
    "criterion",
    "yaw_limit deg",
    "pitch_limit deg",
    "tolerance deg",
    "clearance deg",
    "angular_velocity deg/s",
    "joint_rates deg/s",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Targets:
    """A goal that is given as directions to point at; planning step 1 finds an attitude and joints for it.

    Attributes:
        directions: (k, 3) inertial unit vectors, one for each device. If some of them move, a tuple that
            holds a vector (3,) or a path for each device; they are met where they are at the end of the
            manoeuvre, and followed at their rates then.
        devices: names of the k devices that point along them; empty for all terminals in their order.
        prefer: wishes of devices without a target, the most important first. Of all goals that meet the
            targets the one is taken that comes nearest to the wishes.
        hold: names of devices without a target that keep their joint angles. Others without a target move
            only where a zone asks for it.
        criterion: which of the attitudes is taken that meet targets and wishes: for `LEAST_ROTATION`
            ("least_rotation") the one nearest to the start; for `LEAST_TIME` ("least_time") the one for which
            the slowest of platform and joints takes the least time from rest to rest. None for the least time
            where the duration is `MINIMUM` and nothing moves, else for the least rotation.
        yaw_limit: the yaws at the goal stay in [-yaw_limit, yaw_limit], rad; None for the joints' own ranges.
        pitch_limit: the same for the pitches.
        tolerance: rad, to which instruments and drives meet their targets; terminals meet theirs exactly.
        clearance: rad, margin that the goal keeps to zones where the choice of the attitude allows it. From a
            zone at most half of the room that it leaves is asked, and no more than the margin of those
            directions that the targets themselves fix.
        angular_velocity: (3,) rad/s of the platform at the goal, body axes; zero if left out. It must be left
            out if some targets move.
        joint_rates: (2n + d,) rad/s at the goal; zero if left out, as it must be if some targets move.
    """

    devices: tuple[str, ...] = field(default=(), metadata=key("", kind="target devices", static=True))
    directions: Any = field(
        metadata=key(
            "targets",
            "where devices point, inertial: an array of one a terminal, or a table by names of devices; "
            "one that moves as { direction_samples, times_s }, or "
            "a name: of a satellite or ground point of [sky], a body, nadir, zenith, ram, orbit_normal",
            kind="targets",
        )
    )
    prefer: tuple[Wish, ...] = keyed((), "prefer", "what devices without a target shall come near to")
    hold: tuple[str, ...] = keyed(
        (), "hold", "devices without a target that keep their joints", kind="devices", static=True
    )
    criterion: str | None = keyed(
        None,
        "criterion",
        "what is least among goals that meet all targets; "
        'if absent time where trajectory.duration_s is "minimum", or too short otherwise, else rotation',
        options=CRITERIA,
        static=True,
    )
    yaw_limit: float | None = keyed(
        None, "yaw_limit_deg", "tighter than the joints' own, at the goal", "(0, 180]"
    )
    pitch_limit: float | None = keyed(
        None, "pitch_limit_deg", "tighter than the joints' own, at the goal", "(0, 90)"
    )
    tolerance: float = keyed(
        math.radians(1e-6), "tolerance_deg", "to which instruments and drives meet targets", "[1e-8, 1]"
    )
    clearance: float = keyed(0.0, "clearance_deg", "that the goal keeps from the edges of zones", "[0, 45]")
    angular_velocity: np.ndarray = field(default=_AT_REST, metadata=_SPIN_KEY)
    joint_rates: np.ndarray = field(default=_AT_REST, metadata=_JOINT_RATES_KEY)

    @classmethod
    def of(cls, targets: Mapping[str, Any], **more: Any) -> Self:
        """Make the targets from a mapping of device names to directions.

        Args:
            targets: for each device name an inertial unit vector (3,), or its path.
            more: other attributes of `Targets`, by name.

        Raises:
            ValueError: if a target is neither three numbers nor a path.

        Example:
            >>> jp.Targets.of({"telescope": [1.0, 0.0, 0.0]}, hold=("antenna",))
        """
        for name, direction in targets.items():
            numbers = None if isinstance(direction, DirectionPath) else as_floats(direction)
            if not isinstance(direction, DirectionPath) and (numbers is None or numbers.shape != (3,)):
                wanted = "a unit vector of 3 numbers or a path, such as jaxplan.sky.target makes of a name"
                raise ValueError(f"targets[{name!r}] = {show(direction)}: must be {wanted}")
        each = tuple(targets.values())
        moving = any(isinstance(direction, DirectionPath) for direction in each)
        return cls(
            directions=each if moving else np.array(each, float).reshape(-1, 3),
            devices=tuple(targets),
            **more,
        )

    def names(self, craft: Spacecraft) -> tuple[str, ...]:
        """Return the names of the devices that have the targets, in the order of `directions`."""
        return self.devices or tuple(terminal.name for terminal in craft.terminals)

    def numbers(self, craft: Spacecraft) -> tuple[int, ...]:
        """Return the numbers of the devices that have the targets, as places in `Spacecraft.device_names`."""
        return tuple(craft.device_names.index(name) for name in self.names(craft))

    @property
    def paths(self) -> tuple[DirectionPath, ...]:
        """The targets' directions over time, one path for each device.

        A fixed direction becomes a path that stands still.
        """
        return tuple(as_path(direction) for direction in self.directions)

    @property
    def moves(self) -> bool:
        """Whether the direction of a target or a wish changes with time."""
        each = list(self.directions) if isinstance(self.directions, list | tuple) else []
        each += [wish.direction for wish in self.prefer]
        return any(isinstance(direction, DirectionPath) and direction.moves for direction in each)

    def at(self, time: ArrayLike) -> Self:
        """Return the targets as they are at a time, s, all of them as directions that stand still.

        Targets that do not move are returned as they are.
        """
        if not self.moves:
            return self
        each = [path.at(time) for path in self.paths]
        wishes = tuple(replace(wish, direction=as_path(wish.direction).at(time)) for wish in self.prefer)
        return replace(
            self, directions=array_module(*each).stack(each) if each else np.zeros((0, 3)), prefer=wishes
        )

    def rates(self, time: ArrayLike) -> AnyArray:
        """Return the derivatives (k, 3) 1/s of the targets' directions with respect to time, at a time, s."""
        each = [path.rate(time) for path in self.paths]
        return array_module(*each).stack(each) if each else np.zeros((0, 3))
