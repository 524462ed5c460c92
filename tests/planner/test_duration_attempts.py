"""Durations that are given: what can be done in them is planned, and else told is what can."""

import re
from dataclasses import replace

import jax
import numpy as np
import pytest
from dense import assert_kept
from quick import quick_jit

import jaxplan as jp

SEED, KIND = 0, "keep_out"  # platform and joints both bind, and to its nearest goal it takes 13 % longer


def lasting(scenario, duration, **goal):
    asked = replace(scenario, trajectory=replace(scenario.trajectory, duration=duration))
    return replace(asked, goal=replace(asked.goal, **goal)) if goal else asked


def told(plan):
    """The duration that a refusal says is enough."""
    found = re.search(
        r"at most ([\d.]+) s are needed: set trajectory.duration_s to ([\d.]+) or more", plan.message
    )
    assert found is not None, plan.message
    assert found.group(1) == found.group(2)
    return float(found.group(1))


@pytest.fixture(scope="module")
def scene():
    return jp.random_scenario(SEED, KIND)


@pytest.fixture(scope="module")
def least(scene):
    """The shortest duration, s."""
    return jp.plan(lasting(scene, "minimum")).trajectory.duration


@pytest.mark.parametrize("share", [0.6, 0.97])
def test_too_short_a_duration_is_answered_by_the_shortest_one_that_is_certified(scene, least, share):
    plan = jp.plan(lasting(scene, share * least), throw=False)
    assert plan.status in (jp.Status.LIMITS_TOO_TIGHT, jp.Status.GOAL_UNREACHABLE)
    assert least <= told(plan) <= least + 0.011
    assert jp.plan(lasting(scene, told(plan)), throw=False).ok


def test_a_duration_that_another_goal_can_be_reached_in_is_planned(scene, least):
    duration = 1.01 * least
    plan = jp.plan(lasting(scene, duration))
    assert plan.trajectory.duration == pytest.approx(duration, rel=1e-12)
    assert plan.scenario.goal.criterion == "least_time"
    assert 'goal.criterion = "least_time"' in plan.message
    assert_kept(plan.trajectory, scene.spacecraft, scene.keep_out)


def test_a_criterion_that_is_given_is_kept(scene, least):
    plan = jp.plan(lasting(scene, 1.01 * least, criterion="least_rotation"), throw=False)
    assert plan.status is jp.Status.LIMITS_TOO_TIGHT
    assert plan.scenario.goal.criterion == "least_rotation"
    nearest = jp.plan(lasting(scene, "minimum", criterion="least_rotation")).trajectory.duration
    assert nearest <= told(plan) <= nearest + 0.011


def test_where_there_is_time_the_goal_stays_that_of_least_rotation(scene, least):
    plan = jp.plan(lasting(scene, 2 * least))
    assert plan.scenario.goal.criterion is None
    assert plan.message == ""


def test_at_speed_what_is_told_is_certified_too(scene):
    moving = replace(scene.start, angular_velocity=np.array([0.01, -0.005, 0.008]))
    plan = jp.plan(lasting(replace(scene, start=moving), 12.0), throw=False)
    assert not plan.ok
    assert jp.plan(lasting(replace(scene, start=moving), told(plan)), throw=False).ok


def test_a_plan_in_a_given_time_is_held_with_the_goal_that_it_has(scene, least):
    plan = jp.plan(lasting(scene, 1.03 * least))
    held = jp.hold(plan)
    with jax.enable_x64(True):
        again = quick_jit(jp.replan)(held, jax.tree.map(np.asarray, plan.scenario))
    np.testing.assert_allclose(again.sample(0.0).attitude, plan.scenario.start.attitude, atol=1e-9)
    np.testing.assert_allclose(again.sample(plan.trajectory.duration).attitude, plan.goal.attitude, atol=1e-6)


def test_a_batch_answers_as_one(scene, least):
    asked = [lasting(scene, share * least) for share in (0.7, 1.01, 2.0)]
    together, alone = jp.plan_batch(asked), [jp.plan(one, throw=False) for one in asked]
    assert [plan.status for plan in together] == [plan.status for plan in alone]
    assert [plan.message for plan in together] == [plan.message for plan in alone]
