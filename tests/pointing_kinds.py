"""Problems of step 1 with rows of every kind, solvable by construction, and their margins in plain numpy.

Two terminals t0 and t1, an instrument i0 and an axis of the body: sights 0 to 3.
"""

from dataclasses import replace

import numpy as np
from kinds import pair_margins_of, table_of
from pointing import Problem, make_problem
from reference import direction, random_units
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT, Constraints

TERMINALS, SIGHTS = 2, 4


def table(rows: list[dict], body: np.ndarray, size: int = 16, **carried: np.ndarray) -> Constraints:
    """Rows given by frame, axis, half_angle, side, bound, entry and group, padded; all of one kind to JAX."""
    return replace(table_of(rows, 3, body=body, size=size, **carried), inner=True, nested=True)


def joints_at(problem: Problem, attitudes: np.ndarray) -> np.ndarray:
    """(..., 4) rad, yaws and pitches at which the terminals point at their targets."""
    body = problem.targets.directions @ attitudes
    yaw = np.arctan2(body[..., 1], body[..., 0]) - problem.mounts
    yaw = np.mod(yaw + np.pi, 2 * np.pi) - np.pi
    return np.concatenate([yaw, np.arcsin(np.clip(body[..., 2], -1, 1))], axis=-1)


def row_margins(problem: Problem, attitudes: np.ndarray) -> np.ndarray:
    """(N, Z, S) rad at attitudes (N, 3, 3), row by row and sight by sight."""
    return pair_margins_of(problem.spacecraft, problem.cones, attitudes, joints_at(problem, attitudes))


def constraints_of(problem: Problem) -> list[list[list[int]]]:
    """Rows of the entries of the constraints."""
    rows = problem.cones
    used = np.flatnonzero(np.any(rows.bound, axis=1))
    return [
        [
            [row for row in used if rows.entry[row] == entry]
            for entry in sorted({rows.entry[row] for row in used if rows.group[row] == group})
        ]
        for group in sorted({rows.group[row] for row in used})
    ]


def worst_margin(problem: Problem, attitudes: np.ndarray) -> np.ndarray:
    """(N,) rad, of joints within their limits and all constraints."""
    table_ = row_margins(problem, attitudes).min(axis=2)
    found = (problem.limits - np.abs(joints_at(problem, attitudes))).min(axis=1)
    for entries in constraints_of(problem):
        found = np.minimum(found, np.max([table_[:, entry].min(axis=1) for entry in entries], axis=0))
    return found


def slsqp(problem: Problem, starts: int, rng: np.random.Generator) -> float:
    """Least slew that SLSQP finds from starts uniform in the ball of radius pi; inf if it finds none."""
    groups, slots = constraints_of(problem), int(problem.cones.bound.sum())

    def margins(eta: np.ndarray) -> np.ndarray:
        attitude = problem.start @ Rotation.from_rotvec(eta).as_matrix()
        joints, pairs = joints_at(problem, attitude), row_margins(problem, attitude[None])[0]
        values = [problem.limits - joints, problem.limits + joints, [np.pi**2 - eta @ eta]]
        for entries in groups:
            best = max((np.sort(pairs[entry], axis=None) for entry in entries), key=lambda found: found[0])
            best = best[np.isfinite(best)]
            values.append(np.append(best, np.full(slots - len(best), best[-1])))
        return np.concatenate(values)

    best = np.inf
    for start in random_units(rng, starts) * np.pi * rng.random((starts, 1)) ** (1 / 3):
        end = minimize(
            lambda eta: eta @ eta,
            start,
            jac=lambda eta: 2 * eta,
            method="SLSQP",
            constraints={"type": "ineq", "fun": margins},
            options={"ftol": 1e-13, "maxiter": 100},
        ).x
        if np.all(np.isfinite(end)) and np.all(margins(end) >= -1e-9):
            best = min(best, float(np.linalg.norm(end)))
    return best


def random_kinds(seed: int) -> Problem:
    """Problem number `seed`, of constraints of one to three entries; one that solves it is drawn first."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(32,)))
    start, solution = Rotation.random(2, rng=rng).as_matrix()
    mounts, yaw = rng.uniform(-np.pi, np.pi, 2), np.deg2rad(rng.choice([60, 100, 150, 180], 2))
    pitch = rng.uniform(0.2, 1.4, 2)
    azimuth, elevation = mounts + rng.uniform(-yaw, yaw), rng.uniform(-pitch, pitch)
    free = make_problem(
        start, direction(azimuth, elevation) @ solution.T, mounts, yaw, pitch, boresights=random_units(rng, 1)
    )
    rows: list[dict] = []
    axes = random_units(rng, 1)
    for _ in range(rng.integers(2, 6)):
        group, entries = len(rows), rng.integers(1, 4)
        held = rng.integers(entries)
        for number in range(entries):
            entry = len(rows)
            for _ in range(rng.integers(1, 3)):
                drawn = _row(rng) | {"entry": entry, "group": group}
                rows.append(_meeting(free, axes, drawn, solution, rng) if number == held else drawn)
    rows = rows[:16]
    kept = [row for row in rows if row["group"] < rows[-1]["group"] or len(rows) < 16]  # none cut in half
    return replace(free, cones=table(kept, axes))


def _row(rng: np.random.Generator) -> dict:
    frame = rng.integers(4)
    if frame == JOINTS:
        axis = np.zeros(3)
        axis[rng.integers(2)] = rng.choice([-1.0, 1.0])
        bound = rng.permutation(TERMINALS)[: rng.integers(1, 3)]
        return {"frame": JOINTS, "axis": axis, "half_angle": rng.uniform(-1, 0.5), "bound": bound}
    order = rng.permutation(SIGHTS)
    bound = order[1:2] if frame == SIGHT else order[: rng.integers(1, 3)]
    return {
        "frame": frame,
        "axis": random_units(rng) if frame != SIGHT else np.array([0.0, 0.0, 1.0]),
        "partner": order[0] if frame == SIGHT else 0,
        "side": rng.choice([1.0, 1.0, -1.0]),
        "half_angle": rng.uniform(0.2, 1.2),
        "bound": bound,
    }


def _meeting(
    free: Problem, axes: np.ndarray, row: dict, attitude: np.ndarray, rng: np.random.Generator
) -> dict:
    """The row with an angle at which an attitude meets it."""
    one = replace(free, cones=table([row | {"entry": 0, "group": 0}], axes))
    margin = row_margins(one, attitude[None])[0, 0].min()
    by = margin - rng.uniform(0.02, 0.3)  # the half angle grows by this where sights stay out
    side = row.get("side", 1.0)
    half_angle = np.clip(row["half_angle"] + side * by, -4, 4)
    if row["frame"] != JOINTS and not 0.01 < half_angle < 3.13:
        return row | {"side": 1.0, "half_angle": 0.01} if side > 0 else row | {"half_angle": 3.13}
    return row | {"half_angle": half_angle}


KINDS = {  # a row that the nearest goal without it breaks
    "instrument, inertial axis": {"frame": INERTIAL, "bound": [2]},
    "axis of the body, inertial axis": {"frame": INERTIAL, "bound": [3]},
    "axis of the body, inertial axis, in": {"frame": INERTIAL, "bound": [3], "side": -1.0},
    "terminal, axis of the body": {"frame": BODY, "bound": [0]},
    "terminal, axis of the body, in": {"frame": BODY, "bound": [1], "side": -1.0},
    "terminal, boresight of the instrument": {"frame": SIGHT, "partner": 2, "bound": [0]},
    "instrument, beam of a terminal": {"frame": SIGHT, "partner": 1, "bound": [2]},
    "instrument, beam of a terminal, in": {"frame": SIGHT, "partner": 1, "bound": [2], "side": -1.0},
    "axis of the body, beam of a terminal": {"frame": SIGHT, "partner": 0, "bound": [3]},
    "yaw from below": {"frame": JOINTS, "bound": [0], "axis": np.array([1.0, 0.0, 0.0])},
    "yaw from above": {"frame": JOINTS, "bound": [1], "axis": np.array([-1.0, 0.0, 0.0])},
    "pitch from below": {"frame": JOINTS, "bound": [0], "axis": np.array([0.0, 1.0, 0.0])},
    "pitch from above": {"frame": JOINTS, "bound": [1], "axis": np.array([0.0, -1.0, 0.0])},
}


def one_of(kind: str, seed: int, yaw_limit: float = 2.8) -> Problem:
    """A problem whose nearest goal leans on a row of this kind, in an entry beside another row."""
    for attempt in range(50):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(33, attempt)))
        start, mounts = Rotation.random(rng=rng).as_matrix(), rng.uniform(-np.pi, np.pi, 2)
        free = make_problem(
            start,
            random_units(rng, 2),
            mounts,
            yaw_limit,
            1.2,
            goal_limits=(2.7, 1.1),
            boresights=random_units(rng, 1),
        )
        axes = random_units(rng, 1)
        nearest = free.decompose(max_goals=1)
        row = {"axis": random_units(rng), "half_angle": 0.0, "entry": 0, "group": 0} | KINDS[kind]
        one = replace(free, cones=table([row], axes, size=8))
        if not nearest.goals:
            continue
        margin = row_margins(one, nearest.goals[0].attitude[None])[0, 0].min()
        side = row.get("side", 1.0)
        row["half_angle"] = side * (margin + 0.12)
        if row["frame"] != JOINTS and not 0.1 < row["half_angle"] < 3.0:
            continue
        beside = {"frame": BODY, "axis": axes[0], "half_angle": 3.1, "side": -1.0, "bound": [2]}
        other = {"frame": BODY, "axis": axes[0], "half_angle": 0.001, "side": -1.0, "bound": [2]}
        rows = [row, beside | {"entry": 0, "group": 0}, other | {"entry": 2, "group": 0}]
        found = replace(free, cones=table(rows, axes, size=8))
        goals = found.decompose(max_goals=2).goals
        if goals and abs(row_margins(found, goals[0].attitude[None])[0, 0].min()) < 1e-9:
            return found
    raise AssertionError(f"no problem leans on {kind}")


def past_a_plane() -> Problem:
    """A problem whose goal keeps a yaw more than half a turn from a bound, so beyond the plane through it."""
    for seed in range(20):
        problem = one_of("instrument, inertial axis", seed)
        yaw = problem.decompose(max_goals=1).goals[0].joints[0]
        if abs(yaw) > 0.7:
            rows = problem.cones
            rows.frame[3], rows.axis[3], rows.half_angle[3] = JOINTS, [np.sign(yaw), 0, 0], -2.6
            rows.bound[3, 0] = True
            return problem
    raise AssertionError("no yaw is far from its bound")
