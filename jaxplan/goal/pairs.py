"""Pairs of a row and a sight at a goal: which are settled, and which the attitude decides on as caps.

Most directions are known at a goal in one of two frames (`jaxplan.goal.aims`): targets and inertial axes in
the inertial one; boresights of instruments, axes of the body and held devices in the body's. A pair of a row
and a sight in the same frame is *settled*: its margin is the same at every attitude. A pair with one of
either is a *cap*, see `jaxplan.goal.caps`, and so is a row of joints that bounds a yaw or a pitch alone. All
other pairs depend on the joint angles: step 1 leaves them *open*. Everything computes with numpy or JAX, as
its arguments do. Shapes: Z rows, S sights, J joints.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, array_module, arrays
from jaxplan.goal.aims import Known
from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT, Constraints, joint_values, pair_margins
from jaxplan.model.directions import Sights
from jaxplan.model.scores import room

_PLACEHOLDER_DIRECTION = np.array([0.0, 0.0, 1.0])  # stands for a direction that is not known


class Pairs(NamedTuple):
    """All pairs of Z rows and S sights at a goal: settled or cap, with the margin or the cap of each.

    Attributes:
        settled: (Z, S) bool, pairs whose margin is the same at every attitude.
        margin: (Z, S) rad, margins of the settled pairs, positive where kept; meaningless for the others.
        capped: (Z, S) bool, pairs that are caps. The cap of a bound of a yaw needs others beside it, see
            `caps`.
        axis: (Z, S, 3) axes of the caps, unit vectors in body axes.
        direction: (Z, S, 3) inertial unit vectors that must stay out of the caps.
        half_angle: (Z, S) rad, of the caps.
    """

    settled: AnyArray
    margin: AnyArray
    capped: AnyArray
    axis: AnyArray
    direction: AnyArray
    half_angle: AnyArray


def pairs_at_goal(rows: Constraints, sights: Sights, known: Known, rest: ArrayLike) -> Pairs:
    """Return all pairs of a scene as they are at a goal.

    Args:
        rows: the constraints, at an instant.
        sights: the directions that they bind.
        known: which of these directions are known, and where.
        rest: (J,) rad, joints that held devices keep.
    """
    xp, toward, along, axis = arrays(known.toward, known.along, rows.axis)
    side, half_angle = rows.side[:, None], rows.half_angle[:, None]
    inertial, in_body = rows.frame == INERTIAL, rows.frame == BODY
    outside, inside = axis, axis
    if rows.inner:
        another, partner = rows.frame == SIGHT, rows.partner
        inertial = inertial | (another & xp.asarray(known.inertial)[partner])
        in_body = in_body | (another & xp.asarray(known.in_body)[partner])
        outside = xp.where(another[:, None], toward[partner], axis)
        inside = xp.where(another[:, None], along[partner], axis)
    both_outside = inertial[:, None] & known.inertial
    both_inside = in_body[:, None] & known.in_body
    settled = rows.bound & (both_outside | both_inside)

    def apart(sights: AnyArray, axes: AnyArray) -> AnyArray:
        # an angle to a vector of length zero, which stands for one that is not known, has no derivative
        known = (
            xp.where(_is_known(part), part, _PLACEHOLDER_DIRECTION.astype(part.dtype))
            for part in (sights, axes)
        )
        return pair_margins(rows, *known)

    margin = apart(toward, outside)
    if rows.inner:
        margin = xp.where(both_outside, margin, apart(along, inside))
    by_attitude = (inertial[:, None] & known.in_body) | (in_body[:, None] & known.inertial)
    of_body = xp.asarray(known.in_body)[:, None] & inertial[:, None, None]
    pairs = Pairs(
        settled=settled,
        margin=margin,
        capped=rows.bound & by_attitude & ~settled,
        axis=side[..., None] * xp.where(of_body, along, inside[:, None]),
        direction=xp.where(of_body, outside[:, None], toward),
        half_angle=xp.broadcast_to(xp.where(side > 0, 0, np.pi) + side * half_angle, rows.bound.shape),
    )
    return _with_joint_rows(pairs, rows, sights, known, rest) if rows.inner else pairs


def _is_known(vectors: AnyArray) -> AnyArray:
    """Tell which vectors (..., 3) are not zero, as (..., 1) bool; zero stands for a direction not known."""
    known: AnyArray = array_module(vectors).any(vectors != 0, axis=-1, keepdims=True)
    return known


def _with_joint_rows(pairs: Pairs, rows: Constraints, sights: Sights, known: Known, rest: ArrayLike) -> Pairs:
    """Return the pairs with those of rows of joints filled in, for arguments as in `pairs_at_goal`.

    Such a pair is settled for a held device, and a cap where the row bounds a yaw or a pitch alone.
    """
    xp, normal, bound, frames = arrays(rows.axis, rows.half_angle, sights.gimbals.frames)
    of_yaw, sign = single_yaws(rows), xp.sign(normal[:, 0] + normal[:, 1])
    edge = sign * (bound - np.pi / 2)
    across = frames[:, :, 0] * xp.cos(edge)[:, None, None] + frames[:, :, 1] * xp.sin(edge)[:, None, None]
    upward = -sign[:, None, None] * frames[:, :, 2]
    rest_of = ((0, 0), (0, rows.bound.shape[1] - frames.shape[0]), (0, 0))
    axis = xp.pad(xp.where(of_yaw[:, None, None], across, upward), rest_of)
    half_angle = np.pi / 2 + xp.where(of_yaw, 0, bound)[:, None]
    ours = (rows.frame == JOINTS)[:, None]
    one_plane = of_yaw[:, None] & ~known.winds  # else no plane says which turn a yaw is in
    alone = (one_plane | (normal[:, 0] == 0)[:, None]) & known.inertial
    values = xp.swapaxes(joint_values(rows, sights.gimbals, rest), -1, -2)
    held = ours & known.angles
    return pairs._replace(
        settled=xp.where(ours, rows.bound & held, pairs.settled),
        margin=xp.where(ours, values - bound[:, None], pairs.margin),
        capped=xp.where(ours, rows.bound & alone, pairs.capped),
        axis=xp.where(ours[..., None], axis, pairs.axis),
        direction=xp.where(ours[..., None], known.toward, pairs.direction),
        half_angle=xp.where(ours, half_angle, pairs.half_angle),
    )


def single_yaws(rows: Constraints) -> AnyArray:
    """Tell which of Z rows are of joints and bound a yaw alone, as (Z,) bool."""
    return (rows.frame == JOINTS) & (rows.axis[:, 1] == 0)


def cleared(rows: Constraints, pairs: Pairs, clearance: ArrayLike) -> Constraints:
    """Return the constraints, each tightened by a clearance as far as the attitude can keep it.

    A row is tightened by at most half of the room that it leaves (`room`), and by no more than the least
    margin of its settled pairs, since no attitude helps these.

    Args:
        rows: the constraints, at an instant.
        pairs: the pairs of these rows and their sights.
        clearance: rad, the clearance wanted.
    """
    xp, margin, half_angle, side, wanted = arrays(pairs.margin, rows.half_angle, rows.side, clearance)
    settled = xp.min(xp.where(pairs.settled, margin, xp.inf), axis=-1, initial=xp.inf)
    kept = xp.minimum(wanted, xp.minimum(room(rows), xp.maximum(settled, 0)))
    away = xp.where(rows.frame == JOINTS, 1, side)
    widened: Constraints = replace(rows, half_angle=half_angle + away * kept)
    return widened


def open_pairs(rows: Constraints, pairs: Pairs) -> AnyArray:
    """Tell which pairs are bound but neither settled nor caps, so that joints decide on them.

    The result is (Z, S) bool, Z rows by S sights.
    """
    return rows.bound & ~pairs.settled & ~pairs.capped
