"""Rates in charts at many points: those of the formulas in JAX."""

import jax
import numpy as np
import pytest

from jaxplan.trajectory.curve import chart_motion
from jaxplan.trajectory.peaks import rates

COUNT = 64


def points(departure):
    """A chart's rate, times and ``b`` with three derivatives, (4, n, 3), whose ``eta`` is of a length."""
    rng = np.random.default_rng(0)
    rate, tau = 0.3 * rng.normal(size=(COUNT, 3)), rng.uniform(0, 3, COUNT)
    rate[: COUNT // 4] = 0.0
    eta = rng.normal(size=(COUNT, 3))
    eta *= departure / np.linalg.norm(eta, axis=1)[:, None]
    b = np.stack([eta + tau[:, None] * rate, *rng.normal(size=(3, COUNT, 3))])
    return rate, tau, b


# Both sides of where the series end, next to nothing and nothing, half a turn and beyond a whole one.
@pytest.mark.parametrize("departure", [0.0, 1e-160, 1e-15, 1e-6, 1e-3, 0.2236, 0.2237, 1.0, np.pi, 6.0, 7.0])
def test_rates_are_those_of_the_chart_and_its_derivative(departure):
    rate, tau, b = points(departure)
    with jax.enable_x64(True):
        along = (np.zeros_like(rate), np.ones((COUNT, 1)), *b[1:])
        (_, *expected), (_, _, jerk) = jax.jvp(chart_motion, (rate, tau[:, None], *b[:3]), along)
    found = rates(rate.T, tau, np.swapaxes(b, 1, 2))
    for own, other in zip(found, [*expected, jerk], strict=True):
        np.testing.assert_allclose(own.T, other, rtol=0, atol=2e-13)
    for own, other in zip(rates(rate.T, tau, np.swapaxes(b[:3], 1, 2)), found[:2], strict=True):
        np.testing.assert_allclose(own, other, rtol=0, atol=1e-14)
