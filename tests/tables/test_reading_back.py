"""Files that were written, read back: the same rows, and everything that is no table refused by name."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from exports import EPOCH, flown_plan, truth
from reference import assert_each
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.tables.table import as_known

STEP = 0.5
WRITTEN = ("aem", "ck", "stk", "basilisk", "csv", "npz")


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return flown_plan()


@pytest.fixture(scope="module")
def folder(plan, tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("tables")
    for name in WRITTEN:
        jp.export(plan, place / name, format=name, epoch=EPOCH, step_s=STEP)
    return place


@pytest.mark.parametrize("name", WRITTEN)
def test_a_file_reads_back_with_the_rows_of_the_motion(plan, folder, name):
    pytest.importorskip({"aem": "ccsds_ndm", "ck": "spiceypy"}.get(name, "numpy"))
    table = jp.load_attitude(folder / name)
    expected = truth(plan, STEP * np.arange(61))
    start = np.datetime64(EPOCH, "ns") if table.epoch is not None else None
    late = 0.0 if start is None else float((table.epoch - start) / np.timedelta64(1, "ns")) * 1e-9
    # ephemeris times of today have digits of 1e-7 s
    assert_each(np.abs(table.times + late - STEP * np.arange(61)), "<", 2e-6 if name == "ck" else 1e-9)
    np.testing.assert_allclose(table.attitudes, expected.attitude, atol=1e-8)
    if name != "stk":
        np.testing.assert_allclose(table.angular_velocity, expected.rate, atol=1e-9)
    assert (table.epoch is None) == (name == "basilisk")
    assert (table.joints is not None) == (name in ("csv", "npz"))


def test_columns_of_earlier_versions_with_blanks_are_read_as_the_same_joints(plan, folder, tmp_path):
    fresh, old = folder / "csv", tmp_path / "old.csv"
    head, rows = fresh.read_text().split("\n", 1)
    assert "terminal-0_yaw_rate_rad_s" in head
    for joint in ("yaw", "pitch"):
        head = head.replace(f"_{joint}_", f" {joint}_")
    old.write_text(f"{head}\n{rows}")
    known = [as_known(jp.load_attitude(path), plan.scenario)[0] for path in (fresh, old)]
    assert known[0].joint_names == known[1].joint_names == plan.scenario.spacecraft.joint_names
    np.testing.assert_array_equal(known[0].joints, known[1].joints)
    np.testing.assert_array_equal(known[0].joint_rates, known[1].joint_rates)


def test_a_row_is_the_start_of_a_scene(plan, folder):
    craft, end = plan.scenario.spacecraft, truth(plan, np.array([30.0]))
    for name in ("csv", "npz", "ck"):
        table = jp.load_attitude(folder / name, craft)
        state = table.state(-1)
        np.testing.assert_allclose(state.attitude, end.attitude[0], atol=1e-8, err_msg=name)
        # yaws first, then pitches, whatever the order of the file's columns is
        np.testing.assert_allclose(state.joints, end.joints[0, 0], atol=1e-8, err_msg=name)
    table = jp.load_attitude(folder / "csv")
    with pytest.raises(ValueError, match=r"terminal-0_yaw, terminal-0_pitch, .* read it with the spacecraft"):
        table.state(-1)
    assert len(np.unique(np.round(end.joints[0, 0], 3))) == 4
    bare = jp.load_attitude(folder / "basilisk")
    np.testing.assert_array_equal(bare.state(0, joints=[0.1, 0.2]).joints, [0.1, 0.2])
    for call, words in (
        (lambda: table.state(61), r"row = 61: must be a whole number in \[-61, 60\]"),
        (lambda: table.state(1.5), r"row = 1\.5: must be a whole number in"),
        (lambda: table.state(None), "row = None: must be a whole number in"),
        (lambda: table.state(True), "row = True: must be a whole number in"),
        (lambda: bare.state(0, joints="up"), "joints = 'up': must be a vector of angles in rad"),
        (lambda: table.state(0, joints=[0.0]), "has joints of its own"),
    ):
        with pytest.raises(ValueError, match=words):
            call()


@pytest.mark.parametrize(
    ("written", "change", "told"),
    [
        ("csv", lambda text: text.replace("quaternion_w", "q0"), "must be a CCSDS AEM"),
        ("csv", lambda text: text.replace("time_s", "t"), "must be a CCSDS AEM"),
        ("csv", lambda text: text.replace("quaternion_z", "q3"), "has no quaternion_w to quaternion_z"),
        ("csv", lambda text: _cell(text, 5, 1, "nan"), "quaternions is not finite in row 4"),
        ("csv", lambda text: _cell(text, 5, 1, "x"), "column quaternion_w: could not convert"),
        ("csv", lambda text: _cell(text, 5, 0, "0.1"), "times: must rise"),
        ("csv", lambda text: _cell(text, 5, 1, "0.99999"), "has the length"),
        ("csv", lambda text: text + "1,2\n", "has not"),
        ("csv", lambda text: "\n".join(text.splitlines()[:2]), "has 1 row: must have two or more"),
        ("csv", lambda text: text.splitlines()[0], "has no rows: must have two or more"),
        ("csv", lambda text: _cell(text, 5, 0, "inf"), "times: not finite"),
        ("basilisk", lambda text: text.replace(",", ";"), "must be a CCSDS AEM"),
        ("basilisk", lambda text: _without_last_cell(text), "must be a CCSDS AEM"),
        ("basilisk", lambda text: text + "1,2,3\n", "number of columns"),
        ("stk/platform.a", lambda text: text.replace("J2000", "Fixed"), "CoordinateAxes Fixed"),
        ("stk/platform.a", lambda text: text.replace("Order 1", "Order 5"), "InterpolationOrder 5"),
        ("stk/platform.a", lambda text: text.replace("TimeQuaternions", "TimeEuler"), "has no data of"),
        ("stk/platform.a", lambda text: text.replace("Mar", "Mrz"), "ScenarioEpoch"),
        ("stk/platform.a", lambda text: text.replace("END", "1 2 3\nEND"), "rows of 5 numbers"),
        ("aem", lambda text: text.replace("EME2000", "ITRF97"), "REF_FRAME_A = ITRF97"),
        ("aem", lambda text: text.replace("= UTC", "= TDB"), "TIME_SYSTEM = TDB"),
        (
            "aem",
            lambda text: text.replace(
                "META_STOP", "INTERPOLATION_METHOD = HERMITE\nINTERPOLATION_DEGREE = 7\nMETA_STOP"
            ),
            "INTERPOLATION_METHOD = HERMITE",
        ),
        ("aem", lambda text: text + _later_segment(text), "no attitude is known between"),
        ("aem", lambda text: text.replace("META_START", "META"), "no Attitude Ephemeris Message"),
    ],
)
def test_what_is_no_table_is_refused_by_name(folder, tmp_path, written, change, told):
    if written == "aem":
        pytest.importorskip("ccsds_ndm")
    source = folder / written
    file = tmp_path / source.name
    file.write_text(change(source.read_text()))
    with pytest.raises(ValueError, match=told) as caught:
        jp.load_attitude(file)
    assert source.name in str(caught.value)


def _cell(text: str, line: int, column: int, value: str) -> str:
    """A table with the cell in a line and a column, from zero, replaced."""
    lines = [row.split(",") for row in text.splitlines()]
    lines[line][column] = value
    return "\n".join(",".join(row) for row in lines) + "\n"


def _later_segment(text: str) -> str:
    """The segment of a message once more, an hour later."""
    return text[text.index("META_START") :].replace("T06:", "T07:")


def _without_last_cell(text: str) -> str:
    return "\n".join(line.rpartition(",")[0] for line in text.splitlines())


def test_a_turn_that_may_go_either_way_round_is_refused():
    half_turn = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, 0.0, np.pi]]).as_quat(scalar_first=True)
    with pytest.raises(ValueError, match=r"rows 0 and 1, .*either way round"):
        jp.AttitudeTable(times=np.array([0.0, 1.0]), quaternions=half_turn)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda place: place / "absent.csv", "No such file"),
        (lambda place: place, "holds 0 attitude files"),
    ],
)
def test_paths_of_nothing_are_refused(tmp_path, make: Callable[[Path], Path], told):
    with pytest.raises((ValueError, OSError), match=told):
        jp.load_attitude(make(tmp_path))


def test_a_c_kernel_needs_its_clock(folder, tmp_path):
    pytest.importorskip("spiceypy")
    file = tmp_path / "attitude.bc"
    file.write_bytes((folder / "ck" / "attitude.bc").read_bytes())
    with pytest.raises(ValueError, match="clock kernel"):
        jp.load_attitude(file)
