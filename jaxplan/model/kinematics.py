"""A motion of platform, joints and wheels, as limited quantities are computed from it.

Vectors of the platform are in body axes, with their components first. What wheels give and hold follows from
the total momentum of platform and wheels (`jaxplan.model.wheels`), which turns with the body. Stages of
gimbals that have an inertia carry momentum of their own (`jaxplan.model.stages`).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from jaxplan.geometry.vectors import AnyArray, array_module, arrays, cross
from jaxplan.model.stages import Stages
from jaxplan.model.wheels import WheelArray


class Kinematics(NamedTuple):
    """A motion as quantities are computed from it, components first; what none of them needs may be left out.

    Attributes:
        spin: angular velocity and its derivatives by time, each (3, ...), rad/s, rad/s^2, rad/s^3.
        joints: angles and their derivatives by time, each (2n + d, ...), rad, rad/s, rad/s^2.
        drives: number of the joints, d, that are drives' angles.
        inertia: (3, 3) or (3, 3, ...) kg m^2, without that of the stages.
        total: (3, ...) N m s, the total momentum of platform and wheels in body axes, ``R^T H``.
        array: of the wheels; None without.
        stages: of gimbals that have an inertia; None without.
        carried: what these carry, as of `Stages.carried`, where it is known; else it is found when needed.
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
        """The same, knowing what its stages carry, which several quantities are computed from."""
        return self if self.stages is None else self._replace(carried=self._carried)

    @property
    def _carried(self) -> Sequence[AnyArray]:
        """What stages carry; nothing without any."""
        if self.carried is not None:
            return self.carried
        return () if self.stages is None else self.stages.carried(self.spin, self.joints)

    def angles(self, which: int) -> AnyArray:
        """Angles (c, ...) rad of the terminals' yaws (`which` = 0) or pitches (1), or of the drives (2)."""
        joints = self.joints[0]
        terminals = (len(joints) - self.drives) // 2
        return joints[which * terminals : (which + 1) * terminals if which < 2 else None]

    @property
    def momentum(self) -> AnyArray:
        """``L``, (3, ...) N m s: that of all but the wheels, ``J omega``, to which stages add."""
        own = _product(self.inertia, self.spin[0])
        return own if self.stages is None else own + self._carried[0]

    @property
    def momentum_change(self) -> AnyArray:
        """``L'``, (3, ...) N m: the derivative of `momentum` in body axes."""
        own = _product(self.inertia, self.spin[1])
        return own if self.stages is None else own + self._carried[1]

    @property
    def torque(self) -> AnyArray:
        """Torque of actuators (3, ...) N m: ``L' + omega x L``; wheels have ``R^T H`` there."""
        turned = self.momentum if self.total is None else self.total
        return self.momentum_change + _stacked(cross(self.spin[0], turned))

    @property
    def wheel_torques(self) -> AnyArray:
        """Products (r, ...) N m of the wheels' rows with their torque ``L' + omega x (R^T H)``."""
        return _product(self._array.rows, self.momentum_change) + self.turning_torques

    @property
    def turning_torques(self) -> AnyArray:
        """The part (r, ...) N m of `wheel_torques` that turns the total momentum, ``omega x (R^T H)``."""
        return _product(self._array.rows, _stacked(cross(self.spin[0], self.total)))

    @property
    def wheel_momenta(self) -> AnyArray:
        """Momenta (r, ...) N m s that the wheels' rows limit: of ``R^T H - L``, and what lies apart."""
        return self.resting_momenta - _product(self._array.rows, self.momentum)

    @property
    def resting_momenta(self) -> AnyArray:
        """The `wheel_momenta` (r, ...) N m s that there would be if the body rested at these attitudes."""
        held = _product(self._array.rows, self.total)
        apart = self._array.apart
        return held + apart.reshape(*apart.shape, *[1] * (held.ndim - apart.ndim))

    @property
    def _array(self) -> WheelArray:
        """The wheels."""
        if self.array is None:
            raise ValueError("without wheels they give and hold nothing")
        return self.array


def _product(matrix: Any, vector: AnyArray) -> AnyArray:
    """A matrix (k, 3), or one for each of many vectors (3, ...), times the vectors."""
    _, m, v = arrays(matrix, vector)
    m = m.reshape(*m.shape, *[1] * (v.ndim + 1 - m.ndim))
    return m[:, 0] * v[0] + m[:, 1] * v[1] + m[:, 2] * v[2]


def _stacked(components: Sequence[AnyArray]) -> AnyArray:
    """Components as one array, of numpy or JAX."""
    return array_module(*components).stack(components)
