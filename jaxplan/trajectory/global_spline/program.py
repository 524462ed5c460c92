"""The quadratic programs of one step, solved through their duals; rows that a step would break are added.

    minimise   dc^T H dc / 2 + g^T dc   [ + dT / T + haste (dT / T)^2 / 2 ]

over the free changes ``dc`` of all axes, subject to elastic rows. ``H`` is the same for every axis, so its
inverse is that of one small matrix, and the dual has one unknown a row (`dual`). Few of the rows are near: a
program begins with those, and is solved again with rows added that its answer breaks, of those that are true
of all steps only the worst ones at first, and without those that it leaves far behind.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan.trajectory.global_spline.dual import Rows, pulls, solve_duals
from jaxplan.trajectory.global_spline.rows import Family, Step, lowest, taken
from jaxplan.trajectory.inverses import inverses

_ROUNDS = 6
_ALL_AT_ONCE = 2  # rounds, after which all rows that are broken are added
BROKEN = 1e-3  # of what counts as near: a row that a step breaks by more is added
_KEPT = 0.1  # likewise: a row that a step leaves more room is taken out again
_BINDING = 1e-6  # of the largest multiplier

Multipliers = dict[str, np.ndarray]  # by family, of every row


@dataclass(frozen=True, kw_only=True, eq=False)
class Quadratic:
    """The objectives at a stack of G curves.

    Attributes:
        free: (G, n, k) ``F``: free changes are ``F x``.
        by_time: (G, n, A) what the coefficients change by with the relative change of the duration.
        hessian: (G, n, n) ``H``.
        gradient: (G, n, A) ``g``.
        haste: of the duration's own term, whose slope is 1; None for a given duration.
        rows: (G, 4, S, n) of the basis at the places.
    """

    free: np.ndarray
    by_time: np.ndarray
    hessian: np.ndarray
    gradient: np.ndarray
    haste: float | None
    rows: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """What the programs answer.

    Attributes:
        coefficients: (G, n, A) changes to make; not finite where a program broke down.
        stretch: (G,) relative changes of the duration.
        multipliers: by family, of every row (G, ...); zero where it does not bind.
    """

    coefficients: np.ndarray
    stretch: np.ndarray
    multipliers: Multipliers


def propose(quadratic: Quadratic, families: list[Family], penalty: np.ndarray, held: Multipliers) -> Proposal:
    """Solve the programs at a stack of curves.

    Args:
        quadratic: the objectives.
        families: all rows at the curves.
        penalty: (G, 3) by kind of row.
        held: by family, multipliers of rows to begin with beside those that are near.
    """
    count = len(quadratic.gradient)
    which = np.arange(count)
    free_t = np.swapaxes(quadratic.free, 1, 2)
    inverse = inverses(free_t @ quadratic.hessian @ quadratic.free)
    alone = -inverse @ (free_t @ quadratic.gradient)  # (G, k, A), the steps without rows
    coefficients, stretch = np.empty_like(quadratic.gradient), np.zeros(count)
    found = {family.name: np.zeros(family.room.shape) for family in families}
    chosen = [family.chosen(family.room < family.near, family.room, which) for family in families]
    for family, mask in zip(families, chosen, strict=True):
        if family.name in held:  # in a group another entry may hold now
            mask |= (held[family.name] > 0) & np.isfinite(family.room)
            mask[~family.in_reach] = False
    for round_ in range(_ROUNDS):
        rows = Rows.of(families, chosen, which)
        changes, stretches, multipliers = solve_duals(quadratic, inverse, alone, rows, penalty)
        step = Step(which, changes, taken(quadratic.rows, which) @ changes[:, None], stretches)
        coefficients[which], stretch[which] = changes, stretches
        added = np.zeros(len(which), dtype=bool)
        for family, mask, part in zip(families, chosen, rows.families, strict=True):
            found[family.name][which] = 0.0
            found[family.name][part.index] = multipliers[part.number]
            looked = family.in_reach[which]
            if not np.any(looked):
                continue
            own = step.some(looked)
            room = taken(family.room, own.which) - family.change(own)
            if family.time:
                room -= (family.time * own.stretch).reshape(-1, *[1] * (room.ndim - 1))
            broken = family.chosen(room < -BROKEN * family.near, room, own.which) & ~mask[own.which]
            if family.linear and round_ < _ALL_AT_ONCE:
                broken &= lowest(np.where(broken, room, np.inf))
            mask[own.which] = (mask[own.which] & (room < _KEPT * family.near)) | broken
            added[looked] |= np.any(broken.reshape(len(own.which), -1), axis=1)
        which = which[added]
        if not len(which):
            break
    _drop_small(found, count)
    return Proposal(coefficients=coefficients, stretch=stretch, multipliers=found)


def promised(
    quadratic: Quadratic, families: list[Family], multipliers: Multipliers, which: np.ndarray
) -> np.ndarray:
    """By how much programs of a given time can lower the objectives of curves that break nothing, at most.

    By weak duality, from any multipliers: those of the programs before tell next to exactly once steps are
    short.

    Args:
        quadratic: the objectives at a stack of curves.
        families: all rows at the curves.
        multipliers: by family, of every row, none larger than its penalty.
        which: (g,) numbers of the curves that are asked about.

    Returns:
        (g,).
    """
    # In a group another entry may hold now; without its multiplier the bound remains one.
    pushing = [(multipliers[family.name] > 0) & np.isfinite(family.room) for family in families]
    rows = Rows.of(families, pushing, which)
    y = np.zeros(len(rows.room))
    for family, part in zip(families, rows.families, strict=True):
        y[part.number] = multipliers[family.name][part.index]
    free = taken(quadratic.free, which)
    free_t = np.swapaxes(free, 1, 2)
    gradient = quadratic.gradient[which]
    left = free_t @ (gradient + pulls(rows, y, gradient.shape))
    inverse = inverses(free_t @ quadratic.hessian[which] @ free)
    by_slope = np.sum((left * (inverse @ left)).reshape(len(which), -1), axis=1) / 2
    by_room = np.array([np.sum(part) for part in np.split(y * rows.room, rows.ends[:-1])])
    return np.asarray(by_slope + by_room)


def _drop_small(multipliers: Multipliers, count: int) -> None:
    """Take for zero what is beside the largest multiplier of each of so many programs."""
    largest = np.zeros(count)
    for own in multipliers.values():
        largest = np.maximum(largest, np.max(own.reshape(count, -1), axis=1, initial=0))
    for own in multipliers.values():
        own[~(own > _BINDING * largest.reshape(-1, *[1] * (own.ndim - 1)))] = 0.0
