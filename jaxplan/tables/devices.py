"""Joint angles from the frames of devices, as C-kernels and STK's sensor files have them.

Such a file gives the orientation of a device's frame in the body. How the device is mounted and where its
angles are zero is known from the spacecraft alone. The z axis of a device's frame is its boresight, and the y
axis is the direction to the left of that, at right angles to the yaw axis. In the gimbal's own axes, at
azimuth ``a`` and elevation ``b``, the frame has the columns ``-up, left, outward``, where
``left = (-sin a, cos a, 0)``, and where the third components of ``outward`` and ``up`` are ``sin b`` and
``cos b``. So the angles are known at any elevation, even at the pole.

Frames do not tell whole turns. Angles are taken the shorter way from row to row, and all angles of a joint
are moved by the same number of whole turns, to be nearest to the middle of its range.
"""

from collections.abc import Sequence

import numpy as np

from jaxplan.geometry.vectors import frame
from jaxplan.model.export_names import labels
from jaxplan.model.gimbals import TURN
from jaxplan.model.spacecraft import Spacecraft

FIRST_TURNING = 1
"""How far the number of a kernel's first device with joints is below that of the platform."""
_FRAME_TOLERANCE = 1e-5  # rad, by which a frame may be off all that its device can have; files are more exact


class OtherDevicesError(ValueError):
    """The frames of devices in a file are not those of the spacecraft's, so that its joints are not known."""


def sensor_files(craft: Spacecraft) -> list[str]:
    """Return the names of the STK sensor files (``.sp``) of all devices with joints, in their order."""
    count = craft.gimbals.count
    return [f"{name}.sp" for name in labels(craft.device_names[:count], taken=(), longest=100)]


def joints_of(frames: Sequence[np.ndarray], craft: Spacecraft, source: str) -> np.ndarray:
    """Compute the joint angles at which devices have given frames.

    Args:
        frames: (k, 3, 3) rotation matrices, device to body, for each device with joints, terminals first.
        craft: spacecraft with these devices.
        source: name of the file, for messages.

    Returns:
        (k, J) rad, all yaws, all pitches, all drives.

    Raises:
        OtherDevicesError: if the device cannot have one of the frames.
    """
    gimbals, count = craft.gimbals, len(craft.terminals)
    azimuths, elevations = [], []
    tilts = [None] * count + list(gimbals.tilts)
    for number, (given, tilt) in enumerate(zip(frames, tilts, strict=True)):
        own = np.swapaxes(gimbals.frames[number], 0, 1) @ given
        azimuth = np.arctan2(-own[:, 0, 1], own[:, 1, 1])
        elevation = np.arctan2(own[:, 2, 2], -own[:, 2, 0])
        _expect_frames(
            own, azimuth, elevation if tilt is None else np.full(len(own), tilt), craft, number, source
        )
        azimuths.append(azimuth)
        elevations.append(elevation)
    joints = np.stack([*azimuths[:count], *elevations[:count], *azimuths[count:]], axis=1)
    joints = np.unwrap(joints, axis=0)
    middle = (np.max(joints, axis=0) + np.min(joints, axis=0)) / 2
    wanted = np.mean(np.asarray(craft.joint_ranges), axis=1)
    return np.asarray(joints + TURN * np.round((wanted - middle) / TURN))


def _expect_frames(
    own: np.ndarray, azimuth: np.ndarray, elevation: np.ndarray, craft: Spacecraft, number: int, source: str
) -> None:
    """Raise an OtherDevicesError unless a device has given frames at given angles.

    Args:
        own: (k, 3, 3) frames in the axes of the device's gimbal.
        azimuth: (k,) rad.
        elevation: (k,) rad.
        craft: spacecraft with the device.
        number: index of the device.
        source: name of the file, for the message.
    """
    outward, left, up = (
        np.stack(axis, axis=-1)
        for axis in frame(np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation))
    )
    off = np.abs(own - np.stack([-up, left, outward], axis=-1)).max(axis=(1, 2))
    if not np.all(off <= _FRAME_TOLERANCE):
        row = int(np.argmax(~(off <= _FRAME_TOLERANCE)))
        raise OtherDevicesError(
            f"{source}: row {row}: the frame of {craft.device_names[number]} is {np.rad2deg(off[row]):.3g} "
            "deg off all that it can have in this spacecraft: it is mounted otherwise, or has other axes"
        )


def joint_rates_of(spins: Sequence[np.ndarray], joints: np.ndarray, craft: Spacecraft) -> np.ndarray:
    """Compute the rates of joints (k, J) rad/s from the angular velocities of devices relative to the body.

    Args:
        spins: (k, 3) rad/s in body axes for each device with joints, terminals first.
        joints: (k, J) rad.
        craft: spacecraft with these devices.
    """
    gimbals, count = craft.gimbals, len(craft.terminals)
    azimuths, _ = gimbals.angles(joints)
    yaws, pitches = [], []
    for number, spin in enumerate(spins):
        yaw_axis, pitch_axis = gimbals.axes(azimuths[:, number], np.full(len(spin), number))
        yaws.append(np.sum(spin * yaw_axis, axis=1))
        pitches.append(np.sum(spin * pitch_axis, axis=1))
    return np.stack([*yaws[:count], *pitches[:count], *yaws[count:]], axis=1)
