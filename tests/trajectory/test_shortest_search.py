"""The search for a shortest motion: rough programs, loads between places, and searches that end early."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_spacecraft
from fits import problem_of, stack_at
from node_paths import wandering
from reference import assert_each

import jaxplan as jp
from jaxplan.model.tabulation import tabulate
from jaxplan.planner.steps import wanted_fit
from jaxplan.trajectory import curve_attempts, fit_batch, sqp
from jaxplan.trajectory.gram import gram, times
from jaxplan.trajectory.interior_point import ROUGHLY, BoxQP, solve_box_qps


@pytest.fixture(scope="module")
def asked():
    """The fit along the path of a plan whose shortest motion is well above its bound."""
    scene = jp.random_scenario(2, "keep_in")
    plan = jp.plan(scene)
    return wanted_fit(
        replace(scene, trajectory=replace(scene.trajectory, duration="minimum")), plan.path, plan.goal
    )


def searched(query):
    """The fit of a query, and how many steps its searches took."""
    steps, improve = [], sqp.improve

    def counted(begins):
        found = improve(begins)
        steps.extend(own.steps for own in found)
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(curve_attempts.sqp, "improve", counted)
        (fit,) = fit_batch([query])
    return fit, sum(steps)


@pytest.mark.parametrize("far", [0.0, 0.1, 10.0])
def test_a_rough_answer_is_near_the_precise_one_from_any_guess(far):
    rng = np.random.default_rng(5)
    for _ in range(20):
        factor, target = rng.normal(size=(60, 40)), rng.normal(size=60)
        top = 10.0 ** rng.uniform(-2, 1, 40)
        whole = BoxQP(factor.T @ factor, factor.T @ target, top)
        (precise,) = solve_box_qps([whole])
        guess = np.clip(precise.multipliers + far * rng.normal(size=40), 0, top)
        (rough,) = solve_box_qps([whole._replace(guess=guess, tolerance=ROUGHLY)])
        assert rough.residual <= ROUGHLY
        assert_each(rough.multipliers, ">=", 0)
        assert_each(rough.multipliers, "<=", top)
        np.testing.assert_allclose(rough.multipliers, precise.multipliers, atol=1e-3)


@pytest.mark.parametrize("single", [0, 7, 12])
def test_the_matrix_of_rows_is_that_of_their_slopes(single):
    rng = np.random.default_rng(single)
    axes, along = rng.normal(size=(12, 4, 6)), rng.normal(size=(12, 4, 5))
    order = rng.permutation(12)
    axes[order[:single], 1:] = 0.0  # rows of one product
    axes[order[single:], :, 4:] = 0.0  # rows of some axes
    root = rng.normal(size=(5, 5))
    inverse = root @ root.T
    slopes = np.einsum("rpa,rpk->rak", axes, along)
    expected = np.einsum("rak,kl,sal->rs", slopes, inverse, slopes)
    np.testing.assert_allclose(gram(axes, along, inverse), expected, rtol=1e-12, atol=1e-12)
    assert gram(axes[:0], along[:0], inverse).shape == (0, 0)
    assert times(along[:0], inverse).shape == (0, 4, 5)


def test_the_peak_of_a_parabola_between_places_is_met_exactly():
    rng = np.random.default_rng(6)
    places = np.sort(rng.uniform(0, 1, 15))
    craft = make_spacecraft(1)
    problem = problem_of(wandering(3, 1, seed=0), craft, tabulate((), (), craft))
    stack = stack_at([problem, problem], places)
    tops = rng.uniform(places[2], places[-3], (2, 1, 3))
    heights, bends = rng.uniform(0.2, 2, (2, 2, 1, 3))
    shares = heights - bends * (places[:, None] - tops) ** 2
    found = stack.with_peaks(shares, True)
    np.testing.assert_allclose(found.max(axis=1), heights[:, 0], rtol=1e-12)
    raised = found > shares
    assert_each(raised.sum(axis=1), "<=", 1)
    np.testing.assert_array_equal(found[~raised], shares[~raised])
    np.testing.assert_array_equal(
        stack.with_peaks(-shares, True)[:, 1:-1], -shares[:, 1:-1]
    )  # no peak within
    np.testing.assert_array_equal(stack.with_peaks(shares, False), shares)


def test_loads_between_places_are_kept_nearly_without_slowing_down(asked):
    solutions, improve = [], sqp.improve

    def kept(begins):
        found = improve(begins)
        solutions.extend(found)
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(curve_attempts.sqp, "improve", kept)
        (fit,) = fit_batch([asked])
    last = solutions[-1]
    assert last.duration <= fit.trajectory.duration <= (1 + 5e-4) * last.duration


def test_a_search_that_promises_nothing_shorter_than_is_of_use_ends_sooner(asked):
    alone = replace(asked, settings=replace(asked.settings, first_guesses=0))
    whole, steps = searched(alone)
    shortest = whole.trajectory.duration
    same, as_many = searched(replace(alone, at_most=1.01 * shortest))
    assert (same.trajectory.duration, as_many) == (shortest, steps)
    longer, fewer = searched(replace(alone, at_most=0.8 * shortest))
    assert fewer < steps
    assert longer.trajectory.duration >= 0.999 * shortest
