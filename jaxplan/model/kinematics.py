"""The motion of platform, joints and wheels, from which all limited quantities are computed, and its slowing.

Vectors of the platform are in body axes, and the first axis of an array is that of their components. What
wheels give and hold follows from the total momentum of platform and wheels (`jaxplan.model.wheels`), which is
constant in inertial axes. *Stages*, moving parts of gimbals that have an inertia, carry momentum of their own
(`jaxplan.model.stages`).

A motion that is slowed down to ``s`` times its duration passes the same attitudes and joint angles, and what
is limited falls by a power of ``s``; a *lesser* part of it falls by one power less (`jaxplan.model.limits`).
So the shortest duration at which it keeps a limit follows exactly from the largest fraction of the limit that
it uses.

Letters: ``omega`` angular velocity, ``J`` inertia, ``L`` momentum of all but the wheels, ``H`` total momentum
in inertial axes, ``R`` attitude (body to inertial). There are 2n + d joints of n terminals and d drives, and
r rows that limit the array of wheels.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, array_module, arrays, cross
from jaxplan.model.stages import Stages
from jaxplan.model.wheels import WheelArray

_MAX_LESSER_SHARE = 1 + 1e-12  # fraction of a limit up to which a lesser part counts as within it


class Kinematics(NamedTuple):
    """A motion, as limited quantities are computed from it; what none of them needs may be left out.

    Array shapes end in the same "...", such as the number of times.

    Attributes:
        spin: angular velocity and its derivatives with respect to time, body axes, each (3, ...), in rad/s,
            rad/s^2, rad/s^3.
        joints: joint angles and their derivatives with respect to time, each (2n + d, ...), in rad, rad/s,
            rad/s^2.
        drives: the number d of joints that are drives' angles.
        inertia: (3, 3) or (3, 3, ...) kg m^2, without that of the stages.
        total: (3, ...) N m s, total momentum of platform and wheels in body axes, ``R^T H``.
        array: the array of wheels; None without wheels.
        stages: stages of gimbals that have an inertia; None without any.
        carried: result of `Stages.carried`, if it is known; else it is computed when it is needed.
    """

    spin: Sequence[AnyArray] = ()
    joints: Sequence[AnyArray] = ()
    drives: int = 0
    inertia: AnyArray | None = None
    total: AnyArray | None = None
    array: WheelArray | None = None
    stages: Stages | None = None
    carried: Sequence[AnyArray] | None = None

    @property
    def known(self) -> "Kinematics":
        """The same motion with `carried` computed if there are stages, for use by several quantities."""
        return self if self.stages is None else self._replace(carried=self._stage_momentum)

    @property
    def _stage_momentum(self) -> Sequence[AnyArray]:
        """Momentum of the stages and its derivative, from `Stages.carried`; empty without stages."""
        if self.carried is not None:
            return self.carried
        return () if self.stages is None else self.stages.carried(self.spin, self.joints)

    def angles(self, which: int) -> AnyArray:
        """Return the angles (c, ...) rad of one kind of joint.

        Args:
            which: 0 for the terminals' yaws, 1 for their pitches, 2 for the drives' angles.
        """
        joints = self.joints[0]
        terminals = (len(joints) - self.drives) // 2
        return joints[which * terminals : (which + 1) * terminals if which < 2 else None]

    @property
    def momentum(self) -> AnyArray:
        """``L``, (3, ...) N m s, body axes: momentum of all but the wheels, ``J omega`` plus the stages'."""
        own = _apply_matrix(self.inertia, self.spin[0])
        return own if self.stages is None else own + self._stage_momentum[0]

    @property
    def momentum_change(self) -> AnyArray:
        """``L'``, (3, ...) N m: derivative of the components of `momentum` in body axes."""
        own = _apply_matrix(self.inertia, self.spin[1])
        return own if self.stages is None else own + self._stage_momentum[1]

    @property
    def torque(self) -> AnyArray:
        """Torque of the actuators (3, ...) N m, body axes: ``L' + omega x L``.

        Where `total` is given, as it is with wheels, it is ``L' + omega x (R^T H)``.
        """
        turned = self.momentum if self.total is None else self.total
        return self.momentum_change + _stack_components(cross(self.spin[0], turned))

    @property
    def wheel_torques(self) -> AnyArray:
        """Torques (r, ...) N m that the r rows of the array of wheels limit.

        They are the products of the rows with the torque of all wheels in body axes,
        ``L' + omega x (R^T H)``.
        """
        return _apply_matrix(self._wheel_array.rows, self.momentum_change) + self.turning_torques

    @property
    def turning_torques(self) -> AnyArray:
        """The part (r, ...) N m of `wheel_torques` by ``omega x (R^T H)``.

        It is the torque that turns the total momentum with the body.
        """
        return _apply_matrix(self._wheel_array.rows, _stack_components(cross(self.spin[0], self.total)))

    @property
    def wheel_momenta(self) -> AnyArray:
        """Momenta (r, ...) N m s that the r rows of the array of wheels limit.

        They are the products of the rows with the momentum of all wheels in body axes, ``R^T H - L``, plus
        the momenta by which wheels work against each other (`WheelArray.apart`).
        """
        return self.resting_momenta - _apply_matrix(self._wheel_array.rows, self.momentum)

    @property
    def resting_momenta(self) -> AnyArray:
        """What `wheel_momenta` (r, ...) N m s would be if the body rested at the same attitudes."""
        held = _apply_matrix(self._wheel_array.rows, self.total)
        apart = self._wheel_array.apart
        return held + apart.reshape(*apart.shape, *[1] * (held.ndim - apart.ndim))

    @property
    def _wheel_array(self) -> WheelArray:
        """The array of wheels; ValueError if there is none."""
        if self.array is None:
            raise ValueError("without wheels they give and hold nothing")
        return self.array


def _apply_matrix(matrix: Any, vector: AnyArray) -> AnyArray:
    """Multiply a matrix (k, 3), or matrices (k, 3, ...), by vectors (3, ...), to (k, ...)."""
    _, m, v = arrays(matrix, vector)
    m = m.reshape(*m.shape, *[1] * (v.ndim + 1 - m.ndim))
    return m[:, 0] * v[0] + m[:, 1] * v[1] + m[:, 2] * v[2]


def _stack_components(components: Sequence[AnyArray]) -> AnyArray:
    """Stack components to one array, of numpy or JAX."""
    return array_module(*components).stack(components)


def time_factor(share: ArrayLike, power: int | np.ndarray, lesser: ArrayLike | None = None) -> AnyArray:
    """Return by how much the duration of a motion must be multiplied to use exactly the whole of a limit.

    Args:
        share: (...) magnitude of a quantity over its limit, the quantity having a power above zero. If there
            is a lesser part, the rest of the quantity over its limit, with its sign.
        power: the power of the quantity: 1 or more; with a lesser part 1 or 2.
        lesser: (...) lesser part of the quantity over its limit, with its sign; None for none.

    Returns:
        ``share ** (1 / power)``; at zero, where the root has no derivative, zero is taken for it. With a
        lesser part the least factor such that the limit is kept at this and at all larger factors; infinite
        if there is none.
    """
    if lesser is not None:
        return _least_time_factor(share, power, lesser)
    xp, given = arrays(share)
    zero = given == 0
    return xp.where(zero, 0, xp.where(zero, 1, given) ** (1 / power))


def _least_time_factor(share: ArrayLike, power: int | np.ndarray, lesser: ArrayLike) -> AnyArray:
    """Return the least ``s`` from which on ``|share / s^p + lesser / s^(p - 1)| <= 1``, with p the power."""
    xp, a, b = arrays(share, lesser)
    if power == 1:
        room = 1 - xp.where(a < 0, -b, b)
        open_ = room > 0
        found = xp.where(open_, xp.abs(a) / xp.where(open_, room, 1), xp.where(a == 0, 0, xp.inf))
        return xp.where(xp.abs(b) > _MAX_LESSER_SHARE, xp.inf, xp.where(xp.isnan(a + b), xp.nan, found))
    found = xp.where(xp.isnan(a + b), xp.nan, 0 * a)
    for sign in (1, -1):  # the larger root of s^2 - sign b s - sign a
        square = b * b + 4 * sign * a
        real = square > 0
        size, along = xp.sqrt(xp.where(real, square, 1)), sign * b
        back = xp.where(along < 0, size - along, 1)  # so that no digits cancel
        root = xp.where(along < 0, 2 * sign * a / back, (along + size) / 2)
        found = xp.where(real & (root > found), root, found)
    return found
