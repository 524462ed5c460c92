"""The certificate of a scenario's trajectory, made when it is planned and made anew from a file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxplan import so3
from jaxplan.certificate import Claim, EndState, ProvedMargin, Report, certify_batch, prove_margins
from jaxplan.given import expect
from jaxplan.model.path import Goal
from jaxplan.model.scenario import GivenState, Scenario
from jaxplan.model.zones import sight_names
from jaxplan.planner.arrival import arrival_faults
from jaxplan.planner.record import Plan, end_rates
from jaxplan.planner.validity import breaches
from jaxplan.scenario import ScenarioError
from jaxplan.scenario.taking import refuse_types, take_in
from jaxplan.trajectory import Trajectory

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


def prove(scenario: Scenario, goal: Goal, trajectory: Trajectory) -> Report:
    """Certify a trajectory by itself, see `ProofQuery`."""
    return prove_batch([ProofQuery(scenario=scenario, goal=goal, trajectory=trajectory)])[0]


def prove_batch(queries: Sequence[ProofQuery]) -> list[Report]:
    """Certify many trajectories, alike ones together."""
    reports = []
    for query, report in zip(queries, certify_batch([_claim(query) for query in queries]), strict=True):
        off = (
            *_goal_faults(query.scenario, query.goal),
            *arrival_faults(query.scenario, query.goal, query.trajectory),
        )
        certified, faults = report.certified and not off, (*report.faults, *off)
        reports.append(replace(report, certified=certified, faults=faults))
    return reports


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


def certify(plan: Plan) -> Report:
    """Certify a plan anew, trusting nothing it says, its goal included.

    Args:
        plan: with a trajectory.

    Returns:
        The certificate, or a report of what could not be proved.

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
    report = prove(plan.scenario, plan.goal, plan.trajectory)
    return replace(report, faults=_of_zones(plan.scenario, report.faults))


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
