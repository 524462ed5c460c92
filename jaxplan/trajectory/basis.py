"""Legendre polynomials ``P_0 .. P_l`` on [-1, 1]: values, derivatives and energies.

A curve is ``c^T P(x)`` with ``l + 1`` coefficients, as in equations (17) and (26). Its derivative is again
such a curve, with the coefficients ``D c``; so derivatives of any order need no formula beyond that of the
values. On [-1, 1] the quadratic programs are well conditioned; in raw seconds they would lose all digits.
"""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike


def legendre(x: ArrayLike, order: int) -> Array:
    """Values of all Legendre polynomials up to an order, by their three-term recurrence.

    Args:
        x: (...) in [-1, 1].
        order: the highest degree ``l``, at least 1.

    Returns:
        (..., l + 1).
    """
    return _legendre(order, jnp.asarray(x))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _legendre(order: int, x: Array) -> Array:
    def step(last: tuple[Array, Array], n: Array) -> tuple[tuple[Array, Array], Array]:
        before, value = last
        after = ((2 * n + 1) * x * value - n * before) / (n + 1)
        return (value, after), after

    first = jnp.ones_like(x), x
    _, others = jax.lax.scan(step, first, jnp.arange(1, order, dtype=x.dtype))
    return jnp.moveaxis(jnp.concatenate([jnp.stack(first), others]), 0, -1)


@_legendre.defjvp
def _(order: int, at: tuple[Array], along: tuple[Array]) -> tuple[Array, Array]:
    # The derivative of a recurrence takes many times as long to compile as that of its values.
    values = _legendre(order, *at)
    return values, values @ jnp.asarray(derivative_matrix(order), values.dtype) * along[0][..., None]


@cache
def derivative_matrix(order: int) -> np.ndarray:
    """Matrix ``D`` that takes the coefficients of a curve to those of its derivative in ``x``.

    From ``P_n' = sum of (2 k + 1) P_k`` over ``k = n - 1, n - 3, ...``. Transposed, it takes values to
    derivatives: ``P'(x) = D^T P(x)``.

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
    """First and second derivative in ``x`` of all polynomials at both ends, in closed form.

    Args:
        order: the highest degree ``l``.

    Returns:
        (2, 2, l + 1): at -1 and at 1; read-only.
    """
    n = np.arange(order + 1.0)
    at_end = np.stack([n * (n + 1) / 2, (n - 1) * n * (n + 1) * (n + 2) / 8])
    signs = (-1.0) ** n
    rows = np.stack([at_end * np.stack([-signs, signs]), at_end])
    rows.flags.writeable = False
    return rows
