"""Every exported file as other programs read it, against the motion by scipy and by differences."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import make_plan, make_scenario
from exports import DURATION, EPOCH, differences, flown_plan, truth
from reference import assert_each
from scipy.spatial.transform import Rotation
from wheels import by_pseudo_inverse, exchanged, random_wheels, with_wheels

import jaxplan as jp
from jaxplan.exporting import FORMATS

STEP = 0.05
TIMES = STEP * np.arange(601)


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return flown_plan()


@pytest.fixture(scope="module")
def resting() -> jp.Plan:
    """A plan that ends where it starts."""
    scenario = make_scenario(2, 1)
    return jp.plan(replace(scenario, goal=scenario.start))


@pytest.fixture(scope="module")
def folder(plan, tmp_path_factory) -> Path:
    """The plan in every format, each under its name."""
    place = tmp_path_factory.mktemp("exports")
    for name, kind in FORMATS.items():
        if not kind.needs and not kind.exact:  # the others need an extra
            jp.export(plan, place / name, format=name, epoch=EPOCH, step_s=STEP)
    return place


def matrices(quaternions: np.ndarray, scalar_first: bool) -> np.ndarray:
    """Attitudes of a file, whose quaternions have unit length and do not jump."""
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1, atol=1e-14)
    assert_each(np.sum(quaternions[1:] * quaternions[:-1], axis=1), ">", 0.9)
    return Rotation.from_quat(quaternions, scalar_first=scalar_first).as_matrix()


def read_aem(path: Path) -> tuple[object, np.ndarray, np.ndarray]:
    """Metadata, times after the start and the seven columns, by ccsds-ndm-py."""
    ccsds_ndm = pytest.importorskip("ccsds_ndm", reason="ccsds-ndm-py is not installed")
    (segment,) = ccsds_ndm.Aem.from_file(str(path)).segments
    stamps = np.array(segment.data.attitude_states_epochs, "datetime64[ns]")
    times = (stamps - np.datetime64(segment.metadata.start_time, "ns")) / np.timedelta64(1, "s")
    return segment.metadata, times, segment.data.attitude_states_numpy


def test_an_attitude_message_reads_back_in_ccsds_ndm(plan, folder):
    metadata, times, states = read_aem(folder / "aem")
    assert (metadata.ref_frame_a, metadata.ref_frame_b) == ("EME2000", metadata.angvel_frame)
    assert (metadata.time_system, metadata.attitude_type) == ("UTC", "QUATERNION/ANGVEL")
    assert metadata.start_time == "2026-03-01T06:30:15.250000000"
    np.testing.assert_allclose(times, TIMES, atol=1e-9)
    expected = truth(plan, TIMES)
    attitude = matrices(states[:, :4], scalar_first=False)
    np.testing.assert_allclose(attitude, expected.attitude, atol=1e-9)
    np.testing.assert_allclose(np.deg2rad(states[:, 4:]), expected.rate, atol=1e-9)
    np.testing.assert_allclose(np.deg2rad(states[1:-1, 4:]), differences(attitude, STEP), atol=1e-3)


def read_stk(path: Path, kind: str) -> tuple[object, np.ndarray, np.ndarray]:
    """Header, times and quaternions by stk-files, which must be told the form of times and epoch."""
    stk_files = pytest.importorskip("stk_files", reason="stk-files is not installed")
    text = path.read_text()
    assert "ScenarioEpoch 1 Mar 2026 06:30:15.250000\n" in text
    epoch = "TimeFormat EpSec\nScenarioEpoch 2026-03-01T06:30:15.250\n"
    lines = text.replace("ScenarioEpoch 1 Mar 2026 06:30:15.250000\n", epoch).splitlines(keepends=True)
    header, stamps, data = getattr(stk_files, f"read_{kind}")(iter(lines))
    return header, (stamps - np.datetime64("2026-03-01T06:30:15.250")) / np.timedelta64(1, "s"), data


def test_stk_files_read_back_in_stk_files(plan, folder):
    expected = truth(plan, TIMES)
    header, times, quaternions = read_stk(folder / "stk" / "platform.a", "attitude")
    assert (header.format, header.coordinate_axes, header.central_body) == ("Quaternions", "J2000", "Earth")
    np.testing.assert_allclose(times, TIMES, atol=1e-9)
    attitude = matrices(quaternions, scalar_first=False)
    np.testing.assert_allclose(attitude, expected.attitude, atol=1e-9)
    np.testing.assert_allclose(differences(attitude, STEP), expected.rate[1:-1], atol=1e-3)
    assert {file.name for file in (folder / "stk").iterdir()} == {
        "platform.a",
        "terminal-0.sp",
        "terminal-1.sp",
    }
    for number in range(2):
        header, times, quaternions = read_stk(folder / "stk" / f"terminal-{number}.sp", "sensor")
        assert header.coordinate_axes is None  # the parent's body axes
        sensor = matrices(quaternions, scalar_first=False)
        np.testing.assert_allclose((attitude @ sensor)[:, :, 2], expected.boresights[:, number], atol=1e-9)


def test_basilisk_waypoints_have_inertial_rates_and_accelerations(plan, folder):
    table = np.loadtxt(folder / "basilisk", delimiter=",")
    assert table.shape == (601, 11)
    expected = truth(plan, TIMES)
    np.testing.assert_allclose(table[:, 0], TIMES, atol=1e-12)
    attitude = matrices(table[:, 1:5], scalar_first=True)
    np.testing.assert_allclose(attitude, expected.attitude, atol=1e-9)
    inertial = np.einsum("kij,kj->ki", expected.attitude, expected.rate)
    np.testing.assert_allclose(table[:, 5:8], inertial, atol=1e-9)
    slopes = (table[2:, 5:8] - table[:-2, 5:8]) / (2 * STEP)
    np.testing.assert_allclose(table[1:-1, 8:], slopes, atol=5e-3)  # the jerk jumps at breaks
    np.testing.assert_allclose(
        table[:, 8:], np.einsum("kij,kj->ki", expected.attitude, expected.acceleration), atol=1e-7
    )


def named(folder: Path) -> dict[str, dict[str, np.ndarray]]:
    """Columns by name, of the CSV by the standard library, of the NPZ by numpy."""
    with (folder / "csv").open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    table = dict(zip(header, zip(*rows, strict=True), strict=True))
    texts = {"utc": np.array(table.pop("utc"))}
    with np.load(folder / "npz", allow_pickle=False) as arrays:
        return {"csv": {k: np.array(v, float) for k, v in table.items()} | texts, "npz": dict(arrays)}


def test_plain_tables_hold_every_column_under_its_name(plan, folder):
    tables = named(folder)
    expected = truth(plan, TIMES)
    wide, stacked = tables["csv"], tables["npz"]
    assert not [name for name in [*wide, *stacked] if " " in name]
    for name, axes in {
        "quaternion": ["quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z"],
        "angular_velocity_rad_s": [f"angular_velocity_{axis}_rad_s" for axis in "xyz"],
        "angular_acceleration_rad_s2": [f"angular_acceleration_{axis}_rad_s2" for axis in "xyz"],
    }.items():
        np.testing.assert_array_equal(stacked.pop(name), np.stack([wide[axis] for axis in axes], axis=1))
    assert np.datetime64(str(stacked.pop("epoch_utc"))) == np.datetime64(EPOCH)
    for name, column in stacked.items():
        np.testing.assert_array_equal(column, wide[name], err_msg=name)
    assert wide["utc"][2] == "2026-03-01T06:30:15.350000000"
    np.testing.assert_allclose(wide["time_s"], TIMES, rtol=0, atol=0)
    quaternions = np.stack([wide[f"quaternion_{axis}"] for axis in "wxyz"], axis=1)
    np.testing.assert_allclose(matrices(quaternions, scalar_first=True), expected.attitude, atol=1e-9)
    for axis, rate, acceleration in zip("xyz", expected.rate.T, expected.acceleration.T, strict=True):
        np.testing.assert_allclose(wide[f"angular_velocity_{axis}_rad_s"], rate, atol=1e-9)
        np.testing.assert_allclose(wide[f"angular_acceleration_{axis}_rad_s2"], acceleration, atol=1e-7)
    columns = ["terminal-0_yaw", "terminal-1_yaw", "terminal-0_pitch", "terminal-1_pitch"]
    for number, column in enumerate(columns):
        for order, unit in enumerate(["_rad", "_rate_rad_s", "_acceleration_rad_s2"]):
            np.testing.assert_allclose(wide[column + unit], expected.joints[order, :, number], atol=1e-12)


@pytest.mark.parametrize("name", ["aem", "stk", "basilisk", "csv", "npz"])
@pytest.mark.parametrize("rows", [{"step_s": 0.5}, {"tolerance_deg": 0.01}, {"step_s": "sparsest"}])
def test_a_manoeuvre_that_takes_no_time_is_a_second_at_rest(resting, tmp_path, name, rows):
    assert resting.trajectory.duration == 0
    place = jp.export(resting, tmp_path / "at-rest", format=name, epoch=EPOCH, **rows)
    attitude = resting.goal.attitude
    if name == "aem":
        _, times, states = read_aem(place)
        quaternions, first = states[:, :4], False
    elif name == "stk":
        _, times, quaternions = read_stk(place / "platform.a", "attitude")
        first = False
    elif name == "npz":
        with np.load(place) as arrays:
            times, quaternions, first = arrays["time_s"], arrays["quaternion"], True
    else:
        table = np.genfromtxt(place, delimiter=",", skip_header=name == "csv", usecols=range(5), ndmin=2)
        times, quaternions, first = table[:, 0], table[:, 1:], True
    assert times.tolist() == ([0, 0.5, 1] if rows == {"step_s": 0.5} else [0, 1])
    found = matrices(quaternions, scalar_first=first)
    np.testing.assert_allclose(found, np.broadcast_to(attitude, found.shape), atol=1e-9)
    proof = jp.certify_table(place / "platform.a" if name == "stk" else place, None, resting.scenario)
    assert proof.certified
    assert proof.rows_count == len(times)
    assert not proof.misses_goal
    np.testing.assert_allclose([proof.peaks["angular_velocity"], proof.rate_jump], 0, atol=1e-12)


def test_a_hundred_thousand_samples_are_written_and_read(plan, tmp_path):
    step = DURATION / 1e5
    jp.export(plan, tmp_path / "long.aem", format="aem", epoch=EPOCH, step_s=step)
    _, times, states = read_aem(tmp_path / "long.aem")
    assert times.shape == (100_001,)
    assert_each(np.diff(times), ">", 0)
    picked = np.linspace(0, 100_000, 50).astype(int)
    attitude = matrices(states[:, :4], scalar_first=False)[picked]
    np.testing.assert_allclose(attitude, truth(plan, step * picked).attitude, atol=1e-9)


def test_tables_have_what_each_wheel_gives_and_holds(tmp_path):
    array = [
        replace(one, torque=9 * one.torque, momentum=9 * one.momentum) for one in random_wheels(4, seed=1)
    ]
    for allocation in ("pseudo_inverse", "minimax"):
        own = with_wheels(array, allocation).spacecraft
        made = make_plan(1, craft=own)
        place = jp.export(made, tmp_path / f"{allocation}.csv", format="csv", step_s=0.5)
        table = np.genfromtxt(place, delimiter=",", names=True, deletechars="")
        time = np.minimum(table["time_s"], made.trajectory.duration)
        axes = np.array([wheel.axis for wheel in own.wheels])
        for name, vectors, shares in zip(
            ("torque_Nm", "momentum_Nms"),
            exchanged(made.trajectory, own, time),
            by_pseudo_inverse(made.trajectory, own, time),
            strict=True,
        ):
            each = np.stack([table[f"{wheel.name}_{name}"] for wheel in own.wheels], axis=1)
            np.testing.assert_allclose(each @ axes, vectors, atol=1e-9)
            if allocation == "pseudo_inverse":
                limit = [wheel.torque if name == "torque_Nm" else wheel.momentum for wheel in own.wheels]
                np.testing.assert_allclose(each, shares * limit, atol=1e-9)


@pytest.mark.parametrize("name", ["csv", "npz"])
def test_devices_that_would_share_a_column_are_refused(plan, tmp_path, name):
    craft = plan.scenario.spacecraft
    terminals = tuple(map(replace, craft.terminals))
    twins = tuple(replace(one, name=own) for one, own in zip(terminals, ("a b", "a_b"), strict=True))
    alike = replace(plan, scenario=replace(plan.scenario, spacecraft=replace(craft, terminals=twins)))
    with pytest.raises(ValueError, match="two columns would be called a_b_yaw_rad"):
        jp.export(alike, tmp_path / "table", format=name, step_s=STEP)
    assert not list(tmp_path.iterdir())


def test_tables_without_an_epoch_have_no_calendar(plan, tmp_path):
    place = jp.export(plan, tmp_path / "plan.csv", format="csv", step_s=0.2)
    assert "utc" not in place.read_text().splitlines()[0]
    place = jp.export(plan, tmp_path / "plan.npz", format="npz", step_s=0.2)
    with np.load(place, allow_pickle=False) as arrays:
        assert str(arrays["epoch_utc"]) == ""
