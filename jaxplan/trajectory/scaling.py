"""Peaks of a trajectory over all time, and the uniform time scaling that brings them to their limits.

Slowing a motion by a factor ``s`` leaves its geometry as it is. Rates and the angular momentum ``J omega``
fall by ``s``; accelerations and the torque ``J omega' + omega x J omega`` by ``s^2``; the jerk by ``s^3``.
So the shortest uniform scaling within all limits follows from the peaks of one curve, exactly.

The peaks are maxima over continuous time (`maxima`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.spacecraft import Spacecraft
from jaxplan.trajectory import pieces
from jaxplan.trajectory.basis import derivative_matrix
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.maxima import all_largest, is_resolved

SAFETY = 1 + 1e-6  # on time, beyond what the peaks ask for, so that an independent proof has room

_ORDERS = np.arange(3)[:, None, None]
_FEW, _BLOCK = 4, 16  # pieces that are looked at in one call, of few and of many
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
    platform = all_largest(
        [_platform_values(*own, tuple(loads)) for own, loads in zip(curves, limited, strict=True)]
    )
    joints = all_largest([_joint_values(curve) for curve, _ in curves])
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


def _platform_values(trajectory: Trajectory, spacecraft: Spacecraft, asked: tuple[str, ...]) -> np.ndarray:
    """(N, G, 3 Q) the loads asked for, at the Chebyshev points of every piece."""
    inertia = np.zeros((3, 3)) if spacecraft.inertia is None else np.asarray(spacecraft.inertia, float)
    stacked, size = trajectory.platform_pieces, trajectory.coefficients.shape[1]

    def at(points: int) -> np.ndarray:
        loads = _in_blocks(lambda block: _platform_loads(block, inertia, asked, points), stacked)
        return loads.reshape(*loads.shape[:2], -1)

    # The attitude's exponentials add to the polynomials' degree: little where pieces are short.
    many = len(trajectory.coefficients) > 2 * _FEW
    values = at(size + 7 if many else 3 * size + 1)
    return values if is_resolved(values) else at(4 * size + 13)


def _joint_values(trajectory: Trajectory) -> np.ndarray:
    """(M, G, 6n) angles, rates and accelerations of joints, at the Chebyshev points of every piece."""
    lengths, coefficients = np.diff(trajectory.joint_breaks), trajectory.joint_coefficients
    count, size, joints = coefficients.shape
    # A product a piece, so that none depends on how many there are.
    curves = _derivatives(size) @ coefficients
    curves = curves.reshape(count, 3, size, joints) * (2 / lengths)[:, None, None, None] ** _ORDERS
    return np.ascontiguousarray(np.moveaxis(curves, 1, 2)).reshape(count, size, 3 * joints)


@cache
def _derivatives(size: int) -> np.ndarray:
    """(3 size, size): a polynomial and two derivatives at Chebyshev points, from Legendre coefficients."""
    points = np.cos(np.pi * np.arange(size) / (size - 1))
    values = np.polynomial.legendre.legvander(points, size - 1)
    matrix = derivative_matrix(size - 1)
    found = np.concatenate([values @ np.linalg.matrix_power(matrix, order) for order in range(3)])
    found.flags.writeable = False
    return found


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


def _in_blocks(kernel: Callable[[Any], Array], stacked: Any) -> np.ndarray:
    """Answers of a kernel for all pieces, a block at a time, so that it is compiled for two sizes."""
    count = len(jax.tree.leaves(stacked)[0])
    block = _FEW if count <= 2 * _FEW else _BLOCK
    found = []
    with jax.enable_x64(True):
        for first in range(0, count, block):
            own = np.minimum(np.arange(first, first + block), count - 1)
            found.append(
                np.asarray(kernel(jax.tree.map(lambda array, own=own: np.asarray(array)[own], stacked)))
            )
    return np.concatenate(found)[:count]


@partial(jax.jit, static_argnames=("wanted", "points"))
def _platform_loads(stacked: pieces.Piece, inertia: Array, wanted: tuple[str, ...], points: int) -> Array:
    """(N, points, Q, 3) the loads wanted, at the Chebyshev points of every piece."""
    count = jnp.shape(stacked.coefficients)[0]
    own = jax.tree.map(lambda array: jnp.repeat(array, points, axis=0), stacked)
    _, rate, acceleration, jerk = pieces.platform(own, _chebyshev_times(stacked.start, stacked.end, points))
    momentum = rate @ inertia.T
    torque = acceleration @ inertia.T + jnp.cross(rate, momentum)
    loads = {
        "rate": rate,
        "acceleration": acceleration,
        "jerk": jerk,
        "torque": torque,
        "momentum": momentum,
    }
    chosen = jnp.stack([loads[name] for name in wanted], axis=1)
    return chosen.reshape(count, points, len(wanted), 3)


def _chebyshev_times(start: ArrayLike, end: ArrayLike, points: int) -> Array:
    """Times of the Chebyshev points of all pieces, flat."""
    start, length = jnp.asarray(start), jnp.asarray(end) - jnp.asarray(start)
    fractions = (jnp.cos(jnp.pi * jnp.arange(points) / (points - 1)) + 1) / 2
    return (start[:, None] + length[:, None] * fractions).reshape(-1)
