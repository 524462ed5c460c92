"""Find goals that keep what step 1 leaves open: oblique bounds of joints, and vectors that joints turn.

At a goal every joint is a function of the attitude, so every demand on a state is one on three numbers, the
rotation vector ``eta`` of equation (2), rad, from the start: ``R = R0 exp(eta^)``. Random attitudes around
goals that break something, or else everywhere, show where all constraints hold, and by which entries. From
the nearest of these, sequential quadratic programming (SLSQP of scipy) goes to the least ``|eta|`` while it
keeps the same entries; wishes come before that, one after the other. It proves nothing: there may be a goal
that is nearer. What concerns a device without a target is left aside until the attitude is found, since the
device makes way (`jaxplan.goal.free_devices`).
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.goal.free_devices import settled
from jaxplan.goal.problem import GoalProblem
from jaxplan.model.constraints import SIGHT, chosen_entries, constraint_margins
from jaxplan.model.path import Goal

TRIES = 4096
"""Random attitudes, shared out among the goals."""
WIDEST = np.deg2rad(60.0)
"""rad, the largest turn of a random attitude from the goal around which it is drawn. It is half a turn where
none of them keeps everything."""
STARTS = 8
"""Number of random attitudes from which goals are looked for."""
STARTS_APART = np.deg2rad(8.0)
"""rad, the least turn between two of these."""
APART = np.deg2rad(2.0)
"""rad; goals closer than this count as one."""
SPARE = 2e-5
"""rad by which all is kept, but for half of it: a motion that ends there may swing a little on the way."""
AS_NEAR = 1e-6
"""rad; goals whose distances to a wish differ by less are as near to it."""
_STARTS_AS_NEAR = np.deg2rad(1.0)
"""rad; starts whose distances to a wish differ by less are as near to it."""
_DIFFERENCE_STEP = 1e-5  # rad, step of central differences
_MAX_SLSQP_ITERATIONS = 60  # most iterations of SLSQP
_NEWTON_STEPS = 6  # steps of Newton's method onto the equations; each squares the residual
_MAX_DESCENTS = 4  # descents at most, each with the entries that hold best where the one before ended


def _equation_residuals(problem: GoalProblem, eta: np.ndarray) -> np.ndarray:
    """Return how far the e equations of azimuth and elevation are off at ``eta`` (..., 3), (..., e) rad."""
    aims, attitudes = problem.aims, problem.start @ np.asarray(so3.exp(eta))
    off = np.stack(aims.angles(attitudes), axis=-1) - np.mean(aims.ranges, axis=-1)
    return off[..., np.array(aims.equations, bool).reshape(-1, 2)]


def _solve_equations(problem: GoalProblem, eta: np.ndarray) -> np.ndarray:
    """Return rotation vectors (..., 3) rad near ``eta`` (..., 3) at which all equations hold.

    They are found by a few steps of Newton's method.
    """
    for _ in range(_NEWTON_STEPS if problem.aims.has_equations else 0):
        slopes = _central_differences(lambda moved: _equation_residuals(problem, moved), eta)
        off = _equation_residuals(problem, eta)
        eta = eta - (np.linalg.pinv(slopes, rcond=1e-6) @ off[..., None])[..., 0]
    return eta


def _central_differences(function: Callable[[np.ndarray], np.ndarray], eta: np.ndarray) -> np.ndarray:
    """Return central differences (..., c, 3) of a function of ``eta`` (..., 3) with c values."""
    steps = _DIFFERENCE_STEP * np.eye(3)
    ahead, behind = (function(eta[..., None, :] + way * steps) for way in (1, -1))
    return np.swapaxes((ahead - behind) / (2 * _DIFFERENCE_STEP), -1, -2)


def goals_beside(problem: GoalProblem, around: np.ndarray, max_slew: float, seed: int) -> list[Goal]:
    """Find goals that keep all constraints, by rising slew.

    Args:
        problem: the problem of step 1.
        around: (k, 3, 3) attitudes of k goals that break some constraint, body to inertial, at least one.
        max_slew: rad, bound of ``|eta|``.
        seed: seed of the random attitudes.

    Returns:
        As many as were found, perhaps none, 2 deg or more apart; with wishes, those nearest to these come
        first.
    """
    for widest in (WIDEST, np.pi):
        tried = _solve_equations(problem, _draw_around(problem.start, around, widest, seed))
        left, margins = _aim_and_pair_margins(problem, tried)
        least = np.min(constraint_margins(problem.rows, margins), axis=-1)
        tried = tried[(np.min(left, axis=-1, initial=np.inf) > 0) & (least > 0)]
        if len(tried):
            break
    found = []
    for number in _pick_distinct(problem, tried, STARTS_APART, _STARTS_AS_NEAR):
        eta = _find_local_minimum(problem, tried[number])
        if eta is not None and np.linalg.norm(eta) <= max_slew:
            found.append(eta)
    etas = np.array(found).reshape(-1, 3)
    return [_make_goal(problem, etas[number]) for number in _pick_distinct(problem, etas, APART, AS_NEAR)]


def _make_goal(problem: GoalProblem, eta: np.ndarray) -> Goal:
    """Return the goal at a rotation vector (3,) rad, with free devices where they prefer to be."""
    attitude = problem.start @ np.asarray(so3.exp(eta))
    joints, _ = settled(problem, attitude, problem.joints(attitude))
    slew = float(so3.distance(problem.start, attitude))
    return Goal(attitude=attitude, joints=joints, slew_angle=slew)


def beyond(problem: GoalProblem, attitudes: np.ndarray, as_near: float = AS_NEAR) -> np.ndarray:
    """Return how much farther than its reach each of w wishes is, at attitudes (..., 3, 3), body to inertial.

    Returns:
        (..., w) whole multiples of `as_near` rad, zero within reach.
    """
    wishes = problem.wishes
    off = [np.round(np.maximum(one.distance(attitudes) - one.reach, 0) / as_near) for one in wishes]
    return np.stack(off, axis=-1) if wishes else np.zeros((*attitudes.shape[:-2], 0))


def _aim_and_pair_margins(problem: GoalProblem, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how far aims are inside their ranges, and the margins of all pairs, at ``eta`` (..., 3).

    Returns:
        (..., r) rad, distances of azimuths and elevations from the nearer ends of their r ranges; and margins
        (..., Z, S) rad of the pairs of Z rows and S sights. Both are negative where something is broken;
        margins are infinite where a free device can make way.
    """
    attitudes = problem.start @ np.asarray(so3.exp(eta))
    ranged = ~np.array(problem.aims.equations, bool).reshape(-1, 2)
    left = -problem.aims.excess(attitudes)[..., ranged]
    margins = problem.margins(attitudes, problem.joints(attitudes))
    return left, np.where(_pairs_of_free_devices(problem), np.inf, margins)


def _pairs_of_free_devices(problem: GoalProblem) -> np.ndarray:
    """Tell in which pairs a free device carries the sight, or the sight that is the row's axis.

    The result is (Z, S) bool, Z rows by S sights.
    """
    rows, sights = problem.rows, problem.sights
    free = np.isin(sights.carriers, problem.aims.free(problem.spacecraft.gimbals))
    return free | ((rows.frame == SIGHT) & free[rows.partner])[:, None]


def _draw_around(start: np.ndarray, around: np.ndarray, widest: float, seed: int) -> np.ndarray:
    """Draw `TRIES` random attitudes, each up to `widest` rad from one of the given ones.

    Args:
        start: (3, 3) attitude at the start, body to inertial.
        around: (k, 3, 3) the k attitudes to draw around.
        widest: rad, largest rotation from these.
        seed: seed of the draw.

    Returns:
        (TRIES, 3) rad, rotation vectors from the start.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    axes = rng.standard_normal((TRIES, 3))
    turns = rng.uniform(0, widest, (TRIES, 1)) * axes / np.linalg.norm(axes, axis=-1, keepdims=True)
    centres = around[np.arange(TRIES) % len(around)]
    return np.asarray(so3.log(np.swapaxes(start[None], -1, -2) @ centres @ np.asarray(so3.exp(turns))))


def _pick_distinct(problem: GoalProblem, etas: np.ndarray, apart: float, as_near: float) -> list[int]:
    """Return the indices of the best of k rotation vectors (k, 3) rad from the start, `STARTS` at most.

    The best are those nearest to the wishes, see `beyond`, and among equals the shortest. Their attitudes are
    more than `apart` rad from each other; wishes closer than `as_near` rad count as equally near.
    """
    attitudes, found = problem.start @ np.asarray(so3.exp(etas)), list[int]()
    off = beyond(problem, attitudes, as_near)
    left = np.lexsort([np.linalg.norm(etas, axis=-1), *off.T[::-1]])
    while len(left) and len(found) < STARTS:
        found.append(int(left[0]))
        left = left[so3.distance(attitudes[left[0]], attitudes[left]) > apart]
    return found


def _find_local_minimum(problem: GoalProblem, eta: np.ndarray) -> np.ndarray | None:
    """Find a local minimum of the rotation angle near a feasible rotation.

    Of a constraint with alternatives (`any_of`) the one that holds best is kept while the angle is minimised;
    where another one holds best at the end, it is minimised again with that one.

    Args:
        problem: with the constraints.
        eta: (3,) rad, a rotation vector from the start at which every constraint holds.

    Returns:
        The rotation vector (3,) rad; None if a constraint does not hold there.
    """
    before: np.ndarray | None = None
    for _ in range(_MAX_DESCENTS):
        _, margins = _aim_and_pair_margins(problem, eta)
        best = chosen_entries(problem.rows, np.min(margins, axis=-1)) == problem.rows.entry
        which = problem.rows.bound & best[:, None] & ~_pairs_of_free_devices(problem)
        if before is not None and np.all(which == before):
            break
        eta, before = _solve_equations(problem, _run_slsqp(problem, eta, which)), which
    left, margins = _aim_and_pair_margins(problem, eta)
    least = np.min([*left, *constraint_margins(problem.rows, margins)])
    return eta if least >= SPARE / 2 else None


def _run_slsqp(problem: GoalProblem, eta: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Bring wishes near, one after the other, then minimise ``|eta|``; return where SLSQP ends, (3,) rad.

    It starts at ``eta`` (3,) and keeps the ranges and equations of the aims, and the margins of the pairs in
    `which`, a mask of Z rows by S sights.
    """
    from scipy.optimize import minimize  # slow to import, and seldom needed

    reaches = list[float]()

    def distance(number: int, eta: np.ndarray) -> np.ndarray:
        return problem.wishes[number].distance(problem.start @ np.asarray(so3.exp(eta)))

    def spare(eta: np.ndarray) -> np.ndarray:
        left, margins = _aim_and_pair_margins(problem, eta)
        near = [reach + AS_NEAR - distance(number, eta)[..., None] for number, reach in enumerate(reaches)]
        return np.concatenate([*near, np.concatenate([left, margins[..., which]], axis=-1) - SPARE], axis=-1)

    constraints: list[dict[str, Any]] = [
        {"type": "ineq", "fun": spare, "jac": lambda eta: _central_differences(spare, eta)},
    ]
    if problem.aims.has_equations:
        equations = partial(_equation_residuals, problem)
        constraints.append(
            {"type": "eq", "fun": equations, "jac": lambda eta: _central_differences(equations, eta)}
        )

    def ended(
        cost: Callable[[np.ndarray], Any], slope: Callable[[np.ndarray], Any], eta: np.ndarray
    ) -> np.ndarray:
        found = minimize(
            cost,
            eta,
            jac=slope,
            method="SLSQP",
            constraints=constraints,
            options={"maxiter": _MAX_SLSQP_ITERATIONS, "ftol": 1e-14},
        )
        return np.asarray(found.x)

    for number in range(len(problem.wishes)):

        def square(eta: np.ndarray, number: int = number) -> np.ndarray:
            return distance(number, eta)[..., None] ** 2 / 2

        eta = ended(lambda eta: square(eta)[0], lambda eta: _central_differences(square, eta)[0], eta)
        reaches.append(float(distance(number, eta)))
    return ended(lambda eta: eta @ eta / 2, lambda eta: eta, eta)
