"""The spacecraft: a platform that carries two-axis terminals and body-fixed instruments.

Devices are numbered terminals first, then instruments. Joints are one vector ``(2n,)``: the yaws of all
``n`` terminals, then their pitches (rad). A terminal mounted at angle ``mount`` about the body's z axis
points, in body axes, along ``v(yaw + mount, pitch)`` of equation (13). Attitudes map body to inertial.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, array_module, arrays, azimuth_elevation, pointing
from jaxplan.model.keys import key, keyed
from jaxplan.model.outlines import FORWARD, UP, field_edges
from jaxplan.runtime.arguments import expect_numbers
from jaxplan.runtime.display import shown
from jaxplan.runtime.once import made_once

EachAxis: TypeAlias = float | np.ndarray
"""A number for every body axis, or (3,)."""


def body_boresights(mounts: ArrayLike, fixed: ArrayLike, joints: ArrayLike) -> AnyArray:
    """Directions of all devices in body axes.

    Args:
        mounts: (n,) rad.
        fixed: (i, 3) boresights of the instruments.
        joints: (..., 2n) rad.

    Returns:
        (..., n + i, 3) unit vectors.
    """
    xp, q, mount, still = arrays(joints, mounts, fixed)
    count = mount.shape[0]
    moving = pointing(q[..., :count] + mount.astype(q.dtype), q[..., count:])
    still = xp.broadcast_to(still.astype(q.dtype), (*q.shape[:-1], *still.shape))
    return xp.concatenate([moving, still], axis=-2)


def wrap(angle: ArrayLike) -> AnyArray:
    """An angle brought into (-pi, pi]."""
    xp, a = arrays(angle)
    return a - 2 * xp.pi * xp.ceil((a - xp.pi) / (2 * xp.pi))


def joints_toward(mounts: ArrayLike, attitude: ArrayLike, directions: ArrayLike) -> AnyArray:
    """Joint angles at which each terminal points along its direction, limits aside.

    Corrects equations (3) and (4): the azimuth is ``atan2(s2, s1)`` of ``R^T z``, less the mounting
    angle, wrapped.

    Args:
        mounts: (n,) rad.
        attitude: (..., 3, 3) body to inertial.
        directions: (n, 3) inertial unit vectors, one a terminal.

    Returns:
        (..., 2n) rad. The yaw of a terminal that must point along the body's z axis is arbitrary.
    """
    _, rotation, toward, mount = arrays(attitude, directions, mounts)
    return joints_along(mount, toward @ rotation)


def joints_along(mounts: ArrayLike, body: ArrayLike) -> AnyArray:
    """Joint angles at which each terminal points along a direction in body axes, limits aside.

    Args:
        mounts: (n,) rad.
        body: (..., n, 3), one direction a terminal.

    Returns:
        (..., 2n) rad; see `joints_toward`.
    """
    xp, mount, directions = arrays(mounts, body)
    azimuth, elevation = azimuth_elevation(directions)
    return xp.concatenate([wrap(azimuth - mount.astype(azimuth.dtype)), elevation], axis=-1)


def stacked(values: Sequence[ArrayLike]) -> np.ndarray:
    """The values stacked to a read-only array of numpy, or to one of JAX where one of them is."""
    if array_module(*values) is jnp:
        return jnp.stack([jnp.asarray(value) for value in values])  # type: ignore[return-value]
    array = np.array(values)
    array.flags.writeable = False
    return array


@shown(
    "mount deg",
    "yaw_limit deg",
    "pitch_limit deg",
    "rate_limit deg/s",
    "acceleration_limit deg/s^2",
    "field_of_view deg",
    "mask deg",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Terminal:
    """A pointing device with a yaw and a pitch joint.

    Attributes:
        name: unique among the devices.
        mount: angle of the mounting about the body's z axis, rad (0, +120, -120 deg in the paper).
        yaw_limit: the yaw stays in [-yaw_limit, yaw_limit], rad, at most pi and without wrap.
        pitch_limit: likewise for the pitch, below pi / 2.
        rate_limit: bound of either joint's rate, rad/s.
        acceleration_limit: bound of either joint's acceleration, rad/s^2.
        field_of_view: (2,) rad, full angles of a rectangular field across up and along it, below pi; None
            where it has none.
        up: (3,) unit vector along the boresight, to its left and upward, at right angles to the boresight;
            None for upward.
        mask: (k, 2) rad each, corners (yaw, pitch) of a convex polygon that the joints must not enter.
    """

    name: str = field(metadata=key("name", "unique among the devices", static=True))
    mount: float = field(
        metadata=key("mount_deg", "turn of the mounting about the body's z axis", "[-5e4, 5e4]")
    )
    # beyond half a turn an angle would have two values
    yaw_limit: float = field(metadata=key("yaw_limit_deg", "range of the yaw to either side", "(0, 180]"))
    # at a right angle the yaw loses its meaning
    pitch_limit: float = field(
        metadata=key("pitch_limit_deg", "range of the pitch to either side", "(0, 90)")
    )
    rate_limit: float = field(metadata=key("rate_limit_deg_s", "of each joint", "[1e-6, 1e6]"))
    acceleration_limit: float = field(
        metadata=key("acceleration_limit_deg_s2", "of each joint", "[1e-9, 1e9]")
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
    "instruments",
    "rate_limit deg/s",
    "rate_norm_limit deg/s",
    "acceleration_limit deg/s^2",
    "acceleration_norm_limit deg/s^2",
    "jerk_limit deg/s^3",
    "inertia kg m^2",
    "torque_limit N m",
    "wheel_momentum_limit N m s",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Spacecraft:
    """A platform with any number of terminals and instruments, none of either being legal.

    Attributes:
        rate_limit: bound of each component of the platform's angular velocity (body axes), rad/s; a number
            for all three, or (3,). So are the other limits of the platform, but for those of a length.
        rate_norm_limit: bound of the length of the angular velocity, rad/s, beside that of the components;
            None for no bound.
        acceleration_limit: of its angular acceleration, rad/s^2.
        acceleration_norm_limit: of the length of that, rad/s^2; None for no bound.
        jerk_limit: of its second derivative, rad/s^3; None for no bound.
        inertia: (3, 3) kg m^2 in body axes; None where torque does not matter.
        torque_limit: of the torque, N m; None for no bound.
        wheel_momentum_limit: of the angular momentum ``J omega``, N m s; None for no bound.
        terminals: devices with joints.
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
    terminals: tuple[Terminal, ...] = keyed((), "terminal", "devices with a yaw and a pitch joint")
    instruments: tuple[Instrument, ...] = keyed((), "instrument", "devices fixed to the body")

    @property
    @made_once
    def device_names(self) -> tuple[str, ...]:
        """Names of terminals, then instruments: the order of every device axis."""
        return tuple([t.name for t in self.terminals] + [i.name for i in self.instruments])

    @property
    def devices(self) -> tuple[Terminal | Instrument, ...]:
        """Terminals, then instruments."""
        return (*self.terminals, *self.instruments)

    @property
    @made_once
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in the order of the joint vector, such as ``terminal-1 yaw``."""
        return tuple(f"{t.name} {axis}" for axis in ("yaw", "pitch") for t in self.terminals)

    @property
    @made_once
    def joint_limits(self) -> np.ndarray:
        """(2n,) rad: the bound of each joint's angle."""
        return stacked([t.yaw_limit for t in self.terminals] + [t.pitch_limit for t in self.terminals])

    @property
    @made_once
    def joint_rate_limits(self) -> np.ndarray:
        """(2n,) rad/s: the bound of each joint's rate."""
        return stacked([t.rate_limit for t in self.terminals] * 2)

    @property
    @made_once
    def joint_acceleration_limits(self) -> np.ndarray:
        """(2n,) rad/s^2: the bound of each joint's acceleration."""
        return stacked([t.acceleration_limit for t in self.terminals] * 2)

    @property
    @made_once
    def mounts(self) -> np.ndarray:
        """(n,) rad: the angle of each terminal's mounting."""
        return stacked([t.mount for t in self.terminals])

    @property
    @made_once
    def fixed_boresights(self) -> np.ndarray:
        """(number of instruments, 3) unit vectors in body axes."""
        return stacked([i.boresight for i in self.instruments]).reshape(-1, 3)

    def boresights(self, attitude: ArrayLike, joints: ArrayLike) -> AnyArray:
        """Directions of all devices in the inertial frame, as in equations (11) and (12).

        Args:
            attitude: (..., 3, 3) body to inertial.
            joints: (..., 2n) rad.

        Returns:
            (..., devices, 3) unit vectors.

        Raises:
            ValueError: if an argument has another shape, or is not made of real numbers.
        """
        expect_numbers("attitude", attitude, 3, 3)
        expect_numbers("joints", joints, 2 * len(self.terminals))
        body = body_boresights(self.mounts, self.fixed_boresights, joints)
        xp, rotation = arrays(attitude)
        return body @ xp.swapaxes(rotation, -1, -2)

    def joints_toward(self, attitude: ArrayLike, directions: ArrayLike) -> AnyArray:
        """Joint angles at which each terminal points along its direction, limits aside.

        Args:
            attitude: (..., 3, 3) body to inertial.
            directions: (n, 3) inertial unit vectors, one a terminal.

        Returns:
            (..., 2n) rad. The yaw of a terminal that must point along the body's z axis is arbitrary.

        Raises:
            ValueError: if an argument has another shape, or is not made of real numbers.
        """
        expect_numbers("attitude", attitude, 3, 3)
        expect_numbers("directions", directions, len(self.terminals), 3)
        return joints_toward(self.mounts, attitude, directions)
