"""Find goals that keep what step 1 leaves open: oblique bounds of joints, and vectors that joints turn.

At a goal every joint is a function of the attitude, so all that is asked of a state is asked of three
numbers, the rotation vector ``eta`` of equation (2). Random attitudes around goals that break something show
where all of it holds, and by which entries. From the nearest of these, sequential quadratic programming
(SLSQP of scipy) goes to the least ``|eta|`` beside the same entries. It proves nothing: there may be a goal
that is nearer.

Here ``eta`` is the rotation vector from the start, rad, as in ``R = R0 exp(eta^)``.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.goal.problem import GoalProblem
from jaxplan.model.constraints import chosen_entries, constraint_margins
from jaxplan.model.path import Goal

TRIES = 4096
"""Random attitudes, shared out among the goals."""
WIDEST = np.deg2rad(60.0)
"""rad, the largest turn of a random attitude from the goal around which it is drawn."""
STARTS = 8
"""Number of random attitudes from which goals are looked for."""
STARTS_APART = np.deg2rad(8.0)
"""rad, the least turn between two of these."""
APART = np.deg2rad(2.0)
"""rad; goals closer than this count as one."""
SPARE = 2e-5
"""rad by which all is kept, but for half of it: a motion that ends there may swing a little on the way."""
_STEP = 1e-5  # rad, of central differences
_ITERATIONS = 60  # of SLSQP at most
_NEWTON = 6  # steps of Newton's method onto the equations; each squares the residual
_CHANGES = 4  # descents at most, each with the entries that hold best where the one before ended


def _equations(problem: GoalProblem, eta: np.ndarray) -> np.ndarray:
    """Residuals (..., e) rad, at ``eta`` (..., 3), of the e azimuths and elevations that are equations."""
    aims, attitudes = problem.aims, problem.start @ np.asarray(so3.exp(eta))
    off = np.stack(aims.angles(attitudes), axis=-1) - np.mean(aims.ranges, axis=-1)
    return off[..., np.array(aims.equations, bool).reshape(-1, 2)]


def _met(problem: GoalProblem, eta: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3) rad near ``eta`` (..., 3) at which all equations hold, by Newton's method."""
    for _ in range(_NEWTON if problem.aims.has_equations else 0):
        slopes = _slopes(lambda moved: _equations(problem, moved), eta)
        off = _equations(problem, eta)
        eta = eta - (np.linalg.pinv(slopes, rcond=1e-6) @ off[..., None])[..., 0]
    return eta


def _slopes(function: Callable[[np.ndarray], np.ndarray], eta: np.ndarray) -> np.ndarray:
    """Central differences (..., c, 3) of a function of ``eta`` (..., 3)."""
    steps = _STEP * np.eye(3)
    ahead, behind = (function(eta[..., None, :] + way * steps) for way in (1, -1))
    return np.swapaxes((ahead - behind) / (2 * _STEP), -1, -2)


def goals_beside(problem: GoalProblem, around: np.ndarray, max_slew: float, seed: int) -> list[Goal]:
    """Goals that keep all constraints, in the order of their slews.

    Args:
        problem: what is asked.
        around: (k, 3, 3) attitudes of goals that break some constraint, at least one.
        max_slew: rad, bound of ``|eta|``.
        seed: of the random attitudes.

    Returns:
        As many as were found, perhaps none, 2 deg or more apart.
    """
    tried = _met(problem, _around(problem.start, around, seed))
    left, margins = _spare(problem, tried)
    least = np.min(constraint_margins(problem.rows, margins), axis=-1)
    kept = (np.min(left, axis=-1, initial=np.inf) > 0) & (least > 0)
    found = []
    for number in _distinct(problem.start, tried[kept], STARTS_APART):
        eta = _nearest(problem, tried[kept][number])
        if eta is not None and np.linalg.norm(eta) <= max_slew:
            found.append(eta)
    etas = np.array(found).reshape(-1, 3)
    attitudes = problem.start @ np.asarray(so3.exp(etas))
    slews = np.asarray(so3.distance(problem.start, attitudes)).tolist()
    return [
        Goal(attitude=attitudes[number], joints=problem.joints(attitudes[number]), slew_angle=slews[number])
        for number in _distinct(problem.start, etas, APART)
    ]


def _spare(problem: GoalProblem, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is left of the ranges of aims, and the margins of all pairs, at ``eta`` (..., 3).

    Returns:
        (..., r) rad, distances of azimuths and elevations from the nearer ends of their r ranges, and margins
        (..., Z, S) rad; below zero where something is broken.
    """
    attitudes = problem.start @ np.asarray(so3.exp(eta))
    ranged = ~np.array(problem.aims.equations, bool).reshape(-1, 2)
    left = -problem.aims.excess(attitudes)[..., ranged]
    return left, problem.margins(attitudes, problem.joints(attitudes))


def _around(start: np.ndarray, around: np.ndarray, seed: int) -> np.ndarray:
    """Draw `TRIES` random attitudes, each up to `WIDEST` from one of some given ones.

    Args:
        start: (3, 3) attitude at the start.
        around: (k, 3, 3) the attitudes that they are drawn around.
        seed: of the draw.

    Returns:
        (TRIES, 3) rad, rotation vectors from the start.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    axes = rng.standard_normal((TRIES, 3))
    turns = rng.uniform(0, WIDEST, (TRIES, 1)) * axes / np.linalg.norm(axes, axis=-1, keepdims=True)
    centres = around[np.arange(TRIES) % len(around)]
    return np.asarray(so3.log(np.swapaxes(start[None], -1, -2) @ centres @ np.asarray(so3.exp(turns))))


def _distinct(start: np.ndarray, etas: np.ndarray, apart: float) -> list[int]:
    """Indices of the shortest of rotation vectors (k, 3) from the start, `STARTS` at most.

    Their attitudes are more than `apart` rad from each other; `start` is (3, 3).
    """
    attitudes, found = start @ np.asarray(so3.exp(etas)), list[int]()
    left = np.argsort(np.linalg.norm(etas, axis=-1), kind="stable")
    while len(left) and len(found) < STARTS:
        found.append(int(left[0]))
        left = left[so3.distance(attitudes[left[0]], attitudes[left]) > apart]
    return found


def _nearest(problem: GoalProblem, eta: np.ndarray) -> np.ndarray | None:
    """The shortest rotation vector (3,) that descents reach from one at which every constraint holds.

    Where another entry of a constraint holds best at the end of a descent, the next one starts there with it.
    None if the end breaks something.
    """
    before: np.ndarray | None = None
    for _ in range(_CHANGES):
        _, margins = _spare(problem, eta)
        best = chosen_entries(problem.rows, np.min(margins, axis=-1)) == problem.rows.entry
        which = problem.rows.bound & best[:, None]
        if before is not None and np.all(which == before):
            break
        eta, before = _met(problem, _descended(problem, eta, which)), which
    left, margins = _spare(problem, eta)
    least = np.min([*left, *constraint_margins(problem.rows, margins)])
    return eta if least >= SPARE / 2 else None


def _descended(problem: GoalProblem, eta: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Where SLSQP ends (3,) that minimises ``|eta|`` from ``eta`` (3,).

    It keeps the ranges and equations of the aims and the margins of the pairs in `which`, (Z, S) bool.
    """
    from scipy.optimize import minimize  # slow to import, and seldom needed

    def spare(eta: np.ndarray) -> np.ndarray:
        left, margins = _spare(problem, eta)
        return np.concatenate([left, margins[..., which]], axis=-1) - SPARE

    constraints: list[dict[str, Any]] = [
        {"type": "ineq", "fun": spare, "jac": lambda eta: _slopes(spare, eta)},
    ]
    if problem.aims.has_equations:
        equations = partial(_equations, problem)
        constraints.append({"type": "eq", "fun": equations, "jac": lambda eta: _slopes(equations, eta)})
    found = minimize(
        lambda eta: eta @ eta / 2,
        eta,
        jac=lambda eta: eta,
        method="SLSQP",
        constraints=constraints,
        options={"maxiter": _ITERATIONS, "ftol": 1e-14},
    )
    return np.asarray(found.x)
