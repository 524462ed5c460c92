"""Wishes of random spacecraft that were once left without a goal by them."""

from dataclasses import replace

import numpy as np
import pytest
from pointing_aims import axes
from reference import angle, assert_each, in_body, own_joints, state_margins
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.cases import any_spacecraft
from jaxplan.goal import decompose, multistart

SPACING = 2e-3  # rad, of a grid over roll


@pytest.mark.parametrize(("seed", "most"), [(38, 1e-6), (41, 1e-6), (48, 1e-6), (336, 0.006627)])
def test_a_wish_leaves_a_goal_that_meets_all_else(seed, most):
    """Of the first three the wish can be met to the full; of the last all but a speck is ruled out."""
    stream = np.random.SeedSequence(0, spawn_key=(14, seed))
    scenario = any_spacecraft.draw(np.random.Generator(np.random.PCG64(stream)), "left without a goal")
    craft, start = scenario.spacecraft, scenario.start
    found = decompose(craft, start.attitude, scenario.goal, scenario.constraints, start_joints=start.joints)
    assert found.goals
    for goal in found.goals:
        (wish,) = scenario.goal.prefer
        beam = goal.attitude @ in_body(craft, wish.device, goal.joints[None])[0]
        assert angle(beam, wish.direction) <= most
        for name, target in zip(scenario.goal.devices, scenario.goal.directions, strict=True):
            assert angle(goal.attitude @ in_body(craft, name, goal.joints[None])[0], target) <= 1e-8
        margins = state_margins(scenario, goal.attitude[None], goal.joints[None], np.zeros(1))
        assert_each(list(margins.values()), ">=", -1e-9)


def pointed(craft, name, body):
    """Azimuth and elevation (..., 2) rad of directions in body axes, in those of a terminal."""
    terminal = next(one for one in craft.terminals if one.name == name)
    up, ahead = np.array(terminal.mounting.yaw_axis), np.array(terminal.mounting.boresight)
    own = body @ axes(up, ahead)
    return np.stack([np.arctan2(own[..., 1], own[..., 0]), np.arcsin(np.clip(own[..., 2], -1, 1))], axis=-1)


def beyond(angles, ends):
    """How far angles (...) rad are beyond a range; those of yaws count by the nearest turn."""
    middle, half = np.mean(ends), (ends[1] - ends[0]) / 2
    return np.abs(np.mod(angles - middle + np.pi, 2 * np.pi) - np.pi) - half


def standing(scenario, attitudes):
    """Joints (k, J) rad with devices on their targets at attitudes (k, 3, 3), and by how much these miss."""
    craft = scenario.spacecraft
    joints, missed = np.repeat(scenario.start.joints[None], len(attitudes), axis=0), []
    for name, target in zip(scenario.goal.devices, scenario.goal.directions, strict=True):
        own = own_joints(craft, name)
        if own:
            joints[:, own] = pointed(craft, name, target @ attitudes)
            missed += [beyond(joints[:, joint], craft.joint_ranges[joint]) for joint in own]
        else:
            missed.append(angle(attitudes @ in_body(craft, name, joints[:1])[0], target))
    return joints, np.max(missed, axis=0)


def kept(scenario, attitudes, joints, missed):
    margins = state_margins(scenario, attitudes, joints, np.zeros(len(attitudes)))
    return (missed <= 1e-8) & (np.min(list(margins.values()), axis=0) >= -1e-9)


def around(direction, toward, turns):
    """Attitudes (k, 3, 3) that bring a direction in body axes to an inertial one, by turns about it."""
    first, _ = Rotation.align_vectors(toward[None], direction[None])
    return Rotation.from_rotvec(np.multiply.outer(turns, toward)).as_matrix() @ first.as_matrix()


def found_goals(scenario):
    start = scenario.start
    return decompose(
        scenario.spacecraft,
        start.attitude,
        scenario.goal,
        scenario.constraints,
        start_joints=start.joints,
    ).goals


def test_a_wish_met_at_the_end_of_a_range_leaves_the_next_one_as_near_as_it_can_be():
    """Where the first is met, a drive's angle and a turn about its boresight are free: a grid of both."""
    scenario = jp.random_scenario(627, "any_spacecraft")
    craft, (first, second) = scenario.spacecraft, scenario.goal.prefer
    (goal,) = found_goals(scenario)[:1]
    joint = own_joints(craft, first.device)
    low, high = craft.joint_ranges[joint[0]]
    assert goal.joints[joint] == pytest.approx(low, abs=1e-6)
    beam, eye = (goal.attitude @ in_body(craft, one.device, goal.joints[None])[0] for one in (first, second))
    assert angle(beam, first.direction) <= 1e-6
    least, centre, width = np.inf, np.array([(low + high) / 2, 0.0]), np.array([(high - low) / 2, np.pi])
    for _ in range(6):
        places, turns = (
            np.linspace(mid - half, mid + half, 121) for mid, half in zip(centre, width, strict=True)
        )
        for place in np.clip(places, low, high):
            rest = np.array(scenario.start.joints[None])
            rest[:, joint] = place
            attitudes = around(in_body(craft, first.device, rest)[0], first.direction, turns)
            joints, missed = standing(scenario, attitudes)
            joints[:, joint] = place
            off = angle(attitudes @ in_body(craft, second.device, rest)[0], second.direction)
            off = np.where(kept(scenario, attitudes, joints, missed), off, np.inf)
            if np.min(off) < least:
                least, centre = np.min(off), np.array([place, turns[np.argmin(off)]])
        width /= 20
    assert angle(eye, second.direction) <= least + 1e-6
    assert angle(eye, second.direction) == pytest.approx(least, abs=1e-4)


@pytest.mark.slow
def test_where_the_wish_breaks_what_a_joint_decides_on_the_nearest_goal_that_keeps_it_is_found():
    """An instrument has a target: a fine grid over the roll that is left. The other goals are far off."""
    scenario = jp.random_scenario(589, "any_spacecraft")
    craft, wish = scenario.spacecraft, scenario.goal.prefer[0]
    (still,) = [name for name in scenario.goal.devices if not own_joints(craft, name)]
    target = scenario.goal.directions[scenario.goal.devices.index(still)]
    boresight = in_body(craft, still, scenario.start.joints[None])[0]
    attitudes = around(boresight, target, np.arange(-np.pi, np.pi, SPACING))
    ranges = craft.joint_ranges[own_joints(craft, wish.device)]

    def off(attitudes):
        angles = pointed(craft, wish.device, wish.direction @ attitudes)
        return np.maximum(beyond(angles[..., 0], ranges[0]), beyond(angles[..., 1], ranges[1]))

    joints, missed = standing(scenario, attitudes)
    distances = off(attitudes)
    least = np.min(distances[kept(scenario, attitudes, joints, missed)])
    assert np.min(distances[missed <= 1e-8]) < least - 0.05
    goals = found_goals(scenario)
    states = np.stack([goal.attitude for goal in goals]), np.stack([goal.joints for goal in goals])
    keeping = kept(scenario, *states, np.zeros(len(goals)))
    first = int(np.argmax(keeping))
    assert keeping[first]
    assert least - SPACING < float(off(states[0])[first]) <= least + 1e-5


def test_a_goal_that_descents_from_the_covering_miss_is_found_from_the_attitude_that_breaks_least(
    monkeypatch,
):
    """With a wish and without: as if no point of the covering led to a goal."""
    scenario = jp.random_scenario(627, "any_spacecraft")
    expected = found_goals(scenario)[0]
    minima = multistart.minima

    def missed(caps, count, seed):
        return minima(caps, count, seed)[:0]

    monkeypatch.setattr(multistart, "minima", missed)
    for prefer in (scenario.goal.prefer, ()):
        scenario = replace(scenario, goal=replace(scenario.goal, prefer=prefer))
        goal = found_goals(scenario)[0]
        joints, off = standing(scenario, goal.attitude[None])
        assert kept(scenario, goal.attitude[None], joints, off)
        if not prefer:
            assert goal.slew_angle == pytest.approx(0, abs=1e-9)
        else:
            assert np.all(np.isclose(goal.attitude, expected.attitude, atol=0.1))
