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
        of_values: (n, v) what takes the given values, those at the ends first, to ``f``.
        of_rates: (n, 2) what takes the rates at the ends to ``g``.
        fixed: (n, A) ``f``.
        by_time: (n, A) 1/s, ``g``.
        energies: (4, n, n) of the basis.
    """

    basis: Basis
    free: np.ndarray
    of_values: np.ndarray
    of_rates: np.ndarray
    fixed: np.ndarray
    by_time: np.ndarray
    energies: np.ndarray

    @classmethod
    def of(cls, basis: Basis, ends: Ends) -> "CurveSpace":
        """All splines with the given ends."""
        free, of_values, of_rates = basis.ends(ends.rest)
        return cls(
            basis=basis,
            free=free,
            of_values=of_values,
            of_rates=of_rates,
            fixed=of_values @ ends.values,
            by_time=of_rates @ ends.rates,
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
        lift = self.free @ np.linalg.solve(r[:count], own.T).T  # from what is missing at the nodes
        return CurveSpace(
            basis=self.basis,
            free=self.free @ rest,
            of_values=np.concatenate([self.of_values - lift @ (rows @ self.of_values), lift], axis=1),
            of_rates=self.of_rates - lift @ (rows @ self.of_rates),
            fixed=self.fixed + lift @ (values - rows @ self.fixed),
            by_time=self.by_time - lift @ (rows @ self.by_time),
            energies=self.energies,
        )


def weighted(energies: np.ndarray, duration: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Matrices (G, n, n) of the integral of weighted squares over time, of one axis.

    Args:
        energies: (G, 4, n, n) as `CurveSpace` has them.
        duration: (G,) s.
        weights: (G, 3) of the squares of rate, acceleration and jerk.
    """
    factors = weights * duration[:, None] ** -np.array([1.0, 3.0, 5.0])
    _, *parts = np.moveaxis(energies, 1, 0)
    rate, acceleration, jerk = (
        factor[:, None, None] * part for factor, part in zip(factors.T, parts, strict=True)
    )
    return np.asarray(rate + acceleration + jerk)
