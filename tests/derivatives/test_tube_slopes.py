"""Slopes of plans by the tube's numbers beside differences."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from reference import angle, boresights_of, unit
from wheels import scarce, with_wheels

import jaxplan as jp

ROBUST = jp.Robust(
    attitude_error=np.deg2rad(0.4), joint_error=np.deg2rad(0.3), torque_reserve=12.0, momentum_reserve=6.0
)
STEPS = {"attitude_error": 1e-4, "joint_error": 1e-4, "torque_reserve": 1e-3, "momentum_reserve": 1e-3}


def moved(scenario, name, step):
    """The scenario with one of the tube's numbers larger by a step."""
    own = scenario.robust
    return replace(scenario, robust=replace(own, **{name: getattr(own, name) + step}))


def timed(scenario, duration):
    return replace(scenario, trajectory=replace(scenario.trajectory, duration=duration))


def in_the_way():
    """A slew with wheels past zones in the way of a terminal and of a camera."""
    scenario = with_wheels(scarce(4, seed=5), turn=(0.5, -0.9, 0.6), duration="stretched")
    camera = jp.Instrument(name="camera", boresight=unit([0.8, 0.0, -0.6]))
    scenario = replace(scenario, spacecraft=replace(scenario.spacecraft, instruments=(camera,)))
    straight = jp.plan(scenario, progress=False).trajectory
    times = straight.duration * np.array([0.0, 0.45, 0.5, 0.55, 1.0])
    zones = []
    for device, beam in enumerate(np.moveaxis(boresights_of(straight, scenario.spacecraft, times), 1, 0)):
        aside = unit(np.cross(beam[2], beam[3] - beam[1]))
        axis = unit(np.cos(0.15) * beam[2] + np.sin(0.15) * aside)
        wide = float(min(angle(axis, beam[0]), angle(axis, beam[-1]))) - 0.06
        names = (scenario.spacecraft.device_names[device],)
        zones.append(jp.KeepOut(name=f"lamp {device}", direction=axis, half_angle=wide, devices=names))
    return replace(scenario, keep_out=tuple(zones), robust=ROBUST)


@pytest.fixture(scope="module")
def plan():
    """The shortest, which leans on the zone and is as quick as wheels allow."""
    found = jp.plan(timed(in_the_way(), "minimum"), progress=False)
    assert found.ok, found.message
    return found


def compared(plan, measure, names):
    """The measure, and by the tube's numbers of these names its slopes beside differences."""
    trajectory = jp.differentiable(plan)
    here, found = float(measure(trajectory(plan.scenario))), {}
    with jax.enable_x64(True):
        slopes = jax.grad(lambda own: measure(trajectory(own)), allow_int=True)(plan.scenario).robust
    for name in names:
        ends = [
            float(measure(trajectory(moved(plan.scenario, name, side * STEPS[name])))) for side in (1, -1)
        ]
        found[name] = float(getattr(slopes, name)), (ends[0] - ends[1]) / (2 * STEPS[name])
    return here, found


@pytest.mark.slow
def test_slopes_of_the_shortest_duration_are_differences(plan):
    _, found = compared(plan, jp.measures.duration, STEPS)
    for name, (told, expected) in found.items():
        assert told == pytest.approx(expected, rel=1e-5, abs=1e-6 * plan.trajectory.duration), name
        assert told > 1e-2 or name == "joint_error"  # a wider tube takes longer


@pytest.mark.slow
def test_slopes_of_the_effort_by_what_is_kept_back_are_differences():
    """In a time not much longer than the shortest, so that wheels bind in torque and in momentum."""
    scenario = replace(with_wheels(scarce(4, seed=5), duration="minimum"), robust=ROBUST)
    shortest = jp.plan(scenario, progress=False).trajectory.duration
    plan = jp.plan(timed(scenario, 1.25 * shortest), progress=False)
    here, found = compared(plan, jp.measures.effort, ("torque_reserve", "momentum_reserve"))
    for name, (told, expected) in found.items():
        assert told == pytest.approx(expected, rel=1e-5, abs=1e-8 * here), name
        binding = abs(expected) > 1e-4 * here  # a percent more costs effort
        assert binding or name == "momentum_reserve"


@pytest.mark.slow
def test_slopes_in_a_given_time_are_differences():
    """Among masks, beams and zones of all kinds, on some of which the motion leans."""
    scene = replace(jp.random_scenario(3, "mixed"), robust=ROBUST)
    plan = jp.plan(timed(scene, 60.0), progress=False)
    here, found = compared(plan, jp.measures.effort, ("attitude_error", "joint_error"))
    for name, (told, expected) in found.items():
        assert told == pytest.approx(expected, rel=1e-6), name
        assert told > 0.1 * here  # a wider tube takes more
