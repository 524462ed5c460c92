"""The momentum that wheels hold in the middle of a timeline, with which its next part starts."""

from dataclasses import replace

import numpy as np

from jaxplan.model.kinematics import Kinematics
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import PSEUDO_INVERSE
from jaxplan.timeline.tracking import State


def total_in(craft: Spacecraft, state: State) -> np.ndarray | None:
    """Total momentum (3,) N m s, inertial axes, in a state in which wheels hold what they store.

    It stays what it is; None without wheels.
    """
    if not craft.wheels:
        return None
    assert craft.wheel_array is not None
    return np.asarray(state.attitude @ (_carried(craft, state) + np.asarray(craft.wheel_array.stored)))


def holding(craft: Spacecraft, total: np.ndarray | None, state: State) -> Spacecraft:
    """The spacecraft whose wheels store what a total momentum leaves them in a state.

    Where an array shares out so that the largest share is least, the wheels are given the shares of its
    pseudo-inverse, since only their sum counts.

    Args:
        craft: as it is at the start.
        total: (3,) N m s, inertial axes, see `total_in`; None without wheels, which leaves all as it is.
        state: of the spacecraft.
    """
    if total is None:
        return craft
    array = craft.wheel_array
    assert array is not None
    held = state.attitude.T @ total - _carried(craft, state)
    each = np.linalg.pinv(np.asarray(array.axes).T) @ held
    if craft.allocation == PSEUDO_INVERSE:
        each = each + np.asarray(array.apart)
    wheels = tuple(replace(wheel, stored=float(own)) for wheel, own in zip(craft.wheels, each, strict=True))
    return replace(craft, wheels=wheels)


def _carried(craft: Spacecraft, state: State) -> np.ndarray:
    """Momentum (3,) N m s, body axes, of all but the wheels."""
    motion = Kinematics(
        spin=[state.velocity],
        joints=[state.joints, state.rates],
        inertia=craft.fixed_inertia,
        stages=craft.stages,
    )
    return np.asarray(motion.momentum)
