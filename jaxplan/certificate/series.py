"""Power series in time of moving quantities, and piecewise polynomials in the Legendre basis.

**Jets** are the first K Taylor coefficients of functions of time, many at once. A jet is an array whose first
axis is the order: ``f(t + s) = sum_k jet[k] s^k``. The last axis, of length n below, numbers the instants or
intervals. A *majorant* of a function on an interval is a jet of numbers that bound the length of its Taylor
coefficients about every point of the interval. Sums, products and exponentials of majorants are again
majorants, so the same functions serve for both.

Quaternions ``q`` are of unit length, scalar first; ``q v q*`` turns body into inertial coordinates.

**Pieces** are polynomials in the Legendre basis, evaluated with all their derivatives. The Legendre
coefficients of the derivatives are computed once: a change to powers of time over a whole piece would cost
four digits at order 12.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import comb, factorial
from typing import Self

import numpy as np
from numpy.polynomial import legendre

# The series of `quaternion` holds up to this length of a rotation vector, in rad: the first
# term left out is below 1e-22 and the largest is about 3000.
LARGEST_TURN = 20.0
_SERIES_TERMS = 32  # of that series


def product(subscripts: str, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the jet of a product of two functions, ``f_k = sum_i a_i b_(k-i)``.

    Args:
        subscripts: how the factors are multiplied, as `numpy.einsum` takes it, without the axis of the order.
        first: (K, ...) jet.
        second: (K, ...) jet.

    Returns:
        (K, ...) jet; as long as the shorter factor.
    """
    factors, result = subscripts.split("->")
    left, right = factors.split(",")
    convolution = f"Z{left},Z{right}->{result}"
    orders = range(min(len(first), len(second)))
    return np.stack([np.einsum(convolution, first[: k + 1], second[k::-1]) for k in orders])


def slope(jet: np.ndarray) -> np.ndarray:
    """Return the jet of the derivative, one order shorter: ``f'_k = (k + 1) f_(k+1)``."""
    return jet[1:] * np.arange(1, len(jet)).reshape(-1, *[1] * (jet.ndim - 1))


def exponential(jet: np.ndarray) -> np.ndarray:
    """Return the jet (K, ...) of ``exp(f)`` from the jet (K, ...) of scalars ``f``.

    It follows from ``k e_k = sum_i i f_i e_(k-i)``.
    """
    rate = slope(jet)
    result = np.empty_like(jet)
    result[0] = np.exp(jet[0])
    for k in range(1, len(jet)):
        result[k] = np.einsum("Z...,Z...->...", rate[:k], result[k - 1 :: -1]) / k
    return result


@lru_cache
def _binomials(orders: int, length: int) -> np.ndarray:
    """Return binomial coefficients ``j over k`` as an array (orders, length), k along the first axis."""
    return np.array([[comb(j, k) for j in range(length)] for k in range(orders)], dtype=float)


def majorant(sizes: np.ndarray, orders: int) -> np.ndarray:
    """Return the majorant of a polynomial on an interval, from its Taylor coefficients about the centre.

    The unit of time of both is the half width of the interval.

    Args:
        sizes: (p + 1, ...) lengths of the Taylor coefficients.
        orders: how many orders to return.

    Returns:
        (orders, ...).
    """
    return np.einsum("kj,j...->k...", _binomials(orders, len(sizes)), sizes)


@lru_cache
def _chain_coefficients(members: int) -> np.ndarray:
    """Return coefficients (members, terms) of ``f_m = sum_j (-x^2 / 2)^j / (j! (2 (m + j) - 1)!!)``."""
    odd = np.cumprod([1.0, *range(1, 2 * (members + _SERIES_TERMS), 2)])  # (2 i - 1)!!
    return np.array([[1 / (factorial(j) * odd[m + j]) for j in range(_SERIES_TERMS)] for m in range(members)])


def _cosine_and_sinc(square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return jets (K, n) of ``cos x`` and ``sin x / x``, smooth at zero, from the jet (K, n) of ``x^2``.

    They begin the chain ``f_0 = cos x, f_1 = sin x / x, ...`` in which ``df_m / d(x^2) = -f_(m+1) / 2``:
    order k + 1 of one member follows from the orders up to k of the next.
    """
    length = len(square)
    powers = np.ones((_SERIES_TERMS, square.shape[1]))
    np.cumprod(np.broadcast_to(-square[0] / 2, (_SERIES_TERMS - 1, square.shape[1])), axis=0, out=powers[1:])
    chain = np.zeros((length, length + 1, square.shape[1]))  # (order, member, n)
    chain[0] = np.einsum("mj,jn->mn", _chain_coefficients(length + 1), powers)
    rate = slope(square)
    for k in range(1, length):
        chain[k, :-1] = np.einsum("Zn,Zmn->mn", rate[:k], chain[k - 1 :: -1, 1:]) / (-2 * k)
    return chain[:, 0], chain[:, 1]


def quaternion(rotation_vector: np.ndarray) -> np.ndarray:
    """Return the jet of the unit quaternion, scalar first, of a rotation vector.

    Args:
        rotation_vector: (K, 3, n) jet, rad.

    Returns:
        (K, 4, n); NaN where the rotation vector is longer than `LARGEST_TURN`.
    """
    legible = np.linalg.norm(rotation_vector[0], axis=0) <= LARGEST_TURN
    half = np.where(legible, rotation_vector / 2, np.nan)
    cosine, sinc = _cosine_and_sinc(product("in,in->n", half, half))
    return np.concatenate([cosine[:, None], product("n,in->in", sinc, half)], axis=1)


def multiply(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the jet (K, 4, n) of Hamilton's product of two quaternion jets (K, 4, n), scalar first."""
    w, x, y, z = np.moveaxis(first, 1, 0)
    rows = ((w, -x, -y, -z), (x, w, -z, y), (y, z, w, -x), (z, -y, x, w))
    matrix = np.stack([np.stack(row, axis=1) for row in rows], axis=1)
    return product("ijn,jn->in", matrix, second)


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (3, 3, n) of unit quaternions (4, n), scalar first; values, not jets."""
    w, x, y, z = quaternion
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (z * x + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (z * x - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def body_rate(quaternion_jet: np.ndarray) -> np.ndarray:
    """Return the jet (K - 1, 3, n) of the angular velocity ``2 q* q'``, rad/s, body axes, from one of q."""
    conjugate = quaternion_jet * np.array([1, -1, -1, -1])[:, None]
    return 2 * multiply(conjugate[:-1], slope(quaternion_jet))[:, 1:]


# Size of the rounding error of a sum or of a short computation, relative to the size of its terms.
ROUNDING = 8 * float(np.finfo(np.float64).eps)
_START_END_SLICES = slice(None, -1), slice(1, None)


@lru_cache
def _derivative_matrices(degree: int) -> np.ndarray:
    """Return matrices (k, to, from) from Legendre coefficients to those of the k-th derivative over k!."""
    once = np.zeros((degree + 1, degree + 1))
    once[:degree] = legendre.legder(np.eye(degree + 1))[:degree]
    powers = [np.eye(degree + 1)]
    for k in range(1, degree + 1):
        powers.append(once @ powers[-1] / k)
    return np.stack(powers)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """Polynomials of degree p in c components on the intervals between breaks, of one curve or of several.

    The N pieces of all curves are numbered one after the other.

    Attributes:
        first: (N,) s, where each piece begins.
        last: (N,) s, where it ends.
        derivatives: (N, p + 1, p + 1, c) Legendre coefficients (second axis) of the k-th time derivative over
            k! (third axis, k).
        begins: (curves + 1,) index of each curve's first piece, then N.
    """

    first: np.ndarray
    last: np.ndarray
    derivatives: np.ndarray
    begins: np.ndarray

    @classmethod
    def of(cls, *curves: tuple[np.ndarray, np.ndarray]) -> Self:
        """Join curves, each given by breaks (pieces + 1,) s and coefficients (pieces, p + 1, c)."""
        first, last = (np.concatenate([breaks[part] for breaks, _ in curves]) for part in _START_END_SLICES)
        coefficients = np.concatenate([own for _, own in curves])
        pieces, length, components = coefficients.shape
        # One product for each piece, so that results do not depend on the number of pieces.
        derivatives = _derivative_matrices(length - 1).reshape(-1, length) @ coefficients
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
        """Number of coefficients of each piece, p + 1."""
        return self.derivatives.shape[1]

    def breaks(self, curve: int = 0) -> np.ndarray:
        """Return the breaks (pieces + 1,) s of the curve with this index."""
        own = slice(*self.begins[curve : curve + 2])
        return np.append(self.first[own], self.last[own][-1:])

    def holding(self, time: np.ndarray, curve: int = 0) -> np.ndarray:
        """Return indices (n,) of the curve's pieces that contain times (n,) s; the later one at a break.

        Beyond the ends it is the first or the last piece.
        """
        begin, end = self.begins[curve : curve + 2]
        return begin + np.clip(np.searchsorted(self.first[begin:end], time, side="right") - 1, 0, None)

    def taylor(self, piece: np.ndarray, time: np.ndarray, orders: int) -> np.ndarray:
        """Return Taylor coefficients about given instants.

        Args:
            piece: (n,) index of the polynomial to evaluate.
            time: (n, m) s; outside of the piece its polynomial is continued.
            orders: how many coefficients; those beyond the degree are zero.

        Returns:
            (orders, c, n, m), of powers of seconds.
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
        """Return sizes (orders, c, n) of the rounding errors of `taylor` anywhere on pieces, by index (n,).

        They are those of the sums and, a quarter as large relative to the slope, that of the argument.
        """
        terms = np.abs(self.derivatives[:, :, : orders + 1]).sum(axis=1)  # (N, orders, c)
        sizes = np.zeros((len(terms), orders + 1, terms.shape[2]))
        sizes[:, : terms.shape[1]] = terms
        half = (self.last - self.first)[:, None, None] / 2
        slopes = np.arange(1, orders + 1)[:, None] * sizes[:, 1:] * half
        return ROUNDING * np.moveaxis((sizes[:, :-1] + slopes / 4)[piece], 0, -1)
