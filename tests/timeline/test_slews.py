"""Slews to states with accelerations of their own keep limits that the fit takes in full."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario

import jaxplan as jp
from jaxplan.certificate import Certificate
from jaxplan.timeline import slews
from jaxplan.timeline.slews import Departure
from jaxplan.timeline.tracking import State


def departures(count=8, share=1.06):
    """Slews at rest from the start, to states that turn and accelerate on, each with a short duration."""
    scene, rng = make_scenario(2), np.random.default_rng(4)
    scene = replace(scene, keep_out=(), keep_in=())
    craft = scene.spacecraft
    still = State.still(scene.start.attitude, scene.start.joints)
    depart = Departure(scene=scene, craft=craft, state=still, time=0.0)
    for _ in range(count):
        turn = jp.so3.exp(rng.uniform(0.5, 1.0, 3) * rng.choice([-1.0, 1.0], 3))
        # braking goes on to the end, and what the end's own acceleration adds comes on top
        goal = replace(
            still,
            attitude=still.attitude @ turn,
            acceleration=-0.2 * craft.acceleration_limit * np.sign(jp.so3.log(turn)),
        )
        yield depart, goal, share * depart.bound(goal)


def test_slews_keep_limits_with_what_accelerations_at_the_ends_add(monkeypatch):
    found = [(goal, depart._slew_along(None, goal, duration)) for depart, goal, duration in departures()]
    monkeypatch.setattr(slews, "_peak_over_limit", lambda proof, names: 0.0)  # without less for the fit
    bare = [depart._slew_along(None, goal, duration) for depart, goal, duration in departures()]
    helped = 0
    for (goal, slew), other in zip(found, bare, strict=True):
        if other.trajectory is not None:
            np.testing.assert_array_equal(slew.trajectory.coefficients, other.trajectory.coefficients)
        elif slew.trajectory is not None:
            helped += 1
            assert other.status is jp.Status.UNCERTIFIED
            assert slew.proof.certified
            end = slew.trajectory.sample(slew.trajectory.duration)
            np.testing.assert_allclose(end.angular_acceleration, goal.acceleration, atol=1e-12)
    assert helped >= 3


def test_only_accelerations_a_little_beyond_their_limits_ask_for_less():
    proof = Certificate(
        certified=False, faults=("acceleration",), peaks={"angular_acceleration": 1.04, "joint_rates": 0.9}
    )
    assert slews._peak_over_limit(proof, slews._ACCELERATION_NAMES) == 1.04
    assert slews._peak_over_limit(proof, slews._RATE_NAMES) == 0  # for what else fails nothing is done
    assert slews._peak_over_limit(None, slews._ACCELERATION_NAMES) == 0
    for changed in (
        {"min_margin": -1e-3},
        {"min_margin": np.nan},
        {"peaks": {}},
        {"peaks": {"angular_acceleration": 1.3}},
        {"peaks": {"angular_acceleration": 1.04, "joint_rates": 1.01}},
        {"peaks": {"angular_acceleration": 1.04, "yaw": np.nan}},
    ):
        assert not slews._peak_over_limit(replace(proof, **changed), slews._ACCELERATION_NAMES) > 1, changed


def test_all_limits_of_acceleration_are_made_less():
    craft = replace(make_scenario(2).spacecraft, acceleration_norm_limit=0.03)
    less = slews._ease_accelerations(craft, 1.25)
    np.testing.assert_allclose(1.25 * np.asarray(less.acceleration_limit), craft.acceleration_limit)
    assert 1.25 * less.acceleration_norm_limit == pytest.approx(0.03)
    np.testing.assert_allclose(1.25 * less.joint_acceleration_limits, craft.joint_acceleration_limits)
    np.testing.assert_array_equal(less.rate_limit, craft.rate_limit)
