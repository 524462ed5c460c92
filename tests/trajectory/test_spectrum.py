"""Spectra of torque: closed forms, quadrature, and slopes beside differences."""

from dataclasses import replace
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import ANGLE, DURATION, make_spacecraft, turn_about_z
from node_paths import fit_global, fit_paper, turning
from quick import quick_jit
from reference import spin_of
from wheels import INERTIA, by_pseudo_inverse, random_wheels

from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.arguments import show
from jaxplan.trajectory import measures
from jaxplan.trajectory.spectrum import magnitude, transform

FREQUENCIES = np.array([0.0, 1e-3, 0.02, 0.05, 0.3, 0.5, 1.7, 23.0])  # Hz
CRAFT = Spacecraft(rate_limit=0.5, acceleration_limit=0.1, inertia=INERTIA)


def test_of_a_turn_in_closed_form():
    """The acceleration is linear: ``6 ANGLE / T^2 (1 - 2 t / T)``, and its transform known."""
    found = measures.torque_spectrum(turn_about_z(), replace(CRAFT, inertia=None), FREQUENCIES)
    x = np.pi * FREQUENCIES * DURATION
    with np.errstate(invalid="ignore", divide="ignore"):
        first = np.where(x > 1e-9, (np.sin(x) / x - np.cos(x)) / x, 0)  # j_1
    np.testing.assert_allclose(found[:, 2], 6 * ANGLE / DURATION * np.abs(first), rtol=1e-11, atol=1e-15)
    np.testing.assert_array_equal(found[:, :2], 0)
    assert found.dtype == np.float64


def test_a_pulse_and_a_harmonic_at_frequencies_far_beyond_the_breaks():
    """A jump at a break and a fast harmonic, at which the intervals are far longer than the period."""
    breaks = np.array([0.0, 1.0, 1.0, 4.0])
    high = np.array([0.0, 0.5, 3.0, 40.0, 999.5])
    with jax.enable_x64(True):
        pulse = quick_jit(
            lambda f: transform(
                lambda t: jnp.stack([jnp.where(t < 1, 1.0, 0.0), jnp.cos(4 * t)], axis=-1), breaks, f
            )
        )(high)
    w = 2 * np.pi * high
    with np.errstate(invalid="ignore"):
        expected = np.where(w > 0, (1 - np.exp(-1j * w)) / np.where(w > 0, 1j * w, 1), 1)
    np.testing.assert_allclose(pulse[:, 0], expected, rtol=0, atol=1e-14)
    both = [(np.exp(1j * (s * 4 - w) * 4) - 1) / (1j * (s * 4 - w)) / 2 for s in (1, -1)]
    np.testing.assert_allclose(pulse[:, 1], sum(both), rtol=0, atol=1e-13)


def quadrature(curve):
    """Times and weights (k,) of Gauss's formula on eighths of a curve's intervals."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    edges = np.unique(np.concatenate([np.linspace(*ends, 9) for ends in pairwise(curve.breaks)]))
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (nodes + 1)).ravel(), (half * weights).ravel()


@pytest.mark.slow
@pytest.mark.parametrize("fit", [fit_global, fit_paper])
def test_of_fitted_motions_it_is_that_of_quadrature_on_finer_intervals(fit):
    craft = replace(make_spacecraft(0), inertia=INERTIA)
    path = turning([0.0, 30.0, 70.0], axis=(0.6, 0.0, 0.8))
    curve = fit(path, craft, TrajectorySettings(duration=60.0)).trajectory
    found = measures.torque_spectrum(curve, craft, FREQUENCIES[:7])
    time, weight = quadrature(curve)
    rate, acceleration, _ = spin_of(curve, time)
    torque = acceleration @ INERTIA + np.cross(rate, rate @ INERTIA)
    kernel = weight * np.exp(-2j * np.pi * FREQUENCIES[:7, None] * time)
    np.testing.assert_allclose(found, np.abs(kernel @ torque), rtol=0, atol=1e-6)


def test_what_the_spacecraft_has_not_is_refused():
    with pytest.raises(ValueError, match="wheels"):
        measures.torque_spectrum(turn_about_z(), CRAFT, [0.5], of="wheel_torques")
    with pytest.raises(ValueError, match="inertia"):
        measures.torque_spectrum(turn_about_z(), replace(CRAFT, inertia=None), [0.5], of="torque")
    with pytest.raises(ValueError, match="must be one of"):
        measures.torque_spectrum(turn_about_z(), CRAFT, [0.5], of="momentum")


WRONG = [np.nan, [0.5, np.inf], -0.5, [[0.5]], ["a"], None, True, 1j, jnp.array([0.5, jnp.nan])]


def test_frequencies_that_are_none_are_refused_by_name_value_and_range():
    for wrong in WRONG:
        with pytest.raises(ValueError, match=r"^frequencies = ") as refused:
            measures.torque_spectrum(turn_about_z(), CRAFT, wrong)
        assert show(wrong) in str(refused.value)
        assert "must be numbers of Hz in [0, inf)" in str(refused.value)
    for wrong in (jnp.full((1, 1), 0.5), jnp.array([0.5j]), jnp.array(True)):
        with pytest.raises(ValueError, match="frequencies = a value that JAX traces: must be"):
            jax.eval_shape(lambda f: measures.torque_spectrum(turn_about_z(), CRAFT, f), wrong)


def test_a_number_is_one_frequency_and_what_is_no_number_is_not_zero():
    """A trace does not look at values, so what comes of a NaN must say so; so must a broken motion."""
    one = measures.torque_spectrum(turn_about_z(), CRAFT, 0.5)
    np.testing.assert_array_equal(one, measures.torque_spectrum(turn_about_z(), CRAFT, [0.5]))
    traced = quick_jit(lambda f: measures.torque_spectrum(turn_about_z(), CRAFT, f))
    np.testing.assert_allclose(traced(0.5), one, rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(traced(np.nan), np.nan)
    broken = replace(turn_about_z(), coefficients=turn_about_z().coefficients * np.nan)
    np.testing.assert_array_equal(measures.torque_spectrum(broken, CRAFT, 0.5), np.nan)
    assert measures.torque_spectrum(turn_about_z(), CRAFT, []).shape == (0, 3)


def test_of_wheels_it_is_the_transform_of_their_torques():
    craft = replace(CRAFT, wheels=random_wheels(4, seed=2))
    curve = turn_about_z()
    own = measures.torque_spectrum(curve, craft, FREQUENCIES, of="wheel_torques")
    time, weight = quadrature(curve)
    given = by_pseudo_inverse(curve, craft, time)[0] * [wheel.torque for wheel in craft.wheels]
    kernel = weight * np.exp(-2j * np.pi * FREQUENCIES[:7, None] * time)
    expected = np.abs(kernel @ given)
    np.testing.assert_allclose(own[:7], expected, rtol=0, atol=1e-7 * np.max(expected))


def test_slopes_are_differences():
    def total(scale, inertia):
        curve, craft = turn_about_z().scaled(scale), replace(CRAFT, inertia=inertia)
        return jnp.sum(measures.torque_spectrum(curve, craft, FREQUENCIES) ** 2)

    with jax.enable_x64(True):
        value = quick_jit(total)
        slopes = quick_jit(jax.grad(total, argnums=(0, 1)))(1.0, INERTIA)
        step = 1e-5
        by_scale = (value(1.0 + step, INERTIA) - value(1.0 - step, INERTIA)) / (2 * step)
        by_inertia = (value(1.0, INERTIA * (1 + step)) - value(1.0, INERTIA * (1 - step))) / (2 * step)
    assert float(slopes[0]) == pytest.approx(float(by_scale), rel=1e-7)
    assert float(np.sum(slopes[1] * INERTIA)) == pytest.approx(float(by_inertia), rel=1e-7)
    assert float(magnitude(jnp.zeros(1, complex))[0]) == 0


def test_slopes_outside_jit_are_those_inside_and_differences():
    """Of an entry and of a sum, by the spacecraft, the curve and the frequency, both ways."""
    craft = replace(CRAFT, wheels=random_wheels(4, seed=2))

    def spectrum(scale, inertia, frequency):
        curve = turn_about_z().scaled(scale)
        return measures.torque_spectrum(curve, replace(craft, inertia=inertia), frequency, of="wheel_torques")

    at, step = (1.1, INERTIA, np.array([0.05, 0.3])), 1e-6
    for number in (lambda *given: spectrum(*given)[0, 1], lambda *given: jnp.sum(spectrum(*given))):
        slopes = jax.grad(number, argnums=(0, 1, 2))(*at)
        for place, (own, slope) in enumerate(zip(at, slopes, strict=True)):
            ends = [[*at[:place], own * (1 + side * step), *at[place + 1 :]] for side in (-1, 1)]
            before, after = (float(number(*end)) for end in ends)
            assert float(np.sum(slope * own)) == pytest.approx((after - before) / (2 * step), rel=1e-6)
    inside = quick_jit(jax.grad(number, argnums=(0, 1, 2)))(*at)
    for slope, expected in zip(slopes, inside, strict=True):
        np.testing.assert_allclose(slope, expected, rtol=1e-9, atol=1e-12)
    way = jax.tree.map(lambda own: 0.3 * own, at)
    _, along = jax.jvp(number, at, way)
    assert float(along) == pytest.approx(sum(float(np.sum(s * w)) for s, w in zip(slopes, way, strict=True)))


def test_a_whole_spacecraft_has_slopes_outside_jit():
    slope = jax.grad(lambda c: measures.torque_spectrum(turn_about_z(), c, np.array([0.5]))[0, 1])(CRAFT)
    own = measures.torque_spectrum(turn_about_z(), CRAFT, 0.5)[0, 1]
    assert float(np.sum(slope.inertia * INERTIA)) == pytest.approx(own)  # it is proportional to the inertia
