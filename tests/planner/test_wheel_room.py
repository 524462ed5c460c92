"""Goals at which no wheel is full: where the targets leave the roll free, and by plain numpy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from wheels import least_shared, not_against, numbers, random_wheels, wheels

import jaxplan as jp
from jaxplan.planner.entry_points import as_filed
from jaxplan.planner.wheel_room import SHARES, fullest, overfull, total_at_start, with_wheel_room

STORED = np.array([7.9, 3.0, 0.0])  # N m s
LIMIT = 8.0
OFF = np.deg2rad(10.4)
TARGET = np.array([np.sin(OFF), -np.cos(OFF), 0.0])
NEAREST = Rotation.from_rotvec(np.pi / 2 * np.array([np.cos(OFF), np.sin(OFF), 0.0]))  # turn to the target
STEP = np.deg2rad(0.01)


def observer(array=None, **more):
    """A telescope along z with three wheels about the body axes, the first of them nearly full."""
    return jp.Spacecraft(
        instruments=[jp.Instrument(name="telescope", boresight=[0, 0, 1])],
        rate_limit=np.deg2rad(1.0),
        acceleration_limit=np.deg2rad(0.3),
        inertia=[80.0, 110.0, 95.0],
        wheels=wheels(np.eye(3), 0.3, LIMIT, STORED) if array is None else array,
        **more,
    )


def scene(duration, criterion=None, craft=None):
    """From the identity to the target, the roll being free."""
    scenario = jp.Scenario(
        name="roll",
        spacecraft=observer() if craft is None else craft,
        start=jp.GivenState(rotation_vector=[0, 0, 0], joints=[]),
        goal=jp.Targets.of({"telescope": TARGET}, criterion=criterion),
    )
    return replace(scenario, trajectory=replace(scenario.trajectory, duration=duration))


def nearest_with_room(share):
    """The least turn among all rolls at which no wheel holds more than a share of its limit, rad."""
    rolls = np.arange(-np.pi, np.pi, STEP)
    every = NEAREST * Rotation.from_rotvec(rolls[:, None] * [0, 0, 1])
    held = np.abs(every.inv().apply(STORED)).max(axis=1) / LIMIT
    return every.magnitude()[held <= share].min()


@pytest.mark.parametrize(
    ("duration", "criterion"),
    [("stretched", None), ("minimum", "least_rotation"), ("minimum", None), (120.0, None)],
)
def test_where_wheels_are_full_at_the_nearest_goal_the_nearest_is_taken_at_which_none_is(duration, criterion):
    held = np.abs(NEAREST.inv().apply(STORED))
    assert held.max() > LIMIT
    plan = jp.plan(scene(duration, criterion), progress=False)
    assert plan.ok, plan.message
    np.testing.assert_allclose(plan.goal.attitude[:, 2], TARGET, atol=1e-7)
    assert np.abs(STORED @ plan.goal.attitude).max() <= LIMIT
    if criterion is None and duration == "minimum":
        return  # a goal of least time
    assert plan.goal.slew_angle == pytest.approx(nearest_with_room(SHARES[0]), abs=2 * STEP)
    assert plan.message == "" or "least_time" not in plan.message


def test_with_targets_that_move_the_message_names_the_criterion_with_which_there_is_a_plan():
    times = np.linspace(0, 400, 41)
    angles = OFF + 1e-5 * times
    path = jp.DirectionPath.through(times, np.stack([np.sin(angles), -np.cos(angles), 0 * angles], axis=1))
    found = {}
    for criterion in (None, "least_time"):
        goal = jp.Targets.of({"telescope": path}, criterion=criterion)
        found[criterion] = jp.plan(replace(scene(120.0), goal=goal), throw=False, progress=False)
    assert found[None].status is jp.Status.LIMITS_TOO_TIGHT
    assert 'set goal.criterion = "least_time" for other goals' in found[None].message
    assert found["least_time"].ok, found["least_time"].message


def test_slopes_of_such_a_goal_are_refused():
    plan = jp.plan(scene(120.0), progress=False)
    with pytest.raises(ValueError, match="leans on what a wheel may hold there: give the goal as a state"):
        jp.differentiable(plan)


@pytest.mark.parametrize("allocation", ["pseudo_inverse", "minimax"])
@pytest.mark.parametrize("count", [3, 4, 6])
def test_zones_are_kept_just_where_wheels_hold_no_more_than_a_share(allocation, count):
    """By linear programs with the envelope, and by the pseudo-inverse of numpy, at random attitudes."""
    array = random_wheels(count, seed=count)
    if allocation == "minimax":
        array = not_against(array)
    craft = observer(array, allocation=allocation)
    axes, _, most, stored = numbers(craft)
    scenario = as_filed("scenario", scene("stretched", craft=craft))
    total = total_at_start(scenario)
    np.testing.assert_allclose(total, stored @ axes, atol=1e-12)
    attitudes = Rotation.random(200, rng=np.random.default_rng(count)).as_matrix()
    held = total @ attitudes
    if allocation == "minimax":
        shares = np.array([least_shared(axes, most, own)[0] for own in held])
    else:
        apart = stored - np.linalg.pinv(axes.T) @ (stored @ axes)
        shares = np.abs((held @ np.linalg.pinv(axes.T).T + apart) / most).max(axis=1)
    np.testing.assert_allclose(fullest(craft, total, attitudes), shares, atol=1e-6)
    # of other limits, so that some attitudes keep them
    lower = tuple(replace(one, momentum=one.momentum * np.median(shares) / SHARES[0]) for one in array)
    roomy, *_ = with_wheel_room(replace(scenario, spacecraft=replace(craft, wheels=lower)), total)
    kept = np.ones(len(attitudes), bool)
    for zone in roomy.keep_out:
        (vector,) = zone.vectors
        kept &= np.arccos(attitudes @ vector.along @ zone.direction) >= zone.half_angle
    np.testing.assert_array_equal(kept, shares <= np.median(shares))
    assert 50 < np.sum(kept) < 150


def test_where_no_attitude_leaves_room_the_full_wheel_is_named():
    craft = observer(wheels(np.eye(3), 0.3, LIMIT, 0.999 * LIMIT))  # full at all but turns of the axes
    plan = jp.plan(scene("stretched", craft=craft), throw=False, progress=False)
    assert plan.status is jp.Status.LIMITS_TOO_TIGHT
    assert 'at the goal, however slowly it is reached, wheel "wheel-' in plan.message


def test_without_wheels_none_is_overfull():
    assert not overfull(replace(observer(), wheels=()), None, np.eye(3))
    assert list(with_wheel_room(scene("stretched"), None)) == []


def test_a_timeline_and_slew_times_go_where_wheels_are_not_full():
    craft, start = observer(), jp.GivenState(rotation_vector=[0, 0, 0], joints=[])
    asked = jp.Targets.of({"telescope": TARGET})
    for activity in (
        jp.Activity(name="track", track=asked, duration=20.0),
        jp.Activity(name="glance", point=asked),
    ):
        timeline = jp.Timeline(name="roll", scene=scene("stretched"), activities=[activity], until=600.0)
        day = jp.plan_timeline(timeline, progress=False)
        assert day.ok, day.message
        held = jp.measures.wheel_momenta(day.trajectory, craft, np.linspace(0, day.trajectory.duration, 400))
        assert np.abs(held).max() <= LIMIT * (1 + 1e-9)
    times = jp.slew_times(craft, {"start": start, "target": asked}, progress=False)
    assert times.status[0, 1] == "OK", times.messages[0, 1]
