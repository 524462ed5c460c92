"""A state in which devices point along their targets now, at the rates at which these move.

It is the start of a manoeuvre that begins while a telescope looks at one thing and an antenna follows
another, so that no attitude need be computed by hand. Of all attitudes the one is taken that comes nearest to
the wishes, and then that which is turned least from a given one. Rates are the least of the platform with
which all devices follow.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.goal import decompose
from jaxplan.goal.rates import least_rates
from jaxplan.model.constraints import constraint_margins, state_margins
from jaxplan.model.path import Goal
from jaxplan.model.scenario import GivenState, Scenario, Targets, Wish
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import JointBound, KeepIn, KeepOut
from jaxplan.schema.reading import take_in

_GOALS = 8  # attitudes that are looked at, for one that is clear of all zones


class NotPointingError(ValueError):
    """No state points as it is asked to; the message says what is in the way."""


def point(
    spacecraft: Spacecraft,
    targets: Targets | Mapping[str, Any],
    *,
    prefer: Sequence[Wish] = (),
    attitude: ArrayLike | None = None,
    joints: ArrayLike | None = None,
    keep_out: Sequence[KeepOut] = (),
    keep_in: Sequence[KeepIn] = (),
    joint_bounds: Sequence[JointBound] = (),
) -> GivenState:
    """The state in which devices point along their targets at the start, and follow them.

    Args:
        spacecraft: its devices.
        targets: by names of devices inertial unit vectors (3,), or paths of what moves; or `Targets`.
        prefer: what devices without a target shall come near to, in order.
        attitude: (3, 3) body to inertial, from which the platform is turned least; the identity unless told.
        joints: (2n + d,) rad, of devices without a target; zero, or what is nearest in range, unless told.
        keep_out: zones that hold at the start, likewise the next two.
        keep_in: zones to stay in.
        joint_bounds: bounds of joint angles.

    Returns:
        A start for scenarios.

    Raises:
        NotPointingError: if there is none, with what is in the way.
        ScenarioError: for what no scenario may have, such as a device that there is not.

    Example:
        >>> start = jp.point(spacecraft, {"telescope": [0.0, 0.0, 1.0]})
        >>> jp.Scenario(name="from there", spacecraft=spacecraft, start=start, goal=goal)
    """
    asked = targets if isinstance(targets, Targets) else Targets.of(targets)
    asked = replace(asked, prefer=(*asked.prefer, *prefer))
    still = GivenState(rotation_vector=np.zeros(3), joints=np.zeros(spacecraft.joint_count))
    scenario = take_in(
        Scenario(
            name="start",
            spacecraft=spacecraft,
            start=still if joints is None else replace(still, joints=joints),  # type: ignore[arg-type]
            goal=asked,
            keep_out=tuple(keep_out),
            keep_in=tuple(keep_in),
            joint_bounds=tuple(joint_bounds),
        )
    )
    craft, goal = scenario.spacecraft, scenario.goal
    assert isinstance(goal, Targets)
    given = scenario.start.joints
    return pointing_state(craft, goal, scenario.constraints, attitude=attitude, joints=given)


def pointing_state(
    spacecraft: Spacecraft,
    asked: Targets,
    rows: Any,
    *,
    attitude: ArrayLike | None = None,
    joints: ArrayLike | None = None,
) -> GivenState:
    """The state of `point`, with all constraints as rows."""
    near = np.eye(3) if attitude is None else np.asarray(attitude, float)
    rest = np.clip(0.0 if joints is None else np.asarray(joints, float), *spacecraft.joint_ranges.T)
    now, then = asked.at(0.0), rows.at(0.0)
    found = decompose(spacecraft, near, now, then, start_joints=rest, max_goals=_GOALS)
    clear = [goal for goal in found.goals if _is_clear(spacecraft, then, goal)]
    if not clear:
        raise NotPointingError(
            "no attitude lets all devices point at their targets at the start"
            if not found.goals
            else "every attitude from which all devices point at their targets at the start breaks a zone"
        )
    goal = clear[0]
    spin, rates = np.zeros(3), np.zeros(len(goal.joints))
    if asked.moves:
        spin, rates = least_rates(spacecraft, asked, goal, asked.rates(0.0))
    return GivenState(
        rotation_vector=np.asarray(so3.log(goal.attitude)),
        joints=np.asarray(goal.joints),
        angular_velocity=spin,
        joint_rates=rates,
    )


def _is_clear(spacecraft: Spacecraft, rows: Any, goal: Goal) -> bool:
    sights = rows.sights(spacecraft.gimbals, spacecraft.fixed_boresights)
    margins = constraint_margins(rows, state_margins(rows, sights, goal.attitude, goal.joints))
    return bool(np.all(margins >= 0))
