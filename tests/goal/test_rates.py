"""The least rates that follow targets: alike by numpy and JAX, and devices stay on their targets."""

import jax
import numpy as np
import pytest
from builders import make_observer
from scipy.spatial.transform import Rotation

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
