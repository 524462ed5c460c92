"""The momentum that wheels hold in the middle of a timeline, with which its next part starts.

The functions compute with numpy, or with JAX if a state or a number of the spacecraft is traced.
"""

from dataclasses import replace

import numpy as np

from jaxplan.geometry.vectors import AnyArray, array_module
from jaxplan.model.kinematics import Kinematics
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import PSEUDO_INVERSE
from jaxplan.timeline.tracking import State


def total_in(craft: Spacecraft, state: State) -> AnyArray | None:
    """Return the total momentum (3,), N m s, inertial axes, of a state in which wheels hold what they store.

    It is conserved over the whole timeline. None for a spacecraft without wheels.
    """
    if not craft.wheels:
        return None
    assert craft.wheel_array is not None
    return state.attitude @ (_momentum_without_wheels(craft, state) + craft.wheel_array.stored)


def holding(craft: Spacecraft, total: AnyArray | None, state: State) -> Spacecraft:
    """Return a spacecraft whose wheels store what a conserved total momentum leaves to them in a state.

    With the allocation "minimax" the wheels are given the momenta of the pseudo-inverse instead, since only
    their sum counts.

    Args:
        craft: the spacecraft as it is at the start.
        total: (3,) N m s, inertial axes, see `total_in`; None without wheels, for which `craft` is returned.
        state: the state of the spacecraft then.
    """
    if total is None:
        return craft
    array = craft.wheel_array
    assert array is not None
    held = state.attitude.T @ total - _momentum_without_wheels(craft, state)
    xp = array_module(array.axes, held)
    each = xp.linalg.pinv(array.axes.T) @ held
    if craft.allocation == PSEUDO_INVERSE:
        each = each + array.apart
    stored = each.tolist() if xp is np else list(each)
    wheels = tuple(replace(wheel, stored=own) for wheel, own in zip(craft.wheels, stored, strict=True))
    return replace(craft, wheels=wheels)


def _momentum_without_wheels(craft: Spacecraft, state: State) -> AnyArray:
    """Return the angular momentum (3,), N m s, body axes, of everything but the wheels."""
    motion = Kinematics(
        spin=[state.velocity],
        joints=[state.joints, state.rates],
        inertia=craft.fixed_inertia,
        stages=craft.stages,
    )
    return array_module(motion.momentum).asarray(motion.momentum)
