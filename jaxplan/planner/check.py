"""The certificate of a scenario's trajectory, made when it is planned and made anew from a file."""

from dataclasses import replace

import jax
import numpy as np

from jaxplan import so3
from jaxplan.certificate import EndState, ProvedMargin, Report, certify, prove_margins
from jaxplan.path import Goal
from jaxplan.planner.arrival import arrival_faults
from jaxplan.planner.record import Plan, end_rates
from jaxplan.scenario import GivenState, Scenario, Targets
from jaxplan.spacecraft import joints_toward
from jaxplan.trajectory import Trajectory
from jaxplan.zones import KeepIn, KeepOut, tabulate

# How far a goal may be from what the scenario asks for, rad.
GOAL_TOLERANCE = 1e-8

exp = jax.jit(so3.exp)
_joints_toward = jax.jit(joints_toward)


def start_attitude(scenario: Scenario) -> np.ndarray:
    """(3, 3) of the scenario's start, body to inertial."""
    with jax.enable_x64(True):
        return np.asarray(exp(np.asarray(scenario.start.rotation_vector, float)))


def prove(scenario: Scenario, goal: Goal, trajectory: Trajectory) -> Report:
    """Certify a trajectory against a scenario: zones, limits, start, and the goal that is asked for.

    Args:
        scenario: what must hold.
        goal: where the trajectory must end; it must be what the scenario asks for.
        trajectory: the manoeuvre.
    """
    start, end = scenario.start, end_rates(scenario, goal)
    craft = scenario.spacecraft
    zones: list[KeepOut | KeepIn] = [*scenario.keep_out, *scenario.keep_in]
    report = certify(
        trajectory,
        craft,
        tabulate(scenario.keep_out, scenario.keep_in, craft.device_names),
        zone_names=[zone.name for zone in zones],
        start=EndState(
            attitude=start_attitude(scenario),
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
    off = (*_goal_faults(scenario, goal), *arrival_faults(scenario, goal, trajectory))
    return replace(report, certified=report.certified and not off, faults=(*report.faults, *off))


def check_plan(plan: Plan) -> Report:
    """Certify a plan anew, trusting nothing it says, its goal included.

    Args:
        plan: with a trajectory.

    Raises:
        ValueError: if the plan has no trajectory, or no goal.
    """
    if plan.trajectory is None or plan.goal is None:
        missing = "trajectory" if plan.trajectory is None else "goal"
        raise ValueError(f"the plan of {plan.scenario.name} has no {missing}: it ended as {plan.status.name}")
    return prove(plan.scenario, plan.goal, plan.trajectory)


def check_margins(plan: Plan) -> tuple[ProvedMargin, ...]:
    """Prove anew how far every device stays from every zone, see `jaxplan.certificate.prove_margins`.

    Args:
        plan: with a trajectory; the margins of another are none.
    """
    if plan.trajectory is None:
        return ()
    scenario, names = plan.scenario, plan.scenario.spacecraft.device_names
    zones: list[KeepOut | KeepIn] = [*scenario.keep_out, *scenario.keep_in]
    return prove_margins(
        plan.trajectory,
        scenario.spacecraft,
        tabulate(scenario.keep_out, scenario.keep_in, names),
        zone_names=[zone.name for zone in zones],
    )


def _goal_faults(scenario: Scenario, goal: Goal) -> tuple[str, ...]:
    """Where a goal is not what the scenario asks for; in numpy, so that no NaN passes.

    Of the directions of targets that move `arrival_faults` tells.
    """
    asked, craft = scenario.goal, scenario.spacecraft
    off = []
    turn = start_attitude(scenario).T @ goal.attitude
    sine = np.linalg.norm([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    if not abs(np.arctan2(sine, (np.trace(turn) - 1) / 2) - goal.slew_angle) <= GOAL_TOLERANCE:
        off.append("the goal's slew angle is not that from the start")
    if not isinstance(asked, GivenState):
        limits = zip(
            ("yaw", "pitch"), (asked.yaw_limit, asked.pitch_limit), np.split(goal.joints, 2), strict=True
        )
        for name, limit, angles in limits:
            if limit is not None and not np.all(np.abs(angles) <= limit + GOAL_TOLERANCE):
                off.append(f"a {name} at the goal is beyond goal.{name}_limit_deg = {np.rad2deg(limit):g}")
    if isinstance(asked, GivenState):
        with jax.enable_x64(True):
            attitude = np.asarray(exp(np.asarray(asked.rotation_vector, float)))
        joints = asked.joints
    elif not isinstance(asked, Targets):
        return tuple(off)
    else:
        attitude = goal.attitude
        with jax.enable_x64(True):
            joints = np.asarray(_joints_toward(craft.mounts, goal.attitude, asked.directions))
    if not np.linalg.norm(goal.attitude - attitude) <= GOAL_TOLERANCE:
        off.append("the goal's attitude is not the scenario's")
    if not np.all(np.abs(goal.joints - joints) <= GOAL_TOLERANCE):
        off.append("the goal's joints do not point where the scenario asks")
    return tuple(off)
