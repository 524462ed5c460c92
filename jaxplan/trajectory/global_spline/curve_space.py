"""The curves that a fit may choose from: splines with given ends, and perhaps through given nodes.

Coefficients are ``c = F x + f + T g`` with the free ``x``; ``F`` is the same for all axes, ``g`` stands for
the rates at the ends, which in ``s`` grow with the duration ``T``.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan.trajectory.global_spline.bases import Basis


@dataclass(frozen=True, kw_only=True, eq=False)
class Ends:
    """What a curve must start and end with, in the chart.

    Attributes:
        values: (2, A) rad.
        rates: (2, A) rad/s.
        rest: whether accelerations are zero there; else they are free.
    """

    values: np.ndarray
    rates: np.ndarray
    rest: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveSpace:
    """Splines with given ends.

    Attributes:
        basis: of the splines.
        free: (n, k) ``F``.
        fixed: (n, A) ``f``.
        by_time: (n, A) 1/s, ``g``.
        energies: (4, n, n) of the basis.
    """

    basis: Basis
    free: np.ndarray
    fixed: np.ndarray
    by_time: np.ndarray
    energies: np.ndarray

    @classmethod
    def of(cls, basis: Basis, ends: Ends) -> "CurveSpace":
        """All splines with the given ends."""
        count = 3 if ends.rest else 2
        rows = basis.rows(np.array([0.0, 1.0]), count)
        fixed = np.zeros((basis.size, ends.values.shape[1]))
        by_time = np.zeros_like(fixed)
        for end, part in enumerate((slice(0, count), slice(basis.size - count, basis.size))):
            # At an end only as many B-splines differ from zero as derivatives are given.
            solve = np.linalg.inv(rows[:, end, part])
            fixed[part] = np.outer(solve[:, 0], ends.values[end])
            by_time[part] = np.outer(solve[:, 1], ends.rates[end])
        return cls(
            basis=basis,
            free=np.eye(basis.size)[:, count:-count],
            fixed=fixed,
            by_time=by_time,
            energies=basis.energies,
        )

    def through(self, places: np.ndarray, values: np.ndarray) -> "CurveSpace":
        """Those of them that pass nodes exactly.

        Args:
            places: (m,) in (0, 1); on no interval more nodes than the splines have freedom there.
            values: (m, A) rad.
        """
        rows = self.basis.rows(places, 1)[0]
        q, r = np.linalg.qr((rows @ self.free).T, mode="complete")
        count = len(places)
        own, rest = q[:, :count], q[:, count:]
        to_values = np.linalg.solve(
            r[:count].T, np.column_stack([values - rows @ self.fixed, rows @ self.by_time])
        )
        fixed, by_time = np.split(self.free @ own @ to_values, 2, axis=1)
        return CurveSpace(
            basis=self.basis,
            free=self.free @ rest,
            fixed=self.fixed + fixed,
            by_time=self.by_time - by_time,
            energies=self.energies,
        )

    def energy(self, duration: float, weights: tuple[float, float, float]) -> np.ndarray:
        """Matrix (n, n) of the integral of squares over time, of one axis.

        Args:
            duration: s.
            weights: of the squares of rate, acceleration and jerk.
        """
        powers = float(duration) ** -np.array([1.0, 3.0, 5.0])
        return np.tensordot(np.array(weights) * powers, self.energies[1:], axes=1)
