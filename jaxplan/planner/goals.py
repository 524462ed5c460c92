"""The goals of a scenario: the one that is given, or those that step 1 finds.

Where something moves, a goal is one at a time: the end of the manoeuvre.
"""

import numpy as np

from jaxplan import so3
from jaxplan.decomposition import decompose
from jaxplan.decomposition.pairs import leaves_open
from jaxplan.decomposition.tracking import tracking_rates
from jaxplan.moving import DirectionPath
from jaxplan.path import Goal, MovingGoal
from jaxplan.planner import messages
from jaxplan.planner.record import Plan, end_rates
from jaxplan.planner.validity import breaches
from jaxplan.scenario import GivenState, MovingTargets, Scenario, Targets
from jaxplan.scenario.moments import at, moves, target_rates
from jaxplan.status import Status
from jaxplan.zones import tabulate

CANDIDATES = 16
"""Goals of step 1 to choose from where their joints decide more; hardly a problem has as many minima."""


def find_goals(
    scenario: Scenario, attitude: np.ndarray, time: float | None = None
) -> tuple[Goal, ...] | Plan:
    """The goals to try, nearest first, or a plan that says why there is none.

    Args:
        scenario: the problem.
        attitude: (3, 3) of the start.
        time: s, when the manoeuvre ends; it matters only where something moves, and must be given there.
    """
    end, wanted = 0.0 if time is None else time, scenario.search.max_goals
    then = at(scenario, end)
    if isinstance(then.goal, GivenState):
        candidates: tuple[Goal, ...] = (_given(then.goal, attitude),)
    else:
        assert isinstance(then.goal, Targets)  # none moves at an instant
        craft = scenario.spacecraft
        cones = tabulate(then.keep_out, then.keep_in, craft.device_names)
        sights = cones.sights(craft.mounts, craft.fixed_boresights)
        unsure = leaves_open(cones, sights, then.goal.directions)
        found = decompose(
            craft,
            attitude,
            then.goal,
            cones,
            max_slew=largest_slew(scenario),
            max_goals=max(wanted, CANDIDATES) if unsure else wanted,
            seed=scenario.search.seed,
        )
        if not found.goals:
            message = messages.unreachable(then, cones, found) + messages.when(scenario, end)
            return Plan(scenario=scenario, status=Status.GOAL_UNREACHABLE, message=message)
        candidates = found.goals
    if moves(scenario):
        candidates = tuple(_arriving(scenario, then, goal, attitude, end) for goal in candidates)
    broken = [
        breaches(then, goal.attitude, goal.joints, *end_rates(scenario, goal), arriving=True)
        for goal in candidates
    ]
    valid = tuple(goal for goal, faults in zip(candidates, broken, strict=True) if not faults)
    if not valid:
        message = messages.invalid(broken[0]) + messages.when(scenario, end)
        return Plan(scenario=scenario, status=Status.INVALID_GOAL, message=message, goal=candidates[0])
    return valid[:wanted]


def _arriving(
    scenario: Scenario, then: Scenario, goal: Goal, attitude: np.ndarray, time: float
) -> MovingGoal:
    """A goal with the rates at which the manoeuvre ends there.

    Args:
        scenario: in which something moves.
        then: the same at that time.
        goal: of it.
        attitude: (3, 3) of the start.
        time: s.
    """
    asked, craft = scenario.goal, scenario.spacecraft
    if isinstance(asked, MovingTargets):
        assert isinstance(then.goal, Targets)
        cones = tabulate(scenario.keep_out, scenario.keep_in, craft.device_names)
        axis_rates = np.zeros(cones.axis.shape)
        for row, path in enumerate(cones.paths):
            if isinstance(path, DirectionPath):
                axis_rates[row] = path.rate(time)
        rates = tracking_rates(
            goal,
            craft,
            attitude,
            then.goal,
            cones.at(time),
            target_rates=target_rates(asked, time),
            axis_rates=axis_rates,
        )
    else:
        rates = asked.angular_velocity, asked.joint_rates
    return MovingGoal(**vars(goal), time=time, angular_velocity=rates[0], joint_rates=rates[1])


def _given(state: GivenState, attitude: np.ndarray) -> Goal:
    goal = so3.exp(np.asarray(state.rotation_vector, float))
    slew = float(so3.distance(attitude, goal))
    return Goal(attitude=goal, joints=np.asarray(state.joints, float), slew_angle=slew)


def largest_slew(scenario: Scenario) -> float:
    """Bound of the platform's rotation, equations (5) and (6), rad.

    Within limits of each body axis the rate's length is at most sqrt(3) times the limit. A duration that
    is not a number bounds nothing but half a turn.
    """
    duration = scenario.trajectory.duration
    if isinstance(duration, str):
        return float(np.pi)
    return float(min(np.pi, np.sqrt(3) * scenario.spacecraft.rate_limit * duration))
