"""Joints from the frames of devices, as C-kernels and STK's sensor files have them.

Such a file has where a device's frame is in the body's, not how the device is mounted nor where its angles
are zero, so it takes the spacecraft to tell joints. The frame of a device has its boresight as z axis, and
as y axis what is left of it, across the yaw axis: at azimuth ``a`` and elevation ``b`` in the gimbal's own
axes its columns are ``-up, left, outward``, of which ``left = (-sin a, cos a, 0)`` and ``outward`` and
``up`` have the third components ``sin b`` and ``cos b``. So the angles are known at any elevation, at the
pole, too.

Whole turns are in no frame. Angles follow each other from row to row, the shorter way, and all of a joint
are moved by whole turns to the middle of its range.
"""

from collections.abc import Sequence

import numpy as np

from jaxplan.geometry.vectors import frame
from jaxplan.model.export_names import labels
from jaxplan.model.gimbals import TURN
from jaxplan.model.spacecraft import Spacecraft

FIRST_TURNING = 1
"""How far the number of a kernel's first device with joints is below that of the platform."""
_MOUNTED = 1e-5  # rad, by which a frame may be off those that a device can have; digits of files are finer


class OtherDevicesError(ValueError):
    """Frames of devices that are not those of the spacecraft, so that its joints are not known."""


def sensor_files(craft: Spacecraft) -> list[str]:
    """Names of STK's files of the devices with joints."""
    count = craft.gimbals.count
    return [f"{name}.sp" for name in labels(craft.device_names[:count], taken=(), longest=100)]


def joints_of(frames: Sequence[np.ndarray], craft: Spacecraft, source: str) -> np.ndarray:
    """Joints at which devices have their frames.

    Args:
        frames: (k, 3, 3) device to body of each device with joints, terminals first.
        craft: whose they are.
        source: of them, for messages.

    Returns:
        (k, J) rad.

    Raises:
        OtherDevicesError: if a frame is none that its device can have.
    """
    gimbals, count = craft.gimbals, len(craft.terminals)
    azimuths, elevations = [], []
    tilts = [None] * count + list(gimbals.tilts)
    for number, (given, tilt) in enumerate(zip(frames, tilts, strict=True)):
        own = np.swapaxes(gimbals.frames[number], 0, 1) @ given
        azimuth = np.arctan2(-own[:, 0, 1], own[:, 1, 1])
        elevation = np.arctan2(own[:, 2, 2], -own[:, 2, 0])
        _check(own, azimuth, elevation if tilt is None else np.full(len(own), tilt), craft, number, source)
        azimuths.append(azimuth)
        elevations.append(elevation)
    joints = np.stack([*azimuths[:count], *elevations[:count], *azimuths[count:]], axis=1)
    joints = np.unwrap(joints, axis=0)
    middle = (np.max(joints, axis=0) + np.min(joints, axis=0)) / 2
    wanted = np.mean(np.asarray(craft.joint_ranges), axis=1)
    return np.asarray(joints + TURN * np.round((wanted - middle) / TURN))


def _check(
    own: np.ndarray, azimuth: np.ndarray, elevation: np.ndarray, craft: Spacecraft, number: int, source: str
) -> None:
    """Raise an OtherDevicesError unless frames (k, 3, 3) in a gimbal's axes are those of angles (k,) rad."""
    outward, left, up = (
        np.stack(axis, axis=-1)
        for axis in frame(np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation))
    )
    off = np.abs(own - np.stack([-up, left, outward], axis=-1)).max(axis=(1, 2))
    if not np.all(off <= _MOUNTED):
        row = int(np.argmax(~(off <= _MOUNTED)))
        raise OtherDevicesError(
            f"{source}: row {row}: the frame of {craft.device_names[number]} is {np.rad2deg(off[row]):.3g} "
            "deg off all that it can have in this spacecraft: it is mounted otherwise, or has other axes"
        )


def joint_rates_of(spins: Sequence[np.ndarray], joints: np.ndarray, craft: Spacecraft) -> np.ndarray:
    """Rates of joints (k, J) rad/s from angular velocities (k, 3) rad/s of devices in the body, in body axes.

    Args:
        spins: of each device with joints, relative to the body.
        joints: (k, J) rad.
        craft: whose they are.
    """
    gimbals, count = craft.gimbals, len(craft.terminals)
    azimuths, _ = gimbals.angles(joints)
    yaws, pitches = [], []
    for number, spin in enumerate(spins):
        yaw_axis, pitch_axis = gimbals.axes(azimuths[:, number], np.full(len(spin), number))
        yaws.append(np.sum(spin * yaw_axis, axis=1))
        pitches.append(np.sum(spin * pitch_axis, axis=1))
    return np.stack([*yaws[:count], *pitches[:count], *yaws[count:]], axis=1)
