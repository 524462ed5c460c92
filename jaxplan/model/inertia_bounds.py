"""Bounds of the inertia of a spacecraft whose gimbals have an inertia, valid at all joint angles.

In body axes the inertia ``I_k`` of stage k turns with its joints (`jaxplan.model.stages`), but its principal
moments, from ``a_k`` to ``b_k``, do not change. So with ``J_0`` the inertia of all that joints do not turn

    J_0 + sum a_k  <=  J(q)  <=  J_0 + sum b_k,    |J(q) - J_c| <= sum (b_k - a_k) / 2,

in the order of quadratic forms, about the middle ``J_c = J_0 + sum (a_k + b_k) / 2``; numbers stand for that
multiple of the identity. The momentum in body axes is ``L = J w + p``, and its derivative
``J w' + J' w + p'``, with ``w`` the angular velocity of the body, ``p = sum I_k g_k``, and ``g_k`` the
stages' angular velocities relative to the body. A ``g_k`` has components along two axes at right angles, the
rates of the two joints; its derivative has them along three, the joints' accelerations and the product of
their rates. Since ``I_k' = g_k^ I_k - I_k g_k^`` is the same for ``I_k - c`` with any number ``c``,

    |p| <= sum b_k |g_k|,    |J'| <= sum (b_k - a_k) |g_k|,
    |p'| <= sum (b_k - a_k) / 2 |g_k|^2 + b_k |g_k'|.

Without stages all three inertias are ``J``, and the other bounds are zero. SI units.
"""

from typing import NamedTuple

import numpy as np

from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.spacecraft import Spacecraft


class InertiaBounds(NamedTuple):
    """Bounds of the inertia, and of what moving stages add; letters are as in the module's docstring.

    Attributes:
        least: (3, 3) kg m^2, a lower bound of the inertia as a quadratic form.
        middle: (3, 3) kg m^2, ``J_c``.
        greatest: (3, 3) kg m^2, an upper bound of the inertia as a quadratic form.
        off: kg m^2, bound of the norm of the inertia's difference from the middle.
        swept: kg m^2/s, bound of the norm of the inertia's derivative.
        carried: N m s, bound of the length of ``p``, the momentum that stages carry by their own rates.
        pushed: N m, bound of the length of ``p'``, its derivative in body axes.
    """

    least: AnyArray
    middle: AnyArray
    greatest: AnyArray
    off: AnyArray = 0.0
    swept: AnyArray = 0.0
    carried: AnyArray = 0.0
    pushed: AnyArray = 0.0


def inertia_bounds(craft: Spacecraft) -> InertiaBounds:
    """Return the bounds for a spacecraft that has an inertia.

    Joints may have any angle, and any rate and acceleration within their limits.
    """
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
    """Return the largest length that a vector ``x`` may have if ``J x`` has at most the length `push`.

    That is at most ``|J_c^-1| (push + off |x|)``.

    Args:
        top: the largest length that ``x`` may have in any case.
        bounds: bounds of the inertia ``J``.
        push: largest length of ``J x``.

    Returns:
        The length, at most `top`; `top` itself where the inequality tells nothing.
    """
    xp, top, off, push, middle = arrays(top, bounds.off, push, bounds.middle)
    light = 1 / xp.linalg.eigvalsh(middle)[0]
    telling = light * off < 1
    return xp.where(telling, xp.minimum(top, light * push / xp.where(telling, 1 - light * off, 1)), top)
