"""The momentum that wheels hold in the middle of a timeline, with which its next part starts."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jaxplan.model.kinematics import Kinematics
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import PSEUDO_INVERSE
from jaxplan.timeline.tracking import State
from jaxplan.trajectory import Trajectory
from jaxplan.trajectory.curve import total_momentum


def holding(
    craft: Spacecraft, parts: Sequence[tuple[float, Trajectory, Spacecraft]], state: State
) -> Spacecraft:
    """The spacecraft whose wheels store what they hold in a state after a motion in parts.

    The total momentum is that of the first part, all along. Where an array shares out so that the largest
    share is least, the wheels are given the shares of its pseudo-inverse, since only their sum counts.

    Args:
        craft: with wheels, as they are at the start.
        parts: of the motion, each after the time (s) at which it begins.
        state: at its end.
    """
    _, first, own = parts[0]
    total = total_momentum(first, own)
    array = craft.wheel_array
    assert total is not None
    assert array is not None
    carried = Kinematics(
        spin=[state.velocity],
        joints=[state.joints, state.rates],
        inertia=craft.fixed_inertia,
        stages=craft.stages,
    ).momentum
    held = state.attitude.T @ np.asarray(total) - np.asarray(carried)
    each = np.linalg.pinv(np.asarray(array.axes).T) @ held
    if craft.allocation == PSEUDO_INVERSE:
        each = each + np.asarray(array.apart)
    wheels = tuple(replace(wheel, stored=float(own)) for wheel, own in zip(craft.wheels, each, strict=True))
    return replace(craft, wheels=wheels)
