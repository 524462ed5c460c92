"""Gimbals: devices turn about the axes that they are mounted by, and angles toward directions undo that."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import make_observer
from oblique import oblique_craft
from reference import assert_each, direction, random_units, unit
from scipy.spatial.transform import Rotation

from jaxplan.model import gimbals
from jaxplan.model.devices import NEAREST_TO_POLE, Mount
from jaxplan.model.gimbals import angles_along, angles_toward, in_range

COUNTS = [(1, 0), (0, 1), (0, 3), (2, 0), (2, 1), (4, 2)]  # terminals and drives
counts = pytest.mark.parametrize(("terminals", "drives"), COUNTS)
TURN = 2 * np.pi


def turned(craft, joints):
    """(g, 3) body axes, of one joint vector: each device turned about its axes by scipy."""
    count, found = len(craft.terminals), []
    for number, terminal in enumerate(craft.terminals):
        up, ahead = np.array(terminal.mounting.yaw_axis), np.array(terminal.mounting.boresight)
        lift = Rotation.from_rotvec(-joints[count + number] * np.cross(up, ahead))
        found.append((Rotation.from_rotvec(joints[number] * up) * lift).apply(ahead))
    for number, drive in enumerate(craft.drives):
        turn = Rotation.from_rotvec(joints[2 * count + number] * np.array(drive.axis))
        found.append(turn.apply(drive.boresight))
    return np.reshape(found, (-1, 3))


def random_joints(rng, craft, count):
    """(count, J) rad: yaws and drives anywhere, pitches off the poles."""
    joints = rng.uniform(-7, 7, (count, craft.joint_count))
    pitches = slice(len(craft.terminals), 2 * len(craft.terminals))
    joints[:, pitches] *= 1.5 / 7
    return joints


@counts
def test_devices_are_turned_about_the_axes_they_are_mounted_by(terminals, drives):
    craft = oblique_craft(terminals, drives, instruments=2)
    rng = np.random.default_rng(3)
    joints, attitudes = random_joints(rng, craft, 30), Rotation.random(30, rng=rng).as_matrix()
    expected = np.stack([turned(craft, own) for own in joints])
    np.testing.assert_allclose(craft.gimbals.boresights(joints), expected, rtol=0, atol=3e-15)
    fixed = np.stack([instrument.boresight for instrument in craft.instruments])
    every = np.concatenate([expected, np.broadcast_to(fixed, (30, 2, 3))], axis=1)
    inertial = np.einsum("kij,kdj->kdi", attitudes, every)
    np.testing.assert_allclose(craft.boresights(attitudes, joints), inertial, rtol=0, atol=4e-15)


def test_frames_are_right_handed_with_the_boresight_first_and_the_axis_last():
    craft = oblique_craft(3, 2)
    frames = craft.gimbals.frames
    np.testing.assert_allclose(np.linalg.det(frames), 1, rtol=1e-14)
    mountings = [terminal.mounting for terminal in craft.terminals]
    np.testing.assert_allclose(frames[:3, :, 0], [one.boresight for one in mountings], rtol=0, atol=3e-16)
    axes = [one.yaw_axis for one in mountings] + [drive.axis for drive in craft.drives]
    np.testing.assert_allclose(frames[:, :, 2], axes, rtol=0, atol=3e-16)
    tilts = [np.pi / 2 - np.arccos(np.dot(drive.axis, drive.boresight)) for drive in craft.drives]
    np.testing.assert_allclose(craft.gimbals.tilts, tilts, rtol=0, atol=1e-14)


def test_an_angle_about_z_is_a_mounting_like_any_other():
    craft = oblique_craft(3)
    for angle in (0.0, 0.7, -2.0, 40.0):
        by_angle = replace(craft.terminals[0], mount=angle, mounting=None)
        mounting = Mount(yaw_axis=np.array([0.0, 0.0, 1.0]), boresight=direction(angle))
        by_axes = replace(craft.terminals[0], mounting=mounting)
        np.testing.assert_allclose(by_angle.frame, by_axes.frame, rtol=0, atol=1e-15)


@pytest.mark.parametrize("size", [1.0, 3.0])
def test_mountings_may_have_any_length_and_derivatives_run_across_them(size):
    craft = oblique_craft(1, 1)
    rng = np.random.default_rng(6)
    terminal, drive = craft.terminals[0], craft.drives[0]
    joints = np.array([0.7, -0.4, 1.9])

    def seen(changes):
        mounting = Mount(
            yaw_axis=size * (terminal.mounting.yaw_axis + changes[0]),
            boresight=size * (terminal.mounting.boresight + changes[1]),
        )
        drives = (replace(drive, axis=drive.axis + changes[2], boresight=drive.boresight + changes[3]),)
        turned = replace(craft, terminals=(replace(terminal, mounting=mounting),), drives=drives)
        return turned.gimbals.boresights(joints)

    np.testing.assert_allclose(seen(np.zeros((4, 3))), craft.gimbals.boresights(joints), atol=1e-15)
    way, step = rng.normal(size=(4, 3)), 1e-5
    _, slope = jax.jvp(seen, (jnp.zeros((4, 3)),), (jnp.asarray(way),))
    np.testing.assert_allclose(slope, (seen(step * way) - seen(-step * way)) / (2 * step), atol=1e-9)


@counts
def test_angles_along_undo_boresights(terminals, drives):
    craft = oblique_craft(terminals, drives)
    joints = random_joints(np.random.default_rng(4), craft, 50)
    azimuth, elevation = angles_along(craft.gimbals.frames, craft.gimbals.boresights(joints))
    wanted, lifted = craft.gimbals.angles(joints)
    np.testing.assert_allclose(np.exp(1j * azimuth), np.exp(1j * wanted), rtol=0, atol=2e-14)
    np.testing.assert_allclose(elevation, lifted, rtol=0, atol=1e-14)
    assert_each(np.abs(azimuth), "<=", np.pi)
    attitudes = Rotation.random(50, rng=np.random.default_rng(5)).as_matrix()
    directions = np.asarray(craft.boresights(attitudes, joints))
    for number, attitude in enumerate(attitudes):
        found = angles_toward(craft.gimbals.frames, attitude, directions[number])
        np.testing.assert_allclose(found, [azimuth[number], elevation[number]], rtol=0, atol=1e-13)


def test_joints_toward_leaves_out_drives():
    craft = oblique_craft(2, 2)
    joints = random_joints(np.random.default_rng(8), craft, 1)[0]
    attitude = Rotation.random(rng=np.random.default_rng(9)).as_matrix()
    directions = np.asarray(craft.boresights(attitude, joints))[:2]
    found = craft.joints_toward(attitude, directions)
    assert found.shape == (4,)
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * joints[:4]), rtol=0, atol=1e-13)


def test_the_joint_vector_is_yaws_pitches_and_drives():
    craft = make_observer()
    assert craft.device_names == ("antenna", "array", "telescope", "tracker-1", "tracker-2")
    assert craft.joint_names == ("antenna yaw", "antenna pitch", "array angle")
    ranges = [[-150, 290], [-5, 85], [-120, 200]]
    np.testing.assert_allclose(craft.joint_ranges, np.deg2rad(ranges), rtol=1e-15)
    np.testing.assert_allclose(craft.joint_rate_limits, np.deg2rad([4, 2, 1.2]), rtol=1e-15)
    np.testing.assert_allclose(craft.joint_acceleration_limits, np.deg2rad([1.5, 1.0, 0.4]), rtol=1e-15)
    np.testing.assert_allclose(craft.gimbals.tilts, np.deg2rad([10.0]), rtol=1e-14)
    of_four = oblique_craft(4, 2).gimbals
    assert (of_four.count, of_four.terminals, of_four.joint_count) == (6, 4, 10)
    np.testing.assert_array_equal(of_four.yaws, [0, 1, 2, 3, 8, 9])
    np.testing.assert_array_equal(of_four.pitches, [4, 5, 6, 7])
    turning, lifting = of_four.parts(np.arange(10.0))
    np.testing.assert_array_equal(turning, [0, 1, 2, 3, 8, 9])
    np.testing.assert_array_equal(lifting, [4, 5, 6, 7, 0, 0])


@counts
def test_axes_of_joints_turn_what_they_carry(terminals, drives):
    craft = oblique_craft(terminals, drives)
    rng, step = np.random.default_rng(10), 1e-5
    for joints in random_joints(rng, craft, 4):
        azimuth, _ = craft.gimbals.angles(joints)
        up, across = craft.gimbals.axes(azimuth, np.arange(craft.gimbals.count))
        seen = craft.gimbals.boresights(joints)
        for joint, change in enumerate(step * np.eye(craft.joint_count)):
            ends = craft.gimbals.boresights(joints + change), craft.gimbals.boresights(joints - change)
            expected = np.zeros_like(seen)
            if joint in craft.gimbals.pitches:
                device = joint - terminals
                expected[device] = np.cross(across[device], seen[device])
            else:
                device = joint if joint < terminals else joint - terminals
                expected[device] = np.cross(up[device], seen[device])
            np.testing.assert_allclose((ends[0] - ends[1]) / (2 * step), expected, rtol=0, atol=1e-9)


def by_trial(angle, low, high, near):
    """The turn of an angle in a range that is nearest to another; else the one nearest to the range."""
    every = angle + TURN * np.arange(-12, 13)
    inside = every[(every >= low) & (every <= high)]
    if len(inside):
        return inside[np.argmin(np.abs(inside - near))]
    return every[np.argmin(np.maximum(low - every, every - high))]


@pytest.mark.parametrize("widest", [0.5, 3.0, 7.0, 20.0])
def test_angles_are_brought_into_ranges_by_the_turn_that_is_nearest(widest):
    rng = np.random.default_rng(11)
    low = rng.uniform(-9, 9, 400)
    ranges = np.stack([low, low + rng.uniform(0.01, widest, 400)], axis=-1)
    angle, near = rng.uniform(-15, 15, (2, 400))
    expected = [by_trial(*row) for row in zip(angle, *ranges.T, near, strict=True)]
    np.testing.assert_allclose(in_range(angle, ranges, near), expected, rtol=0, atol=1e-13)
    middle = in_range(angle, ranges)
    expected = [by_trial(*row) for row in zip(angle, *ranges.T, ranges.mean(axis=1), strict=True)]
    np.testing.assert_allclose(middle, expected, rtol=0, atol=1e-13)
    inside = (middle >= ranges[:, 0]) & (middle <= ranges[:, 1])
    assert np.any(inside)
    assert widest > TURN or np.any(~inside)


def test_an_angle_keeps_its_derivative_whatever_turn_is_taken():
    ranges, near = np.deg2rad([[-150.0, 290.0]] * 3), np.deg2rad([200.0, 280.0, -140.0])
    angles = jnp.deg2rad(jnp.array([-170.0, -75.0, 250.0]))
    found = in_range(angles, ranges, near)
    np.testing.assert_allclose(np.rad2deg(found), [190.0, 285.0, -110.0], rtol=1e-13)
    slope = jax.jacfwd(lambda a: in_range(a, ranges, near))(angles)
    np.testing.assert_array_equal(slope, np.eye(3))


def test_pitches_stay_off_the_poles_whatever_their_range_says():
    terminal = oblique_craft(1).terminals[0]
    for given in ({"pitch_range": np.deg2rad([-90.0, 90.0])}, {"pitch_range": None, "pitch_limit": 1.5708}):
        own = replace(terminal, **given).ranges
        np.testing.assert_allclose(own[1], [NEAREST_TO_POLE - np.pi / 2, np.pi / 2 - NEAREST_TO_POLE])
        np.testing.assert_array_equal(own[0], terminal.yaw_range)
    low = replace(terminal, pitch_range=np.deg2rad([20.0, 89.9])).ranges
    np.testing.assert_allclose(low[1], np.deg2rad([20.0, 89.9]), rtol=1e-15)


def test_joints_without_limits_of_their_own_share_the_terminals():
    terminal = replace(oblique_craft(1).terminals[0], rate_limit=0.3, acceleration_limit=0.2)
    assert replace(terminal, yaw_rate_limit=None).rate_limits == (0.3, terminal.pitch_rate_limit)
    own = replace(terminal, pitch_acceleration_limit=None).acceleration_limits
    assert own == (terminal.yaw_acceleration_limit, 0.2)


@pytest.mark.parametrize("module", [np, jnp])
def test_single_precision_stays_so(module):
    craft = oblique_craft(2, 1)
    joints = module.asarray(random_joints(np.random.default_rng(1), craft, 3), np.float32)
    assert craft.gimbals.boresights(joints).dtype == np.float32
    assert all(part.dtype == np.float32 for part in craft.gimbals.angles(joints))
    seen = craft.gimbals.boresights(joints)
    assert all(part.dtype == np.float32 for part in angles_along(craft.gimbals.frames, seen))


def test_without_joints_there_are_no_gimbals():
    craft = oblique_craft(0, 0, instruments=2)
    assert craft.gimbals.count == 0
    assert craft.gimbals.boresights(np.zeros((5, 0))).shape == (5, 0, 3)
    assert craft.boresights(np.eye(3), np.zeros(0)).shape == (2, 3)


def test_a_frame_needs_no_right_angle():
    axis, tilted = random_units(np.random.default_rng(12), 2)
    frame = gimbals.frame_of(axis, tilted)
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), rtol=0, atol=1e-15)
    np.testing.assert_allclose(frame[:, 0], unit(tilted - (tilted @ axis) * axis), rtol=0, atol=1e-15)
