"""Scores: margins without an arc cosine, as kernels compare them, and what bounds them between two states.

The score of a pair is ``side * cos(angle)``, that of a row of joints ``-f . (yaw, pitch)``: the larger it is,
the smaller is the margin. Over a motion of platform and joints at constant rates, as a function of the share
of the motion in [0, 1], the cosine ``u . a`` of a sight and an axis has

    abs((u . a)'') <= kappa_u + 2 rho_u rho_a + kappa_a

with bounds ``rho`` and ``kappa`` of the first and second derivative of either in body axes: of an
inertial axis ``|w|`` and ``|w|^2`` for the platform's turn ``w``, of an axis of the body zero, of sights what
`Sights.bounds` says. So the values at both ends of an interval bound those between (`edge_bound`). Rows of
joints are linear. Rows and margins are those of `jaxplan.model.constraints`.
"""

import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT, Constraints


def scores(rows: Constraints, cosines: ArrayLike, values: ArrayLike | None = None) -> AnyArray:
    """Score (..., Z) of each row, to be compared with `thresholds`: the larger it is, the smaller the margin.

    Args:
        rows: the constraints.
        cosines: (..., Z) of angles between sights and axes.
        values: (..., Z) of `joint_values`, where there are rows of joints.
    """
    xp, cosine, side = arrays(cosines, rows.side)
    if not rows.inner:
        return side * cosine
    return xp.where(rows.frame == JOINTS, -xp.asarray(values), side * cosine)


def thresholds(rows: Constraints, clearance: ArrayLike) -> AnyArray:
    """The score that a row has where its margin is just the clearance wanted; a larger score is too near.

    Args:
        rows: the constraints.
        clearance: (...) rad wanted; where a row has no such room, the most that it has (`room`).

    Returns:
        (..., Z).
    """
    xp, wanted, side, half_angle = arrays(clearance, rows.side, rows.half_angle)
    kept = xp.minimum(wanted[..., None], room(rows))
    asked = side * xp.cos(half_angle + side * kept)
    return xp.where(rows.frame == JOINTS, -half_angle - kept, asked) if rows.inner else asked


def room(rows: Constraints) -> AnyArray:
    """(Z,) rad, the most clearance that is asked of each row: half of the room that its cone leaves."""
    xp, side, half_angle = arrays(rows.side, rows.half_angle)
    cone = xp.where(side > 0, np.pi - half_angle, half_angle) / 2
    return xp.where(rows.frame == JOINTS, np.pi / 2, cone) if rows.inner else cone


def margins_of_scores(rows: Constraints, score: ArrayLike) -> AnyArray:
    """Margins from scores.

    Args:
        rows: the constraints.
        score: (..., Z), of a cone beyond [-1, 1] taken as the end of that range.

    Returns:
        (..., Z) rad; good to 1e-8 near a cone's very axis, else to rounding. At the axis and beyond the
        derivative is taken as zero.
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
    """Bound of the second derivative of scores with respect to the share of a motion in [0, 1].

    Args:
        rows: the constraints.
        turn: (...) rad, angle of the platform's turn over the motion.
        rate: (..., S) bounds of the sights' first derivatives, of `Sights.bounds`.
        bend: (..., S) of their second derivatives, likewise.

    Returns:
        (..., S, Z), or (..., S, 1) where all rows have the same.
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
    """Largest value on an interval of a function known at both ends, of bounded second derivative.

    With ``|f''| <= C`` on an interval of length ``h``, ``f`` lies below the parabola through its end values
    with second derivative ``-C``. Where that is monotone the larger end value is the bound, with
    nothing lost.

    Args:
        start: (...) f at the interval's start.
        end: (...) f at its end.
        curvature: (...) ``C h^2 / 2``.

    Returns:
        (...) upper bound of f on the interval; +inf where one of the three is not a number.
    """
    xp, a, b, c = arrays(start, end, curvature)
    rise = b - a
    inside = xp.abs(rise) < c
    # the quotient by itself, since many intervals often share a curvature; of one too small to be seen beside
    # anything a larger one is as good
    vertex = a + (c + rise) ** 2 * (0.25 / xp.maximum(c, np.sqrt(np.finfo(c.dtype).tiny)))
    bound = xp.where(inside, vertex, xp.maximum(a, b))
    return xp.where(xp.isnan(rise + c), xp.inf, bound)
