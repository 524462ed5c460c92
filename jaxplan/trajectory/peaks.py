"""Peaks of a trajectory over all time, and the uniform time scaling that brings them to their limits.

Slowing a motion leaves its geometry as it is, and every limited quantity falls by a power of the factor on
time (`jaxplan.model.limits`). So the shortest uniform scaling within all limits follows from the peaks of one
curve, exactly. Torques and momenta of wheels have a *lesser part*, which falls by one power less, so their
peaks move as the time is scaled, and are followed. Peaks are maxima over continuous time (`maxima`). In
shapes, Q counts limited quantities, C their components and E the lesser parts.

Rates of the platform at very many points are computed by cross products in numpy: the same formulas as in
`curve.chart_motion` (equations 25 to 29), but not differentiable. With ``E = exp(eta^)``, and
``U = exp(tau Omega^ / 2)``, which leaves ``Omega`` as it is,

    omega  = U^T v,                     v  = (Omega + E^T Omega) / 2 + w,   w = D(eta) eta',
    omega' = U^T (v' - Omega x v / 2),  v' = w' - w x (E^T Omega) / 2.

All is analytic in time, so a step along its imaginary axis gives the next derivative to the last digit. The
length of a vector is not smooth where it is zero; its square is, and of that the maxima are looked for. With
the chart's base ``R_a`` the total momentum ``H`` of wheels and platform is ``U^T E^T U^T R_a^T H`` in body
axes. Where stages of gimbals have an inertia the loads depend on the joints, too, so pieces of both are
needed.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from jaxplan.geometry import vectors
from jaxplan.geometry.vectors import dot
from jaxplan.model.kinematics import Kinematics, time_factor
from jaxplan.model.limits import (
    Limit,
    are_lengths,
    components,
    highest_derivative,
    lesser_components,
    timed_limits,
    values,
)
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import WheelArray
from jaxplan.runtime.batching import in_groups
from jaxplan.trajectory.curve import Trajectory, on_common_pieces, total_momentum
from jaxplan.trajectory.maxima import is_resolved, largest, rooted_factors
from jaxplan.trajectory.splines import derivative_matrix

SAFETY = 1 + 1e-6  # factor on time beyond what the peaks require, so that an independent proof has room

# Of a limit, by which it may be exceeded and counts as kept: a joint that binds is at its limit but for
# rounding, and whether there is a motion must not hang on that. The certificate forgives ten times as much.
_LIMIT_ROUNDING = 1e-10
_RANGE_ROUNDING = 1e-9  # of a joint's range, by which it may be exceeded, since a node may be at its very end

_REFINEMENT_FACTOR = 2  # factor on the number of points, where stages turn far on a piece
_MAX_REFINEMENTS = 4  # most times that this factor is applied
_FEW_PIECES = 8  # pieces; where a trajectory has more, they are short and take fewer points
_NO_LESSER_PART = 1e-13  # of a limit; lesser parts below this are rounding
_POINTS_PER_BLOCK = 4096  # points computed together; intermediate results stay in the processor's cache

_MAX_SERIES_SQUARE = 0.05  # rad^2, square of the angle below which series are used
_MIN_SQUARE = 1e-300  # rad^2, least square of an angle whose root is divided by
_COMPLEX_STEP = 1e-30  # s, along the imaginary axis, of complex-step derivatives

Asked = tuple[Trajectory, Spacecraft, tuple[str, ...]]
"""A trajectory of positive duration, its spacecraft, and names of the quantities asked for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Peaks:
    """The largest fraction of each limit that a trajectory uses, for Q limited quantities.

    Attributes:
        names: of the quantities, such as ``platform rate x`` or ``terminal-1 yaw acceleration``.
        ratios: (Q,) largest magnitude over limit.
        powers: (Q,) the power of the time scaling by which the ratio falls.
        in_range: whether every joint stays within its range of angles, on which time has no influence.
        rooted: (Q,) time factors of quantities with a lesser part that is not zero, NaN for the others; None
            without wheels.
    """

    names: tuple[str, ...]
    ratios: np.ndarray
    powers: np.ndarray
    in_range: bool
    rooted: np.ndarray | None = None

    @property
    def stretch(self) -> float:
        """Least factor on time with which all limits are kept, so that one of them is just met.

        It is NaN if a peak is not a number, and infinite if slowing down does not help, as with full wheels.
        """
        return float(np.max(self.time_factors, initial=0.0))

    @property
    def kept(self) -> bool:
        """Whether all limits but those of joint angles are kept as it is; a slower motion may break one."""
        return self.stretch <= 1 + _LIMIT_ROUNDING or bool(np.all(self.ratios <= 1 + _LIMIT_ROUNDING))

    @property
    def sound(self) -> bool:
        """Whether all peaks are finite numbers."""
        return bool(np.all(np.isfinite(self.ratios)))

    @property
    def binding(self) -> int:
        """Index of the quantity that requires the longest time."""
        return int(np.argmax(self.time_factors))

    @property
    def time_factors(self) -> np.ndarray:
        """(Q,) factor on time for each quantity at which its limit is just met; below 1 it is kept."""
        found = np.asarray(time_factor(self.ratios, self.powers))
        return found if self.rooted is None else np.where(np.isnan(self.rooted), found, self.rooted)


def peaks(trajectory: Trajectory, spacecraft: Spacecraft) -> Peaks:
    """Compute the peaks of a trajectory, over their limits, of all quantities that the spacecraft limits.

    Args:
        trajectory: of positive duration.
        spacecraft: its limits; a torque or momentum limit needs its inertia.

    Returns:
        The peaks, of the platform first, then of the joints.
    """
    return all_peaks([(trajectory, spacecraft)])[0]


def all_peaks(curves: Sequence[tuple[Trajectory, Spacecraft]]) -> list[Peaks]:
    """Compute the `peaks` of many pairs of a trajectory and its spacecraft, in the same order."""
    limits = [timed_limits(craft) for _, craft in curves]
    names = [tuple(limit.quantity.name for limit in of_platform) for of_platform, _ in limits]
    loads = _platform_loads([(*curve, own) for curve, own in zip(curves, names, strict=True)])
    platform = []
    for own, found, (_, craft) in zip(names, largest(loads), curves, strict=True):
        squared = are_lengths(own, wheel_rows(craft))
        found = found[: len(squared)]
        platform.append(np.where(squared, np.sqrt(found), found))
    joints = largest([_joint_values(*curve) for curve in curves])
    crafts = [craft for _, craft in curves]
    return [_make_peaks(*own) for own in zip(crafts, limits, platform, joints, loads, strict=True)]


def wheel_rows(craft: Spacecraft) -> int:
    """Number of rows of a spacecraft's wheel array; 0 without wheels."""
    return 0 if craft.wheel_array is None else len(craft.wheel_array.rows)


def _make_peaks(
    craft: Spacecraft,
    limits: tuple[tuple[Limit, ...], tuple[Limit, ...]],
    platform: np.ndarray,
    joints: np.ndarray,
    loads: np.ndarray,
) -> Peaks:
    """Make the `Peaks` of a trajectory from largest magnitudes.

    Args:
        craft: the spacecraft.
        limits: of its platform and of its joints.
        platform: (C,) largest magnitudes of the components of the platform's limited quantities.
        joints: (3J,) those of `_joint_values`.
        loads: (N, G, C + E) of the platform over time, as of `_platform_loads`.
    """
    angles, *of_joints = np.split(joints, 3)
    rows, names = wheel_rows(craft), [limit.quantity.name for limit in limits[0]]
    parts = components(names, rows)
    of_platform = (platform[own] for own in parts)
    largest = [*of_platform, *(of_joints[limit.quantity.power - 1] for limit in limits[1])]
    every = [*limits[0], *limits[1]]
    rooted = [np.full(len(limit.bound), np.nan) for limit in every]
    for number, lesser in enumerate(lesser_components(names, rows)):
        if lesser is not None:
            limit = limits[0][number]
            whole, slow = loads[:, :, parts[number]] / limit.bound, loads[:, :, lesser] / limit.bound
            if not np.all(np.abs(slow) <= _NO_LESSER_PART):  # else, as of empty wheels, there is none
                rooted[number] = rooted_factors(whole - slow, slow, limit.quantity.power)
    return Peaks(
        names=tuple(name for limit in every for name in limit.names),
        ratios=np.concatenate([own / limit.bound for own, limit in zip(largest, every, strict=True)]),
        powers=np.concatenate([np.full(len(limit.bound), limit.quantity.power) for limit in every]),
        in_range=bool(np.all(angles <= (1 + _RANGE_ROUNDING) * np.diff(craft.joint_ranges)[:, 0] / 2)),
        rooted=np.concatenate(rooted) if rows else None,
    )


def _platform_loads(asked: Sequence[Asked]) -> list[np.ndarray]:
    """Loads of the platform along trajectories: C components of its limited quantities, and E lesser parts.

    Args:
        asked: each with names of quantities of the platform.

    Returns:
        For each (N, G, C + E), at G Chebyshev points of each of its N pieces, enough to interpolate between
        them, with the E lesser parts last. For quantities that are a vector's length, their squares.
    """

    def kind(one: tuple[Asked, int]) -> tuple[Any, ...]:
        (trajectory, craft, names), points = one
        return points, trajectory.coefficients.shape[1], names, wheel_rows(craft), _stages_key(craft)

    def at_points(some: Sequence[Asked], points: Sequence[int]) -> list[np.ndarray]:
        return in_groups(
            list(zip(some, points, strict=True)),
            kind,
            lambda alike: _loads_at_points([own for own, _ in alike], alike[0][1]),
        )

    asked = [(own[0] if own[1].stages is None else on_common_pieces(own[0]), *own[1:]) for own in asked]

    # The attitude's exponentials add to the polynomials' degree: little where pieces are short.
    sizes = [curve.coefficients.shape for curve, _, _ in asked]
    found = at_points(asked, [size + 7 if count > _FEW_PIECES else 3 * size + 1 for count, size, _ in sizes])
    again = [number for number, own in enumerate(found) if not is_resolved(own)]
    more = at_points([asked[number] for number in again], [4 * sizes[number][1] + 13 for number in again])
    for number, own in zip(again, more, strict=True):
        found[number] = own
    for _ in range(_MAX_REFINEMENTS):
        again = [
            number
            for number in again
            if asked[number][1].stages is not None and not is_resolved(found[number])
        ]
        more = at_points([asked[n] for n in again], [_REFINEMENT_FACTOR * found[n].shape[1] for n in again])
        for number, own in zip(again, more, strict=True):
            found[number] = own
    return found


def _stages_key(craft: Spacecraft) -> Hashable:
    """Return a key that is equal for spacecraft with equal gimbal stages; None for one without."""
    stages = craft.stages
    if stages is None:
        return None
    return stages.turned, np.asarray(stages.frames).tobytes(), np.asarray(stages.inertias).tobytes()


def _joint_values(trajectory: Trajectory, craft: Spacecraft) -> np.ndarray:
    """Values of the J joints at G Chebyshev points of each of M pieces of their motion, (M, G, 3J).

    They are the J angles relative to the middle of their ranges (rad), then the rates (rad/s), then the
    accelerations (rad/s^2).
    """
    coefficients = trajectory.joint_coefficients
    count, size, joints = coefficients.shape
    curves = _evaluate_pieces(coefficients, np.diff(trajectory.joint_breaks), size, 3)
    curves[:, 0] -= np.mean(craft.joint_ranges, axis=-1)
    return np.ascontiguousarray(np.moveaxis(curves, 1, 2)).reshape(count, size, 3 * joints)


def _loads_at_points(asked: Sequence[Asked], points: int) -> list[np.ndarray]:
    """`_platform_loads` of trajectories with the same degree and names, at so many Chebyshev points."""
    trajectories, names = [curve for curve, _, _ in asked], asked[0][2]
    coefficients = np.concatenate([own.coefficients for own in trajectories])
    chart_rate = np.concatenate([own.chart_rate for own in trajectories])
    length = np.concatenate([np.diff(own.breaks) for own in trajectories])
    since = np.concatenate([own.breaks[:-1] - own.chart_start for own in trajectories])
    counts = [len(own.coefficients) for own in trajectories]
    given = [np.zeros((3, 3)) if craft.inertia is None else craft.fixed_inertia for _, craft, _ in asked]
    stages = asked[0][1].stages
    of_joints = None if stages is None else np.concatenate([own.joint_coefficients for own in trajectories])
    inertia = np.repeat(np.array(given, float), counts, axis=0)
    shares, orders = (_chebyshev_points(points) + 1) / 2, 1 + max(highest_derivative(names), 2)
    block = max(1, _POINTS_PER_BLOCK // points)
    wheels = wheel_rows(asked[0][1])
    squared = are_lengths(names, wheels)
    lesser = [part for part in lesser_components(names, wheels) if part is not None]
    count = len(squared) + sum(part.stop - part.start for part in lesser)
    squared = np.append(squared, np.zeros(count - len(squared), bool))
    totals = _collect_wheel_data(asked) if wheels else None
    found = np.empty((len(length), points, count))
    for first in range(0, len(length), block):
        part = slice(first, first + block)
        b = _evaluate_pieces(coefficients[part], length[part], points, orders)
        with np.errstate(invalid="ignore", over="ignore"):  # callers check for NaN
            chart = (
                np.repeat(chart_rate[part].T, points, axis=1),
                (since[part, None] + length[part, None] * shares).reshape(-1),
                np.ascontiguousarray(np.moveaxis(b, (1, 3), (0, 1))).reshape(orders, 3, -1),
            )
            own = np.repeat(np.moveaxis(inertia[part], 0, 2), points, axis=2)
            motion = Kinematics(spin=rates(*chart), inertia=own, stages=stages)
            if of_joints is not None:
                joints = _evaluate_pieces(of_joints[part], length[part], points, 3)
                values_of = np.moveaxis(joints, (1, 3), (0, 1)).reshape(3, joints.shape[3], -1)
                motion = motion._replace(joints=list(values_of)).known
            if totals is not None:
                total, rows, apart = (
                    np.repeat(np.moveaxis(each[part], 0, -1), points, axis=-1) for each in totals
                )
                array = WheelArray(*[np.empty(0)] * len(WheelArray._fields))._replace(rows=rows, apart=apart)
                motion = motion._replace(total=_rotate_to_body(*chart, total), array=array)
            loads = np.asarray(values(names, motion))
        loads[squared] *= loads[squared]
        found[part] = loads.T.reshape(-1, points, len(loads))
    return np.split(found, np.cumsum(counts)[:-1])


def _collect_wheel_data(asked: Sequence[Asked]) -> tuple[np.ndarray, ...]:
    """Collect what loads of wheels depend on, for each of N pieces of trajectories with equally many rows.

    Returns:
        Total momenta (N, 3) N m s in the axes of the charts' bases, then `rows` (N, r, 3) and `apart` (N, r)
        of the wheel arrays.
    """
    found = []
    for trajectory, craft, _ in asked:
        own = np.swapaxes(trajectory.chart_attitude, 1, 2) @ total_momentum(trajectory, craft)
        parts = () if craft.wheel_array is None else (craft.wheel_array.rows, craft.wheel_array.apart)
        found.append((own, *(np.repeat(part[None], len(own), axis=0) for part in parts)))
    return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))


def _evaluate_pieces(coefficients: np.ndarray, lengths: np.ndarray, points: int, orders: int) -> np.ndarray:
    """(N, orders, points, d) polynomials and their time derivatives at Chebyshev points of N pieces.

    Args:
        coefficients: (N, size, d) in the Legendre basis.
        lengths: (N,) s, of the pieces; on one of no length derivatives are zero.
        points: how many on each piece.
        orders: number of arrays wanted: the values count as one, each derivative as another.
    """
    count, size, axes = coefficients.shape
    with np.errstate(invalid="ignore", over="ignore"):
        curves = (_evaluation_matrix(size, points, orders) @ coefficients).reshape(
            count, orders, points, axes
        )
        scale = np.divide(2, lengths, out=np.zeros(count), where=lengths > 0)  # a piece of no length rests
        return np.asarray(curves * scale[:, None, None, None] ** np.arange(orders)[:, None, None])


@cache
def _evaluation_matrix(size: int, points: int, orders: int) -> np.ndarray:
    """(orders * points, size) matrix from Legendre coefficients to values and derivatives in [-1, 1].

    They are at Chebyshev points, all values first, then all of each derivative.
    """
    values = np.polynomial.legendre.legvander(_chebyshev_points(points), size - 1)
    matrix = derivative_matrix(size - 1)
    found = np.concatenate([values @ np.linalg.matrix_power(matrix, order) for order in range(orders)])
    found.flags.writeable = False
    return found


def _chebyshev_points(points: int) -> np.ndarray:
    """Chebyshev points (points,) in [-1, 1], in descending order, both ends included."""
    return np.cos(np.pi * np.arange(points) / (points - 1))


def rates(chart_rate: np.ndarray, tau: np.ndarray, b: np.ndarray) -> list[np.ndarray]:
    """Angular velocity, angular acceleration and, if asked for, angular jerk on a chart.

    Args:
        chart_rate: (3, n) rad/s, ``Omega``.
        tau: (n,) s since the chart's start.
        b: (k + 1, 3, n) rad, the curve and its first k derivatives by time: two, or three for the jerk.

    Returns:
        k arrays (3, n), in rad/s, rad/s^2 and rad/s^3, body axes.
    """
    if len(b) == 3:
        return list(_velocity_and_acceleration(chart_rate, tau, *b))
    ahead = b[:-1] + 1j * _COMPLEX_STEP * b[1:]
    velocity, acceleration = _velocity_and_acceleration(chart_rate, tau + 1j * _COMPLEX_STEP, *ahead)
    return [velocity.real, acceleration.real, acceleration.imag / _COMPLEX_STEP]


def _velocity_and_acceleration(
    chart_rate: np.ndarray, tau: np.ndarray, b: np.ndarray, b_rate: np.ndarray, b_acceleration: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity and acceleration at n instants, (3, n) each, see `rates`; arguments may be complex."""
    eta, eta_rate = b - tau * chart_rate, b_rate - chart_rate
    square = dot(eta, eta)
    sine, cosine = _rodrigues_coefficients(square)
    cubic, cosine_slope, cubic_slope = _jacobian_coefficients(square, sine, cosine)

    def tangent(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return ``D x``, with ``eta x x`` and ``eta x (eta x x)``."""
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
    of_turn = _rodrigues_coefficients(dot(turn, turn))
    return _rotate_back(turn, *of_turn, velocity), _rotate_back(turn, *of_turn, acceleration)


def _rotate_to_body(chart_rate: np.ndarray, tau: np.ndarray, b: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Turn vectors (3, n) from the axes of charts' bases to body axes, for n instants; see `rates`."""
    turn = tau * chart_rate / 2
    eta = b[0] - 2 * turn
    around, between = (_rodrigues_coefficients(dot(each, each)) for each in (turn, eta))
    return _rotate_back(turn, *around, _rotate_back(eta, *between, _rotate_back(turn, *around, vector)))


def _rotate_back(turn: np.ndarray, sine: np.ndarray, cosine: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Compute ``exp(turn^)^T x`` of ``x`` (3, n) from `_rodrigues_coefficients` of the squared angles."""
    once = cross(turn, vector)
    return np.asarray(vector - sine * once + cosine * cross(turn, once))


def _rodrigues_coefficients(square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``sin t / t`` and ``(1 - cos t) / t^2`` as functions of ``t^2``, (n,) real or complex."""
    angle = np.sqrt(np.where(square.real < _MIN_SQUARE, _MIN_SQUARE, square))
    half = np.sin(angle / 2) / angle
    return np.sin(angle) / angle, 2 * half * half


def _jacobian_coefficients(
    square: np.ndarray, sine: np.ndarray, cosine: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ``(t - sin t) / t^3``, and derivatives by ``t^2`` of ``(1 - cos t) / t^2`` and of the former.

    Args:
        square: (n,) ``t^2``, real or complex.
        sine: ``sin t / t``.
        cosine: ``(1 - cos t) / t^2``.
    """
    small = square.real < _MAX_SERIES_SQUARE
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
    """Cross products of n pairs of vectors (3, n)."""
    return np.array(vectors.cross(first, second))  # quicker than a stack
