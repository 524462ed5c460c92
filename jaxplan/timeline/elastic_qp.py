"""Solve a quadratic program whose inequalities may be violated, each at its own price.

Most rows never bind, so the program begins without any; those that its step violates are added until the step
violates no other row.
"""

import numpy as np

from jaxplan.trajectory.interior_point import BoxQP, solve_box_qps

_MAX_ROUNDS = 12  # most rounds in which rows are added
_ROW_TOLERANCE = 1e-9  # rad, by which a row may be violated and still counts as kept
_MIN_ROW_NORM = 1e-9  # norm of a row below which it is ignored, since no step changes its value


def priced_step(
    hessian: np.ndarray, pull: np.ndarray, rows: np.ndarray, slack: np.ndarray, price: np.ndarray
) -> np.ndarray:
    """Return the step ``x`` that minimizes ``x H x / 2 + p x`` plus the price of rows violated.

    Row i asks for ``B_i x + s_i >= 0``; violating it by ``v`` costs ``price_i * v``.

    Args:
        hessian: ``H`` (y, y), positive definite.
        pull: ``p`` (y,).
        rows: ``B`` (b, y).
        slack: ``s`` (b,) rad.
        price: (b,) 1/rad.

    Returns:
        The step (y,).
    """
    inverse = np.linalg.inv(hessian)
    free = -inverse @ pull
    found, taken = free, np.zeros(len(slack), bool)
    can_help = np.linalg.norm(rows, axis=1) > _MIN_ROW_NORM
    for _ in range(_MAX_ROUNDS):
        broken = can_help & ~taken & (rows @ found + slack < -_ROW_TOLERANCE)
        if not np.any(broken):
            break
        taken |= broken
        own = rows[taken]
        turned = own @ inverse
        program = BoxQP(
            matrix=turned @ own.T,
            linear=-(own @ free) - slack[taken],
            penalty=price[taken],
        )
        multipliers = solve_box_qps([program])[0].multipliers
        if not np.all(np.isfinite(multipliers)):
            break
        found = free + turned.T @ multipliers
    return np.asarray(found)
