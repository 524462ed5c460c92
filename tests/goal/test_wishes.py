"""Wishes of random spacecraft that were once left without a goal by them."""

import numpy as np
import pytest
from reference import angle, assert_each, in_body, state_margins

from jaxplan.cases import any_spacecraft
from jaxplan.goal import decompose


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
