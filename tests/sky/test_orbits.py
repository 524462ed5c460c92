"""Circular orbits against closed forms, and the paper's three target directions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import assert_each

from jaxplan.sky import frames, orbits

# Satellites with nothing in common: altitude km, then inclination, node and argument of latitude, rad.
RNG = np.random.default_rng(3)
ALTITUDE = RNG.uniform(200, 36_000, 50)
ANGLES = RNG.uniform([0, -np.pi, -np.pi], [np.pi, np.pi, np.pi], (50, 3)).T
TIMES = RNG.uniform(-10_000, 10_000, 50)


def positions(time):
    return orbits.position(ALTITUDE, *ANGLES, time)


@pytest.mark.paper
def test_the_papers_satellites_are_seen_in_its_target_directions():
    node, anomaly = np.deg2rad([[10.0, 10.0, 5.0, 13.0], [20.0, 25.0, 15.0, 15.0]])
    satellites = orbits.position(500.0, np.deg2rad(10.0), node, anomaly)
    seen = orbits.line_of_sight(satellites[0], satellites[1:])
    printed = [[-0.5349, 0.8296, 0.1604], [0.4212, -0.9032, -0.0832], [0.4601, -0.7960, -0.3933]]
    np.testing.assert_allclose(seen, printed, atol=5e-5)
    np.testing.assert_array_equal(orbits.earth_blocks(satellites[0], satellites[1:], 100.0), False)


def test_known_periods():
    # a geostationary satellite turns with the Earth: one sidereal day
    np.testing.assert_allclose(orbits.period(42_164.17 - frames.EARTH_RADIUS), 86_164.1, atol=0.1)
    radius = frames.EARTH_RADIUS + ALTITUDE
    np.testing.assert_allclose(
        orbits.period(ALTITUDE), 2 * np.pi * np.sqrt(radius**3 / 398600.4418), rtol=1e-14
    )


def test_a_period_later_the_satellite_is_back():
    later = positions(TIMES + np.asarray(orbits.period(ALTITUDE)))
    np.testing.assert_allclose(later, positions(TIMES), rtol=0, atol=1e-6)


def test_velocity_is_the_derivative_of_position():
    velocity = orbits.velocity(ALTITUDE, *ANGLES, TIMES)
    _, tangent = jax.jvp(positions, (jnp.asarray(TIMES),), (jnp.ones(50),))
    np.testing.assert_allclose(velocity, tangent, rtol=0, atol=1e-12)
    step = 10.0
    ahead, behind = (np.asarray(positions(TIMES + shift)) for shift in (step, -step))
    np.testing.assert_allclose(velocity, (ahead - behind) / (2 * step), atol=1e-3)


def test_motion_obeys_newton():
    acceleration = jax.jvp(
        lambda t: orbits.velocity(ALTITUDE, *ANGLES, t), (jnp.asarray(TIMES),), (jnp.ones(50),)
    )[1]
    p = np.asarray(positions(TIMES))
    radius = np.linalg.norm(p, axis=-1, keepdims=True)
    np.testing.assert_allclose(radius[:, 0], frames.EARTH_RADIUS + ALTITUDE, rtol=1e-14)
    np.testing.assert_allclose(acceleration, -398600.4418 * p / radius**3, rtol=0, atol=1e-14)


def test_the_elements_mean_what_they_say():
    momentum = np.cross(positions(TIMES), orbits.velocity(ALTITUDE, *ANGLES, TIMES))
    normal = momentum / np.linalg.norm(momentum, axis=-1, keepdims=True)
    inclination, node, latitude = ANGLES
    np.testing.assert_allclose(np.arccos(normal[:, 2]), inclination, atol=1e-7)
    ascending = np.stack([np.cos(node), np.sin(node), np.zeros(50)], axis=-1)
    np.testing.assert_allclose(np.sum(normal * ascending, axis=-1), 0, atol=1e-14)
    at_node = orbits.position(ALTITUDE, *ANGLES, -latitude / np.asarray(orbits.mean_motion(ALTITUDE)))
    np.testing.assert_allclose(at_node, (frames.EARTH_RADIUS + ALTITUDE)[:, None] * ascending, atol=1e-6)
    assert_each(orbits.velocity(ALTITUDE, inclination, node, 0.0)[:, 2], ">", 0)


def test_a_direction_is_a_unit_vector_and_opposite_from_the_other_end():
    here, there = np.asarray(positions(0.0)), np.asarray(positions(TIMES))
    forth, back = orbits.line_of_sight(here, there), orbits.line_of_sight(there, here)
    np.testing.assert_array_equal(forth, -np.asarray(back))
    np.testing.assert_allclose(np.linalg.norm(forth, axis=-1), 1, rtol=1e-15)
    np.testing.assert_allclose(np.cross(forth, there - here), 0, atol=1e-10)
    assert_each(np.sum(np.asarray(forth) * (there - here), axis=-1), ">", 0)


def test_two_satellites_in_one_place_have_no_direction_and_finite_derivatives():
    place = jnp.array([7000.0, 0.0, 0.0])
    np.testing.assert_array_equal(orbits.line_of_sight(place, place), np.zeros(3))
    np.testing.assert_array_equal(np.isfinite(jax.jacobian(orbits.line_of_sight)(place, place)), True)
    np.testing.assert_allclose(orbits.grazing_altitude(place, place), 7000 - frames.EARTH_RADIUS)


def test_the_line_between_satellites_of_one_orbit_grazes_at_the_sagitta():
    apart = np.deg2rad([0.5, 10.0, 43.9, 44.2, 90.0, 179.0])
    satellites = orbits.position(500.0, 0.9, 0.4, np.append(0.0, apart))
    expected = (frames.EARTH_RADIUS + 500) * np.cos(apart / 2) - frames.EARTH_RADIUS
    np.testing.assert_allclose(orbits.grazing_altitude(satellites[0], satellites[1:]), expected, atol=1e-9)
    # the line touches the sphere at 2 acos(R / (R + h)) = 43.95 deg
    blocked = orbits.earth_blocks(satellites[0], satellites[1:])
    np.testing.assert_array_equal(blocked, [False, False, False, True, True, True])
    np.testing.assert_array_equal(orbits.earth_blocks(satellites[0], satellites[1:], 501.0), True)


def test_a_satellite_straight_above_another_is_seen():
    low, high = np.array([0.0, 0.0, 7000.0]), np.array([0.0, 0.0, 42_000.0])
    np.testing.assert_allclose(orbits.grazing_altitude(low, high), 7000 - frames.EARTH_RADIUS)
    np.testing.assert_allclose(orbits.grazing_altitude(high, low), 7000 - frames.EARTH_RADIUS)
    assert not orbits.earth_blocks(low, high)


def test_a_position_that_is_no_number_counts_as_blocked():
    assert orbits.earth_blocks(np.array([7000.0, 0.0, 0.0]), np.array([7000.0, np.nan, 1.0]))


def test_the_precision_follows_the_input():
    satellites = orbits.position(
        jnp.float32(500.0), jnp.float32(0.2), jnp.float32(0.1), jnp.float32([0.3, 0.4])
    )
    assert satellites.dtype == orbits.line_of_sight(satellites[0], satellites[1]).dtype == jnp.float32
