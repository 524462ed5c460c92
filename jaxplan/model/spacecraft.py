"""The spacecraft: a platform that carries terminals, drives and body-fixed instruments.

Devices are numbered terminals first, then drives, then instruments. Joints are one vector ``(2n + d,)``: the
yaws of all ``n`` terminals, their pitches, and the angles of the ``d`` drives (rad). How the joints turn the
devices is in `jaxplan.model.gimbals`. Attitudes map body to inertial.
"""

from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.gimbals import Gimbals, angles_toward, frame_about_z, frame_of, stacked
from jaxplan.model.keys import key, keyed
from jaxplan.model.outlines import FORWARD, UP, field_edges
from jaxplan.model.wheels import ALLOCATIONS, PSEUDO_INVERSE, Wheel, WheelArray, wheel_array
from jaxplan.runtime.arguments import expect_numbers
from jaxplan.runtime.display import shown
from jaxplan.runtime.once import made_once

EachAxis: TypeAlias = float | np.ndarray
"""A number for every body axis, or (3,)."""

NEAREST_TO_POLE = np.deg2rad(0.1)
"""rad; a pitch stays this far from 90 deg, where the yaw loses its meaning, whatever its range says."""


_MOST_ANGLE = np.array([np.inf, np.inf, np.pi / 2 - NEAREST_TO_POLE, np.pi / 2 - NEAREST_TO_POLE])


@shown("yaw_axis", "boresight")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Mount:
    """How a terminal is mounted, in body axes.

    Attributes:
        yaw_axis: (3,) unit vector that the yaw turns about, and to which a rising pitch lifts the boresight.
        boresight: (3,) unit vector along which it points at zero angles, at right angles to the yaw axis.
    """

    yaw_axis: np.ndarray = field(
        metadata=key("yaw_axis", "that the yaw turns about; the pitch lifts towards it", kind="unit vector")
    )
    boresight: np.ndarray = field(
        metadata=key(
            "boresight", "where it points at zero angles, at right angles to the yaw axis", kind="unit vector"
        )
    )


@shown(
    "mount deg",
    "mounting",
    "yaw_limit deg",
    "yaw_range deg",
    "pitch_limit deg",
    "pitch_range deg",
    "rate_limit deg/s",
    "yaw_rate_limit deg/s",
    "pitch_rate_limit deg/s",
    "acceleration_limit deg/s^2",
    "yaw_acceleration_limit deg/s^2",
    "pitch_acceleration_limit deg/s^2",
    "field_of_view deg",
    "up",
    "mask deg",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Terminal:
    """A pointing device with a yaw and a pitch joint.

    Attributes:
        name: unique among the devices.
        mount: angle of the mounting about the body's z axis, rad (0, +120, -120 deg in the paper), of a
            terminal whose yaw turns about that axis. One of this and `mounting` is given.
        mounting: any other way that it is mounted.
        yaw_limit: the yaw stays in [-yaw_limit, yaw_limit], rad. One of this and `yaw_range` is given.
        yaw_range: (2,) rad, least and largest yaw; it may span more than a turn.
        pitch_limit: the pitch stays in [-pitch_limit, pitch_limit], rad. One of this and `pitch_range`.
        pitch_range: (2,) rad, least and largest pitch; `NEAREST_TO_POLE` is kept whatever it says.
        rate_limit: bound of either joint's rate, rad/s, but for a joint that has its own.
        yaw_rate_limit: bound of the yaw's rate, rad/s; None for `rate_limit`.
        pitch_rate_limit: likewise of the pitch's.
        acceleration_limit: bound of either joint's acceleration, rad/s^2, but for a joint that has its own.
        yaw_acceleration_limit: bound of the yaw's acceleration, rad/s^2; None for `acceleration_limit`.
        pitch_acceleration_limit: likewise of the pitch's.
        field_of_view: (2,) rad, full angles of a rectangular field across up and along it, below pi; None
            where it has none.
        up: (3,) unit vector along the boresight, to its left and upward, at right angles to the boresight;
            None for upward.
        mask: (k, 2) rad each, corners (yaw, pitch) of a convex polygon that the joints must not enter.
    """

    name: str = field(metadata=key("name", "unique among the devices", static=True))
    mount: float | None = keyed(
        None, "mount_deg", "turn of the mounting about the body's z axis", "[-5e4, 5e4]", required=True
    )
    mounting: Mount | None = keyed(None, "mount", "any other way that it is mounted", instead_of="mount")
    # beyond half a turn to either side an angle would have two values
    yaw_limit: float | None = keyed(
        None, "yaw_limit_deg", "range of the yaw to either side", "(0, 180]", required=True
    )
    yaw_range: np.ndarray | None = keyed(
        None,
        "yaw_range_deg",
        "least and largest yaw, may span more than a turn",
        "[-720, 720]",
        kind="range",
        instead_of="yaw_limit",
    )
    # at a right angle the yaw loses its meaning
    pitch_limit: float | None = keyed(
        None, "pitch_limit_deg", "range of the pitch to either side", "(0, 90)", required=True
    )
    pitch_range: np.ndarray | None = keyed(
        None,
        "pitch_range_deg",
        "least and largest pitch; 0.1 deg is kept from 90, where the yaw has no meaning",
        "[-90, 90]",
        kind="range",
        instead_of="pitch_limit",
    )
    rate_limit: float | None = keyed(None, "rate_limit_deg_s", "of each joint without its own", "[1e-6, 1e6]")
    yaw_rate_limit: float | None = keyed(None, "yaw_rate_limit_deg_s", "of the yaw", "[1e-6, 1e6]")
    pitch_rate_limit: float | None = keyed(None, "pitch_rate_limit_deg_s", "of the pitch", "[1e-6, 1e6]")
    acceleration_limit: float | None = keyed(
        None, "acceleration_limit_deg_s2", "of each joint without its own", "[1e-9, 1e9]"
    )
    yaw_acceleration_limit: float | None = keyed(
        None, "yaw_acceleration_limit_deg_s2", "of the yaw", "[1e-9, 1e9]"
    )
    pitch_acceleration_limit: float | None = keyed(
        None, "pitch_acceleration_limit_deg_s2", "of the pitch", "[1e-9, 1e9]"
    )

    field_of_view: np.ndarray | None = keyed(
        None,
        "field_of_view_deg",
        "of a rectangular field, full angles across up and along it",
        "(0, 180)",
        kind="two angles",
    )
    up: np.ndarray | None = keyed(
        None,
        "up",
        "of its field, in parts along the boresight, to its left and upward; upward if absent",
        kind="unit vector",
    )
    mask: tuple[np.ndarray, ...] = keyed(
        (),
        "mask_deg",
        "convex polygons of (yaw, pitch) that it must not enter, met again every turn",
        "[-360, 360]",
        kind="polygons",
    )

    @property
    def edges(self) -> AnyArray:
        """(4, 3) outward normals of its field's edges: along the boresight, to its left and upward."""
        return field_edges(FORWARD, UP if self.up is None else self.up, self.field_of_view)

    @property
    def frame(self) -> AnyArray:
        """Rotation (3, 3) to body axes from the terminal's at zero angles: boresight, left, yaw axis."""
        if self.mounting is None:
            return frame_about_z(_given(self.mount))
        return frame_of(self.mounting.yaw_axis, self.mounting.boresight)

    @property
    def ranges(self) -> AnyArray:
        """(2, 2) rad, least and largest yaw, then pitch."""
        yaw: Any = self.yaw_range
        pitch: Any = self.pitch_range
        if yaw is None:
            yaw = -_given(self.yaw_limit), self.yaw_limit
        if pitch is None:
            pitch = -_given(self.pitch_limit), self.pitch_limit
        return stacked([yaw[0], yaw[1], pitch[0], pitch[1]]).clip(-_MOST_ANGLE, _MOST_ANGLE).reshape(2, 2)

    @property
    def rate_limits(self) -> tuple[Any, Any]:
        """Bounds of the rates of yaw and pitch, rad/s."""
        own = self.yaw_rate_limit, self.pitch_rate_limit
        return tuple(self.rate_limit if each is None else each for each in own)  # type: ignore[return-value]

    @property
    def acceleration_limits(self) -> tuple[Any, Any]:
        """Bounds of the accelerations of yaw and pitch, rad/s^2."""
        own = self.yaw_acceleration_limit, self.pitch_acceleration_limit
        return tuple(self.acceleration_limit if each is None else each for each in own)  # type: ignore[return-value]


def _given(number: float | None) -> float:
    """The number, or NaN for None, which no checked spacecraft has where this is called."""
    return np.nan if number is None else number


@shown("axis", "boresight", "range deg", "rate_limit deg/s", "acceleration_limit deg/s^2")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Drive:
    """A device that turns about one axis, such as a solar array or a one-axis antenna.

    Attributes:
        name: unique among the devices.
        axis: (3,) unit vector in body axes that it turns about, counter-clockwise seen from its tip.
        boresight: (3,) unit vector in body axes along which it points at zero angle; at any angle to the
            axis, but not along it.
        range: (2,) rad, least and largest angle; it may span more than a turn.
        rate_limit: rad/s.
        acceleration_limit: rad/s^2.
    """

    field_of_view: ClassVar[None] = None

    name: str = field(metadata=key("name", "unique among the devices", static=True))
    axis: np.ndarray = field(metadata=key("axis", "that it turns about, body axes", kind="unit vector"))
    boresight: np.ndarray = field(
        metadata=key("boresight", "where it points at zero angle, body axes", kind="unit vector")
    )
    range: np.ndarray = field(
        metadata=key(
            "range_deg", "least and largest angle, may span more than a turn", "[-720, 720]", kind="range"
        )
    )
    rate_limit: float = field(metadata=key("rate_limit_deg_s", "of its angle", "[1e-6, 1e6]"))
    acceleration_limit: float = field(
        metadata=key("acceleration_limit_deg_s2", "of its angle", "[1e-9, 1e9]")
    )

    @property
    def frame(self) -> AnyArray:
        """(3, 3) rotation to body axes from its own: the boresight's part across the axis, left, and axis."""
        return frame_of(self.axis, self.boresight)

    @property
    def tilt(self) -> AnyArray:
        """Elevation, rad, of the boresight above the plane across the axis; the same at all angles."""
        xp, axis, boresight = arrays(self.axis, self.boresight)
        return xp.arcsin(xp.sum(axis * boresight) / xp.sqrt(xp.sum(axis * axis) * xp.sum(boresight**2)))


@shown("boresight", "field_of_view deg", "up")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Instrument:
    """A device fixed to the body, such as a star tracker.

    Attributes:
        name: unique among the devices.
        boresight: (3,) unit vector in body axes.
        field_of_view: (2,) rad, full angles of a rectangular field across up and along it, below pi; None
            where it has none.
        up: (3,) unit vector in body axes, at right angles to the boresight; needed for a field.
    """

    name: str = field(metadata=key("name", "unique among the devices", static=True))
    boresight: np.ndarray = field(metadata=key("boresight", "where it looks, body axes", kind="unit vector"))
    field_of_view: np.ndarray | None = keyed(
        None,
        "field_of_view_deg",
        "of a rectangular field, full angles across up and along it",
        "(0, 180)",
        kind="two angles",
    )
    up: np.ndarray | None = keyed(
        None, "up", "of its field, body axes, at right angles to the boresight", kind="unit vector"
    )

    @property
    def edges(self) -> AnyArray:
        """(4, 3) outward normals of its field's edges in body axes."""
        return field_edges(self.boresight, self.up, self.field_of_view)


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
        inertia: (3, 3) kg m^2 in body axes; None where torque does not matter.
        torque_limit: of the torque ``J omega' + omega x J omega``, which thrusters give, N m; None for no
            bound.
        wheel_momentum_limit: of the angular momentum ``J omega``, N m s; None for no bound.
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
    inertia: np.ndarray | None = keyed(None, "inertia_kg_m2", "in body axes", "[-1e12, 1e12]", kind="inertia")
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
