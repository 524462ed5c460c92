"""Plans that take about as long as a file may ask for."""

import re
from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario

import jaxplan as jp
from jaxplan.model.scenario import LONGEST_DURATION


def test_no_plan_is_longer_than_a_duration_may_be_and_the_message_names_the_limit(tmp_path):
    """One that is nearly as long is OK, and what is written of either can be read."""
    for method, duration in (("global", "minimum"), ("global", 100.0), ("paper", "stretched")):
        scenario = make_scenario(1)
        settings = replace(scenario.trajectory, method=method, duration=duration)
        for name, torque in (("weak", 1e-12), ("nearly", 0.2)):
            craft = replace(scenario.spacecraft, inertia=np.eye(3) * 1e12, torque_limit=np.full(3, torque))
            plan = jp.plan(replace(scenario, spacecraft=craft, trajectory=settings), throw=False)
            plan.save(tmp_path / f"{method} {duration} {name}.json")
            assert jp.load_plan(tmp_path / f"{method} {duration} {name}.json").message == plan.message
            if name == "weak":
                assert plan.status is jp.Status.LIMITS_TOO_TIGHT
                assert "within the limit of platform torque " in plan.message, plan.message
                assert "10,000,000 s" in plan.message
            elif duration == 100.0:
                assert float(re.search(r"duration_s to ([\d.]+)", plan.message)[1]) <= LONGEST_DURATION
            else:
                assert plan.ok, plan.message
                assert LONGEST_DURATION / 10 < plan.trajectory.duration <= LONGEST_DURATION
    longest = replace(scenario.trajectory, duration=LONGEST_DURATION)
    assert jp.plan(replace(scenario, trajectory=longest)).ok
    with pytest.raises(jp.ScenarioError, match="1e7"):
        jp.plan(replace(scenario, trajectory=replace(longest, duration=1.01 * LONGEST_DURATION)))
