"""What a family of linear rows near a curve is.

A row says ``slopes . dc + time * dT / T <= room`` of a change ``dc`` of the coefficients and ``dT`` of the
duration. A family knows the room of all its rows and how a step changes it, and writes out only the rows that
a program asks for.
"""

from typing import NamedTuple, Protocol

import numpy as np

LIMIT, ZONE, TUBE = range(3)  # kinds of rows

# Rows with less room than this are in a program from the start: shares of a limit or of a tube, and angles.
NEAR_SHARE = 0.15
NEAR_ANGLE = float(np.deg2rad(1.0))

SIGNS = np.array([1.0, -1.0])  # of a bound on both sides

Index = tuple[np.ndarray, ...]


class Step(NamedTuple):
    """A change of a curve.

    Attributes:
        coefficients: (n, A).
        curves: (4, S, A) what that makes of values and derivatives at the places.
        stretch: relative change of the duration.
    """

    coefficients: np.ndarray
    curves: np.ndarray
    stretch: float


class Family(Protocol):
    """Rows of one sort.

    Attributes:
        name: unique among the families of a fit.
        kind: `LIMIT`, `ZONE` or `TUBE`.
        room: of every row, in any shape.
        near: rows with less room are near.
        time: of the rows.
        linear: whether the rows are true of all steps, not of small ones alone.
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

    def change(self, step: Step) -> np.ndarray:
        """By how much a step lessens the room, without its stretch; like `room`."""
        ...

    def slopes(self, index: Index) -> np.ndarray:
        """Slopes (R, A, n) of some rows, in the coefficients."""
        ...

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """Of the rows that are wanted (like `room`), those that do, given what room they have."""
        ...
