"""Directions over time: through their samples, smooth, with rates and bounds that hold between them."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import great_circle, turning_direction, wandering_direction
from reference import angle, seen, unit

from jaxplan import sky
from jaxplan.model.directions import DirectionPath

ORBIT = {"altitude": 550.0, "inclination": 0.925, "node": 0.3}
HERE = sky.CircularOrbit(**ORBIT, latitude=1.0)
AHEAD = sky.CircularOrbit(**ORBIT, latitude=1.35)
EPOCH = "2026-03-20T12:00:00"


def paths():
    rng = np.random.default_rng(3)
    return [
        turning_direction(rng, 0.001, np.linspace(0, 80, 9)),
        turning_direction(rng, 0.05, np.linspace(-2, 20, 12)),
        wandering_direction(rng, 60.0, 12, 0.2),
        turning_direction(rng, 0.02, np.array([0.0, 10.0, 20.0])),
        turning_direction(rng, 0.02, np.array([0.0, 20.0])),
    ]


@pytest.mark.parametrize("path", paths(), ids=["slow", "quick", "random", "three samples", "two samples"])
def test_a_path_passes_its_samples_and_is_the_spline_of_its_definition(path):
    np.testing.assert_allclose(path.at(path.times) - path.samples, 0, atol=4e-16)
    times = np.linspace(path.times[0], path.times[-1], 3001)
    directions = path.at(times)
    np.testing.assert_allclose(directions, seen(path, times), atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-15)


@pytest.mark.parametrize("path", paths())
def test_the_rate_is_the_derivative_of_the_direction(path):
    step = 1e-4
    times = np.linspace(path.times[0] + 2 * step, path.times[-1] - 2 * step, 500)
    near, far = (path.at(times + k * step) - path.at(times - k * step) for k in (1, 2))
    np.testing.assert_allclose(path.rate(times), (8 * near - far) / (12 * step), atol=1e-10)
    np.testing.assert_allclose(np.sum(path.rate(times) * path.at(times), axis=1), 0, atol=1e-15)
    # the same from both sides of a sample
    inner = path.times[1:-1]
    np.testing.assert_allclose(
        path.rate(inner), path.rate(np.nextafter(inner, -np.inf)), atol=1e-12, err_msg="the rate jumps"
    )


def test_a_steady_turn_is_followed_to_the_fourth_power_of_the_time_between_samples():
    first, toward = np.array([1.0, 0, 0]), np.array([0.2, 0.9, 0.3])
    errors = []
    for samples in (9, 17):
        times = np.linspace(0, 80, samples)
        path = DirectionPath.through(times, great_circle(first, toward, 0.0011, times))
        dense = np.linspace(0, 80, 4001)
        errors.append(np.abs(path.at(dense) - great_circle(first, toward, 0.0011, dense)).max())
    assert errors[0] < 1e-9
    assert errors[1] < errors[0] / 8


# Also of four and five samples, whose end conditions meet.
SHORT = [turning_direction(np.random.default_rng(5), 0.02, 7.0 * np.arange(n) ** 1.2) for n in (4, 5)]


@pytest.mark.parametrize("path", [*paths(), *SHORT])
def test_a_path_made_again_by_jax_is_the_one_through_its_samples_whatever_its_slopes_and_their_lengths(path):
    stretched = np.linspace(0.5, 2.0, len(path.times))[:, None] * path.samples
    off = replace(path, samples=stretched, slopes=np.full_like(path.slopes, np.nan))
    with jax.enable_x64(True):
        again = off.resplined
    np.testing.assert_allclose(again.samples, path.samples, atol=1e-15)
    np.testing.assert_allclose(again.slopes, path.slopes, atol=1e-14)


@pytest.mark.parametrize("path", [*paths(), *SHORT])
def test_derivatives_of_slopes_by_samples_and_times_are_those_of_the_spline_through_others(path):
    rng, step = np.random.default_rng(0), 1e-3
    way = rng.normal(size=path.samples.shape)
    later = 0.1 * rng.normal(size=len(path.times))

    def through(by):
        return DirectionPath.through(path.times + by * later, unit(path.samples + by * way)).slopes

    def made(by):
        return replace(path, times=path.times + by * later, samples=path.samples + by * way).resplined.slopes

    with jax.enable_x64(True):
        along = jax.jvp(made, (0.0,), (1.0,))[1]
        weight = rng.normal(size=along.shape)
        back = jax.grad(lambda by: jnp.sum(weight * made(by)))(0.0)
    found = (8 * (through(step) - through(-step)) - through(2 * step) + through(-2 * step)) / (12 * step)
    np.testing.assert_allclose(along, found, atol=1e-8 * np.max(np.abs(found)))
    np.testing.assert_allclose(back, np.sum(weight * along), rtol=1e-12)


@pytest.mark.parametrize("path", paths())
def test_bounds_of_rate_and_reach_hold_at_every_instant_and_are_near(path):
    first, last = path.times[0] + 0.1 * np.ptp(path.times), path.times[0] + 0.7 * np.ptp(path.times)
    times = np.linspace(first, last, 20_001)
    quickest = np.linalg.norm(path.rate(times), axis=1).max()
    assert quickest <= path.largest_rate(first, last)
    axis = path.at((first + last) / 2)
    apart = angle(axis, path.at(times)).max()
    assert apart <= path.reach(axis, first, last) <= 1.1 * apart + 0.02 * quickest * (last - first)


def test_a_path_is_the_same_under_jit_vmap_and_jvp():
    path = paths()[2]
    times = np.linspace(0, 60, 50)
    np.testing.assert_allclose(jax.jit(lambda path, t: path.at(t))(path, times), path.at(times), atol=1e-15)
    each, slopes = jax.vmap(lambda t: jax.jvp(path.at, (t,), (1.0,)))(jnp.asarray(times))
    np.testing.assert_allclose(each, path.at(times), atol=1e-15)
    np.testing.assert_allclose(slopes, path.rate(times), atol=1e-13)
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *[path] * 3)
    many = jax.vmap(lambda path: path.at(7.0))(stacked)
    np.testing.assert_allclose(many, np.tile(path.at(7.0), (3, 1)), atol=1e-15)


@pytest.mark.parametrize("time", [-1e-9, 60.0 + 1e-9, np.nan])
def test_nothing_is_extrapolated(time):
    path = paths()[2]
    with pytest.raises(ValueError, match=r"must lie in \[0, 60\] s, where the direction is known"):
        path.at(time)
    with pytest.raises(ValueError, match="where the direction is known"):
        path.rate(np.array([1.0, time]))
    np.testing.assert_array_equal(jax.jit(path.at)(time), np.nan)


@pytest.mark.parametrize(
    ("times", "samples", "words"),
    [
        ([0.0], [[1, 0, 0]], "n at least 2"),
        ([0, 1], [[1, 0], [1, 0]], "must be"),
        ([0, 0], [[1, 0, 0], [1, 0, 0]], "rise"),
        ([0, np.nan], [[1, 0, 0], [1, 0, 0]], "finite"),
        ([0, 1], [[1, 0, 0], [2, 0, 0]], r"samples\[1\]"),
        ([0, 1], [[1, 0, 0], [np.nan, 0, 0]], r"samples\[1\]"),
        ([0, 1, 2], [[1, 0, 0], [1, 0, 0], [-1, 0, 0]], "turns too far between the samples"),
    ],
)
def test_samples_that_make_no_path_are_refused(times, samples, words):
    with pytest.raises(ValueError, match=words):
        DirectionPath.through(times, samples)


@pytest.mark.parametrize(
    ("target", "most"), [(AHEAD, 33), ("earth", 33), (np.array([7000.0, 0, 3000.0]), 129)], ids=str
)
def test_the_sky_has_a_path_within_its_accuracy_of_the_true_direction_and_rate(target, most):
    asked = {"epoch": EPOCH, "observer": HERE}
    path = sky.path(target, **asked, duration_s=300.0)
    assert len(path.times) <= most
    times = np.linspace(0, 300, 997)
    true = sky.directions(target, **asked, times=times)
    assert np.linalg.norm(path.at(times) - true, axis=1).max() <= 2e-9
    if not isinstance(target, np.ndarray):
        rates = sky.direction_rates(target, **asked, times=times)
        assert np.linalg.norm(path.rate(times) - rates, axis=1).max() <= 1e-8
        # 5 deg in 80 s, as every direction in the orbit's plane
        assert np.rad2deg(np.linalg.norm(path.rate(40.0))) * 80 == pytest.approx(5.0, abs=0.1)


def test_a_target_that_passes_too_close_is_refused():
    there = sky.positions(HERE, epoch=EPOCH, times=123.4)
    with pytest.raises(ValueError, match="passes so close"):
        sky.path(there + 1e-6, epoch=EPOCH, observer=HERE, duration_s=300.0)
    with pytest.raises(ValueError, match=r"duration_s = 0.0: must lie in \(0, 86400\] s"):
        sky.path("earth", epoch=EPOCH, observer=HERE, duration_s=0.0)


def test_a_zone_that_moves_is_no_wider_than_the_body_and_follows_it():
    asked = {"epoch": EPOCH, "observer": HERE, "exclusion_deg": 3.0, "for_duration_s": 80.0}
    moving, still = sky.keep_out("earth", moving=True, **asked), sky.keep_out("earth", **asked)
    limb = sky.angular_radius("earth", epoch=EPOCH, observer=HERE)
    assert moving.half_angle == pytest.approx(limb + np.deg2rad(3.0), abs=1e-9)
    assert still.half_angle - moving.half_angle == pytest.approx(np.deg2rad(2.5), abs=1e-3)
    times = np.linspace(0, 80, 100)
    down = sky.directions("earth", epoch=EPOCH, observer=HERE, times=times)
    np.testing.assert_allclose(moving.direction.at(times), down, atol=2e-9)
