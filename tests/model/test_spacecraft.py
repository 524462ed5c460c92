"""Where devices point, and the joint angles that make terminals point somewhere."""

import jax
import numpy as np
import pytest
from builders import gimbals_about_z
from reference import assert_each
from scipy.spatial.transform import Rotation

from jaxplan.geometry.vectors import array_module, pointing
from jaxplan.model import gimbals
from jaxplan.model.devices import Instrument, Terminal
from jaxplan.model.spacecraft import Spacecraft

COUNTS = [0, 1, 2, 4, 12]
AXIS = np.array([0.6, 0.0, 0.8])


def craft(terminals, instruments=0):
    """Terminals spread unevenly about the body's z axis, all different, and instruments in odd directions."""
    boresights = np.random.default_rng(1).normal(size=(instruments, 3))
    return Spacecraft(
        terminals=tuple(
            Terminal(
                name=f"terminal-{i}",
                mount=0.3 + 2.1 * i,
                yaw_limit=1.0 + 0.1 * i,
                pitch_limit=0.2 + 0.01 * i,
                rate_limit=0.05 + 0.001 * i,
                acceleration_limit=0.03 + 0.001 * i,
            )
            for i in range(terminals)
        ),
        instruments=tuple(
            Instrument(name=f"tracker-{i}", boresight=b / np.linalg.norm(b)) for i, b in enumerate(boresights)
        ),
        rate_limit=0.05,
        acceleration_limit=0.03,
    )


def random_state(count, terminals, seed=2):
    """Attitudes (count, 3, 3), yaws anywhere and pitches off the poles (count, 2n)."""
    rng = np.random.default_rng(seed)
    yaws = rng.uniform(-np.pi, np.pi, (count, terminals))
    pitches = rng.uniform(-1.5, 1.5, (count, terminals))
    return Rotation.random(count, rng=rng).as_matrix(), np.concatenate([yaws, pitches], axis=1)


def same_angle(first, second, atol):
    np.testing.assert_allclose(np.exp(1j * first), np.exp(1j * second), rtol=0, atol=atol)


def test_pointing_turns_the_x_axis_by_azimuth_then_elevation():
    azimuths, elevations = np.random.default_rng(3).uniform(-3, 3, (2, 50))
    turns = Rotation.from_euler("ZY", np.stack([azimuths, -elevations], axis=-1))
    result = pointing(azimuths, elevations)
    np.testing.assert_allclose(result, turns.apply([1.0, 0.0, 0.0]), rtol=0, atol=1e-15)


@pytest.mark.parametrize("terminals", COUNTS)
@pytest.mark.parametrize("instruments", [0, 3])
def test_boresights_are_turned_mount_yaw_and_pitch(terminals, instruments):
    device = craft(terminals, instruments)
    attitudes, joints = random_state(6, terminals)
    result = np.asarray(device.boresights(attitudes, joints))
    assert result.shape == (6, terminals + instruments, 3)
    assert len(device.device_names) == terminals + instruments
    for k, attitude in enumerate(attitudes):
        for i, terminal in enumerate(device.terminals):
            turn = Rotation.from_euler("ZY", [joints[k, i] + terminal.mount, -joints[k, terminals + i]])
            expected = attitude @ turn.apply([1.0, 0.0, 0.0])
            np.testing.assert_allclose(result[k, i], expected, rtol=0, atol=1e-14)
        for i, instrument in enumerate(device.instruments):
            np.testing.assert_allclose(result[k, terminals + i], attitude @ instrument.boresight, atol=1e-14)


@pytest.mark.parametrize("terminals", COUNTS)
def test_joints_toward_inverts_boresights(terminals):
    device = craft(terminals, instruments=2)
    attitudes, joints = random_state(20, terminals)
    for attitude, expected in zip(attitudes, joints, strict=True):
        directions = np.asarray(device.boresights(attitude, expected))[:terminals]
        result = np.asarray(device.joints_toward(attitude, directions))
        assert result.shape == (2 * terminals,)
        assert_each(result[:terminals], ">", -np.pi)
        assert_each(result[:terminals], "<=", np.pi)
        same_angle(result, expected, atol=1e-14)


def test_joints_toward_takes_a_batch_of_attitudes():
    device = craft(4)
    attitudes, _ = random_state(10, 4)
    directions = random_state(4, 0)[0][:, :, 0]
    joints = device.joints_toward(attitudes, directions)
    assert joints.shape == (10, 8)
    pointed = device.boresights(attitudes, joints)
    np.testing.assert_allclose(pointed, np.broadcast_to(directions, pointed.shape), rtol=0, atol=1e-14)


def test_wrap_keeps_the_angle_and_lands_in_the_half_open_turn():
    angles = np.concatenate([np.linspace(-40, 40, 4001), np.pi * np.arange(-9, 10), [np.nextafter(np.pi, 4)]])
    wrapped = np.asarray(gimbals.wrap(angles))
    assert_each(wrapped, ">", -np.pi)
    assert_each(wrapped, "<=", np.pi)
    same_angle(wrapped, angles, atol=1e-14)
    inside = (angles > -np.pi) & (angles <= np.pi)
    np.testing.assert_array_equal(wrapped[inside], angles[inside])
    assert gimbals.wrap(-np.pi) == np.pi


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_target_on_the_body_axis_gives_a_finite_answer_and_finite_derivatives(direction):
    frames = gimbals_about_z([0.0, 2.0]).frames

    def toward(targets):
        return array_module(targets).concatenate(gimbals.angles_toward(frames, np.eye(3), targets))

    targets = np.array([[0.0, 0.0, direction], AXIS])
    joints = np.asarray(toward(targets))
    np.testing.assert_array_equal(np.isfinite(joints), True)
    assert joints[2] == direction * np.pi / 2
    np.testing.assert_allclose(joints[3], np.arcsin(0.8), rtol=1e-15)
    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_array_equal(np.isfinite(mode(toward)(targets)), True)


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_pointing_at_a_moving_target_has_the_derivatives_of_azimuth_and_elevation(mode):
    frames, targets = gimbals_about_z([0.0]).frames, AXIS[None]
    jacobian = np.stack(mode(lambda z: gimbals.angles_toward(frames, np.eye(3), z))(targets))[:, 0, 0]
    # at azimuth 0: d yaw = dy / horizontal, d pitch = horizontal dz - z dx
    np.testing.assert_allclose(jacobian, [[0, 1 / 0.6, 0], [-0.8, 0, 0.6]], rtol=0, atol=1e-15)


def test_the_dtype_is_that_of_attitude_and_joints():
    device = craft(2, instruments=1)
    attitude, joints = np.eye(3, dtype=np.float32), np.zeros(4, np.float32)
    boresights = device.boresights(attitude, joints)
    assert boresights.dtype == np.float32
    assert device.joints_toward(attitude, boresights[:2]).dtype == np.float32


def test_integer_joints_leave_instruments_as_they_are():
    device = craft(1, instruments=2)
    result = device.boresights(np.eye(3), np.zeros(2, int))
    np.testing.assert_allclose(result[1:], device.fixed_boresights, rtol=0, atol=1e-15)


def test_limits_and_names_follow_the_order_of_the_joint_vector():
    device = craft(2, instruments=1)
    assert device.device_names == ("terminal-0", "terminal-1", "tracker-0")
    assert device.joint_names == ("terminal-0 yaw", "terminal-1 yaw", "terminal-0 pitch", "terminal-1 pitch")
    limits = np.array([1.0, 1.1, 0.2, 0.21])
    np.testing.assert_allclose(device.joint_ranges, np.stack([-limits, limits], axis=-1), rtol=1e-15)
    np.testing.assert_allclose(device.joint_rate_limits, [0.05, 0.051, 0.05, 0.051], rtol=1e-15)
    np.testing.assert_allclose(device.joint_acceleration_limits, [0.03, 0.031, 0.03, 0.031], rtol=1e-15)


def test_a_spacecraft_is_a_tree_of_its_numbers_that_keeps_its_names():
    device = craft(2, instruments=1)
    doubled = jax.tree.map(lambda leaf: 2 * leaf, device)
    assert doubled.device_names == device.device_names
    np.testing.assert_array_equal(doubled.joint_ranges, 2 * device.joint_ranges)
    np.testing.assert_array_equal(doubled.fixed_boresights, 2 * device.fixed_boresights)


@pytest.mark.paper
def test_published_goals_point_at_the_published_targets():
    targets = [[-0.5349, 0.8296, 0.1604], [0.4212, -0.9032, -0.0832], [0.4601, -0.7960, -0.3933]]
    mounted = gimbals_about_z(np.deg2rad([0.0, 120.0, -120.0]))
    goals = [  # rotation vector, yaws, pitches of cases 1 to 4
        ([0.4025, 1.3486, 1.4256], [0.6032, 1.5359, -0.2236, 0.0253, -0.1317, -0.1396]),
        ([1.9598, 1.2862, 1.8662], [-0.7386, 0.2610, -1.5359, -0.1394, -0.0092, 0.1396]),
        ([0.1547, -0.1803, 1.5131], [0.6137, 1.5359, -0.5119, -0.0080, 0.1017, -0.2269]),
        ([0.5993, 2.1165, 1.2377], [0.5054, 1.5359, -0.3006, 0.0717, -0.2269, -0.0151]),
    ]
    for vector, joints in goals:
        attitude = Rotation.from_rotvec(vector).as_matrix()
        body = mounted.boresights(np.array(joints))
        np.testing.assert_allclose(body @ attitude.T, targets, rtol=0, atol=1e-3)
        found = np.concatenate(gimbals.angles_toward(mounted.frames, attitude, np.array(targets)))
        np.testing.assert_allclose(found, joints, rtol=0, atol=1e-3)
