"""Fourier transforms of quantities along a trajectory, at any frequency and without sampling.

On each interval a quantity is expanded in Legendre polynomials, of which the transform is known,

    integral over u in [-1, 1] of P_n(u) exp(-i x u) = 2 (-i)^n j_n(x),

with the spherical Bessel functions ``j_n``. So the only error is what the polynomials leave out, at any
frequency alike: its transform is at most the integral of its magnitude, and nothing is aliased, however high
the frequency. For ``x`` up to the number of polynomials the integral is taken by Gauss' rule, whose nodes are
enough there; beyond, by the recurrence ``j_(n+1) = (2 n + 1) / x j_n - j_(n-1)``, which is stable for
``n < x``.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.polynomial import legendre

from jaxplan.runtime.arguments import floats, show
from jaxplan.runtime.jit import is_traced

_TERMS = 24  # Legendre polynomials on an interval
_INTERVALS_PER_PIECE = 2  # intervals of a piece
_GAUSS_NODES = 64  # nodes of Gauss' rule for transforms of the polynomials, if |x| is at most `_TERMS`


def expect_frequencies(given: object, *, zero: bool = True) -> Any:
    """Check frequencies and return them as an array (f,) in Hz, (1,) for a number; traced ones stay traced.

    Args:
        given: of any type. Values of traced numbers are not looked at.
        zero: whether a frequency may be zero.

    Raises:
        ValueError: if they are not finite real numbers in one row, or one is negative, or zero and may not
            be.
    """
    wanted = f"{'numbers of Hz in [0, inf)' if zero else 'positive numbers of Hz'}, one or a row of them"
    fault = f"frequencies = {show(given)}: must be {wanted}"
    if is_traced(given):
        traced = jnp.atleast_1d(jnp.asarray(given))
        if traced.ndim > 1 or traced.dtype.kind in "bc":
            raise ValueError(fault)
        return traced
    found = np.atleast_1d(floats("frequencies", given, wanted))
    if found.ndim > 1 or not np.all(np.isfinite(found) & (found >= 0 if zero else found > 0)):
        raise ValueError(fault)
    return jnp.atleast_1d(given) if isinstance(given, jax.Array) else found


def transform(values: Callable[[Array], Array], breaks: Array, frequencies: Array) -> Array:
    """Compute the Fourier transform ``integral of f(t) exp(-2 pi i nu t)`` of a quantity over all time.

    Args:
        values: function from times (k,) in s to the quantity's c components (k, c); smooth between the
            breaks.
        breaks: (m + 1,) s, ascending, from start to end; outside the quantity counts as zero. Intervals of no
            length contribute nothing.
        frequencies: (f,) Hz, ``nu``.

    Returns:
        (f, c) complex, in the quantity's unit times s.
    """
    steps = jnp.arange(_INTERVALS_PER_PIECE) / _INTERVALS_PER_PIECE
    starts = (breaks[:-1, None] + jnp.diff(breaks)[:, None] * steps).ravel()
    half = jnp.repeat(jnp.diff(breaks), _INTERVALS_PER_PIECE) / (2 * _INTERVALS_PER_PIECE)
    nodes, weights = legendre.leggauss(_TERMS)
    times = (starts + half)[:, None] + half[:, None] * nodes
    found = values(times.ravel()).reshape(*times.shape, -1)
    to_series = legendre.legvander(nodes, _TERMS - 1).T * weights * (np.arange(_TERMS)[:, None] + 0.5)
    series = jnp.einsum("nq,pqc->pnc", to_series, jnp.where(half[:, None, None] > 0, found, 0.0))
    turning = 2 * jnp.pi * jnp.asarray(frequencies)[:, None]
    phase = half * jnp.exp(-1j * turning * (starts + half))
    return jnp.einsum("fp,fpn,pnc->fc", phase, _legendre_transforms(turning * half), series)


def _legendre_transforms(x: Array) -> Array:
    """Transforms (..., `_TERMS`) of the Legendre polynomials at arguments ``x`` (...), of either sign."""
    nodes, weights = legendre.leggauss(_GAUSS_NODES)
    near = jnp.abs(x) <= _TERMS
    small, large = jnp.where(near, x, 0.0), jnp.where(near, float(_TERMS), x)
    rule = jnp.asarray(legendre.legvander(nodes, _TERMS - 1) * weights[:, None], jnp.result_type(x, 1j))
    by_rule = jnp.exp(-1j * small[..., None] * nodes) @ rule
    bessel = [jnp.sin(large) / large]
    bessel.append((bessel[0] - jnp.cos(large)) / large)
    for n in range(1, _TERMS - 1):
        bessel.append((2 * n + 1) / large * bessel[n] - bessel[n - 1])
    signs = 2 * (-1j) ** (np.arange(_TERMS) % 4)
    return jnp.where(near[..., None], by_rule, jnp.stack(bessel, axis=-1) * signs)


def magnitude(values: Array) -> Array:
    """Absolute values of complex numbers; where one is zero its derivative is taken as zero."""
    square = values.real**2 + values.imag**2
    zero = square == 0  # not where it is a NaN
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, square)))
