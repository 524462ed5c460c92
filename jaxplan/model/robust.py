"""The tube about a plan: errors of attitude and joints that a plan must tolerate, and reserves of its limits.

A spacecraft flies what its controller makes of a plan. A `Robust` says by how much the platform may be turned
away from the plan, about any axis, and by how much each joint; every zone, mask and range then holds for all
attitudes and joint angles within these errors, the *tube*. Angles add, so a margin falls by the angle by
which direction and axis can move towards each other, its *loss*:

- for a direction against an inertial axis: the attitude error plus the swing of the device that carries it;
- for a direction against an axis of the body, or the boresight of another device: the sum of the swings of
  both, or nothing if the same joints carry both;
- for ``f . (yaw, pitch) >= d``: the joint error times ``|f_1| + |f_2|``.

The *swing* is the largest angle by which joint errors ``e`` turn a direction that a device carries. The two
rotations of a terminal are about axes at right angles, so together they are one by
``2 arccos(cos(e / 2)^2)``, sqrt(2) e for small ones, which is reached by the boresight where the pitch is
about zero. The swing of a drive is ``e``; what is fixed to the body has none.

Half angles, ranges and limits of torque and momentum are tightened in one place, `Scenario.constraints` and
`Scenario.usable`, so that planners need not know of errors. Functions compute with numpy or JAX, as their
arguments do. Angles in rad.
"""

from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np

from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.devices import Drive, Terminal
from jaxplan.model.file_keys import keyed
from jaxplan.model.gimbals import stacked
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.display import shown


@shown("attitude_error deg", "joint_error deg", "torque_reserve", "momentum_reserve")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Robust:
    """Errors that a plan must tolerate, and shares of limits that it must not use.

    Attributes:
        attitude_error: rad, by which the platform may be turned away from the plan, about any axis.
        joint_error: rad, by which each joint may be off the plan.
        torque_reserve: percent of every limit of torque that is kept back for the controller.
        momentum_reserve: percent of every limit of wheel momentum that is kept back, since a body whose
            inertia differs from the stated one needs another momentum to turn as planned.
    """

    attitude_error: float = keyed(
        0.0,
        "attitude_error_deg",
        "by which the platform may be turned off the plan, about any axis",
        "[0, 90)",
    )
    joint_error: float = keyed(0.0, "joint_error_deg", "by which each joint may be off the plan", "[0, 90)")
    torque_reserve: float = keyed(
        0.0, "torque_reserve_percent", "of all limits of torque, kept back for the controller", "[0, 100)"
    )
    momentum_reserve: float = keyed(
        0.0,
        "momentum_reserve_percent",
        "of all limits of wheel momentum, kept back for errors of the inertia",
        "[0, 100)",
    )

    @property
    def words(self) -> str:
        """Text that names the tube in messages, with the errors by their keys in files, in degrees."""
        errors = {"attitude": self.attitude_error, "joint": self.joint_error}
        told = ", ".join(f"{name}_error_deg = {np.rad2deg(error):.6g}" for name, error in errors.items())
        return f"the tube of [robust] ({told})"

    @property
    def told(self) -> str:
        """Text for people with the errors in degrees and the reserves in percent."""
        attitude, joints = np.rad2deg([self.attitude_error, self.joint_error])
        reserves = {"torque": self.torque_reserve, "wheel momentum": self.momentum_reserve}
        kept = " and ".join(f"{share:.6g} % of {name}" for name, share in reserves.items() if share)
        told = f"{attitude:.6g} deg of attitude and {joints:.6g} deg of joints"
        return f"{told}, with {kept} kept back" if kept else told

    @property
    def terminal_swing(self) -> AnyArray:
        """The largest angle, rad, by which errors of yaw and pitch turn what a terminal carries."""
        xp, error = arrays(self.joint_error)
        # from sin(a / 2)^2 = 1 - cos(e / 2)^4, so that no digit is lost where e is small
        return 2 * xp.arcsin(xp.sin(error / 2) * xp.sqrt(1 + xp.cos(error / 2) ** 2))

    def swing(self, device: object) -> Any:
        """Return the largest angle, rad, by which joint errors turn what a device carries.

        The device may be None for the body.
        """
        if isinstance(device, Terminal):
            return self.terminal_swing
        return self.joint_error if isinstance(device, Drive) else 0.0

    def loss(self, device: object, other: object, *, inertial: bool) -> Any:
        """Return by how much, rad, errors may reduce the margin between a direction and an axis.

        Args:
            device: the device that carries the direction; None for the body.
            other: the device that carries the axis; None for the body or the inertial frame.
            inertial: whether the axis is inertial.
        """
        if inertial:
            return self.attitude_error + self.swing(device)
        return 0.0 if device is other else self.swing(device) + self.swing(other)

    def loss_of_joints(self, normal: Any) -> Any:
        """Return by how much, rad, joint errors may reduce ``normal . (yaw, pitch)``, for a normal (2,)."""
        return self.joint_error * (abs(normal[0]) + abs(normal[1]))


def usable(craft: Spacecraft, robust: Robust) -> Spacecraft:
    """Return the spacecraft with ranges, torque and wheel momentum reduced to what a plan may use.

    The result is a new spacecraft whose JAX tree has the same structure.
    """
    kept, held = 1 - robust.torque_reserve / 100, 1 - robust.momentum_reserve / 100
    wheels = tuple(
        replace(wheel, torque=wheel.torque * kept, momentum=wheel.momentum * held) for wheel in craft.wheels
    )
    torque, momentum = craft.torque_limit, craft.wheel_momentum_limit
    return replace(
        craft,
        torque_limit=None if torque is None else torque * kept,
        wheel_momentum_limit=None if momentum is None else momentum * held,
        wheels=wheels,
        terminals=tuple(_narrow_terminal(terminal, robust.joint_error) for terminal in craft.terminals),
        drives=tuple(
            replace(one, range=_narrow_range(one.range, robust.joint_error)) for one in craft.drives
        ),
    )


def _narrow_terminal(terminal: Terminal, error: Any) -> Terminal:
    """Return the terminal with its ranges narrowed by an error, rad, at either end."""
    yaw, pitch = (_narrow_range(ends, error) for ends in terminal.ranges)
    return replace(
        terminal,
        yaw_limit=None if terminal.yaw_limit is None else _numpy_to_float(yaw[1]),
        yaw_range=None if terminal.yaw_range is None else yaw,
        pitch_limit=None if terminal.pitch_limit is None else _numpy_to_float(pitch[1]),
        pitch_range=None if terminal.pitch_range is None else pitch,
    )


def _narrow_range(ends: Any, error: Any) -> AnyArray:
    """Return the ends (2,) rad of a range after narrowing it by an error, rad, at either end."""
    return stacked([ends[0] + error, ends[1] - error])


def _numpy_to_float(value: Any) -> Any:
    """Turn a scalar of numpy into a float of Python; leave anything else, such as one of JAX, as it is."""
    return float(value) if isinstance(value, np.floating) else value
