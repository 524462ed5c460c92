"""Rows that are true of every step: of joints by the coefficients, and of nodes in a tube.

All values of a spline lie between the least and the largest of its coefficients, and those of a derivative
likewise, so what holds for the coefficients holds at every instant.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan.trajectory.global_spline.bases import Basis
from jaxplan.trajectory.global_spline.rows import LIMIT, NEAR_ANGLE, NEAR_SHARE, SIGNS, TUBE, Index, Step


@dataclass(frozen=True, eq=False)
class Joints:
    """Rates or accelerations of joints, by the coefficients of the derivative: rows (2, n - d, joints)."""

    name: str
    power: int
    basis: Basis
    coefficients: np.ndarray
    scale: np.ndarray  # (joints,) 1 / (limit * duration^power)
    kind: int = LIMIT
    near: float = 2 * NEAR_SHARE
    linear: bool = True

    @property
    def time(self) -> float:
        """Of the rows."""
        return -float(self.power)

    @property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return 1 - self._shares(self.coefficients)

    def _shares(self, coefficients: np.ndarray) -> np.ndarray:
        shares = self.basis.differences[self.power] @ coefficients[:, 3:] * self.scale
        return np.multiply.outer(SIGNS, shares)

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return self._shares(step.coefficients)

    def slopes(self, index: Index) -> np.ndarray:
        """See `Family`."""
        sign, row, joint = index
        slopes = np.zeros((len(row), *self.coefficients.shape[::-1]))
        factor = SIGNS[sign] * self.scale[joint]
        slopes[np.arange(len(row)), 3 + joint] = factor[:, None] * self.basis.differences[self.power][row]
        return slopes

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """See `Family`; all of them."""
        return wanted


@dataclass(frozen=True, eq=False)
class Ranges:
    """Angles of the joints by the coefficients: rows (2, n, joints)."""

    coefficients: np.ndarray
    limits: np.ndarray
    name: str = "range"
    kind: int = LIMIT
    near: float = NEAR_ANGLE
    time: float = 0.0
    linear: bool = True

    @property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return self.limits - np.multiply.outer(SIGNS, self.coefficients[:, 3:])

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return np.multiply.outer(SIGNS, step.coefficients[:, 3:])

    def slopes(self, index: Index) -> np.ndarray:
        """See `Family`."""
        sign, row, joint = index
        slopes = np.zeros((len(row), *self.coefficients.shape[::-1]))
        slopes[np.arange(len(row)), 3 + joint, row] = SIGNS[sign]
        return slopes

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """See `Family`; all of them."""
        return wanted


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

    def off(self, coefficients: np.ndarray) -> np.ndarray:
        """How far beyond the tube a curve passes the nodes, (m, A) rad; negative within."""
        return np.abs(self.rows @ coefficients - self.values) - self.radius


@dataclass(frozen=True, eq=False)
class Nodes:
    """A tube about nodes: rows (2, m, A), as shares of its radius."""

    tube: Tube
    coefficients: np.ndarray
    name: str = "tube"
    kind: int = TUBE
    near: float = 2 * NEAR_SHARE
    time: float = 0.0
    linear: bool = True

    @property
    def room(self) -> np.ndarray:
        """Of the rows."""
        off = self.tube.rows @ self.coefficients - self.tube.values
        return 1 - np.multiply.outer(SIGNS, off / self.tube.radius)

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return np.multiply.outer(SIGNS, self.tube.rows @ step.coefficients / self.tube.radius)

    def slopes(self, index: Index) -> np.ndarray:
        """See `Family`."""
        sign, node, axis = index
        slopes = np.zeros((len(node), *self.coefficients.shape[::-1]))
        factor = SIGNS[sign] / self.tube.radius[axis]
        slopes[np.arange(len(node)), axis] = factor[:, None] * self.tube.rows[node]
        return slopes

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """See `Family`; all of them."""
        return wanted
