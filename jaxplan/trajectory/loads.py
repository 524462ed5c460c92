"""Loads of the platform and of the joints at the Chebyshev points of trajectories' pieces, for their peaks.

The pieces of many trajectories are looked at one after the other; each has what it has alone, to the last
bit.
"""

from collections import defaultdict
from collections.abc import Sequence
from functools import cache
from itertools import pairwise

import numpy as np

from jaxplan.model import limits
from jaxplan.model.limits import Kinematics, highest_derivative
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory.basis import derivative_matrix
from jaxplan.trajectory.chart_rates import rates
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.maxima import are_resolved

_FEW = 8  # pieces; where there are more they are short
_TOGETHER = 4096  # points; what is computed of them is then still in the processor's cache

Asked = tuple[Trajectory, Spacecraft, tuple[str, ...]]  # of positive duration, with names of quantities


def platform_loads(asked: Sequence[Asked]) -> list[np.ndarray]:
    """Loads of the platform.

    Args:
        asked: each with names of quantities of the platform.

    Returns:
        Of each (N, G, 3 Q), at as many points of each piece as tell what is between them.
    """
    # The attitude's exponentials add to the polynomials' degree: little where pieces are short.
    sizes = [curve.coefficients.shape for curve, _, _ in asked]
    found, told = _at_points(asked, [size + 7 if count > _FEW else 3 * size + 1 for count, size, _ in sizes])
    again = [number for number, is_told in enumerate(told) if not is_told]
    more, _ = _at_points([asked[number] for number in again], [4 * sizes[number][1] + 13 for number in again])
    for number, values in zip(again, more, strict=True):
        found[number] = values
    return found


def joint_loads(trajectory: Trajectory) -> np.ndarray:
    """(M, G, 6n) angles, rates and accelerations of joints."""
    coefficients = trajectory.joint_coefficients
    count, size, joints = coefficients.shape
    curves = _curves(coefficients, np.diff(trajectory.joint_breaks), size, 3)
    return np.ascontiguousarray(np.moveaxis(curves, 1, 2)).reshape(count, size, 3 * joints)


def _at_points(asked: Sequence[Asked], points: Sequence[int]) -> tuple[list[np.ndarray], list[bool]]:
    """`platform_loads` at so many points of each piece, and whether these tell what is between them."""
    alike: dict[tuple[int, int, tuple[str, ...]], list[int]] = defaultdict(list)
    for number, ((curve, _, names), each) in enumerate(zip(asked, points, strict=True)):
        alike[each, curve.coefficients.shape[1], names].append(number)
    found: dict[int, np.ndarray] = {}
    told: dict[int, bool] = {}
    for (each, _, names), numbers in alike.items():
        several = [asked[number][:2] for number in numbers]
        ends = np.cumsum([0, *(len(curve.coefficients) for curve, _ in several)])
        values = _of_alike(several, names, each)
        found.update(zip(numbers, (values[slice(*own)] for own in pairwise(ends.tolist())), strict=True))
        told.update(zip(numbers, are_resolved(values, ends[:-1]).tolist(), strict=True))
    every = range(len(asked))
    return [found[number] for number in every], [told[number] for number in every]


def _of_alike(
    curves: Sequence[tuple[Trajectory, Spacecraft]], names: tuple[str, ...], points: int
) -> np.ndarray:
    """(N, points, 3 Q) of all pieces of trajectories with polynomials of the same degree."""
    trajectories = [curve for curve, _ in curves]
    coefficients = np.concatenate([own.coefficients for own in trajectories])
    chart_rate = np.concatenate([own.chart_rate for own in trajectories])
    length = np.concatenate([np.diff(own.breaks) for own in trajectories])
    since = np.concatenate([own.breaks[:-1] - own.chart_start for own in trajectories])
    none = np.zeros((3, 3))
    inertia = np.concatenate(
        [
            np.broadcast_to(none if craft.inertia is None else craft.inertia, (len(own.coefficients), 3, 3))
            for own, craft in curves
        ]
    )
    count, block = len(length), max(1, _TOGETHER // points)
    shares = (_chebyshev(points) + 1) / 2
    found = np.empty((count, points, len(names), 3))
    for first in range(0, count, block):
        part = slice(first, first + block)
        b = _curves(coefficients[part], length[part], points, 1 + max(highest_derivative(names), 2))
        with np.errstate(invalid="ignore", over="ignore"):  # what is no number is found by who asks
            values = _loads(
                np.repeat(chart_rate[part].T, points, axis=1),
                (since[part, None] + length[part, None] * shares).reshape(-1),
                np.ascontiguousarray(np.moveaxis(b, (1, 3), (0, 1))).reshape(b.shape[1], 3, -1),
                np.repeat(np.moveaxis(inertia[part], 0, 2), points, axis=2),
                names,
            )
        found[part] = np.moveaxis(values, 2, 0).reshape(-1, points, len(names), 3)
    return found.reshape(count, points, -1)


def _loads(
    chart_rate: np.ndarray, tau: np.ndarray, b: np.ndarray, inertia: np.ndarray, names: tuple[str, ...]
) -> np.ndarray:
    """(Q, 3, n) by name, of charts' rates (3, n), times (n,), curves (k, 3, n) and inertia (3, 3, n)."""
    return np.asarray(limits.values(names, Kinematics(spin=rates(chart_rate, tau, b), inertia=inertia)))


def _curves(coefficients: np.ndarray, lengths: np.ndarray, points: int, orders: int) -> np.ndarray:
    """(N, orders, points, d) polynomials and derivatives by time, of pieces (N, size, d)."""
    count, size, axes = coefficients.shape
    # A product a piece, so that none depends on how many there are.
    with np.errstate(invalid="ignore", over="ignore"):
        curves = (_rows(size, points, orders) @ coefficients).reshape(count, orders, points, axes)
        scale = np.divide(2, lengths, out=np.zeros(count), where=lengths > 0)  # a piece of no length rests
        return np.asarray(curves * scale[:, None, None, None] ** np.arange(orders)[:, None, None])


@cache
def _rows(size: int, points: int, orders: int) -> np.ndarray:
    """(orders points, size): a polynomial and derivatives at Chebyshev points, from Legendre coefficients."""
    values = np.polynomial.legendre.legvander(_chebyshev(points), size - 1)
    matrix = derivative_matrix(size - 1)
    found = np.concatenate([values @ np.linalg.matrix_power(matrix, order) for order in range(orders)])
    found.flags.writeable = False
    return found


def _chebyshev(points: int) -> np.ndarray:
    return np.cos(np.pi * np.arange(points) / (points - 1))
