"""Goals at which no wheel is full, by zones that step 1 keeps.

What a wheel holds while the body rests follows from the attitude ``R`` alone: it is ``row . R^T H + apart``,
with the total momentum ``H`` of body and wheels, which is constant in inertial axes, and a row of the array
(`jaxplan.model.wheels`). It stays below a limit where the direction of ``H`` keeps out of two cones about
body axes, along the row and against it. Those are keep-out zones, which only the choice of a goal knows.

A wheel that is just full at the goal has no room for what the body holds before it comes to rest there. So
goals leave some of the limit, much of it if there are such goals.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jaxplan.model.goals import GivenState
from jaxplan.model.path import Goal
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import row_names
from jaxplan.model.zones import FixedVector, KeepOut
from jaxplan.trajectory.kernels import Body

SHARES = (0.9, 0.99)
"""Fractions of their limits that wheels may hold at goals, tried in turn."""
_FULL = 1 + 1e-6  # fraction of a limit above which a wheel is overfull, beyond rounding
_SAME_SHARE = 1e-6  # fraction of a limit by which what a wheel holds at a goal differs at most from `SHARES`


def total_at_start(scenario: Scenario) -> np.ndarray | None:
    """Return the total momentum (3,), N m s, inertial axes, of a scenario's start; None without wheels."""
    start, craft = scenario.start, scenario.usable
    if craft.wheel_array is None:
        return None
    rates = np.concatenate([start.angular_velocity, start.joint_rates])
    return np.asarray(start.attitude @ Body.of(craft, start.joints, rates).total)


def fullest(craft: Spacecraft, total: np.ndarray, attitudes: np.ndarray) -> np.ndarray:
    """Return the largest fractions of the limits that wheels hold while the body rests.

    Args:
        craft: a spacecraft with wheels, with the limits that may be used.
        total: (3,) N m s, total momentum, inertial axes.
        attitudes: (..., 3, 3) body to inertial.

    Returns:
        (...) fractions of the limits, above 1 for a wheel, or the envelope, that is overfull.
    """
    array = craft.wheel_array
    assert array is not None
    held = (total @ attitudes) @ array.rows.T + array.apart
    return np.asarray(np.max(np.abs(held) / array.momentum, axis=-1))


def overfull(craft: Spacecraft, total: np.ndarray | None, attitudes: np.ndarray) -> bool:
    """Tell whether a wheel would be overfull at any of some attitudes; never without wheels (`total` None).

    Arguments are those of `fullest`.
    """
    return total is not None and bool(np.any(fullest(craft, total, attitudes) > _FULL))


def leans_on_wheels(scenario: Scenario, goal: Goal) -> bool:
    """Tell whether a wheel holds just as much at a goal as `with_wheel_room` allows it."""
    total = total_at_start(scenario)
    if total is None or isinstance(scenario.goal, GivenState):
        return False
    share = fullest(scenario.usable, total, goal.attitude)
    return bool(np.any(np.abs(share - np.array(SHARES)) <= _SAME_SHARE))


def with_wheel_room(scenario: Scenario, total: np.ndarray | None) -> Iterator[Scenario]:
    """Yield a scenario with zones that keep attitudes at which wheels hold at most `SHARES` of their limits.

    It is left out where no attitude does, and nothing is yielded without wheels, for which `total` is None.

    Args:
        scenario: the problem.
        total: (3,) N m s, total momentum, inertial axes.
    """
    if total is None or not np.any(total):
        return
    for share in SHARES:
        zones = _zones(scenario.usable, total, share)
        if zones is not None:
            yield replace(scenario, keep_out=(*scenario.keep_out, *zones))


def _zones(craft: Spacecraft, total: np.ndarray, share: float) -> tuple[KeepOut, ...] | None:
    """The zones that leave wheels at most `share` of their limits; None if no attitude does."""
    array, size, zones = craft.wheel_array, float(np.linalg.norm(total)), list[KeepOut]()
    assert array is not None
    for name, row, apart, most in zip(
        row_names(craft.wheels, craft.allocation), array.rows, array.apart, array.momentum, strict=True
    ):
        length = float(np.linalg.norm(row))
        for side, way in ((1.0, "along"), (-1.0, "against")) if length else ():
            cosine = (share * most - side * apart) / (size * length)
            if cosine <= -1:
                return None
            if cosine < 1:
                zones.append(
                    KeepOut(
                        name=f"momentum {way} {name}",
                        direction=total / size,
                        half_angle=float(np.arccos(cosine)),
                        vectors=(FixedVector(along=side * row / length),),
                    )
                )
    return tuple(zones)
