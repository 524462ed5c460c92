"""Peaks of a trajectory over all time, and the uniform time scaling that brings them to their limits.

Slowing a motion leaves its geometry as it is, and every limited quantity falls by a power of the factor on
time (`jaxplan.model.limits`). So the shortest uniform scaling within all limits follows from the peaks of one
curve, exactly.

The peaks are maxima over continuous time. On a piece every quantity is smooth, so its interpolant on
Chebyshev points (which include both ends, where jerks jump) is the quantity itself but for rounding. As a
function of ``theta = arccos(x)`` it is a cosine sum without edges: every maximum over the piece is a
stationary point, and Newton's method finds it from the maximum of a fine grid beside it. One so narrow that
no grid maximum is beside it would be missed; the certificate, which shares nothing with this, has the last
word.

Rates of the platform at very many points are computed by cross products in numpy: the same formulas as in
`curve.chart_motion` (equations 25 to 29), but not differentiable. With ``E = exp(eta^)``, and
``U = exp(tau Omega^ / 2)``, which leaves ``Omega`` as it is,

    omega  = U^T v,                     v  = (Omega + E^T Omega) / 2 + w,   w = D(eta) eta',
    omega' = U^T (v' - Omega x v / 2),  v' = w' - w x (E^T Omega) / 2.

All is analytic in time, so a step of it along the imaginary axis tells the next derivative to the last digit.
The length of a vector is not where it is zero; its square is, and of that the maxima are looked for.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from jaxplan.geometry import vectors
from jaxplan.geometry.vectors import dot
from jaxplan.model.limits import (
    Kinematics,
    Limit,
    are_lengths,
    components,
    highest_derivative,
    time_factor,
    timed_limits,
    values,
)
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.batching import in_groups
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.splines import derivative_matrix

SAFETY = 1 + 1e-6  # on time, beyond what the peaks ask for, so that an independent proof has room

_ROUNDING = 1e-9  # beyond a joint's range, at whose very end a node may be

_FEW = 8  # pieces; where a trajectory has more they are short
_POINTS = 4096  # points computed together, so that intermediate results stay in the processor's cache
_CURVES = 16  # curves whose maxima are looked for together, for the same reason
_RESOLVED = 1e-10  # of the largest term of a quantity's cosine sums; smaller last terms are next to nothing

_FINE = 4  # grid intervals in theta for each point
_NEWTON_STEPS = 12  # at most, from the grid to a maximum
_STILL = 1e-9  # rad of theta; a maximum is flat, so its value is off by the square of it

_SMALL = 0.05  # rad^2, below which series are used
_ZERO = 1e-300  # rad^2
_STEP = 1e-30  # s, along the imaginary axis

Asked = tuple[Trajectory, Spacecraft, tuple[str, ...]]
"""A trajectory of positive duration, its spacecraft, and names of the quantities asked for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Peaks:
    """The largest share of each limit that a trajectory uses.

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
    """Peaks of a trajectory, over their limits, of all quantities that the spacecraft limits.

    Args:
        trajectory: of positive duration.
        spacecraft: its limits; a torque or momentum limit needs its inertia.

    Returns:
        The peaks, of the platform first, then of the joints.
    """
    return all_peaks([(trajectory, spacecraft)])[0]


def all_peaks(curves: Sequence[tuple[Trajectory, Spacecraft]]) -> list[Peaks]:
    """`peaks` of many trajectories."""
    limits = [timed_limits(craft) for _, craft in curves]
    names = [tuple(limit.quantity.name for limit in of_platform) for of_platform, _ in limits]
    loads = _platform_loads([(*curve, own) for curve, own in zip(curves, names, strict=True)])
    platform = [
        np.where(are_lengths(own), np.sqrt(found), found)
        for own, found in zip(names, largest(loads), strict=True)
    ]
    joints = largest([_joint_values(*curve) for curve in curves])
    crafts = [craft for _, craft in curves]
    return [_shares(*own) for own in zip(crafts, limits, platform, joints, strict=True)]


def _shares(
    craft: Spacecraft,
    limits: tuple[tuple[Limit, ...], tuple[Limit, ...]],
    platform: np.ndarray,
    joints: np.ndarray,
) -> Peaks:
    """Peaks from the largest magnitudes of the platform's limited quantities (C,) and of joints (3J,)."""
    angles, *of_joints = np.split(joints, 3)
    of_platform = (platform[own] for own in components(limit.quantity.name for limit in limits[0]))
    largest = [*of_platform, *(of_joints[limit.quantity.power - 1] for limit in limits[1])]
    every = [*limits[0], *limits[1]]
    return Peaks(
        names=tuple(name for limit in every for name in limit.names),
        ratios=np.concatenate([own / limit.bound for own, limit in zip(largest, every, strict=True)]),
        powers=np.concatenate([np.full(len(limit.bound), limit.quantity.power) for limit in every]),
        in_range=bool(np.all(angles <= (1 + _ROUNDING) * np.diff(craft.joint_ranges)[:, 0] / 2)),
    )


def _platform_loads(asked: Sequence[Asked]) -> list[np.ndarray]:
    """Loads of the platform along trajectories, C components of its limited quantities.

    Args:
        asked: each with names of quantities of the platform.

    Returns:
        For each (N, G, C), at G Chebyshev points of each of its N pieces, enough to interpolate between them;
        of quantities that are a vector's length, its square.
    """

    def at_points(some: Sequence[Asked], points: Sequence[int]) -> list[np.ndarray]:
        return in_groups(
            list(zip(some, points, strict=True)),
            lambda one: (one[1], one[0][0].coefficients.shape[1], one[0][2]),
            lambda alike: _loads_at([own for own, _ in alike], alike[0][1]),
        )

    # The attitude's exponentials add to the polynomials' degree: little where pieces are short.
    sizes = [curve.coefficients.shape for curve, _, _ in asked]
    found = at_points(asked, [size + 7 if count > _FEW else 3 * size + 1 for count, size, _ in sizes])
    again = [number for number, own in enumerate(found) if not is_resolved(own)]
    more = at_points([asked[number] for number in again], [4 * sizes[number][1] + 13 for number in again])
    for number, own in zip(again, more, strict=True):
        found[number] = own
    return found


def _joint_values(trajectory: Trajectory, craft: Spacecraft) -> np.ndarray:
    """(M, G, 3J) values at G Chebyshev points of each of M pieces of the joints' motion.

    They are the J angles off the middle of their ranges (rad), then the rates, then the accelerations.
    """
    coefficients = trajectory.joint_coefficients
    count, size, joints = coefficients.shape
    curves = _curves(coefficients, np.diff(trajectory.joint_breaks), size, 3)
    curves[:, 0] -= np.mean(craft.joint_ranges, axis=-1)
    return np.ascontiguousarray(np.moveaxis(curves, 1, 2)).reshape(count, size, 3 * joints)


def _loads_at(asked: Sequence[Asked], points: int) -> list[np.ndarray]:
    """`_platform_loads` of trajectories with the same degree and names, at so many Chebyshev points."""
    trajectories, names = [curve for curve, _, _ in asked], asked[0][2]
    coefficients = np.concatenate([own.coefficients for own in trajectories])
    chart_rate = np.concatenate([own.chart_rate for own in trajectories])
    length = np.concatenate([np.diff(own.breaks) for own in trajectories])
    since = np.concatenate([own.breaks[:-1] - own.chart_start for own in trajectories])
    counts = [len(own.coefficients) for own in trajectories]
    given = [np.zeros((3, 3)) if craft.inertia is None else craft.inertia for _, craft, _ in asked]
    inertia = np.repeat(np.array(given, float), counts, axis=0)
    shares, orders = (_chebyshev(points) + 1) / 2, 1 + max(highest_derivative(names), 2)
    block = max(1, _POINTS // points)
    squared = are_lengths(names)
    found = np.empty((len(length), points, len(squared)))
    for first in range(0, len(length), block):
        part = slice(first, first + block)
        b = _curves(coefficients[part], length[part], points, orders)
        with np.errstate(invalid="ignore", over="ignore"):  # what is no number is found by who asks
            spin = rates(
                np.repeat(chart_rate[part].T, points, axis=1),
                (since[part, None] + length[part, None] * shares).reshape(-1),
                np.ascontiguousarray(np.moveaxis(b, (1, 3), (0, 1))).reshape(orders, 3, -1),
            )
            own = np.repeat(np.moveaxis(inertia[part], 0, 2), points, axis=2)
            loads = np.asarray(values(names, Kinematics(spin=spin, inertia=own)))
        loads[squared] *= loads[squared]
        found[part] = loads.T.reshape(-1, points, len(loads))
    return np.split(found, np.cumsum(counts)[:-1])


def _curves(coefficients: np.ndarray, lengths: np.ndarray, points: int, orders: int) -> np.ndarray:
    """(N, orders, points, d) polynomials and derivatives in time at Chebyshev points of N pieces.

    Args:
        coefficients: (N, size, d) in the Legendre basis.
        lengths: (N,) s, of the pieces.
        points: how many on each piece.
        orders: how many derivatives, the polynomials themselves counted.
    """
    count, size, axes = coefficients.shape
    with np.errstate(invalid="ignore", over="ignore"):
        curves = (_rows(size, points, orders) @ coefficients).reshape(count, orders, points, axes)
        scale = np.divide(2, lengths, out=np.zeros(count), where=lengths > 0)  # a piece of no length rests
        return np.asarray(curves * scale[:, None, None, None] ** np.arange(orders)[:, None, None])


@cache
def _rows(size: int, points: int, orders: int) -> np.ndarray:
    """(orders * points, size) from Legendre coefficients to a polynomial and its derivatives in [-1, 1].

    At Chebyshev points, all of the polynomial first, then those of each derivative.
    """
    values = np.polynomial.legendre.legvander(_chebyshev(points), size - 1)
    matrix = derivative_matrix(size - 1)
    found = np.concatenate([values @ np.linalg.matrix_power(matrix, order) for order in range(orders)])
    found.flags.writeable = False
    return found


def _chebyshev(points: int) -> np.ndarray:
    """Chebyshev points (points,) in [-1, 1], from 1 to -1, both included."""
    return np.cos(np.pi * np.arange(points) / (points - 1))


def is_resolved(values: np.ndarray) -> bool:
    """Whether values (N, G, Q) at the Chebyshev points of pieces suffice to interpolate between the points.

    They do where the last terms of the cosine sums are next to nothing; True also where one is not finite.
    """
    series = np.abs(chebyshev(values.shape[1])[0] @ values)
    last, most = (np.max(part, axis=(0, 1), initial=0.0) for part in (series[:, -2:], series))
    return not np.any(last > _RESOLVED * most)


def largest(values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Largest magnitudes of quantities of many curves over all pieces, between the points as well.

    Args:
        values: of each curve (N, G, Q) at the Chebyshev points ``cos(pi j / (G - 1))`` of its pieces.

    Returns:
        (Q,) of each; all NaN if a value is not finite.
    """
    return in_groups(
        values, lambda own: (own.shape[1:], bool(np.isfinite(own).all())), _largest_of, most=_CURVES
    )


def _largest_of(values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """`largest` of values (N, G, Q) with the same G and Q, all of them finite or none."""
    if not np.isfinite(values[0]).all():
        return [np.full(own.shape[2], np.nan) for own in values]
    to_series, to_fine = chebyshev(values[0].shape[1])
    counts = np.array([len(own) for own in values])
    series = np.swapaxes(np.concatenate(values), 1, 2) @ to_series.T  # (N, Q, G)
    heights = np.abs(series @ to_fine.T)  # (N, Q, fine)
    highest = np.maximum.reduceat(heights.max(axis=2), np.cumsum(counts) - counts)
    owner = np.repeat(np.arange(len(values)), counts)
    # Half a step off, a maximum is higher by no more than what the largest second derivative makes of it.
    step = np.pi / (len(to_fine) - 1)
    bends = np.sum(np.abs(series) * np.arange(series.shape[2]) ** 2, axis=2)
    peaked = heights >= (highest[owner] - step**2 / 8 * bends)[:, :, None]
    peaked &= heights > 0
    peaked[..., 1:] &= heights[..., 1:] > heights[..., :-1]
    peaked[..., :-1] &= heights[..., :-1] >= heights[..., 1:]
    piece, quantity, place = np.unravel_index(np.flatnonzero(peaked), peaked.shape)
    followed = _follow(series[piece, quantity], place * step, step)
    np.maximum.at(highest, (owner[piece], quantity), followed)
    return list(highest)


def _follow(sums: np.ndarray, theta: np.ndarray, reach: float) -> np.ndarray:
    """Local maxima of the magnitudes of cosine sums, by Newton's method within a shrinking bracket.

    Args:
        sums: (c, G) coefficients.
        theta: (c,) rad, near the maximum of each.
        reach: half the width of the first bracket, rad.

    Returns:
        (c,) the largest magnitudes there.
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
def chebyshev(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices from values at so many Chebyshev points to a cosine sum (G, G), and from that to a fine grid.

    The grid is even in theta, `_FINE` * G intervals from 0 to pi.
    """
    k = np.arange(points)
    halved_ends = np.ones(points)
    halved_ends[[0, -1]] = 0.5
    cosines = np.cos(np.pi * np.outer(k, k) / (points - 1))
    to_series = 2 / (points - 1) * halved_ends[:, None] * cosines * halved_ends
    return to_series, np.cos(np.outer(np.linspace(0, np.pi, _FINE * points + 1), k))


def rates(chart_rate: np.ndarray, tau: np.ndarray, b: np.ndarray) -> list[np.ndarray]:
    """Angular velocity, angular acceleration and perhaps angular jerk.

    Args:
        chart_rate: (3, n) rad/s, ``Omega``.
        tau: (n,) s since the chart's start.
        b: (k + 1, 3, n) rad, the curve and its first derivatives by time: two, or three for the jerk.

    Returns:
        k arrays (3, n), in rad/s, rad/s^2 and rad/s^3, body axes.
    """
    if len(b) == 3:
        return list(_velocity_and_acceleration(chart_rate, tau, *b))
    ahead = b[:-1] + 1j * _STEP * b[1:]
    velocity, acceleration = _velocity_and_acceleration(chart_rate, tau + 1j * _STEP, *ahead)
    return [velocity.real, acceleration.real, acceleration.imag / _STEP]


def _velocity_and_acceleration(
    chart_rate: np.ndarray, tau: np.ndarray, b: np.ndarray, b_rate: np.ndarray, b_acceleration: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity and acceleration, (3, n) each, see `rates`; also of complex arguments."""
    eta, eta_rate = b - tau * chart_rate, b_rate - chart_rate
    square = dot(eta, eta)
    sine, cosine = _sine_and_cosine(square)
    cubic, cosine_slope, cubic_slope = _further(square, sine, cosine)

    def tangent(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``D x``, with ``eta x x`` and ``eta x (eta x x)``."""
        once = cross(eta, vector)
        twice = cross(eta, once)
        return vector - cosine * once + cubic * twice, once, twice

    once = cross(eta, chart_rate)
    turned = chart_rate - sine * once + cosine * cross(eta, once)  # E^T Omega
    own, once, twice = tangent(eta_rate)  # w
    bend = tangent(b_acceleration)[0] + cubic * cross(eta_rate, once)
    square_rate = 2 * dot(eta, eta_rate)
    bend += (cubic_slope * square_rate) * twice - (cosine_slope * square_rate) * once  # w'
    velocity = (chart_rate + turned) / 2 + own
    acceleration = bend - cross(own, turned) / 2 - cross(chart_rate, velocity) / 2
    turn = tau * chart_rate / 2
    of_turn = _sine_and_cosine(dot(turn, turn))
    return _turned_back(turn, *of_turn, velocity), _turned_back(turn, *of_turn, acceleration)


def _turned_back(turn: np.ndarray, sine: np.ndarray, cosine: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """``exp(turn^)^T x`` of vectors ``x`` (3, n), from `_sine_and_cosine` of the squared angles."""
    once = cross(turn, vector)
    return np.asarray(vector - sine * once + cosine * cross(turn, once))


def _sine_and_cosine(square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``sin t / t`` and ``(1 - cos t) / t^2`` as functions of ``t^2``, (n,) real or complex."""
    angle = np.sqrt(np.where(square.real < _ZERO, _ZERO, square))
    half = np.sin(angle / 2) / angle
    return np.sin(angle) / angle, 2 * half * half


def _further(
    square: np.ndarray, sine: np.ndarray, cosine: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """``(t - sin t) / t^3``, and the derivatives of ``(1 - cos t) / t^2`` and of the former in ``t^2``.

    Args:
        square: (n,) ``t^2``, real or complex.
        sine: ``sin t / t``.
        cosine: ``(1 - cos t) / t^2``.
    """
    small = square.real < _SMALL
    z, safe = np.where(small, square, 0), np.where(small, 1, square)
    cubic = np.where(
        small, 1 / 6 - z * (1 / 120 - z * (1 / 5040 - z * (1 / 362880 - z / 39916800))), (1 - sine) / safe
    )
    of_cosine = z * (2 / 720 - z * (3 / 40320 - z * (4 / 3628800 - z * 5 / 479001600))) - 1 / 24
    of_cubic = z * (2 / 5040 - z * (3 / 362880 - z * (4 / 39916800 - z * 5 / 6227020800))) - 1 / 120
    return (
        cubic,
        np.where(small, of_cosine, (sine - 2 * cosine) / (2 * safe)),
        np.where(small, of_cubic, (cosine - 3 * cubic) / (2 * safe)),
    )


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Cross product of vectors (3, n)."""
    return np.array(vectors.cross(first, second))  # quicker than a stack
