"""Moments of inertia: a matrix, or three moments, about body axes or a device's own."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan.runtime.arguments import as_floats
from jaxplan.schema.arrays import Array, shown_value
from jaxplan.schema.faults import Place
from jaxplan.schema.value_kinds import Kind, Number

NO_BODY = "no principal moment above the sum of the other two, as no body has"
"""What inertias are refused for that no distribution of mass has."""

# Indices of products of inertia, each of which is in the matrix twice.
_OFF_DIAGONAL = ((0, 1), (0, 2), (1, 2))


def _check_inertia(array: np.ndarray, value: Any, place: Place) -> Any:
    """Check that a body can have an inertia, a matrix (3, 3) or moments (3,) about the axes; a `Rule`."""
    matrix = array if array.ndim == 2 else np.diag(array)
    scaled = matrix / (np.max(np.abs(matrix)) or 1)  # so that the thresholds below are relative
    small, middle, large = np.linalg.eigvalsh((scaled + scaled.T) / 2)
    unlike = [pair for pair in _OFF_DIAGONAL if abs(scaled[pair] - scaled.T[pair]) > 1e-9]
    if unlike:
        told = (
            f"[{i}][{j}] = {matrix[i, j]:.12g} is not [{j}][{i}] = {matrix[j, i]:.12g}" for i, j in unlike
        )
        complaint = f"must be symmetric, but {', '.join(told)}"
    elif small <= 1e-12:  # rounding may leave a singular one slightly positive
        complaint = "must be positive definite"
    elif np.max(matrix) < 1e-12:
        complaint = "must have its largest moment in [1e-12, 1e12]"
    elif large > (small + middle) * (1 + 1e-9):
        complaint = f"must have {NO_BODY}"
    else:
        return array
    return place.fault(complaint, shown_value(array, value, place))


@dataclass(frozen=True)
class Moments(Kind):
    """A moment of inertia, as a matrix or as three moments about the axes; the model keeps the form given.

    Attributes:
        of: kind of each number.
    """

    of: Number
    wanted = "3 moments, or 3 rows of 3 numbers"

    @property
    def range(self) -> str | None:
        return self.of.range

    def read(self, value: Any, place: Place) -> Any:
        array = as_floats(value) if place.reading.python else None
        rows = (
            list(value)
            if isinstance(value, list | tuple)
            else array
            if array is not None and array.ndim
            else ()
        )
        if len(rows) != 3:
            size = f", not of {len(rows)}" if isinstance(value, list | tuple) else ""
            return place.refuse(f"must be an array of {self.wanted}{size}", value)
        nested = sum(isinstance(row, list | tuple) or np.ndim(row) > 0 for row in rows) > 1
        return Array((3, 3) if nested else (3,), self.of, noun=self._noun(nested), rule=_check_inertia).read(
            value, place
        )

    def write(self, value: Any) -> Any:
        return np.asarray(value, float).tolist()

    def _noun(self, nested: bool) -> str:
        """Return what the numbers are, for messages."""
        return "3 rows of 3 numbers" if nested else "3 numbers"
