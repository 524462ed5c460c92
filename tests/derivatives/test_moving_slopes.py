"""Slopes by samples and times of what moves, beside plans made anew, whose splines follow from both."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import great_circle, make_scenario
from reference import boresights_of, unit

import jaxplan as jp

DURATION = 60.0
TIMES = np.array([-7.0, 12.0, 27.0, 45.0, 58.0, 80.0])
STEPS = {"samples": 1e-5, "times": 1e-2}


def passing(at, toward, when):
    """A path that is at a direction at a time, s, and turns toward another."""
    return jp.DirectionPath.through(TIMES, great_circle(unit(at), toward, 2e-3, TIMES - when))


@pytest.fixture(scope="module")
def plan():
    """A camera and a terminal go to targets that move, and a zone that moves is in the camera's way."""
    scenario = make_scenario(1, 1)
    craft, last = scenario.spacecraft, scenario.goal
    beams = dict(zip(craft.device_names, craft.boresights(last.attitude, last.joints), strict=True))
    goal = jp.Targets.of({name: passing(at, [0.3, 0.5, -0.8], DURATION) for name, at in beams.items()})
    settings = replace(scenario.trajectory, duration=DURATION, optimal=True, node_tube=np.inf)
    scenario = replace(scenario, goal=goal, trajectory=settings)
    free = jp.plan(scenario, progress=False).trajectory
    (seen,) = boresights_of(free, craft, np.array([30.0]))[:, 1]
    axis = passing(np.cos(0.1) * seen + np.sin(0.1) * unit(np.cross(seen, [0.2, 0.1, 1.0])), seen, 30.0)
    zone = jp.KeepOut(name="ship", direction=axis, half_angle=0.105, devices=["camera-1"])
    return jp.plan(replace(scenario, keep_out=[zone]), progress=False)


def path_of(scenario, what):
    return scenario.keep_out[0].direction if what == "zone" else scenario.goal.directions[1]


def with_path(scenario, what, path):
    if what == "zone":
        return replace(scenario, keep_out=(replace(scenario.keep_out[0], direction=path),))
    return replace(scenario, goal=replace(scenario.goal, directions=(scenario.goal.directions[0], path)))


@pytest.fixture(scope="module")
def slopes(plan):
    trajectory = jp.differentiable(plan)
    with jax.enable_x64(True):
        return jax.grad(lambda own: jp.measures.effort(trajectory(own)), allow_int=True)(plan.scenario)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["target", "zone"])
@pytest.mark.parametrize("numbers", STEPS)
def test_slopes_by_the_numbers_of_a_path_are_those_of_plans_made_anew(plan, slopes, what, numbers):
    path = path_of(plan.scenario, what)
    own = jax.tree.map(np.asarray, path_of(slopes, what))
    rng, step = np.random.default_rng(1), STEPS[numbers]
    ways = {name: 0 * getattr(path, name) for name in STEPS}
    ways[numbers] = rng.normal(size=ways[numbers].shape)

    def at(by):
        samples = unit(path.samples + by * ways["samples"])
        changed = jp.DirectionPath.through(path.times + by * ways["times"], samples)
        return float(jp.measures.effort(jp.follow(plan, with_path(plan.scenario, what, changed)).trajectory))

    found = (8 * (at(step) - at(-step)) - (at(2 * step) - at(-2 * step))) / (12 * step)
    assert abs(found) > 1e-3 * float(np.linalg.norm(getattr(own, numbers)))
    assert float(np.sum(getattr(own, numbers) * ways[numbers])) == pytest.approx(found, rel=1e-6)
    assert not np.any(own.slopes)
