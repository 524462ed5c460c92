"""The list of limits: what a spacecraft has of it, closed forms, and how quantities scale with time."""

import pickle
from dataclasses import replace
from itertools import chain, combinations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from manoeuvres import craft, manoeuvre
from reference import attitudes_of, joints_of, spin_of

from jaxplan.model.kinematics import Kinematics, time_factor
from jaxplan.model.limits import (
    QUANTITIES,
    are_lengths,
    components,
    highest_derivative,
    limits,
    longest,
    values,
)
from jaxplan.trajectory import measures
from jaxplan.trajectory.peaks import peaks as peaks_of

INERTIA = np.array([[12.0, 0.5, -0.3], [0.5, 8.0, 0.2], [-0.3, 0.2, 15.0]])
OPTIONAL = {
    "rate_norm_limit": 0.03,
    "acceleration_norm_limit": 0.004,
    "jerk_limit": np.array([1e-3, 2e-3, 3e-3]),
    "torque_limit": np.array([0.1, 0.2, 0.3]),
    "wheel_momentum_limit": 0.7,
    "inertia": INERTIA,
}
JOINTS = {"rate_limit": 0.01, "acceleration_limit": 0.002, "yaw_limit": 3.0, "pitch_limit": 1.0}
EVERY = craft(2, joints=JOINTS, **OPTIONAL)
RIGID = craft(0, inertia=INERTIA)


def by_name(spacecraft):
    return {limit.quantity.name: limit for limit in limits(spacecraft)}


@pytest.mark.parametrize("terminals", [0, 1, 2])
def test_a_spacecraft_has_just_the_limits_that_it_was_given(terminals):
    for given in chain.from_iterable(combinations(OPTIONAL, size) for size in range(len(OPTIONAL) + 1)):
        own = craft(terminals, rate_limit=0.02, joints=JOINTS, **{name: OPTIONAL[name] for name in given})
        expected = {"angular_velocity": np.full(3, 0.02)}
        if "rate_norm_limit" in given:
            expected["angular_velocity_norm"] = np.full(1, 0.03)
        expected["angular_acceleration"] = np.full(3, 9.0)
        if "acceleration_norm_limit" in given:
            expected["angular_acceleration_norm"] = np.full(1, 0.004)
        if terminals:
            expected |= {"joint_rates": np.full(2 * terminals, 0.01)}
            expected |= {"joint_accelerations": np.full(2 * terminals, 0.002)}
            expected |= {"yaw": np.full(terminals, 3.0), "pitch": np.full(terminals, 1.0)}
        if "torque_limit" in given and "inertia" in given:
            expected["torque"] = OPTIONAL["torque_limit"]
        if "wheel_momentum_limit" in given and "inertia" in given:
            expected["wheel_momentum"] = np.full(3, 0.7)
        if "jerk_limit" in given:
            expected["jerk"] = OPTIONAL["jerk_limit"]
        found = by_name(own)
        assert list(found) == list(expected), given
        for name, bound in expected.items():
            np.testing.assert_array_equal(found[name].bound, bound, err_msg=name)
            assert len(found[name].names) == len(bound)


def test_a_spacecraft_whose_limits_have_been_asked_for_goes_to_other_processes():
    found = limits(EVERY)
    again = limits(pickle.loads(pickle.dumps(EVERY)))
    assert [one.quantity for one in again] == [one.quantity for one in found]
    assert all(one.quantity in QUANTITIES for one in again)


def test_components_are_told_apart_by_name():
    every = [name for limit in limits(EVERY) if limit.quantity.power for name in limit.names]
    assert len(set(every)) == len(every)
    assert {"platform rate x", "platform jerk z", "platform torque y", "platform momentum x"} <= set(every)
    assert {"platform rate length", "platform acceleration length"} <= set(every)
    assert {"terminal-0 yaw rate", "terminal-1 pitch acceleration"} <= set(every)
    joints = list(by_name(EVERY)["joint_rates"].owners)
    assert joints == ["terminal-0 yaw", "terminal-1 yaw", "terminal-0 pitch", "terminal-1 pitch"]
    assert by_name(EVERY)["pitch"].owners == ("terminal-0", "terminal-1")


def test_people_read_angles_in_degrees_and_raised_exponents():
    for quantity in QUANTITIES:
        angular = quantity.unit.startswith("deg")
        assert quantity.in_unit(0.5) == (np.rad2deg(0.5) if angular else 0.5)
        assert quantity.by_inertia == (not angular)
        if angular:  # the unit says the same as the power
            assert quantity.unit == ("deg", "deg/s", "deg/s^2", "deg/s^3")[quantity.power]
            assert quantity.printed_unit == ("deg", "deg/s", "deg/s²", "deg/s³")[quantity.power]


@pytest.mark.parametrize("xp", [np, jnp], ids=["numpy", "JAX"])
def test_torque_of_a_free_symmetric_body_is_none_and_its_momentum_is_closed_form(xp):
    """``J = diag(a, a, c)``: its rate goes round the axis of symmetry at ``(c - a) / a`` times the spin."""
    a, c, tilt, spin = 5.0, 8.0, 0.3, 0.2
    turn = (c - a) / a * spin
    time = np.linspace(0, 60, 101)
    rate = np.stack([tilt * np.cos(turn * time), tilt * np.sin(turn * time), np.full(len(time), spin)])
    change = turn * np.stack([-rate[1], rate[0], 0 * time])
    inertia = np.diag([a, a, c])
    with jax.enable_x64(True):
        motion = Kinematics(spin=[xp.asarray(rate), xp.asarray(change)], inertia=xp.asarray(inertia))
        found = values(("torque", "angular_velocity_norm", "wheel_momentum"), motion)
        assert isinstance(found, jax.Array if xp is jnp else np.ndarray)
        torque, length, momentum = (
            found[own] for own in components(("torque", "angular_velocity_norm", "wheel_momentum"))
        )
    np.testing.assert_allclose(torque, 0, atol=1e-15)
    np.testing.assert_allclose(length, np.full((1, len(time)), np.hypot(tilt, spin)), rtol=1e-14)
    np.testing.assert_allclose(momentum, inertia @ rate, rtol=1e-14)


def test_torque_is_the_change_of_the_momentum_in_inertial_axes():
    trajectory, step, time = manoeuvre(7, terminals=1, pieces=1, wiggle=0.4), 1e-3, np.linspace(1, 79, 50)

    def momentum(time):
        attitude = attitudes_of(trajectory, time, np.zeros(len(time), int))
        return np.einsum("kij,jl,kl->ki", attitude, INERTIA, spin_of(trajectory, time)[0])

    found = trajectory.sample(time)
    change = (momentum(time + step) - momentum(time - step)) / (2 * step)
    expected = np.einsum("kij,ki->jk", found.attitude, change)
    np.testing.assert_allclose(found.kinematics(RIGID).torque, expected, atol=1e-6 * np.abs(expected).max())


def test_quantities_of_a_motion_are_those_of_its_definition():
    trajectory, time = manoeuvre(8, terminals=2, wiggle=0.4), np.linspace(0.5, 79.5, 20)
    motion = trajectory.sample(time).kinematics(RIGID)
    spin, joints = spin_of(trajectory, time), joints_of(trajectory, time)
    expected = {
        "angular_velocity": spin[0],
        "angular_acceleration": spin[1],
        "jerk": spin[2],
        "joint_rates": joints[1],
        "joint_accelerations": joints[2],
        "yaw": joints[0][:, :2],
        "pitch": joints[0][:, 2:],
        "torque": spin[1] @ INERTIA + np.cross(spin[0], spin[0] @ INERTIA),
        "wheel_momentum": spin[0] @ INERTIA,
        "angular_velocity_norm": np.linalg.norm(spin[0], axis=1)[:, None],
        "angular_acceleration_norm": np.linalg.norm(spin[1], axis=1)[:, None],
    }
    for limit in limits(EVERY):
        own = expected.pop(limit.quantity.name)
        found, size = limit.quantity.values(motion), np.abs(own).max()
        np.testing.assert_allclose(np.transpose(found), own, atol=1e-6 * size, err_msg=limit.quantity.name)
        np.testing.assert_allclose(limit.shares(motion), np.abs(found) / limit.bound[:, None], rtol=1e-15)
    assert not expected


def test_powers_of_time_are_exact():
    trajectory, time = manoeuvre(9, terminals=2, wiggle=0.4), np.linspace(0, 80, 30)[:-1]
    for slower in (0.5, 2.0, 3.7):
        at = np.minimum(slower * time, np.nextafter(slower * trajectory.duration, 0))
        motion, slow = (
            curve.sample(own).kinematics(RIGID)
            for curve, own in ((trajectory, time), (trajectory.scaled(slower), at))
        )
        for limit in limits(EVERY):
            quantity = limit.quantity
            own = quantity.values(motion)
            np.testing.assert_allclose(
                quantity.values(slow) * slower**quantity.power,
                own,
                atol=1e-9 * np.abs(own).max(),  # a sample may be of the place beside its own
                err_msg=quantity.name,
            )
            if quantity.power:
                np.testing.assert_allclose(time_factor(slower**quantity.power, quantity.power), slower)


def test_what_a_quantity_is_made_of_is_enough_for_it():
    everything = [np.ones(3), np.ones(3), np.ones(3)]
    for quantity in QUANTITIES:
        if not (quantity.of_joints or quantity.of_wheels):
            needed = everything[: highest_derivative([quantity.name])]
            size = 1 if quantity.of_length else 3
            assert np.shape(quantity.values(Kinematics(spin=needed, inertia=INERTIA))) == (size,)
            with pytest.raises(IndexError):
                quantity.values(Kinematics(spin=needed[:-1], inertia=INERTIA))
    assert highest_derivative(["angular_velocity", "jerk", "torque"]) == 3


def test_components_stand_one_after_the_other():
    names = ("angular_velocity", "angular_velocity_norm", "angular_acceleration_norm", "jerk")
    assert components(names) == [slice(0, 3), slice(3, 4), slice(4, 5), slice(5, 8)]
    assert are_lengths(names).tolist() == [False] * 3 + [True] * 2 + [False] * 3
    rng = np.random.default_rng(2)
    spin = rng.normal(size=(3, 3, 7))
    expected = [spin[0], *(np.linalg.norm(spin[d], axis=0)[None] for d in (0, 1)), spin[2]]
    np.testing.assert_allclose(values(names, Kinematics(spin=spin)), np.concatenate(expected), rtol=1e-14)


def test_a_length_has_slopes_where_it_is_zero():
    (velocity,) = (q for q in QUANTITIES if q.name == "angular_velocity_norm")

    def length(spin):
        return velocity.values(Kinematics(spin=[spin]))[0]

    with jax.enable_x64(True):
        for order in (jax.grad, lambda f: jax.hessian(f)):
            assert not np.any(order(length)(jnp.zeros(3)))
        np.testing.assert_allclose(jax.grad(length)(jnp.array([0.0, 3.0, 4.0])), [0, 0.6, 0.8])


@pytest.mark.parametrize(
    ("given", "rate", "acceleration"),
    [
        ({}, np.sqrt(3) * 9.0, np.sqrt(3) * 9.0),
        ({"rate_limit": [0.2, 0.3, 0.6]}, 0.7, np.sqrt(3) * 9.0),
        ({"rate_limit": [0.2, 0.3, 0.6], "rate_norm_limit": 0.65}, 0.65, np.sqrt(3) * 9.0),
        ({"rate_norm_limit": 99.0, "acceleration_norm_limit": 1.5}, np.sqrt(3) * 9.0, 1.5),
        ({"inertia": INERTIA, "torque_limit": 1e-9}, np.sqrt(3) * 9.0, np.sqrt(3) * 9.0),
    ],
)
def test_the_largest_length_is_the_diagonal_of_the_box_or_the_limit_of_the_length(given, rate, acceleration):
    own = craft(1, joints=JOINTS, **given)
    np.testing.assert_allclose([longest(own, 1), longest(own, 2)], [rate, acceleration], rtol=1e-15)


@pytest.mark.parametrize("power", [1, 2, 3])
def test_the_time_factor_has_a_slope_everywhere(power):
    def factor(share):
        return time_factor(share, power)

    with jax.enable_x64(True):
        assert jax.grad(factor)(8.0) == pytest.approx(8.0 ** (1 / power - 1) / power, rel=1e-14)
        assert factor(jnp.zeros(2)).tolist() == [0, 0]
        assert np.isfinite(jax.grad(factor)(0.0))
        assert np.isnan(factor(jnp.nan))


def test_bounds_follow_a_spacecraft_that_is_differentiated():
    def total(spacecraft):
        return sum(jnp.sum(limit.bound) for limit in limits(spacecraft))

    with jax.enable_x64(True):
        slope = jax.jit(jax.grad(total, allow_int=True))(EVERY)
    assert (slope.rate_limit, slope.wheel_momentum_limit) == (3, 3)
    assert (slope.rate_norm_limit, slope.acceleration_norm_limit) == (1, 1)
    np.testing.assert_array_equal(slope.jerk_limit, np.ones(3))
    np.testing.assert_array_equal(slope.torque_limit, np.ones(3))
    assert [float(one.rate_limit) for one in slope.terminals] == [2, 2]


@pytest.mark.slow
@pytest.mark.parametrize("binding", [limit.quantity.name for limit in limits(EVERY) if limit.quantity.power])
def test_a_motion_scaled_to_its_limits_just_keeps_the_one_that_binds(binding):
    trajectory = manoeuvre(10, terminals=2, wiggle=0.4)
    wide = craft(2, jerk_limit=9.0, inertia=INERTIA, torque_limit=99.0, wheel_momentum_limit=99.0)
    narrow = {
        "angular_velocity": {"rate_limit": 1e-3},
        "angular_velocity_norm": {"rate_norm_limit": 1e-3},
        "angular_acceleration": {"acceleration_limit": np.array([1e-4, 1.0, 1.0])},
        "angular_acceleration_norm": {"acceleration_norm_limit": 1e-4},
        "jerk": {"jerk_limit": 1e-5},
        "torque": {"torque_limit": np.full(3, 1e-3)},
        "wheel_momentum": {"wheel_momentum_limit": np.full(3, 1e-2)},
        "joint_rates": {"rate_limit": 1e-3},
        "joint_accelerations": {"acceleration_limit": 1e-5},
    }[binding]
    if binding.startswith("joint"):
        own = replace(wide, terminals=tuple(replace(one, **narrow) for one in wide.terminals))
    else:
        own = replace(wide, **narrow)
    peaks = peaks_of(trajectory, own)
    slow = trajectory.scaled(peaks.stretch)
    both_sides = [np.linspace(0, slow.duration, 20_001), slow.breaks, np.nextafter(slow.breaks[1:], 0)]
    motion = slow.sample(np.concatenate(both_sides)).kinematics(RIGID)  # the jerk jumps at breaks
    shares = {limit.quantity.name: np.max(limit.shares(motion)) for limit in limits(own)}
    assert max(shares, key=lambda name: shares[name]) == binding
    assert shares[binding] == pytest.approx(1, abs=1e-3)
    assert max(shares.values()) <= 1 + 1e-9
    assert peaks.names[peaks.binding] in by_name(own)[binding].names
    with jax.enable_x64(True):
        assert float(measures.stretch(trajectory, own)) == pytest.approx(peaks.stretch, rel=1e-9)
