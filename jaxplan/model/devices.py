"""Devices that point, as users state them: terminals, drives and instruments, and how they are mounted.

A *terminal* has two joints: a yaw about its yaw axis, and a pitch that lifts its boresight towards that axis.
A *drive* has one joint, and an *instrument* has none. The *boresight* of a device is the direction in which
it points. A terminal's own axes are its boresight at zero angles, the direction to the left of that (yaw axis
x boresight), and its yaw axis.
"""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import jax
import numpy as np

from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.file_keys import key, keyed
from jaxplan.model.gimbals import frame_about_z, frame_of, stacked
from jaxplan.model.outlines import FORWARD, UP, field_edges
from jaxplan.runtime.display import shown

NEAREST_TO_POLE = np.deg2rad(0.1)
"""rad; a pitch stays this far from 90 deg, where the yaw loses its meaning, whatever its range says."""

_SQUARE_TOLERANCE = 8 * np.finfo(float).eps  # cosine of an angle that is a right one to rounding
_MAX_ANGLE = np.array([np.inf, np.inf, np.pi / 2 - NEAREST_TO_POLE, np.pi / 2 - NEAREST_TO_POLE])


@shown("yaw_axis", "boresight")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Mount:
    """The mounting of a terminal whose yaw axis is any axis of the body.

    Attributes:
        yaw_axis: (3,) unit vector in body axes about which the yaw turns (counter-clockwise seen from its
            tip); a rising pitch lifts the boresight towards it.
        boresight: (3,) unit vector in body axes along which the terminal points when both angles are zero. It
            is at right angles to the yaw axis; one that is so to 0.057 deg is made `squared` when it is read.
    """

    yaw_axis: np.ndarray = field(
        metadata=key("yaw_axis", "that the yaw turns about; the pitch lifts towards it", kind="unit vector")
    )
    boresight: np.ndarray = field(
        metadata=key(
            "boresight", "where it points at zero angles, at right angles to the yaw axis", kind="unit vector"
        )
    )

    @property
    def squared(self) -> "Mount":
        """The mount with its boresight turned, in the plane of both vectors, to an exact right angle.

        It has the same `Terminal.frame`. A mount whose vectors are at right angles to rounding is returned as
        it is, so that its numbers keep their bits. Both must be unit vectors, of numpy.
        """
        cosine = np.dot(self.yaw_axis, self.boresight)
        if abs(cosine) <= _SQUARE_TOLERANCE:
            return self
        across = self.boresight - cosine * self.yaw_axis
        return replace(self, boresight=across / np.linalg.norm(across))


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
    "yaw_inertia kg m^2",
    "pitch_inertia kg m^2",
    "field_of_view deg",
    "up",
    "mask deg",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Terminal:
    """A pointing device with a yaw joint and a pitch joint.

    Attributes:
        name: name, unique among the devices.
        mount: for a terminal whose yaw axis is the body's z axis, the angle about that axis by which it is
            turned, rad (0, +120, -120 deg in the paper). Either this or `mounting` is given.
        mounting: the mounting about any other yaw axis.
        yaw_limit: the yaw stays in [-yaw_limit, yaw_limit], rad. Either this or `yaw_range` is given.
        yaw_range: (2,) rad, least and largest yaw; it may span more than a turn.
        pitch_limit: the pitch stays in [-pitch_limit, pitch_limit], rad. Either this or `pitch_range` is
            given.
        pitch_range: (2,) rad, least and largest pitch. A pitch stays `NEAREST_TO_POLE` away from +-90 deg in
            any case.
        rate_limit: bound of the rate of each joint that has no bound of its own, rad/s.
        yaw_rate_limit: bound of the yaw's rate, rad/s; None for `rate_limit`.
        pitch_rate_limit: bound of the pitch's rate, rad/s; None for `rate_limit`.
        acceleration_limit: bound of the acceleration of each joint that has no bound of its own, rad/s^2.
        yaw_acceleration_limit: bound of the yaw's acceleration, rad/s^2; None for `acceleration_limit`.
        pitch_acceleration_limit: bound of the pitch's acceleration, rad/s^2; None for `acceleration_limit`.
        yaw_inertia: inertia of the part that yaws but does not pitch: (3, 3) kg m^2, or its moments (3,),
            about the part's own centre of mass, which lies on the yaw axis; in the terminal's own axes
            (boresight, left, yaw axis) at zero angles. None where it does not matter.
        pitch_inertia: the same for the part that yaws and pitches; its centre of mass lies on both axes.
        field_of_view: (2,) rad, full angles of a rectangular field of view, first across `up` and then along
            it, below pi; None without a field of view.
        up: (3,) unit vector that says how the field is turned about the boresight, as components along the
            boresight, to its left and upward; at right angles to the boresight. None for upward.
        mask: convex polygons that the joint angles must not enter, each (k, 2) rad: corners (yaw, pitch).
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
    yaw_inertia: np.ndarray | None = keyed(
        None,
        "yaw_inertia_kg_m2",
        "of what yaws and does not pitch, in its axes boresight, left, yaw axis at zero angles",
        "[-1e12, 1e12]",
        kind="inertia",
    )
    pitch_inertia: np.ndarray | None = keyed(
        None,
        "pitch_inertia_kg_m2",
        "of what yaws and pitches, in the same axes",
        "[-1e12, 1e12]",
        kind="inertia",
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
        """(4, 3) outward normals of the edges of its field of view: left, right, upper, lower.

        They are unit vectors, as components along the boresight, to its left and upward.
        """
        return field_edges(FORWARD, UP if self.up is None else self.up, self.field_of_view)

    @property
    def frame(self) -> AnyArray:
        """Rotation (3, 3) to body axes from the terminal's own axes at zero angles.

        Its columns are the boresight, the left of that, and the yaw axis, in body axes.
        """
        if self.mounting is None:
            return frame_about_z(_nan_if_none(self.mount))
        return frame_of(self.mounting.yaw_axis, self.mounting.boresight)

    @property
    def ranges(self) -> AnyArray:
        """(2, 2) rad: least and largest yaw in the first row, least and largest pitch in the second."""
        yaw: Any = self.yaw_range
        pitch: Any = self.pitch_range
        if yaw is None:
            yaw = -_nan_if_none(self.yaw_limit), self.yaw_limit
        if pitch is None:
            pitch = -_nan_if_none(self.pitch_limit), self.pitch_limit
        return stacked([yaw[0], yaw[1], pitch[0], pitch[1]]).clip(-_MAX_ANGLE, _MAX_ANGLE).reshape(2, 2)

    @property
    def rate_limits(self) -> tuple[Any, Any]:
        """Bounds of the rates of yaw and pitch, rad/s; each is the joint's own or else `rate_limit`."""
        own = self.yaw_rate_limit, self.pitch_rate_limit
        return tuple(self.rate_limit if each is None else each for each in own)  # type: ignore[return-value]

    @property
    def acceleration_limits(self) -> tuple[Any, Any]:
        """Bounds of the accelerations of yaw and pitch, rad/s^2; each is its own or `acceleration_limit`."""
        own = self.yaw_acceleration_limit, self.pitch_acceleration_limit
        return tuple(self.acceleration_limit if each is None else each for each in own)  # type: ignore[return-value]


def _nan_if_none(number: float | None) -> float:
    """The number, or NaN for None, which no spacecraft that passed its checks has where this is called."""
    return np.nan if number is None else number


@shown("axis", "boresight", "range deg", "rate_limit deg/s", "acceleration_limit deg/s^2", "inertia kg m^2")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Drive:
    """A device that turns about one axis, such as a solar array or a one-axis antenna.

    Attributes:
        name: name, unique among the devices.
        axis: (3,) unit vector in body axes about which it turns, counter-clockwise seen from the vector's
            tip.
        boresight: (3,) unit vector in body axes along which it points at zero angle; it may have any angle to
            the axis, but not lie along it.
        range: (2,) rad, least and largest angle; it may span more than a turn.
        rate_limit: bound of the angle's rate, rad/s.
        acceleration_limit: bound of the angle's acceleration, rad/s^2.
        inertia: inertia of the part that turns: (3, 3) kg m^2, or its moments (3,), about the part's own
            centre of mass, which lies on the axis; in the drive's own axes at zero angle: the component of
            the boresight across the axis, left, axis. None where it does not matter.
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
    inertia: np.ndarray | None = keyed(
        None,
        "inertia_kg_m2",
        "of what turns, in its axes boresight (its part across the axis), left, axis at zero angle",
        "[-1e12, 1e12]",
        kind="inertia",
    )

    @property
    def frame(self) -> AnyArray:
        """Rotation (3, 3) to body axes from the drive's own axes at zero angle.

        Its columns are the boresight's component across the axis, the left of that, and the axis, in body
        axes.
        """
        return frame_of(self.axis, self.boresight)

    @property
    def tilt(self) -> AnyArray:
        """Angle, rad, of the boresight above the plane across the axis, the same at all joint angles."""
        xp, axis, boresight = arrays(self.axis, self.boresight)
        return xp.arcsin(xp.sum(axis * boresight) / xp.sqrt(xp.sum(axis * axis) * xp.sum(boresight**2)))


@shown("boresight", "field_of_view deg", "up")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Instrument:
    """A device that is fixed to the body, such as a star tracker.

    Attributes:
        name: name, unique among the devices.
        boresight: (3,) unit vector in body axes along which it looks.
        field_of_view: (2,) rad, full angles of a rectangular field of view, first across `up` and then along
            it, below pi; None without a field of view.
        up: (3,) unit vector in body axes at right angles to the boresight, which says how the field is turned
            about the boresight; required where there is a field of view.
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
        """(4, 3) outward normals of the edges of its field of view: left, right, upper, lower.

        They are unit vectors in body axes.
        """
        return field_edges(self.boresight, self.up, self.field_of_view)
