"""Slopes of plans whose goal leaves a device out of the way or near its wish, beside plans made anew."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import at_rest, make_spacecraft
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.scenario import Scenario, TrajectorySettings

STEP = 1e-4
START, TURN = Rotation.from_rotvec([0.4, -0.7, 0.3]), 0.63
GOAL = START * Rotation.from_rotvec([0.0, 0.0, TURN])
AXIS, AHEAD = np.array([0.0, 0.6, 0.8]), np.array([1.0, 0.0, 0.0])


def craft():
    drive = jp.Drive(
        name="array",
        axis=AXIS,
        boresight=AHEAD,
        range=np.array([-2.0, 2.5]),
        rate_limit=0.03,
        acceleration_limit=0.01,
    )
    return replace(make_spacecraft(1), drives=(drive,))


def scenario_of(keep_out=(), prefer=()):
    """The terminal's target is out of its range, so that the platform turns, and with it the array."""
    azimuth = np.pi / 2 + TURN
    target = START.apply([np.cos(azimuth), np.sin(azimuth), 0.0])
    return Scenario(
        name="free",
        spacecraft=craft(),
        start=at_rest(START.as_rotvec(), np.array([0.3, 0.05, 0.2])),
        goal=jp.Targets(directions=target[None], devices=("terminal-1",), prefer=prefer),
        keep_out=keep_out,
        trajectory=TrajectorySettings(duration=60.0, optimal=True),
    )


def array_toward(angle):
    """Where the array points at the goal, inertial."""
    return GOAL.apply(np.cos(angle) * AHEAD + np.sin(angle) * np.cross(AXIS, AHEAD))


def effort_of(plan, scenario):
    return float(jp.measures.effort(jp.follow(plan, scenario).trajectory))


def slopes_of(plan):
    told = jp.differentiable(plan)
    with jax.enable_x64(True):
        return jax.grad(lambda own: jp.measures.effort(told(own)), allow_int=True)(plan.scenario)


def difference(at):
    return (8 * (at(STEP) - at(-STEP)) - (at(2 * STEP) - at(-2 * STEP))) / (12 * STEP)


@pytest.mark.slow
def test_slopes_by_what_a_device_makes_way_for_are_those_of_plans_made_anew():
    zone = jp.KeepOut(name="sky", direction=array_toward(0.3), half_angle=0.25, devices=("array",))
    plan = jp.plan(scenario_of(keep_out=(zone,)), progress=False)
    assert plan.goal.joints[2] < 0.1  # it stood at 0.2, and is kept at 0.05 and a hair
    slopes = slopes_of(plan)

    def at(by):
        wider = replace(zone, half_angle=zone.half_angle + by)
        return effort_of(plan, replace(plan.scenario, keep_out=(wider,)))

    assert float(slopes.keep_out[0].half_angle) == pytest.approx(difference(at), rel=1e-6)


@pytest.mark.slow
def test_slopes_by_what_a_device_prefers_are_those_of_plans_made_anew():
    wish = jp.Wish(device="array", direction=array_toward(0.6))
    plan = jp.plan(scenario_of(prefer=(wish,)), progress=False)
    assert plan.goal.joints[2] == pytest.approx(0.6, abs=1e-5)
    slopes = slopes_of(plan)
    way = np.cross(GOAL.apply(AXIS), wish.direction)

    def at(by):
        turned = np.cos(by) * wish.direction + np.sin(by) * way
        asked = replace(plan.scenario.goal, prefer=(replace(wish, direction=turned),))
        return effort_of(plan, replace(plan.scenario, goal=asked))

    assert float(slopes.goal.prefer[0].direction @ way) == pytest.approx(difference(at), rel=1e-6)
