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
_ENDS = slice(None, -1), slice(1, None)


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
    """Polynomials of degree p in c components on the intervals between breaks, of one curve or of several.

    The pieces of all curves are numbered one after the other.

    Attributes:
        first: (N,) s, where each piece begins.
        last: (N,) s, where it ends.
        derivatives: (N, p + 1, p + 1, c) Legendre coefficients (second axis) of the k-th derivative in time
            over k! (third axis).
        begins: (curves + 1,) number of each curve's first piece, and N.
    """

    first: np.ndarray
    last: np.ndarray
    derivatives: np.ndarray
    begins: np.ndarray

    @classmethod
    def of(cls, *curves: tuple[np.ndarray, np.ndarray]) -> Self:
        """From the breaks and the Legendre coefficients of each curve, the latter (pieces, p + 1, c)."""
        first, last = (np.concatenate([breaks[part] for breaks, _ in curves]) for part in _ENDS)
        coefficients = np.concatenate([own for _, own in curves])
        pieces, length, components = coefficients.shape
        # One product a piece, so that none depends on how many there are.
        derivatives = _operators(length - 1).reshape(-1, length) @ coefficients
        derivatives = derivatives.reshape(pieces, length, length, components).swapaxes(1, 2)
        unit = (2 / (last - first))[:, None, None] ** np.arange(length)[:, None]
        return cls(
            first=first,
            last=last,
            derivatives=derivatives * unit[:, None],
            begins=np.cumsum([0, *(len(own) for _, own in curves)]),
        )

    @property
    def length(self) -> int:
        """Number of coefficients, p + 1."""
        return self.derivatives.shape[1]

    def breaks(self, curve: int = 0) -> np.ndarray:
        """(pieces + 1,) s, of one curve."""
        own = slice(*self.begins[curve : curve + 2])
        return np.append(self.first[own], self.last[own][-1:])

    def holding(self, time: np.ndarray, curve: int = 0) -> np.ndarray:
        """Numbers of the pieces of one curve that hold at some times; at a break the later one."""
        begin, end = self.begins[curve : curve + 2]
        return begin + np.clip(np.searchsorted(self.first[begin:end], time, side="right") - 1, 0, None)

    def taylor(self, piece: np.ndarray, time: np.ndarray, orders: int) -> np.ndarray:
        """Taylor coefficients about some instants.

        Args:
            piece: (n,) number of the polynomial to take.
            time: (n, m) s.
            orders: how many coefficients.

        Returns:
            (orders, c, n, m), of the powers of seconds.
        """
        first, last = self.first[piece, None], self.last[piece, None]
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
        half = (self.last - self.first)[:, None, None] / 2
        slopes = np.arange(1, orders + 1)[:, None] * sizes[:, 1:] * half
        return ROUNDING * np.moveaxis((sizes[:, :-1] + slopes / 4)[piece], 0, -1)
