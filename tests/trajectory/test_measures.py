"""Numbers of a trajectory, of a turn about one axis in closed form."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import ANGLE, DURATION, turn_about_z
from quick import quick_jit

from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory import measures

CRAFT = Spacecraft(rate_limit=0.5, acceleration_limit=1e-3, jerk_limit=0.1)


@cache
def kernel():
    """Some numbers of a turn with given coefficients, and the stretch with its gradient in them."""

    def numbers(coefficients, craft):
        curve = replace(turn_about_z(), coefficients=coefficients)
        stretch = jax.value_and_grad(lambda c: measures.stretch(replace(curve, coefficients=c), craft))
        fields = ("angular_velocity", "angular_acceleration", "joint_rates")
        return *stretch(coefficients), jnp.stack([measures.peak(curve, field) for field in fields])

    return quick_jit(numbers)


def test_peaks_are_those_of_the_closed_form():
    *_, peaks = kernel()(turn_about_z().coefficients, CRAFT)
    expected = [1.5 * ANGLE / DURATION, 6 * ANGLE / DURATION**2, 0]  # there are no joints
    np.testing.assert_allclose(peaks, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("changes", "stretch", "power"),
    [
        ({"rate_limit": 1e-2}, 1.5 * ANGLE / DURATION / 1e-2, 1),
        ({}, np.sqrt(6 * ANGLE / DURATION**2 / 1e-3), 2),
        ({"jerk_limit": 1e-6}, np.cbrt(12 * ANGLE / DURATION**3 / 1e-6), 3),
    ],
)
def test_the_stretch_is_differentiable_where_two_axes_rest(changes, stretch, power):
    coefficients = turn_about_z().coefficients
    value, slope, _ = kernel()(coefficients, replace(CRAFT, **changes))
    assert float(value) == pytest.approx(stretch, rel=1e-9)
    np.testing.assert_array_equal(np.isfinite(slope), True)
    assert np.sum(slope * coefficients) == pytest.approx(stretch / power, rel=1e-9)


def test_a_derivative_of_the_number_duration_is_refused_with_what_to_use():
    curve = turn_about_z()
    for transform in (jax.grad, jax.jit):
        with pytest.raises(TypeError, match=r"jp\.measures\.duration"):
            transform(lambda factor: replace(curve, breaks=factor * curve.breaks).duration)(2.0)
    assert jax.grad(lambda f: measures.duration(replace(curve, breaks=f * curve.breaks)))(2.0) > 0


def test_what_is_not_a_number_is_not_lost():
    broken = turn_about_z().coefficients * np.array([1.0, np.nan, 1.0])
    stretch, _, peaks = kernel()(broken, CRAFT)
    assert np.isnan(stretch)
    np.testing.assert_array_equal(peaks[:2], np.nan)


def test_of_numpy_they_are_of_64_bits_whatever_jax_is_set_to():
    turn = turn_about_z()
    with jax.enable_x64(False):
        found = measures.effort(turn), measures.duration(turn), measures.peak(turn, "angular_velocity")
    expected = 12 * ANGLE**2 / DURATION**3, DURATION, 1.5 * ANGLE / DURATION
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert all(value.dtype == np.float64 for value in found)
