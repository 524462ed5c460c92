"""What each pair of a row and a sight asks of the attitude at a goal.

At a goal a terminal points along its target ``z``, so along ``R^T z`` in the body. Of most directions it is
known, then, where they are in one of two frames: targets and inertial axes in the inertial one, boresights of
instruments and axes of the body in the body's. A pair of the same frame is settled whatever the attitude; one
of either is a cap that a direction keeps out of (`caps`). So is a row of joints that bounds a yaw or a pitch
alone. All other pairs depend on what the joints are: step 1 leaves them open, and who uses a goal checks them
in its state.

All of it computes with numpy or JAX, as its arguments do. Shapes: Z rows, S sights.
"""

from typing import NamedTuple

import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.arrays import AnyArray, arrays
from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT, Constraints, pair_margins
from jaxplan.model.sights import Sights


class Pairs(NamedTuple):
    """Every pair at a goal.

    Attributes:
        settled: (Z, S) bool, pairs that the attitude changes nothing about.
        margin: (Z, S) rad, of those that are settled.
        capped: (Z, S) bool, pairs that are caps. A bound of a yaw is one beside others, see `caps`.
        axis: (Z, S, 3) of the cap, unit vectors in body axes.
        direction: (Z, S, 3) unit vectors that stay out of the caps, inertial.
        half_angle: (Z, S) rad.
    """

    settled: AnyArray
    margin: AnyArray
    capped: AnyArray
    axis: AnyArray
    direction: AnyArray
    half_angle: AnyArray


def pairs_at_goal(rows: Constraints, sights: Sights, directions: ArrayLike) -> Pairs:
    """All pairs of a scene as they are at a goal.

    Args:
        rows: the constraints, at an instant.
        sights: what they bind.
        directions: (n, 3) inertial unit vectors that the terminals point along.
    """
    xp, toward, fixed, axis = arrays(directions, sights.fixed, rows.axis)
    side, half_angle = rows.side[:, None], rows.half_angle[:, None]
    known = _known(sights)
    seen = xp.concatenate([toward, fixed, xp.zeros(sights.carried.shape, toward.dtype)])
    frame = rows.frame[:, None]
    if rows.inner:
        another = frame == SIGHT
        axis = xp.where(another, seen[rows.partner], axis)
        frame = xp.where(another, xp.asarray(known)[rows.partner][:, None], frame)
    in_body = known == BODY
    mixed = ((frame == INERTIAL) & in_body) | ((frame == BODY) & (known == INERTIAL))
    pairs = Pairs(
        settled=rows.bound & (frame == known) & (known != JOINTS),
        margin=pair_margins(rows, seen, axis),
        capped=rows.bound & mixed,
        axis=side[..., None] * xp.where(in_body[:, None], seen, axis[:, None]),
        direction=xp.where(in_body[:, None], axis[:, None], seen),
        half_angle=xp.broadcast_to(xp.where(side > 0, 0, np.pi) + side * half_angle, rows.bound.shape),
    )
    return _with_joints(pairs, rows, sights, seen) if rows.inner else pairs


def _known(sights: Sights) -> np.ndarray:
    """The frame (S,) in which each sight is known at a goal; `JOINTS` where it takes the joints to know."""
    counts = [sights.mounts.shape[0], sights.fixed.shape[0], sights.carried.shape[0]]
    return np.repeat([INERTIAL, BODY, JOINTS], counts)


def _with_joints(pairs: Pairs, rows: Constraints, sights: Sights, seen: AnyArray) -> Pairs:
    """The pairs with caps for rows of joints that bound a yaw or a pitch alone."""
    xp, normal, bound, mounts = arrays(rows.axis, rows.half_angle, sights.mounts)
    of_yaw, sign = single_yaws(rows), xp.sign(normal[:, 0] + normal[:, 1])
    rest = np.zeros(rows.bound.shape[1] - mounts.shape[0])
    edge = xp.concatenate([mounts, rest]) + (sign * (bound - np.pi / 2))[:, None]
    yaw_axis = xp.stack([xp.cos(edge), xp.sin(edge), xp.zeros_like(edge)], axis=-1)
    pitch_axis = -sign[:, None, None] * np.array([0.0, 0.0, 1.0])
    half_angle = np.pi / 2 + xp.where(of_yaw, 0, bound)[:, None]
    ours = (rows.frame == JOINTS)[:, None]
    alone = of_yaw | (normal[:, 0] == 0)
    return pairs._replace(
        capped=xp.where(ours, rows.bound & alone[:, None], pairs.capped),
        axis=xp.where(ours[..., None], xp.where(of_yaw[:, None, None], yaw_axis, pitch_axis), pairs.axis),
        direction=xp.where(ours[..., None], seen, pairs.direction),
        half_angle=xp.where(ours, half_angle, pairs.half_angle),
    )


def single_yaws(rows: Constraints) -> AnyArray:
    """(Z,) bool, the rows of joints that bound a yaw alone."""
    return (rows.frame == JOINTS) & (rows.axis[:, 1] == 0)


def leaves_open(rows: Constraints, sights: Sights, directions: ArrayLike) -> bool:
    """Whether there are pairs that neither the targets nor the attitude at a goal decide."""
    pairs = pairs_at_goal(rows, sights, directions)
    return bool(np.any(rows.bound & ~pairs.settled & ~pairs.capped))
