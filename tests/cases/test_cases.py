"""The paper's cases as they ship, held against the published numbers."""

import math

import numpy as np
import pytest
from reference import assert_each

from jaxplan import so3
from jaxplan.cases import CASE_NAMES, case_path, paper_case
from jaxplan.model import constraints
from jaxplan.model.tabulation import tabulate
from jaxplan.schema import dump_scenario, load_scenario, parse_scenario

# Section 5: the published goals, equations (50) and (53).
GOALS = {
    1: ([0.4025, 1.3486, 1.4256], [0.6032, 1.5359, -0.2236, 0.0253, -0.1317, -0.1396]),
    2: ([1.9598, 1.2862, 1.8662], [-0.7386, 0.2610, -1.5359, -0.1394, -0.0092, 0.1396]),
    3: ([0.1547, -0.1803, 1.5131], [0.6137, 1.5359, -0.5119, -0.0080, 0.1017, -0.2269]),
    4: ([0.5993, 2.1165, 1.2377], [0.5054, 1.5359, -0.3006, 0.0717, -0.2269, -0.0151]),
}
# Table 2: half angles of CZ1 to CZ5, deg; Table 3: steps and weights.
HALF_ANGLES = {
    1: {"CZ1": 21, "CZ2": 27, "CZ3": 15, "CZ4": 15},
    2: {"CZ1": 21, "CZ2": 25, "CZ3": 20, "CZ4": 20},
    3: {"CZ2": 15, "CZ3": 16, "CZ4": 18, "CZ5": 15},
    4: {"CZ2": 18, "CZ3": 23, "CZ4": 28, "CZ5": 15},
}
STEPS = {1: (0.1, 0.1, 8, 2), 2: (0.12, 0.13, 6, 2), 3: (0.09, 0.1, 8, 3), 4: (0.14, 0.12, 8, 2)}
numbers = pytest.mark.parametrize("number", [1, 2, 3, 4])


@pytest.mark.paper
@numbers
def test_zones_steps_and_limits_are_those_of_the_tables(number):
    case = paper_case(number)
    angles = {zone.name: math.degrees(zone.half_angle) for zone in (*case.keep_out, *case.keep_in)}
    assert angles == pytest.approx(HALF_ANGLES[number])
    search, trajectory = case.search, case.trajectory
    steps = (search.joint_step, search.attitude_step, search.heuristic_weight, search.anchor_weight)
    assert steps == STEPS[number]
    assert (trajectory.duration, trajectory.segments, trajectory.order) == (80, 3, 12)
    assert (trajectory.rate_weight, trajectory.acceleration_weight) == (1, 3)
    # equation (51)
    assert case.spacecraft.rate_limit == pytest.approx(0.0524, abs=5e-5)
    assert case.spacecraft.acceleration_limit == pytest.approx(0.0349, abs=5e-5)
    np.testing.assert_allclose(case.spacecraft.joint_rate_limits, 0.0698, atol=5e-5)
    np.testing.assert_allclose(case.spacecraft.joint_acceleration_limits, 0.0524, atol=5e-5)
    # Table 1
    np.testing.assert_allclose(np.rad2deg(case.spacecraft.joint_ranges[:, 1]), [90] * 3 + [15] * 3)


@pytest.mark.paper
@numbers
def test_the_published_goal_points_at_the_targets_within_the_goal_limits(number):
    case = paper_case(number)
    rotation_vector, joints = map(np.array, GOALS[number])
    boresights = case.spacecraft.boresights(so3.exp(rotation_vector), joints)
    np.testing.assert_allclose(boresights, case.goal.directions, atol=5e-4)
    assert_each(np.abs(joints[:3]), "<=", case.goal.yaw_limit + 5e-5)
    assert_each(np.abs(joints[3:]), "<=", case.goal.pitch_limit + 5e-5)
    # the tighter limits are active: this is how they were found
    assert np.max(np.abs(joints[:3])) == pytest.approx(case.goal.yaw_limit, abs=5e-5)
    assert np.max(np.abs(joints[3:])) == pytest.approx(case.goal.pitch_limit, abs=5e-5)


@pytest.mark.paper
@numbers
def test_start_and_published_goal_are_clear_of_all_zones(number):
    case = paper_case(number)
    cones = tabulate(case.keep_out, case.keep_in, case.spacecraft)
    goal_vector, goal_joints = map(np.array, GOALS[number])
    for vector, joints in ((case.start.rotation_vector, case.start.joints), (goal_vector, goal_joints)):
        boresights = case.spacecraft.boresights(so3.exp(vector), joints)
        margins = np.asarray(
            constraints.constraint_margins(cones, constraints.pair_margins(cones, boresights, cones.axis))
        )
        assert_each(margins, ">=", 0)
        assert np.sum(np.isfinite(margins)) == 4
        assert_each(np.abs(joints), "<=", case.spacecraft.joint_ranges[:, 1])


def test_terminal_1_takes_half_steps_where_it_is_kept_in():
    for number in (1, 2, 3, 4):
        case = paper_case(number)
        kept_in = {name for zone in case.keep_in for name in zone.devices}
        assert kept_in == ({"terminal-1"} if number > 2 else set())
        assert case.search.terminal_step_scale == dict.fromkeys(kept_in, 0.5)
        bound = {zone.devices for zone in case.keep_out}
        assert bound == ({("terminal-2", "terminal-3")} if number > 2 else {()})


@pytest.mark.parametrize("name", CASE_NAMES)
def test_a_case_is_a_file_that_survives_writing(name):
    case = load_scenario(case_path(name))
    assert case.name == name.replace("-", " ")
    text = dump_scenario(case)
    assert dump_scenario(parse_scenario(text)) == text


def test_an_unknown_case_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match=r"number = 5: must be 1, 2, 3 or 4"):
        paper_case(5)
    with pytest.raises(ValueError, match=r"name = 'case-5': must be one of case-1, case-2, case-3, case-4"):
        case_path("case-5")
    with pytest.raises(ValueError, match="must be one of"):
        case_path("../cases/case-1")
