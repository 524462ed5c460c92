"""Plans of scenarios near that of another plan: without a search, along a path with the same corners."""

from dataclasses import replace

import numpy as np

from jaxplan.derivatives.held import (
    A_PLAN,
    Held,
    expect_known_time,
    expect_same_devices,
    follow_goal,
    held_of,
)
from jaxplan.model.path import leads_of
from jaxplan.model.scenario import Scenario
from jaxplan.planner import Plan
from jaxplan.planner.clock import Clock
from jaxplan.planner.entry_points import as_filed
from jaxplan.planner.proving import prove
from jaxplan.planner.steps import find_goals, fit, fitted_plan, judged
from jaxplan.runtime.arguments import expect
from jaxplan.runtime.jit import clear_if_full
from jaxplan.runtime.workers import one_thread
from jaxplan.trajectory import Fit, Trajectory
from jaxplan.trajectory.node_times import FEWEST_NODES


@one_thread()
def follow(plan: Plan, scenario: Scenario) -> Plan:
    """Plan a scenario near another plan, without a search, along a path with the same corners.

    Args:
        plan: a plan with a path.
        scenario: a scenario with the same devices.

    Returns:
        A plan with a certificate of its own, or with a status that says why there is none. If the scenario
        has several goals, the one nearest to that of the other plan is taken. A shortest motion is looked for
        near that of the other plan, with breaks at the same places where these are at switches.

    Raises:
        TypeError: if the arguments are no plan and no scenario.
        ValueError: for a scenario that `plan` refuses, for one with other devices, or if the plan has no path
            or does not move.
    """
    expect("plan", plan, Plan, A_PLAN)
    filed = as_filed("scenario", scenario)
    expect_same_devices(plan.scenario, filed)
    return plan_near(plan, filed, plan.trajectory)[0]


@one_thread()
def follow_and_hold(plan: Plan, scenario: Scenario, *, nodes: int = FEWEST_NODES) -> tuple[Plan, Held | None]:
    """`follow` a plan to a scenario and `hold` the result, with a single fit for both.

    Returns:
        The new plan, and what is held of it; None for the latter where the plan failed or cannot be held.
    """
    followed, fitted = plan_near(plan, scenario)
    path, goal = followed.path, followed.goal
    if not followed.ok or fitted is None or path is None or goal is None:
        return followed, None
    try:
        return followed, held_of(followed, path, goal, follow_goal(scenario, goal), fitted, nodes)
    except ValueError:  # nothing moves, or a row is about to bind
        return followed, None


def plan_near(plan: Plan, scenario: Scenario, near: Trajectory | None = None) -> tuple[Plan, Fit | None]:
    """Plan a scenario near another plan, see `follow`, and return the plan with its fit, None without one.

    Args:
        plan: a plan with a path.
        scenario: the scenario to be planned.
        near: a trajectory near which a shortest motion is looked for, on its breaks; None for anywhere.

    Raises:
        ValueError: if the plan has no path or does not move, or something moves and no duration is given.
    """
    if plan.path is None or plan.goal is None:
        raise ValueError(f"the plan of {plan.scenario.name} has no path, it ended as {plan.status.name}")
    if not plan.path.edges:
        raise ValueError(
            f"the plan of {plan.scenario.name} does not move, so nothing of it can be followed: "
            f"plan {scenario.name} by jp.plan"
        )
    expect_known_time(scenario)
    clear_if_full()
    clock = Clock(np.inf)
    duration = scenario.trajectory.duration
    goals = find_goals(scenario, None if isinstance(duration, str) else float(duration))
    if isinstance(goals, Plan):
        return goals, None
    earlier = plan.goal.attitude
    goal = min(goals, key=lambda one: float(np.linalg.norm(one.attitude - earlier)))
    attitudes, joints = plan.path.attitudes.copy(), plan.path.joints.copy()
    attitudes[0], attitudes[-1] = scenario.start.attitude, goal.attitude
    joints[0], joints[-1] = scenario.start.joints, goal.joints
    attitudes, joints = leads_of(plan.path.attitudes, plan.path.joints).nodes(attitudes, joints)
    path = replace(plan.path, attitudes=attitudes, joints=joints)
    with clock.step("trajectory"):
        fitted = fit(scenario, path, goal, near)
    while True:
        followed = fitted_plan(replace(plan, scenario=scenario, goal=goal, path=path), fitted)
        if followed.trajectory is None:
            return followed, fitted
        with clock.step("certificate"):
            certificate = prove(scenario, goal, followed.trajectory)
        if certificate.certified or fitted.spare is None:
            return judged(followed, certificate), fitted
        fitted = fitted.spare
