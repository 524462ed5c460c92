"""Bounds of the inertia of a spacecraft whose gimbals have one of their own, at all joint angles.

In body axes the inertia of stage k turns with its joints (`jaxplan.model.stages`), but its principal moments,
from ``a_k`` to ``b_k``, do not change. So with ``J_0`` of what joints do not turn

    J_0 + sum a_k  <=  J(q)  <=  J_0 + sum b_k,    |J(q) - J_c| <= sum (b_k - a_k) / 2,

in the order of quadratic forms, about ``J_c = J_0 + sum (a_k + b_k) / 2``. The momentum in body axes is
``L = J w + p``, and its derivative ``J w' + J' w + p'``, with ``p = sum I_k g_k`` of the stages' angular
velocities ``g_k`` relative to the body. These are along two axes at right angles, with the rates of the two
joints, and their derivatives along three, with the joints' accelerations and the product of their rates. As
``I_k' = g_k^ I_k - I_k g_k^`` is the same of ``I_k - c``, whatever ``c`` is,

    |p| <= sum b_k |g_k|,    |J'| <= sum (b_k - a_k) |g_k|,
    |p'| <= sum (b_k - a_k) / 2 |g_k|^2 + b_k |g_k'|.

Without stages all three inertias are ``J``, and the others zero. SI units.
"""

from typing import NamedTuple

import numpy as np

from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.spacecraft import Spacecraft


class InertiaBounds(NamedTuple):
    """Between what the inertia lies, and what stages add at most.

    Attributes:
        least: (3, 3) kg m^2, no more than any that there is.
        middle: (3, 3) kg m^2.
        greatest: (3, 3) kg m^2, no less than any.
        off: kg m^2, by which it differs from the middle at most.
        swept: kg m^2/s, its derivative at most.
        carried: N m s, that stages carry at most by their own rates, ``p``.
        pushed: N m, the derivative of that in body axes at most.
    """

    least: AnyArray
    middle: AnyArray
    greatest: AnyArray
    off: AnyArray = 0.0
    swept: AnyArray = 0.0
    carried: AnyArray = 0.0
    pushed: AnyArray = 0.0


def inertia_bounds(craft: Spacecraft) -> InertiaBounds:
    """The bounds of a spacecraft with an inertia, within the limits of its joints."""
    stages = craft.stages
    if stages is None:
        return InertiaBounds(craft.whole_inertia, craft.whole_inertia, craft.whole_inertia)
    xp, fixed, inertias, rates, accelerations = arrays(
        craft.fixed_inertia, stages.inertias, craft.joint_rate_limits, craft.joint_acceleration_limits
    )
    moments = xp.linalg.eigvalsh(inertias)
    low, high = moments[:, 0], moments[:, 2]
    (yaw, pitch), (yaw_growth, pitch_growth) = (
        (own[np.array(stages.yaws)], xp.where(np.array(stages.pitches) < 0, 0, own[np.array(stages.pitches)]))
        for own in (rates, accelerations)
    )
    square = yaw**2 + pitch**2
    rate, growth = xp.sqrt(square), xp.sqrt(yaw_growth**2 + pitch_growth**2 + (yaw * pitch) ** 2)
    identity = np.eye(3)
    return InertiaBounds(
        least=fixed + xp.sum(low) * identity,
        middle=fixed + xp.sum(low + high) / 2 * identity,
        greatest=fixed + xp.sum(high) * identity,
        off=xp.sum(high - low) / 2,
        swept=xp.sum((high - low) * rate),
        carried=xp.sum(high * rate),
        pushed=xp.sum((high - low) / 2 * square + high * growth),
    )


def most_by(top: AnyArray, bounds: InertiaBounds, push: AnyArray) -> AnyArray:
    """The largest length of ``x``, at most `top`, for which ``J x`` may have the length `push`.

    It is ``|J_c^-1| (push + off |x|)`` at most, and less than any number where that tells nothing.
    """
    xp, top, off, push, middle = arrays(top, bounds.off, push, bounds.middle)
    light = 1 / xp.linalg.eigvalsh(middle)[0]
    telling = light * off < 1
    return xp.where(telling, xp.minimum(top, light * push / xp.where(telling, 1 - light * off, 1)), top)
