"""Joints that C-kernels and STK's folders give back, told from frames of devices with the spacecraft."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import make_observer
from exports import EPOCH, flown_plan
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.tables.devices import OtherDevicesError, joint_rates_of, joints_of

STEP = 0.5


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return flown_plan()


@pytest.fixture(scope="module")
def folder(plan, tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("frames")
    for name in ("ck", "stk"):
        jp.export(plan, place / name, format=name, epoch=EPOCH, step_s=STEP)
    return place


def moved(terminal: jp.Terminal, joints: np.ndarray) -> np.ndarray:
    """Frames (k, 3, 3) of a terminal mounted by a yaw axis and a boresight, by two turns of scipy's."""
    up, ahead = terminal.mounting.yaw_axis, terminal.mounting.boresight
    zero = np.stack([-up, np.cross(up, ahead), ahead], axis=1)
    yaw = Rotation.from_rotvec(joints[:, :1] * up)
    pitch = Rotation.from_rotvec(joints[:, 1:] * -np.cross(up, ahead))
    return (yaw * pitch).as_matrix() @ zero


@pytest.mark.parametrize("name", ["ck", "stk"])
def test_joints_are_those_of_the_plan(plan, folder, name):
    pytest.importorskip("spiceypy" if name == "ck" else "numpy")
    craft = plan.scenario.spacecraft
    table = jp.load_attitude(folder / name, craft)
    expected = plan.trajectory.sample(STEP * np.arange(61))
    assert table.joint_names == craft.joint_names
    np.testing.assert_allclose(table.joints, expected.joints, rtol=0, atol=1e-9)
    if name == "ck":
        np.testing.assert_allclose(table.joint_rates, expected.joint_rates, rtol=0, atol=1e-9)
    else:
        assert table.joint_rates is None
    assert jp.load_attitude(folder / name).joints is None  # how devices are mounted is not in the files
    proof = jp.certify_table(folder / name, None, plan.scenario)
    assert {"joint_rates", "yaw", "pitch"} <= set(proof.peaks)
    assert not any("no joints" in each for each in proof.left_out)


def test_any_mount_drives_and_elevations_beyond_the_pole_give_their_angles():
    craft = make_observer()  # a terminal and a drive
    terminal, drive = craft.terminals[0], craft.drives[0]
    steps = np.linspace(0.0, 1.0, 60)
    yaw = np.linspace(-2.0, 2.5, 60)
    pitch = np.linspace(-1.5, 1.57, 60)
    turned = np.linspace(-1.5, 3.0, 60)
    axis = np.asarray(drive.axis, float)
    ahead = drive.boresight - axis * (axis @ drive.boresight)
    left = np.cross(axis, ahead / np.linalg.norm(ahead))
    zero = np.stack([np.cross(drive.boresight, left) * -1.0, left, drive.boresight], axis=1)
    zero[:, 0] = np.cross(zero[:, 1], zero[:, 2])
    of_drive = Rotation.from_rotvec(turned[:, None] * axis).as_matrix() @ zero
    frames = [moved(terminal, np.stack([yaw, pitch], axis=1)), of_drive]
    found = joints_of(frames, craft, "here")
    middle = np.mean(craft.joint_ranges, axis=1)
    for column, angles in enumerate((yaw, pitch, turned)):
        turns = 2 * np.pi * np.round((middle[column] - (angles[0] + angles[-1]) / 2) / (2 * np.pi))
        np.testing.assert_allclose(found[:, column], angles + turns, atol=1e-9)
    slope = np.diff(steps)[0]
    rates = np.stack([np.gradient(angles, steps) for angles in (yaw, pitch, turned)], axis=1)
    spins = []
    for each in frames:
        between = Rotation.from_matrix(each[1:] @ np.swapaxes(each[:-1], 1, 2)).as_rotvec() / slope
        spins.append(np.concatenate([between, between[-1:]]))
    told = joint_rates_of(spins, found, craft)
    np.testing.assert_allclose(told[:, 2], rates[:, 2], rtol=1e-9)  # about one axis
    np.testing.assert_allclose(told[:, 0], rates[:, 0], rtol=0.02)  # a difference is at the middle
    np.testing.assert_allclose(told[:, 1], rates[:, 1], rtol=0.02)


def test_whole_turns_come_nearest_to_the_middle_of_the_range():
    craft = make_observer()
    wide = replace(
        craft.terminals[0],
        yaw_limit=None,
        yaw_range=np.deg2rad([100.0, 500.0]),
        pitch_limit=None,
        pitch_range=np.deg2rad([0.0, 80.0]),
    )
    craft = replace(craft, terminals=(wide,), drives=())
    yaw = np.deg2rad(np.linspace(150.0, 480.0, 100))  # through 360 deg
    frames = moved(wide, np.stack([yaw, np.full(100, 0.5)], axis=1))
    np.testing.assert_allclose(joints_of([frames], craft, "here")[:, 0], yaw, atol=1e-9)


def test_frames_of_another_spacecraft_are_refused_and_left_out_of_the_proof(plan, folder, tmp_path):
    craft = plan.scenario.spacecraft
    other = replace(
        craft,
        terminals=tuple(
            replace(each, mount=None, mounting=jp.Mount(yaw_axis=np.eye(3)[0], boresight=np.eye(3)[1]))
            for each in craft.terminals
        ),
    )
    with pytest.raises(
        OtherDevicesError, match=r"platform.a: row 0: the frame of terminal-0 is .* deg off all"
    ):
        jp.load_attitude(folder / "stk", other)
    scene = replace(plan.scenario, spacecraft=other)
    proof = jp.certify_table(folder / "stk", None, scene)
    assert any("mounted otherwise" in each for each in proof.left_out)
    assert any("no joints" in each for each in proof.left_out)
    broken = tmp_path / "stk"
    shutil.copytree(folder / "stk", broken)
    sensor = broken / "terminal-1.sp"
    text = sensor.read_text()
    order = "InterpolationOrder 1"
    for change, said in (
        (text.replace(order, f"{order}\nCoordinateAxes J2000"), "CoordinateAxes J2000"),
        ("\n".join(line for number, line in enumerate(text.splitlines()) if number != 9), "other times than"),
        (None, "and no terminal-1.sp"),
    ):
        if change is None:
            sensor.unlink()
        else:
            sensor.write_text(change)
        with pytest.raises(ValueError, match=said):
            jp.load_attitude(broken, craft)
    with pytest.raises(TypeError, match="spacecraft must be a Spacecraft"):
        jp.load_attitude(folder / "stk", plan.scenario)


def test_kernels_without_devices_are_of_the_platform_alone(plan, folder, tmp_path):
    spice = pytest.importorskip("spiceypy")
    craft = plan.scenario.spacecraft
    more = replace(craft, terminals=(*craft.terminals, replace(craft.terminals[0], name="third")))
    with pytest.raises(
        OtherDevicesError, match="has 2 of 3 devices with joints upon -999000, and no -999003"
    ):
        jp.load_attitude(folder / "ck", more)
    bare = tmp_path / "bare.bc"
    spice.furnsh(str(folder / "ck" / "clock.tsc"))
    handle = spice.ckopn(str(bare), "test", 0)
    clock = spice.sce2c(-999, 0.0) + 1e6 * np.arange(2.0)
    still = np.tile([1.0, 0, 0, 0], (2, 1))
    spice.ckw03(
        handle, *clock, -999000, "J2000", True, "bus", 2, clock, still, np.zeros((2, 3)), 1, clock[:1]
    )
    spice.ckcls(handle)
    spice.kclear()
    shutil.copy(folder / "ck" / "clock.tsc", tmp_path)
    table = jp.load_attitude(bare, craft)
    assert table.joints is None
    assert table.joint_names == ()
