"""Parts that fail while a plan is made: whatever solver or search answer, no false plan comes out."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg.lapack
from reference import assert_each
from scipy.spatial.transform import Rotation
from trust.long_run import examine

import jaxplan as jp
from jaxplan.paper import qp
from jaxplan.planner import steps
from jaxplan.schema import with_settings
from jaxplan.search import mha
from jaxplan.search.astar import make_root, trace
from jaxplan.trajectory import interior_point as box_qp
from jaxplan.trajectory import step_programs

RNG = np.random.default_rng(21)
SETTINGS = {"search.max_goals": 1, "search.time_limit_s": "off"}


def planned(method: str = "global", **changes: object) -> jp.Plan:
    """A plan of the paper's case 3, whose straight motion breaks a zone, looked at without the package."""
    scenario = with_settings(jp.paper_case(3), {**SETTINGS, "trajectory.method": method, **changes})
    plan = jp.plan(scenario, throw=False, progress=False)
    examine(plan)
    return plan


BOX_ANSWERS = {
    "nothing binds": lambda matrix, linear, penalty: np.zeros_like(linear),
    "noise": lambda matrix, linear, penalty: RNG.uniform(0, 1, len(linear)) * penalty,
    "not a number": lambda matrix, linear, penalty: np.full_like(linear, np.nan),
}


@pytest.mark.parametrize("name", BOX_ANSWERS)
def test_garbage_of_the_box_solver_is_no_plan_that_breaks_anything(monkeypatch, name):
    asked = []

    def garbage(programs):
        asked.extend(len(own.linear) for own in programs)
        return [box_qp.BoxQPSolution(BOX_ANSWERS[name](*own[:3]), residual=0.0) for own in programs]

    monkeypatch.setattr(step_programs, "solve_box_qps", garbage)
    with np.errstate(all="ignore"):
        plan = planned()
    assert asked
    assert plan.status in (
        jp.Status.OK,
        jp.Status.UNCERTIFIED,
        jp.Status.INFEASIBLE,
        jp.Status.LIMITS_TOO_TIGHT,
    )


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_garbage_of_lapack_is_no_plan_that_breaks_anything(monkeypatch, size):
    real, asked = scipy.linalg.lapack.dpotrs, []

    def garbage(factor, right, **more):
        asked.append(len(right))
        answer, info = real(factor, right, **more)
        return answer * (1 + size * RNG.standard_normal(answer.shape)), info

    monkeypatch.setattr(scipy.linalg.lapack, "dpotrs", garbage)
    with np.errstate(all="ignore"):
        planned()
    assert asked


QP_ANSWERS = {
    "off by a little": lambda x: x + 1e-6 * RNG.standard_normal(x.shape),
    "nothing": np.zeros_like,
    "not a number": lambda x: np.full_like(x, np.nan),
}


@pytest.mark.parametrize("name", QP_ANSWERS)
def test_garbage_of_the_papers_programs_is_no_plan_that_breaks_anything(monkeypatch, name):
    real, asked = qp.solve_all, []

    def garbage(given):
        asked.extend(given)
        return [None if answer is None else QP_ANSWERS[name](answer) for answer in real(given)]

    monkeypatch.setattr(qp, "solve_all", garbage)
    with np.errstate(all="ignore"):
        plan = planned("paper", **{"trajectory.duration_s": 80})
    assert asked
    assert not plan.ok


def test_wrong_sides_of_osqp_are_no_answer(monkeypatch):
    asked = []

    def garbage(given, column):
        asked.append(column)
        return RNG.integers(-1, 2, len(given.limits)).astype(float)

    monkeypatch.setattr(qp, "_find_active_sides", garbage)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        given = qp.SegmentQP(
            objective=np.eye(8),
            equalities=rng.standard_normal((2, 8)),
            values=rng.standard_normal((2, 1)),
            limited=rng.standard_normal((4, 8)),
            limits=np.full((4, 1), 0.05),
        )
        (answer,) = qp.solve_all([given])
        if answer is not None:
            assert_each(np.abs(given.limited @ answer), "<=", given.limits + 1e-9)
            np.testing.assert_allclose(given.equalities @ answer, given.values, rtol=0, atol=1e-9)
    assert asked


def test_a_search_that_says_clear_where_it_is_not_is_found_out(monkeypatch):
    """The straight motion, whatever is in its way."""

    def blind(scenes, settings):
        return [trace(scene, make_root(scene)) for scene in scenes.scenes]

    monkeypatch.setattr(mha, "straight_paths", blind)
    plan = planned("paper", **{"trajectory.duration_s": 80})
    assert plan.status is jp.Status.UNCERTIFIED
    assert plan.certificate.min_margin < 0
    assert "CZ" in plan.message


@pytest.mark.parametrize("angle", [1e-6, 0.1])
def test_a_goal_that_step_1_gets_wrong_is_found_out(monkeypatch, angle):
    real = steps.decompose

    def garbage(*given, **more):
        found = real(*given, **more)
        turn = Rotation.from_rotvec([0, 0, angle]).as_matrix()
        return replace(found, goals=tuple(replace(g, attitude=g.attitude @ turn) for g in found.goals))

    monkeypatch.setattr(steps, "decompose", garbage)
    scenario = with_settings(jp.paper_case(3), SETTINGS)
    plan = jp.plan(scenario, throw=False, progress=False)
    assert not plan.ok
    assert "goal" in plan.message
