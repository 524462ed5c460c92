"""Check that a state keeps the limits and meets every constraint; return a phrase for each breach."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jaxplan.model.breaches import ROUNDING, constraint_breaches, in_own_zone
from jaxplan.model.goals import Targets
from jaxplan.model.hidden_spans import hidden_words
from jaxplan.model.kinematics import Kinematics
from jaxplan.model.scenario import Scenario, known_until, moves, target_paths
from jaxplan.model.wheels import MINIMAX, row_names


def breaches(
    scenario: Scenario,
    attitude: np.ndarray,
    joints: np.ndarray,
    angular_velocity: np.ndarray,
    joint_rates: np.ndarray,
    *,
    arriving: bool = False,
    time: float = 0.0,
) -> tuple[str, ...]:
    """Return a phrase for each thing a state breaks: ranges, rates, zones, room for joints to brake.

    Args:
        scenario: limits and zones.
        attitude: (3, 3) body to inertial.
        joints: (2n + d,) rad, of n terminals and d drives: yaws, pitches, drives.
        angular_velocity: (3,) rad/s, body axes.
        joint_rates: (2n + d,) rad/s.
        arriving: whether the state ends a motion, so that the joints must have been in range just before it;
            if False it starts one, and the joints must be able to brake within their ranges.
        time: s, when the state is reached; moving zones are taken where they are then.

    Returns:
        Phrases that name device, zone or limit, and the overlap in degrees; empty when nothing is broken.
        Where the tube about the state (`Scenario.robust`) makes a difference, the last phrase says so.
    """
    state = attitude, joints, angular_velocity, joint_rates
    found = _state_breaches(scenario, *state, arriving, time)
    if not found or scenario.robust is None:
        return found
    alone = _state_breaches(replace(scenario, robust=None), *state, arriving, time)
    if alone == found:  # such as rates, of which errors take nothing
        return found
    tube = scenario.robust.words
    return (*found, f"this counts with {tube} about it" if alone else f"without {tube} it breaks nothing")


def _state_breaches(
    scenario: Scenario,
    attitude: np.ndarray,
    joints: np.ndarray,
    angular_velocity: np.ndarray,
    joint_rates: np.ndarray,
    arriving: bool,
    time: float,
) -> tuple[str, ...]:
    """Return the phrases of `breaches` except the last one on the tube; arguments as there."""
    craft = scenario.usable
    found = [] if np.all(np.isfinite(attitude)) else ["the attitude is not made of finite numbers"]
    found += [
        f"{name} is {np.rad2deg(excess):.4g} deg beyond its limit of {np.rad2deg(limit):.4g} deg"
        for name, excess, limit in zip(craft.joint_names, *_range_excess(scenario, joints), strict=True)
        if not excess <= ROUNDING
    ]
    bounds, norm = np.full(3, craft.rate_limit), craft.rate_norm_limit
    axis = np.argmax(np.abs(angular_velocity) / bounds)
    rates = [
        (f"the platform's rate about {'xyz'[axis]}", abs(angular_velocity[axis]), bounds[axis]),
        *(
            []
            if norm is None
            else [("the length of the platform's rate", np.linalg.norm(angular_velocity), norm)]
        ),
        *zip(
            [f"the rate of {name}" for name in craft.joint_names],
            np.abs(joint_rates),
            craft.joint_rate_limits,
            strict=True,
        ),
    ]
    found += [
        f"{name} is {np.rad2deg(rate):.4g} deg/s, its limit {np.rad2deg(limit):.4g} deg/s"
        for name, rate, limit in rates
        if not rate <= limit * (1 + ROUNDING)
    ]
    found += _braking_breaches(scenario, joints, joint_rates, arriving)
    rows = scenario.constraints.at(time)
    stated = scenario.zones
    zones = [stated[zone] for zone in rows.zone if zone >= 0]
    return (*found, *constraint_breaches(rows, craft, attitude, joints, zones, scenario.sight_names))


def _range_excess(scenario: Scenario, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how far joints (J,), rad, exceed the nearer end of their range, and that end, (J,) rad.

    The excess is negative within the range. The end is signed, but positive if the range is symmetric.
    """
    low, high = scenario.usable.joint_ranges.T
    upper = joints - high >= low - joints
    end = np.where(upper, high, np.where(low == -high, high, low))
    return np.where(upper, joints - high, low - joints), end


def start_breaches(scenario: Scenario) -> tuple[str, ...]:
    """Return a phrase for everything that the scenario's start breaks, overfull wheels included."""
    start = scenario.start
    state = start.attitude, start.joints, start.angular_velocity, start.joint_rates
    return (*breaches(scenario, *state), *_wheel_breaches(scenario), *_axis_momentum_breaches(scenario))


def _wheel_breaches(scenario: Scenario) -> Iterator[str]:
    """Yield a phrase for each wheel that stores more momentum at the start than a plan may use.

    With the allocation "minimax" wheels are checked in pairs: there is a phrase for the worst pair, across
    which the array as a whole stores too much.
    """
    craft, array = scenario.usable, scenario.usable.wheel_array
    if array is None:
        return
    stored = np.asarray(array.rows @ array.stored + array.apart)
    shares = np.abs(stored) / array.momentum
    broken = np.flatnonzero(~(shares <= 1 + ROUNDING))
    envelope = craft.allocation == MINIMAX
    if envelope and len(broken):
        broken = broken[[np.argmax(shares[broken])]]
    names = row_names(craft.wheels, craft.allocation)
    for row in broken:
        owner = f"the {names[row]}" if envelope else f'wheel "{names[row]}"'
        most = _momentum_limit_text(scenario, float(array.momentum[row]), float(stored[row]))
        yield f"{owner} stores {stored[row]:.6g} N m s at the start, of {most}"


def _axis_momentum_breaches(scenario: Scenario) -> Iterator[str]:
    """Yield a phrase for each body axis about which the start has more momentum than the wheels may hold.

    The limit is `wheel_momentum_limit`, N m s, and the momentum that of the body and its stages in motion.
    """
    craft, start = scenario.usable, scenario.start
    if craft.wheel_momentum_limit is None or craft.inertia is None:
        return
    motion = Kinematics(
        spin=[np.asarray(start.angular_velocity)],
        joints=[np.asarray(start.joints), np.asarray(start.joint_rates)],
        inertia=craft.fixed_inertia,
        stages=craft.stages,
    )
    limits = np.broadcast_to(np.asarray(craft.wheel_momentum_limit, float), 3)
    for axis, held, limit in zip("xyz", np.asarray(motion.momentum).tolist(), limits.tolist(), strict=True):
        if not abs(held) <= limit * (1 + ROUNDING):
            most = _momentum_limit_text(scenario, limit, held)
            yield (
                f"at its rates the wheels hold {held:.6g} N m s about body {axis} at the start, of "
                f"wheel_momentum_limit_nms = {most}"
            )


def _momentum_limit_text(scenario: Scenario, limit: float, held: float) -> str:
    """Return text of a momentum limit that a plan may use, and of the whole limit if a reserve is kept back.

    `limit` is the usable limit and `held` the momentum to compare it with, both in N m s.
    """
    most = f"{limit:.6g} N m s at most"
    if scenario.robust is None or not scenario.robust.momentum_reserve:
        return most
    reserve = scenario.robust.momentum_reserve
    whole = limit / (1 - reserve / 100)
    enough = "; without it that is enough" if abs(held) <= whole * (1 + ROUNDING) else ""
    return (
        f"{most}, which [robust] momentum_reserve_percent = {reserve:g} leaves of {whole:.6g} N m s{enough}"
    )


def hidden_targets(scenario: Scenario, time: float, when: str = "when the motion ends") -> tuple[str, ...]:
    """Return a phrase for each target that is hidden at `time` s, with what hides it and until when.

    `when` are words for what happens at that time.
    """
    known, _ = known_until(scenario)
    when = f"{when}, at {time:.6g} s"
    each = [hidden_words(path.hidden, device, time, known, when) for device, path in target_paths(scenario)]
    return tuple(phrase for phrase in each if phrase is not None)


def contradictions(scenario: Scenario) -> tuple[str, ...]:
    """Tell why no goal can meet a scenario's targets, as far as that is certain without looking for one.

    Returns:
        A phrase for each target that is hidden when the motion ends, or else one on targets that lie in zones
        of their own devices. Empty if there are none, if the goal is a given state, or if something moves and
        the end time is not given.
    """
    given = scenario.trajectory.duration
    if not isinstance(scenario.goal, Targets) or (isinstance(given, str) and moves(scenario)):
        return ()
    time = 0.0 if isinstance(given, str) else float(given)
    own = in_own_zone(scenario.spacecraft, scenario.cones, scenario.goal, time)
    return hidden_targets(scenario, time) or (() if own is None else (own,))


def _braking_breaches(
    scenario: Scenario, joints: np.ndarray, joint_rates: np.ndarray, arriving: bool
) -> Iterator[str]:
    """Yield a phrase for each joint within its range that cannot brake before it leaves the range.

    If `arriving`, for each that must have been beyond its range just before. `joints` in rad, `joint_rates`
    in rad/s, both (2n + d,).
    """
    craft = scenario.usable
    beyond, ends = _range_excess(scenario, joints)
    room, side = -beyond, np.where(joints >= np.mean(craft.joint_ranges, axis=-1), 1, -1)
    outward = np.where(arriving, -1, 1) * side * joint_rates
    braking = joint_rates**2 / (2 * craft.joint_acceleration_limits)
    for j in np.flatnonzero((room >= -ROUNDING) & (outward > 0) & (braking > room + ROUNDING)):
        gap, rate, limit = np.rad2deg([max(room[j], 0), abs(joint_rates[j]), ends[j]])
        where = f"{craft.joint_names[j]}, {gap:.4g} deg from its limit of {limit:.4g} deg,"
        if arriving:
            yield f"{where} moves away from it at {rate:.4g} deg/s, so it must have been beyond it"
        else:
            yield f"{where} moves toward it at {rate:.4g} deg/s and cannot stop before it"
