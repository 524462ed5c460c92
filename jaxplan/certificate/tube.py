"""How much errors of attitude and joints, and reserves, take off margins and limits in a certificate.

This repeats `jaxplan.model.robust` independently, for the certificate alone. A turn of the platform by at
most ``e`` moves each direction of the body by at most ``e``. If a terminal's yaw and pitch are each off by
``q``, what it carries is turned by the product of two rotations about axes at right angles, with unit
quaternions ``(cos, sin z)`` and ``(cos, sin y)`` of ``q / 2``. The angle of that product is the device's
*swing*; a drive's swing is ``q``. By the triangle inequality such angles add up, and a margin falls by their
sum. As seen from the body, the platform's turn has no effect, and where the same joints carry both
directions, neither have those.
"""

from collections.abc import Iterator

import numpy as np

from jaxplan.model.constraints import INERTIAL, JOINTS, SIGHT, Constraints
from jaxplan.model.robust import Robust
from jaxplan.model.spacecraft import Spacecraft

_BODY_INDEX = -1  # stands for the body among the devices that carry sights
_UPPER_BOUNDS = (np.pi / 2, np.pi / 2, 100.0, 100.0)  # of both errors, rad, and both reserves, percent
_ANGLES = ("yaw", "pitch", "drive")
_TORQUES, _MOMENTA = ("torque", "wheel_torques"), ("wheel_momentum", "wheel_momenta")


def losses(robust: Robust, craft: Spacecraft, cones: Constraints) -> np.ndarray:
    """Return the angles (Z, S) rad by which errors lower the margin of each of S sights to each of Z rows."""
    carrier, swing = _carriers_and_swings(robust, craft, cones)
    frame = cones.frame[:, None]
    other = np.where(frame == SIGHT, carrier[cones.partner.astype(int)][:, None], _BODY_INDEX)
    both = np.where((frame == SIGHT) & (carrier == other), 0, swing[carrier] + swing[other])
    lost = both + np.where(frame == INERTIAL, float(robust.attitude_error), 0)
    of_joints = float(robust.joint_error) * np.abs(cones.axis[:, :2]).sum(axis=1)
    return np.where(frame == JOINTS, of_joints[:, None], lost)


def _carriers_and_swings(
    robust: Robust, craft: Spacecraft, cones: Constraints
) -> tuple[np.ndarray, np.ndarray]:
    """Return the devices that carry the sights, and the swing of each device.

    Returns:
        (S,) int, indices of devices with joints, or `_BODY_INDEX` for sights that no joint turns. Swings,
        rad, of all devices with joints, then zero for the body, where `_BODY_INDEX` finds it.
    """
    half = float(robust.joint_error) / 2
    cosine, sine = np.cos(half), np.sin(half)
    vector = np.array([sine * sine, cosine * sine, sine * cosine])  # part of the product of both quaternions
    both = 2 * np.arctan2(np.linalg.norm(vector), cosine * cosine)
    swing = [both] * len(craft.terminals) + [float(robust.joint_error)] * len(craft.drives) + [0.0]
    gimbals, still = len(swing) - 1, len(craft.instruments) + len(cones.body)
    carrier = np.concatenate([np.arange(gimbals), np.full(still, _BODY_INDEX), cones.carrier]).astype(int)
    return carrier, np.array(swing)


def left(robust: Robust | None, name: str, bound: np.ndarray) -> np.ndarray:
    """Return limits (c,) less what errors and reserves take off them; unchanged if `robust` is None.

    Args:
        robust: the errors and reserves.
        name: name of the limited quantity, as in `jaxplan.model.limits`.
        bound: (c,) limits in SI units.
    """
    if robust is None:
        return bound
    if name in _ANGLES:
        return bound - float(robust.joint_error)
    if name in _TORQUES:
        return bound * (100 - float(robust.torque_reserve)) / 100
    return bound * (100 - float(robust.momentum_reserve)) / 100 if name in _MOMENTA else bound


def numbers(robust: Robust | None) -> tuple[float, ...]:
    """Return both errors, rad, and both reserves, percent; an empty tuple for None."""
    if robust is None:
        return ()
    errors = float(robust.attitude_error), float(robust.joint_error)
    return *errors, float(robust.torque_reserve), float(robust.momentum_reserve)


def faults(robust: Robust | None, craft: Spacecraft, cones: Constraints, names: list[str]) -> Iterator[str]:
    """Yield a sentence for errors or reserves out of range, and for each joint range or zone used up by them.

    Args:
        robust: the errors and reserves; None for no faults.
        craft: the spacecraft, whose form has been checked.
        cones: the constraints, whose form has been checked.
        names: names of zones, by row.
    """
    if robust is None:
        return
    own = numbers(robust)
    if not all(0 <= number < most for number, most in zip(own, _UPPER_BOUNDS, strict=True)):
        told = f"errors of {own[0]:g} and {own[1]:g} rad, reserves of {own[2]:g} and {own[3]:g} percent"
        yield f"robust has {told}"
        return
    for name, (low, high) in zip(craft.joint_names, craft.joint_ranges, strict=True):
        if not high - low > 2 * own[1]:
            yield f"robust leaves nothing of the range of {name}"
    row, sight = np.nonzero(cones.bound)
    angle = cones.half_angle[row] + cones.side[row] * losses(robust, craft, cones)[row, sight]
    gone = (cones.frame[row] != JOINTS) & ~((angle > 0) & (angle < np.pi))
    yield from (f"robust leaves nothing of zone {names[number]}" for number in np.unique(row[gone]))
