"""Axes of zones that move, evaluated anew from what a path is: samples, their times, slopes there.

On a piece between two samples ``s`` is a cubic, ``e = s / |s|``. The majorant of ``e`` on an interval (see
`jets`) is that of ``s`` times that of ``q^(-1/2)`` with ``q = |s|^2``: where ``q`` is at least ``l`` on the
interval, and ``Q`` is a majorant of it without its constant term, ``(l - Q)^(-1/2)`` is one.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from jaxplan.certificate import jets
from jaxplan.certificate.pieces import ROUNDING

if TYPE_CHECKING:
    from jaxplan.model.moving import DirectionPath


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """An axis over time.

    Attributes:
        breaks: (n,) s.
        cubics: (4, 3, n - 1) Taylor coefficients of ``s`` on each piece about its start.
    """

    breaks: np.ndarray
    cubics: np.ndarray

    @classmethod
    def of(cls, path: "DirectionPath") -> Self:
        """From a path of finite numbers whose times rise."""
        times, p, m = (np.asarray(part, np.float64) for part in (path.times, path.samples, path.slopes))
        h = np.diff(times)[:, None]
        chord = np.diff(p, axis=0) / h
        square, cube = (3 * chord - 2 * m[:-1] - m[1:]) / h, (m[:-1] + m[1:] - 2 * chord) / h**2
        return cls(breaks=times, cubics=np.moveaxis(np.stack([p[:-1], m[:-1], square, cube]), 1, 2))

    def holding(self, time: np.ndarray) -> np.ndarray:
        """Numbers of the pieces that hold at some times; at a break the later one."""
        return np.clip(np.searchsorted(self.breaks, time, side="right") - 1, 0, len(self.breaks) - 2)

    def at(self, piece: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Unit vectors (3, n, m) at times (n, m) s of some pieces (n,)."""
        value = self._taylor(piece, time)[0]
        return value / np.linalg.norm(value, axis=0)

    def majorant(self, centre: np.ndarray, half: np.ndarray, orders: int) -> np.ndarray:
        """Majorant (orders, n) on intervals within pieces, in the unit of half widths; one at order zero.

        Args:
            centre: (n,) s.
            half: (n,) s.
            orders: how many.
        """
        cubic = self._cubic(centre, half)
        padded = np.concatenate([cubic, np.zeros((3, *cubic.shape[1:]))])
        square = jets.product("in,in->n", padded, padded)  # of degree 6
        least = square[0] - np.abs(square[1:]).sum(axis=0)
        inverse = _inverse_root(np.where(least > 0, least, np.nan), jets.majorant(np.abs(square), orders))
        found = jets.product("n,n->n", jets.majorant(np.linalg.norm(cubic, axis=1), orders), inverse)
        found[0] = 1
        return found

    def rounding(self, centre: np.ndarray, half: np.ndarray) -> np.ndarray:
        """Sizes (n,) of the rounding errors of `at` on intervals."""
        return ROUNDING * (1 + np.linalg.norm(self._cubic(centre, half), axis=1).sum(axis=0))

    def _cubic(self, centre: np.ndarray, half: np.ndarray) -> np.ndarray:
        """Taylor coefficients (4, 3, n) of ``s`` about centres, in the unit of half widths."""
        about = self._taylor(self.holding(centre), centre[:, None])[..., 0]
        return about * half ** np.arange(4)[:, None, None]

    def _taylor(self, piece: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Taylor coefficients (4, 3, n, m) of ``s`` about times (n, m) of pieces (n,)."""
        x = time - self.breaks[piece, None]
        a, b, c, d = self.cubics[:, :, piece, None]
        return np.stack(
            [a + x * (b + x * (c + x * d)), b + x * (2 * c + 3 * x * d), c + 3 * x * d, d + 0 * x]
        )


def _inverse_root(least: np.ndarray, majorant: np.ndarray) -> np.ndarray:
    """Series (orders, n) of ``(least - Q)^(-1/2)``, ``Q`` the majorant without its constant term."""
    result = np.empty_like(majorant)
    result[0] = least**-0.5
    for k in range(1, len(majorant)):
        terms = [(k - i / 2) * majorant[i] * result[k - i] for i in range(1, k + 1)]
        result[k] = np.sum(terms, axis=0) / (k * least)
    return result
