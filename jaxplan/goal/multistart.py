"""All minima of problem (7) from many starts, and the least change that makes the problem solvable.

The starts are points of a *covering* of SO(3), a super-Fibonacci spiral on the unit quaternions: any attitude
is within `RADIUS` of one of them. A direction in body axes moves by no more than the attitude turns, so an
attitude clear of all caps is within `RADIUS` of a point that is inside no cap by more than `RADIUS`. Points
that are deeper inside are ruled out; where all are, the problem is proved to have no solution.

The descents start from the points left, those of the least slew first: a solution of slew ``theta`` lies near
a point of slew below ``theta + RADIUS``, so once all of those have been started from, nothing better is left
to find. Starts spread over the others find further minima.

For many satellites at once, without zones, `nearest_attitudes` starts from four attitudes only: the start,
and that turned about the body's z axis by a quarter turn either way and by half a turn. Problems without an
answer then are left to `decompose`.

Quaternions are those of ``E``, the rotation from the start to an attitude, scalar first.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import jax
import numpy as np
from jax import Array

from jaxplan.geometry import quaternion, rotations
from jaxplan.goal.aims import pointed
from jaxplan.goal.caps import Caps, assemble, group_excess
from jaxplan.goal.descent import CLEAR, LANES, Minima, descend, descent_ends
from jaxplan.goal.problem import GoalProblem
from jaxplan.model.goals import Targets
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.jit import quick_jit

POINTS = 4096
RADIUS = 0.25
"""rad; the largest distance found of any attitude to the nearest point is 0.2455."""
BEYOND = 704
"""Points taken twice: the (r + sin r) / pi of all within r = `RADIUS` of half a turn, and a few more."""

# Points to a turn of the spiral in each of its two planes. They come from the positive roots of x^4 = x + 4
# and x^2 = 2, which keep the points apart best.
_FIRST_SPIRAL_PERIOD = np.sqrt(2.0)
_SECOND_SPIRAL_PERIOD = 1.533751168755204288118041

NEAR = 64
"""Starts of the first batch with the least slew; the others are spread over the rest."""
TOLERANCE = 1e-10
"""rad; largest residual of the conditions of optimality of a minimum."""
LAST_TOLERANCE = 1e-7
"""rad; likewise in the last round: rounding leaves more at the curved edge of a cone of arc seconds."""
ROUNDS = 4
"""Descents in a row from one batch of starts."""
APART = np.deg2rad(2.0)
"""rad; minima closer than this count as one."""
STILL = 1e-9
"""rad; a smaller slew counts as none."""
PRECISION = 3e-7
"""rad; to which the least widening is found."""
TOGETHER = 256
"""Satellites of one call of `nearest_attitudes`: there is one shape to compile."""
_SQRT_HALF = np.sqrt(0.5)
_START_QUATERNIONS = np.array(
    [[1.0, 0.0, 0.0, 0.0], [_SQRT_HALF, 0, 0, _SQRT_HALF], [_SQRT_HALF, 0, 0, -_SQRT_HALF], [0.0, 0, 0, 1.0]]
)


@lru_cache(maxsize=8)
def covering_points(seed: int) -> np.ndarray:
    """Return the N points of the covering of SO(3) as unit quaternions (N, 4), by rising angle from zero.

    The scalar part is positive up to half a turn. The last points, with a negative scalar part, are those
    near half a turn once more, taken as the longer way round: so a solution near half a turn has a point near
    it on its own side, too.

    Args:
        seed: seed of a random rotation of the whole covering.
    """
    step = np.arange(POINTS) + 0.5
    share = step / POINTS
    first, second = 2 * np.pi * step / _FIRST_SPIRAL_PERIOD, 2 * np.pi * step / _SECOND_SPIRAL_PERIOD
    spiral = np.stack(
        [
            np.sqrt(share) * np.sin(first),
            np.sqrt(share) * np.cos(first),
            np.sqrt(1 - share) * np.sin(second),
            np.sqrt(1 - share) * np.cos(second),
        ]
    )
    turn = np.random.default_rng(np.random.SeedSequence(seed)).normal(size=4)
    turned = np.stack(rotations.product(turn / np.linalg.norm(turn), spiral), axis=-1)
    both = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], turned, -turned])
    return both[np.argsort(-both[:, 0], kind="stable")[: 1 + POINTS + BEYOND]]


@lru_cache(maxsize=8)
def _covering_matrices(seed: int) -> np.ndarray:
    """Return the rotation matrices of the N `covering_points`, as entries (9, N) in single precision."""
    return np.array(rotations.matrix(covering_points(seed).T), dtype=np.float32).reshape(9, -1)


def depths(caps: Caps, seed: int) -> np.ndarray:
    """Tell for each of the N points of the covering whether a solution may lie near it, or how far it is off.

    Args:
        caps: what directions must stay out of.
        seed: seed of the covering.

    Returns:
        (N,) differences of cosines: zero or less where a solution may lie within `RADIUS` of the point;
        otherwise the larger, the deeper the point is inside a cap.
    """
    # a . E^T z is the sum of these times the entries of E
    entries = np.einsum("mi,mj->mji", caps.axis, caps.direction).reshape(-1, 9)
    reach = caps.half_angle - RADIUS
    excluded = np.where(reach > 0, np.cos(reach), np.inf)
    single = np.float32
    depth = entries.astype(single) @ _covering_matrices(seed) - excluded.astype(single)[:, None]
    found: np.ndarray = np.max(group_excess(depth, caps.member, caps.group), axis=0)
    return found


def minima(caps: Caps, count: int, seed: int) -> np.ndarray:
    """Find distinct local minima of the slew, the global one first.

    Args:
        caps: what directions must stay out of.
        count: how many are wanted at most.
        seed: seed of the covering.

    Returns:
        (at most count, 4) unit quaternions of ``E`` with scalar part >= 0, by rising slew; (0, 4) without a
        solution. Where no descent reaches a minimum, as where caps leave hardly any room, it is the nearest
        end of a descent that is clear of all caps.
    """
    points = covering_points(seed)
    possible = np.flatnonzero(depths(caps, seed) <= 0)
    slews = 2 * np.arccos(np.clip(points[possible, 0], -1, 1))
    rest = possible[NEAR:]
    spread = rest[np.linspace(0, len(rest) - 1, min(LANES - NEAR, len(rest))).astype(int)]
    found, clear = _minima_from(caps, points[np.concatenate([possible[:NEAR], spread])])
    for begin in range(NEAR, len(possible), LANES):
        if len(found) and slews[begin] > np.min(slew(found)) + RADIUS:
            break
        more, also = _minima_from(caps, points[possible[begin : begin + LANES]])
        found, clear = np.concatenate([found, more]), np.concatenate([clear, also])
    return _pick_distinct(found, count) if len(found) else _pick_distinct(clear, 1)


def minimum_near(caps: Caps, start: np.ndarray) -> np.ndarray:
    """Return the local minimum that descents reach from a start, or else an attitude clear of all caps.

    Args:
        caps: what directions must stay out of.
        start: (4,) unit quaternion to begin at; it counts itself where it is clear of all caps.

    Returns:
        (1, 4) unit quaternion of ``E`` with scalar part >= 0; (0, 4) if nothing was found.
    """
    found, clear = _minima_from(caps, start[None])
    if not len(found) and caps.clear(quaternion.to_matrix(start)):
        clear = np.concatenate([clear, start[None]])
    return _pick_distinct(found if len(found) else clear, 1)


def slew(quaternions: np.ndarray) -> np.ndarray:
    """Return the angles (K,) rad in [0, pi] of K rotations given as unit quaternions (K, 4)."""
    return np.asarray(rotations.angle(quaternions.T))


def _minima_from(caps: Caps, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Run descents from at most one batch of starts, and return those of their ends that are local minima.

    Where none is, as in a curved valley near half a turn, the descents go on from where they ended.

    Returns:
        The minima among the K ends, (at most K, 4), and all L ends that are clear of all caps, (L, 4).
    """
    good, clear = np.empty((0, 4)), np.empty((0, 4))
    for round_ in range(ROUNDS if len(starts) else 0):
        ends = descend(caps, starts)
        good = ends.quaternion[ends.good(TOLERANCE if round_ < ROUNDS - 1 else LAST_TOLERANCE)]
        clear = np.concatenate([clear, ends.quaternion[ends.excess <= CLEAR]])
        if len(good):
            break
        starts = ends.quaternion
    return good, clear


def _pick_distinct(quaternions: np.ndarray, count: int) -> np.ndarray:
    """Return the quaternions (at most count, 4) of least slew that are `APART` or more from each other."""
    slews = slew(quaternions)
    left = np.argsort(slews, kind="stable")
    kept = np.empty((0, 4))
    while len(left) and len(kept) < count:
        best = quaternions[left[0]]
        still = slews[left[0]] < STILL
        kept = np.concatenate([kept, [[1.0, 0.0, 0.0, 0.0]] if still else [best if best[0] >= 0 else -best]])
        left = left[np.abs(quaternions[left] @ best) < np.cos(APART / 2)]
    return kept


def least_widening(
    widened: Callable[[float], Caps], enough: float, seed: int, near: np.ndarray | None = None
) -> tuple[np.ndarray, float]:
    """Return the attitude that needs the least widening of a problem's constraints, and that widening.

    The least widening with which the problem has a solution is found by bisection. Every trial starts from
    the points that are least deep in the caps as they are, and from the last solution.

    Args:
        widened: function that returns the caps when the constraints are relaxed by the given angle, rad.
        enough: rad; a widening with which there is a solution.
        seed: seed of the covering.
        near: (4,) unit quaternion of a further start; None for none.

    Returns:
        (4,) unit quaternion of ``E``, and a widening with which it is a solution, rad.
    """
    least_deep = np.argsort(depths(widened(0), seed), kind="stable")
    starts = covering_points(seed)[least_deep[:LANES]]
    if near is not None:
        starts[0] = near
    narrow, wide = 0.0, enough
    while wide - narrow > PRECISION:
        trial = (narrow + wide) / 2
        ends = descend(widened(trial), starts)
        solutions = ends.quaternion[ends.excess <= CLEAR]
        if len(solutions):
            wide, starts[0] = trial, solutions[0]
        else:
            narrow = trial
    return starts[0], wide


def nearest_attitudes(
    spacecraft: Spacecraft, start_attitudes: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for each satellite the attitude nearest to a given one with its terminals on their targets.

    Args:
        spacecraft: the same for all N satellites.
        start_attitudes: (N, 3, 3) body to inertial, to which the answers shall be near.
        directions: (N, n, 3) inertial unit vectors, one for each of n terminals.

    Returns:
        Attitudes (N, 3, 3), body to inertial; joints (N, J) rad within their ranges; and (N,) bool, whether
        an attitude was found: where not, one may still exist.
    """
    count = len(start_attitudes)
    ranges = spacecraft.joint_ranges
    attitudes, joints = np.empty((count, 3, 3)), np.empty((count, len(ranges)))
    found = np.empty(count, dtype=bool)
    for first in range(0, count, TOGETHER):
        rows = np.arange(first, min(first + TOGETHER, count))
        padded = np.resize(rows, TOGETHER)
        part = _solve_batch(spacecraft, start_attitudes[padded], directions[padded])
        attitudes[rows], joints[rows], found[rows] = (values[: len(rows)] for values in part)
    return attitudes, np.clip(joints, *ranges.T), found


def _solve_batch(
    spacecraft: Spacecraft, starts: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute `nearest_attitudes` for one batch of `TOGETHER` satellites, with joints not clipped."""
    first = GoalProblem.of(spacecraft, starts[0], Targets(directions=directions[0]))
    caps = assemble(first)  # the same for all
    toward = np.take(directions, np.maximum(caps.sight, 0), axis=1) @ starts
    toward[:, caps.half_angle < 0] = 0
    with jax.enable_x64(True):
        packed = np.asarray(
            _descend_satellites(
                _START_QUATERNIONS.T, caps.axis, toward, caps.half_angle, caps.member, caps.group
            )
        )
    ends = Minima(np.swapaxes(packed[:, :4], 1, 2), *np.swapaxes(packed[:, 4:], 0, 1))
    good = ends.good(LAST_TOLERANCE)
    best = np.argmin(np.where(good, ends.slew, np.inf), axis=-1)
    chosen = ends.quaternion[np.arange(len(best)), best]
    attitudes = starts @ quaternion.to_matrix(chosen)
    joints = [
        pointed(spacecraft.gimbals, replace(first.aims, directions=own), attitude, first.rest)
        for own, attitude in zip(directions, attitudes, strict=True)
    ]
    return attitudes, np.stack(joints), np.any(good, axis=-1)


@quick_jit
def _descend_satellites(
    starts: Array, axis: Array, directions: Array, half_angle: Array, member: Array, group: Array
) -> Array:
    """Run `descent_ends` for N satellites at once, K starts each and m caps.

    Only the directions (N, m, 3) differ from satellite to satellite. The result is (N, 8, K).
    """
    return jax.vmap(descent_ends, (None, None, 0, None, None, None))(
        starts, axis, directions, half_angle, member, group
    )
