"""The spacecraft: a platform that carries terminals, drives and body-fixed instruments.

Devices are numbered terminals first, then drives, then instruments. The joint angles are one vector
``(2n + d,)`` in rad: the yaws of all ``n`` terminals, then their pitches, then the angles of the ``d``
drives. How the joints turn the devices is in `jaxplan.model.gimbals`. Attitudes are rotation matrices from
body to inertial axes.
"""

from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.devices import Drive, Instrument, Terminal
from jaxplan.model.file_keys import key, keyed
from jaxplan.model.gimbals import Gimbals, angles_toward, stacked
from jaxplan.model.stages import Stages, matrix_of, stages_of
from jaxplan.model.wheels import ALLOCATIONS, PSEUDO_INVERSE, Wheel, WheelArray, wheel_array
from jaxplan.runtime.arguments import expect_numbers
from jaxplan.runtime.compute_once import made_once
from jaxplan.runtime.display import shown

EachAxis: TypeAlias = float | np.ndarray
"""A number for every body axis, or (3,)."""


@shown(
    "terminals",
    "drives",
    "instruments",
    "rate_limit deg/s",
    "rate_norm_limit deg/s",
    "acceleration_limit deg/s^2",
    "acceleration_norm_limit deg/s^2",
    "jerk_limit deg/s^3",
    "inertia kg m^2",
    "torque_limit N m",
    "wheel_momentum_limit N m s",
    "wheels",
    "allocation",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Spacecraft:
    """A platform with any number of terminals, drives and instruments; there may be none of each.

    A limit "per body axis" is a number for all three axes, or (3,).

    Attributes:
        rate_limit: bound of the components of the platform's angular velocity, rad/s, per body axis.
        rate_norm_limit: bound of the length of the angular velocity, rad/s, in addition; None for no bound.
        acceleration_limit: bound of the components of its angular acceleration, rad/s^2, per body axis.
        acceleration_norm_limit: bound of the length of the angular acceleration, rad/s^2; None for no bound.
        jerk_limit: bound of the second derivative of its angular velocity, rad/s^3, per body axis; None for
            no bound.
        inertia: (3, 3) kg m^2 in body axes, or its three moments about them (3,), of the whole spacecraft
            with wheels locked and joints at zero, as it was given (`whole_inertia` is always the matrix);
            None where torque does not matter.
        torque_limit: bound of the torque ``J omega' + omega x J omega`` that thrusters give, N m, per body
            axis; None for no bound. Moving parts of terminals and drives that have an inertia add to the
            torque.
        wheel_momentum_limit: bound of the angular momentum ``J omega``, N m s, per body axis; None for no
            bound. Moving parts that have an inertia add to the momentum.
        wheels: three or more reaction wheels, which then give all torque; empty where they are not modelled.
        allocation: how wheels share torque and momentum, one of `jaxplan.model.wheels.ALLOCATIONS`.
        terminals: devices with two joints.
        drives: devices with one joint.
        instruments: devices without joints.
    """

    rate_limit: EachAxis = field(
        metadata=key("rate_limit_deg_s", "of the platform, per body axis", "[1e-6, 1e6]", kind="per axis")
    )
    rate_norm_limit: float | None = keyed(
        None, "rate_norm_limit_deg_s", "of the length of the platform's angular velocity", "[1e-6, 1e6]"
    )
    acceleration_limit: EachAxis = field(
        metadata=key(
            "acceleration_limit_deg_s2", "of the platform, per body axis", "[1e-9, 1e9]", kind="per axis"
        )
    )
    acceleration_norm_limit: float | None = keyed(
        None,
        "acceleration_norm_limit_deg_s2",
        "of the length of the platform's angular acceleration",
        "[1e-9, 1e9]",
    )
    jerk_limit: EachAxis | None = keyed(
        None, "jerk_limit_deg_s3", "of the platform, per body axis", "[1e-12, 1e12]", kind="per axis"
    )
    inertia: np.ndarray | None = keyed(
        None, "inertia_kg_m2", "in body axes, or three moments about them", "[-1e12, 1e12]", kind="inertia"
    )
    torque_limit: EachAxis | None = keyed(
        None, "torque_limit_nm", "per body axis; needs the inertia", "[1e-12, 1e12]", kind="per axis"
    )
    wheel_momentum_limit: EachAxis | None = keyed(
        None, "wheel_momentum_limit_nms", "per body axis; needs the inertia", "[1e-12, 1e12]", kind="per axis"
    )
    wheels: tuple[Wheel, ...] = keyed((), "wheel", "reaction wheels, three or more; they need the inertia")
    allocation: str = keyed(
        PSEUDO_INVERSE,
        "allocation",
        "how wheels share out torque and momentum",
        options=ALLOCATIONS,
        static=True,
    )
    terminals: tuple[Terminal, ...] = keyed((), "terminal", "devices with a yaw and a pitch joint")
    drives: tuple[Drive, ...] = keyed((), "drive", "devices that turn about one axis")
    instruments: tuple[Instrument, ...] = keyed((), "instrument", "devices fixed to the body")

    @property
    @made_once
    def device_names(self) -> tuple[str, ...]:
        """Names of terminals, drives and instruments, in the order of every array axis over devices."""
        names = [one.name for one in self.terminals] + [one.name for one in self.drives]
        return (*names, *(one.name for one in self.instruments))

    @property
    def devices(self) -> tuple[Terminal | Drive | Instrument, ...]:
        """All devices: terminals, then drives, then instruments."""
        return (*self.terminals, *self.drives, *self.instruments)

    @property
    @made_once
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in the order of the joint vector, such as ``terminal-1 yaw``."""
        of_terminals = [f"{t.name} {axis}" for axis in ("yaw", "pitch") for t in self.terminals]
        return (*of_terminals, *(f"{drive.name} angle" for drive in self.drives))

    @property
    def joint_count(self) -> int:
        """Number of joints, ``2n + d``: two for each of n terminals, one for each of d drives."""
        return 2 * len(self.terminals) + len(self.drives)

    @property
    @made_once
    def joint_ranges(self) -> np.ndarray:
        """(2n + d, 2) rad: least and largest angle of each joint, in the order of the joint vector."""
        ranges = [t.ranges for t in self.terminals]
        rows = (
            [own[0] for own in ranges] + [own[1] for own in ranges] + [drive.range for drive in self.drives]
        )
        return stacked(rows).reshape(-1, 2)

    @property
    @made_once
    def joint_rate_limits(self) -> np.ndarray:
        """(2n + d,) rad/s: bound of each joint's rate, in the order of the joint vector."""
        return self._order_by_joint([t.rate_limits for t in self.terminals], "rate_limit")

    @property
    @made_once
    def joint_acceleration_limits(self) -> np.ndarray:
        """(2n + d,) rad/s^2: bound of each joint's acceleration, in the order of the joint vector."""
        return self._order_by_joint([t.acceleration_limits for t in self.terminals], "acceleration_limit")

    def _order_by_joint(self, of_terminals: list[tuple[Any, Any]], of_drives: str) -> np.ndarray:
        """Put numbers of terminals and drives into the order of the joint vector, as (2n + d,).

        Args:
            of_terminals: for each terminal the number of its yaw and that of its pitch.
            of_drives: name of the attribute that holds a drive's number.
        """
        rows = [own[axis] for axis in range(2) for own in of_terminals]
        return stacked(rows + [getattr(drive, of_drives) for drive in self.drives])

    @property
    @made_once
    def wheel_array(self) -> WheelArray | None:
        """The wheels as an array with the rows that limit it; None without wheels."""
        return wheel_array(self.wheels, self.allocation) if self.wheels else None

    @property
    @made_once
    def stages(self) -> Stages | None:
        """The parts that joints turn and that have an inertia; None if no part has one."""
        return stages_of((*self.terminals, *self.drives), len(self.terminals), self.joint_count)

    @property
    @made_once
    def whole_inertia(self) -> np.ndarray | None:
        """(3, 3) kg m^2 in body axes: `inertia` as a matrix; None where none is given."""
        return None if self.inertia is None else matrix_of(self.inertia)

    @property
    @made_once
    def fixed_inertia(self) -> np.ndarray | None:
        """(3, 3) kg m^2 in body axes, `inertia` less that of parts that joints turn; None if not given."""
        if self.stages is None or self.inertia is None:
            return self.whole_inertia
        _, whole, moving = arrays(self.whole_inertia, self.stages.at_zero)
        return whole - moving

    @property
    @made_once
    def stiff(self) -> "Spacecraft":
        """The same spacecraft as if its inertia stayed what it is with all joints at zero."""
        terminals = [replace(one, yaw_inertia=None, pitch_inertia=None) for one in self.terminals]
        drives = [replace(one, inertia=None) for one in self.drives]
        return replace(self, terminals=tuple(terminals), drives=tuple(drives), inertia=self.whole_inertia)

    @property
    @made_once
    def gimbals(self) -> Gimbals:
        """The mountings of terminals and drives, which turn joint angles into directions."""
        frames = [one.frame for one in self.terminals] + [one.frame for one in self.drives]
        return Gimbals(
            frames=stacked(frames).reshape(-1, 3, 3), tilts=stacked([drive.tilt for drive in self.drives])
        )

    @property
    @made_once
    def fixed_boresights(self) -> np.ndarray:
        """(number of instruments, 3) boresights of the instruments, unit vectors in body axes."""
        return stacked([i.boresight for i in self.instruments]).reshape(-1, 3)

    def boresights(self, attitude: ArrayLike, joints: ArrayLike) -> AnyArray:
        """Return the directions of all devices in the inertial frame, as in equations (11) and (12).

        Args:
            attitude: (..., 3, 3) body to inertial.
            joints: (..., 2n + d) rad.

        Returns:
            (..., number of devices, 3) unit vectors.

        Raises:
            ValueError: if an argument has another shape, or is not made of real numbers.
        """
        expect_numbers("attitude", attitude, 3, 3)
        expect_numbers("joints", joints, self.joint_count)
        xp, rotation, moving, fixed = arrays(attitude, self.gimbals.boresights(joints), self.fixed_boresights)
        still = xp.broadcast_to(fixed.astype(moving.dtype), (*moving.shape[:-2], *fixed.shape))
        return xp.concatenate([moving, still], axis=-2) @ xp.swapaxes(rotation, -1, -2)

    def joints_toward(self, attitude: ArrayLike, directions: ArrayLike) -> AnyArray:
        """Return the joint angles at which each terminal points along its direction, whatever its ranges are.

        It corrects equations (3) and (4), see `jaxplan.model.gimbals.angles_toward`.

        Args:
            attitude: (..., 3, 3) body to inertial.
            directions: (n, 3) inertial unit vectors, one for each terminal.

        Returns:
            (..., 2n) rad, all yaws and then all pitches. The yaw of a terminal that must point along its yaw
            axis is arbitrary.

        Raises:
            ValueError: if an argument has another shape, or is not made of real numbers.
        """
        expect_numbers("attitude", attitude, 3, 3)
        expect_numbers("directions", directions, len(self.terminals), 3)
        xp, rotation, toward, frames = arrays(attitude, directions, self.gimbals.frames)
        yaw, pitch = angles_toward(frames[: len(self.terminals)], rotation, toward)
        return xp.concatenate([yaw, pitch], axis=-1)
