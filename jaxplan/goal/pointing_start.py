"""Compute a start state in which devices point along their targets, at the rates at which these move.

Such a state begins a manoeuvre while a telescope looks at one thing and an antenna follows another, so that
no attitude need be computed by hand. Of all attitudes the one nearest to the wishes is taken, and among those
the one turned least from a given attitude. The platform turns at the least rates with which all devices
follow. Spacecraft have n terminals and d drives, with 2n + d joints.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.goal import Decomposition, decompose
from jaxplan.goal.rates import least_rates
from jaxplan.goal.unreachable_messages import apart, off
from jaxplan.model.breaches import ROUNDING, constraint_breaches, in_own_zone
from jaxplan.model.constraints import Constraints
from jaxplan.model.goals import GivenState, Targets, Wish
from jaxplan.model.hidden_spans import hidden_words
from jaxplan.model.path import Goal
from jaxplan.model.robust import Robust
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import JointBound, KeepIn, KeepOut
from jaxplan.schema.reading import take_in

_MAX_GOALS = 8  # most attitudes that are tried, for one that is clear of all zones


class NotPointingError(ValueError):
    """Raised where no state points as asked; the message says what is in the way."""


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
    robust: Robust | None = None,
) -> GivenState:
    """Return a state in which devices point along their targets at the start, and follow them.

    Args:
        spacecraft: its devices.
        targets: inertial unit vectors (3,), or paths of moving directions, by names of devices; or `Targets`.
        prefer: wishes: directions that devices without a target shall come near to, in the order of priority.
        attitude: (3, 3) body to inertial, from which the platform is turned as little as possible; the
            identity by default.
        joints: (2n + d,) rad for n terminals and d drives, which devices without a target or a wish have
            then, whatever is in their way; by default zero, or the nearest angles that are in range and clear
            of zones.
        keep_out: zones to stay out of at the start.
        keep_in: zones to stay in at the start.
        joint_bounds: bounds of joint angles at the start.
        robust: errors of the state in spite of which zones and ranges must hold; None for none.

    Returns:
        A start for scenarios, with the rates of platform and joints.

    Raises:
        NotPointingError: if there is no such state, or a target is hidden then; the message says what is in
            the way.
        ScenarioError: for values that no scenario may have, such as a device that does not exist.

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
            robust=robust,
        )
    )
    craft, goal = scenario.spacecraft, scenario.goal
    assert isinstance(goal, Targets)
    if joints is None:
        return pointing_state(scenario, goal, attitude=attitude)
    # Devices whose angles are given keep these, whatever is in their way.
    asked_for = (*goal.names(craft), *(wish.device for wish in goal.prefer))
    told = tuple(name for name in craft.device_names[: craft.gimbals.count] if name not in asked_for)
    return pointing_state(scenario, replace(goal, hold=told), attitude=attitude, joints=scenario.start.joints)


def pointing_state(
    scenario: Scenario, asked: Targets, *, attitude: ArrayLike | None = None, joints: ArrayLike | None = None
) -> GivenState:
    """Return the state of `point` for the spacecraft and zones of a scenario.

    Args:
        scenario: whose spacecraft and zones count.
        asked: targets at the start; devices in `hold` keep the given joints.
        attitude: (3, 3) body to inertial, as for `point`.
        joints: all joint angles, rad, as for `point`.

    Raises:
        NotPointingError: if there is no such state, or a target is hidden then; the message says what is in
            the way.
    """
    spacecraft, rows = scenario.usable, scenario.constraints
    near = np.eye(3) if attitude is None else np.asarray(attitude, float)
    given = np.zeros(spacecraft.joint_count) if joints is None else np.asarray(joints, float)
    rest = np.clip(given, *spacecraft.joint_ranges.T)
    _check_range(spacecraft, asked.hold, given, rest)
    _check_targets_visible(spacecraft, asked)
    now, then = asked.at(0.0), rows.at(0.0)
    found = decompose(spacecraft, near, now, then, start_joints=rest, max_goals=_MAX_GOALS)
    if not found.goals and found.aim_excess > 0:
        raise NotPointingError(_unreachable_message(spacecraft, now, found))
    if not found.goals:
        bare = replace(scenario, keep_out=(), keep_in=(), joint_bounds=()).constraints.at(0.0)
        free = decompose(spacecraft, near, now, bare, start_joints=rest, max_goals=1)
        raise NotPointingError(
            _blocked_message(scenario, asked, [_breach_phrases(scenario, then, one) for one in free.goals])
        )
    broken = [_breach_phrases(scenario, then, goal) for goal in found.goals]
    if all(broken):
        raise NotPointingError(_blocked_message(scenario, asked, broken))
    goal = found.goals[broken.index([])]
    spin, rates = np.zeros(3), np.zeros(len(goal.joints))
    if asked.moves:
        spin, rates = least_rates(spacecraft, asked, goal, asked.rates(0.0))
    return GivenState(
        rotation_vector=np.asarray(so3.log(goal.attitude)),
        joints=np.asarray(goal.joints),
        angular_velocity=spin,
        joint_rates=rates,
    )


def _check_range(craft: Spacecraft, held: Sequence[str], given: np.ndarray, near: np.ndarray) -> None:
    """Raise `NotPointingError` if a held device is given a joint angle out of its range.

    Args:
        craft: the spacecraft.
        held: names of the held devices.
        given: the joint angles of all devices, rad.
        near: the same clipped to their ranges, rad.
    """
    for number, name in enumerate(craft.device_names[: craft.gimbals.count]):
        for joint in (craft.gimbals.yaws[number], *craft.gimbals.pitches[number : number + 1]):
            if name in held and abs(given[joint] - near[joint]) > ROUNDING:
                angle, end = np.rad2deg([given[joint], near[joint]])
                what = f"{craft.joint_names[joint]} is {angle:.6g} deg at the start"
                raise NotPointingError(f"{what}, beyond its limit of {end:.6g} deg")


def _check_targets_visible(craft: Spacecraft, asked: Targets) -> None:
    """Raise `NotPointingError` if a target is hidden at the start, with what hides it and until when."""
    each = [
        hidden_words(path.hidden, name, 0.0, float(path.times[-1]), "at the start")
        for name, path in zip(asked.names(craft), asked.paths, strict=True)
    ]
    unseen = [phrase for phrase in each if phrase is not None]
    if unseen:
        raise NotPointingError("; ".join(unseen))


def _unreachable_message(craft: Spacecraft, asked: Targets, found: Decomposition) -> str:
    """Return text saying that no attitude has all devices on target, and which devices miss at best."""
    words = "no attitude lets all devices point at their targets at the start"
    return f"{words}: {apart(craft, asked) or 'at best ' + off(craft, asked, found.aim_excesses)}"


def _blocked_message(scenario: Scenario, asked: Targets, broken: Sequence[Sequence[str]]) -> str:
    """Return text saying that zones leave no attitude with all devices on target, and what is in the way.

    `broken` holds, for some of the attitudes with all devices on target, the nearest first, phrases of what
    each breaks.
    """
    certain = in_own_zone(scenario.spacecraft, scenario.cones, asked, 0.0)
    if certain is not None:
        return certain
    tube = "" if scenario.robust is None else f", with {scenario.robust.words} about it"
    words = "every attitude from which all devices point at their targets at the start breaks a zone"
    phrases = next(filter(None, broken), ())
    return f"{words}{tube}" + (f"; at one of them {'; '.join(phrases)}" if phrases else "")


def _breach_phrases(scenario: Scenario, rows: Constraints, goal: Goal) -> list[str]:
    """Return a phrase for each of the rows' constraints that a goal breaks."""
    zones = [scenario.zones[zone] for zone in rows.zone if zone >= 0]
    state = scenario.spacecraft, goal.attitude, goal.joints
    return list(constraint_breaches(rows, *state, zones, scenario.sight_names))
