"""All minima of problem (7), the global one first, and the least change that makes a problem solvable.

The descents start from the points of the covering that may have a solution near them, those of the least
slew first: a solution of slew ``theta`` lies near a point of slew below ``theta + RADIUS``, so once all of
those have been started from, nothing better is left to find. Starts spread over the others find further
minima.
"""

from collections.abc import Callable

import numpy as np

from jaxplan.decomposition import covering
from jaxplan.decomposition.caps import Caps
from jaxplan.decomposition.descent import Minima, descend
from jaxplan.geometry import rotations

NEAR = 64
"""Lanes of a batch for the points with the least slew."""
SPREAD = 64
"""Lanes of a batch for points spread over the rest."""
CLEAR = 5e-13
"""rad; an excess over caps that counts as none, half of what caps are wider than their constraints."""
TOLERANCE = 1e-10
"""rad; of the conditions of optimality."""
LAST_TOLERANCE = 1e-7
"""Likewise in the last round: rounding leaves more at the edge of a cone of arc seconds, bent as it is."""
ROUNDS = 4
"""Descents in a row from one batch of starts."""
APART = np.deg2rad(2.0)
"""Minima closer than this count as one."""
STILL = 1e-9
"""rad; a smaller slew is none."""
PRECISION = 3e-7
"""rad; to which the least widening is found."""


def minima(caps: Caps, count: int, seed: int) -> np.ndarray:
    """Distinct local minima of the slew, the global one first.

    Args:
        caps: what directions must stay out of.
        count: how many are wanted at most.
        seed: of the covering.

    Returns:
        (at most count, 4) unit quaternions of ``E`` with scalar part >= 0, by slew; none without a solution.
    """
    points = covering.points(seed)
    possible = np.flatnonzero(covering.depths(caps, seed) <= 0)
    slews = 2 * np.arccos(np.clip(points[possible, 0], -1, 1))
    rest = possible[NEAR:]
    spread = rest[np.linspace(0, len(rest) - 1, min(SPREAD, len(rest))).astype(int)]
    found = _minima_from(caps, points[np.concatenate([possible[:NEAR], spread])])
    for begin in range(NEAR, len(possible), NEAR + SPREAD):
        if len(found) and slews[begin] > np.min(slew(found)) + covering.RADIUS:
            break
        batch = points[possible[begin : begin + NEAR + SPREAD]]
        found = np.concatenate([found, _minima_from(caps, batch)])
    return _distinct(found, count)


def slew(quaternions: np.ndarray) -> np.ndarray:
    """Angle (K,) of the rotations of unit quaternions (K, 4), the short way round."""
    return np.asarray(rotations.angle(quaternions.T))


def _minima_from(caps: Caps, starts: np.ndarray) -> np.ndarray:
    """Ends (at most K, 4) of the descents from at most one batch of starts that are local minima.

    Where none is, as in a curved valley near half a turn, the descents go on from where they ended.
    """
    good = np.empty((0, 4))
    for round_ in range(ROUNDS if len(starts) else 0):
        ends = _descend(caps, starts)
        tolerance = TOLERANCE if round_ < ROUNDS - 1 else LAST_TOLERANCE
        good = ends.quaternion[is_minimum(ends.slew, ends.excess, ends.residual, ends.curvature, tolerance)]
        if len(good):
            break
        starts = ends.quaternion
    return good


def is_minimum(
    slew: np.ndarray, excess: np.ndarray, residual: np.ndarray, curvature: np.ndarray, tolerance: float
) -> np.ndarray:
    """Whether ends of descents are local minima, of (...) values as in `descent.Minima`."""
    within = (excess <= CLEAR) & (residual <= tolerance)
    return within & (curvature >= -1e-6) & (slew <= np.pi + 1e-9)  # the longer way round is no minimum


def _descend(caps: Caps, starts: np.ndarray) -> Minima:
    """Descends from at most one batch of starts, repeated to fill it: there is one shape to compile."""
    return descend(caps, np.resize(starts, (NEAR + SPREAD, 4)))


def _distinct(quaternions: np.ndarray, count: int) -> np.ndarray:
    """The first (at most count, 4) by slew that are not close to one before."""
    slews = slew(quaternions)
    left = np.argsort(slews, kind="stable")
    kept = np.empty((0, 4))
    while len(left) and len(kept) < count:
        best = quaternions[left[0]]
        still = slews[left[0]] < STILL
        kept = np.concatenate([kept, [[1.0, 0.0, 0.0, 0.0]] if still else [best if best[0] >= 0 else -best]])
        left = left[np.abs(quaternions[left] @ best) < np.cos(APART / 2)]
    return kept


def least_widening(widened: Callable[[float], Caps], enough: float, seed: int) -> np.ndarray:
    """The attitude that breaks a problem's constraints least.

    The least widening with which the problem has a solution is found by bisection. Every trial starts from
    the points that are least deep in the caps as they are, and from the last solution.

    Args:
        widened: the caps when the constraints are made easier by so many radians.
        enough: rad; a widening with which there is a solution.
        seed: of the covering.

    Returns:
        (4,) unit quaternion of ``E``.
    """
    least_deep = np.argsort(covering.depths(widened(0), seed), kind="stable")
    starts = covering.points(seed)[least_deep[: NEAR + SPREAD]]
    narrow, wide = 0.0, enough
    while wide - narrow > PRECISION:
        trial = (narrow + wide) / 2
        ends = _descend(widened(trial), starts)
        solutions = ends.quaternion[ends.excess <= CLEAR]
        if len(solutions):
            wide, starts[0] = trial, solutions[0]
        else:
            narrow = trial
    return starts[0]
