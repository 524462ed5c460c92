"""Goals of step 1 for terminals of any mounting, drives and instruments, against brute force."""

import numpy as np
import pytest
from pointing_aims import (
    KINDS,
    conditions,
    contradicting,
    over_roll,
    pointing_errors,
    random_aims,
    slew_of,
    slsqp,
    with_tolerance,
)
from reference import angle, assert_each
from scipy.spatial.transform import Rotation

COUNT = 6 * len(KINDS)
TOLERANCE = np.deg2rad(1e-6)


@pytest.fixture(scope="module")
def solved():
    problems = [random_aims(seed) for seed in range(COUNT)]
    return [(kind, problem, problem.decompose()) for kind, problem in problems]


def test_goals_point_at_every_target_within_all_ranges_and_zones(solved):
    leant_on = np.zeros(2, int)
    for kind, problem, found in solved:
        assert found.goals, kind
        assert max(found.aim_excess, found.zone_excess) <= 1e-12
        ranges = problem.spacecraft.joint_ranges
        for goal in found.goals:
            errors = pointing_errors(problem, goal.attitude, goal.joints)
            assert_each(errors, "<=", TOLERANCE, kind)
            least, zero = conditions(problem, goal.attitude)
            assert_each(least, ">=", -1e-12, kind)
            assert_each(np.abs(zero), "<=", TOLERANCE, kind)
            assert_each(goal.joints, ">=", ranges[:, 0])
            assert_each(goal.joints, "<=", ranges[:, 1])
            assert goal.slew_angle == pytest.approx(slew_of(problem, goal.attitude), abs=1e-9)
            leant_on += [np.any(least < 1e-8), np.any(least > 1e-3)]
    assert_each(leant_on, ">", COUNT / 4)


def test_terminals_meet_their_targets_exactly(solved):
    for kind, problem, found in solved:
        for goal in found.goals:
            errors = pointing_errors(problem, goal.attitude, goal.joints)
            terminals = [name.startswith("terminal") for name in problem.targets.names(problem.spacecraft)]
            assert_each(errors[terminals], "<=", 1e-12, kind)


def test_goals_are_the_nearest_first(solved):
    for _, _, found in solved:
        slews = [goal.slew_angle for goal in found.goals]
        assert slews == sorted(slews)
        assert found.slew_angle == slews[0]


def test_no_turn_about_an_instrument_is_nearer(solved):
    kinds = ("an instrument", "an instrument and a terminal", "an instrument and two terminals")
    asked = [one for one in solved if one[0] in kinds]
    assert len(asked) == 3 * COUNT / len(KINDS)
    for kind, problem, found in asked:
        brute = over_roll(problem)
        assert found.goals[0].slew_angle <= brute + 1e-6, kind
        # a tolerance lets the goal be a hair nearer; a fine grid finds it
        assert found.goals[0].slew_angle >= brute - 1e-6, kind


@pytest.mark.slow
def test_no_solution_of_slsqp_is_nearer(solved):
    rng, reached, some = np.random.default_rng(4), 0, solved[: 2 * len(KINDS)]
    for kind, problem, found in some:
        brute = slsqp(problem, 12, rng)
        assert found.goals[0].slew_angle <= brute + 1e-6, kind
        reached += brute <= found.goals[0].slew_angle + 1e-5
    assert reached > 0.7 * len(some)


def test_no_random_attitude_is_nearer_where_there_are_only_ranges(solved):
    rng, possible = np.random.default_rng(5), 0
    for kind, problem, found in solved:
        if kind not in ("terminals", "one terminal"):
            continue
        for attitude in Rotation.random(500, rng=rng).as_matrix():
            if np.all(conditions(problem, attitude)[0] >= 0):
                assert slew_of(problem, attitude) >= found.goals[0].slew_angle - 1e-9
                possible += 1
    assert possible > 50


@pytest.mark.parametrize("tolerance", [1e-8, 1e-4])
def test_a_wider_tolerance_is_used_and_kept(tolerance):
    for seed in range(len(KINDS)):
        kind, problem = random_aims(seed)
        wide = with_tolerance(problem, tolerance).decompose(max_goals=1).goals[0]
        usual = problem.decompose(max_goals=1).goals[0]
        assert_each(pointing_errors(problem, wide.attitude, wide.joints), "<=", tolerance, kind)
        assert abs(wide.slew_angle - usual.slew_angle) <= 50 * max(tolerance, TOLERANCE)


def test_of_two_that_cannot_both_be_met_the_worst_is_told_with_how_far_it_is_off():
    for seed in range(5):
        problem = contradicting(seed)
        found = problem.decompose()
        assert found.goals == ()
        # an angle in the axes of one instrument; at best both are off by half of what is too much
        assert 0.01 < found.aim_excess <= 0.05 + 1e-6
        assert found.worst_aim[0] in (0, 1)
        errors = angle(
            problem.targets.directions[:, None],
            problem.targets.directions[None],
        )
        assert errors[0, 1] == pytest.approx(angle(*problem.spacecraft.fixed_boresights) + 0.1, abs=1e-9)


def test_of_angles_a_turn_apart_the_one_nearest_to_the_start_is_taken():
    for seed in (0, 1, 10, 20):
        kind, problem = random_aims(seed)
        craft = problem.spacecraft
        rng = np.random.default_rng(seed)
        for _ in range(3):
            start = rng.uniform(*craft.joint_ranges.T)
            goal = problem.decompose(start_joints=start, max_goals=1).goals[0]
            low, high = craft.joint_ranges.T
            for joint, own in enumerate(goal.joints):
                others = own + 2 * np.pi * np.arange(-3, 4)
                others = others[(others >= low[joint]) & (others <= high[joint])]
                if len(others) and not np.isclose(own, start[joint]):
                    nearest = np.min(np.abs(others - start[joint]))
                    assert abs(own - start[joint]) <= nearest + 1e-9, (kind, joint)
