"""Small quadratic programs that share their matrices and differ in their right-hand sides.

    minimise 1/2 x^T P x   subject to   A x = b,   -c <= G x <= c        (equations 23 and 47)

The axes of a segment do not couple, so each is a column: ``x`` is (p, d) for p unknowns on each of d axes,
``b`` is (r, d), ``c`` is (g, d). In most programs no limit is active. Their solution is that of a linear
system, exact to rounding, and where it keeps the limits it is the optimum. For the other columns OSQP finds
which limits are active, and a linear system gives the solution to full precision. The check at the end is
plain numpy and decides alone whether a solution is returned; a NaN does not pass it.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from jaxplan.trajectory.step_programs import inverses

_CHECK_TOLERANCE = 1e-11
_OSQP_SETTINGS = {
    "verbose": False,
    "eps_abs": 1e-9,
    "eps_rel": 1e-9,
    "eps_prim_inf": 1e-9,
    "max_iter": 4000,
    "polishing": True,
    "rho": 10.0,  # with the next two, at worst a tenth of the iterations of the default
    "adaptive_rho": 1,  # by number of iterations; by time, the same program could end differently
    "adaptive_rho_interval": 25,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class SegmentQP:
    """The data of one quadratic program; its d columns share the matrices.

    Attributes:
        objective: (p, p) ``P``, symmetric and positive semidefinite, definite where ``A x = 0``.
        equalities: (r, p) ``A``, of full row rank.
        values: (r, d) ``b``.
        limited: (g, p) ``G``; g may be 0.
        limits: (g, d) ``c``, positive.
    """

    objective: np.ndarray
    equalities: np.ndarray
    values: np.ndarray
    limited: np.ndarray
    limits: np.ndarray

    @property
    def kind(self) -> Hashable:
        """Sizes of the program; programs of equal kinds can be solved together."""
        return self.equalities.shape, self.limits.shape, self.values.shape


def solve_all(programs: Sequence[SegmentQP]) -> list[np.ndarray | None]:
    """Solve programs of one kind, and check the solutions.

    Args:
        programs: each with d columns.

    Returns:
        For each its optimum (p, d), in the same order; None if a column has no solution, or none that passes
        the check.
    """
    objective, rows, values, limited, limits = (
        np.stack([getattr(program, name) for program in programs])
        for name in ("objective", "equalities", "values", "limited", "limits")
    )
    x = _solve_equality_qps(objective, rows, values)[0]
    beyond = np.any(~(np.abs(limited @ x) <= limits), axis=(1, 2)) & np.all(np.isfinite(x), axis=(1, 2))
    solved = np.ones(len(programs), dtype=bool)
    for number in np.flatnonzero(beyond).tolist():
        solved[number] = _hold_limits(programs[number], x[number])
    size = 1 + np.abs(values).max(axis=1, initial=0.0)[:, None]
    solved &= np.all(np.abs(rows @ x - values) <= _CHECK_TOLERANCE * size, axis=(1, 2))
    solved &= np.all(np.abs(limited @ x) <= limits + _CHECK_TOLERANCE * size, axis=(1, 2))
    return [own if good else None for own, good in zip(x, solved, strict=True)]


def _hold_limits(program: SegmentQP, x: np.ndarray) -> bool:
    """Replace columns of ``x``, in place, that exceed a limit by the optimum within the limits.

    Args:
        program: the program.
        x: (p, d) solution without limits, of p unknowns on each of d axes.

    Returns:
        Whether that succeeded for all of these columns.
    """
    for column in np.flatnonzero(~np.all(np.abs(program.limited @ x) <= program.limits, axis=0)):
        side = _find_active_sides(program, int(column))
        if side is None:
            return False
        active = side != 0
        rows = np.concatenate([program.equalities, program.limited[active]])
        bounds = side[active] * program.limits[active, column]
        wanted = np.concatenate([program.values[:, column], bounds])
        answer, multipliers = _solve_equality_qps(program.objective[None], rows[None], wanted[None, :, None])
        if not np.all(multipliers[0, len(program.equalities) :, 0] * bounds >= -_CHECK_TOLERANCE):
            return False  # a limit that pulls is not active: this is no optimum
        x[:, column] = answer[0, :, 0]
    return True


def _solve_equality_qps(
    objectives: np.ndarray, rows: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Minimisers ``x`` under equalities alone, and multipliers ``y``: ``P x + A^T y = 0``, ``A x = b``.

    Args:
        objectives: (N, p, p) ``P`` of N programs.
        rows: (N, r, p) ``A``.
        values: (N, r, d) ``b``.

    Returns:
        ``x`` (N, p, d) and ``y`` (N, r, d); NaN where there is no unique solution.
    """
    count, held, unknowns = rows.shape
    system = np.zeros((count, unknowns + held, unknowns + held))
    system[:, :unknowns, :unknowns] = objectives
    system[:, unknowns:, :unknowns] = rows
    system[:, :unknowns, unknowns:] = np.swapaxes(rows, 1, 2)
    right = np.concatenate([np.zeros((count, unknowns, values.shape[2])), values], axis=1)
    inverse = inverses(system)
    solution = inverse @ right
    solution += inverse @ (right - system @ solution)  # the step that brings the residual to rounding
    return solution[:, :unknowns], solution[:, unknowns:]


def _find_active_sides(program: SegmentQP, column: int) -> np.ndarray | None:
    """Find which limits are active for one column, by OSQP.

    A solution that OSQP calls inaccurate is used, too; if its limits are wrong, the caller's check fails.

    Returns:
        (g,) 1 where the upper limit is active, -1 where the lower one is, 0 where none is; None if there is
        no solution.
    """
    import osqp
    from scipy import sparse

    values, limits = program.values[:, column], program.limits[:, column]
    solver = osqp.OSQP()
    solver.setup(
        P=sparse.csc_matrix(np.triu(program.objective)),
        q=np.zeros(len(program.objective)),
        A=sparse.csc_matrix(np.concatenate([program.equalities, program.limited])),
        l=np.concatenate([values, -limits]),
        u=np.concatenate([values, limits]),
        **_OSQP_SETTINGS,
    )
    result = solver.solve(raise_error=False)
    if result.x is None or not np.all(np.isfinite(result.x)):  # infeasible
        return None
    multipliers = result.y[len(values) :]
    gaps = limits - np.abs(program.limited @ result.x)
    return np.where(gaps < np.abs(multipliers), np.sign(multipliers), 0.0)
