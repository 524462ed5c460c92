"""Slopes of a plan that leans on a mask, by the mask's corners, beside plans made anew along its path."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import make_scenario

import jaxplan as jp

STEP = 2e-5  # rad, to either side; with larger ones other rows bind


def masked(scene, corners):
    terminal = replace(scene.spacecraft.terminals[0], mask=(corners,))
    return replace(scene, spacecraft=replace(scene.spacecraft, terminals=(terminal,)))


@pytest.mark.slow
def test_slopes_by_the_corners_of_a_mask_are_those_of_plans_made_anew():
    """The terminal has to go over a mask between start and goal while the platform rests."""
    corners = np.deg2rad([[-20.0, -20.0], [20.0, -20.0], [6.0, 4.0], [-2.0, 3.0]])
    scene = make_scenario(1, turn=(0.0, 0.0, 0.0))
    ends = [
        replace(end, joints=np.deg2rad([yaw, 0.0])) for end, yaw in ((scene.start, -50), (scene.goal, 50))
    ]
    settings = replace(scene.trajectory, duration=60.0, optimal=True, node_tube=np.inf)
    plan = jp.plan(
        masked(replace(scene, start=ends[0], goal=ends[1], trajectory=settings), corners), progress=False
    )
    assert plan.ok
    trajectory = jp.differentiable(plan)
    with jax.enable_x64(True):
        slopes = jax.grad(lambda own: jp.measures.effort(trajectory(own)), allow_int=True)(plan.scenario)
    (found,) = slopes.spacecraft.terminals[0].mask
    assert np.abs(found).max() > 1e-5
    rng = np.random.default_rng(0)
    for _ in range(2):
        way = rng.normal(size=corners.shape)
        ends = [
            float(jp.measures.effort(jp.follow(plan, masked(plan.scenario, corners + step * way)).trajectory))
            for step in (STEP, -STEP)
        ]
        expected = (ends[0] - ends[1]) / (2 * STEP)
        assert float(np.sum(found * way)) == pytest.approx(expected, rel=1e-6)
