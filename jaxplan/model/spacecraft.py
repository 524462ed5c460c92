"""The spacecraft: a platform that carries terminals, drives and body-fixed instruments.

Devices are numbered terminals first, then drives, then instruments. Joints are one vector ``(2n + d,)``: the
yaws of all ``n`` terminals, their pitches, and the angles of the ``d`` drives (rad). How the joints turn the
devices is in `jaxplan.model.gimbals`. Attitudes map body to inertial.
"""

from dataclasses import dataclass, field
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
from jaxplan.runtime.display import shown
from jaxplan.runtime.once import made_once

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
    """A platform with any number of terminals, drives and instruments, zero of each included.

    Attributes:
        rate_limit: bound of each component of the platform's angular velocity (body axes), rad/s; a number
            for all three, or (3,). So are the other limits of the platform, but for those of a length.
        rate_norm_limit: bound of the length of the angular velocity, rad/s, beside that of the components;
            None for no bound.
        acceleration_limit: of its angular acceleration, rad/s^2.
        acceleration_norm_limit: of the length of that, rad/s^2; None for no bound.
        jerk_limit: of its second derivative, rad/s^3; None for no bound.
        inertia: (3, 3) kg m^2 in body axes, or its three moments about them (3,), of the whole with wheels
            locked and joints at zero, as it is given (`whole_inertia` is always the matrix); None where
            torque does not matter.
        torque_limit: of the torque ``J omega' + omega x J omega``, which thrusters give, N m; None for no
            bound. Stages of terminals and drives that have an inertia add to it.
        wheel_momentum_limit: of the angular momentum ``J omega``, to which they add, too, N m s; None for no
            bound.
        wheels: three or more reaction wheels, which then give all torque; none where that is not modelled.
        allocation: how the wheels share out torque and momentum, one of `jaxplan.model.wheels.ALLOCATIONS`.
        terminals: devices with two joints.
        drives: devices with one.
        instruments: devices without.
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
        """Names of terminals, drives and instruments: the order of every device axis."""
        names = [one.name for one in self.terminals] + [one.name for one in self.drives]
        return (*names, *(one.name for one in self.instruments))

    @property
    def devices(self) -> tuple[Terminal | Drive | Instrument, ...]:
        """Terminals, drives and instruments."""
        return (*self.terminals, *self.drives, *self.instruments)

    @property
    @made_once
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in the order of the joint vector, such as ``terminal-1 yaw``."""
        of_terminals = [f"{t.name} {axis}" for axis in ("yaw", "pitch") for t in self.terminals]
        return (*of_terminals, *(f"{drive.name} angle" for drive in self.drives))

    @property
    def joint_count(self) -> int:
        """Number of joints, ``2n + d``."""
        return 2 * len(self.terminals) + len(self.drives)

    @property
    @made_once
    def joint_ranges(self) -> np.ndarray:
        """(2n + d, 2) rad: least and largest angle of each joint."""
        ranges = [t.ranges for t in self.terminals]
        rows = (
            [own[0] for own in ranges] + [own[1] for own in ranges] + [drive.range for drive in self.drives]
        )
        return stacked(rows).reshape(-1, 2)

    @property
    @made_once
    def joint_rate_limits(self) -> np.ndarray:
        """(2n + d,) rad/s: the bound of each joint's rate."""
        return self._each_joint([t.rate_limits for t in self.terminals], "rate_limit")

    @property
    @made_once
    def joint_acceleration_limits(self) -> np.ndarray:
        """(2n + d,) rad/s^2: the bound of each joint's acceleration."""
        return self._each_joint([t.acceleration_limits for t in self.terminals], "acceleration_limit")

    def _each_joint(self, of_terminals: list[tuple[Any, Any]], of_drives: str) -> np.ndarray:
        """Numbers (2n + d,), one a joint.

        Args:
            of_terminals: yaw's and pitch's number of each terminal.
            of_drives: name of the drives' attribute.
        """
        rows = [own[axis] for axis in range(2) for own in of_terminals]
        return stacked(rows + [getattr(drive, of_drives) for drive in self.drives])

    @property
    @made_once
    def wheel_array(self) -> WheelArray | None:
        """The rows that limit the wheels; None without wheels."""
        return wheel_array(self.wheels, self.allocation) if self.wheels else None

    @property
    @made_once
    def stages(self) -> Stages | None:
        """What joints turn, as far as it has an inertia; None without any."""
        return stages_of((*self.terminals, *self.drives), len(self.terminals), self.joint_count)

    @property
    @made_once
    def whole_inertia(self) -> np.ndarray | None:
        """(3, 3) kg m^2 in body axes, `inertia` as a matrix; None where none is given."""
        return None if self.inertia is None else matrix_of(self.inertia)

    @property
    @made_once
    def fixed_inertia(self) -> np.ndarray | None:
        """(3, 3) kg m^2 in body axes, of what joints do not turn; None where no inertia is given."""
        if self.stages is None or self.inertia is None:
            return self.whole_inertia
        _, whole, moving = arrays(self.whole_inertia, self.stages.at_zero)
        return whole - moving

    @property
    @made_once
    def gimbals(self) -> Gimbals:
        """The mounting of terminals and drives, from which joints give directions."""
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
        """Directions of all devices in the inertial frame, as in equations (11) and (12).

        Args:
            attitude: (..., 3, 3) body to inertial.
            joints: (..., 2n + d) rad.

        Returns:
            (..., devices, 3) unit vectors.

        Raises:
            ValueError: if an argument has another shape, or is not made of real numbers.
        """
        expect_numbers("attitude", attitude, 3, 3)
        expect_numbers("joints", joints, self.joint_count)
        xp, rotation, moving, fixed = arrays(attitude, self.gimbals.boresights(joints), self.fixed_boresights)
        still = xp.broadcast_to(fixed.astype(moving.dtype), (*moving.shape[:-2], *fixed.shape))
        return xp.concatenate([moving, still], axis=-2) @ xp.swapaxes(rotation, -1, -2)

    def joints_toward(self, attitude: ArrayLike, directions: ArrayLike) -> AnyArray:
        """Joint angles at which each terminal points along its direction, limits aside.

        Corrects equations (3) and (4), see `Gimbals.joints_along`.

        Args:
            attitude: (..., 3, 3) body to inertial.
            directions: (n, 3) inertial unit vectors, one a terminal.

        Returns:
            (..., 2n) rad. The yaw of a terminal that must point along its yaw axis is arbitrary.

        Raises:
            ValueError: if an argument has another shape, or is not made of real numbers.
        """
        expect_numbers("attitude", attitude, 3, 3)
        expect_numbers("directions", directions, len(self.terminals), 3)
        xp, rotation, toward, frames = arrays(attitude, directions, self.gimbals.frames)
        yaw, pitch = angles_toward(frames[: len(self.terminals)], rotation, toward)
        return xp.concatenate([yaw, pitch], axis=-1)
