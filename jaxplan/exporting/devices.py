"""Frames of the devices, whose z axis is the boresight, and names of devices that other tools take.

A device at azimuth ``a`` and elevation ``b`` in body axes has the frame ``Rz(a) Ry(pi/2 - b)``, whose columns
are its axes: z is ``v(a, b)`` of equation (13), y lies in the body's xy plane and x points down. A terminal's
azimuth is its yaw plus its mount, its elevation the pitch.
"""

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from jaxplan.geometry.directions import azimuth_elevation, frame

if TYPE_CHECKING:
    from jaxplan.exporting.sampled import Sampled


def frames(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Frames of devices.

    Args:
        azimuth: (...) rad.
        elevation: (...) rad.

    Returns:
        (..., 3, 3) device to body.
    """
    a, b = np.broadcast_arrays(azimuth, elevation)
    outward, left, up = (
        np.stack(axis, axis=-1) for axis in frame(np.cos(a), np.sin(a), np.cos(b), np.sin(b))
    )
    return np.stack([-up, left, outward], axis=-1)


def terminal_motion(sampled: "Sampled", terminal: int) -> tuple[np.ndarray, np.ndarray]:
    """How a terminal turns on the body.

    Args:
        sampled: the manoeuvre.
        terminal: its number.

    Returns:
        (k, 3, 3) frames, terminal to body, and (k, 3) rad/s, their angular velocity in body axes.
    """
    craft = sampled.spacecraft
    joints = [terminal, terminal + len(craft.terminals)]
    yaw, pitch = sampled.values.joints[:, joints].T
    yaw_rate, pitch_rate = sampled.values.joint_rates[:, joints].T
    azimuth = yaw + craft.terminals[terminal].mount
    rates = [pitch_rate * np.sin(azimuth), -pitch_rate * np.cos(azimuth), yaw_rate]
    return frames(azimuth, pitch), np.stack(rates, axis=-1)


def instrument_frames(boresights: np.ndarray) -> np.ndarray:
    """Frames of instruments.

    Args:
        boresights: (i, 3) unit vectors in body axes.

    Returns:
        (i, 3, 3) instrument to body; one along the body's z axis has its y axis along the body's.
    """
    return frames(*azimuth_elevation(boresights))


def labels(names: Iterable[str], taken: Iterable[str], longest: int) -> list[str]:
    """Short names of letters, digits, ``-`` and ``_`` that differ also where case does not count.

    Args:
        names: any text, such as names of devices.
        taken: what they must not be.
        longest: characters.

    Returns:
        For each name itself with other characters made ``_``, or ``device_3`` where that is too long, empty
        or taken.
    """
    used = {name.lower() for name in taken}
    result = []
    for number, name in enumerate(names, start=1):
        label = re.sub(r"[^A-Za-z0-9_-]", "_", name)
        spare = (f"device_{k}" for k in range(number, 10**9))
        while not label.strip("_-") or len(label) > longest or label.lower() in used:
            label = next(spare)
        used.add(label.lower())
        result.append(label)
    return result
