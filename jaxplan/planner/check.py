"""Whether a start or goal is valid, and the certificate of a plan.

Whether a state is within the limits and meets every constraint, said in words when it is not.

The certificate of a scenario's trajectory, made when it is planned and made anew from a file.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxplan import so3
from jaxplan.certificate import Certificate, Claim, EndState, ProvedMargin, certify_batch, prove_margins
from jaxplan.model.constraints import (
    INERTIAL,
    JOINTS,
    SIGHT,
    Constraints,
    best_entries,
    chosen_entries,
    state_margins,
)
from jaxplan.model.path import Goal
from jaxplan.model.scenario import GivenState, Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import body_axis_name, sight_names
from jaxplan.planner.moving import arrival_faults
from jaxplan.planner.record import Plan, end_rates
from jaxplan.runtime.arguments import expect
from jaxplan.schema import ScenarioError
from jaxplan.schema.reading import refuse_types, take_in
from jaxplan.trajectory import Trajectory

# What rounding may cost at the very limit, rad; the certificate allows the same.
ROUNDING = 1e-9


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
    """Everything a state breaks: joint limits, also those that it cannot but break next, rates and zones.

    Args:
        scenario: limits and zones.
        attitude: (3, 3) body to inertial.
        joints: (2n,) rad.
        angular_velocity: (3,) rad/s, body axes.
        joint_rates: (2n,) rad/s.
        arriving: whether the state ends a motion instead of starting one: what was just before counts.
        time: s, when it is; zones that move are where they are then.

    Returns:
        A phrase a breach, naming device, zone or limit and the overlap in degrees; empty when there is none.
    """
    craft = scenario.spacecraft
    found = [] if np.all(np.isfinite(attitude)) else ["the attitude is not made of finite numbers"]
    found += [
        f"{name} is {np.rad2deg(excess):.4g} deg beyond its limit of {np.rad2deg(limit):.4g} deg"
        for name, excess, limit in zip(
            craft.joint_names, np.abs(joints) - craft.joint_limits, craft.joint_limits, strict=True
        )
        if not excess <= ROUNDING
    ]
    rates = [
        ("the platform's rate", np.max(np.abs(angular_velocity)), craft.rate_limit),
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
    found += _overruns(scenario, joints, joint_rates, arriving)
    return (*found, *_zone_breaches(scenario, attitude, joints, time))


def _overruns(
    scenario: Scenario, joints: np.ndarray, joint_rates: np.ndarray, arriving: bool
) -> Iterator[str]:
    """Joints within their limits that even full braking takes beyond, or that come from there."""
    craft = scenario.spacecraft
    room = craft.joint_limits - np.abs(joints)
    outward = np.where(arriving, -1, 1) * np.sign(joints) * joint_rates
    braking = joint_rates**2 / (2 * craft.joint_acceleration_limits)
    for j in np.flatnonzero((room >= -ROUNDING) & (outward > 0) & (braking > room + ROUNDING)):
        gap, rate, limit = np.rad2deg([max(room[j], 0), abs(joint_rates[j]), craft.joint_limits[j]])
        where = f"{craft.joint_names[j]}, {gap:.4g} deg from its limit of {limit:.4g} deg,"
        if arriving:
            yield f"{where} moves away from it at {rate:.4g} deg/s, so it must have been beyond it"
        else:
            yield f"{where} moves toward it at {rate:.4g} deg/s and cannot stop before it"


def _zone_breaches(
    scenario: Scenario, attitude: np.ndarray, joints: np.ndarray, time: float
) -> Iterator[str]:
    rows = scenario.constraints.at(time)
    zones = [scenario.zones[zone] for zone in rows.zone if zone >= 0]
    names, groups = [zone.name for zone in zones], [zone.any_of for zone in zones]
    yield from constraint_breaches(rows, scenario.spacecraft, attitude, joints, names, groups)


def constraint_breaches(
    rows: Constraints,
    spacecraft: Spacecraft,
    attitude: np.ndarray,
    joints: np.ndarray,
    names: Sequence[str],
    groups: Sequence[str | None],
) -> Iterator[str]:
    """Every pointing constraint that a state breaks, a phrase each.

    Args:
        rows: the constraints, at an instant.
        spacecraft: whose devices they bind.
        attitude: (3, 3) body to inertial.
        joints: (2n,) rad.
        names: of the rows, without padding.
        groups: likewise the name of the group that a row's constraint is, None where it has none.

    Yields:
        The worst row of the constraint's best entry, the worst sight of that row, and the overlap in degrees.
    """
    sights = rows.sights(spacecraft.mounts, spacecraft.fixed_boresights)
    table = state_margins(rows, sights, np.asarray(attitude), np.asarray(joints))
    worst = np.min(table, axis=-1, initial=np.inf)
    leaders = np.flatnonzero(~(best_entries(rows, worst) >= -ROUNDING))
    if not len(leaders):
        return
    called = sight_names(spacecraft.device_names, rows)
    beams = [f"the beam of {name}" for name in spacecraft.device_names]
    axes = beams + called[len(beams) :]
    chosen = chosen_entries(rows, worst)
    for leader in leaders:
        row = int(np.argmin(np.where(rows.entry == chosen[leader], worst, np.inf)))
        sight = int(np.argmin(table[row]))
        name = names[row] if groups[row] is None else f"{names[row]}, the nearest of group {groups[row]}"
        overlap = f"{np.rad2deg(-worst[row]):.4g} deg"
        yield f"{called[sight]} is {overlap} {_where(rows, row, name, axes)}"


def _where(rows: Constraints, row: int, name: str, axes: Sequence[str]) -> str:
    """Where a sight is that breaks a row; `axes` are the names of all sights as axes of others."""
    if rows.frame[row] == JOINTS:
        return f"beyond joint bound {name}"
    side = "outside keep-in" if rows.side[row] < 0 else "inside keep-out"
    if rows.frame[row] == INERTIAL:
        return f"{side} zone {name}"
    if rows.frame[row] == SIGHT:
        return f"{side} cone {name}, about {axes[rows.partner[row]]}"
    return f"{side} cone {name}, about {body_axis_name(rows.axis[row])}"


# How far a goal may be from what the scenario asks for, rad.
GOAL_TOLERANCE = 1e-8


def start_breaches(scenario: Scenario) -> tuple[str, ...]:
    """Everything that the scenario's start breaks, a phrase each."""
    start = scenario.start
    return breaches(scenario, start.attitude, start.joints, start.angular_velocity, start.joint_rates)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProofQuery:
    """What is to be certified against a scenario: zones, limits, start, and the goal that is asked for.

    Attributes:
        scenario: what must hold.
        goal: where the trajectory must end; it must be what the scenario asks for.
        trajectory: the manoeuvre.
    """

    scenario: Scenario
    goal: Goal
    trajectory: Trajectory


def prove(scenario: Scenario, goal: Goal, trajectory: Trajectory) -> Certificate:
    """Certify a trajectory by itself, see `ProofQuery`."""
    return prove_batch([ProofQuery(scenario=scenario, goal=goal, trajectory=trajectory)])[0]


def prove_batch(queries: Sequence[ProofQuery]) -> list[Certificate]:
    """Certify many trajectories, alike ones together."""
    certificates = []
    for query, certificate in zip(queries, certify_batch([_claim(query) for query in queries]), strict=True):
        off = (
            *_goal_faults(query.scenario, query.goal),
            *arrival_faults(query.scenario, query.goal, query.trajectory),
        )
        certified, faults = certificate.certified and not off, (*certificate.faults, *off)
        certificates.append(replace(certificate, certified=certified, faults=faults))
    return certificates


def _claim(query: ProofQuery) -> Claim:
    """What the scenario asks of the trajectory, its goal being where it should end."""
    scenario, goal, start = query.scenario, query.goal, query.scenario.start
    end, craft = end_rates(scenario, goal), scenario.spacecraft
    return Claim(
        trajectory=query.trajectory,
        spacecraft=craft,
        cones=scenario.constraints,
        zone_names=_zone_names(scenario),
        sight_names=sight_names(craft.device_names, scenario.constraints),
        start=EndState(
            attitude=start.attitude,
            joints=start.joints,
            angular_velocity=start.angular_velocity,
            joint_rates=start.joint_rates,
        ),
        goal=EndState(
            attitude=goal.attitude,
            joints=goal.joints,
            angular_velocity=end[0],
            joint_rates=end[1],
        ),
    )


def certify(plan: Plan) -> Certificate:
    """Certify a plan anew, trusting nothing it says, its goal included.

    Args:
        plan: with a trajectory.

    Returns:
        The certificate, which lists what could not be proved.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, or no goal.
        ScenarioError: if an attribute of its scenario has the wrong type or shape.

    Example:
        >>> jp.certify(jp.load_plan("plan.json")).certified
        True
    """
    expect("plan", plan, Plan, "jp.plan makes one, jp.load_plan reads one")
    if plan.trajectory is None or plan.goal is None:
        missing = "trajectory" if plan.trajectory is None else "goal"
        raise ValueError(f"the plan of {plan.scenario.name} has no {missing}: it ended as {plan.status.name}")
    refuse_types(plan.scenario)
    certificate = prove(plan.scenario, plan.goal, plan.trajectory)
    return replace(certificate, faults=_of_zones(plan.scenario, certificate.faults))


def _of_zones(scenario: Scenario, faults: tuple[str, ...]) -> tuple[str, ...]:
    """Faults, with those of rows of cones told as those of the zones that they are made of."""
    others = tuple(fault for fault in faults if not fault.startswith("cones."))
    if len(others) == len(faults):
        return faults
    try:
        take_in(scenario)
    except ScenarioError as error:
        own = tuple(
            fault for fault in error.faults if fault.startswith(("keep_out", "keep_in", "joint_bounds"))
        )
        return (*own, *others) if own else faults
    return faults


def check_margins(plan: Plan) -> tuple[ProvedMargin, ...]:
    """Prove anew how far every device stays from every zone, see `jaxplan.certificate.prove_margins`.

    Args:
        plan: with a trajectory; the margins of another are none.
    """
    if plan.trajectory is None:
        return ()
    scenario = plan.scenario
    return prove_margins(
        plan.trajectory,
        scenario.spacecraft,
        scenario.constraints,
        zone_names=_zone_names(scenario),
        sight_names=sight_names(scenario.spacecraft.device_names, scenario.constraints),
    )


def _zone_names(scenario: Scenario) -> list[str]:
    """Of each row of the scenario's constraints."""
    return [scenario.zones[zone].name for zone in scenario.constraints.zone if zone >= 0]


def _goal_faults(scenario: Scenario, goal: Goal) -> tuple[str, ...]:
    """Where a goal is not what the scenario asks for; in numpy, so that no NaN passes.

    Of the directions of targets that move `arrival_faults` tells.
    """
    asked, craft = scenario.goal, scenario.spacecraft
    off = []
    slew = so3.distance(scenario.start.attitude, goal.attitude)
    if not abs(slew - goal.slew_angle) <= GOAL_TOLERANCE:
        off.append("the goal's slew angle is not that from the start")
    if not isinstance(asked, GivenState):
        limits = zip(
            ("yaw", "pitch"), (asked.yaw_limit, asked.pitch_limit), np.split(goal.joints, 2), strict=True
        )
        for name, limit, angles in limits:
            if limit is not None and not np.all(np.abs(angles) <= limit + GOAL_TOLERANCE):
                off.append(f"a {name} at the goal is beyond goal.{name}_limit_deg = {np.rad2deg(limit):g}")
    if isinstance(asked, GivenState):
        attitude, joints = asked.attitude, asked.joints
    elif asked.moves:
        return tuple(off)
    else:
        attitude = goal.attitude
        joints = craft.joints_toward(goal.attitude, asked.directions)
    if not np.linalg.norm(goal.attitude - attitude) <= GOAL_TOLERANCE:
        off.append("the goal's attitude is not the scenario's")
    if not np.all(np.abs(goal.joints - joints) <= GOAL_TOLERANCE):
        off.append("the goal's joints do not point where the scenario asks")
    return tuple(off)
