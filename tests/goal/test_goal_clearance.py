"""Goals with a clearance from zones, and goals beside masks and fields of view."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import make_scenario
from pointing import KINDS, random_problem
from quick import quick_jit
from reference import state_margins
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.goal.derivative import differentiable_goal
from jaxplan.model.constraints import constraint_margins
from jaxplan.model.constraints import state_margins as margins_of
from jaxplan.model.scores import room
from jaxplan.planner.steps import find_goals

CLEARANCE = 0.02
SEEDS = [KINDS.index("star trackers") + len(KINDS) * number for number in range(12)]


def at_rest_toward(directions):
    return jp.Targets(
        directions=directions, angular_velocity=np.zeros(3), joint_rates=np.zeros(2 * len(directions))
    )


def with_clearance(problem, clearance):
    return replace(problem, targets=replace(problem.targets, clearance=clearance))


def least(problem, goal):
    """(Z,) rad, margins of all rows at a goal."""
    craft, rows = problem.spacecraft, problem.cones
    sights = rows.sights(craft.gimbals, craft.fixed_boresights)
    return constraint_margins(rows, margins_of(rows, sights, goal.attitude, goal.joints))


def test_goals_keep_the_clearance_and_lean_on_it_where_they_leant_on_a_zone():
    leant = 0
    for seed in SEEDS:
        problem = random_problem(seed)
        plain, wider = (with_clearance(problem, value).decompose().goals for value in (0.0, CLEARANCE))
        assert plain
        if not wider:
            continue
        wanted = np.minimum(CLEARANCE, room(problem.cones))
        single = problem.cones.single & np.any(problem.cones.bound, axis=1)
        for goal in wider:
            assert np.all(least(problem, goal)[single] >= wanted[single] - 1e-9)
        assert wider[0].slew_angle >= plain[0].slew_angle - 1e-9
        before = np.min(least(problem, plain[0]))
        if abs(before) < 1e-9:
            leant += 1
            assert np.min(least(problem, wider[0]) - wanted) == pytest.approx(0, abs=1e-9)
    assert leant >= 3


@pytest.mark.slow
def test_slews_have_derivatives_by_clearance_and_half_angles():
    tried = 0
    for seed in SEEDS:
        problem = with_clearance(random_problem(seed), CLEARANCE)
        found = problem.decompose().goals
        if not found or abs(np.min(least(problem, found[0]) - CLEARANCE)) > 1e-9:
            continue

        def slew(clearance, wider, problem=problem, goal=found[0]):
            cones = replace(problem.cones, half_angle=problem.cones.half_angle + wider)
            targets = replace(problem.targets, clearance=clearance)
            return differentiable_goal(goal, problem.spacecraft, problem.start, targets, cones).slew_angle

        with jax.enable_x64(True):
            told = quick_jit(jax.grad(slew, argnums=(0, 1)))(CLEARANCE, 0.0)
        for number, step in enumerate(np.eye(2) * 1e-4):
            ends = []
            for sign in (1, -1):
                clearance, wider = np.array([CLEARANCE, 0.0]) + sign * step
                cones = replace(problem.cones, half_angle=problem.cones.half_angle + wider)
                ends.append(with_clearance(replace(problem, cones=cones), clearance).decompose().goals[0])
            expected = (ends[0].slew_angle - ends[1].slew_angle) / 2e-4
            assert float(told[number]) == pytest.approx(expected, abs=1e-6)
        assert abs(float(told[0])) > 1e-3
        tried += 1
    assert tried >= 3


def test_a_goal_that_cannot_have_the_clearance_says_so():
    """No direction is 58 deg away from three that are at right angles and from their opposites."""
    scene = make_scenario(1, 1)
    axes = [sign * axis for axis in np.eye(3) for sign in (1, -1)]
    keep_out = tuple(
        jp.KeepOut(name=f"z{i}", direction=axis, half_angle=np.deg2rad(50), devices=("camera-1",))
        for i, axis in enumerate(axes)
    )
    target = at_rest_toward(Rotation.from_rotvec([0, 0.3, 0.2]).apply([[1.0, 0, 0]]))
    plain = find_goals(replace(scene, keep_out=keep_out, goal=target))
    assert isinstance(plain, tuple)
    plan = find_goals(replace(scene, keep_out=keep_out, goal=replace(target, clearance=np.deg2rad(8))))
    assert plan.status is jp.Status.GOAL_UNREACHABLE
    assert "or lower goal.clearance_deg = 8, which counts" in plan.message


MASKS = np.deg2rad([[[-60.0, -20], [-5, -20], [-5, -1], [-60, -1]], [[5, -20], [60, -20], [60, -1], [5, -1]]])


@pytest.mark.slow
@pytest.mark.parametrize("way", [1, -1])
def test_no_goal_is_on_a_mask_or_too_close_to_a_field(way):
    """Where the nearest goal without masks and fields breaks one, what is found instead breaks none."""
    found = tried = 0
    for seed in range(30):
        scene = make_scenario(2, 1, seed=seed)
        camera = replace(
            scene.spacecraft.instruments[0],
            boresight=np.array([0.0, 0, 1]),
            up=np.array([1.0, 0, 0]),
            field_of_view=np.deg2rad([20.0, 10.0]),
        )
        free = replace(scene.spacecraft, instruments=(camera,))
        turned = Rotation.from_rotvec(scene.goal.rotation_vector).apply(
            free.boresights(np.eye(3), scene.goal.joints)[:2]
        )
        scene = replace(scene, spacecraft=free, goal=at_rest_toward(turned))
        nearest = find_goals(scene)[0]
        sun = jp.KeepOut(
            name="sun",
            direction=nearest.attitude @ [0.02, 0.1, 1] / np.linalg.norm([0.02, 0.1, 1]),
            half_angle=0.1,
            outside="field_of_view",
            devices=("camera-1",),
        )
        terminals = tuple(replace(one, mask=tuple(MASKS[:, ::way])) for one in free.terminals)
        whole = replace(scene, spacecraft=replace(free, terminals=terminals), keep_out=(sun,))
        state = nearest.attitude[None], nearest.joints[None], np.zeros(1)
        if np.min(list(state_margins(whole, *state).values())) > 0:
            continue
        tried += 1
        goals = find_goals(whole)
        if isinstance(goals, jp.Plan):
            assert goals.status in (jp.Status.INVALID_GOAL, jp.Status.GOAL_UNREACHABLE)
            continue
        found += 1
        for goal in goals:
            own = state_margins(whole, goal.attitude[None], goal.joints[None], np.zeros(1))
            assert min(map(float, np.ravel(list(own.values())))) >= -1e-9
            np.testing.assert_allclose(
                free.boresights(goal.attitude, goal.joints)[:2], scene.goal.directions, atol=1e-9
            )
    assert tried >= 15
    assert found >= 0.6 * tried
