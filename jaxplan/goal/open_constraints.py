"""Find goals that keep what step 1 leaves open: oblique bounds of joints, and vectors that joints turn.

The joints of devices with a target are functions of the attitude at a goal, so a demand on a state is one on
an *unknown* (3 + f,): the rotation vector ``eta`` of equation (2), rad, from the start, ``R = R0 exp(eta^)``,
and f joints, rad, of devices without a target that some constraint concerns. Random attitudes around goals
that break something, or else everywhere, show where all constraints hold, and by which entries; at each,
random joints show whether devices without a target can make way. From the nearest of these, sequential
quadratic programming (SLSQP of scipy) goes to the least ``|eta|`` while it keeps the same entries; wishes
come before that, one after the other. It proves nothing: there may be a goal that is nearer. Where devices
without a target are at the goal found is chosen as at any other (`jaxplan.goal.free_devices`).
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.goal.free_devices import rows_about_device, settled
from jaxplan.goal.problem import GoalProblem
from jaxplan.model.constraints import BODY, INERTIAL, SIGHT, chosen_entries, constraint_margins
from jaxplan.model.gimbals import angles_along, in_range
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
_DEVICE_SPARE = 2 * SPARE  # rad, as `SPARE`, of devices that make way: `settled` has to find them a place
_WITH_JOINTS = 512  # most random attitudes at which joints of devices without a target are looked for
_JOINT_TRIES = 16  # random joints of each such device at each of them
AS_NEAR = 1e-6
"""rad; goals whose distances to a wish differ by less are as near to it."""
_STARTS_AS_NEAR = np.deg2rad(1.0)
"""rad; starts whose distances to a wish differ by less are as near to it."""
_DIFFERENCE_STEP = 1e-5  # rad, step of central differences
_MAX_SLSQP_ITERATIONS = 60  # most iterations of SLSQP
_NEWTON_STEPS = 6  # steps of Newton's method onto the equations; each squares the residual
_MAX_DESCENTS = 4  # descents at most, each with the entries that hold best where the one before ended


class _Unknowns:
    """The unknowns of a search for goals, and margins and equations as functions of them; see the module.

    Args:
        problem: the problem of step 1.

    Attributes:
        problem: the problem of step 1.
        devices: numbers of the devices without a target that a constraint concerns.
        columns: (f,) numbers of their joints.
        ranges: (f, 2) rad, of these joints, at the goal.
        spares: (Z, S) rad, margins to keep of the pairs of Z rows and S sights.
    """

    def __init__(self, problem: GoalProblem) -> None:
        gimbals = problem.spacecraft.gimbals
        free = problem.aims.free(gimbals)
        self.problem = problem
        self.devices = [number for number in free if np.any(rows_about_device(problem, number))]
        self.columns = np.concatenate([np.empty(0, int), *(gimbals.joints_of(one) for one in self.devices)])
        self.ranges = problem.ranges[self.columns]
        self.spares = np.where(_pairs_of_devices(problem, self.devices), _DEVICE_SPARE, SPARE)

    def attitudes(self, unknown: np.ndarray) -> np.ndarray:
        """Attitudes (..., 3, 3), body to inertial, of unknowns (..., 3 + f)."""
        return self.problem.start @ np.asarray(so3.exp(unknown[..., :3]))

    def joints(self, unknown: np.ndarray, attitudes: np.ndarray) -> np.ndarray:
        """All joints (..., J) rad, of unknowns (..., 3 + f) with their attitudes (..., 3, 3)."""
        joints = np.array(self.problem.joints(attitudes))
        joints[..., self.columns] = unknown[..., 3:]
        return joints

    def aim_and_pair_margins(self, unknown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how far aims are inside their ranges, and the margins of all pairs, at (..., 3 + f).

        Returns:
            (..., r) rad, distances of azimuths and elevations from the nearer ends of their r ranges; and
            margins (..., Z, S) rad of the pairs of Z rows and S sights. Both are negative where something is
            broken.
        """
        attitudes = self.attitudes(unknown)
        ranged = ~np.array(self.problem.aims.equations, bool).reshape(-1, 2)
        left = -self.problem.aims.excess(attitudes)[..., ranged]
        return left, self.problem.margins(attitudes, self.joints(unknown, attitudes))

    def equation_residuals(self, unknown: np.ndarray) -> np.ndarray:
        """Return how far the e equations of azimuth and elevation are off, (..., e) rad, at (..., 3 + f)."""
        aims = self.problem.aims
        off = np.stack(aims.angles(self.attitudes(unknown)), axis=-1) - np.mean(aims.ranges, axis=-1)
        return off[..., np.array(aims.equations, bool).reshape(-1, 2)]

    def solve_equations(self, unknown: np.ndarray) -> np.ndarray:
        """Return unknowns (..., 3 + f) nearby at which all equations hold.

        They are found by a few steps of Newton's method.
        """
        for _ in range(_NEWTON_STEPS if self.problem.aims.has_equations else 0):
            slopes = _central_differences(self.equation_residuals, unknown)
            off = self.equation_residuals(unknown)
            unknown = unknown - (np.linalg.pinv(slopes, rcond=1e-6) @ off[..., None])[..., 0]
        return unknown

    def feasible(self, etas: np.ndarray, seed: int) -> np.ndarray:
        """Return unknowns (n, 3 + f) at which everything is kept, of n of the rotation vectors (k, 3) rad.

        Devices without a target, one after the other, stay where they are at the start if that is clear; if
        not, they are pointed at the axes of zones that they have to stay in, then at random, and the best
        joints are kept.

        Args:
            etas: rotation vectors at which all equations hold.
            seed: seed of the random joints.
        """
        rng = np.random.default_rng(np.random.SeedSequence(seed))
        at_rest = np.clip(self.problem.rest[self.columns], *self.ranges.T)
        unknown = np.concatenate([etas, np.tile(at_rest, (len(etas), 1))], axis=1)
        about = [rows_about_device(self.problem, number) for number in self.devices]
        every = np.ones(len(self.problem.rows.zone), bool)
        left, _ = self.aim_and_pair_margins(unknown)
        kept = self._least_margins(unknown, ~np.any(about, axis=0) if about else every) > 0
        unknown = unknown[kept & (np.min(left, axis=-1, initial=np.inf) > 0)]
        if about:
            unknown = unknown[:_WITH_JOINTS]
        for _ in range(2 if len(about) > 1 else 1):  # each may be in the other's way
            for number, rows in zip(self.devices, about, strict=True):
                self._place_device(unknown, number, rows, rng)
        return unknown[self._least_margins(unknown, every) > 0]

    def _place_device(
        self, unknown: np.ndarray, number: int, rows: np.ndarray, rng: np.random.Generator
    ) -> None:
        """Change the joints of device `number` in place, where the constraints about it do not hold.

        Args:
            unknown: (k, 3 + f), which are changed to the best that was tried.
            number: of the device.
            rows: (Z,) bool, the rows about it.
            rng: where random joints come from.
        """
        own = np.isin(self.columns, self.problem.spacecraft.gimbals.joints_of(number))
        low, high = self.ranges[own].T
        into = self._zones_to_stay_in(number)
        best = self._least_margins(unknown, rows)
        for attempt in range(len(into) + _JOINT_TRIES):
            broken = np.flatnonzero(best <= 0)
            if not len(broken):
                break
            tried = unknown[broken]
            if attempt < len(into):
                places = self._joints_toward(tried, number, into[attempt])
            else:
                places = rng.uniform(low, high, (len(broken), len(low)))
            tried[:, 3:][:, own] = places
            margins = self._least_margins(tried, rows)
            better = margins > best[broken]
            unknown[broken[better]], best[broken[better]] = tried[better], margins[better]

    def _zones_to_stay_in(self, number: int) -> np.ndarray:
        """Return which rows keep the boresight of device `number` near an axis of the sky or of the body."""
        rows = self.problem.rows
        fixed = (rows.frame == INERTIAL) | (rows.frame == BODY)
        return np.flatnonzero(rows.bound[:, number] & fixed & (rows.side < 0))

    def _joints_toward(self, unknown: np.ndarray, number: int, row: int) -> np.ndarray:
        """Return joints (k, o) rad with device `number` as near to a row's axis as can be, at (k, 3 + f)."""
        problem, axis = self.problem, self.problem.rows.axis[row]
        gimbals, columns = problem.spacecraft.gimbals, problem.spacecraft.gimbals.joints_of(number)
        body = np.tile(axis, (len(unknown), 1))
        if problem.rows.frame[row] == INERTIAL:
            body = axis @ self.attitudes(unknown)
        azimuth, elevation = angles_along(gimbals.frames[number : number + 1], body[:, None])
        yaw = in_range(azimuth, problem.ranges[columns[:1]], problem.rest[columns[:1]])
        places = np.concatenate([yaw, elevation], axis=1)[:, : len(columns)]
        return np.clip(places, *problem.ranges[columns].T)

    def _least_margins(self, unknown: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return the least margins (k,) rad of the constraints in `rows` (Z,) at unknowns (k, 3 + f)."""
        _, margins = self.aim_and_pair_margins(unknown)
        kept = constraint_margins(self.problem.rows, margins)
        return np.asarray(np.min(np.where(rows, kept, np.inf), axis=-1, initial=np.inf))


def _central_differences(function: Callable[[np.ndarray], np.ndarray], place: np.ndarray) -> np.ndarray:
    """Return central differences (..., c, n) of a function of n numbers (..., n) with c values."""
    steps = _DIFFERENCE_STEP * np.eye(place.shape[-1])
    ahead, behind = (function(place[..., None, :] + way * steps) for way in (1, -1))
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
    unknowns = _Unknowns(problem)
    for widest in (WIDEST, np.pi):
        etas = unknowns.solve_equations(_draw_around(problem.start, around, widest, seed))
        tried = unknowns.feasible(etas, seed)
        if len(tried):
            break
    found = []
    for number in _pick_distinct(problem, tried[:, :3], STARTS_APART, _STARTS_AS_NEAR):
        eta = _find_local_minimum(unknowns, tried[number])
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


def _find_local_minimum(unknowns: _Unknowns, place: np.ndarray) -> np.ndarray | None:
    """Find a local minimum of the rotation angle near a feasible rotation.

    Of a constraint with alternatives (`any_of`) the one that holds best is kept while the angle is minimised;
    where another one holds best at the end, it is minimised again with that one.

    Args:
        unknowns: with the constraints.
        place: (3 + f,) rad, an unknown at which every constraint holds.

    Returns:
        The rotation vector (3,) rad; None if a constraint does not hold there.
    """
    rows = unknowns.problem.rows
    before: np.ndarray | None = None
    for _ in range(_MAX_DESCENTS):
        _, margins = unknowns.aim_and_pair_margins(place)
        which = rows.bound & (chosen_entries(rows, np.min(margins, axis=-1)) == rows.entry)[:, None]
        if before is not None and np.all(which == before):
            break
        place, before = unknowns.solve_equations(_run_slsqp(unknowns, place, which)), which
    left, margins = unknowns.aim_and_pair_margins(place)
    least = np.min([*(left - SPARE / 2), *constraint_margins(rows, margins - unknowns.spares / 2)])
    return place[:3] if least >= 0 else None


def _run_slsqp(unknowns: _Unknowns, place: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Bring wishes near, one after the other, then minimise ``|eta|``; return where SLSQP ends, (3 + f,) rad.

    It starts at ``place`` (3 + f,) and keeps the ranges and equations of the aims, the ranges of the joints
    that are unknown, and the margins of the pairs in `which`, a mask of Z rows by S sights.
    """
    from scipy.optimize import minimize  # slow to import, and seldom needed

    problem, reaches = unknowns.problem, list[float]()
    ranges = [(None, None)] * 3 + [(low, high) for low, high in unknowns.ranges.tolist()]

    def distance(number: int, place: np.ndarray) -> np.ndarray:
        return problem.wishes[number].distance(unknowns.attitudes(place))

    def spare(place: np.ndarray) -> np.ndarray:
        left, margins = unknowns.aim_and_pair_margins(place)
        near = [reach + AS_NEAR - distance(number, place)[..., None] for number, reach in enumerate(reaches)]
        return np.concatenate([*near, left - SPARE, (margins - unknowns.spares)[..., which]], axis=-1)

    constraints: list[dict[str, Any]] = [
        {"type": "ineq", "fun": spare, "jac": lambda place: _central_differences(spare, place)},
    ]
    if problem.aims.has_equations:
        equations = unknowns.equation_residuals
        constraints.append(
            {"type": "eq", "fun": equations, "jac": lambda place: _central_differences(equations, place)}
        )

    def ended(
        cost: Callable[[np.ndarray], Any], slope: Callable[[np.ndarray], Any], place: np.ndarray
    ) -> np.ndarray:
        found = minimize(
            cost,
            place,
            jac=slope,
            bounds=ranges,
            method="SLSQP",
            constraints=constraints,
            options={"maxiter": _MAX_SLSQP_ITERATIONS, "ftol": 1e-14},
        )
        return np.asarray(found.x)

    for number in range(len(problem.wishes)):

        def square(place: np.ndarray, number: int = number) -> np.ndarray:
            return distance(number, place)[..., None] ** 2 / 2

        place = ended(
            lambda place: square(place)[0], lambda place: _central_differences(square, place)[0], place
        )
        reaches.append(float(distance(number, place)))
    turning = np.arange(len(place)) < 3
    return ended(lambda place: place[:3] @ place[:3] / 2, lambda place: np.where(turning, place, 0.0), place)


def _pairs_of_devices(problem: GoalProblem, devices: Sequence[int]) -> np.ndarray:
    """Tell in which pairs one of some devices carries the sight, or the sight that is the row's axis.

    The result is (Z, S) bool, Z rows by S sights.
    """
    rows, carried = problem.rows, np.isin(problem.sights.carriers, devices)
    return carried | ((rows.frame == SIGHT) & carried[rows.partner])[:, None]
