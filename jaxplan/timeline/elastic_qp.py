"""A step of least energy that keeps rows where it can: a quadratic program with a price for each.

Most rows never bind, so a program begins without any, and those that its step breaks are added until none is.
"""

import numpy as np

from jaxplan.trajectory.qp import BoxQP, solve_box_qps

_ROUNDS = 12  # in which rows are added
_KEPT = 1e-9  # rad, by which a row may be broken and count as kept
_FLAT = 1e-9  # size of a row below which no step changes it


def priced_step(
    hessian: np.ndarray, pull: np.ndarray, rows: np.ndarray, slack: np.ndarray, price: np.ndarray
) -> np.ndarray:
    """The step (y,) least in ``y H y / 2 + p y`` with ``B y + s >= 0``, where rows may be broken at a price.

    Args:
        hessian: (y, y).
        pull: (y,).
        rows: (b, y).
        slack: (b,) rad.
        price: (b,) 1/rad, of breaking each.
    """
    inverse = np.linalg.inv(hessian)
    free = -inverse @ pull
    found, taken = free, np.zeros(len(slack), bool)
    can_help = np.linalg.norm(rows, axis=1) > _FLAT
    for _ in range(_ROUNDS):
        broken = can_help & ~taken & (rows @ found + slack < -_KEPT)
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
