"""Maxima of smooth functions over continuous time, and the least time scaling that keeps them within limits.

A curve has N pieces, each with G Chebyshev points ``cos(pi j / (G - 1))``, which include both ends, where
jerks may jump; there Q (or c) quantities are given. On a piece every quantity is smooth, so its interpolant
on the points is the quantity itself but for rounding. As a function of ``theta = arccos(x)`` it is a sum of
cosines without edges: every maximum over the piece is a stationary point, and Newton's method finds it from
the neighbouring maximum of a fine grid. A maximum so narrow that the grid misses it would be missed; the
certificate, which shares nothing with this, has the last word.

A quantity with a *lesser part* is ``a / s^p + b / s^(p - 1)`` if the motion takes ``s`` times as long
(`jaxplan.model.limits`), and its peaks move as ``s`` changes. Each of its highest peaks at some ``s`` yields
the ``s`` that this peak requires, which is no smaller; a few such steps lead to the least ``s`` from which on
the limit is kept.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from jaxplan.model.kinematics import time_factor
from jaxplan.runtime.batching import in_groups

_CURVES_PER_GROUP = 16  # curves whose maxima are found together; their results stay in the processor's cache
_RESOLUTION_TOLERANCE = 1e-10  # of the largest term of a sum of cosines; smaller last terms are negligible

_FINE_STEPS_PER_POINT = 4  # intervals of the fine grid in theta for each Chebyshev point
_MAX_NEWTON_STEPS = 12  # most steps from the grid to a maximum
_STEP_TOLERANCE = 1e-9  # rad; smaller steps of theta end the search. A maximum is flat: it errs by the square

_MAX_FACTOR_STEPS = 12  # most iterations that follow the peaks of quantities with a lesser part
_FACTOR_TOLERANCE = 1e-12  # of a time factor; a step that adds less is the last


def is_resolved(values: np.ndarray) -> bool:
    """Tell whether values at the Chebyshev points suffice to interpolate between the points.

    They do if the last terms of the sums of cosines are negligible. It is also true if a value is not finite.

    Args:
        values: (N, G, Q) of Q quantities at G points on each of N pieces.
    """
    series = np.abs(chebyshev(values.shape[1])[0] @ values)
    last, most = (np.max(part, axis=(0, 1), initial=0.0) for part in (series[:, -2:], series))
    return not np.any(last > _RESOLUTION_TOLERANCE * most)


def largest(values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Largest magnitudes of quantities over all pieces of many curves, between the points as well.

    Args:
        values: for each curve (N, G, Q), at the Chebyshev points of its pieces.

    Returns:
        (Q,) for each curve; all NaN if any of its values is not finite.
    """
    return in_groups(
        values,
        lambda own: (own.shape[1:], bool(np.isfinite(own).all())),
        _largest_of_group,
        most=_CURVES_PER_GROUP,
    )


def _largest_of_group(values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Do the work of `largest` for one group of curves, which share G and Q.

    Either every value of the group is finite, or every curve has one that is not: then the results are NaN.
    """
    if not np.isfinite(values[0]).all():
        return [np.full(own.shape[2], np.nan) for own in values]
    to_series, to_fine = chebyshev(values[0].shape[1])
    counts = np.array([len(own) for own in values])
    series = np.swapaxes(np.concatenate(values), 1, 2) @ to_series.T  # (N, Q, G)
    heights = np.abs(series @ to_fine.T)  # (N, Q, fine)
    highest = np.maximum.reduceat(heights.max(axis=2), np.cumsum(counts) - counts)
    owner = np.repeat(np.arange(len(values)), counts)
    # A maximum, half a step off at most, exceeds the grid by no more than the second derivatives allow.
    step = np.pi / (len(to_fine) - 1)
    bends = np.sum(np.abs(series) * np.arange(series.shape[2]) ** 2, axis=2)
    piece, quantity, theta = _find_local_maxima(series, heights, highest[owner] - step**2 / 8 * bends, step)
    np.maximum.at(highest, (owner[piece], quantity), np.abs(_sum_cosines(series[piece, quantity], theta)))
    return list(highest)


def _find_local_maxima(
    series: np.ndarray, heights: np.ndarray, floor: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the local maxima of the magnitudes of sums of cosines.

    Args:
        series: (N, Q, G) coefficients.
        heights: (N, Q, fine) magnitudes on a fine grid of theta.
        floor: (N, Q) heights; maxima of the grid below them are ignored.
        step: rad, of the grid.

    Returns:
        Three arrays, with an entry for each maximum: its piece, its quantity, and theta in rad.
    """
    peaked = heights >= floor[:, :, None]
    peaked &= heights > 0
    peaked[..., 1:] &= heights[..., 1:] > heights[..., :-1]
    peaked[..., :-1] &= heights[..., :-1] >= heights[..., 1:]
    piece, quantity, place = np.unravel_index(np.flatnonzero(peaked), peaked.shape)
    return piece, quantity, _refine_maxima(series[piece, quantity], place * step, step)


def _sum_cosines(sums: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Evaluate sums of cosines, each at one angle.

    Args:
        sums: (c, G) coefficients of c sums.
        theta: (c,) rad.

    Returns:
        (c,) values.
    """
    cosines = np.cos(np.outer(theta, np.arange(sums.shape[1])))
    return np.asarray(np.einsum("ck,ck->c", sums, cosines))


def _refine_maxima(sums: np.ndarray, theta: np.ndarray, reach: float) -> np.ndarray:
    """Find local maxima of the magnitudes of sums of cosines by Newton's method in shrinking brackets.

    Args:
        sums: (c, G) coefficients.
        theta: (c,) rad, near the maximum of each; not changed.
        reach: half the width of the first bracket, rad.

    Returns:
        (c,) rad, theta where the magnitudes are largest.
    """
    k = np.arange(sums.shape[1])
    sums = sums * np.sign(np.sum(sums * np.cos(np.outer(theta, k)), axis=1))[:, None]
    first = sums * k
    second = first * k
    theta, lower, upper = theta.copy(), theta - reach, theta + reach
    moving = np.arange(len(theta))
    for _ in range(_MAX_NEWTON_STEPS):
        at = theta[moving]
        angle = np.outer(at, k)
        slope = -np.einsum("ck,ck->c", first[moving], np.sin(angle))
        curvature = -np.einsum("ck,ck->c", second[moving], np.cos(angle))
        lower[moving] = np.where(slope > 0, at, lower[moving])
        upper[moving] = np.where(slope > 0, upper[moving], at)
        ahead = at - slope / np.where(curvature < 0, curvature, -1)
        sound = (curvature < 0) & (lower[moving] <= ahead) & (ahead <= upper[moving])
        theta[moving] = np.where(sound, ahead, (lower[moving] + upper[moving]) / 2)
        moving = moving[np.abs(theta[moving] - at) > _STEP_TOLERANCE]
        if not len(moving):
            break
    return theta


def rooted_factors(share: np.ndarray, lesser: np.ndarray, power: int) -> np.ndarray:
    """Factors (c,) on time from which on quantities with a lesser part keep their limits at every instant.

    Args:
        share: (N, G, c) over the limit at the Chebyshev points of a curve's pieces, without the lesser part.
        lesser: (N, G, c) likewise, the part that falls by one power less.
        power: by which `share` falls, 1 or 2.

    Returns:
        Inf where slowing down does not help, NaN where a value is not finite.
    """
    factors = np.max(np.asarray(time_factor(share, power, lesser)), axis=(0, 1))
    to_series, to_fine = chebyshev(share.shape[1])
    series, slow = (np.swapaxes(part, 1, 2) @ to_series.T for part in (share, lesser))  # (N, c, G)
    step = np.pi / (len(to_fine) - 1)
    orders = np.arange(series.shape[2]) ** 2
    left = np.flatnonzero(np.isfinite(factors) & (factors > 0))
    for _ in range(_MAX_FACTOR_STEPS):
        if not len(left):
            break
        own = factors[left, None]
        a, b = series[:, left], slow[:, left]
        sums = a / own**power + b / own ** (power - 1)
        heights = np.abs(sums @ to_fine.T)
        floor = np.max(heights, axis=(0, 2)) - step**2 / 8 * np.sum(np.abs(sums) * orders, axis=2)
        piece, quantity, theta = _find_local_maxima(sums, heights, floor, step)
        needed = time_factor(
            _sum_cosines(a[piece, quantity], theta), power, _sum_cosines(b[piece, quantity], theta)
        )
        ahead = factors[left]
        np.maximum.at(ahead, quantity, needed)
        rising = np.isfinite(ahead) & (ahead > (1 + _FACTOR_TOLERANCE) * factors[left])
        factors[left] = ahead
        left = left[rising]
    return factors


@cache
def chebyshev(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return matrices from values at Chebyshev points to a sum of cosines, and from that to a fine grid.

    Args:
        points: number G of Chebyshev points.

    Returns:
        (G, G), and (`_FINE_STEPS_PER_POINT` * G + 1, G) for a grid with equal steps in theta from 0 to pi.
    """
    k = np.arange(points)
    halved_ends = np.ones(points)
    halved_ends[[0, -1]] = 0.5
    cosines = np.cos(np.pi * np.outer(k, k) / (points - 1))
    to_series = 2 / (points - 1) * halved_ends[:, None] * cosines * halved_ends
    return to_series, np.cos(np.outer(np.linspace(0, np.pi, _FINE_STEPS_PER_POINT * points + 1), k))
