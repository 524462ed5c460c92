"""Plans that end at the optimum, and the exact quadratic program that leads there."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import make_scenario
from quick import quick_jit
from reference import assert_each
from scipy.optimize import minimize

import jaxplan as jp
from jaxplan.derivatives import held_end, replan_to
from jaxplan.planner.steps import fit
from jaxplan.trajectory.active_set import FitRecord
from jaxplan.trajectory.exact_qp import downward_way, least_change
from jaxplan.trajectory.outcome import NOT_OPTIMAL


def asking(scenario, **settings):
    return replace(scenario, trajectory=replace(scenario.trajectory, **settings))


DURATIONS = {
    "in a given time": 60.0,
    "stretched": "stretched",
    "shortest": "minimum",
}


@pytest.mark.parametrize(
    "name", ["in a given time", "stretched", pytest.param("shortest", marks=pytest.mark.slow)]
)
def test_an_optimal_plan_is_the_one_whose_derivatives_are_known(name):
    scene = asking(make_scenario(1), first_guesses=0)  # breaks at switches lose two digits of the rates
    plan = jp.plan(asking(scene, duration=DURATIONS[name], optimal=True), progress=False)
    assert plan.ok
    assert NOT_OPTIMAL not in plan.message
    told = jp.differentiable(plan)(plan.scenario)
    assert told.duration == pytest.approx(plan.trajectory.duration, rel=1e-9)
    shares = np.linspace(0, 1, 201)
    with jax.enable_x64(True):
        own, other = (curve.sample(shares * curve.duration) for curve in (plan.trajectory, told))
        for part, atol in (("attitude", 1e-8), ("joints", 1e-8), ("angular_velocity", 1e-9)):
            np.testing.assert_allclose(getattr(own, part), getattr(other, part), atol=atol, err_msg=part)
        assert float(jp.measures.effort(told)) == pytest.approx(
            float(jp.measures.effort(plan.trajectory)),
            rel=1e-8,  # at which steps to the optimum end, in rad
        )


def test_an_optimal_plan_has_no_more_energy():
    scenario = asking(make_scenario(1), duration=60.0)
    plan, best = (jp.plan(asking(scenario, optimal=optimal), progress=False) for optimal in (False, True))
    rate, acceleration, jerk = 1.0, 3.0, 30.0  # the settings' weights

    def energy(plan):
        curve = plan.trajectory
        times = np.linspace(0, curve.duration, 4001)
        sampled = curve.sample(times)
        joints = [np.asarray(getattr(sampled, name)) for name in ("joint_rates", "joint_accelerations")]
        body = [np.asarray(getattr(sampled, name)) for name in ("angular_velocity", "angular_acceleration")]
        squares = [np.sum(a**2, axis=1) + np.sum(b**2, axis=1) for a, b in zip(joints, body, strict=True)]
        jerks = np.gradient(np.concatenate([body[1], joints[1]], axis=1), times, axis=0)
        density = rate * squares[0] + acceleration * squares[1] + jerk * np.sum(jerks**2, axis=1)
        return np.trapezoid(density, times)

    assert energy(best) <= energy(plan) * (1 + 1e-4)


def test_what_the_certificate_refuses_is_flown_as_it_was(monkeypatch):
    scenario = asking(make_scenario(1), duration=60.0)
    plan = jp.plan(scenario, progress=False)

    def too_quick(record):
        return replace(record.attempt, trajectory=record.attempt.trajectory.scaled(0.2))

    monkeypatch.setattr(FitRecord, "at_optimum", too_quick)
    other = jp.plan(asking(scenario, optimal=True), progress=False)
    assert other.ok
    assert NOT_OPTIMAL in other.message
    np.testing.assert_array_equal(other.trajectory.coefficients, plan.trajectory.coefficients)
    followed = jp.follow(plan, asking(scenario, optimal=True))
    assert followed.ok
    assert NOT_OPTIMAL in followed.message


def test_a_plan_whose_optimum_cannot_be_told_says_so(monkeypatch):
    monkeypatch.setattr(FitRecord, "at_optimum", lambda record: None)
    plan = jp.plan(asking(make_scenario(1), duration=60.0, optimal=True), progress=False)
    assert plan.ok
    assert NOT_OPTIMAL in plan.message


@pytest.mark.parametrize("seed", [10, 25])  # rows beside each other bind; the set of them was hard to find
def test_nothing_is_broken_at_the_optimum_at_any_place(seed):
    scenario = asking(jp.random_scenario(seed, "hard_keep_out"), method="global", duration=60.0)
    plan = jp.plan(scenario, progress=False)
    best = fit(scenario, plan.path, plan.goal).origin.at_optimum()
    assert np.max(best.solution.violations) <= 2e-8  # of a limit, or rad
    again = replace(fit(scenario, plan.path, plan.goal).origin, attempt=best).at_optimum()
    np.testing.assert_allclose(again.solution.coefficients, best.solution.coefficients, atol=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_the_least_change_is_that_of_another_solver(seed):
    rng = np.random.default_rng(seed)
    size, count = 6, 9
    root = rng.normal(size=(size, size))
    hessian, gradient = root @ root.T + np.eye(size), 3 * rng.normal(size=size)
    slopes = rng.normal(size=(count, size))
    slopes[-1] = slopes[0] + slopes[1]  # rows that follow from each other
    inside = rng.normal(size=size)
    excess = -slopes @ inside - rng.uniform(0, 0.5, count)
    excess[-1] = excess[0] + excess[1]
    found, pushes = least_change(hessian, gradient, slopes, excess, np.zeros(count, bool))
    other = minimize(
        lambda d: d @ hessian @ d / 2 + gradient @ d,
        inside,
        jac=lambda d: hessian @ d + gradient,
        constraints={"type": "ineq", "fun": lambda d: -slopes @ d - excess, "jac": lambda d: -slopes},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    np.testing.assert_allclose(found, other.x, atol=1e-6)
    np.testing.assert_allclose(hessian @ found + gradient + slopes.T @ pushes, 0, atol=1e-10)
    assert_each(pushes, ">=", 0)
    assert np.max(slopes @ found + excess) <= 1e-10
    np.testing.assert_allclose(pushes * (slopes @ found + excess), 0, atol=1e-10)
    assert np.linalg.matrix_rank(slopes[pushes > 0]) == np.sum(pushes > 0)


def test_rows_that_bind_make_up_for_a_form_without_a_minimum():
    hessian, gradient = np.diag([-1.0, 2.0]), np.array([0.5, -4.0])
    slopes, excess = np.array([[1.0, 0.0]]), np.array([-3.0])  # the first is at most 3, and taken to be it
    found, pushes = least_change(hessian, gradient, slopes, excess, np.ones(1, bool))
    np.testing.assert_allclose(found, [3.0, 2.0], atol=1e-9)
    np.testing.assert_allclose(pushes, [2.5], atol=1e-9)


def test_a_form_that_curves_downwards_where_rows_leave_it_is_followed_to_the_next_row():
    hessian = np.diag([-1.0, 2.0, 4.0])
    slopes, excess = np.array([[0, 0, 1.0], [1.0, 0, 0]]), np.array([0.0, -3.0])  # the second is 3 away
    gradient, binding = np.array([-0.1, 0.0, -2.0]), np.array([True, False])
    for _ in range(12):  # as far as the form's curvature says, which is twice as far each time
        change, pushes = least_change(hessian, gradient, slopes, excess, binding, downwards=True)
        gradient, excess = gradient + hessian @ change, excess + slopes @ change
    np.testing.assert_allclose(excess, 0, atol=1e-9)
    assert np.all(pushes > 0)


def test_the_way_off_a_saddle_is_along_what_the_rows_leave_free():
    hessian = np.diag([-3.0, -2.0, 4.0, 5.0])
    np.testing.assert_allclose(np.abs(downward_way(hessian, np.zeros((0, 4)))), [1, 0, 0, 0], atol=1e-12)
    rows = np.array([[1.0, 0, 0, 0], [2.0, 0, 0, 0]])  # which depend on each other
    np.testing.assert_allclose(np.abs(downward_way(hessian, rows)), [0, 1, 0, 0], atol=1e-12)
    assert downward_way(hessian, np.eye(4)[:2]) is None
    assert downward_way(hessian, np.eye(4)) is None
    assert downward_way(-hessian + 10 * np.eye(4), np.zeros((0, 4))) is None


@quick_jit
def shortest_of(held, scenario):
    """The duration of what is replanned to the goal that is held, which need not be found anew."""
    return jp.measures.duration(replan_to(held_end(held, scenario), held, scenario))


@pytest.mark.slow
def test_shortest_motions_among_hard_zones_are_held_at_minima():
    for seed in (7, 12, 15):  # where curvature of zones and loads makes saddles
        plan = jp.plan(asking(jp.random_scenario(seed, "hard_keep_out"), duration="minimum"), progress=False)
        with jax.enable_x64(True):
            duration = shortest_of(jp.hold(plan), jax.tree.map(np.asarray, plan.scenario))
        assert float(duration) == pytest.approx(plan.trajectory.duration, rel=1e-3)


def test_a_hessian_that_only_nearly_dependent_rows_make_convex_is_kept():
    rng = np.random.default_rng(4)
    hessian = np.diag([1.0, -1.0, 2.0, 3.0])
    hessian[1, 2:] = hessian[2:, 1] = 0.5, 0.4
    slopes = np.array([[1.0, 0, 0, 0], [1.0, 1e-5, 0, 0]])  # both bind, so neither of their axes is free
    change, pushes = rng.normal(size=4), np.array([1.0, 2.0])
    gradient = -hessian @ change - slopes.T @ pushes
    found, told = least_change(hessian, gradient, slopes, -slopes @ change, np.ones(2, bool))
    np.testing.assert_allclose(found, change, atol=1e-6)
    assert np.all(told > 0)
