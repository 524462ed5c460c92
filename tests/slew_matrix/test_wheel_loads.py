"""What wheels store at the departures of slews: what is stored at the reference, seen from the body there."""

from dataclasses import replace

import numpy as np
import pytest
from wheels import INERTIA, not_against, numbers, random_wheels, wheels

import jaxplan as jp

GOALS = {
    "first": jp.GivenState(rotation_vector=[0.2, -0.3, 0.5], joints=[]),
    "second": jp.GivenState(rotation_vector=[-0.4, 0.1, 0.9], joints=[]),
    "third": jp.GivenState(
        rotation_vector=[0.6, 0.5, -0.2], joints=[], angular_velocity=[0.003, -0.002, 0.004]
    ),
}
STRETCHED = {"trajectory.first_guesses": 0, "trajectory.duration_s": "stretched"}  # found quickly
REFERENCE = jp.GivenState(
    rotation_vector=[0.1, 0.2, -0.1], joints=[], angular_velocity=[-0.002, 0.001, 0.003]
)


def telescope(array, allocation="pseudo_inverse"):
    return jp.Spacecraft(
        instruments=[jp.Instrument(name="telescope", boresight=[0, 0, 1])],
        rate_limit=np.deg2rad(2.0),
        acceleration_limit=np.deg2rad(0.5),
        inertia=INERTIA,
        wheels=array,
        allocation=allocation,
    )


@pytest.mark.parametrize("allocation", ["pseudo_inverse", "minimax"])
def test_each_slew_begins_with_what_wheels_hold_at_the_end_of_any_other_to_its_state(allocation):
    array = random_wheels(4, seed=3)
    if allocation == "minimax":
        array = not_against(array)
    craft = telescope(array, allocation)
    settings = {"trajectory.first_guesses": 0}
    none = np.zeros((len(GOALS), len(GOALS)), bool)  # the slews are planned one by one below
    slews = jp.slew_times(craft, GOALS, start=REFERENCE, settings=settings, pairs=none, progress=False)
    axes, _, _, stored = numbers(craft)
    total = REFERENCE.attitude @ (INERTIA @ REFERENCE.angular_velocity + stored @ axes)
    for name, state in GOALS.items():
        spin = np.zeros(3) if state.angular_velocity is None else np.asarray(state.angular_velocity)
        others = [other for other in GOALS if other != name]
        begin, *_ = [numbers(slews.scenario(name, other).spacecraft)[3] for other in others]
        np.testing.assert_allclose(begin @ axes, state.attitude.T @ total - INERTIA @ spin, atol=1e-9)
        for other in others:
            plan = jp.plan(slews.scenario(other, name), progress=False)
            own = plan.scenario.spacecraft
            end = jp.measures.wheel_momenta(plan.trajectory, own, plan.trajectory.duration)
            np.testing.assert_allclose(end @ axes, begin @ axes, atol=1e-6)
            if allocation == "pseudo_inverse":
                np.testing.assert_allclose(end, begin, atol=1e-6)


def test_chains_are_possible_just_where_timelines_do_them():
    """Two wheels that together hold more than one can: turned by 20 deg, one of them would be overfull."""
    craft = telescope(wheels(np.eye(3), 0.3, 8.0, [6.5, 6.5, 0.0]))
    turned = {
        f"{angle} deg": jp.GivenState(rotation_vector=[0, 0, np.deg2rad(angle)], joints=[])
        for angle in (0, 10, 20)
    }
    slews = jp.slew_times(craft, turned, progress=False)
    fine = np.array([True, True, False])
    np.testing.assert_array_equal(slews.status == "OK", fine[:, None] & fine)
    words = f'20 deg: wheel "wheel-1" would hold {6.5 * np.sqrt(2) * np.cos(np.deg2rad(25)):.4g} N m s there'
    assert slews.messages[0, 2].startswith(words)
    scene = replace(slews.scenario("0 deg", "10 deg"), name="chain")
    for asked in (["10 deg", "0 deg"], ["10 deg", "20 deg"]):
        activities = [jp.Activity(name=name, attitude=turned[name], duration=1.0) for name in asked]
        timeline = jp.Timeline(name="chain", scene=scene, activities=activities)
        assert jp.plan_timeline(timeline, throw=False, progress=False).ok is ("20 deg" not in asked)


def test_a_load_at_the_limit_is_no_overload_by_rounding():
    craft = telescope(wheels(np.eye(3), 0.3, 8.0, [8.0, 0.0, 0.0]))
    about = {f"{angle}": jp.GivenState(rotation_vector=[angle, 0, 0], joints=[]) for angle in (0.0, 0.3, 0.7)}
    slews = jp.slew_times(craft, about, settings=STRETCHED, progress=False)
    for name in about:
        assert all(
            abs(wheel.stored) <= wheel.momentum
            for wheel in slews.scenario(name, "0.0" if name != "0.0" else "0.3").spacecraft.wheels
        )
