"""Peaks of a trajectory over all time, and the uniform time scaling that brings them to their limits.

Slowing a motion leaves its geometry as it is, and every limited quantity falls by a power of the factor on
time (`jaxplan.model.limits`). So the shortest uniform scaling within all limits follows from the peaks of one
curve, exactly.

The peaks are maxima over continuous time (`maxima`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxplan.model.limits import Limit, time_factor, timed_limits
from jaxplan.model.spacecraft import Spacecraft
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
        return float(np.max(self.time_factors, initial=0.0))

    @property
    def binding(self) -> int:
        """Index of the quantity that asks for the longest time."""
        return int(np.argmax(self.time_factors))

    @property
    def time_factors(self) -> np.ndarray:
        """(Q,) factors on time at which each limit is just met."""
        return np.asarray(time_factor(self.ratios, self.powers))


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
    limited = [timed_limits(craft) for _, craft in curves]
    names = [tuple(limit.quantity.name for limit in platform) for platform, _ in limited]
    platform = all_largest(platform_loads([(*own, its) for own, its in zip(curves, names, strict=True)]))
    joints = all_largest([joint_loads(curve) for curve, _ in curves])
    crafts = [craft for _, craft in curves]
    return [_shares(*own) for own in zip(crafts, limited, platform, joints, strict=True)]


def _shares(
    craft: Spacecraft,
    limited: tuple[tuple[Limit, ...], tuple[Limit, ...]],
    platform: np.ndarray,
    joints: np.ndarray,
) -> Peaks:
    """Peaks from the largest magnitudes of the platform's limited quantities (3 Q,) and of joints (6n,)."""
    angles, *of_joints = np.split(joints, 3)
    largest = [*platform.reshape(-1, 3), *(of_joints[limit.quantity.power - 1] for limit in limited[1])]
    every = [limit for group in limited for limit in group]
    return Peaks(
        names=tuple(name for limit in every for name in limit.names),
        ratios=np.concatenate([own / limit.bound for own, limit in zip(largest, every, strict=True)]),
        powers=np.concatenate([np.full(len(limit.bound), limit.quantity.power) for limit in every]),
        in_range=bool(np.all(angles <= (1 + _ROUNDING) * craft.joint_limits)),
    )
