"""The goals of a scenario: the one that is given, or those that step 1 finds."""

import jax
import numpy as np

from jaxplan import so3
from jaxplan.decomposition import decompose
from jaxplan.path import Goal
from jaxplan.planner import messages
from jaxplan.planner.record import Plan
from jaxplan.planner.validity import breaches
from jaxplan.scenario import GivenState, Scenario
from jaxplan.status import Status
from jaxplan.zones import tabulate


def find_goals(scenario: Scenario, attitude: np.ndarray) -> tuple[Goal, ...] | Plan:
    """The goals to try, nearest first, or a plan that says why there is none.

    Args:
        scenario: the problem.
        attitude: (3, 3) of the start.
    """
    if isinstance(scenario.goal, GivenState):
        candidates: tuple[Goal, ...] = (_given(scenario.goal, attitude),)
    else:
        cones = tabulate(scenario.keep_out, scenario.keep_in, scenario.spacecraft.device_names)
        found = decompose(
            scenario.spacecraft,
            attitude,
            scenario.goal,
            cones,
            max_slew=largest_slew(scenario),
            max_goals=scenario.search.max_goals,
            seed=scenario.search.seed,
        )
        if not found.goals:
            message = messages.unreachable(scenario, found)
            return Plan(scenario=scenario, status=Status.GOAL_UNREACHABLE, message=message)
        candidates = found.goals
    end = scenario.goal
    broken = [
        breaches(scenario, goal.attitude, goal.joints, end.angular_velocity, end.joint_rates, arriving=True)
        for goal in candidates
    ]
    valid = tuple(goal for goal, faults in zip(candidates, broken, strict=True) if not faults)
    if not valid:
        message = messages.invalid(broken[0])
        return Plan(scenario=scenario, status=Status.INVALID_GOAL, message=message, goal=candidates[0])
    return valid


def _given(state: GivenState, attitude: np.ndarray) -> Goal:
    with jax.enable_x64(True):
        goal, slew = (np.asarray(part) for part in _attitude_and_slew(state.rotation_vector, attitude))
    return Goal(attitude=goal, joints=np.asarray(state.joints, float), slew_angle=float(slew))


@jax.jit
def _attitude_and_slew(rotation_vector: jax.Array, start: jax.Array) -> tuple[jax.Array, jax.Array]:
    goal = so3.exp(rotation_vector)
    return goal, so3.distance(start, goal)


def largest_slew(scenario: Scenario) -> float:
    """Bound of the platform's rotation, equations (5) and (6), rad.

    Within limits of each body axis the rate's length is at most sqrt(3) times the limit. A duration that
    is not a number bounds nothing but half a turn.
    """
    duration = scenario.trajectory.duration
    if isinstance(duration, str):
        return float(np.pi)
    return float(min(np.pi, np.sqrt(3) * scenario.spacecraft.rate_limit * duration))
