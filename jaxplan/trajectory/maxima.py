"""Largest magnitudes of smooth quantities over all time.

On a piece every quantity is smooth, so its interpolant on Chebyshev points (which include both ends, where
jerks jump) is the quantity itself but for rounding. As a function of ``theta = arccos(x)`` it is a cosine sum
without edges: every maximum over the piece is a stationary point, and Newton's method finds it from the
nearest point of a fine grid.
"""

from collections import defaultdict
from collections.abc import Sequence
from functools import cache

import numpy as np

_FINE = 4  # grid intervals in theta for each point; then a grid maximum is within 8 % of the true one
_NEAR = 0.9  # grid maxima above this share of the highest are followed
_NEWTON_STEPS = 12
_STILL = 1e-9  # rad of theta; a maximum is flat, so its value is off by the square of it
_RESOLVED = 1e-10  # of the largest term of a quantity's cosine sums
_ELEMENTS = 200_000  # of an array that many pieces are looked at in


def is_resolved(values: np.ndarray) -> bool:
    """Whether values (N, G, Q) at the Chebyshev points of pieces tell what is between the points.

    So they do where the last terms of the cosine sums are next to nothing; a number that is not finite counts
    as told.
    """
    series = np.abs(np.tensordot(chebyshev(values.shape[1])[0], values, axes=(1, 1)))
    most = np.max(series, axis=(0, 1))
    return not np.any(np.max(series[-2:], axis=(0, 1)) > _RESOLVED * most)


def largest(values: np.ndarray) -> np.ndarray:
    """Largest magnitudes over all pieces, between the points as well.

    Args:
        values: (N, G, Q) at the Chebyshev points ``cos(pi j / (G - 1))`` of each piece.

    Returns:
        (Q,); all NaN if a value is not finite.
    """
    return all_largest([values])[0]


def all_largest(values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """`largest` of many; those with as many points are looked at together, some at a time."""
    found: dict[int, np.ndarray] = {}
    alike: dict[int, list[int]] = defaultdict(list)
    for number, own in enumerate(values):
        if np.all(np.isfinite(own)):
            alike[own.shape[1]].append(number)
        else:
            found[number] = np.full(own.shape[2], np.nan)
    for points, numbers in alike.items():
        columns = np.cumsum([values[number].shape[0] * values[number].shape[2] for number in numbers])
        part = (columns - 1) // (_ELEMENTS // (_FINE * points))
        for one in np.unique(part):
            some = [number for number, its in zip(numbers, part, strict=True) if its == one]
            found.update(zip(some, _largest_of([values[number] for number in some]), strict=True))
    return [found[number] for number in range(len(values))]


def _largest_of(values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """`largest` of values (N, G, Q) that are finite, with the same G."""
    points = values[0].shape[1]
    to_series, to_fine = chebyshev(points)
    # From here on one column is one quantity on one piece; their sums stay within it.
    several = [np.tensordot(to_series, own, axes=(1, 1)).reshape(points, -1) for own in values]
    fine = np.abs(np.concatenate([to_fine @ series for series in several], axis=1))
    quantity, last = [], 0
    for own in values:
        quantity.append(np.tile(np.arange(last, last + own.shape[2]), len(own)))
        last += own.shape[2]
    of = np.concatenate(quantity)
    highest = np.zeros(last)
    np.maximum.at(highest, of, fine.max(axis=0))
    peaked = fine >= _NEAR * highest[of]
    peaked &= fine > 0
    peaked[1:] &= fine[1:] > fine[:-1]
    peaked[:-1] &= fine[:-1] >= fine[1:]
    row, column = np.divmod(np.flatnonzero(peaked), peaked.shape[1])
    series = np.concatenate(several, axis=1)[:, column].T
    followed = _follow(np.ascontiguousarray(series), row * np.pi / (len(fine) - 1), np.pi / (len(fine) - 1))
    np.maximum.at(highest, of[column], followed)
    return np.split(highest, np.cumsum([own.shape[2] for own in values])[:-1])


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
def chebyshev(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices from values at Chebyshev points to a cosine sum, and from that to a fine grid in theta."""
    k = np.arange(points)
    halved_ends = np.ones(points)
    halved_ends[[0, -1]] = 0.5
    cosines = np.cos(np.pi * np.outer(k, k) / (points - 1))
    to_series = 2 / (points - 1) * halved_ends[:, None] * cosines * halved_ends
    return to_series, np.cos(np.outer(np.linspace(0, np.pi, _FINE * points + 1), k))
