"""Which intervals share a quadratic program.

A segment of ``n`` intervals has ``l + 1`` coefficients an axis and must pass ``n + 1`` nodes. It takes two
derivatives over from its neighbour, or from the start of the motion, and should keep a coefficient for its
objective; the one that closes the chain takes two from the other end as well. So the closing segment (the
last for the joints, the first for the platform, which is planned backward) holds at most ``l - 4``
intervals, every other one ``l - 3``. So ``m`` intervals fit into ``S`` segments exactly if
``m // S <= l - 4``.
"""

from functools import cache

import numpy as np

_CHART_REACH = 2.5  # rad; the logarithm of a chart must stay away from half a turn


def fewest_segments(intervals: int, order: int) -> int:
    """The smallest number of segments that the counting rule allows.

    Args:
        intervals: m, at least 1.
        order: of the Legendre basis, at least `MIN_ORDER`.
    """
    return intervals // (order - 3) + 1


@cache
def split(intervals: int, segments: int, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Node indices at which the segments of the joints, and those of the platform, end.

    Both are split equally wherever the counting rule allows it for both; else the closing segments are
    the short ones, which stand at opposite ends.

    Args:
        intervals: m, at least 1.
        segments: S, from `fewest_segments` to m.
        order: of the Legendre basis.

    Returns:
        Two integer arrays (S + 1,), from 0 to m, read-only.
    """
    ends = [np.round(np.linspace(0, intervals, segments + 1)).astype(int)] * 2
    sizes = np.diff(ends[0])
    if max(sizes[0], sizes[-1]) > order - 4 or sizes.max() > order - 3:
        sizes = np.full(segments, intervals // segments)
        sizes[: intervals % segments] += 1
        ends = [np.concatenate([[0], np.cumsum(own)]) for own in (sizes, sizes[::-1])]
    for own in ends:
        own.flags.writeable = False
    return ends[0], ends[1]


def is_full(intervals: int, segments: int, order: int) -> bool:
    """Whether a closing segment has at most one coefficient left for its objective."""
    return segments < intervals and intervals // segments >= order - 5


def charts_suffice(turns: np.ndarray, ends: np.ndarray) -> bool:
    """Whether every segment of more than one interval can work in one chart.

    A segment whose edges turn by ``L`` in all has ``|eta| <= L`` along them, since ``eta`` is the rotation
    between two motions that start together and end together; below half a turn its logarithm has no jump. A
    single interval has none anyway.

    Args:
        turns: (m, 3) rad, rotation of each edge.
        ends: (S + 1,) node indices where the platform's segments end.
    """
    turned = np.add.reduceat(np.linalg.norm(turns, axis=1), ends[:-1])
    return bool(np.all((turned <= _CHART_REACH) | (np.diff(ends) == 1)))


def shortest_duration(
    moves: np.ndarray, fractions: np.ndarray, rate_limits: np.ndarray, acceleration_limits: np.ndarray
) -> float:
    """The duration at which the differences of the nodes, from rest to rest, just keep all limits.

    First differences are held against rates, second ones against accelerations.

    Args:
        moves: (m, d) change of each axis along each edge, rad.
        fractions: (m + 1,) of the duration.
        rate_limits: (d,) rad/s.
        acceleration_limits: (d,) rad/s^2.

    Returns:
        s; a curve through the nodes needs more.
    """
    shares = np.diff(fractions)[:, None]
    rates = np.pad(moves / shares, ((1, 1), (0, 0)))
    between = np.pad(shares, ((1, 1), (0, 0)), mode="edge")
    accelerations = np.diff(rates, axis=0) / ((between[1:] + between[:-1]) / 2)
    by_rate = np.max(np.abs(rates) / rate_limits)
    return float(max(by_rate, np.sqrt(np.max(np.abs(accelerations) / acceleration_limits))))
