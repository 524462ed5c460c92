"""The three solvers of quadratic programs against engines that share nothing with them.

box            of the method "global":    OSQP
limited axes   of the method "paper":     nonnegative least squares, by Lawson and Hanson's duality
three unknowns of the decomposition:      likewise, and it tells which have no solution, too
"""

import jax
import numpy as np
import osqp
from reference import assert_each
from scipy import sparse
from scipy.linalg import null_space
from scipy.optimize import nnls

from jaxplan.goal import descent
from jaxplan.paper.qp import SegmentQP, solve_all
from jaxplan.trajectory.interior_point import BoxQP, solve_box_qps

TOLERANCE = 1e-6  # of the objective, relative to its size
EPSILON = 1e-7  # a least squares residual below counts as none
ROWS = 24


def least_distance(
    hessian: np.ndarray, gradient: np.ndarray, rows: np.ndarray, bounds: np.ndarray
) -> np.ndarray | None:
    """Minimiser of ``x H x / 2 + g x`` with ``rows x <= bounds`` by nonnegative least squares; None for none.

    With ``H = L L^T`` and ``u = L^T x + L^-1 g`` it is the point nearest to zero in a polyhedron (Lawson and
    Hanson, 1974, chapter 23).
    """
    factor = np.linalg.cholesky(hessian)
    offset = np.linalg.solve(factor, gradient)
    slopes = np.linalg.solve(factor, rows.T).T
    low = -(bounds + slopes @ offset)  # -slopes u >= low
    size = np.maximum(np.linalg.norm(slopes, axis=1), np.abs(low))
    system = np.vstack([(-slopes / size[:, None]).T, low / size])
    target = np.zeros(len(system))
    target[-1] = 1
    weights, residual = nnls(system, target, maxiter=100 * len(bounds))
    if residual <= EPSILON:
        return None
    left = system @ weights - target
    return np.linalg.solve(factor.T, -left[:-1] / left[-1] - offset)


def box(seed: int) -> str:
    """A program in a box, perhaps with dependent rows."""
    rng = np.random.default_rng([seed, 0])
    rank = int(rng.choice([6, ROWS, 2 * ROWS]))
    factor = rng.normal(size=(rank, ROWS)) * 10.0 ** rng.uniform(-1, 1, ROWS)
    matrix, linear = factor.T @ factor, factor.T @ rng.normal(size=rank)
    top = np.full(ROWS, 1e2) if rng.random() < 0.5 else 10.0 ** rng.uniform(-3, 1, ROWS)
    (answer,) = solve_box_qps([BoxQP(matrix, linear, top)])
    assert_each(answer.multipliers, ">=", 0)
    assert_each(answer.multipliers, "<=", top)
    engine = osqp.OSQP()
    engine.setup(
        sparse.csc_matrix(np.triu(matrix)),
        -linear,
        sparse.identity(ROWS, format="csc"),
        np.zeros(ROWS),
        top,
        verbose=False,
        eps_abs=1e-10,
        eps_rel=1e-10,
        max_iter=50_000,
    )
    other = np.clip(engine.solve().x, 0, top)

    def cost(y: np.ndarray) -> float:
        return float(y @ matrix @ y / 2 - linear @ y)

    assert cost(answer.multipliers) <= cost(other) + TOLERANCE * (1 + abs(cost(other)))
    bound = answer.multipliers >= 0.999 * top
    return "at the penalty" if np.any(bound) else "inside"


def limited(seed: int) -> str:
    """A program whose columns share their matrices; those without a solution are said to have none."""
    rng = np.random.default_rng([seed, 1])
    unknowns, equal, rows, columns = 12, int(rng.integers(2, 8)), int(rng.integers(1, 10)), 3
    factor = rng.normal(size=(unknowns, unknowns))
    equalities, limits = rng.normal(size=(equal, unknowns)), rng.normal(size=(rows, unknowns))
    program = SegmentQP(
        objective=factor @ factor.T + 1e-2 * np.eye(unknowns),
        equalities=equalities,
        values=rng.normal(size=(equal, columns)),
        limited=limits,
        limits=rng.uniform(0.2, 3.0, (rows, columns)),
    )
    (found,), free = solve_all([program]), null_space(equalities)
    fixed = np.linalg.lstsq(equalities, program.values, rcond=None)[0]
    both, expected = np.vstack([limits, -limits]) @ free, []
    for column in range(columns):
        passed = limits @ fixed[:, column]
        bounds = np.concatenate([program.limits[:, column] - passed, program.limits[:, column] + passed])
        hessian = free.T @ program.objective @ free
        best = least_distance(hessian, free.T @ program.objective @ fixed[:, column], both, bounds)
        expected.append(None if best is None else fixed[:, column] + free @ best)
    impossible = any(one is None for one in expected)
    assert (found is None) == impossible, f"solved: {found is not None}, possible: {not impossible}"
    if found is None:
        return "without solution"
    for column, other in enumerate(expected):
        own = found[:, column]
        assert_each(np.abs(limits @ own), "<=", program.limits[:, column] + 1e-9)
        np.testing.assert_allclose(equalities @ own, program.values[:, column], rtol=1e-5, atol=1e-9)
        costs = [x @ program.objective @ x / 2 for x in (own, other)]
        assert abs(costs[0] - costs[1]) <= TOLERANCE * (1 + costs[1]), costs
    return "solved"


LANES = 32


_solve = jax.jit(descent.solve)


def three(seed: int) -> list[str]:
    """Programs of the decomposition, several at once."""
    rng = np.random.default_rng([seed, 2])
    factor = rng.normal(size=(LANES, 3, 3))
    hessian = factor @ np.swapaxes(factor, 1, 2) + 0.1 * np.eye(3)
    gradient, gradients = rng.normal(size=(LANES, 3)), rng.normal(size=(LANES, ROWS, 3))
    excess = 0.5 * rng.normal(size=(LANES, ROWS)) - rng.choice([0.3, 1.2], size=(LANES, 1))
    with jax.enable_x64(True):
        moves, _, lost = _solve(
            np.moveaxis(np.linalg.inv(hessian), 0, -1),
            gradient.T,
            np.moveaxis(gradients, (0, 2), (-1, 0)),
            excess.T,
        )
        moves, lost = np.asarray(moves), np.asarray(lost)
    words = []
    for k in range(LANES):
        best = least_distance(hessian[k], gradient[k], gradients[k], -excess[k])
        assert bool(lost[k]) == (best is None), f"lane {k}"
        words.append("without solution" if best is None else "solved")
        if best is not None:
            own = moves[:, k]
            costs = [gradient[k] @ d + d @ hessian[k] @ d / 2 for d in (own, best)]
            assert np.max(excess[k] + gradients[k] @ own) <= 1e-9
            assert abs(costs[0] - costs[1]) <= TOLERANCE * (1 + abs(costs[1])), f"lane {k}: {costs}"
    return words
