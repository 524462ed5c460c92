"""Motions with rates at start or goal come within the limits without being scaled in time."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import jaxplan as jp

TORQUE = 0.2  # N m
STORED = (1.0, 3.0, -2.0)  # N m s
START_RATES = [0.002, -0.003, 0.0025]  # rad/s

CRAFT = jp.Spacecraft(
    instruments=(jp.Instrument(name="camera", boresight=np.array([0.0, 0.0, 1.0])),),
    rate_limit=np.deg2rad(2.0),
    acceleration_limit=np.deg2rad(0.5),
    inertia=np.diag([100.0, 120.0, 90.0]),
)


def scenario(craft, rates, goal, duration):
    return jp.Scenario(
        name="moving",
        spacecraft=craft,
        start=jp.GivenState(rotation_vector=[0.0, 0.0, 0.0], joints=[], angular_velocity=rates),
        goal=jp.GivenState(rotation_vector=goal, joints=[]),
        trajectory=jp.TrajectorySettings(duration=duration),
    )


def planned(scenarios):
    plans = jp.plan_batch(scenarios, progress=False)
    assert [plan.message for plan in plans if not plan.ok] == []
    return [plan.trajectory.duration for plan in plans]


def about_one_axis(rate, angle, duration="minimum"):
    return scenario(replace(CRAFT, torque_limit=TORQUE), [rate, 0.0, 0.0], [angle, 0.0, 0.0], duration)


RATES_AND_ANGLES = [(0.01, 0.0), (0.005, 0.0), (0.02, 0.0), (-0.02, 0.0), (0.01, -0.1), (-0.01, 0.05)]


def bang_bang(rate, angle):
    """Least time, s, from a rate to rest at an angle, about the x axis, by the switching curve."""
    a = TORQUE / 100.0
    after_braking = rate * abs(rate) / (2 * a)
    side = 1.0 if angle > after_braking else -1.0
    peak = np.sqrt(a * side * angle + rate * rate / 2)  # size of the rate where the torque switches
    return (2 * peak - side * rate) / a


def test_shortest_motions_about_one_axis_take_little_more_than_the_bang_bang_time():
    """Accelerations have to be continuous and zero at the ends, which costs a few per cent."""
    found = planned([about_one_axis(*one) for one in RATES_AND_ANGLES])
    expected = np.array([bang_bang(*one) for one in RATES_AND_ANGLES])
    assert np.all(found >= expected)
    assert np.all(found <= 1.05 * expected)


def turning(torque, duration):
    """A spacecraft that turns at the start, and whose wheels hold momentum that must be turned with it."""
    wheels = [
        jp.Wheel(name=name, axis=axis, torque=torque, momentum=6.0, stored=stored)
        for name, axis, stored in zip("abc", np.eye(3), STORED, strict=True)
    ]
    return scenario(replace(CRAFT, wheels=tuple(wheels)), START_RATES, [0.8, -0.6, 0.9], duration)


@cache
def shortest_durations():
    """Durations, s, of the shortest motions with weaker and weaker wheels, planned once."""
    return planned([turning(torque, "minimum") for torque in (0.02, 0.0105, 0.0102, 0.0100)])


@cache
def too_short():
    """Plans in less time than any needs, s, of which the first is below what can be proved to be needed."""
    return jp.plan_batch([turning(0.02, each) for each in (20.0, 150.0)], progress=False)


def test_weaker_wheels_do_not_lead_to_shorter_motions():
    found = shortest_durations()
    assert np.all(np.diff(found) > -0.005 * np.array(found[1:]))
    assert found[-1] < 1.05 * found[-3]  # nor by far to longer ones


@pytest.mark.slow
def test_any_number_above_the_shortest_duration_has_a_plan():
    cases = [(0.02, each) for each in (200.0, 300.0, 360.0, 400.0, 500.0, 800.0)]
    cases += [(0.0102, each) for each in (400.0, 500.0, 800.0, 2000.0)]
    np.testing.assert_allclose(planned([turning(*one) for one in cases]), [each for _, each in cases])


def test_a_number_that_is_too_small_is_answered_with_the_shortest_duration():
    plan = too_short()[1]
    assert plan.status is jp.Status.LIMITS_TOO_TIGHT
    told = float(plan.message.partition("at most ")[2].partition(" s")[0])
    assert told == pytest.approx(shortest_durations()[0], rel=0.02)


@pytest.mark.slow
def test_a_motion_in_less_time_than_any_needs_is_shown_with_the_rates_that_were_given():
    for plan in too_short():
        assert plan.status is jp.Status.LIMITS_TOO_TIGHT
        assert plan.trajectory.duration == plan.scenario.trajectory.duration
        ends = plan.trajectory.sample(np.array([0.0, plan.trajectory.duration]))
        np.testing.assert_allclose(ends.angular_velocity, [START_RATES, [0.0, 0.0, 0.0]], atol=1e-12)


def test_a_stretched_motion_leaves_the_nodes_where_they_make_it_slow():
    stretched, shortest = planned([about_one_axis(-0.02, 1.0, each) for each in ("stretched", "minimum")])
    assert stretched < 1.1 * shortest


@pytest.mark.parametrize("duration", [300.0, "minimum", "stretched"])
def test_rates_that_alone_need_more_torque_than_there_is_are_told_at_once(duration):
    torque = 4e-3
    plan = jp.plan(turning(torque, duration), throw=False, progress=False)
    rates = np.array(START_RATES)
    needed = np.abs(np.cross(rates, CRAFT.inertia @ rates + STORED))  # to turn the momentum with the body
    assert plan.status is jp.Status.LIMITS_TOO_TIGHT
    assert plan.trajectory is None
    share, name = np.max(needed) / torque, "abc"[np.argmax(needed)]
    assert f"at the start the rates alone need {share:.4g} times the limit of {name} torque" in plan.message


def test_reserves_that_leave_too_little_torque_are_named():
    scene = replace(turning(0.02, "minimum"), robust=jp.Robust(torque_reserve=80.0))
    plan = jp.plan(scene, throw=False, progress=False)
    assert "or lower [robust] torque_reserve_percent = 80, which is taken off that limit" in plan.message


@pytest.mark.parametrize("duration", [60.0, 80.0])
def test_a_motion_in_a_given_time_with_small_rates_at_its_ends_is_like_that_from_rest_to_rest(duration):
    settings = jp.TrajectorySettings(duration=duration)
    scene = replace(jp.paper_case(1), keep_out=(), trajectory=settings)
    efforts = []
    for rate in (0.0, 1e-9, 1e-4, -1e-4):
        start = replace(scene.start, angular_velocity=[0.0, 0.0, rate], joint_rates=np.full(6, rate))
        efforts.append(float(jp.measures.effort(jp.plan(replace(scene, start=start), progress=False))))
    assert efforts[1] == pytest.approx(efforts[0], rel=1e-6)
    np.testing.assert_allclose(efforts, efforts[0], rtol=0.02)
