"""Arrays of wheels: rows by numpy and scipy, what they give and hold, and how it scales with time."""

from dataclasses import replace
from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import make_plan, make_spacecraft
from manoeuvres import manoeuvre
from reference import random_units
from scipy.optimize import linprog
from wheels import (
    INERTIA,
    by_envelope,
    by_pseudo_inverse,
    exchanged,
    least_shared,
    random_wheels,
    wheels,
)

from jaxplan.model.kinematics import time_factor
from jaxplan.model.limits import limits, timed_limits
from jaxplan.model.wheel_reach import shared_out
from jaxplan.model.wheels import MINIMAX, PSEUDO_INVERSE, wheel_array
from jaxplan.trajectory import measures, total_momentum
from jaxplan.trajectory.peaks import peaks

PYRAMID = np.array([[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]]) / np.sqrt(2)


def reach(axes, bound, along):
    """The largest multiple of a vector that is in a zonotope: by linprog."""
    equal = np.column_stack([axes.T, -along])
    found = linprog(
        np.append(np.zeros(len(axes)), -1.0),
        A_eq=equal,
        b_eq=np.zeros(3),
        bounds=[*((-b, b) for b in bound), (0, None)],
    )
    return -found.fun


def test_each_wheel_of_a_pseudo_inverse_has_a_row():
    for count in (3, 4, 6):
        array = random_wheels(count, seed=count)
        found = wheel_array(array, PSEUDO_INVERSE)
        axes = np.array([one.axis for one in array])
        np.testing.assert_allclose(found.rows, np.linalg.pinv(axes.T), atol=1e-14)
        held = np.array([one.stored for one in array])
        np.testing.assert_allclose(found.stored, held @ axes, atol=1e-15)
        np.testing.assert_allclose(found.rows @ found.stored + found.apart, held, atol=1e-14)
        np.testing.assert_allclose(found.apart @ axes, 0, atol=1e-14)
        np.testing.assert_array_equal(found.torque, [one.torque for one in array])


AXES = {
    "three": np.eye(3),
    "a pyramid": PYRAMID,
    "six about random axes": random_units(np.random.default_rng(4), 6),
    "three in one plane, and one": np.array([[1, 0, 0], [0, 1, 0], [0.6, 0.8, 0], [0, 0, 1]]),
    "two along one axis": np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1], [0, 0.6, 0.8]]),
}


@pytest.mark.parametrize("name", AXES)
def test_the_envelope_is_all_that_some_sharing_out_reaches(name):
    axes, rng = AXES[name], np.random.default_rng(5)
    torque = rng.uniform(0.5, 2, len(axes))
    found = wheel_array(wheels(axes, torque, 3 * torque[::-1]), MINIMAX)
    assert found.rows.shape == (len(axes) * (len(axes) - 1) // 2, 3)
    sizes = np.linalg.norm(found.rows, axis=1)
    assert set(np.round(sizes, 12)) <= {0.0, 1.0}
    kept = found.rows[sizes > 0]
    assert np.all(np.abs(kept @ kept.T)[~np.eye(len(kept), dtype=bool)] < 1 - 1e-9)  # none twice
    for bound, limit in ((torque, found.torque), (3 * torque[::-1], found.momentum)):
        for along in [*random_units(rng, 12), *axes]:
            most = np.max(np.abs(found.rows @ along) / limit)
            assert 1 / most == pytest.approx(reach(axes, bound, along), rel=1e-9)


def test_rows_and_their_slopes_are_those_of_numpy_in_jax():
    array = random_wheels(5, seed=6)
    for allocation in (PSEUDO_INVERSE, MINIMAX):
        expected = wheel_array(array, allocation)
        with jax.enable_x64(True):
            found = jax.jit(wheel_array, static_argnums=1)(array, allocation)
            slopes = jax.jit(jax.jacfwd(wheel_array), static_argnums=1)(array, allocation)
        for own, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(own, other, atol=1e-14)
        for leaf in jax.tree.leaves(slopes):
            assert np.isfinite(leaf).all()
        step = 1e-6 * np.array([0.3, -0.5, 0.2])
        ends = [
            wheel_array((replace(array[0], axis=array[0].axis + side * step), *array[1:]), allocation)
            for side in (1, -1)
        ]
        for name in ("rows", "apart", "stored", "torque", "momentum"):
            rise = (getattr(ends[0], name) - getattr(ends[1], name)) / 2
            slope = getattr(slopes, name)[0].axis @ step
            np.testing.assert_allclose(slope, rise, atol=1e-15)


def test_the_sum_of_parallel_wheels_is_that_of_one():
    twice = wheel_array(wheels(np.array([[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), 1.0, 2.0), MINIMAX)
    once = wheel_array(wheels(np.eye(3), [2.0, 1, 1], [4.0, 2, 2]), MINIMAX)
    for along in random_units(np.random.default_rng(7), 20):
        own, other = (np.max(np.abs(each.rows @ along) / each.torque) for each in (twice, once))
        assert own == pytest.approx(other, rel=1e-12)


def craft_of(array, allocation=PSEUDO_INVERSE, terminals=1):
    return replace(
        make_spacecraft(terminals),
        rate_limit=9.0,
        acceleration_limit=9.0,
        inertia=INERTIA,
        wheels=array,
        allocation=allocation,
    )


def test_torque_is_the_change_of_what_the_wheels_hold():
    """By differences of the components in body axes: ``tau = -h'``."""
    trajectory, craft = manoeuvre(7, terminals=1, pieces=1, wiggle=0.4), craft_of(random_wheels(4, seed=8))
    time, step = np.linspace(1, 79, 50), 1e-3
    ends = [exchanged(trajectory, craft, time + side * step)[1] for side in (1, -1)]
    expected = -(ends[0] - ends[1]) / (2 * step)
    motion = trajectory.sample(time).kinematics(craft, total_momentum(trajectory, craft))
    size = np.abs(expected).max()
    np.testing.assert_allclose(np.transpose(motion.torque), expected, atol=1e-6 * size)
    for allocation, stated in ((PSEUDO_INVERSE, by_pseudo_inverse), (MINIMAX, by_envelope)):
        own = craft_of(craft.wheels, allocation)
        motion = trajectory.sample(time).kinematics(own, total_momentum(trajectory, own))
        for limit, shares in zip(limits(own)[-2:], stated(trajectory, own, time), strict=True):
            np.testing.assert_allclose(limit.shares(motion).T, np.abs(shares), atol=1e-8 * shares.max())


def test_empty_wheels_along_the_body_axes_are_a_box_without_gyroscopic_torque():
    trajectory = make_plan(1).trajectory
    craft = craft_of(wheels(np.eye(3), 0.5, [4.0, 5.0, 6.0]))
    own = limits(craft)
    time = np.linspace(0, trajectory.duration, 40)
    samples = trajectory.sample(time)
    motion = samples.kinematics(craft, total_momentum(trajectory, craft))
    start = INERTIA @ samples.angular_velocity[0]
    np.testing.assert_allclose(start, 0, atol=1e-12)
    expected = INERTIA @ samples.angular_acceleration.T, INERTIA @ samples.angular_velocity.T
    for limit, values in zip(own[-2:], expected, strict=True):
        shares = np.abs(values) / limit.bound[:, None]
        np.testing.assert_allclose(limit.shares(motion), shares, atol=1e-12)
    assert limits(craft)[-1].names == ("wheel-1 momentum", "wheel-2 momentum", "wheel-3 momentum")


@pytest.mark.parametrize("xp", [np, jnp], ids=["numpy", "JAX"])
@pytest.mark.parametrize("power", [1, 2])
def test_a_time_factor_is_the_first_from_which_on_the_limit_is_kept(power, xp):
    """Against a fine grid of factors; and its slopes are those of differences."""
    rng = np.random.default_rng(9)
    share, lesser = rng.uniform(-3, 3, 400), rng.uniform(-1.5, 1.5, 400)
    share[:5], lesser[5:10] = 0.0, 0.0
    with jax.enable_x64(True):
        found = np.asarray(time_factor(xp.asarray(share), power, xp.asarray(lesser)))
    assert np.array_equal(np.isinf(found), (power == 1) & (np.abs(lesser) > 1))
    grid = np.linspace(0, 12, 40_001)[:, None]
    with np.errstate(all="ignore"):
        kept = np.abs(share / grid**power + lesser / grid ** (power - 1)) <= 1
    kept[0] |= found == 0
    last = np.where(kept.all(axis=0), 0, len(grid) - 1 - np.argmax(~kept[::-1], axis=0))
    near = found < 11.9
    np.testing.assert_allclose(found[near], grid[last[near], 0], atol=4e-4)
    only = time_factor(np.abs(share), power)
    np.testing.assert_allclose(time_factor(share, power, 0 * lesser), only, rtol=1e-14)
    with jax.enable_x64(True):
        told = jax.grad(lambda a, b: jnp.sum(jnp.where(near, time_factor(a, power, b), 0)), (0, 1))
        slopes = told(share, lesser)
    for slope, ways in zip(slopes, np.eye(2), strict=True):
        ends = [time_factor(share + s * ways[0], power, lesser + s * ways[1])[near] for s in (1e-7, -1e-7)]
        rise = (ends[0] - ends[1]) / 2e-7
        smooth = (share[near] != 0) & (np.abs(rise) < 1e3)
        np.testing.assert_allclose(np.asarray(slope)[near][smooth], rise[smooth], rtol=1e-4, atol=1e-4)
        assert np.isfinite(slope).all()


def test_peaks_and_the_stretch_are_those_of_dense_samples():
    for seed, allocation in ((1, PSEUDO_INVERSE), (2, MINIMAX), (3, PSEUDO_INVERSE)):
        trajectory = make_plan(1).trajectory
        craft = craft_of(random_wheels(3 + seed, seed), allocation)
        stated = {PSEUDO_INVERSE: by_pseudo_inverse, MINIMAX: by_envelope}[allocation]
        found = peaks(trajectory, craft)
        time = np.linspace(0, trajectory.duration, 30_001)[:-1]
        dense = np.concatenate([np.abs(own).max(axis=0) for own in stated(trajectory, craft, time)])
        of_wheels = np.flatnonzero([not name.startswith("platform") for name in found.names])[: len(dense)]
        np.testing.assert_allclose(found.ratios[of_wheels], dense, rtol=1e-5)
        assert np.all(found.ratios[of_wheels] >= dense * (1 - 1e-12))
        slow = trajectory.scaled(found.stretch)
        reached = peaks(slow, craft)
        assert np.max(reached.ratios) == pytest.approx(1, abs=1e-9)
        assert measures.stretch(trajectory, craft) == pytest.approx(found.stretch, rel=1e-9)


def test_where_slowing_down_does_not_help_the_stretch_is_infinite():
    trajectory = make_plan(1).trajectory
    held = limits(craft_of(wheels(np.eye(3))))[-1]
    turned = np.abs(trajectory.sample(trajectory.duration).attitude.T @ trajectory.sample(0.0).attitude)
    stored, most = 1.0, float(turned[1:, 0].max())
    tight = craft_of(wheels(np.eye(3), 1e3, [1.1 * stored, 0.9 * most, 0.9 * most], [stored, 0, 0]))
    loose = craft_of(wheels(np.eye(3), 1e3, 3.0, [stored, 0, 0]))
    assert np.isinf(peaks(trajectory, tight).stretch)
    assert np.isinf(measures.stretch(trajectory, tight))
    assert not peaks(trajectory.scaled(1e3), tight).kept
    assert np.isfinite(peaks(trajectory, loose).stretch)
    assert held.quantity.power == 1
    assert len(timed_limits(tight)[0]) == 4


def test_pairs_are_named_by_their_wheels():
    own = limits(craft_of(random_wheels(3, seed=1), MINIMAX))[-2]
    pairs = combinations((1, 2, 3), 2)
    assert own.owners == tuple(f"array across wheel-{a} and wheel-{b}" for a, b in pairs)


@pytest.mark.parametrize("name", AXES)
def test_the_least_largest_sharing_out_is_that_of_a_linear_program(name):
    axes, rng = AXES[name], np.random.default_rng(8)
    limit = rng.uniform(0.5, 2, len(axes))
    vectors = np.vstack([2 * rng.normal(size=(20, 3)), np.eye(3), axes, axes[:2].sum(axis=0)[None]])
    found = shared_out(axes, limit, vectors.T)
    np.testing.assert_allclose(found.T @ axes, vectors, atol=1e-12)
    for own, vector in zip(found.T, vectors, strict=True):
        least = least_shared(axes, limit, vector)[0]
        assert np.max(np.abs(own) / limit) == pytest.approx(least, abs=1e-9)
    assert shared_out(axes, limit, np.zeros(3)).tolist() == [0.0] * len(axes)
