"""The parts of step 3: Legendre basis, quadratic programs, schedule, and peaks over all time."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from builders import make_spacecraft
from node_paths import fit_global, fit_stored, load, turning
from numpy.polynomial import legendre as reference
from reference import assert_each
from scipy.linalg import null_space
from scipy.optimize import minimize, minimize_scalar

from jaxplan.model.scenario import TrajectorySettings
from jaxplan.paper import qp, segments
from jaxplan.paper.segments import assemble
from jaxplan.trajectory import maxima, node_times, peaks, splines

ORDERS = pytest.mark.parametrize("order", [5, 12, 24])


@ORDERS
def test_values_and_derivatives_are_those_of_numpy(order):
    x, rng = np.linspace(-1, 1, 41), np.random.default_rng(0)
    c = rng.normal(size=order + 1)
    for power in range(4):
        own = splines.legendre(x, order) @ np.linalg.matrix_power(splines.derivative_matrix(order), power) @ c
        expected = reference.legval(x, reference.legder(c, power))
        np.testing.assert_allclose(own, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    ends = splines.end_derivatives(order)
    for side, end in enumerate((-1.0, 1.0)):
        for power in (1, 2):
            assert ends[side, power - 1] @ c == pytest.approx(
                reference.legval(end, reference.legder(c, power)), rel=1e-12
            )


@ORDERS
@pytest.mark.parametrize("derivative", [0, 1, 2, 3])
def test_energy_is_the_integral_of_the_squared_derivative(order, derivative):
    x, weights = reference.leggauss(order + 1)
    c = np.random.default_rng(1).normal(size=order + 1)
    expected = weights @ reference.legval(x, reference.legder(c, derivative)) ** 2
    assert c @ splines.energy(order, derivative) @ c == pytest.approx(expected, rel=1e-12)
    assert np.linalg.matrix_rank(splines.energy(order, derivative)) == order + 1 - derivative


def test_the_basis_follows_the_precision_of_its_input():
    assert splines.legendre(jnp.ones(3, jnp.float32), 12).dtype == jnp.float32


def solve(program: qp.SegmentQP) -> np.ndarray | None:
    return qp.solve_all([program])[0]


def join_program(limit: float) -> tuple[qp.SegmentQP, np.ndarray]:
    """A segment of zig-zag nodes, limited at its join to a share of what it takes there if free; and that."""
    path = load("astar_c3")
    joints, _, _ = assemble(
        attitudes=path.attitudes,
        joints=path.joints,
        times=np.linspace(0, 40, 18),
        joint_ends=np.array([0, 5, 11, 17]),
        platform_ends=np.array([0, 5, 11, 17]),
        order=12,
        rate_weight=1.0,
        acceleration_weight=3.0,
    )
    ends = splines.end_derivatives(12)
    program = qp.SegmentQP(
        objective=joints.objective[0],
        equalities=np.concatenate([joints.node_rows[0, joints.present[0]], ends[0]]),
        values=np.concatenate([joints.node_values[0, joints.present[0]], np.zeros((2, 6))]),
        limited=ends[1],
        limits=np.full((2, 6), np.inf),
    )
    free = np.abs(ends[1] @ solve(program))
    return qp.SegmentQP(**{**vars(program), "limits": limit * np.tile(free.max(axis=1)[:, None], 6)}), free


def optimum(program: qp.SegmentQP, column: int) -> np.ndarray:
    """The same optimum by SLSQP within the solutions of the equalities."""
    start = np.linalg.lstsq(program.equalities, program.values[:, column], rcond=None)[0]
    free = null_space(program.equalities)
    scaled = program.objective / np.trace(program.objective)
    h, g = free.T @ scaled @ free, free.T @ scaled @ start
    bound, limited = program.limits[:, column], program.limited

    def slack(z: np.ndarray) -> np.ndarray:
        value = limited @ (start + free @ z)
        return np.concatenate([bound - value, bound + value])

    both = np.concatenate([-limited @ free, limited @ free])
    result = minimize(
        lambda z: (0.5 * z @ h @ z + g @ z, h @ z + g),
        np.zeros(len(g)),
        jac=True,
        method="SLSQP",
        constraints={"type": "ineq", "fun": slack, "jac": lambda z: both},
        options={"maxiter": 500, "ftol": 1e-16},
    )
    assert_each(slack(result.x), ">=", -1e-8)
    return start + free @ result.x


@pytest.mark.parametrize("limit", [10.0, 0.9, 0.5, 0.2, 0.05])
def test_optimum_is_that_of_an_independent_solver(limit):
    program, free = join_program(limit)
    x = solve(program)
    assert np.any(free > program.limits) == (limit < 1)  # a limit binds, or none does
    assert_each(np.abs(program.equalities @ x - program.values), "<=", 1e-12)
    assert_each(np.abs(program.limited @ x), "<=", program.limits * (1 + 1e-12))
    cost = [0.5 * x[:, k] @ program.objective @ x[:, k] for k in range(6)]
    for k in range(6):
        other = optimum(program, k)
        assert cost[k] <= 0.5 * other @ program.objective @ other * (1 + 1e-6)
        np.testing.assert_allclose(x[:, k], other, rtol=0, atol=1e-6)


def test_programs_without_solution_have_none():
    program, _ = join_program(0.9)
    full = {**vars(program), "equalities": np.concatenate([program.equalities, program.limited])}
    pinned = np.concatenate([program.values, 2 * program.limits])  # what is limited must be twice the limit
    assert solve(qp.SegmentQP(**{**full, "values": pinned})) is None
    values = np.concatenate([program.values, 0.5 * program.limits])
    assert solve(qp.SegmentQP(**{**full, "values": values})) is not None


@pytest.mark.parametrize("field", ["objective", "equalities", "values"])
def test_a_nan_in_a_program_gives_no_solution(field):
    program, _ = join_program(10.0)
    spoilt = np.array(getattr(program, field))
    spoilt[2, 3] = np.nan
    assert solve(qp.SegmentQP(**{**vars(program), field: spoilt})) is None


@ORDERS
def test_the_counting_rule_is_that_of_trying_all_numbers(order):
    for intervals in range(1, 80):
        fits = [s for s in range(1, intervals + 1) if (order - 4) + (s - 1) * (order - 3) >= intervals]
        assert segments.fewest_segments(intervals, order) == fits[0]
        for count in fits[:4]:
            joints, platform = segments.split(intervals, count, order)
            for ends, closing in ((joints, -1), (platform, 0)):
                sizes = np.diff(ends)
                assert (ends[0], ends[-1], len(sizes), sizes.min() > 0) == (0, intervals, count, True)
                assert sizes[closing] <= order - 4
                assert sizes.max() <= order - 3


def test_platform_and_joints_share_the_equal_split_where_they_can():
    joints, platform = segments.split(17, 3, 12)
    np.testing.assert_array_equal(joints, [0, 6, 11, 17])
    np.testing.assert_array_equal(platform, joints)
    joints, platform = segments.split(26, 3, 12)
    np.testing.assert_array_equal(np.diff(joints), [9, 9, 8])
    np.testing.assert_array_equal(np.diff(platform), [8, 9, 9])


def test_segments_that_turn_too_far_for_one_chart_are_told():
    path = turning(list(range(0, 181, 20)))
    turns = np.tile(np.deg2rad([0, 0, 20.0]), (path.edges, 1))
    assert segments.charts_suffice(turns, np.array([0, 5, 9]))
    assert not segments.charts_suffice(turns, np.array([0, 1, 9]))
    assert segments.charts_suffice(np.array([[0, 0, 3.0]]), np.array([0, 1]))


def test_shares_of_time_follow_costs_but_for_the_least():
    np.testing.assert_array_equal(node_times.node_fractions(np.full(4, 0.3)), [0, 0.25, 0.5, 0.75, 1])
    np.testing.assert_allclose(node_times.node_fractions(np.array([1.0, 3.0])), [0, 0.25, 1], rtol=1e-15)
    shares = np.diff(node_times.node_fractions(np.array([1, 1, 0.0, 1, 1])))
    assert shares[2] == pytest.approx(0.1 * 0.8 / (4 + 0.08), rel=1e-12)  # a tenth of the mean cost


def test_shortest_duration_is_the_one_of_the_differences():
    """One axis with steps 1, 1, -1 in thirds of T: rates 3 / T, accelerations up to 6 / T over T / 3."""
    moves, fractions = np.array([[1.0], [1.0], [-1.0]]), np.linspace(0, 1, 4)
    by_rate = segments.shortest_duration(moves, fractions, np.array([0.1]), np.array([1e9]))
    by_acceleration = segments.shortest_duration(moves, fractions, np.array([1e9]), np.array([0.5]))
    assert by_rate == pytest.approx(30, rel=1e-12)
    assert by_acceleration == pytest.approx(np.sqrt(18 / 0.5), rel=1e-12)


def smooth(x: np.ndarray, k: int) -> np.ndarray:
    return np.stack([np.sin(5 * x + k), x**7 - 0.3 * k, np.exp(x) * np.cos(9 * x), np.zeros_like(x)], axis=-1)


def largest(values: np.ndarray) -> np.ndarray:
    return maxima.largest([values])[0]


def test_peaks_between_the_points_are_found():
    x = np.cos(np.pi * np.arange(65) / 64)
    found = largest(np.stack([smooth(x, k) for k in range(3)]))
    grid = np.linspace(-1, 1, 2001)
    for quantity in range(4):
        best = 0.0
        for k in range(3):

            def height(at: float, k: int = k, quantity: int = quantity) -> float:
                return -abs(smooth(np.asarray(at), k)[quantity])

            near = grid[np.argmax(np.abs(smooth(grid, k)[:, quantity]))]
            polished = minimize_scalar(
                height,
                bounds=(max(near - 1e-3, -1), min(near + 1e-3, 1)),
                method="bounded",
                options={"xatol": 1e-12},
            )
            best = max(best, -polished.fun, -height(near))
        assert found[quantity] == pytest.approx(best, rel=1e-9, abs=1e-15)


def test_of_two_pieces_whose_peaks_are_all_but_equal_the_higher_one_is_found():
    rng = np.random.default_rng(0)
    k, theta = np.arange(13), np.linspace(0, np.pi, 40_001)
    series = rng.normal(size=(2, 13, 200))
    series /= np.abs(np.cos(np.outer(theta, k)) @ series).max(axis=1, keepdims=True)
    series[rng.integers(0, 2, 200), :, np.arange(200)] *= 1 + 1e-4
    values = np.cos(np.pi * np.outer(k, k) / 12) @ series
    np.testing.assert_allclose(largest(values), 1 + 1e-4, rtol=1e-6)


def test_points_that_do_not_tell_what_is_between_them_are_found():
    def values(points: int, wave: float) -> np.ndarray:
        x = np.cos(np.pi * np.arange(points) / (points - 1))
        return np.stack([np.stack([np.cos(wave * x), np.zeros_like(x), x], axis=-1)] * 3)

    assert maxima.is_resolved(values(13, 0.5))
    assert not maxima.is_resolved(values(13, 9.0))
    odd = np.sin(9 * np.cos(np.pi * np.arange(13) / 12))[None, :, None]  # its last term is zero
    assert not maxima.is_resolved(odd)
    assert maxima.is_resolved(values(37, 9.0))
    few, many = (largest(values(points, 0.5)) for points in (13, 37))
    np.testing.assert_allclose(few, many, rtol=1e-10)


@pytest.mark.slow
def test_peaks_are_those_at_many_points_where_pieces_turn_far():
    craft = make_spacecraft()
    plan = fit_global(load("rrt_c1"), craft, TrajectorySettings(duration=80.0)).trajectory
    for factor in (1.0, 200.0, 1000.0):  # of the chart's rate: up to thirty turns in a piece
        curve = replace(plan, chart_rate=factor * plan.chart_rate)
        found = peaks.peaks(curve, craft).ratios[:6]
        samples = curve.sample(np.linspace(0, curve.duration, 200_000))
        seen = [np.abs(samples.angular_velocity), np.abs(samples.angular_acceleration)]
        limits = np.repeat([craft.rate_limit, craft.acceleration_limit], 3)
        least = np.concatenate([own.max(axis=0) for own in seen]) / limits
        assert_each(found, ">=", least * (1 - 1e-9))
        np.testing.assert_allclose(found, least, rtol=1e-4)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_peak_that_is_no_number_stays_none(value):
    values = np.ones((1000, 17, 4))
    values[700, 3, 1] = value
    np.testing.assert_array_equal(largest(values), np.nan)


def test_a_joint_beyond_its_range_between_nodes_is_told():
    fit = fit_stored("astar_c1", 3)
    reached = np.abs(fit.trajectory.sample(np.linspace(0, 80, 16_000)).joints).max(axis=0)[3:].max()
    for margin, inside in ((1e-6, True), (-1e-6, False)):
        craft = make_spacecraft()
        terminals = tuple(replace(t, yaw_limit=3.0, pitch_limit=reached + margin) for t in craft.terminals)
        assert peaks.peaks(fit.trajectory, replace(craft, terminals=terminals)).in_range == inside
