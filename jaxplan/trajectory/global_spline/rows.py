"""What a family of linear rows near curves is.

Curves are looked at together: a stack of G, each with its own rows. A row says
``slopes . dc + time * dT / T <= room`` of a change ``dc`` of the coefficients and ``dT`` of the duration. A
family knows the room of all its rows and how a step changes it, and writes out only the rows that a program
asks for.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

LIMIT, ZONE, TUBE = range(3)  # kinds of rows

# Rows with less room than this are in a program from the start: shares of a limit or of a tube, and angles.
NEAR_SHARE = 0.15
NEAR_ANGLE = float(np.deg2rad(1.0))

SIGNS = np.array([1.0, -1.0])  # of a bound on both sides

Index = tuple[np.ndarray, ...]  # of rows, the number of the curve first


class Step(NamedTuple):
    """Changes of some curves of a stack.

    Attributes:
        which: (g,) numbers of the curves.
        coefficients: (g, n, A).
        curves: (g, 4, S, A) what that makes of values and derivatives at the places.
        stretch: (g,) relative change of the duration.
    """

    which: np.ndarray
    coefficients: np.ndarray
    curves: np.ndarray
    stretch: np.ndarray

    def some(self, which: np.ndarray) -> "Step":
        """Those of (g,) bool."""
        return self if np.all(which) else Step(*(own[which] for own in self))


class Slopes(NamedTuple):
    """Slopes of some rows in the coefficients: sums of J products of a row of the axes and one of the basis.

    Attributes:
        axes: (R, J, A).
        basis: (R, J, n).
    """

    axes: np.ndarray
    basis: np.ndarray

    @property
    def full(self) -> np.ndarray:
        """(R, A, n)."""
        return np.asarray(np.swapaxes(self.axes, 1, 2) @ self.basis)


class Family(Protocol):
    """Rows of one sort.

    Attributes:
        name: unique among the families of a fit.
        kind: `LIMIT`, `ZONE` or `TUBE`.
        room: of every row (G, ...).
        near: rows with less room are near.
        time: of the rows.
        linear: whether the rows are true of all steps, not of small ones alone.
        in_reach: (G,) whether a step may break any of the rows.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def kind(self) -> int: ...  # noqa: D102
    @property
    def room(self) -> np.ndarray: ...  # noqa: D102
    @property
    def near(self) -> float: ...  # noqa: D102
    @property
    def time(self) -> float: ...  # noqa: D102
    @property
    def linear(self) -> bool: ...  # noqa: D102
    @property
    def in_reach(self) -> np.ndarray: ...  # noqa: D102

    def change(self, step: Step) -> np.ndarray:
        """By how much a step lessens the room (g, ...) of the curves that take it, without its stretch."""
        ...

    def slopes(self, index: Index) -> Slopes:
        """Of some rows."""
        ...

    def chosen(self, wanted: np.ndarray, room: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Of the rows that are wanted (g, ...) of some curves, those that do, given what room they have."""
        ...


def numbers(chosen: np.ndarray) -> Index:
    """Of the rows that are chosen, (G, ...) bool; `np.nonzero`, many times as fast where they are few."""
    return np.unravel_index(np.flatnonzero(chosen), chosen.shape)


def lowest(room: np.ndarray) -> np.ndarray:
    """Where the room is least among neighbours along the second to last axis."""
    kept = np.ones(room.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        down = room[..., 1:, :] <= room[..., :-1, :]
        up = room[..., :-1, :] <= room[..., 1:, :]
    kept[..., 1:, :] &= down
    kept[..., :-1, :] &= up
    return kept


def stacked(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays (G, ...); what all share is there but once."""
    first = arrays[0]
    if all(array is first for array in arrays):
        return np.broadcast_to(first, (len(arrays), *first.shape))
    return np.stack(arrays)


def taken(array: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Some of `stacked` arrays, by rising number or as (G,) bool, to be read only: no copy of all of them."""
    count = int(np.sum(which)) if which.dtype == bool else len(which)
    if count == len(array):
        return array
    if array.strides[0] == 0:
        return np.broadcast_to(array[0], (count, *array.shape[1:]))
    return array[which]
