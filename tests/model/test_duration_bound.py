"""Lower bounds of the duration: strict, near published optima, alike in numpy and JAX."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import make_spacecraft
from quick import quick_jit
from reference import assert_each, random_units
from scipy.spatial.transform import Rotation
from stages import change, momentum, with_stages
from wheels import random_wheels, wheels

from jaxplan import so3
from jaxplan.model.duration_bound import duration_bound, moving_bound, rest_bounds
from jaxplan.model.minimum_times import shortest_time
from jaxplan.model.spacecraft import Spacecraft


def brute_force(distance, first, last, rate, acceleration):
    """The least time on a fine grid in which the distance lies between the least and the largest possible."""
    times = np.linspace(0, 12, 2401)[:, None]
    t = times * np.linspace(0, 1, 401)

    def farthest_way(v, w):
        speed = np.minimum(np.minimum(v + acceleration * t, w + acceleration * (times - t)), rate)
        return np.trapezoid(speed, t, axis=1)

    possible = np.abs(first - last) <= acceleration * times[:, 0] + 1e-9
    possible &= (farthest_way(first, last) >= distance - 1e-3) & (
        -farthest_way(-first, -last) <= distance + 1e-3
    )
    return times[np.argmax(possible), 0]


def test_the_shortest_time_is_that_of_brute_force():
    rng = np.random.default_rng(8)
    cases = rng.uniform([-3, -1, -1, 1, 0.5], [3, 1, 1, 2, 2], size=(25, 5))
    cases[:5, 1:3] = 0
    cases[5:8, 0] = 0
    cases[8:10, 2] = -cases[8:10, 1]
    for case in cases:
        assert shortest_time(*case) == pytest.approx(brute_force(*case), abs=0.03), case
    assert shortest_time(*np.array([0.0, 0, 0, 1, 1])) == 0
    assert shortest_time(*np.array([0.0, 0.5, 0.5, 1, 1])) == 0  # it is there already, at the right rate


def test_no_motion_needs_no_time_and_the_slowest_axis_sets_the_bound():
    craft, still = make_spacecraft(1), np.zeros((2, 3))
    attitudes, joints = np.repeat(np.eye(3)[None], 2, axis=0), np.zeros((2, 2))
    assert duration_bound(craft, attitudes, joints, still, joints).seconds == 0
    moved = np.array([[0, 0], [1.0, 0.1]])
    rate, acceleration = craft.joint_rate_limits[0], craft.joint_acceleration_limits[0]
    bound = duration_bound(craft, attitudes, moved, still, joints)
    assert bound.seconds == pytest.approx(1 / rate + rate / acceleration)
    assert bound.name == craft.joint_names[0]


def free_flyer(**limits):
    return Spacecraft(**{"rate_limit": 1e3, "acceleration_limit": 1e3, **limits})


def seconds(craft, turns):
    return rest_bounds(craft, turns, np.zeros((len(turns), 0)))


def motions(count, *, at_rest, seed=9):
    """Smooth motions of 2 s: rates (S, 3), accelerations, the turn made, and the step of time."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2, 2001)
    window, rising = (np.sin(np.pi * t / 2), np.pi / 2 * np.cos(np.pi * t / 2))
    if not at_rest:
        window, rising = np.ones(len(t)), np.zeros(len(t))
    for _ in range(count):
        size, phase = rng.normal(size=(2, 3)), rng.uniform(0, 2 * np.pi, (2, 3))
        wave = sum(
            s * np.sin(k * t[:, None] + p) for k, (s, p) in enumerate(zip(size, phase, strict=True), 1)
        )
        slope = sum(
            k * s * np.cos(k * t[:, None] + p) for k, (s, p) in enumerate(zip(size, phase, strict=True), 1)
        )
        spin = window[:, None] * wave
        middle = (spin[1:] + spin[:-1]) / 2
        turn = np.eye(3)
        for step in Rotation.from_rotvec(middle * (t[1] - t[0])).as_matrix():
            turn = turn @ step
        yield spin, rising[:, None] * wave + window[:, None] * slope, turn


def limits_of(spin, acceleration, inertia):
    """The tightest limits of each kind that a motion keeps."""
    momentum = spin @ inertia
    torque = acceleration @ inertia + np.cross(spin, momentum)
    rates = {
        "rate_limit": np.abs(spin).max(axis=0),
        "rate_norm_limit": np.linalg.norm(spin, axis=1).max(),
        "acceleration_limit": np.abs(acceleration).max(axis=0),
        "acceleration_norm_limit": np.linalg.norm(acceleration, axis=1).max(),
    }
    yield rates
    yield {"inertia": inertia, "torque_limit": np.abs(torque).max(axis=0)}
    yield {"inertia": inertia, "torque_limit": np.abs(torque).max()}
    yield {"inertia": inertia, "wheel_momentum_limit": np.abs(momentum).max(axis=0)}
    yield from limits_of_wheels(spin, acceleration, inertia)


def limits_of_wheels(spin, acceleration, inertia):
    """Wheels that a motion just does not overload, empty ones and such that hold something at the start."""
    attitude, turned = np.eye(3), [np.eye(3)]
    step = 2 / (len(spin) - 1)
    for rate in (spin[1:] + spin[:-1]) / 2:
        attitude = attitude @ Rotation.from_rotvec(rate * step).as_matrix()
        turned.append(attitude)
    for count, stored in ((3, 0.0), (5, 0.7), (10, 3.0)):
        axes = random_units(np.random.default_rng(count), count)
        held = stored * np.linspace(-1, 1, count)
        total = inertia @ spin[0] + held @ axes
        carried = np.einsum("kji,j->ki", np.array(turned), total)
        share = np.linalg.pinv(axes.T)
        torque = (acceleration @ inertia + np.cross(spin, carried)) @ share.T
        momentum = held + (carried - spin @ inertia - held @ axes) @ share.T
        array = wheels(axes, np.abs(torque).max(axis=0), np.abs(momentum).max(axis=0), held)
        for allocation in ("pseudo_inverse", "minimax"):
            yield {"inertia": inertia, "wheels": array, "allocation": allocation}


@pytest.mark.parametrize("at_rest", [True, False])
def test_no_motion_is_quicker_than_the_bound_within_its_own_limits(at_rest):
    rng, shares = np.random.default_rng(10), []
    for spin, acceleration, turn in motions(40, at_rest=at_rest):
        axes = Rotation.random(rng=rng).as_matrix()
        inertia = axes @ np.diag(rng.uniform(1, 1.9, 3)) @ axes.T
        for limits in limits_of(spin, acceleration, inertia):
            attitudes, none = np.stack([np.eye(3), turn]), np.zeros((2, 0))
            bound = duration_bound(free_flyer(**limits), attitudes, none, spin[[0, -1]], none)
            assert bound.seconds <= 2 * (1 + 1e-6), limits
            shares.append(bound.seconds / 2)
    assert max(shares) > 0.5


def gimbals_of(count, seed, size, joints):
    """A spacecraft of terminals with stages of a size in kg m^2, whose joints' limits a motion just keeps.

    Args:
        joints: angles, rates and accelerations (S, 2 count) of the motion.
    """
    craft = with_stages(make_spacecraft(count), size, seed)
    rates, accelerations = (np.abs(own).max(axis=0) for own in joints[1:])
    terminals = tuple(
        replace(
            one,
            yaw_range=np.array([-9.0, 9.0]),
            yaw_limit=None,
            rate_limit=1.0,
            yaw_rate_limit=rates[k],
            pitch_rate_limit=rates[count + k],
            yaw_acceleration_limit=accelerations[k],
            pitch_acceleration_limit=accelerations[count + k],
        )
        for k, one in enumerate(craft.terminals)
    )
    return replace(craft, terminals=terminals, rate_limit=1e3, acceleration_limit=1e3)


def limits_with_stages(craft, spin, joints):
    """The tightest limits of each kind that a motion keeps."""
    own, rising = momentum(craft, spin[0], *joints[:2]), change(craft, spin, joints)
    torque = rising + np.cross(spin[0], own)
    yield {"torque_limit": np.abs(torque).max(axis=0)}
    yield {"wheel_momentum_limit": np.abs(own).max(axis=0)}
    rates = {
        "rate_limit": np.abs(spin[0]).max(axis=0),
        "acceleration_limit": np.abs(spin[1]).max(axis=0),
    }
    yield rates | {"torque_limit": np.abs(torque).max(axis=0)}
    attitude, turned, step = np.eye(3), [np.eye(3)], 2 / (len(own) - 1)
    for rate in (spin[0][1:] + spin[0][:-1]) / 2:
        attitude = attitude @ Rotation.from_rotvec(rate * step).as_matrix()
        turned.append(attitude)
    for count, stored in ((3, 0.0), (5, 0.7)):
        axes = random_units(np.random.default_rng(count), count)
        held = stored * np.linspace(-1, 1, count)
        carried = np.einsum("kji,j->ki", np.array(turned), own[0] + held @ axes)
        share = np.linalg.pinv(axes.T)
        given = (rising + np.cross(spin[0], carried)) @ share.T
        kept = held + (carried - own - held @ axes) @ share.T
        array = wheels(axes, np.abs(given).max(axis=0), np.abs(kept).max(axis=0), held)
        for allocation in ("pseudo_inverse", "minimax"):
            yield rates | {"wheels": array, "allocation": allocation}
            yield {"wheels": array, "allocation": allocation}


@pytest.mark.parametrize("at_rest", [True, False])
def test_no_motion_is_quicker_than_the_bound_where_gimbals_push_back(at_rest):
    rng, shares = np.random.default_rng(11), []
    t = np.linspace(0, 2, 2001)[:, None]
    for number, (velocity, acceleration, turn) in enumerate(motions(20, at_rest=at_rest)):
        count, size = 1 + number % 2, (0.002, 0.05, 0.2)[number % 3]
        axes = Rotation.random(rng=rng).as_matrix()
        inertia = axes @ np.diag(rng.uniform(1, 1.9, 3)) @ axes.T
        slow, _, phase = rng.uniform((0.1, 0.5, 0), (1, 3, 6), (2 * count, 3)).T
        quick = np.pi * rng.integers(1, 3, 2 * count)  # so that joints end as they began, and need no time
        angle = quick * t + phase
        joints = slow * np.sin(angle), slow * quick * np.cos(angle), -slow * quick**2 * np.sin(angle)
        craft = replace(gimbals_of(count, number, size, joints), inertia=inertia)
        spin = velocity, acceleration
        ends = np.stack([np.eye(3), turn]), joints[0][[0, -1]], velocity[[0, -1]], joints[1][[0, -1]]
        for limits in limits_with_stages(craft, spin, joints):
            bound = duration_bound(replace(craft, **limits), *ends)
            assert bound.seconds <= 2 * (1 + 1e-6), limits
            if bound.name not in craft.joint_names:
                shares.append(bound.seconds / 2)
    assert max(shares) > 0.5
    assert len(shares) > 20


@pytest.mark.parametrize("limits", [{"inertia": np.eye(3), "torque_limit": 1.0}, {"acceleration_limit": 1.0}])
def test_published_shortest_slews_lie_above_the_bound_and_near_it(limits):
    # Bilimoria and Wie 1993: a sphere, each torque at most 1, about z; the second by the same switching
    optima = np.array([3.2431, 2.4211])
    bounds = seconds(free_flyer(**limits), np.array([[0, 0, np.pi], [0, 0, np.pi / 2]]))
    assert_each(bounds, "<=", optima)
    assert_each(bounds, ">=", 0.92 * optima)


BOX = {"torque_limit": np.array([0.01, 0.02, 0.01]), "wheel_momentum_limit": 0.1}


@pytest.mark.parametrize("loads", [BOX, {"wheels": random_wheels(4, seed=2)}], ids=["box", "wheels"])
def test_bounds_at_rest_are_the_same_one_by_one_and_in_jax(loads):
    rng = np.random.default_rng(11)
    craft = replace(make_spacecraft(1), inertia=np.diag([1.0, 2.0, 2.5]) + 0.1, **loads)
    turns, moves = Rotation.random(20, rng=rng).as_rotvec(), rng.uniform(-0.5, 0.5, (20, 2))
    known, none = rest_bounds(craft, turns, moves), np.zeros((2, 3))
    for turn, move, bound in zip(turns, moves, known, strict=True):
        attitudes = np.stack([np.eye(3), Rotation.from_rotvec(turn).as_matrix()])
        joints = np.stack([np.zeros(2), move])
        one = duration_bound(craft, attitudes, joints, none, np.zeros((2, 2)))
        assert one.seconds == pytest.approx(bound, rel=1e-6)
    with jax.enable_x64(True):
        np.testing.assert_allclose(quick_jit(partial(rest_bounds, craft))(turns, moves), known, rtol=1e-9)
        slope = quick_jit(jax.grad(lambda turns, moves: rest_bounds(craft, turns, moves).sum()))
        slopes, at_zero = slope(turns, moves), slope(0 * turns, 0 * moves)
    assert_each(np.isfinite(at_zero), "==", True)
    for axis, step in enumerate(1e-6 * np.eye(3)):
        rise = rest_bounds(craft, turns + step, moves) - rest_bounds(craft, turns - step, moves)
        np.testing.assert_allclose(slopes[:, axis], rise / 2e-6, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("turning", [True, False])
@pytest.mark.parametrize("size", [None, 0.05], ids=["stiff", "stages"])
@pytest.mark.parametrize(
    "loads", [{}, BOX, {"wheels": random_wheels(4, seed=2)}], ids=["rates", "box", "wheels"]
)
def test_bounds_between_rates_are_the_same_in_jax_with_slopes_of_differences(loads, size, turning):
    rng = np.random.default_rng(12)
    craft = replace(make_spacecraft(1), inertia=np.diag([1.0, 2.0, 2.5]) + 0.1, **loads)
    craft = craft if size is None else with_stages(craft, size, 1)

    def ends(x):  # turn, joints, velocities and rates at both ends
        xp = np if isinstance(x, np.ndarray) else jnp
        attitudes = xp.stack([so3.exp(x[:3]), so3.exp(x[3:6])])
        spins = x[10:16].reshape(2, 3) if turning else np.zeros((2, 3))
        return attitudes, x[6:10].reshape(2, 2), spins, x[16:].reshape(2, 2)

    def bound(x):
        return moving_bound(craft, *ends(x), turning=turning)

    matter = 0
    with jax.enable_x64(True):
        both = quick_jit(jax.value_and_grad(bound))
        for _ in range(6):
            x = np.concatenate([rng.uniform(-0.9, 0.9, 10), 0.004 * rng.uniform(-1, 1, 10)])
            value, slope = both(jnp.asarray(x))
            assert float(value) == pytest.approx(duration_bound(craft, *ends(x)).seconds, rel=1e-9)
            step = 1e-7
            rise = [bound(x + step * one) - bound(x - step * one) for one in np.eye(20)]
            np.testing.assert_allclose(slope, np.array(rise) / (2 * step), rtol=1e-4, atol=1e-4)
            matter += np.sum(np.abs(slope[10:]) > 1e-3)
    assert matter > 0


def test_the_bound_says_which_limits_set_it():
    attitudes = np.stack([np.eye(3), Rotation.from_rotvec([1.0, 0, 0]).as_matrix()])
    still, none = np.zeros((2, 3)), np.zeros((2, 0))
    for limits, word in (
        ({"rate_limit": 0.1}, "rates"),
        ({"torque_limit": 0.1, "inertia": np.eye(3)}, "torque"),
        ({"wheels": random_wheels(4, seed=1), "inertia": 9 * np.eye(3)}, "torque"),
    ):
        assert word in duration_bound(free_flyer(**limits), attitudes, none, still, none).name
