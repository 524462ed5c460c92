"""Largest magnitudes of smooth quantities over all time.

On a piece every quantity is smooth, so its interpolant on Chebyshev points (which include both ends, where
jerks jump) is the quantity itself but for rounding. As a function of ``theta = arccos(x)`` it is a cosine sum
without edges: every maximum over the piece is a stationary point, and Newton's method finds it from the
maximum of a fine grid beside it. One so narrow that no grid maximum is beside it would be missed; the
certificate, which shares nothing with this, has the last word.
"""

from collections import defaultdict
from collections.abc import Sequence
from functools import cache

import numpy as np

_FINE = 4  # grid intervals in theta for each point
_NEWTON_STEPS = 12
_STILL = 1e-9  # rad of theta; a maximum is flat, so its value is off by the square of it
_RESOLVED = 1e-10  # of the largest term of a quantity's cosine sums
_ELEMENTS = 200_000  # of an array that many pieces are looked at in


def are_resolved(values: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Whether values at the Chebyshev points of pieces tell what is between the points.

    So they do where the last terms of the cosine sums are next to nothing; a number that is not finite counts
    as told.

    Args:
        values: (N, G, Q), pieces of one trajectory after the other.
        first: (T,) number of the first piece of each, rising.

    Returns:
        (T,) bool.
    """
    series = np.abs(chebyshev(values.shape[1])[0] @ values)
    last, most = (np.maximum.reduceat(part.max(axis=1), first) for part in (series[:, -2:], series))
    return np.asarray(~np.any(last > _RESOLVED * most, axis=1))


def largest(values: np.ndarray) -> np.ndarray:
    """Largest magnitudes over all pieces, between the points as well.

    Args:
        values: (N, G, Q) at the Chebyshev points ``cos(pi j / (G - 1))`` of each piece.

    Returns:
        (Q,); all NaN if a value is not finite.
    """
    return all_largest([values])[0]


def all_largest(values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """`largest` of many; those with as many points and quantities are looked at together, some at a time."""
    found: dict[int, np.ndarray] = {}
    alike: dict[tuple[int, ...], list[int]] = defaultdict(list)
    for number, own in enumerate(values):
        if np.isfinite(own).all():
            alike[own.shape[1:]].append(number)
        else:
            found[number] = np.full(own.shape[2], np.nan)
    for (points, quantities), numbers in alike.items():
        pieces = np.cumsum([len(values[number]) for number in numbers])
        part = (pieces - 1) // max(1, _ELEMENTS // (_FINE * points * max(1, quantities)))
        for one in np.unique(part):
            some = [number for number, its in zip(numbers, part, strict=True) if its == one]
            found.update(zip(some, _largest_of([values[number] for number in some]), strict=True))
    return [found[number] for number in range(len(values))]


def _largest_of(values: Sequence[np.ndarray]) -> np.ndarray:
    """(T, Q) `largest` of values (N, G, Q) that are finite, with the same G and Q."""
    to_series, to_fine = chebyshev(values[0].shape[1])
    counts = np.array([len(own) for own in values])
    # A product a piece, so that none depends on how many there are.
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
def chebyshev(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices from values at Chebyshev points to a cosine sum, and from that to a fine grid in theta."""
    k = np.arange(points)
    halved_ends = np.ones(points)
    halved_ends[[0, -1]] = 0.5
    cosines = np.cos(np.pi * np.outer(k, k) / (points - 1))
    to_series = 2 / (points - 1) * halved_ends[:, None] * cosines * halved_ends
    return to_series, np.cos(np.outer(np.linspace(0, np.pi, _FINE * points + 1), k))
