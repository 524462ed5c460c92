"""Find what wheels store in the states that slews leave, from what they store at the reference.

The total momentum of platform and wheels is constant in inertial axes, so what wheels hold in a state follows
from the state alone, whatever slews led there (`jaxplan.timeline.wheel_momentum`).
"""

from dataclasses import replace

import numpy as np

from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheel_reach import shared_out
from jaxplan.model.wheels import MINIMAX
from jaxplan.planner.wheel_room import total_at_start
from jaxplan.timeline.tracking import State
from jaxplan.timeline.wheel_momentum import holding

_ROUNDING = 1e-9  # of a wheel's limit, by which it may be exceeded and counts as kept


def loaded(reference: Scenario, state: GivenState) -> Spacecraft:
    """Return the spacecraft of a scenario with what its wheels store in another state than the start.

    Args:
        reference: with what wheels store at its start.
        state: the state, with rates of platform and joints. Its wheels may be overfull, see `overload_text`.
    """
    craft, total = reference.spacecraft, total_at_start(reference)
    if total is None:
        return craft
    moving = replace(
        State.still(state.attitude, np.asarray(state.joints, float)),
        velocity=np.asarray(state.angular_velocity, float),
        rates=np.asarray(state.joint_rates, float),
    )
    held = holding(craft, total, moving)
    stored, most = (np.array([getattr(one, name) for one in held.wheels]) for name in ("stored", "momentum"))
    if craft.allocation == MINIMAX and held.wheel_array is not None:  # which lets them hold nothing in vain
        stored = shared_out(held.wheel_array.axes, most, held.wheel_array.stored)
    within = np.abs(stored) <= (1 + _ROUNDING) * most
    stored = np.where(within, np.clip(stored, -most, most), stored)
    own = zip(craft.wheels, stored.tolist(), strict=True)
    return replace(craft, wheels=tuple(replace(wheel, stored=each) for wheel, each in own))


def overload_text(scene: Scenario) -> str:
    """Return text on the wheel of a scene that stores most beyond what a plan may use; empty if none does."""
    over = [
        (abs(wheel.stored) / usable.momentum, wheel.name, abs(wheel.stored), usable.momentum)
        for wheel, usable in zip(scene.spacecraft.wheels, scene.usable.wheels, strict=True)
    ]
    share, name, held, most = max(over, default=(0.0, "", 0.0, 0.0))
    if share <= 1 + _ROUNDING:
        return ""
    return (
        f'wheel "{name}" would hold {held:.4g} N m s there, of {most:.4g} N m s at most, by what is stored '
        "at the start: lower spacecraft.wheel.stored_nms, raise momentum_nms, or change the goal"
    )
