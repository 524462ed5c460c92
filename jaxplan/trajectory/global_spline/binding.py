"""Which rows bind where a fit ended: the next set to try, after one that was wrong or whose rows depend."""

from contextlib import suppress

import numpy as np

from jaxplan.trajectory.global_spline import program
from jaxplan.trajectory.global_spline.rows import Family

_TOUCHING = 1e-6  # room of a row that may bind

Masks = dict[str, np.ndarray]


def next_rows(family: Family, binding: np.ndarray, multipliers: np.ndarray, least: float) -> np.ndarray:
    """Which rows of a family (of one curve) to try next: without those that pull, with those that are broken.

    Of rows at places only the worst of each zone or load, since those beside it mean the same.
    """
    pulling = binding & (multipliers < least)
    room = family.room
    broken = ~binding & family.chosen(room < -program.BROKEN * family.near, room, np.zeros(1, int))
    if not family.linear:
        worst = np.arange(room.shape[1]).reshape(-1, *[1] * (room.ndim - 2))
        if np.any(pulling):
            return binding & ~(pulling & (worst == np.argmin(np.where(pulling, multipliers, 0), axis=1)))
        broken &= worst == np.argmin(np.where(broken, room, np.inf), axis=1)
    return (binding & ~pulling) | broken


def independent(families: dict[str, Family], binding: Masks, quadratic: program.Quadratic) -> Masks:
    """Multipliers of few of the rows that bind or touch, none of which follows from the others.

    They are those that push and hold the objective's gradient best.
    """
    from scipy.optimize import nnls

    touching = {name: np.nonzero(binding[name] | (f.room < _TOUCHING)) for name, f in families.items()}
    free = quadratic.free[0]
    slopes = [families[name].slopes(index).full @ free for name, index in touching.items()]
    gradient = (free.T @ quadratic.gradient[0]).T
    every = np.concatenate([own.reshape(-1, gradient.size) for own in slopes])
    flat = np.zeros(len(every))
    if len(every):  # on none it crashes
        with suppress(RuntimeError):  # of too many iterations: then no row is taken to bind
            flat = nnls(every.T, -gradient.ravel())[0]
    found = {}
    for name, index in touching.items():
        found[name] = np.zeros(families[name].room.shape)
        found[name][index], flat = flat[: len(index[0])], flat[len(index[0]) :]
    return found
