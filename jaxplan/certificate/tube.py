"""How much errors of attitude and joints, and reserves, take off margins and limits in a certificate.

The certificate's own writing. A turn of the platform by at most ``e`` moves each direction of the body by at
most ``e``. Turns of a terminal's yaw and pitch by ``q`` move what it carries by the turn that both make
together: about axes at right angles, as unit quaternions ``(cos, sin z)`` and ``(cos, sin y)`` of ``q / 2``.
By the triangle inequality such angles add up, and a margin falls by their sum. Seen from the body nothing of
the platform's turn is left, and where the same joints carry both directions nothing of theirs either.
"""

from collections.abc import Iterator

import numpy as np

from jaxplan.model.constraints import INERTIAL, JOINTS, SIGHT, Constraints
from jaxplan.model.robust import Robust
from jaxplan.model.spacecraft import Spacecraft

_BODY = -1  # number of what carries a sight that no joint turns
_MOST = (np.pi / 2, np.pi / 2, 100.0, 100.0)  # above the errors, rad, and the reserves, percent
_ANGLES = ("yaw", "pitch", "drive")
_TORQUES, _MOMENTA = ("torque", "wheel_torques"), ("wheel_momentum", "wheel_momenta")


def losses(robust: Robust, craft: Spacecraft, cones: Constraints) -> np.ndarray:
    """The angles (Z, S) rad by which errors lower the margin of each sight to each row of constraints."""
    carrier, swing = _carriers(robust, craft, cones)
    frame = cones.frame[:, None]
    other = np.where(frame == SIGHT, carrier[cones.partner.astype(int)][:, None], _BODY)
    both = np.where((frame == SIGHT) & (carrier == other), 0, swing[carrier] + swing[other])
    lost = both + np.where(frame == INERTIAL, float(robust.attitude_error), 0)
    of_joints = float(robust.joint_error) * np.abs(cones.axis[:, :2]).sum(axis=1)
    return np.where(frame == JOINTS, of_joints[:, None], lost)


def _carriers(robust: Robust, craft: Spacecraft, cones: Constraints) -> tuple[np.ndarray, np.ndarray]:
    """Devices (S,) that carry the sights, by number, `_BODY` for the body; and each device's swing, rad."""
    half = float(robust.joint_error) / 2
    cosine, sine = np.cos(half), np.sin(half)
    vector = np.array([sine * sine, cosine * sine, sine * cosine])  # of the product of both quaternions
    both = 2 * np.arctan2(np.linalg.norm(vector), cosine * cosine)
    swing = [both] * len(craft.terminals) + [float(robust.joint_error)] * len(craft.drives) + [0.0]
    gimbals, still = len(swing) - 1, len(craft.instruments) + len(cones.body)
    carrier = np.concatenate([np.arange(gimbals), np.full(still, _BODY), cones.carrier]).astype(int)
    return carrier, np.array(swing)


def left(robust: Robust | None, name: str, bound: np.ndarray) -> np.ndarray:
    """Limits (c,) of a quantity, given by its name, after errors and reserves are taken off; SI units."""
    if robust is None:
        return bound
    if name in _ANGLES:
        return bound - float(robust.joint_error)
    if name in _TORQUES:
        return bound * (100 - float(robust.torque_reserve)) / 100
    return bound * (100 - float(robust.momentum_reserve)) / 100 if name in _MOMENTA else bound


def numbers(robust: Robust | None) -> tuple[float, ...]:
    """The errors, rad, and the reserves, percent; none without."""
    if robust is None:
        return ()
    errors = float(robust.attitude_error), float(robust.joint_error)
    return *errors, float(robust.torque_reserve), float(robust.momentum_reserve)


def faults(robust: Robust | None, craft: Spacecraft, cones: Constraints, names: list[str]) -> Iterator[str]:
    """Yield a sentence for each error that is none, and for what no tube leaves anything of.

    Args:
        robust: the errors.
        craft: the spacecraft, whose form is good.
        cones: the constraints, whose form is good.
        names: of zones, by row.
    """
    if robust is None:
        return
    own = numbers(robust)
    if not all(0 <= number < most for number, most in zip(own, _MOST, strict=True)):
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
