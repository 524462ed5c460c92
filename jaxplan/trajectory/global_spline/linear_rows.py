"""Rows that are true of every step: of joints by the coefficients, and of nodes in a tube.

All values of a spline lie between the least and the largest of its coefficients, and those of a derivative
likewise, so what holds for the coefficients holds at every instant.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jaxplan.trajectory.global_spline.rows import (
    LIMIT,
    NEAR_ANGLE,
    NEAR_SHARE,
    SIGNS,
    TUBE,
    Index,
    Slopes,
    Step,
    taken,
)


@dataclass(frozen=True, eq=False)
class _Linear:
    """What these families share."""

    coefficients: np.ndarray  # (G, n, A)
    linear = True

    @property
    def in_reach(self) -> np.ndarray:
        """Of the rows; all of them."""
        return np.ones(len(self.coefficients), dtype=bool)

    def chosen(self, wanted: np.ndarray, room: np.ndarray, which: np.ndarray) -> np.ndarray:
        """See `Family`; all of them."""
        return wanted


@dataclass(frozen=True, eq=False)
class Joints(_Linear):
    """Rates or accelerations of joints, by the coefficients of the derivative: rows (G, 2, n - d, joints)."""

    name: str
    power: int
    differences: np.ndarray  # (G, n - d, n)
    scale: np.ndarray  # (G, joints) 1 / (limit * duration^power)
    kind: int = LIMIT
    near: float = 2 * NEAR_SHARE

    @property
    def time(self) -> float:
        """Of the rows."""
        return -float(self.power)

    @cached_property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return 1 - self._shares(np.arange(len(self.scale)), self.coefficients)

    def _shares(self, which: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        differences = taken(self.differences, which)
        return _both(differences @ coefficients[:, :, 3:] * self.scale[which][:, None])

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return self._shares(step.which, step.coefficients)

    def slopes(self, index: Index) -> Slopes:
        """See `Family`."""
        curve, sign, row, joint = index
        factor = SIGNS[sign] * self.scale[curve, joint]
        return _of_axis(3 + joint, factor, self.differences[curve, row], self.coefficients.shape[2])


@dataclass(frozen=True, eq=False)
class Ranges(_Linear):
    """Angles of the joints by the coefficients: rows (G, 2, n, joints)."""

    limits: np.ndarray  # (G, joints)
    name: str = "range"
    kind: int = LIMIT
    near: float = NEAR_ANGLE
    time: float = 0.0

    @cached_property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return self.limits[:, None, None] - _both(self.coefficients[:, :, 3:])

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return _both(step.coefficients[:, :, 3:])

    def slopes(self, index: Index) -> Slopes:
        """See `Family`."""
        _, sign, row, joint = index
        _, size, axes = self.coefficients.shape
        return _of_axis(3 + joint, SIGNS[sign], np.eye(size)[row], axes)


@dataclass(frozen=True, eq=False)
class Tube:
    """Nodes that a curve must pass within a tube.

    Attributes:
        rows: (m, n) of the basis at the nodes.
        values: (m, A) rad.
        radius: (A,) rad, for each axis.
    """

    rows: np.ndarray
    values: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True, eq=False)
class Nodes(_Linear):
    """Tubes about nodes: rows (G, 2, m, A), as shares of the radius."""

    rows: np.ndarray  # (G, m, n)
    values: np.ndarray  # (G, m, A)
    radius: np.ndarray  # (G, A)
    name: str = "tube"
    kind: int = TUBE
    near: float = 2 * NEAR_SHARE
    time: float = 0.0

    @cached_property
    def room(self) -> np.ndarray:
        """Of the rows."""
        off = self.rows @ self.coefficients - self.values
        return 1 - _both(off / self.radius[:, None])

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return _both(self.rows[step.which] @ step.coefficients / self.radius[step.which][:, None])

    def slopes(self, index: Index) -> Slopes:
        """See `Family`."""
        curve, sign, node, axis = index
        factor = SIGNS[sign] / self.radius[curve, axis]
        return _of_axis(axis, factor, self.rows[curve, node], self.coefficients.shape[2])


def _both(values: np.ndarray) -> np.ndarray:
    """Values (g, ...) with both signs (g, 2, ...)."""
    return np.stack([values, -values], axis=1)


def _of_axis(axis: np.ndarray, factor: np.ndarray, basis: np.ndarray, axes: int) -> Slopes:
    """Slopes of rows (R,) that are of one axis each."""
    own = np.zeros((len(axis), 1, axes))
    own[np.arange(len(axis)), 0, axis] = factor
    return Slopes(own, basis[:, None])
