import numpy as np
import pytest
from pointing import Printed, Problem, random_problem
from reference import assert_each
from scipy.optimize import linprog, minimize
from scipy.spatial.transform import Rotation

from jaxplan.goal import descent, multistart
from jaxplan.goal.caps import HAIR, Caps, GoalProblem, assemble, group_excess


def caps_of(problem: Problem) -> Caps:
    return assemble(GoalProblem.of(problem.spacecraft, problem.start, problem.targets, problem.cones))


def test_caps_ask_for_what_joints_and_zones_ask_for():
    rng, broken, clear = np.random.default_rng(1), 0, 0
    for seed in range(40):
        problem = random_problem(seed)
        caps, printed, count = caps_of(problem), Printed(problem), len(problem.spacecraft.terminals)
        turns = Rotation.random(50, rng=rng)
        inside = np.stack([caps.excess(rotation) for rotation in turns.as_matrix()], axis=1)
        worst = np.max(group_excess(inside, caps.member, caps.group), axis=0)
        margins = np.array([np.delete(printed.margins(eta)[0], 4 * count) for eta in turns.as_rotvec()])
        least = np.min(margins, axis=1)
        np.testing.assert_array_equal(worst <= HAIR, least >= 0)
        clear += np.sum(least >= 0)
        if count == 0:
            np.testing.assert_allclose(worst[least < 0] - HAIR, -least[least < 0], atol=1e-12, rtol=0)
            broken += np.sum(least < 0)
    assert min(broken, clear) >= 20


def test_every_attitude_is_near_a_point_of_the_covering():
    points = multistart.covering_points(0)
    attitudes = Rotation.random(4000, rng=np.random.default_rng(5)).as_quat(scalar_first=True)
    assert 2 * np.arccos(np.abs(attitudes @ points.T).max(axis=1).min()) <= multistart.RADIUS
    assert_each(np.diff(points[:, 0]), "<=", 0)
    np.testing.assert_array_equal(points[0], [1, 0, 0, 0])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_points_near_half_a_turn_are_there_on_both_sides(seed):
    scalar = multistart.covering_points(seed)[:, 0]
    near = np.abs(scalar) <= np.sin(multistart.RADIUS / 2)
    assert np.sum(near & (scalar < 0)) == np.sum(near & (scalar > 0))


def test_no_point_near_a_solution_is_ruled_out():
    ruled_out = 0
    for seed in (0, 1, 2, 10, 11, 12):  # three terminals, so of one padded size
        problem = random_problem(seed)
        depths = multistart.depths(caps_of(problem), 0)
        for goal in problem.decompose().goals:
            solution = Rotation.from_matrix(problem.start.T @ goal.attitude).as_quat(scalar_first=True)
            distance = 2 * np.arccos(np.minimum(np.abs(multistart.covering_points(0) @ solution), 1))
            assert np.any(distance <= multistart.RADIUS)
            assert_each(depths[distance <= multistart.RADIUS], "<=", 1e-6)
        ruled_out += np.sum(depths > 0)
    assert ruled_out > multistart.POINTS


def test_quadratic_programs_are_solved_or_said_to_have_no_solution():
    rng = np.random.default_rng(4)
    count, rows = 60, 24
    factor = rng.standard_normal((count, 3, 3))
    hessian = factor @ np.swapaxes(factor, 1, 2) + 0.1 * np.eye(3)
    gradient = rng.standard_normal((count, 3))
    gradients = rng.standard_normal((count, rows, 3))
    excess = rng.standard_normal((count, rows)) * 0.5 - np.where(np.arange(count) % 3, 1.2, 0.3)[:, None]
    gradients[:, 1], excess[:, 1] = gradients[:, 0], excess[:, 0]  # one constraint twice
    found, active, lost = descent.solve(
        np.moveaxis(np.linalg.inv(hessian), 0, -1),
        gradient.T,
        np.moveaxis(gradients, (0, 2), (-1, 0)),
        excess.T,
    )
    found, lost = np.asarray(found).T, np.asarray(lost)
    assert 5 <= np.sum(lost) <= count - 20
    for k in range(count):
        possible = linprog(np.zeros(3), gradients[k], -excess[k], bounds=[(None, None)] * 3).status == 0
        assert lost[k] != possible
        if not possible:
            continue
        reference = minimize(
            lambda d, k=k: gradient[k] @ d + d @ hessian[k] @ d / 2,
            np.zeros(3),
            jac=lambda d, k=k: gradient[k] + hessian[k] @ d,
            method="SLSQP",
            constraints={
                "type": "ineq",
                "fun": lambda d, k=k: -excess[k] - gradients[k] @ d,
                "jac": lambda d, k=k: -gradients[k],
            },
            options={"ftol": 1e-15, "maxiter": 500},
        ).x
        np.testing.assert_allclose(found[k], reference, atol=1e-6)
        number, multiplier = np.asarray(active.number)[:, k], np.asarray(active.multiplier)[:, k]
        assert_each(multiplier, ">=", 0)
        pull = multiplier[number >= 0] @ gradients[k][number[number >= 0]]
        np.testing.assert_allclose(gradient[k] + hessian[k] @ found[k] + pull, 0, atol=1e-10)
        assert_each(excess[k] + gradients[k] @ found[k], "<=", 1e-12)


def test_restoration_is_the_least_squares_step_to_the_violated_bounds():
    rng = np.random.default_rng(6)
    gradients, excess = rng.standard_normal((8, 3)), rng.standard_normal(8)
    matrix, pull = (
        np.asarray(part)[..., 0] for part in descent.restoration(gradients.T[:, :, None], excess[:, None])
    )
    found = -np.linalg.solve(matrix, pull)
    violated = excess > 0
    expected = np.linalg.lstsq(gradients[violated], -excess[violated])[0]
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_algebra_of_lanes_is_that_of_numpy():
    rng = np.random.default_rng(2)
    factor = rng.standard_normal((50, 3, 3))
    matrices = factor + np.swapaxes(factor, 1, 2)
    matrices[0], matrices[1] = np.eye(3), np.diag([2.0, 2.0, -1.0])
    vectors = rng.standard_normal((50, 3))
    lane_matrices = np.moveaxis(matrices, 0, -1)
    least = np.asarray(descent.least_eigenvalue(lane_matrices))
    np.testing.assert_allclose(least, np.linalg.eigvalsh(matrices)[:, 0], atol=1e-7)
    inverse = np.moveaxis(np.asarray(descent.inverse(lane_matrices)), -1, 0)
    np.testing.assert_allclose(inverse @ matrices, np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-10)
    product = np.asarray(descent.apply(lane_matrices, vectors.T)).T
    np.testing.assert_allclose(product, np.einsum("kij,kj->ki", matrices, vectors), atol=1e-13)
    squares = np.asarray(descent.sum_of_squares(np.moveaxis(factor, 0, -1)))
    np.testing.assert_allclose(np.moveaxis(squares, -1, 0), factor @ np.swapaxes(factor, 1, 2), atol=1e-13)
