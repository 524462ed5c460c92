"""Polynomials in the Legendre basis, and splines of degree 5: values, derivatives, energies and ends.

**A polynomial** on [-1, 1] is ``c^T P(x)`` with the Legendre polynomials ``P = P_0 .. P_l`` and ``l + 1``
coefficients, as in equations (17) and (26). Its derivative has the coefficients ``D c``; so derivatives of
any order need no formula beyond that of the values. On [-1, 1] the quadratic programs are well conditioned;
in raw seconds they would lose all digits.

**A spline** on given breaks is ``z(s) = sum_i N_i(s) c_i`` on [0, 1] with the B-splines ``N_i`` of degree 5
and simple knots, so it has four continuous derivatives. A derivative is a spline of one degree less, whose
coefficients are differences of those of the curve; all its values lie between the least and the largest of
them, which turns a limit at every instant into as many linear rows.

**A curve space** is the set that a fit chooses from: splines with given ends, which perhaps pass given nodes.
Their coefficients are ``c = F x + f + T g`` with the free ``x``; ``F`` is the same for all axes, and ``T g``
gives the rates at the ends, which in ``s`` grow with the duration ``T``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, array_module

DEGREE = 5  # of the splines
SMOOTHNESS = DEGREE - 1  # continuous derivatives of a spline
_DERIVATIVE_COUNT = 4  # number of curves: the curve itself and its first three derivatives


def legendre(x: ArrayLike, order: int) -> AnyArray:
    """Evaluate all Legendre polynomials up to an order, by their three-term recurrence.

    Args:
        x: (...) in [-1, 1].
        order: the highest degree ``l``, at least 1.

    Returns:
        (..., l + 1) values of ``P_0`` to ``P_l``; numpy for numpy arguments, JAX for JAX arguments.
    """
    if array_module(x) is np:
        values = np.polynomial.legendre.legvander(np.asarray(x), order)
        return values.reshape(*np.shape(x), order + 1)  # legvander adds an axis to a single number
    return _legendre_jax(order, jnp.asarray(x))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _legendre_jax(order: int, x: Array) -> Array:
    """Do the same as `legendre` in JAX, with a derivative rule that compiles fast."""

    def step(last: tuple[Array, Array], n: Array) -> tuple[tuple[Array, Array], Array]:
        before, value = last
        after = ((2 * n + 1) * x * value - n * before) / (n + 1)
        return (value, after), after

    first = jnp.ones_like(x), x
    _, others = jax.lax.scan(step, first, jnp.arange(1, order, dtype=x.dtype))
    return jnp.moveaxis(jnp.concatenate([jnp.stack(first), others]), 0, -1)


@_legendre_jax.defjvp
def _(order: int, at: tuple[Array], along: tuple[Array]) -> tuple[Array, Array]:
    # Compiling the derivative of the recurrence would take many times as long as compiling its values.
    values = _legendre_jax(order, *at)
    return values, values @ jnp.asarray(derivative_matrix(order), values.dtype) * along[0][..., None]


@cache
def derivative_matrix(order: int) -> np.ndarray:
    """Matrix ``D`` that takes Legendre coefficients of a curve to those of its derivative in ``x``.

    It follows from ``P_n' = sum of (2 k + 1) P_k`` over ``k = n - 1, n - 3, ...``. Transposed, it takes
    values of the polynomials to their derivatives: ``P'(x) = D^T P(x)``.

    Args:
        order: the highest degree ``l``.

    Returns:
        (l + 1, l + 1) integers as floats, read-only.
    """
    k, n = np.indices((order + 1, order + 1))
    matrix = np.where((k < n) & ((n - k) % 2 == 1), 2.0 * k + 1, 0.0)
    matrix.flags.writeable = False
    return matrix


@cache
def energy(order: int, derivative: int) -> np.ndarray:
    """Gram matrix of a derivative: the integral of ``(d^r P / dx^r) (d^r P / dx^r)^T`` over [-1, 1].

    Exact but for the last rounding, since the integral of ``P_k^2`` is ``2 / (2 k + 1)`` and the rest are
    zero. With ``r = 1, 2`` these are the matrices of equations (22) and (45), the former with its missing
    derivatives.

    Args:
        order: the highest degree ``l``.
        derivative: ``r``.

    Returns:
        (l + 1, l + 1) symmetric, positive semidefinite with ``r`` zero eigenvalues, read-only.
    """
    steps = np.linalg.matrix_power(derivative_matrix(order), derivative)
    gram = steps.T @ (2 / (2 * np.arange(order + 1) + 1)[:, None] * steps)
    gram.flags.writeable = False
    return gram


@cache
def end_derivatives(order: int) -> np.ndarray:
    """First and second derivatives in ``x`` of all Legendre polynomials at both ends, in closed form.

    Args:
        order: the highest degree ``l``.

    Returns:
        (2, 2, l + 1), indexed by end (-1, then 1), derivative (first, then second) and degree; read-only.
    """
    n = np.arange(order + 1.0)
    at_end = np.stack([n * (n + 1) / 2, (n - 1) * n * (n + 1) * (n + 2) / 8])
    signs = (-1.0) ** n
    rows = np.stack([at_end * np.stack([-signs, signs]), at_end])
    rows.flags.writeable = False
    return rows


@dataclass(frozen=True, kw_only=True, eq=False)
class Basis:
    """The B-splines of degree 5 on given breaks.

    Attributes:
        breaks: (K + 1,) ends of the K intervals, rising from 0 to 1.
        differences: four matrices (n - d, n), d from 0 to 3, which take the n = K + 5 coefficients of a curve
            to those of its d-th derivative.
    """

    breaks: np.ndarray
    differences: tuple[np.ndarray, ...]
    _places_cache: dict[tuple[int, bool], tuple[np.ndarray, np.ndarray]] = field(
        default_factory=dict, init=False, repr=False
    )
    _ends_cache: dict[bool, tuple[np.ndarray, ...]] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def on(cls, breaks: np.ndarray) -> "Basis":
        """Make the spline basis on given breaks, K + 1 numbers that rise from 0 to 1."""
        knots = _knots(breaks, DEGREE)
        matrices = [np.eye(len(breaks) - 1 + DEGREE)]
        for degree in range(DEGREE, DEGREE - _DERIVATIVE_COUNT + 1, -1):
            rows = len(knots) - degree - 2
            rate = degree / (knots[degree + 1 : -1] - knots[1 : -degree - 1])
            step = np.zeros((rows, rows + 1))
            step[np.arange(rows), np.arange(rows)] = -rate
            step[np.arange(rows), np.arange(1, rows + 1)] = rate
            matrices.append(step @ matrices[-1])
            knots = knots[1:-1]
        return cls(breaks=breaks, differences=tuple(matrices))

    @classmethod
    @cache
    def even(cls, intervals: int) -> "Basis":
        """Return the basis on breaks at equal distances; it is made once for each number of intervals."""
        return cls.on(np.linspace(0, 1, intervals + 1))

    @property
    def size(self) -> int:
        """Number n of coefficients of a curve on each axis."""
        return self.differences[0].shape[0]

    def rows(self, places: np.ndarray, derivatives: int = _DERIVATIVE_COUNT) -> np.ndarray:
        """Evaluate the B-splines and their derivatives; multiplied by coefficients they are those of a curve.

        Args:
            places: (S,) in [0, 1].
            derivatives: number of arrays wanted: 1 for the values alone, up to 4 with the third derivative.

        Returns:
            (derivatives, S, n) values, then derivatives by the place, of n B-splines at S places.
        """
        span = np.clip(np.searchsorted(self.breaks, places, side="right") - 1, 0, len(self.breaks) - 2)
        by_degree = _nonzero_splines(self.breaks, places, span)
        every = np.arange(len(places))[:, None]
        found = np.empty((derivatives, len(places), self.size))
        for d in range(derivatives):
            degree = DEGREE - d
            own = found[0] if d == 0 else np.empty((len(places), len(self.differences[d])))
            own[:] = 0.0
            own[every, span[:, None] + np.arange(degree + 1)] = by_degree[degree]
            if d > 0:
                np.matmul(own, self.differences[d], out=found[d])
        return found

    def within(self, points: int, *, to_end: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Return places spaced evenly on each interval, and the B-splines there.

        Args:
            points: number of places on each interval, at least 2.
            to_end: whether the last place is 1, so that those of the last interval are a little farther
                apart; otherwise 1 is left out.

        Returns:
            The places (K * points,), and `rows` there, (4, K * points, n).
        """
        if (points, to_end) not in self._places_cache:
            steps = np.tile(np.arange(points) / points, (len(self.breaks) - 1, 1))
            if to_end:
                steps[-1] = np.arange(points) / (points - 1)
            places = (self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * steps).ravel()
            if to_end:
                places[-1] = self.breaks[-1]  # to the last bit
            self._places_cache[points, to_end] = places, self.rows(places)
        return self._places_cache[points, to_end]

    @cached_property
    def energies(self) -> np.ndarray:
        """Gram matrices of the n B-splines and of their three derivatives: integrals of products over [0, 1].

        It is (4, n, n), exact by Gauss' rule.
        """
        nodes, weights = np.polynomial.legendre.leggauss(DEGREE + 1)
        half = np.diff(self.breaks)[:, None] / 2
        rows = self.rows((self.breaks[:-1, None] + half * (nodes + 1)).ravel())
        return np.swapaxes(rows, 1, 2) @ ((half * weights).reshape(-1, 1) * rows)

    @cached_property
    def _interval_values(self) -> list[np.ndarray]:
        """Values of the B-splines of degree 5 - d, for each derivative d from 0 to 3, on all K intervals.

        Each array is (K, 3, 6 - d): at the start, the middle and the end of each interval, the 6 - d
        B-splines that are not zero there.
        """
        intervals = len(self.breaks) - 1
        places = self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * [0.0, 0.5, 1.0]
        by_degree = _nonzero_splines(self.breaks, places.ravel(), np.repeat(np.arange(intervals), 3))
        return [by_degree[DEGREE - d].reshape(intervals, 3, -1) for d in range(_DERIVATIVE_COUNT)]

    def ends(self, rest: bool) -> tuple[np.ndarray, ...]:
        """Matrices that describe all coefficients ``F x + V values + R rates`` of curves with given ends.

        Args:
            rest: whether accelerations are zero at both ends; otherwise they are free.

        Returns:
            ``F`` (n, k) of the k free coefficients, ``V`` (n, 2) of the values and ``R`` (n, 2) of the rates
            (by the place) at both ends; read-only.
        """
        if rest not in self._ends_cache:
            count = 3 if rest else 2
            rows = self.rows(np.array([0.0, 1.0]), count)
            of_values, of_rates = np.zeros((2, self.size, 2))
            for end, part in enumerate((slice(0, count), slice(self.size - count, self.size))):
                # At an end only as many B-splines differ from zero as derivatives are given.
                solve = np.linalg.inv(rows[:, end, part])
                of_values[part, end], of_rates[part, end] = solve[:, 0], solve[:, 1]
            found = np.eye(self.size)[:, count:-count], of_values, of_rates
            for array in found:
                array.flags.writeable = False
            self._ends_cache[rest] = found
        return self._ends_cache[rest]

    def pieces(self, coefficients: np.ndarray) -> np.ndarray:
        """Rewrite a curve in Legendre polynomials on each interval.

        Args:
            coefficients: (n, d) of d components.

        Returns:
            (K, 6, d) coefficients of ``P_0`` to ``P_5`` on each of the K intervals.
        """
        # B-splines sum to one, so a constant is split off, and what stands still does so to the last bit.
        base = coefficients[:1]
        moved = coefficients - base
        half = np.diff(self.breaks)[:, None, None] / 2
        interval = np.arange(len(self.breaks) - 1)[:, None]

        def values(derivative: int) -> np.ndarray:
            control = self.differences[derivative] @ moved
            return self._interval_values[derivative] @ control[interval + np.arange(DEGREE + 1 - derivative)]

        # Neighbours share coefficients of derivatives, so that none jumps by more than its own rounding.
        # From values of the curve alone, the third derivative would lose twelve digits on short intervals.
        found: np.ndarray = _PARABOLA_TO_LEGENDRE @ values(_DERIVATIVE_COUNT - 1)
        for derivative in reversed(range(_DERIVATIVE_COUNT - 1)):
            found = np.polynomial.legendre.legint(found * half, axis=1, lbnd=0)
            found[:, 0] += values(derivative)[:, 1]
        found[:, 0] += base
        return found


# Legendre coefficients from the values at -1, 0, and 1.
_PARABOLA_TO_LEGENDRE = np.array([[1 / 6, 2 / 3, 1 / 6], [-1 / 2, 0, 1 / 2], [1 / 3, -2 / 3, 1 / 3]])


def _nonzero_splines(breaks: np.ndarray, places: np.ndarray, span: np.ndarray) -> list[np.ndarray]:
    """For each degree from 0 to `DEGREE`, values (S, degree + 1) of the B-splines not zero at S places.

    It is the recursion of Cox and de Boor; scipy's design matrices take a call and a sparse matrix for each
    degree.

    Args:
        breaks: (K + 1,) of the splines.
        places: (S,) in [0, 1].
        span: (S,) int, index of the interval that each place is on.
    """
    knots = _knots(breaks, DEGREE)
    reach = np.arange(1, DEGREE + 1)
    ahead = knots[span[:, None] + DEGREE + reach] - places[:, None]  # to the j-th knot on the right
    behind = places[:, None] - knots[span[:, None] + DEGREE + 1 - reach]
    values = [np.ones((len(places), 1))]
    for degree in range(1, DEGREE + 1):
        right, left = ahead[:, :degree], behind[:, degree - 1 :: -1]
        share = values[-1] / (right + left)
        own = np.zeros((len(places), degree + 1))
        own[:, :degree] = right * share
        own[:, 1:] += left * share
        values.append(own)
    return values


def _knots(breaks: np.ndarray, degree: int) -> np.ndarray:
    """Knots of splines on given breaks: both ends repeated ``degree + 1`` times, the others once."""
    return np.concatenate([np.repeat(breaks[:1], degree), breaks, np.repeat(breaks[-1:], degree)])


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveSpace:
    """All splines with given ends, and perhaps through given nodes, on A axes: ``c = F x + f + T g``.

    Attributes:
        basis: the B-splines.
        free: (n, k) ``F``, from the k free coefficients ``x`` of each axis to all n of them.
        of_values: (n, v) matrix from v given values, those at the two ends first, to ``f``.
        of_rates: (n, 2) matrix from the rates at the ends to ``g``.
        fixed: (n, A) ``f``, rad.
        by_time: (n, A) rad/s, ``g``, which is multiplied by the duration ``T``.
    """

    basis: Basis
    free: np.ndarray
    of_values: np.ndarray
    of_rates: np.ndarray
    fixed: np.ndarray
    by_time: np.ndarray

    @property
    def energies(self) -> np.ndarray:
        """(4, n, n) Gram matrices of the n B-splines and of their three derivatives, see `Basis.energies`."""
        return self.basis.energies

    @classmethod
    def of(
        cls,
        basis: Basis,
        ends: np.ndarray,
        rates: np.ndarray,
        rest: bool,
        places: Sequence[float] | np.ndarray = (),
        nodes: Sequence[float] | np.ndarray = (),
    ) -> Self:
        """Make the space of all splines with given ends and nodes.

        Args:
            basis: the B-splines.
            ends: (2, A) rad, values at start and end, in the chart.
            rates: (2, A) rad/s, at start and end.
            rest: whether accelerations are zero at both ends; otherwise they are free.
            places: (m,) in (0, 1) of nodes; on no interval more than the splines have freedom there.
            nodes: (m, A) rad, which are passed exactly.
        """
        (free, of_values, of_rates), values = basis.ends(rest), ends
        count = len(places)
        if count:
            rows = basis.rows(np.asarray(places), 1)[0]
            q, r = np.linalg.qr((rows @ free).T, mode="complete")
            lift = free @ np.linalg.solve(r[:count], q[:, :count].T).T  # from what is missing at the nodes
            free, values = free @ q[:, count:], np.concatenate([ends, nodes])
            of_values = np.concatenate([of_values - lift @ (rows @ of_values), lift], axis=1)
            of_rates = of_rates - lift @ (rows @ of_rates)
        return cls(
            basis=basis,
            free=free,
            of_values=of_values,
            of_rates=of_rates,
            fixed=of_values @ values,
            by_time=of_rates @ rates,
        )


def weighted(energies: np.ndarray, duration: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Matrices (G, n, n) of the energy of one axis for G curves: the integral over time of weighted squares.

    With coefficients ``c`` (n,) the energy is ``c . M c``, without a factor 1/2.

    Args:
        energies: (G, 4, n, n) as `CurveSpace` has them.
        duration: (G,) s.
        weights: (G, 3) of the squares of rate, acceleration and jerk.
    """
    factors = weights * duration[:, None] ** -np.array([1.0, 3.0, 5.0])
    return np.asarray(np.einsum("gd,gdij->gij", factors, energies[:, 1:]))
