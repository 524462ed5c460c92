"""Piecewise polynomials in the Legendre basis, evaluated with all their derivatives.

Derivatives are taken of the Legendre coefficients, once, in their own basis: a change to powers over a
whole piece would cost four digits at order 12.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.polynomial import legendre

# Size of the rounding error of a sum or of a short computation, relative to the size of its terms.
ROUNDING = 8 * float(np.finfo(np.float64).eps)


@lru_cache
def _operators(degree: int) -> np.ndarray:
    """Matrices (k, to, from) that map Legendre coefficients to those of the k-th derivative over k!."""
    once = np.zeros((degree + 1, degree + 1))
    once[:degree] = legendre.legder(np.eye(degree + 1))[:degree]
    powers = [np.eye(degree + 1)]
    for k in range(1, degree + 1):
        powers.append(once @ powers[-1] / k)
    return np.stack(powers)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """Polynomials of degree p in c components on the intervals between breaks.

    Attributes:
        breaks: (N + 1,) s.
        derivatives: (N, p + 1, p + 1, c) Legendre coefficients (second axis) of the k-th derivative in time
            over k! (third axis).
    """

    breaks: np.ndarray
    derivatives: np.ndarray

    @classmethod
    def of(cls, breaks: np.ndarray, coefficients: np.ndarray) -> Self:
        """From Legendre coefficients of shape (N, p + 1, c)."""
        degree = coefficients.shape[1] - 1
        unit = (2 / np.diff(breaks))[:, None, None] ** np.arange(degree + 1)[:, None]
        derivatives = np.einsum("kij,njc->nikc", _operators(degree), coefficients)
        return cls(breaks=breaks, derivatives=derivatives * unit[:, None])

    @property
    def length(self) -> int:
        """Number of coefficients, p + 1."""
        return self.derivatives.shape[1]

    def holding(self, time: np.ndarray) -> np.ndarray:
        """Numbers of the pieces that hold at some times; at a break the later one."""
        return np.clip(np.searchsorted(self.breaks, time, side="right") - 1, 0, len(self.breaks) - 2)

    def taylor(self, piece: np.ndarray, time: np.ndarray, orders: int) -> np.ndarray:
        """Taylor coefficients about some instants.

        Args:
            piece: (n,) number of the polynomial to take.
            time: (n, m) s.
            orders: how many coefficients.

        Returns:
            (orders, c, n, m), of the powers of seconds.
        """
        first, last = self.breaks[piece, None], self.breaks[piece + 1, None]
        argument = ((time - first) - (last - time)) / (last - first)
        length, components = self.length, self.derivatives.shape[3]
        known = min(orders, length)
        table = self.derivatives[piece, :, :known].reshape(len(piece), length, known * components)
        values = legendre.legvander(argument, length - 1) @ table  # (n, m, orders and components)
        result = np.zeros((orders, components, *time.shape))
        result[:known] = np.moveaxis(values, -1, 0).reshape(known, components, *time.shape)
        return result

    def rounding(self, piece: np.ndarray, orders: int) -> np.ndarray:
        """Sizes of the rounding errors of `taylor` on whole pieces, (orders, c, n).

        They are those of the sums and, a quarter as large relative to its slope, that of their argument.
        """
        terms = np.abs(self.derivatives[:, :, : orders + 1]).sum(axis=1)  # (N, orders, c)
        sizes = np.zeros((len(terms), orders + 1, terms.shape[2]))
        sizes[:, : terms.shape[1]] = terms
        half = np.diff(self.breaks)[:, None, None] / 2
        slopes = np.arange(1, orders + 1)[:, None] * sizes[:, 1:] * half
        return ROUNDING * np.moveaxis((sizes[:, :-1] + slopes / 4)[piece], 0, -1)
