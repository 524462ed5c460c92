"""Compute a start state in which devices point along their targets, at the rates at which these move.

Such a state begins a manoeuvre while a telescope looks at one thing and an antenna follows another, so that
no attitude need be computed by hand. Of all attitudes the one nearest to the wishes is taken, and among those
the one turned least from a given attitude. Spacecraft have n terminals and d drives, with J = 2n + d joints.

The platform turns at the least rates with which all devices follow. A boresight ``u`` follows its direction
``z`` where ``R (omega x u + y' Y x u + p' P x u) = z'``, with the axes ``Y`` and ``P`` about which its joints
turn at the rates ``y'`` and ``p'``, all vectors but ``z`` in body axes. A terminal can do so whatever the
platform's angular velocity ``omega`` is. An instrument fixes two components of ``omega``, and a drive one,
across what its joint can do; of all ``omega`` that meet these conditions the shortest is taken, so that
nothing turns about a boresight without need. Goals that follow targets take the same rates. k is the number
of devices with targets.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import length
from jaxplan.goal import Decomposition, decompose
from jaxplan.goal.aims import apart, off
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

_RANK_TOLERANCE = 1e-9  # singular values below this share of the largest one count as zero
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


def least_rates(
    craft: Spacecraft, targets: Targets, state: Goal, target_rates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return rates with which devices follow their targets.

    Args:
        craft: the spacecraft.
        targets: which devices have targets.
        state: attitude and joints at which these devices point along their targets.
        target_rates: (k, 3) 1/s, time derivatives of the inertial directions of k targets.

    Returns:
        (3,) angular velocity, rad/s, body axes, and (J,) joint rates, rad/s; those of other devices are zero.
    """
    gimbals, numbers = craft.gimbals, targets.numbers(craft)
    attitude, joints = np.asarray(state.attitude, float), np.asarray(state.joints, float)
    turned = np.asarray(target_rates, float).reshape(-1, 3) @ attitude  # in body axes
    azimuth, _ = gimbals.angles(joints)
    boresights = np.concatenate([gimbals.boresights(joints), craft.fixed_boresights])
    matrix, right = [np.zeros((0, 3))], [np.zeros(0)]
    by_joints = {}
    for number, rate in zip(numbers, turned, strict=True):
        beam = boresights[number]
        across = np.linalg.svd(beam[None])[2][1:]  # (2, 3), how a direction can change
        if number < gimbals.count:
            axes = np.concatenate(gimbals.axes(azimuth[[number]], np.array([number])))
            axes = axes[: 2 if number < gimbals.terminals else 1]
            by_joints[number] = np.cross(axes, beam)
            across = _uncontrolled_directions(across, by_joints[number])
        # (omega x u) . c = omega . (u x c)
        matrix.append(np.cross(beam, across))
        right.append(across @ rate)
    spin = np.linalg.pinv(np.concatenate(matrix), rcond=_RANK_TOLERANCE) @ np.concatenate(right)
    rates = np.zeros(len(joints))
    for number, rate in zip(numbers, turned, strict=True):
        if number in by_joints:
            left = rate - np.cross(spin, boresights[number])
            own = [gimbals.yaws[number], *gimbals.pitches[number : number + 1]]
            rates[own] = np.linalg.pinv(by_joints[number].T, rcond=_RANK_TOLERANCE) @ left
    return spin, rates


def differentiable_rates(
    craft: Spacecraft, targets: Targets, attitude: Array, joints: Array, target_rates: Array
) -> tuple[Array, Array]:
    """Return the rates of `least_rates` as JAX arrays, with derivatives.

    Args:
        craft: the spacecraft.
        targets: which devices have targets.
        attitude: (3, 3) body to inertial, at which these devices point along their targets.
        joints: (J,) rad, likewise.
        target_rates: (k, 3) 1/s, time derivatives of the inertial directions of k targets.

    Returns:
        (3,) angular velocity, rad/s, body axes, and (J,) joint rates, rad/s. The rates of a terminal that
        points along its yaw axis are NaN or infinite.
    """
    gimbals = craft.gimbals
    turned = jnp.asarray(target_rates).reshape(-1, 3) @ attitude  # in body axes
    azimuth, _ = gimbals.angles(joints)
    fixed = jnp.asarray(craft.fixed_boresights, turned.dtype)
    boresights = jnp.concatenate([gimbals.boresights(joints), fixed])
    matrix, right = [jnp.zeros((0, 3))], [jnp.zeros(0)]
    by_joints: dict[int, Any] = {}
    for number, rate in zip(targets.numbers(craft), turned, strict=True):
        beam = boresights[number]
        across = jnp.zeros((0, 3))
        if number < gimbals.count:
            axes = jnp.concatenate(gimbals.axes(azimuth[np.array([number])], np.array([number])))
            axes = axes[: 2 if number < gimbals.terminals else 1]
            by_joints[number] = jnp.cross(axes, beam)  # at right angles to each other
            if number >= gimbals.terminals:
                across = _normalise(jnp.cross(beam, by_joints[number][0]))[None]
        else:
            first = _normalise(jnp.cross(beam, jnp.eye(3)[jnp.argmin(jnp.abs(beam))]))
            across = jnp.stack([first, jnp.cross(beam, first)])
        matrix.append(jnp.cross(beam, across))
        right.append(across @ rate)
    rows, spin = jnp.concatenate(matrix), jnp.zeros(3)
    if len(rows):
        spin = jnp.linalg.pinv(rows, rtol=_RANK_TOLERANCE) @ jnp.concatenate(right)
    rates = jnp.zeros(joints.shape)
    for number, rate in zip(targets.numbers(craft), turned, strict=True):
        if number in by_joints:
            left = rate - jnp.cross(spin, boresights[number])
            moved = by_joints[number]
            rates = rates.at[gimbals.joints_of(number)].set(moved @ left / jnp.sum(moved**2, axis=1))
    return spin, rates


def _normalise(vector: Array) -> Array:
    """Return a vector (3,) brought to unit length."""
    return jnp.asarray(vector / length(vector))


def _uncontrolled_directions(directions: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Return a basis of the part of a plane in which joints cannot move a beam: c orthonormal rows (c, 3).

    Args:
        directions: (2, 3) orthonormal vectors that span the plane across the beam.
        moved: (j, 3) derivatives of the beam by the j joints.
    """
    across = directions @ moved.T
    _, sizes, own = np.linalg.svd(across.T)
    rank = int(np.sum(sizes > _RANK_TOLERANCE * max(float(np.max(sizes, initial=0.0)), _RANK_TOLERANCE)))
    return np.asarray(own[rank:] @ directions)
