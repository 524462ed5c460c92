"""Rates that follow targets: devices stay on these, and derivatives are those of goals found anew."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import make_observer
from pointing_aims import random_aims
from quick import quick_jit
from reference import unit
from scipy.spatial.transform import Rotation

from jaxplan.goal import tracking_rates
from jaxplan.goal.derivative import goal_in_time
from jaxplan.goal.pointing_start import differentiable_rates, least_rates
from jaxplan.model.goals import Targets
from jaxplan.model.path import Goal

STEP = 1e-6  # s, after which boresights are looked at


def beams(craft, attitude, joints):
    """Boresights of all devices, inertial."""
    own = np.concatenate([np.asarray(craft.gimbals.boresights(joints)), craft.fixed_boresights])
    return own @ attitude.T


@pytest.mark.parametrize("places", [[0], [1], [2], [0, 1], [0, 2], [1, 2], [0, 1, 2]])
def test_rates_keep_devices_on_targets_that_move_and_are_the_same_in_jax(places):
    craft, rng = make_observer(), np.random.default_rng(5)
    attitude, joints = Rotation.random(rng=rng).as_matrix(), np.array([0.4, 0.3, 0.7])
    names = [craft.device_names[place] for place in places]
    seen = beams(craft, attitude, joints)[places]
    targets = Targets.of(dict(zip(names, seen, strict=True)))
    rates = np.cross(1e-3 * rng.normal(size=seen.shape), seen)
    goal = Goal(attitude=attitude, joints=joints, slew_angle=0.0)
    spin, moved = least_rates(craft, targets, goal, rates)
    with jax.enable_x64(True):
        again = differentiable_rates(craft, targets, attitude, joints, rates)
    np.testing.assert_allclose(again[0], spin, atol=1e-15)
    np.testing.assert_allclose(again[1], moved, atol=1e-15)
    turned = attitude @ Rotation.from_rotvec(STEP * spin).as_matrix()
    later = beams(craft, turned, joints + STEP * moved)[places]
    np.testing.assert_allclose((later - seen) / STEP, rates, atol=1e-7)
    assert np.max(np.abs(rates)) > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 3, 5])
def test_derivatives_of_rates_at_goals_are_those_of_rates_at_goals_found_anew(seed):
    _, problem = random_aims(seed)
    rng, craft, targets = np.random.default_rng(seed), problem.spacecraft, problem.targets
    moves, way = rng.normal(size=(2, *targets.directions.shape))
    goal = problem.decompose(max_goals=1).goals[0]
    given = {
        "start_joints": goal.joints,
        "target_rates": np.cross(1e-2 * moves, targets.directions),
        "axis_rates": np.zeros_like(problem.cones.axis),
    }
    way -= np.sum(way * targets.directions, axis=1, keepdims=True) * targets.directions

    def found_anew(by):
        directions = unit(targets.directions + by * way)
        moved = replace(targets, directions=directions)
        place = replace(problem, targets=moved).decompose(max_goals=1).goals[0]
        return np.concatenate(tracking_rates(place, craft, problem.start, moved, problem.cones, **given))

    def rates(by):
        moved = replace(targets, directions=targets.directions + by * way)
        found = goal_in_time(goal, craft, problem.start, moved, problem.cones, **given)
        return found.angular_velocity, found.joint_rates

    with jax.enable_x64(True):
        slopes = np.concatenate(quick_jit(lambda by: jax.jvp(rates, (by,), (1.0,))[1])(0.0))
    step = 1e-4
    expected = (8 * (found_anew(step) - found_anew(-step)) - found_anew(2 * step) + found_anew(-2 * step)) / (
        12 * step
    )
    np.testing.assert_allclose(slopes, expected, atol=1e-7)
    assert np.max(np.abs(slopes)) > 1e-3
