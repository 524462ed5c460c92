"""Limits of each body axis and of lengths of vectors: peaks and stretches against dense sampling."""

import numpy as np
import pytest
from manoeuvres import craft, judge, manoeuvre
from reference import assert_each, spin_of

from jaxplan.trajectory.peaks import peaks

INSTANTS = 1001


def random_craft(rng):
    """A spacecraft with limits of its own for each axis, and for lengths that may be tighter or looser."""
    size = rng.uniform(0.5, 2, (5, 3)) * np.array([2e-2, 2e-3, 3e-4, 2e-2, 2e-3])[:, None]
    return craft(
        1,
        rate_limit=size[0],
        acceleration_limit=size[1],
        jerk_limit=size[2],
        rate_norm_limit=float(size[3, 0]),
        acceleration_norm_limit=float(size[4, 0]),
    )


def sampled(trajectory, own):
    """Largest shares of the limits of rates and accelerations at samples, as `peaks` has them in turn."""
    times = np.concatenate(
        [np.linspace(0, trajectory.duration, INSTANTS), np.nextafter(trajectory.breaks[1:], 0)]
    )
    rate, acceleration, _ = np.abs(spin_of(trajectory, times))
    shares = [
        rate / own.rate_limit,
        np.linalg.norm(rate, axis=1)[:, None] / own.rate_norm_limit,
        acceleration / own.acceleration_limit,
        np.linalg.norm(acceleration, axis=1)[:, None] / own.acceleration_norm_limit,
    ]
    return np.max(np.concatenate(shares, axis=1), axis=0)


@pytest.mark.slow
def test_peaks_are_those_of_samples_and_scaling_to_them_is_exact():
    rng = np.random.default_rng(0)
    for seed in range(200):
        pieces = int(rng.integers(1, 9))
        trajectory = manoeuvre(seed, terminals=1, pieces=pieces, wiggle=float(rng.uniform(0.05, 0.6)))
        own = random_craft(rng)
        found = peaks(trajectory, own)
        highest = sampled(trajectory, own)
        assert_each(found.ratios[:8], ">=", highest * (1 - 1e-9), f"seed {seed}")
        assert_each(found.ratios[:8], "<=", highest * (1 + 2e-3), f"seed {seed}")
        slow = peaks(trajectory.scaled(found.stretch), own)
        assert np.max(slow.ratios) == pytest.approx(1, abs=1e-9), seed
        assert slow.names[int(np.argmax(slow.ratios))] == found.names[found.binding]


@pytest.mark.slow
def test_the_certificate_bounds_the_peaks_of_axes_and_lengths():
    rng = np.random.default_rng(1)
    for seed in range(12):
        trajectory = manoeuvre(seed, terminals=1, pieces=1 + seed % 4, wiggle=0.4)
        own = random_craft(rng)
        found, report = peaks(trajectory, own), judge(trajectory, own)
        names = "angular_velocity", "angular_velocity_norm"
        names += "angular_acceleration", "angular_acceleration_norm"
        parts = np.split(found.ratios[:8], [3, 4, 7])
        for name, part in zip(names, parts, strict=True):
            assert np.max(part) <= report.peaks[name] <= np.max(part) * (1 + 1e-6), (seed, name)


def test_a_motion_that_turns_steadily_has_the_length_of_its_rate():
    trajectory = manoeuvre(3, terminals=0, pieces=1, wiggle=0.0, step=0.0)
    turned = np.array([[0.02, -0.03, 0.06]])
    trajectory = type(trajectory)(
        **(vars(trajectory) | {"chart_rate": turned, "coefficients": steady(trajectory, turned[0])})
    )
    own = craft(0, rate_limit=[0.1, 0.05, 0.1], rate_norm_limit=0.1)
    found = peaks(trajectory, own)
    assert found.names[:4] == (*(f"platform rate {axis}" for axis in "xyz"), "platform rate length")
    np.testing.assert_allclose(found.ratios[:4], [0.2, 0.6, 0.6, 0.7], rtol=1e-12)
    assert found.names[found.binding] == "platform rate length"


def steady(trajectory, rate):
    """Coefficients of a curve that keeps to a chart of this rate."""
    coefficients = np.zeros_like(trajectory.coefficients)
    coefficients[0, :2] = rate * trajectory.duration / 2
    return coefficients
