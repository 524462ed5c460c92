"""Scores: margins without an arc cosine, as kernels compare them, and their bounds between two states.

The *score* of a sight and a row is ``side * cos(angle)``, or ``-f . (yaw, pitch)`` for a row of joints: the
larger it is, the smaller is the margin. Over a motion in which platform and joints turn at constant rates,
the cosine ``u . a`` of a sight and an axis is a function of the fraction of the motion, in [0, 1], with

    abs((u . a)'') <= kappa_u + 2 rho_u rho_a + kappa_a

where ``rho`` and ``kappa`` bound the first and second derivative of either in body axes: for an inertial axis
they are ``|w|`` and ``|w|^2`` with the platform's rotation vector ``w``, for an axis of the body zero, for
sights those of `Sights.bounds`. So the values at both ends of an interval bound those between (`edge_bound`).
Rows of joints are linear. Rows, sights and margins are those of `jaxplan.model.constraints`, with Z rows and
S sights.
"""

import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT, Constraints


def scores(rows: Constraints, cosines: ArrayLike, values: ArrayLike | None = None) -> AnyArray:
    """Return the score (..., Z) of each row, to be compared with `thresholds`.

    The larger it is, the smaller is the margin.

    Args:
        rows: the constraints.
        cosines: (..., Z) of the angles between sights and axes.
        values: (..., Z) rad, from `joint_values`; needed if there are rows of joints.
    """
    xp, cosine, side = arrays(cosines, rows.side)
    if not rows.inner:
        return side * cosine
    return xp.where(rows.frame == JOINTS, -xp.asarray(values), side * cosine)


def thresholds(rows: Constraints, clearance: ArrayLike) -> AnyArray:
    """Return the score at which the margin of a row is just the wanted clearance; a larger score is too near.

    Args:
        rows: the constraints.
        clearance: (...) rad, wanted; for a row with less room, its `room`.

    Returns:
        (..., Z).
    """
    xp, wanted, side, half_angle = arrays(clearance, rows.side, rows.half_angle)
    kept = xp.minimum(wanted[..., None], room(rows))
    asked = side * xp.cos(half_angle + side * kept)
    return xp.where(rows.frame == JOINTS, -half_angle - kept, asked) if rows.inner else asked


def room(rows: Constraints) -> AnyArray:
    """(Z,) rad, the largest clearance that is asked of each row: half of the room that its cone leaves."""
    xp, side, half_angle = arrays(rows.side, rows.half_angle)
    cone = xp.where(side > 0, np.pi - half_angle, half_angle) / 2
    return xp.where(rows.frame == JOINTS, np.pi / 2, cone) if rows.inner else cone


def margins_of_scores(rows: Constraints, score: ArrayLike) -> AnyArray:
    """Return margins, given scores.

    Args:
        rows: the constraints.
        score: (..., Z); a score of a cone outside of [-1, 1] is taken as the nearer end of that range.

    Returns:
        (..., Z) rad; good to 1e-8 where a sight lies on a cone's axis, else to rounding. There and outside of
        the range the derivative is taken as zero.
    """
    xp, given, side, half_angle = arrays(score, rows.side, rows.half_angle)
    cosine = side * given
    if xp is np:
        angle = np.arccos(np.clip(cosine, -1, 1))
    else:
        beyond = xp.abs(cosine) >= 1  # where the arc cosine has no derivative
        angle = xp.where(beyond, xp.where(cosine > 0, 0, np.pi), xp.arccos(xp.where(beyond, 0, cosine)))
    found = side * (angle - half_angle)
    return xp.where(rows.frame == JOINTS, -given - half_angle, found) if rows.inner else found


def score_curvature(rows: Constraints, turn: ArrayLike, rate: ArrayLike, bend: ArrayLike) -> AnyArray:
    """Bound the second derivative of scores with respect to the fraction of a motion, in [0, 1].

    Args:
        rows: the constraints.
        turn: (...) rad, angle by which the platform turns over the motion.
        rate: (..., S) bounds of the sights' first derivatives, from `Sights.bounds`.
        bend: (..., S) bounds of their second derivatives, likewise.

    Returns:
        (..., S, Z), or (..., S, 1) if all rows have the same bounds.
    """
    xp, w, rho, kappa = arrays(turn, rate, bend)
    w = w[..., None]
    turned = w * w + 2 * w * rho + kappa
    if not rows.inner:
        return turned[..., None]
    partner = rho[..., None, rows.partner]
    relative = kappa[..., :, None] + 2 * rho[..., :, None] * partner + kappa[..., None, rows.partner]
    within = xp.where(rows.frame == SIGHT, relative, xp.where(rows.frame == BODY, kappa[..., None], 0))
    return xp.where(rows.frame == INERTIAL, turned[..., None], within)


def edge_bound(start: ArrayLike, end: ArrayLike, curvature: ArrayLike) -> AnyArray:
    """Bound a function on an interval from its values at both ends and a bound of its second derivative.

    If ``|f''| <= C`` on an interval of length ``h``, ``f`` lies below the parabola through its end values
    whose second derivative is ``-C``. If that parabola is monotone, the bound is simply the larger end value.

    Args:
        start: (...) f at the start of the interval.
        end: (...) f at its end.
        curvature: (...) ``C h^2 / 2``.

    Returns:
        (...) upper bound of f on the interval; +inf where an argument is not a number.
    """
    xp, a, b, c = arrays(start, end, curvature)
    rise = b - a
    inside = xp.abs(rise) < c
    # The quotient is separate, since many intervals often share a curvature. A curvature too small to matter
    # is replaced by a larger one, against division by zero.
    vertex = a + (c + rise) ** 2 * (0.25 / xp.maximum(c, np.sqrt(np.finfo(c.dtype).tiny)))
    bound = xp.where(inside, vertex, xp.maximum(a, b))
    return xp.where(xp.isnan(rise + c), xp.inf, bound)
