from dataclasses import replace

import jax
import numpy as np
import pytest
from pointing import KINDS, Printed, Problem, random_problem
from quick import quick_jit
from reference import assert_each
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan import so3
from jaxplan.cases import paper_case
from jaxplan.goal import Decomposition, least_time
from jaxplan.goal.derivative import differentiable_goal
from jaxplan.goal.minimax import soonest_ends
from jaxplan.model.duration_bound import rest_bounds
from jaxplan.model.path import Goal
from jaxplan.planner.steps import find_goals, soonest_task
from jaxplan.trajectory import evaluate

SAMPLES = Rotation.random(20000, rng=np.random.default_rng(2)).as_matrix()


def seconds(problem: Problem, goals: list[Goal]) -> np.ndarray:
    """Strict bounds of the times to goals, from joints at zero."""
    turns = [Rotation.from_matrix(problem.start.T @ goal.attitude).as_rotvec() for goal in goals]
    return rest_bounds(problem.spacecraft, np.array(turns), np.array([goal.joints for goal in goals]))


def soonest(problem: Problem, **settings: float) -> Decomposition:
    return replace(problem, targets=replace(problem.targets, criterion="least_time")).decompose(**settings)


def drawn(problem: Problem) -> float:
    """The least time, s, of the random attitudes that meet all targets and zones, by plain numpy."""
    craft = problem.spacecraft
    count, limits, mounts = len(craft.terminals), problem.limits, problem.mounts
    attitudes = problem.start @ SAMPLES
    body = np.einsum("kj,nji->nki", problem.targets.directions, attitudes)
    azimuth = np.arctan2(body[..., 1], body[..., 0]) - mounts
    joints = np.concatenate(
        [np.arctan2(np.sin(azimuth), np.cos(azimuth)), np.arcsin(np.clip(body[..., 2], -1, 1))], axis=-1
    )
    met = np.all(np.abs(joints) <= limits, axis=-1)
    cones = problem.cones
    for group in np.unique(cones.group):
        held = np.zeros(len(attitudes), bool)
        for row in np.flatnonzero(cones.group == group):
            own = np.flatnonzero(cones.bound[row, count:])
            beams = (
                attitudes @ craft.fixed_boresights[own].T if len(own) else np.zeros((len(attitudes), 3, 0))
            )
            apart = np.arccos(np.clip(np.einsum("i,nik->nk", cones.axis[row], beams), -1, 1))
            held |= np.all(cones.side[row] * (apart - cones.half_angle[row]) >= 0, axis=-1)
        met &= held
    if not np.any(met):
        return np.inf
    turns = Rotation.from_matrix(SAMPLES[met]).as_rotvec()
    return float(np.min(rest_bounds(craft, turns, joints[met])))


@pytest.fixture(scope="module")
def solved() -> list[tuple[Problem, Decomposition, Decomposition]]:
    problems = [random_problem(seed) for seed in range(2 * len(KINDS))]
    return [(problem, problem.decompose(), soonest(problem)) for problem in problems]


def test_no_attitude_drawn_at_random_is_reached_sooner(solved):
    least = [(seconds(problem, [found.goals[0]])[0], drawn(problem)) for problem, _, found in solved]
    times, references = np.array(least).T
    assert np.sum(np.isfinite(references)) >= 15
    assert_each(times, "<=", 1.01 * references + 1e-9)


def test_goals_are_never_later_than_those_of_least_rotation(solved):
    gains = []
    for problem, nearest, found in solved:
        first, before = seconds(problem, [found.goals[0], nearest.goals[0]])
        assert first <= before * (1 + 1e-12)
        gains.append(1 - first / before if before > 0 else 0.0)
        assert_each(np.diff(seconds(problem, list(found.goals))), ">=", 0)
        assert found.slew_angle == nearest.slew_angle
    assert max(gains) > 0.3
    assert np.sum(np.array(gains) > 0.01) >= 8


def test_goals_of_least_time_meet_targets_and_zones(solved):
    for problem, _, found in solved:
        printed = Printed(problem)
        for goal in found.goals:
            eta = Rotation.from_matrix(problem.start.T @ goal.attitude).as_rotvec()
            assert_each(printed.margins(eta)[0], ">=", -1e-14)
            boresights = np.asarray(problem.spacecraft.boresights(goal.attitude, goal.joints))
            count = len(problem.spacecraft.terminals)
            np.testing.assert_allclose(boresights[:count], problem.targets.directions, atol=1e-14)


def test_the_goal_of_least_rotation_is_among_them(solved):
    for problem, nearest, found in solved:
        apart = [
            Rotation.from_matrix(nearest.goals[0].attitude.T @ g.attitude).magnitude() for g in found.goals
        ]
        assert min(apart) <= np.deg2rad(2)
        assert len(soonest(problem, max_goals=1).goals) == 1


def test_the_same_seed_gives_the_same_goals(solved):
    for problem, _, found in solved[:5]:
        again = soonest(problem)
        for one, two in zip(found.goals, again.goals, strict=True):
            np.testing.assert_array_equal(one.attitude, two.attitude)
        other = seconds(problem, [soonest(problem, seed=3).goals[0], found.goals[0]])
        assert other[0] == pytest.approx(other[1], rel=1e-3)


def test_the_bound_of_the_slew_holds(solved):
    for problem, nearest, _ in solved[:5]:
        most = nearest.slew_angle + 0.05
        assert_each([goal.slew_angle for goal in soonest(problem, max_slew=most).goals], "<=", most)


@pytest.mark.paper
@pytest.mark.parametrize("case", [1, 2, 3, 4])
def test_goals_of_the_paper_cases_leave_time(case):
    scenario = paper_case(case)
    still = scenario.start.attitude
    times = {}
    for word in ("least_rotation", "least_time"):
        goal = find_goals(replace(scenario, goal=replace(scenario.goal, criterion=word)))[0]
        turn = Rotation.from_matrix(still.T @ goal.attitude).as_rotvec()
        moves = (goal.joints - scenario.start.joints)[None]
        times[word] = rest_bounds(scenario.spacecraft, turn[None], moves)[0]
    assert times["least_rotation"] == pytest.approx([20.6, 25.2, 21.4, 24.6][case - 1], abs=0.06)
    assert times["least_time"] <= [18.6, 21.0, 18.9, 24.0][case - 1] + 0.06


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_derivatives_of_goals_of_least_time_are_those_of_differences(seed):
    problem = random_problem(seed)  # of the second one the joints are as slow as the platform
    targets = replace(problem.targets, criterion="least_time")
    craft, goal = problem.spacecraft, soonest(problem).goals[0]
    count = craft.joint_count

    def attitude(move: jax.Array) -> jax.Array:  # of the platform and joints at the start
        start, joints = problem.start @ so3.exp(move[:3]), move[3:]
        return differentiable_goal(goal, craft, start, targets, problem.cones, start_joints=joints).attitude

    def anew(move: np.ndarray) -> np.ndarray:
        start = problem.start @ np.asarray(so3.exp(move[:3]))
        return soonest(replace(problem, start=start), start_joints=move[3:]).goals[0].attitude

    way = np.random.default_rng(seed).normal(size=3 + count)
    with jax.enable_x64(True):
        there, slopes = quick_jit(lambda move: jax.jvp(attitude, (move,), (way,)))(0 * way)
    np.testing.assert_allclose(there, goal.attitude, atol=1e-9)
    differences = (anew(1e-5 * way) - anew(-1e-5 * way)) / 2e-5
    np.testing.assert_allclose(slopes, differences, atol=1e-6)
    assert np.max(np.abs(slopes)) > 0.1


@pytest.mark.slow
def test_a_goal_of_least_rotation_that_is_the_soonest_is_followed_as_such():
    scenario = jp.random_scenario(56, "keep_out")
    scenario = replace(scenario, goal=replace(scenario.goal, criterion="least_time"))
    plan = jp.plan(scenario)
    nearest = find_goals(replace(scenario, goal=replace(scenario.goal, criterion="least_rotation")))[0]
    np.testing.assert_array_equal(plan.goal.attitude, nearest.attitude)
    held = jp.hold(plan)
    assert held.criterion == "least_rotation"

    def turned(move: jax.Array) -> jp.Scenario:
        target = scenario.goal.directions @ so3.exp(move).T
        return replace(scenario, goal=replace(scenario.goal, directions=target))

    def end(move: jax.Array) -> jax.Array:
        trajectory = jp.replan(held, turned(move))
        return evaluate(trajectory, trajectory.breaks[-1]).attitude

    axis = np.array([0.6, 0.0, 0.8])
    with jax.enable_x64(True):
        _, slope = quick_jit(lambda move: jax.jvp(end, (move,), (axis,)))(np.zeros(3))
        ahead, behind = (find_goals(jax.tree.map(np.asarray, turned(s * 1e-5 * axis)))[0] for s in (1, -1))
    np.testing.assert_allclose(slope, (ahead.attitude - behind.attitude) / 2e-5, atol=2e-6)


def telescope(**goal: object) -> jp.Scenario:
    """A telescope with a target and limits that differ by axis, an array that prefers the sun."""
    craft = jp.Spacecraft(
        rate_limit=np.array([0.05, 0.05, 0.02]),
        acceleration_limit=0.02,
        instruments=(jp.Instrument(name="telescope", boresight=np.array([0.0, 0.0, 1.0])),),
        drives=(
            jp.Drive(
                name="array",
                axis=np.array([0.0, 1.0, 0.0]),
                boresight=np.array([1.0, 0.0, 0.0]),
                range=(-3.0, 3.0),
                rate_limit=0.02,
                acceleration_limit=0.01,
            ),
        ),
    )
    target = np.array([0.6, 0.0, -0.8])
    still = {"angular_velocity": np.zeros(3), "joint_rates": np.zeros(1)}
    return jp.Scenario(
        name="telescope",
        spacecraft=craft,
        start=jp.GivenState(rotation_vector=np.array([0.0, 0.0, 0.3]), joints=np.zeros(1), **still),
        goal=jp.Targets.of({"telescope": target}, **goal, **still),
        trajectory=jp.TrajectorySettings(duration="minimum"),
    )


def reached(scenario: jp.Scenario, goal: Goal) -> float:
    turn = Rotation.from_matrix(scenario.start.attitude.T @ goal.attitude).as_rotvec()
    moves = goal.joints - np.asarray(scenario.start.joints)
    return float(rest_bounds(scenario.spacecraft, turn[None], moves[None])[0])


def rolls(scenario: jp.Scenario, goal: Goal, count: int = 3600) -> np.ndarray:
    """All attitudes that see the target, by their roll about it."""
    about = scenario.goal.directions[0]
    every = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return Rotation.from_rotvec(every[:, None] * about).as_matrix() @ goal.attitude


def test_the_roll_of_an_instrument_is_the_soonest_of_all():
    scenario = telescope()
    goal = find_goals(scenario)[0]
    seen = goal.attitude @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(seen, scenario.goal.directions[0], atol=np.deg2rad(1e-6))
    turns = Rotation.from_matrix(scenario.start.attitude.T @ rolls(scenario, goal)).as_rotvec()
    every = rest_bounds(scenario.spacecraft, turns, np.zeros((len(turns), 1)))
    assert reached(scenario, goal) <= 1.01 * np.min(every)
    assert np.max(every) > 1.2 * np.min(every)


def test_wishes_come_before_the_time():
    sun = np.array([0.0, 0.6, 0.8])
    wish = (jp.Wish(device="array", direction=sun),)
    free, bound = telescope(), telescope(prefer=wish)
    one, other = find_goals(free)[0], find_goals(bound)[0]

    def off(attitudes: np.ndarray) -> np.ndarray:
        """How far the array is from the sun at best."""
        return np.abs(np.arcsin(np.clip(sun @ attitudes @ [0.0, 1.0, 0.0], -1, 1)))

    least = np.min(off(rolls(bound, other)))
    assert off(other.attitude) == pytest.approx(least, abs=1e-5)
    assert off(one.attitude) > least + 0.01
    nearest = find_goals(replace(bound, goal=replace(bound.goal, criterion="least_rotation")))[0]
    assert reached(bound, other) <= reached(bound, nearest) * (1 + 1e-6)


@pytest.mark.parametrize("prefer", [(), (jp.Wish(device="array", direction=[0.0, 0.6, 0.8]),)])
def test_what_is_compiled_ahead_is_what_finds_goals(monkeypatch, prefer):
    kinds = []

    def noted(*arguments):
        kinds.append(jax.tree.map(lambda leaf: (np.shape(leaf), np.asarray(leaf).dtype), arguments))
        return soonest_ends(*arguments)

    monkeypatch.setattr(least_time, "soonest_ends", noted)
    scenario = telescope(prefer=prefer)
    soonest_task(scenario, None)()
    assert len(kinds) == 1
    assert find_goals(scenario)
    assert len(kinds) > 1
    assert all(kind == kinds[0] for kind in kinds)
    assert (
        soonest_task(replace(scenario, goal=replace(scenario.goal, criterion="least_rotation")), None) is None
    )


def test_the_criterion_follows_from_the_duration():
    scenario = telescope()
    assert scenario.goal.criterion is None
    assert scenario.asked.criterion == "least_time"
    for duration in (60.0, "stretched"):
        given = replace(scenario, trajectory=replace(scenario.trajectory, duration=duration))
        assert given.asked.criterion == "least_rotation"
    named = replace(scenario, goal=replace(scenario.goal, criterion="least_rotation"))
    assert named.asked.criterion == "least_rotation"


def test_files_keep_the_criterion(tmp_path):
    scenario = telescope(criterion="least_time")
    jp.save_scenario(scenario, tmp_path / "scene.toml")
    assert 'criterion = "least_time"' in (tmp_path / "scene.toml").read_text()
    assert jp.load_scenario(tmp_path / "scene.toml").goal.criterion == "least_time"
    with pytest.raises(ValueError, match=r"criterion.*least_time"):
        jp.plan(telescope(criterion="fastest"))


@pytest.mark.slow
def test_all_reasons_why_slopes_are_refused_are_told_at_once():
    wish = jp.Wish(device="array", direction=[0.0, 0.6, 0.8])
    times = np.linspace(0.0, 600.0, 61)
    turning = np.array([0.0, 0.0, 1e-3])
    axis = Rotation.from_rotvec(np.outer(times, turning)).apply([0.0, -1.0, 0.0])
    drifting = jp.DirectionPath(times=times, samples=axis, slopes=np.cross(turning, axis))
    zone = jp.KeepOut(name="drifting", direction=drifting, half_angle=np.deg2rad(2.0))
    still, moving = telescope(prefer=(wish,)), replace(telescope(prefer=(wish,)), keep_out=(zone,))
    with pytest.raises(ValueError, match=r"no derivatives: .*one of least time with wishes"):
        jp.hold(jp.plan(still))
    plan = jp.plan(moving)
    with pytest.raises(
        ValueError, match=r"(?s)for 2 reasons:\n  1\. .*that move.*\n  2\. .*leave the wish out"
    ):
        jp.hold(plan)
    # What the message says that is enough.
    goal = plan.goal.state
    longer = replace(moving.trajectory, duration=1.05 * plan.trajectory.duration)
    jp.hold(jp.plan(replace(moving, goal=goal, trajectory=longer)))
