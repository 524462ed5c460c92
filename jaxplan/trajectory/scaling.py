"""Peaks of a trajectory over all time, and the uniform time scaling that brings them to their limits.

Slowing a motion by a factor ``s`` leaves its geometry as it is. Rates and the angular momentum ``J omega``
fall by ``s``; accelerations and the torque ``J omega' + omega x J omega`` by ``s^2``; the jerk by ``s^3``.
So the shortest uniform scaling within all limits follows from the peaks of one curve, exactly.

The peaks are maxima over continuous time (`maxima`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan.spacecraft import Spacecraft
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.loads import joint_loads, platform_loads
from jaxplan.trajectory.maxima import all_largest

SAFETY = 1 + 1e-6  # on time, beyond what the peaks ask for, so that an independent proof has room

_ROUNDING = 1e-9  # beyond a joint's range, at whose very end a node may be


@dataclass(frozen=True, kw_only=True, eq=False)
class Peaks:
    """The largest share of each limit that a trajectory takes.

    Attributes:
        names: of the quantities, such as ``platform rate x`` or ``terminal-1 yaw acceleration``.
        ratios: (Q,) largest magnitude over limit.
        powers: (Q,) the ratio falls by this power of the time scaling.
        in_range: whether every joint stays within its angles, on which time has no influence.
    """

    names: tuple[str, ...]
    ratios: np.ndarray
    powers: np.ndarray
    in_range: bool

    @property
    def stretch(self) -> float:
        """Factor on time at which the first limit is just met; NaN if a peak is not a number."""
        return float(np.max(self.ratios ** (1 / self.powers), initial=0.0))

    @property
    def binding(self) -> int:
        """Index of the quantity that asks for the longest time."""
        return int(np.argmax(self.ratios ** (1 / self.powers)))


def peaks(trajectory: Trajectory, spacecraft: Spacecraft) -> Peaks:
    """Peaks over limits of all quantities that the spacecraft limits.

    Args:
        trajectory: of positive duration.
        spacecraft: its limits; a torque or momentum limit needs its inertia.

    Returns:
        Platform first, then the joints.
    """
    return all_peaks([(trajectory, spacecraft)])[0]


def all_peaks(curves: Sequence[tuple[Trajectory, Spacecraft]]) -> list[Peaks]:
    """`peaks` of many trajectories; each has those that it has alone, to the last bit."""
    limited = [_limits(craft) for _, craft in curves]
    asked = [(*own, tuple(loads)) for own, loads in zip(curves, limited, strict=True)]
    platform = all_largest(platform_loads(asked))
    joints = all_largest([joint_loads(curve) for curve, _ in curves])
    return [
        _shares(curves[number][1], loads, platform[number], joints[number])
        for number, loads in enumerate(limited)
    ]


def _limits(spacecraft: Spacecraft) -> dict[str, tuple[Any, int]]:
    """Limits of the platform's loads by name, and the power of the time scaling by which each load falls."""
    limited = {
        "rate": (spacecraft.rate_limit, 1),
        "acceleration": (spacecraft.acceleration_limit, 2),
        "jerk": (spacecraft.jerk_limit, 3),
        "torque": (spacecraft.torque_limit, 2),
        "momentum": (spacecraft.wheel_momentum_limit, 1),
    }
    return {load: own for load, own in limited.items() if own[0] is not None}


def _shares(
    spacecraft: Spacecraft, limited: dict[str, tuple[Any, int]], platform: np.ndarray, joints: np.ndarray
) -> Peaks:
    """Peaks from the largest magnitudes of platform (3 Q,) and joints (6n,)."""
    names, ratios, powers = [], [], []
    for (load, (limit, power)), highest in zip(limited.items(), platform.reshape(-1, 3), strict=True):
        names += [f"platform {load} {axis}" for axis in "xyz"]
        ratios.append(highest / limit)
        powers += [power] * 3
    names += [f"{joint} {load}" for load in ("rate", "acceleration") for joint in spacecraft.joint_names]
    joint_limits = np.concatenate([spacecraft.joint_rate_limits, spacecraft.joint_acceleration_limits])
    angles, *rates = np.split(joints, 3)
    ratios.append(np.concatenate(rates) / joint_limits)
    powers += [1] * len(angles) + [2] * len(angles)
    in_range = bool(np.all(angles <= (1 + _ROUNDING) * spacecraft.joint_limits))
    return Peaks(
        names=tuple(names), ratios=np.concatenate(ratios), powers=np.array(powers), in_range=in_range
    )
