"""The quadratic program of one step, solved through its dual; rows that a step would break are added to it.

    minimise   dc^T H dc / 2 + g^T dc   [ + dT / T + haste (dT / T)^2 / 2 ]

over the free changes ``dc`` of all axes, subject to elastic rows. ``H`` is the same for every axis, so its
inverse is that of one small matrix, and the dual has one unknown a row (`box_qp`). Few of the rows are near:
a program begins with those, and is solved again with the rows added that its answer breaks.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan.trajectory.global_spline.box_qp import solve_box_qp
from jaxplan.trajectory.global_spline.rows import Family, Index, Step

_MOST_ROWS = 512  # of a dual; no more can bind in the usual number of intervals
_ROUNDS = 6
BROKEN = 1e-3  # of what counts as near: a row that a step breaks by more is added
_SHORTEST_STEP = -0.5  # of the duration, taken off at once: it stays positive
_NO_SLOPE = 1e-9  # rows with smaller ones are beyond what a program may change
_BINDING = 1e-6  # of the largest multiplier


@dataclass(frozen=True, kw_only=True, eq=False)
class Quadratic:
    """The objective at a curve.

    Attributes:
        free: (n, k) ``F``: free changes are ``F x``.
        by_time: (n, A) what the coefficients change by with the relative change of the duration.
        hessian: (n, n) ``H``.
        gradient: (n, A) ``g``.
        haste: of the duration's own term, whose slope is 1; None for a given duration.
        rows: (4, S, n) of the basis at the places.
    """

    free: np.ndarray
    by_time: np.ndarray
    hessian: np.ndarray
    gradient: np.ndarray
    haste: float | None
    rows: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """What a program answers.

    Attributes:
        step: to take; not finite where the program broke down.
        multipliers: by family, of every row; zero where it does not bind.
        exact: whether no row that is only linearised binds.
    """

    step: Step
    multipliers: dict[str, np.ndarray]
    exact: bool


def propose(
    quadratic: Quadratic, families: list[Family], penalty: np.ndarray, held: dict[str, np.ndarray]
) -> Proposal:
    """Solve the program at a curve.

    Args:
        quadratic: the objective.
        families: all rows at the curve.
        penalty: by kind of row.
        held: by family, multipliers of rows to begin with beside those that are near.
    """
    inverse = np.linalg.inv(quadratic.free.T @ quadratic.hessian @ quadratic.free)
    chosen = [family.chosen(family.room < family.near, family.room) for family in families]
    for family, mask in zip(families, chosen, strict=True):
        if family.name in held:  # in a group another entry may hold now
            mask |= (held[family.name] > 0) & np.isfinite(family.room)
    for _ in range(_ROUNDS):
        indices = [np.nonzero(mask) for mask in chosen]
        step, multipliers = _answer(quadratic, inverse, families, indices, penalty)
        added = False
        for family, mask in zip(families, chosen, strict=True):
            room = family.room - family.change(step) - family.time * step.stretch
            broken = family.chosen(room < -BROKEN * family.near, room) & ~mask
            mask |= broken
            added |= bool(np.any(broken))
        if not added:
            break
    least = _BINDING * max((float(np.max(own, initial=0)) for own in multipliers), default=0.0)
    found = {}
    for family, index, own in zip(families, indices, multipliers, strict=True):
        found[family.name] = np.zeros(family.room.shape)
        found[family.name][index] = np.where(own > least, own, 0.0)
    curved = (family for family in families if not family.linear)
    exact = not any(np.any(found[family.name]) for family in curved)
    return Proposal(step=step, multipliers=found, exact=exact)


def _answer(
    quadratic: Quadratic,
    inverse: np.ndarray,
    families: list[Family],
    indices: list[Index],
    penalty: np.ndarray,
) -> tuple[Step, list[np.ndarray]]:
    """The best step under some rows of each family, and the rows' multipliers."""
    counts = [len(index[0]) for index in indices]
    time = np.repeat(np.array([family.time for family in families]), counts)
    limit = np.repeat(np.array([penalty[family.kind] for family in families]), counts)
    every, room = [np.zeros((0, *quadratic.gradient.shape[::-1]))], [np.zeros(0)]  # there may be no family
    every += [family.slopes(index) for family, index in zip(families, indices, strict=True)]
    room += [family.room[index] for family, index in zip(families, indices, strict=True)]
    step, multipliers = _dual(quadratic, inverse, np.concatenate(every), time, np.concatenate(room), limit)
    return step, np.split(multipliers, np.cumsum(counts))[:-1]


def _dual(
    quadratic: Quadratic,
    inverse: np.ndarray,
    every: np.ndarray,
    time: np.ndarray,
    room: np.ndarray,
    penalty: np.ndarray,
) -> tuple[Step, np.ndarray]:
    """The best step under rows with the slopes ``every`` (R, A, n), and their multipliers (R,)."""
    slopes = every @ quadratic.free
    if np.any(quadratic.by_time):
        time = time + np.einsum("ran,na->r", every, quadratic.by_time)
    kept = np.flatnonzero(np.max(np.abs(slopes), axis=(1, 2), initial=0) > _NO_SLOPE)
    if len(kept) > _MOST_ROWS:  # those with the least room
        kept = np.sort(kept[np.argsort(room[kept])[:_MOST_ROWS]])
    slopes, time = slopes[kept], time[kept]
    bent = slopes @ inverse
    alone = -inverse @ (quadratic.free.T @ quadratic.gradient)  # (k, A), the step without rows
    matrix = np.tensordot(bent, slopes, axes=((1, 2), (1, 2)))
    linear = np.tensordot(slopes, alone.T, axes=((1, 2), (0, 1))) - room[kept]
    if quadratic.haste is not None:
        matrix += np.outer(time, time) / quadratic.haste
        linear -= time / quadratic.haste
    y = solve_box_qp(matrix, linear, penalty[kept]).multipliers
    change = quadratic.free @ (alone - np.tensordot(bent, y, axes=(0, 0)).T)
    stretch = 0.0
    if quadratic.haste is not None:
        stretch = max(float(-(1 + time @ y) / quadratic.haste), _SHORTEST_STEP)
        change = change + stretch * quadratic.by_time
    multipliers = np.zeros(len(room))
    multipliers[kept] = y
    return Step(change, quadratic.rows @ change, stretch), multipliers
