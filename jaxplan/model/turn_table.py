"""Tabulated lengths of turns: proved lower bounds of the integral of the magnitude of the angular velocity.

A *length* ``F`` of a turn is such a bound for every motion that makes the turn. It has ``F(I) = 0``, and
along every motion F grows no faster than the magnitude of the angular velocity ``w`` (body axes), by one of
two measures. With rates ``c`` (3,) they are

    of a box,        max over i of |w_i| / c_i               or
    of an ellipsoid, square root of the sum of (w_i / c_i)^2.

So with ``|w_i| <= c_i`` no motion makes the turn in less than ``F`` seconds. With ``X_i F`` for the slope of
F along a turn about body axis i, the condition that F grows no faster is

    sum of c_i |X_i F| <= 1,      square root of the sum of (c_i X_i F)^2 <= 1.

For no box is the *eigenaxis* turn, about one fixed axis, always the quickest: where each axis has a limit of
its own, turns about the diagonals are quicker, and a half turn about x takes 0.77 of what it takes about x
alone.

**Coordinates.** A turn is a rotation vector ``r`` (3,) rad in body axes, ``|r| <= pi``. Let
``q_i = |r_i| / c_i``, let ``f`` be the axis with the largest, and the other axes follow in the order x, y, z,
x. The turn has the coordinates ``|r|``, ``q_(f+1) / q_f``, ``q_(f+2) / q_f``. The table has ``F / q_f``,
linear between its places along each coordinate. F does not change with the signs of the components of ``r``:
half of the changes of sign turn the body's axes by half a turn, the others run the motion backwards. So the
condition must hold both for ``F`` and for F of the inverse turn.

Only the ratios of the rates matter, ``c_2 / c_1`` and ``c_3 / c_2`` of rates in falling order. Between the
tabulated ratios F / q_f is linear as well; since lengths would grow a little too fast there, they are divided
by a bound of their growth. A ratio below the least one in the table is replaced by that: rates are raised,
and what bounds motions with higher rates bounds these.

bench/turn_table.py made the table. tests/turn_growth.py proves that its lengths grow no faster than they may,
cell by cell and for all ratios of rates, and tests/model/test_turn_table.py makes this proof anew.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, array_module, arrays, length

Measure = Literal["box", "ellipsoid"]
"""The size of the angular velocity that a length bounds the integral of."""

FILE = Path(__file__).with_name("turn_table.npz")
UNIT = 2.0**-15
"""Share that a one of the file's integers is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TurnTable:
    """A table of the lengths of turns, by one measure; letters are as in the module's docstring.

    Attributes:
        ratios: (U,) and (V,), rising to 1: ratios of the second to the first rate, and of the third to the
            second.
        finer: (P,) and (Q,), the same ratios at closer places.
        slopes: (P, Q) bounds of how fast the interpolated lengths grow, by which they are divided; linear
            between the places of `finer`.
        shares: (U, V, 3, K, L, L) values of ``F / q_f``, by both ratios of rates, axis f, |r|, and both
            ratios of q.
    """

    ratios: tuple[np.ndarray, np.ndarray]
    finer: tuple[np.ndarray, np.ndarray]
    slopes: np.ndarray
    shares: np.ndarray

    def length(self, turns: ArrayLike, rates: ArrayLike) -> AnyArray:
        """Return lengths (...) s of turns (..., 3) rad for rates (3,) rad/s, as `lengths` of these does."""
        return self.lengths(rates).of(turns)

    def lengths(self, rates: ArrayLike) -> "Lengths":
        """Return the tables for rates ``c`` (..., 3) rad/s, positive, by body axis."""
        by, c = arrays(rates)
        order = by.argsort(-c, axis=-1)
        shares, used = self.at(by.take_along_axis(c, order, axis=-1))
        return Lengths(order, used, shares)

    def at(self, rates: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Return the tables (..., 3, K, L, L) for given rates, and the rates for which they hold.

        Args:
            rates: (..., 3) rad/s, each three in falling order.

        Returns:
            Values of ``F / q_f``, and the rates (..., 3), raised where their ratios are beyond the end of the
            table.
        """
        xp, c = arrays(rates)
        first = c[..., 0]
        second = first * xp.maximum(c[..., 1] / first, self.ratios[0][0])
        third = second * xp.maximum(c[..., 2] / second, self.ratios[1][0])
        ratios = second / first, third / second
        slopes = _bilinear(self.slopes, self.finer, ratios)[..., None, None, None, None]
        return _bilinear(self.shares, self.ratios, ratios) / slopes, xp.stack([first, second, third], axis=-1)


class Lengths(NamedTuple):
    """The lengths of turns for given rates, or for several along leading axes.

    Attributes:
        order: (..., 3) int, body axes by falling rate.
        used: (..., 3) rad/s, rates in that order for which the table holds.
        shares: (..., 3, K, L, L), values of ``F / q_f`` as in `TurnTable`.
    """

    order: AnyArray
    used: AnyArray
    shares: AnyArray

    def of(self, turns: ArrayLike) -> AnyArray:
        """Return lengths of turns by interpolation in the table, for rates (3,).

        Args:
            turns: (..., 3) rad, rotation vectors in body axes, at most pi long.

        Returns:
            (...) s; derivatives exist almost everywhere, and are finite elsewhere.
        """
        xp, r, used, table = arrays(turns, self.used, self.shares)
        q = xp.abs(r[..., self.order]) / used
        face = xp.argmax(q, axis=-1)
        q = xp.take_along_axis(q, (face[..., None] + np.arange(3)) % 3, axis=-1)
        largest = xp.where(q[..., 0] > 0, q[..., 0], 1)
        angle = xp.minimum(length(r) / np.pi, 1)
        places = [angle, q[..., 1] / largest, q[..., 2] / largest]
        return q[..., 0] * _trilinear(table, face, places)


def _bilinear(
    values: AnyArray, known: tuple[np.ndarray, np.ndarray], ratios: tuple[AnyArray, AnyArray]
) -> AnyArray:
    """Interpolate values linearly at two ratios.

    Args:
        values: (U, V, ...) at known ratios.
        known: (U,) and (V,), the known ratios, rising.
        ratios: the two ratios, each of any shape.

    Returns:
        An array with the axes of the ratios, then the further ones of the values; a ratio outside of the
        known ones is taken as the nearest of them.
    """
    xp = array_module(*ratios)
    each = [
        xp.stack([xp.interp(ratio, own, row) for row in np.eye(len(own))], axis=-1)
        for own, ratio in zip(known, ratios, strict=True)
    ]
    return xp.tensordot(each[0][..., :, None] * each[1][..., None, :], xp.asarray(values), axes=2)


def _trilinear(table: AnyArray, face: AnyArray, places: list[AnyArray]) -> AnyArray:
    """Interpolate a table (3, K, L, L) linearly along its three last axes.

    Args:
        table: values by the axis of the largest q, and at places evenly from 0 to 1 along the other axes.
        face: (...) int, the axis of the largest q.
        places: three arrays (...) in [0, 1], where to interpolate.

    Returns:
        (...) values.
    """
    xp = array_module(table, *places)
    cells = []
    for place, count in zip(places, table.shape[1:], strict=True):
        at = place * (count - 1)
        low = xp.clip(xp.floor(at).astype(int), 0, count - 2)
        cells.append((low, at - low))
    found, flat = 0, table.reshape(-1)
    for corner in np.ndindex(2, 2, 2):
        index, weight = face, 1
        for (low, above), step, count in zip(cells, corner, table.shape[1:], strict=True):
            index = index * count + low + step
            weight = weight * (above if step else 1 - above)
        found = found + flat[index] * weight
    return found


@cache
def turn_table(measure: Measure) -> TurnTable:
    """Load the table of a measure from the package; it is read only once."""
    with np.load(FILE, allow_pickle=False) as file:
        ratios, finer = (
            (file[f"{measure}_{name}_1"], file[f"{measure}_{name}_2"]) for name in ("ratios", "finer")
        )
        return TurnTable(
            ratios=ratios, finer=finer, slopes=file[f"{measure}_slopes"], shares=file[measure] * UNIT
        )
