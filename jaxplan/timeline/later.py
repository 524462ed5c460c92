"""The scene and the spacecraft as they are in the middle of a timeline, from which its next part starts."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jaxplan.model.directions import DirectionPath
from jaxplan.model.kinematics import Kinematics
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import PSEUDO_INVERSE
from jaxplan.timeline.tracking import State
from jaxplan.trajectory import Trajectory
from jaxplan.trajectory.curve import total_momentum

_PAD = 60.0  # s beyond a span of time, for which directions are kept


def at_time(scene: Scenario, time: float, duration: float | None = None) -> Scenario:
    """The scene as it is from a time, s, on: what moves is known from there on, for a duration if given.

    Directions are those of the scene to the last bit, as far as they are kept.
    """
    last = np.inf if duration is None else time + duration + _PAD

    def shifted(path: DirectionPath) -> DirectionPath:
        first = max(0, int(np.searchsorted(path.times, time - _PAD)) - 2)
        beyond = int(np.searchsorted(path.times, last)) + 3
        own = slice(first, beyond)
        return replace(path, times=path.times[own] - time, samples=path.samples[own], slopes=path.slopes[own])

    def moved(zone: Any) -> Any:
        return replace(zone, direction=shifted(zone.direction)) if zone.moves else zone

    return replace(
        scene,
        keep_out=tuple(moved(zone) for zone in scene.keep_out),
        keep_in=tuple(moved(zone) for zone in scene.keep_in),
        epoch=None,
    )


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
