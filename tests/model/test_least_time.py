import numpy as np
import pytest
from builders import make_spacecraft

from jaxplan.model.least_time import duration_bound, shortest_time


def brute_force(distance, first, last, rate, acceleration):
    """The least time on a fine grid in which the distance lies between the least and the largest possible."""
    times = np.linspace(0, 12, 2401)[:, None]
    t = times * np.linspace(0, 1, 401)

    def farthest_way(v, w):
        speed = np.minimum(np.minimum(v + acceleration * t, w + acceleration * (times - t)), rate)
        return np.trapezoid(speed, t, axis=1)

    possible = np.abs(first - last) <= acceleration * times[:, 0] + 1e-9
    possible &= (farthest_way(first, last) >= distance - 1e-3) & (
        -farthest_way(-first, -last) <= distance + 1e-3
    )
    return times[np.argmax(possible), 0]


def test_the_shortest_time_is_that_of_brute_force():
    rng = np.random.default_rng(8)
    cases = rng.uniform([-3, -1, -1, 1, 0.5], [3, 1, 1, 2, 2], size=(25, 5))
    cases[:5, 1:3] = 0
    cases[5:8, 0] = 0
    cases[8:10, 2] = -cases[8:10, 1]
    for case in cases:
        assert shortest_time(*case) == pytest.approx(brute_force(*case), abs=0.03), case
    assert shortest_time(*np.array([0.0, 0, 0, 1, 1])) == 0
    assert shortest_time(*np.array([0.0, 0.5, 0.5, 1, 1])) == 0  # it is there already, at the right rate


def test_no_motion_needs_no_time_and_the_slowest_axis_sets_the_bound():
    craft, still = make_spacecraft(1), np.zeros((2, 3))
    attitudes, joints = np.repeat(np.eye(3)[None], 2, axis=0), np.zeros((2, 2))
    assert duration_bound(craft, attitudes, joints, still, joints).seconds == 0
    moved = np.array([[0, 0], [1.0, 0.1]])
    rate, acceleration = craft.joint_rate_limits[0], craft.joint_acceleration_limits[0]
    bound = duration_bound(craft, attitudes, moved, still, joints)
    assert bound.seconds == pytest.approx(1 / rate + rate / acceleration)
    assert bound.name == craft.joint_names[0]
