"""What is told to change where a motion is not proved: what helps most first, with values that would do."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import jaxplan as jp
from jaxplan.certificate import Certificate
from jaxplan.planner.remedies import uncertified

LASTS = 80.0  # s
FAULT = Certificate(certified=False, faults=("odd",), evaluations=1000)


def advice(certificate: Certificate, scenario: jp.Scenario | None = None) -> list[str]:
    """What is told to change, one by one, after the faults."""
    told = uncertified(certificate, scenario or jp.paper_case(2), LASTS)
    assert told.startswith("odd: ")
    return told.removeprefix("odd: ").split("; or ")


def lost(time: float, margin: float = -0.01) -> Certificate:
    return replace(FAULT, min_margin=margin, worst_time=time, worst_zone="sun", worst_device="tracker")


def value(told: str, key: str) -> float:
    found = re.search(rf"{re.escape(key)} = ([\d.]+)", told)
    assert found is not None, told
    return float(found[1])


@pytest.mark.parametrize("margin", [-1e-8, -1e-4, -0.01])
@pytest.mark.parametrize("before", [0.0, 0.02])
def test_a_margin_lost_at_the_goal_asks_for_a_clearance_there_first_that_makes_up_for_it(margin, before):
    scenario = jp.paper_case(2)
    scenario = replace(scenario, goal=replace(scenario.goal, clearance=before))
    first, second, *_ = advice(lost(0.97 * LASTS, margin), scenario)
    assert math.radians(value(first, "goal.clearance_deg")) > before - margin
    assert "search.clearance_deg" in second


@pytest.mark.parametrize("time", [0.2, 0.5, 0.8])
def test_a_margin_lost_on_the_way_asks_for_clearance_of_the_path_and_not_of_the_goal(time):
    scenario = jp.paper_case(2)
    first, second = advice(lost(time * LASTS))
    assert math.radians(value(first, "search.clearance_deg")) > scenario.search.clearance + 0.01
    assert value(second, "search.attitude_step_rad") < scenario.search.attitude_step
    assert "goal." not in f"{first} {second}"


def test_a_zone_that_moves_may_be_elsewhere_at_another_time():
    scenario = jp.paper_case(2)
    way = jp.DirectionPath.through([0.0, 100.0], [[1.0, 0.0, 0.0], [0.98, np.sqrt(1 - 0.98**2), 0.0]])
    moving = replace(scenario, keep_out=(jp.KeepOut(name="sun", direction=way, half_angle=0.1),))
    assert "another trajectory.duration_s" in advice(lost(LASTS / 2), moving)[-1]
    assert not any("duration" in one for one in advice(lost(LASTS / 2), scenario))


def test_ends_that_are_given_states_have_no_clearance_and_are_to_move():
    given = jp.paper_case(2)
    given = replace(given, goal=given.start)
    assert advice(lost(LASTS), given)[0] == "move the state of [goal] by 1.2 deg away from zone sun"
    assert advice(lost(0.0), given)[0] == "move the state of [start] by 1.2 deg away from zone sun"


def test_a_goal_that_no_clearance_keeps_off_its_zone_is_to_change():
    assert advice(lost(LASTS, -1.0))[0] == "change goal.targets, which lie in zone sun"


@pytest.mark.parametrize(("name", "power"), [("angular_velocity", 1), ("joint_accelerations", 2)])
def test_a_load_asks_for_the_time_in_which_it_fits(name, power):
    (told,) = advice(replace(FAULT, peaks={"yaw": 0.9, name: 1.21}, min_margin=0.1))
    longer = value(told, "trajectory.duration_s") / LASTS
    assert 1.21 <= longer**power < 1.21 * 1.1


def test_a_load_that_no_duration_is_enough_for_asks_for_a_higher_limit():
    (told,) = advice(replace(FAULT, peaks={"joint_accelerations": 1e18}, min_margin=0.1))
    assert told == "raise the limit of joint accelerations"


def test_joints_beyond_their_range_ask_for_what_helps_where_they_are():
    fault = replace(FAULT, peaks={"yaw": 1.01, "angular_velocity": 0.9}, min_margin=0.1)
    ends, steps = advice(replace(fault, peak_times={"yaw": LASTS}))
    assert re.match(r"keep the yaw at the goal [\d.]+ deg farther inside its joint limits", ends)
    assert value(steps, "search.joint_step_rad") < jp.paper_case(2).search.joint_step
    (way,) = advice(replace(fault, peak_times={"yaw": LASTS / 2}))
    assert "search.joint_step_rad" in way


def test_numbers_that_are_none_are_no_advice():
    for odd in (lost(LASTS, math.nan), replace(FAULT, peaks={"torque": math.nan, "yaw": math.nan})):
        assert "nan" not in uncertified(odd, jp.paper_case(2), LASTS)


def test_what_no_setting_is_known_for_asks_for_another_try():
    scenario = jp.paper_case(2)
    scenario = replace(scenario, search=replace(scenario.search, seed=4))
    assert "try another search.seed, such as 5" in uncertified(FAULT, scenario, LASTS)


def test_a_zone_that_does_not_last_says_what_to_change_and_nothing_else_is():
    zone = jp.KeepOut(name="sun", direction=np.array([0.0, 0.0, 1.0]), half_angle=0.1, lasts=3.0)
    scenario = replace(jp.paper_case(2), keep_out=(zone,))
    fault = "zone sun is known for 3 s, and the motion takes 80 s: raise lasts_s, or sky.for_duration_s"
    assert uncertified(Certificate(certified=False, faults=(fault,)), scenario, LASTS) == fault


def test_what_is_wrong_with_the_form_of_a_claim_asks_for_no_other_try():
    fault = "the boresight of camera is no unit vector to 1e-06"
    assert uncertified(Certificate(certified=False, faults=(fault,)), jp.paper_case(2), LASTS) == fault
