"""Small quadratic programs that share their matrices and differ in their right-hand sides.

    minimise 1/2 x^T P x   subject to   A x = b,   -c <= G x <= c        (equations 23 and 47)

The axes of a segment do not couple, so each is a column: ``x`` is (p, d), ``b`` is (r, d), ``c`` is (g, d).
Most programs have no active limit. Their answer is that of a linear system, exact to rounding, and where it
keeps the limits it is the optimum. For the other columns OSQP finds which limits are active, and the digits
come from a linear system again. The check at the end is plain numpy and decides alone whether an answer is
given; a NaN does not pass it.
"""

from dataclasses import dataclass

import numpy as np

_TOLERANCE = 1e-11
_OSQP_SETTINGS = {
    "verbose": False,
    "eps_abs": 1e-9,
    "eps_rel": 1e-9,
    "eps_prim_inf": 1e-9,
    "max_iter": 4000,
    "polishing": True,
    "rho": 10.0,  # with the next two, a tenth of the iterations that the default takes at worst
    "adaptive_rho": 1,  # by iterations: by time, the same program could end differently
    "adaptive_rho_interval": 25,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Program:
    """The data of one program, or of several with the same matrices.

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


def solve(program: Program) -> np.ndarray | None:
    """The optimum, checked.

    Args:
        program: with d columns.

    Returns:
        (p, d); None if a column has no solution, or none that passes the check.
    """
    x = _minimiser(program.objective, program.equalities, program.values)[0]
    if not np.all(np.isfinite(x)):
        return None
    for column in np.flatnonzero(~np.all(np.abs(program.limited @ x) <= program.limits, axis=0)):
        side = _active_sides(program, int(column))
        if side is None:
            return None
        active = side != 0
        rows = np.concatenate([program.equalities, program.limited[active]])
        bounds = side[active] * program.limits[active, column]
        answer, multipliers = _minimiser(
            program.objective, rows, np.concatenate([program.values[:, column], bounds])[:, None]
        )
        if not np.all(multipliers[len(program.equalities) :, 0] * bounds >= -_TOLERANCE):
            return None  # a limit that pulls is not active: this is no optimum
        x[:, column] = answer[:, 0]
    size = 1 + np.abs(program.values).max(axis=0, initial=0.0)
    passes = np.all(np.abs(program.equalities @ x - program.values) <= _TOLERANCE * size)
    keeps = np.all(np.abs(program.limited @ x) <= program.limits + _TOLERANCE * size)
    return x if passes and keeps else None


def _minimiser(objective: np.ndarray, rows: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Minimiser under equalities alone, and their multipliers: ``P x + A^T y = 0``, ``A x = b``."""
    unknowns = len(objective)
    system = np.block([[objective, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    right = np.concatenate([np.zeros((unknowns, values.shape[1])), values])
    try:
        inverse = np.linalg.inv(system)
    except np.linalg.LinAlgError:
        failed = np.full_like(right, np.nan)
        return failed[:unknowns], failed[unknowns:]
    solution = inverse @ right
    solution += inverse @ (right - system @ solution)  # the step that brings the residual to rounding
    return solution[:unknowns], solution[unknowns:]


def _active_sides(program: Program, column: int) -> np.ndarray | None:
    """For one column, which limits are active: (g,) of -1, 0 and 1; None if there is no solution.

    An answer that OSQP calls inaccurate still tells; if it tells wrong, the caller's check fails.
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
