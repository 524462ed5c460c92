"""Parts of the method "global": each against scipy, quadrature, finite differences or brute force."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from builders import make_spacecraft
from fits import problem_of, stack_at
from node_paths import load, turning, wandering
from reference import assert_each
from scipy.interpolate import BSpline
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.trajectory.chart import farthest, fitting
from jaxplan.trajectory.constraints import margin_slopes
from jaxplan.trajectory.interior_point import BoxQP, solve_box_qps
from jaxplan.trajectory.motion import load_slopes
from jaxplan.trajectory.node_times import TrapezoidalProfile, edge_turns
from jaxplan.trajectory.splines import DEGREE, Basis, CurveSpace, weighted

RNG = np.random.default_rng(3)
UNEVEN = np.concatenate([[0.0], np.sort(RNG.uniform(0.02, 0.98, 9)), [1.0]])
BREAKS = pytest.mark.parametrize("breaks", [np.linspace(0, 1, 2), np.linspace(0, 1, 33), UNEVEN])
DENSE = np.linspace(0, 1, 2001)
FULL = np.array([[2.0, 0.2, -0.1], [0.2, 3.0, 0.3], [-0.1, 0.3, 4.0]])


def scipy_curve(basis, coefficients, derivative=0):
    knots = np.concatenate([np.zeros(DEGREE), basis.breaks, np.ones(DEGREE)])
    spline = BSpline(knots, coefficients, DEGREE)
    return spline.derivative(derivative) if derivative else spline


@BREAKS
def test_splines_and_derivatives_are_those_of_scipy(breaks):
    basis = Basis.on(breaks)
    coefficients = np.random.default_rng(0).normal(size=(basis.size, 2))
    for d, rows in enumerate(basis.rows(DENSE)):
        expected = scipy_curve(basis, coefficients, d)(DENSE)
        np.testing.assert_allclose(rows @ coefficients, expected, atol=1e-10 * np.abs(expected).max())


@BREAKS
def test_each_derivative_is_the_slope_of_the_one_before(breaks):
    basis, step = Basis.on(breaks), 1e-6
    inner = np.random.default_rng(1).uniform(0.01, 0.99, 200)
    inner = inner[np.abs(inner[:, None] - breaks).min(axis=1) > 2 * step]
    ahead, behind, rows = basis.rows(inner + step), basis.rows(inner - step), basis.rows(inner)
    for d in (1, 2, 3):
        slope = (ahead[d - 1] - behind[d - 1]) / (2 * step)
        np.testing.assert_allclose(slope, rows[d], atol=1e-6 * np.abs(rows[d]).max())


@BREAKS
def test_energies_are_integrals(breaks):
    basis = Basis.on(breaks)
    coefficients = np.random.default_rng(2).normal(size=basis.size)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    half = np.diff(breaks)[:, None] / 2
    places = (breaks[:-1, None] + half * (nodes + 1)).ravel()
    for d, form in enumerate(basis.energies):
        squares = scipy_curve(basis, coefficients, d)(places) ** 2
        assert coefficients @ form @ coefficients == pytest.approx(
            np.sum((half * weights).ravel() * squares), rel=1e-11
        )


@BREAKS
def test_pieces_are_the_spline_and_hulls_hold_its_derivatives(breaks):
    basis = Basis.on(breaks)
    coefficients = np.random.default_rng(4).normal(size=(basis.size, 3))
    pieces = basis.pieces(coefficients)
    for k, (low, high) in enumerate(pairwise(breaks)):
        x = np.linspace(-1, 1, 50)
        here = np.polynomial.legendre.legval(x, pieces[k]).T
        there = scipy_curve(basis, coefficients)(low + (high - low) * (x + 1) / 2)
        np.testing.assert_allclose(here, there, atol=1e-12)
    for d in range(4):
        hull = basis.differences[d] @ coefficients
        values = scipy_curve(basis, coefficients, d)(DENSE)
        room = 1e-10 * np.abs(hull).max()
        assert_each(values, "<=", hull.max(axis=0) + room)
        assert_each(values, ">=", hull.min(axis=0) - room)


def test_pieces_join_smoothly_however_short_some_of_them_are():
    # as of a minute's turn whose limits of jerk and acceleration bind for a hundredth of a second at its ends
    short = 1.5e-4 * np.arange(9)
    basis = Basis.on(
        np.concatenate([short, np.linspace(short[-1], 1 - short[-1], 16)[1:-1], 1 - short[::-1]])
    )
    knots = np.concatenate([np.zeros(DEGREE), basis.breaks, np.ones(DEGREE)])
    middles = np.lib.stride_tricks.sliding_window_view(knots[1:-1], DEGREE).mean(axis=1)
    pieces = basis.pieces(np.stack([1.0 + np.sin(2.0 * middles), np.full(basis.size, 0.7)], axis=1))
    half = np.diff(basis.breaks)[:, None] / 2
    for d, allowed in enumerate((1e-15, 1e-11, 1e-6, 1e-12)):
        own = np.polynomial.legendre.legder(pieces, d, axis=1) if d else pieces
        begin, end = (np.polynomial.legendre.legval(x, own.swapaxes(0, 1)) / half**d for x in (-1, 1))
        moving, still = np.abs(end[:-1] - begin[1:]).T
        assert_each(moving, "<=", allowed * np.abs(begin).max())
        assert_each(still, "==", 0)


@BREAKS
def test_places_within_are_evenly_spread_on_each_interval(breaks):
    basis = Basis.on(breaks)
    places, rows = basis.within(4)
    expected = np.concatenate([np.linspace(*ends, 4, endpoint=False) for ends in pairwise(breaks)])
    np.testing.assert_allclose(places, expected, atol=1e-15)
    np.testing.assert_array_equal(rows, basis.rows(places))


@BREAKS
def test_of_places_up_to_the_end_only_those_of_the_last_interval_are_farther_apart(breaks):
    basis = Basis.on(breaks)
    places, rows = basis.within(4, to_end=True)
    np.testing.assert_array_equal(places[:-4], basis.within(4)[0][:-4])
    np.testing.assert_allclose(places[-4:], np.linspace(*breaks[-2:], 4), atol=1e-15)
    assert places[-1] == breaks[-1]
    np.testing.assert_array_equal(rows, basis.rows(places))


def test_an_even_basis_is_that_of_breaks_at_equal_distances():
    basis = Basis.even(7)
    np.testing.assert_array_equal(basis.breaks, np.linspace(0, 1, 8))
    assert [len(matrix) for matrix in basis.differences] == [12, 11, 10, 9]  # the curve and three derivatives


@pytest.mark.parametrize("rest", [True, False])
def test_all_curves_of_a_space_meet_its_ends_and_pass_its_nodes(rest):
    rng = np.random.default_rng(5)
    basis, duration = Basis.on(UNEVEN), 17.0
    values, rates = rng.normal(size=(2, 4)), rng.normal(size=(2, 4))
    places, nodes = np.array([0.11, 0.42, 0.5, 0.93]), rng.normal(size=(4, 4))
    space = CurveSpace.of(basis, values, rates, rest)
    for one in (space, CurveSpace.of(basis, values, rates, rest, places, nodes)):
        coefficients = one.fixed + duration * one.by_time + one.free @ rng.normal(size=(one.free.shape[1], 4))
        at_ends = basis.rows(np.array([0.0, 1.0])) @ coefficients
        np.testing.assert_allclose(at_ends[0], values, atol=1e-12)
        np.testing.assert_allclose(at_ends[1], duration * rates, atol=1e-10)
        if rest:
            np.testing.assert_allclose(at_ends[2], 0, atol=1e-9)
    np.testing.assert_allclose(basis.rows(places, 1)[0] @ coefficients, nodes, atol=1e-12)
    assert one.free.shape[1] == space.free.shape[1] - len(places)
    # The same from what is given, which derivatives are taken of.
    np.testing.assert_allclose(one.of_values @ np.concatenate([values, nodes]), one.fixed, atol=1e-12)
    np.testing.assert_allclose(one.of_rates @ rates, one.by_time, atol=1e-12)


def test_the_energy_is_the_weighted_integral_of_squares_over_time():
    rng = np.random.default_rng(6)
    basis, duration, weights = Basis.on(UNEVEN), 17.0, (0.7, 30.0, 900.0)
    space = CurveSpace.of(basis, np.zeros((2, 1)), np.zeros((2, 1)), True)
    coefficients = rng.normal(size=basis.size)
    nodes, shares = np.polynomial.legendre.leggauss(12)
    half = np.diff(UNEVEN)[:, None] / 2
    places, steps = (UNEVEN[:-1, None] + half * (nodes + 1)).ravel(), duration * (half * shares).ravel()
    squares = [(scipy_curve(basis, coefficients, d)(places) / duration**d) ** 2 for d in (1, 2, 3)]
    expected = sum(weight * (steps @ square) for weight, square in zip(weights, squares, strict=True))
    both = weighted(np.stack([space.energies] * 2), np.array([2.0, duration]), np.array([(1, 1, 1), weights]))
    assert coefficients @ both[1] @ coefficients == pytest.approx(expected, rel=1e-11)


TURNS = [[0, 20], [0, 180], [0, 90, 180], [0, 60, 120, 180, 240, 300], [0, 100, 190], [0, 170, 10], [0, 0, 5]]
TURNS += [list(range(0, 331, 30)), [0, 100, 200, 100, 0]]


@pytest.mark.parametrize("path", [turning(t, (1, 2, -1)) for t in TURNS] + [load("astar_c3"), load("rrt_c2")])
def test_coordinates_in_the_chart_give_the_attitudes_back(path):
    places = np.linspace(0, 1, path.edges + 1)
    chart, b = fitting(path.attitudes, edge_turns(path.attitudes), places)
    half = Rotation.from_rotvec(places[:, None] * chart.turn / 2)
    eta = Rotation.from_rotvec(b - places[:, None] * chart.turn)
    again = (Rotation.from_matrix(chart.attitude) * half * eta * half).as_matrix()
    np.testing.assert_allclose(again, path.attitudes, atol=1e-12)
    assert farthest(chart, b, places) < 2 * np.pi
    np.testing.assert_allclose(b[[0, -1]], [np.zeros(3), chart.turn], atol=1e-12)
    # No node is a turn off: along the path b goes on from where it is.
    assert np.linalg.norm(np.diff(b, axis=0), axis=1).max(initial=0) < 3.2


ZONES = [
    KeepOut(name="sun", direction=np.array([0.6, 0.0, 0.8]), half_angle=0.4),
    KeepOut(name="moon", direction=np.array([0.0, -1.0, 0.0]), half_angle=0.3, devices=("camera-1",)),
    KeepIn(name="earth", direction=np.array([0.0, 0.8, -0.6]), half_angle=0.7, devices=("terminal-2",)),
]


@pytest.mark.parametrize(("dynamic", "jerky"), [(False, False), (True, True)])
def test_slopes_of_loads_and_margins_are_those_of_differences(dynamic, jerky):
    rng = np.random.default_rng(6)
    craft = make_spacecraft(3, 1)
    if dynamic:
        craft = replace(craft, inertia=FULL, torque_limit=0.1, wheel_momentum_limit=np.array([1.0, 2.0, 3.0]))
    if jerky:
        craft = replace(craft, jerk_limit=0.1, rate_norm_limit=0.2, acceleration_norm_limit=0.3)
    zones = tabulate(ZONES[:2], ZONES[2:], craft)
    problem = problem_of(wandering(5, 3, seed=1, step=0.4), craft, zones)
    stack = stack_at([problem, problem], np.linspace(0.1, 0.9, 4))
    curves = rng.normal(size=(2, 4, 4, 9))  # the second of two is looked at

    def both(curves):
        return stack.iterates(curves.reshape(2, 16, 9), np.ones(2))

    at, step = both(curves), 1e-5
    assert len(problem.names) == 2 + 2 * dynamic + 3 * jerky
    assert at.loads.shape[2] == 3 * (2 + 2 * dynamic + jerky) + 2 * jerky
    index = np.nonzero(np.isfinite(at.margins))
    slopes, of_loads = margin_slopes(at, *index), load_slopes(at, 1)
    for axis in range(9):
        for d in range(4):
            change = np.zeros_like(curves)
            change[:, d, :, axis] = step
            ahead, behind = (both(curves + sign * change) for sign in (1, -1))
            if axis < 3:
                found = (ahead.loads - behind.loads)[1] / (2 * step)
                np.testing.assert_allclose(of_loads[..., d, axis], found, atol=1e-6, rtol=1e-6)
            if d == 0:
                found = (ahead.margins[index] - behind.margins[index]) / (2 * step)
                np.testing.assert_allclose(slopes[:, axis], found, atol=1e-7)


def solved(*program):
    return solve_box_qps([BoxQP(*program)])[0]


def random_program(rng, rows, rank, loose):
    """Least squares |L y - b|^2 / 2 with 0 <= y <= top."""
    factor = rng.normal(size=(rank, rows)) * 10.0 ** rng.uniform(-2, 2, rows)
    target = rng.normal(size=rank)
    return factor, target, np.full(rows, 1e3) if loose else 10.0 ** rng.uniform(-3, 0, rows)


@pytest.mark.parametrize("loose", [True, False], ids=["loose", "at the penalty"])
@pytest.mark.parametrize("rank", [4, 30, 60], ids=["dependent", "square", "regular"])
def test_box_programs_are_solved_as_by_active_sets(rank, loose):
    rng, rows = np.random.default_rng(rank), 30
    programs = [random_program(rng, rows, rank, loose) for _ in range(20)]
    for factor, target, top in programs:
        y = solved(factor.T @ factor, factor.T @ target, top).multipliers
        assert_each(y, ">=", 0)
        assert_each(y, "<=", top)
        best = lsq_linear(factor, target, (0, top), method="bvls", tol=1e-15)
        cost = np.sum((factor @ y - target) ** 2) / 2
        assert cost <= best.cost + 1e-6 * (1 + best.cost)
        scale = np.linalg.norm(factor, axis=0)
        gradient = factor.T @ (factor @ y - target) / scale
        np.testing.assert_allclose(y - np.clip(y - gradient / scale, 0, top), 0, atol=1e-4 / scale.min())


def test_box_programs_solved_together_have_the_answers_they_have_alone():
    rng = np.random.default_rng(7)
    programs = []
    for rows in rng.permutation(40):  # more than one stack
        factor, target, top = random_program(rng, rows, max(rows // 2, 1), loose=bool(rows % 2))
        programs.append(BoxQP(factor.T @ factor, factor.T @ target, top))
    programs[3] = programs[3]._replace(linear=np.full_like(programs[3].linear, np.nan))
    for own, answer in zip(programs, solve_box_qps(programs), strict=True):
        np.testing.assert_allclose(answer.multipliers, solved(*own).multipliers, rtol=1e-6, atol=1e-9)
    assert solve_box_qps([]) == []


def test_a_program_without_rows_has_no_multipliers():
    assert solved(np.zeros((0, 0)), np.zeros(0), np.zeros(0)).multipliers.shape == (0,)


@pytest.mark.parametrize("part", range(3))
def test_a_nan_gives_nan_and_never_an_answer(part):
    rng = np.random.default_rng(0)
    factor, target, top = random_program(rng, 40, 40, loose=False)
    program = [factor.T @ factor, factor.T @ target, top]
    program[part] = program[part].copy()
    program[part].flat[-1] = np.nan
    answer = solved(*program)
    assert np.any(np.isnan(answer.multipliers))
    assert not answer.residual <= 1e-6


PACES_AT_ENDS = [(0.0, 0.0), (1e-3, 0.0), (0.0, 1e-3), (5e-4, 1e-12), (-0.2, 5.0), (5.0, 5.0)]


@pytest.mark.parametrize("paces", PACES_AT_ENDS)
def test_a_pace_with_rates_at_its_ends_has_these_there_as_far_as_they_lead_ahead_and_are_no_quicker(paces):
    calm = TrapezoidalProfile.within(80.0, 20.0, 1.5)
    profile, step = calm.between(np.array(paces)), 1e-6
    gone = profile.progress(np.array([0.0, step, 1 - step, 1.0]))
    at_ends = np.array([gone[1] - gone[0], gone[3] - gone[2]]) / step  # over the mean rate
    wanted = np.clip(np.array(paces) * profile.duration / profile.length, 0.0, 1.0)
    np.testing.assert_allclose(at_ends, wanted, atol=1e-4)
    if not np.any(wanted):
        np.testing.assert_allclose(profile.places(DENSE), calm.places(DENSE), atol=1e-14)


@pytest.mark.parametrize(("length", "rise"), [(20.0, 1.5), (0.4, 1.5), (1.5, 1.5)])
def test_a_pace_is_gone_and_inverted(length, rise):
    for profile in (
        TrapezoidalProfile.quickest(length, rise),
        TrapezoidalProfile.within(80.0, length, rise),
        *(TrapezoidalProfile.within(80.0, length, rise).between(np.array(ends)) for ends in PACES_AT_ENDS),
    ):
        gone = profile.progress(DENSE)
        assert_each(np.diff(gone), ">=", 0)
        np.testing.assert_allclose(gone[[0, -1]], [0, 1], atol=1e-12)
        np.testing.assert_allclose(profile.places(gone), DENSE, atol=1e-7)
        breaks = profile.breaks(32)
        assert breaks.shape == (33,)
        assert_each(np.diff(breaks), ">", 0)
