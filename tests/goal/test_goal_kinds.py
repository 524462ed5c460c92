"""Goals of step 1 beside constraints of every kind, against plain numpy, scipy and random attitudes."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario
from pointing import make_problem
from pointing_kinds import random_kinds, row_margins, slsqp, table, worst_margin
from reference import assert_each, random_units, state_margins
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.goal import tracking_rates
from jaxplan.goal.caps import GoalProblem, leaves_open
from jaxplan.model.breaches import constraint_breaches
from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT
from jaxplan.model.scenario import Scenario
from jaxplan.model.zones import FixedVector, KeepIn, KeepOut
from jaxplan.planner import messages
from jaxplan.planner.steps import find_goals

START = Rotation.from_rotvec([0.4, -0.2, 0.7]).as_matrix()
BORESIGHT, AXIS = np.array([0.0, 0.6, 0.8]), np.array([[1.0, 0.0, 0.0]])


def free_problem(**settings):
    """Two terminals, an instrument and an axis of the body, and nothing that they must keep out of."""
    directions = START @ np.array([[0.8, 0.6, 0.0], [0.0, -0.8, 0.6]]).T
    mounts = np.array([0.3, -2.0])
    return make_problem(START, directions.T, mounts, np.pi, 1.5, boresights=(BORESIGHT,), **settings)


def with_rows(problem, *rows, **carried):
    """The problem with rows, each a constraint by itself if it says nothing else."""
    return replace(problem, cones=table([dict(row) for row in rows], AXIS, size=8, **carried))


def goal_problem(problem):
    return GoalProblem.of(problem.spacecraft, problem.start, problem.targets, problem.cones)


@pytest.fixture(scope="module")
def solved():
    problems = [random_kinds(seed) for seed in range(40)]
    return [(problem, problem.decompose()) for problem in problems]


def test_problems_with_a_solution_have_goals_that_meet_every_constraint(solved):
    leant_on = set()
    for problem, found in solved:
        assert found.goals
        assert max(found.aim_excess, found.zone_excess) <= 0
        for goal in found.goals:
            assert worst_margin(problem, goal.attitude[None])[0] >= -1e-14
            table = row_margins(problem, goal.attitude[None])[0]
            leant_on |= {int(problem.cones.frame[row]) for row in np.argwhere(np.abs(table) < 1e-9)[:, 0]}
    assert leant_on == {INERTIAL, BODY, SIGHT, JOINTS}


def test_no_random_attitude_is_nearer_than_the_goal(solved):
    rng, possible = np.random.default_rng(8), 0
    for problem, found in solved:
        nearest = found.goals[0].slew_angle
        turns = random_units(rng, 4000) * (nearest * rng.random((4000, 1)) ** (1 / 3))
        attitudes = problem.start @ Rotation.from_rotvec(turns).as_matrix()
        nearer = np.linalg.norm(turns, axis=1) < nearest - 1e-9
        np.testing.assert_array_equal(nearer & (worst_margin(problem, attitudes) >= 0), False)
        everywhere = problem.start @ Rotation.random(4000, rng=rng).as_matrix()
        possible += np.any(worst_margin(problem, everywhere) >= 0)
    assert possible >= len(solved) / 2  # what is tried can hold at all


@pytest.mark.slow
def test_no_slsqp_run_finds_a_nearer_goal(solved):
    references = []
    for number, (problem, found) in enumerate(solved[:12]):
        references.append(slsqp(problem, 3, np.random.default_rng(number)))
        assert found.goals[0].slew_angle <= references[-1] + 1e-7
    assert np.sum(np.isfinite(references)) >= 7


def test_what_the_targets_or_the_body_settle_changes_no_goal():
    """Both directions known: of two terminals, of an instrument and an axis of the body."""
    free = free_problem().decompose().goals[0]
    apart = np.arccos(np.prod([[0.6, -0.8]]))
    beams = {"frame": SIGHT, "partner": 0, "bound": [1]}
    body = {"frame": BODY, "axis": AXIS[0], "bound": [2]}
    for row in (beams, body, beams | {"side": -1.0}, body | {"half_angle": 3.0}):
        problem = with_rows(free_problem(), row)
        found = problem.decompose()
        np.testing.assert_array_equal(found.goals[0].attitude, free.attitude)
        assert found.worst_zone is None
    margin = row_margins(with_rows(free_problem(), beams), free.attitude[None])[0, 0, 1]
    np.testing.assert_allclose(margin, apart - 0.5, atol=1e-12)


@pytest.mark.parametrize("met", [True, False])
def test_a_settled_row_of_an_entry_leaves_the_others_or_rules_the_entry_out(met):
    """Of two entries the first asks for little of the attitude, and of the angle between two targets."""
    sun = START @ BORESIGHT
    beams = {"frame": SIGHT, "partner": 0, "bound": [1], "half_angle": 0.5, "side": 1.0 if met else -1.0}
    near = {"axis": sun, "half_angle": 0.3, "bound": [2], "group": 0}
    far = {"axis": sun, "half_angle": 0.7, "bound": [2], "entry": 2, "group": 0}
    problem = with_rows(free_problem(), near | {"entry": 0}, beams | {"entry": 0, "group": 0}, far)
    found = problem.decompose()
    np.testing.assert_allclose(found.slew_angle, 0.3 if met else 0.7, atol=1e-10)
    assert found.worst_zone == (0 if met else 2)


@pytest.mark.parametrize(("limit", "bound"), [(np.pi, 0.4), (np.pi, -2.0), (1.2, -0.4), (2.5, -1.0)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_bound_of_a_yaw_is_kept_on_all_of_its_side(limit, bound, sign):
    """Also beyond the other side of the plane through the bound."""
    row = {"frame": JOINTS, "axis": np.array([sign, 0.0, 0.0]), "half_angle": bound, "bound": [0]}
    cones = with_rows(free_problem(), row).cones
    cones = replace(cones, bound=cones.bound[:, :1], body=np.zeros((0, 3)))
    for yaw in np.linspace(-limit, limit, 15)[1:-1]:
        toward = START @ np.array([np.cos(0.3 + yaw), np.sin(0.3 + yaw), 0.0])
        problem = make_problem(START, toward[None], np.array([0.3]), limit, 0.5)
        goal = replace(problem, cones=cones).decompose().goals[0]
        assert sign * goal.joints[0] >= bound - 1e-12
        ways = [bound - sign * yaw, np.pi + sign * yaw if limit == np.pi else np.inf]  # also round the back
        wanted = max(0.0, min(ways))
        assert goal.slew_angle <= wanted + 1e-9
        if wanted <= np.pi / 2:
            np.testing.assert_allclose(goal.slew_angle, wanted, atol=1e-9)


def test_rows_that_contradict_each_other_say_by_how_much_and_for_which_sight():
    sun = START @ AXIS[0]
    out = {"axis": sun, "half_angle": 0.5, "bound": [3]}
    inside = {"axis": sun, "half_angle": 0.3, "bound": [3], "side": -1.0}
    found = with_rows(free_problem(), out, inside).decompose()
    assert found.goals == ()
    np.testing.assert_allclose(found.zone_excess, 0.1, atol=1e-6)
    assert found.worst_zone in (0, 1)
    assert found.worst_device == 3


def test_only_rows_that_need_the_joints_are_left_open():
    carried = {"carrier": np.array([1]), "carried": np.array([[0.0, 1.0, 0.0]])}
    open_ = [
        {"frame": JOINTS, "axis": np.array([0.6, 0.8, 0.0]), "bound": [0]},
        {"frame": BODY, "bound": [4]},
        {"frame": SIGHT, "partner": 4, "bound": [0]},
    ]
    for row in open_:
        problem = with_rows(free_problem(), row, **carried)
        assert leaves_open(goal_problem(problem))
        free = free_problem().decompose().goals[0]
        np.testing.assert_array_equal(problem.decompose().goals[0].attitude, free.attitude)
    for seed in range(10):
        problem = random_kinds(seed)
        assert not leaves_open(goal_problem(problem))


def stated(monkeypatch, problem, **search):
    """A scenario of the problem, whose zones are read as the problem's rows."""
    names, axis = [f"row-{number}" for number in range(16)], (FixedVector(along=AXIS[0]),)
    zones = tuple(
        KeepOut(name=name, direction=AXIS[0], half_angle=0.1, vectors=() if number else axis)
        for number, name in enumerate(names)
    )
    scenario = make_scenario(1, keep_out=zones)
    start = replace(
        scenario.start,
        rotation_vector=Rotation.from_matrix(problem.start).as_rotvec(),
        joints=np.zeros(4),
        joint_rates=np.zeros(4),
    )
    settings = replace(scenario.search, **search)
    monkeypatch.setattr(Scenario, "constraints", problem.cones)
    return replace(
        scenario, spacecraft=problem.spacecraft, start=start, goal=problem.targets, search=settings
    )


def test_goals_whose_joints_break_a_row_are_dropped_for_the_next(monkeypatch):
    """A mask that leans in yaw and pitch forbids the nearest goals of a problem of many."""
    rng = np.random.default_rng(2)
    free = make_problem(START, random_units(rng, 2), np.array([0.3, -2.0]), 1.0, 0.6, boresights=(BORESIGHT,))
    every = free.decompose(max_goals=8).goals
    assert len(every) >= 3
    values = [np.array([0.6, 0.8]) @ goal.joints[[0, 2]] for goal in every]
    keeps = int(np.argmax(values))
    assert keeps > 0
    row = {
        "frame": JOINTS,
        "axis": np.array([0.6, 0.8, 0.0]),
        "bound": [0],
        "half_angle": values[keeps] - 1e-3,
    }
    problem = with_rows(free, row)
    found = find_goals(stated(monkeypatch, problem, max_goals=1))
    assert len(found) == 1
    np.testing.assert_allclose(found[0].attitude, every[keeps].attitude, atol=1e-9)
    none = with_rows(free, row | {"half_angle": 2.0})
    plan = find_goals(stated(monkeypatch, none))
    assert plan.status is jp.Status.INVALID_GOAL
    assert "beyond joint bound row-0" in plan.message


def test_targets_out_of_reach_beside_an_axis_of_the_body_name_it(monkeypatch):
    sun = START @ AXIS[0]
    out = {"axis": sun, "half_angle": 0.5, "bound": [3]}
    inside = {"axis": sun, "half_angle": 0.3, "bound": [3], "side": -1.0}
    plan = find_goals(stated(monkeypatch, with_rows(free_problem(), out, inside)))
    assert plan.status is jp.Status.GOAL_UNREACHABLE
    assert "axis (1, 0, 0) of the body breaks zone row-" in plan.message
    assert messages.when(stated(monkeypatch, free_problem()), 0.0) == ""


WORDS = {
    "t0 is 28.65 deg inside keep-out zone one": {"frame": INERTIAL, "bound": [0]},
    "axis (1, 0, 0) of the body is 28.65 deg outside keep-in zone one": {"bound": [3], "side": -1.0},
    "t1 is 28.65 deg inside keep-out cone one, about axis (0, 0, 1) of the body": {
        "frame": BODY,
        "bound": [1],
    },
    "t1 is 28.65 deg inside keep-out cone one, about the beam of t0": {"frame": SIGHT, "bound": [1]},
    "i0 is 28.65 deg outside keep-in cone one, about axis (1, 0, 0) of the body": {
        "frame": SIGHT,
        "partner": 3,
        "bound": [2],
        "side": -1.0,
    },
    "t0 is 28.65 deg beyond joint bound one": {
        "frame": JOINTS,
        "axis": np.array([0.6, 0.8, 0.0]),
        "bound": [0],
    },
    "direction (0, 1, 0) of t1 is 28.65 deg inside keep-out zone one": {"bound": [4]},
}


@pytest.mark.parametrize("words", WORDS)
def test_a_broken_row_is_told_in_words_of_its_kind(words):
    carried = {"carrier": np.array([1]), "carried": np.array([[0.0, 1.0, 0.0]])}
    goal = free_problem().decompose().goals[0]
    joints = goal.joints

    def told(margin, *others):
        row = WORDS[words] | {"half_angle": 0.0}
        bare = with_rows(free_problem(), row, **carried)
        now = row_margins(bare, goal.attitude[None])[0, 0].min()
        row["half_angle"] = row.get("side", 1.0) * (now - margin)
        found = with_rows(free_problem(), row | {"entry": 0, "group": 0}, *others, **carried)
        group = "all" if others else None
        zones = [
            (KeepIn if own.get("side") == -1 else KeepOut)(name=name, half_angle=1.0, any_of=group)
            for name, own in zip(("one", "two"), (row, *others), strict=False)
        ]
        names = ["t0", "t1", "i0", "axis (1, 0, 0) of the body", "direction (0, 1, 0) of t1"]
        return list(constraint_breaches(found.cones, found.spacecraft, goal.attitude, joints, zones, names))

    assert told(1e-6) == []
    assert told(-0.5) == [words]
    worse = {"bound": [2], "axis": goal.attitude @ BORESIGHT, "half_angle": 1.0, "entry": 1, "group": 0}
    (of_group,) = told(-0.5, worse)
    assert "one, the nearest of group all" in of_group
    assert told(-0.5, worse | {"half_angle": 0.0}) == []
    (of_entry,) = told(-0.5, worse | {"entry": 0})  # both rows must hold, and the second is broken more
    assert of_entry == "i0 is 57.3 deg inside keep-out zone two, the nearest of group all"


def test_every_sight_has_a_name():
    vectors = FixedVector(along=AXIS[0]), FixedVector(along=np.array([0.0, 0.6, -0.8]), to="t1")
    scenario = replace(
        make_scenario(1),
        spacecraft=free_problem().spacecraft,
        keep_in=(KeepIn(name="sun", direction=AXIS[0], half_angle=1.0, vectors=vectors),),
    )
    names = ("t0", "t1", "i0", "axis (1, 0, 0) of the body", "direction (0, 0.6, -0.8) of t1")
    assert scenario.sight_names == names


@pytest.mark.parametrize(
    "row", [{"frame": BODY, "axis": BORESIGHT, "bound": [0]}, {"frame": SIGHT, "partner": 1, "bound": [2]}]
)
def test_tracking_follows_targets_beside_rows_of_the_body(row):
    """A goal that leans on a row of the body, while the targets move: differences of goals found anew."""
    free = make_problem(
        START,
        random_units(np.random.default_rng(4), 2),
        np.array([0.3, -2.0]),
        2.5,
        1.2,
        boresights=(BORESIGHT,),
    )
    bare = with_rows(free, row | {"half_angle": 0.0})
    nearest = free.decompose(max_goals=1).goals[0]
    angle = row_margins(bare, nearest.attitude[None])[0, 0].min()
    problem = with_rows(free, row | {"half_angle": angle + 0.1})
    directions, turning = problem.targets.directions, np.array([[0.2, -0.1, 0.3], [0.1, 0.4, 0.0]])

    def at(time):
        moved = Rotation.from_rotvec(turning * time).apply(directions)
        return replace(problem, targets=replace(problem.targets, directions=moved))

    goal = problem.decompose(max_goals=1).goals[0]
    assert abs(row_margins(problem, goal.attitude[None])[0, 0].min()) < 1e-9
    spin, rates = tracking_rates(
        goal,
        problem.spacecraft,
        problem.start,
        problem.targets,
        problem.cones,
        start_joints=np.zeros(4),
        target_rates=np.cross(turning, directions),
        axis_rates=np.zeros((8, 3)),
    )
    step = 1e-4
    before, after = (at(time).decompose(max_goals=1).goals[0] for time in (-step, step))
    turned = Rotation.from_matrix(before.attitude.T @ after.attitude).as_rotvec()
    np.testing.assert_allclose(spin, turned / (2 * step), atol=1e-6)
    np.testing.assert_allclose(rates, (after.joints - before.joints) / (2 * step), atol=1e-6)


@pytest.fixture(scope="module")
def moved():
    """Scenes whose nearest goal of step 1 breaks what it leaves open, and all goals that are found."""
    scenes = [jp.random_scenario(seed, "moved_goals") for seed in range(12)]
    return [(scene, find_goals(scene)) for scene in scenes]


def stated_margin(scene, attitudes, joints):
    """(k,) rad, the least of states to the zones as they are stated."""
    found = state_margins(scene, attitudes, joints, np.zeros(len(joints)))
    return np.min(list(found.values()), axis=0)


def test_goals_are_found_beside_what_step_1_leaves_open(moved):
    for scene, goals in moved:
        assert isinstance(goals, tuple)
        slews = [goal.slew_angle for goal in goals]
        assert slews == sorted(slews)
        for goal in goals:
            seen = scene.spacecraft.boresights(goal.attitude, goal.joints)
            np.testing.assert_allclose(seen, scene.goal.directions, atol=1e-12)
            limits = np.repeat([scene.goal.yaw_limit, scene.goal.pitch_limit], 3)
            assert_each(np.abs(goal.joints), "<=", limits)
            assert stated_margin(scene, goal.attitude[None], goal.joints[None])[0] >= 0


def test_no_attitude_around_such_a_goal_is_nearer_to_the_start(moved):
    rng, near = np.random.default_rng(3), 0
    for scene, goals in moved:
        craft, goal = scene.spacecraft, goals[0]
        turns = 0.02 * random_units(rng, 3000) * rng.random((3000, 1))
        attitudes = goal.attitude @ Rotation.from_rotvec(turns).as_matrix()
        joints = craft.joints_toward(attitudes, scene.goal.directions)
        limits = np.repeat([scene.goal.yaw_limit, scene.goal.pitch_limit], 3)
        kept = np.all(np.abs(joints) <= limits, axis=1) & (stated_margin(scene, attitudes, joints) >= 0)
        turned = Rotation.from_matrix(scene.start.attitude.T @ attitudes).magnitude()
        assert_each(turned[kept], ">=", goal.slew_angle - 5e-4)
        near += np.sum(kept)
    assert near > 1000


def test_where_nothing_holds_the_goal_is_invalid(moved):
    scene, _ = moved[0]
    bounds = [
        jp.JointBound(name=name, device="terminal-1", normal=[sign * 0.6, sign * 0.8], least=0.1)
        for name, sign in (("up", 1), ("down", -1))
    ]
    found = find_goals(replace(scene, joint_bounds=bounds))
    assert found.status is jp.Status.INVALID_GOAL
    assert "terminal-1" in found.message


@pytest.mark.slow
def test_a_plan_whose_goal_leans_on_what_step_1_leaves_open_is_not_held(moved):
    scene, (goal, *_) = moved[0]
    assert stated_margin(scene, goal.attitude[None], goal.joints[None])[0] < 1e-4
    plan = jp.plan(scene)
    assert plan.ok
    with pytest.raises(ValueError, match="leans on a bound of joints, a vector that these turn"):
        jp.hold(plan)
