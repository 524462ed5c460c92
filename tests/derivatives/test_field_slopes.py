"""Slopes by fields of view and their up, beside plans made anew, with JAX set as it is by default."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import make_scenario
from reference import unit
from scipy.spatial.transform import Rotation

import jaxplan as jp

STEP = 5e-5  # with larger ones the field binds at other places
BORESIGHT = np.array([0.36, -0.48, 0.8])
UP = unit(np.cross(BORESIGHT, [1.0, 0.0, 0.0]))
LEFT = np.cross(UP, BORESIGHT)


@pytest.fixture(scope="module")
def plan():
    """A camera that passes a direction beside the left edge of its field, so that its corner counts, too."""
    scenario = make_scenario(1, 1, turn=tuple(0.9 * LEFT + 0.15 * UP))
    camera = replace(
        scenario.spacecraft.instruments[0],
        boresight=BORESIGHT,
        field_of_view=np.deg2rad([14.0, 10.0]),
        up=UP,
    )
    scenario = replace(
        scenario,
        spacecraft=replace(scenario.spacecraft, instruments=(camera,)),
        trajectory=replace(scenario.trajectory, duration=60.0, optimal=True, node_tube=np.inf),
    )
    half_way = jp.plan(scenario, progress=False).trajectory.sample(np.array([30.0])).attitude[0]
    axis = half_way @ (np.cos(np.deg2rad(9.5)) * BORESIGHT + np.sin(np.deg2rad(9.5)) * LEFT)
    sun = jp.KeepOut(
        name="sun",
        direction=axis,
        half_angle=np.deg2rad(3.0),
        devices=(camera.name,),
        outside="field_of_view",
    )
    return jp.plan(replace(scenario, keep_out=(sun,)), progress=False)


@pytest.fixture(scope="module")
def slopes(plan):
    trajectory = jp.differentiable(plan)
    with jax.enable_x64(True):
        found = jax.grad(lambda own: jp.measures.effort(trajectory(own)), allow_int=True)(plan.scenario)
    return found.spacecraft.instruments[0]


def effort(plan, **changes):
    craft = plan.scenario.spacecraft
    camera = replace(craft.instruments[0], **changes)
    changed = replace(plan.scenario, spacecraft=replace(craft, instruments=(camera,)))
    with jax.enable_x64(False):
        return float(jp.measures.effort(jp.follow(plan, changed).trajectory))


def assert_slope(slope, at):
    found = (8 * (at(STEP) - at(-STEP)) - (at(2 * STEP) - at(-2 * STEP))) / (12 * STEP)
    assert slope == pytest.approx(found, rel=1e-6)


@pytest.mark.slow
def test_slopes_by_the_angles_of_a_field_are_those_of_plans_made_anew(plan, slopes):
    way = np.array([0.8, -0.6])
    angles = plan.scenario.spacecraft.instruments[0].field_of_view
    assert_slope(float(slopes.field_of_view @ way), lambda by: effort(plan, field_of_view=angles + by * way))


@pytest.mark.slow
def test_slopes_by_the_up_of_a_field_are_those_of_plans_made_anew(plan, slopes):
    about = 5 * BORESIGHT  # it matters little
    assert_slope(
        float(slopes.up @ np.cross(about, UP)),
        lambda by: effort(plan, up=Rotation.from_rotvec(by * about).apply(UP)),
    )
