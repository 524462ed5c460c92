"""Peaks of a trajectory over all time, and the uniform time scaling that brings them to their limits.

Slowing a motion by a factor ``s`` leaves its geometry as it is. Rates and the angular momentum ``J omega``
fall by ``s``; accelerations and the torque ``J omega' + omega x J omega`` by ``s^2``; the jerk by ``s^3``.
So the shortest uniform scaling within all limits follows from the peaks of one curve, exactly.

The peaks are maxima over continuous time. On a piece every quantity is smooth, so its interpolant on
Chebyshev points (which include both ends, where jerks jump) is the quantity itself but for rounding. As a
function of ``theta = arccos(x)`` it is a cosine sum without edges: every maximum over the piece is a
stationary point, and Newton's method finds it from the nearest point of a fine grid.
"""

from collections.abc import Callable
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
from jaxplan.trajectory.curve import Trajectory

SAFETY = 1 + 1e-6  # on time, beyond what the peaks ask for, so that an independent proof has room

_BLOCK = 16  # pieces that are looked at in one call
_FINE = 4  # grid intervals in theta for each point; then a grid maximum is within 8 % of the true one
_NEAR = 0.9  # grid maxima above this share of the highest are followed
_NEWTON_STEPS = 12
_STILL = 1e-9  # rad of theta; a maximum is flat, so its value is off by the square of it
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
    limited = {
        "rate": (spacecraft.rate_limit, 1),
        "acceleration": (spacecraft.acceleration_limit, 2),
        "jerk": (spacecraft.jerk_limit, 3),
        "torque": (spacecraft.torque_limit, 2),
        "momentum": (spacecraft.wheel_momentum_limit, 1),
    }
    limited = {load: own for load, own in limited.items() if own[0] is not None}
    inertia = np.zeros((3, 3)) if spacecraft.inertia is None else np.asarray(spacecraft.inertia, float)
    asked = tuple(limited)
    loads = _in_blocks(lambda pieces: _platform_loads(pieces, inertia, asked), trajectory.platform_pieces)
    breaks = trajectory.joint_breaks
    joint_pieces = breaks[:-1], breaks[1:], trajectory.joint_coefficients
    joint_loads = _in_blocks(lambda pieces: _joint_loads(*pieces), joint_pieces)
    names, ratios, powers = [], [], []
    platform_peaks = largest(loads.reshape(*loads.shape[:2], -1)).reshape(-1, 3)
    for (load, (limit, power)), highest in zip(limited.items(), platform_peaks, strict=True):
        names += [f"platform {load} {axis}" for axis in "xyz"]
        ratios.append(highest / limit)
        powers += [power] * 3
    names += [f"{joint} {load}" for load in ("rate", "acceleration") for joint in spacecraft.joint_names]
    joint_limits = np.concatenate([spacecraft.joint_rate_limits, spacecraft.joint_acceleration_limits])
    angles, *rates = np.split(largest(joint_loads), 3)
    ratios.append(np.concatenate(rates) / joint_limits)
    powers += [1] * len(angles) + [2] * len(angles)
    in_range = bool(np.all(angles <= (1 + _ROUNDING) * spacecraft.joint_limits))
    return Peaks(
        names=tuple(names), ratios=np.concatenate(ratios), powers=np.array(powers), in_range=in_range
    )


def _in_blocks(kernel: Callable[[Any], Array], stacked: Any) -> np.ndarray:
    """Answers of a kernel for all pieces, a block at a time, so that it is compiled once for any number."""
    count = len(jax.tree.leaves(stacked)[0])
    found = []
    with jax.enable_x64(True):
        for first in range(0, count, _BLOCK):
            own = np.minimum(np.arange(first, first + _BLOCK), count - 1)
            found.append(
                np.asarray(kernel(jax.tree.map(lambda array, own=own: np.asarray(array)[own], stacked)))
            )
    return np.concatenate(found)[:count]


def largest(values: np.ndarray) -> np.ndarray:
    """Largest magnitudes over all pieces, between the points as well.

    Args:
        values: (N, G, Q) at the Chebyshev points ``cos(pi j / (G - 1))`` of each piece.

    Returns:
        (Q,); all NaN if a value is not finite.
    """
    count, points, quantities = values.shape
    if not np.all(np.isfinite(values)):
        return np.full(quantities, np.nan)
    to_series, to_fine = _chebyshev(points)
    # From here on one column is one quantity on one piece.
    series = np.tensordot(to_series, values, axes=(1, 1)).reshape(points, count * quantities)
    fine = np.abs(to_fine @ series)
    highest = fine.max(axis=0).reshape(count, quantities).max(axis=0)
    peaked = fine > 0
    peaked[1:] &= fine[1:] > fine[:-1]
    peaked[:-1] &= fine[:-1] >= fine[1:]
    row, column = np.nonzero(peaked & (fine >= np.tile(_NEAR * highest, count)))
    followed = _follow(series[:, column].T, row * np.pi / (len(fine) - 1), np.pi / (len(fine) - 1))
    np.maximum.at(highest, column % quantities, followed)
    return highest


def _follow(sums: np.ndarray, theta: np.ndarray, reach: float) -> np.ndarray:
    """Local maxima of the magnitudes of cosine sums, by Newton's method within a shrinking bracket.

    Args:
        sums: (c, G) coefficients.
        theta: (c,) where each is near its maximum.
        reach: half the first bracket.

    Returns:
        (c,) magnitudes.
    """
    k = np.arange(sums.shape[1])
    sums = sums * np.sign(np.sum(sums * np.cos(np.outer(theta, k)), axis=1))[:, None]
    first = sums * k
    second = first * k
    theta, lower, upper = theta.copy(), theta - reach, theta + reach
    moving = np.arange(len(theta))
    for _ in range(_NEWTON_STEPS):
        at = theta[moving]
        angle = np.outer(at, k)
        slope = -np.einsum("ck,ck->c", first[moving], np.sin(angle))
        curvature = -np.einsum("ck,ck->c", second[moving], np.cos(angle))
        lower[moving] = np.where(slope > 0, at, lower[moving])
        upper[moving] = np.where(slope > 0, upper[moving], at)
        ahead = at - slope / np.where(curvature < 0, curvature, -1)
        sound = (curvature < 0) & (lower[moving] <= ahead) & (ahead <= upper[moving])
        theta[moving] = np.where(sound, ahead, (lower[moving] + upper[moving]) / 2)
        moving = moving[np.abs(theta[moving] - at) > _STILL]
        if not len(moving):
            break
    return np.abs(np.einsum("ck,ck->c", sums, np.cos(np.outer(theta, k))))


@cache
def _chebyshev(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices from values at Chebyshev points to a cosine sum, and from that to a fine grid in theta."""
    k = np.arange(points)
    halved_ends = np.ones(points)
    halved_ends[[0, -1]] = 0.5
    cosines = np.cos(np.pi * np.outer(k, k) / (points - 1))
    to_series = 2 / (points - 1) * halved_ends[:, None] * cosines * halved_ends
    return to_series, np.cos(np.outer(np.linspace(0, np.pi, _FINE * points + 1), k))


@partial(jax.jit, static_argnames="wanted")
def _platform_loads(stacked: pieces.Piece, inertia: Array, wanted: tuple[str, ...]) -> Array:
    """(N, G, Q, 3) the loads wanted, at the Chebyshev points of every piece."""
    count, size, _ = jnp.shape(stacked.coefficients)
    points = 4 * size + 13  # the attitude's exponentials add to the polynomials' degree
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


@jax.jit
def _joint_loads(starts: Array, ends: Array, coefficients: Array) -> Array:
    """(M, G, 6n) angles, rates and accelerations of joints at the Chebyshev points of every piece."""
    count, points, _ = coefficients.shape  # as many as the polynomials have coefficients
    start, end, c = (jnp.repeat(array, points, axis=0) for array in (starts, ends, coefficients))
    t = _chebyshev_times(starts, ends, points)
    curves = pieces.polynomial(c, start, end, t)
    return jnp.concatenate(curves[:3], axis=-1).reshape(count, points, -1)


def _chebyshev_times(start: ArrayLike, end: ArrayLike, points: int) -> Array:
    """Times of the Chebyshev points of all pieces, flat."""
    start, length = jnp.asarray(start), jnp.asarray(end) - jnp.asarray(start)
    fractions = (jnp.cos(jnp.pi * jnp.arange(points) / (points - 1)) + 1) / 2
    return (start[:, None] + length[:, None] * fractions).reshape(-1)
