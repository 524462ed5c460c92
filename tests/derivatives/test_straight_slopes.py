"""Slopes of straight plans beside differences of plans that are searched for anew."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import make_scenario

import jaxplan as jp

STEP = 1e-4  # rad
TURN, MOVE = np.array([0.6, 0.0, -0.8]), np.array([0.3, -0.5])


def with_goal_moved(scenario, by):
    goal = replace(
        scenario.goal,
        rotation_vector=scenario.goal.rotation_vector + by * TURN,
        joints=scenario.goal.joints + by * MOVE,
    )
    return replace(scenario, goal=goal)


@pytest.mark.parametrize("duration", ["stretched", 60.0])
def test_slopes_by_the_goal_are_those_of_plans_made_anew(duration):
    scenario = make_scenario(1)
    settings = replace(scenario.trajectory, duration=duration, optimal=True)
    plan = jp.plan(replace(scenario, trajectory=settings), progress=False)
    measure = jp.measures.effort if plan.scenario.trajectory.timed else jp.measures.duration
    told = jp.differentiable(plan)
    with jax.enable_x64(True):
        slopes = jax.grad(lambda own: measure(told(own)), allow_int=True)(plan.scenario).goal
        slope = float(slopes.rotation_vector @ TURN + slopes.joints @ MOVE)
    ends = [
        float(measure(jp.plan(with_goal_moved(plan.scenario, by), progress=False).trajectory))
        for by in (STEP, -STEP)
    ]
    assert slope == pytest.approx((ends[0] - ends[1]) / (2 * STEP), rel=1e-6)
