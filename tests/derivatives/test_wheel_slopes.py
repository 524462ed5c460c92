"""Slopes of plans by the numbers of their wheels beside differences, and of plans that are made anew."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from wheels import scarce, with_wheels

import jaxplan as jp

STEP = 1e-4  # to either side, relative; of what is stored, of what the wheel can hold

SCENES = {
    "shortest, pseudo-inverse": ("minimum", "pseudo_inverse", jp.measures.duration),
    "shortest, envelope": ("minimum", "minimax", jp.measures.duration),
    "stretched": ("stretched", "pseudo_inverse", jp.measures.duration),
    "in a given time": (None, "pseudo_inverse", jp.measures.effort),
}


def moved(scenario, number, name, way, step):
    """The scenario with a number of a wheel changed: along a way, for an axis."""
    wheels = list(scenario.spacecraft.wheels)
    wheels[number] = replace(wheels[number], **{name: getattr(wheels[number], name) + step * way})
    return replace(scenario, spacecraft=replace(scenario.spacecraft, wheels=tuple(wheels)))


def ways_of(wheel):
    """Names of a wheel's numbers with ways to change them: of the axis two at right angles to it."""
    yield from (("axis", way) for way in np.linalg.svd(np.asarray(wheel.axis)[None])[2][1:])
    yield from (("torque", wheel.torque), ("momentum", wheel.momentum), ("stored", wheel.momentum))


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_slopes_by_wheels_are_differences(name):
    duration, allocation, measure = SCENES[name]
    scenario = with_wheels(scarce(4, seed=5), allocation, duration=duration or "minimum")
    plan = jp.plan(scenario, progress=False)
    if duration is None:  # not much longer than the shortest, so that limits bind
        longer = replace(scenario.trajectory, duration=1.25 * plan.trajectory.duration)
        plan = jp.plan(replace(scenario, trajectory=longer), progress=False)
    trajectory, own, binding = jp.differentiable(plan), plan.scenario, 0
    here, slopes = jax.value_and_grad(lambda own: measure(trajectory(own)), allow_int=True)(own)
    for number in (0, 2):
        for key, way in ways_of(own.spacecraft.wheels[number]):
            ends = [float(measure(trajectory(moved(own, number, key, way, side * STEP)))) for side in (1, -1)]
            told = float(np.sum(getattr(slopes.spacecraft.wheels[number], key) * way))
            expected = (ends[0] - ends[1]) / (2 * STEP)
            assert told == pytest.approx(expected, rel=1e-6, abs=1e-6 * abs(float(here))), (number, key)
            binding += abs(expected) > 1e-3 * abs(here)
    assert binding >= 2  # what is asked about matters


@pytest.mark.slow
def test_the_shortest_duration_follows_a_wheel_as_plans_made_anew():
    plan = jp.plan(with_wheels(scarce(4, seed=5), duration="minimum"), progress=False)
    trajectory = jp.differentiable(plan)
    slopes = jax.grad(lambda own: jp.measures.duration(trajectory(own)), allow_int=True)(plan.scenario)
    number = int(np.argmax([abs(float(one.torque)) for one in slopes.spacecraft.wheels]))
    step = 1e-4 * plan.scenario.spacecraft.wheels[number].torque
    ends = [jp.follow(plan, moved(plan.scenario, number, "torque", 1.0, side * step)) for side in (1, -1)]
    found = [float(jp.measures.duration(jp.differentiable(end)(end.scenario))) for end in ends]
    told = float(slopes.spacecraft.wheels[number].torque)
    assert told == pytest.approx((found[0] - found[1]) / (2 * step), rel=2e-2)
    assert told < 0


@pytest.mark.slow
@pytest.mark.parametrize("allocation", ["pseudo_inverse", "minimax"])
def test_wheels_that_are_all_full_at_once_have_the_slope_of_all_together(allocation):
    """A turn about the axis of a pyramid takes as long as one over the root of the torque of its wheels."""
    tilt, around = np.sqrt(2 / 3), np.deg2rad([0.0, 90.0, 180.0, 270.0])
    axes = np.stack([tilt * np.cos(around), tilt * np.sin(around), np.full(4, np.sqrt(1 / 3))], axis=1)
    wheels = tuple(
        jp.Wheel(name=f"wheel-{k}", axis=axis, torque=0.1, momentum=50.0) for k, axis in enumerate(axes)
    )
    # A spacecraft like those above, so that what is compiled for these serves here.
    turn = {"turn": (0.0, 0.0, 1.2), "duration": "minimum", "first_guesses": 0}
    scenario = with_wheels(wheels, allocation, **turn)
    limit, sphere = float(np.deg2rad(20.0)), np.diag([10.0, 10.0, 10.0])
    craft = replace(scenario.spacecraft, rate_limit=limit, acceleration_limit=limit, inertia=sphere)
    goal = replace(scenario.goal, joints=scenario.start.joints)
    plan = jp.plan(replace(scenario, spacecraft=craft, goal=goal), progress=False)
    found = jp.sensitivities(plan, "duration")
    together = sum(0.1 * found[f"spacecraft.wheel[{k}].torque_nm"] for k in range(4))
    assert together == pytest.approx(-plan.trajectory.duration / 2, rel=1e-3)
