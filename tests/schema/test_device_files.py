"""Files of spacecraft with devices of every kind: their meaning, their faults, and the way back to files."""

import copy
import tomllib
from dataclasses import replace

import numpy as np
import pytest

import jaxplan as jp
import jaxplan.schema as sc
from jaxplan.model.devices import NEAREST_TO_POLE
from jaxplan.schema.reading import take_in

OBSERVER = tomllib.loads("""
schema_version = 1
name = "Earth observer"
[spacecraft]
rate_limit_deg_s = [1.5, 1.5, 0.8]
rate_norm_limit_deg_s = 1.8
acceleration_limit_deg_s2 = 0.3
[[spacecraft.instrument]]
name = "telescope"
boresight = [0, 0, 1]
[[spacecraft.instrument]]
name = "tracker-1"
boresight = [0, 0.8, -0.6]
[[spacecraft.terminal]]
name = "antenna"
mount = { yaw_axis = [0, 0, 1], boresight = [0.6, 0.8, 0] }
yaw_range_deg = [-270, 290]
pitch_range_deg = [5, 85]
yaw_rate_limit_deg_s = 4.0
pitch_rate_limit_deg_s = 2.0
yaw_acceleration_limit_deg_s2 = 1.5
pitch_acceleration_limit_deg_s2 = 1.0
[[spacecraft.drive]]
name = "array"
axis = [0, 1, 0]
boresight = [0, 0, -1]
range_deg = [-180, 200]
rate_limit_deg_s = 0.5
acceleration_limit_deg_s2 = 0.1
[start]
attitude = [0, 0, 0]
joints_deg = { antenna = [10, 45], array = [30] }
[goal]
targets = { telescope = [0.5, 0, 0.8660254037844386], antenna = [0, 0.6, 0.8] }
prefer = [{ device = "array", direction = [1, 0, 0] }]
tolerance_deg = 1e-5
""")
TERMINAL, DRIVE = "spacecraft.terminal.0.", "spacecraft.drive.0."


def changed(place, value):
    """The tables with a value at a place, or without it for None."""
    tables = copy.deepcopy(OBSERVER)
    *steps, last = [int(step) if step.isdigit() else step for step in place.split(".")]
    inner = tables
    for step in steps:
        inner = inner[step]
    if value is None:
        del inner[last]
    else:
        inner[last] = value
    return tables


def test_a_file_of_devices_is_read_in_radians():
    scenario = sc.scenario_from_dict(OBSERVER)
    craft = scenario.spacecraft
    assert craft.device_names == ("antenna", "array", "telescope", "tracker-1")
    ranges = [[-270, 290], [5, 85], [-180, 200]]
    np.testing.assert_allclose(craft.joint_ranges, np.deg2rad(ranges), rtol=1e-15)
    np.testing.assert_allclose(craft.joint_rate_limits, np.deg2rad([4, 2, 0.5]), rtol=1e-15)
    np.testing.assert_allclose(craft.joint_acceleration_limits, np.deg2rad([1.5, 1, 0.1]), rtol=1e-15)
    np.testing.assert_allclose(scenario.start.joints, np.deg2rad([10, 45, 30]), rtol=1e-15)
    assert scenario.goal.devices == ("telescope", "antenna")
    assert scenario.goal.numbers(craft) == (2, 0)
    assert scenario.goal.tolerance == pytest.approx(np.deg2rad(1e-5), rel=1e-15)
    (wish,) = scenario.goal.prefer
    assert (wish.device, list(wish.direction)) == ("array", [1, 0, 0])


def test_writing_and_reading_again_gives_the_same():
    scenario = sc.scenario_from_dict(OBSERVER)
    text = sc.dump_scenario(scenario)
    again = sc.parse_scenario(text)
    assert again == scenario
    assert sc.dump_scenario(again) == text


ROUNDED = {"yaw_axis": [0.5774, 0.5774, 0.5774], "boresight": [0.8165, -0.4082, -0.4082]}


def test_a_mount_typed_with_four_digits_is_read_with_an_exact_right_angle():
    (terminal,) = sc.scenario_from_dict(changed(TERMINAL + "mount", ROUNDED)).spacecraft.terminals
    mount, given = terminal.mounting, jp.Mount(**{key: np.array(value) for key, value in ROUNDED.items()})
    assert abs(mount.yaw_axis @ mount.boresight) < 1e-15
    np.testing.assert_allclose(np.linalg.norm([mount.yaw_axis, mount.boresight], axis=1), 1, atol=1e-15)
    np.testing.assert_allclose(terminal.frame, replace(terminal, mounting=given).frame, atol=1e-15)


def test_a_mount_that_was_made_exact_is_read_back_to_the_bit():
    for axis, other in np.random.default_rng(0).normal(size=(300, 2, 3)):
        up = axis / np.linalg.norm(axis)
        ahead = np.cross(up, other)
        given = {
            "yaw_axis": up.round(4).tolist(),
            "boresight": (ahead / np.linalg.norm(ahead)).round(4).tolist(),
        }
        scenario = sc.scenario_from_dict(changed(TERMINAL + "mount", given))
        mount = scenario.spacecraft.terminals[0].mounting
        assert abs(mount.yaw_axis @ mount.boresight) < 1e-15
        again = sc.scenario_from_dict(sc.scenario_to_dict(scenario))
        assert again == scenario
        assert take_in(scenario) == scenario


def test_devices_that_joints_deg_leaves_out_are_at_zero_or_the_nearest_in_range():
    start = sc.scenario_from_dict(changed("start.joints_deg", {"array": [30]})).start
    np.testing.assert_allclose(start.joints, np.deg2rad([0, 5, 30]), rtol=1e-15)
    nothing = sc.scenario_from_dict(changed("start.joints_deg", {})).start
    np.testing.assert_allclose(nothing.joints, np.deg2rad([0, 5, 0]), rtol=1e-15)


def test_arrays_of_joints_do_as_well_as_names():
    tables = changed("start.joints_deg", None)
    tables["start"] |= {"yaw_deg": [10], "pitch_deg": [45], "drive_deg": [30]}
    assert sc.scenario_from_dict(tables) == sc.scenario_from_dict(OBSERVER)


@pytest.mark.parametrize("place", [TERMINAL + "pitch_range_deg"])
def test_the_pitch_keeps_off_the_pole_whatever_the_file_says(place):
    craft = sc.scenario_from_dict(changed(place, [-90, 90])).spacecraft
    steepest = np.pi / 2 - NEAREST_TO_POLE
    np.testing.assert_allclose(craft.joint_ranges[1], [-steepest, steepest], rtol=1e-15)


@pytest.mark.parametrize(
    ("place", "value", "fault"),
    [
        (
            TERMINAL + "mount",
            {"yaw_axis": [0, 0, 1], "boresight": [0.6, 0, 0.8]},
            "spacecraft.terminal[0].mount.boresight = [0.6, 0.0, 0.8]: must be at right angles to yaw_axis, "
            "the angle is 36.8699 deg",
        ),
        (TERMINAL + "mount", {"yaw_axis": [0, 0, 1]}, "spacecraft.terminal[0].mount.boresight: missing"),
        (TERMINAL + "mount", None, "spacecraft.terminal[0].mount_deg: missing (or mount)"),
        (TERMINAL + "mount_deg", 5, "mount: stands in the place of mount_deg, only one of them can be given"),
        (
            TERMINAL + "yaw_range_deg",
            [290, -270],
            "yaw_range_deg = [290, -270]: must be two numbers, the first below",
        ),
        (TERMINAL + "yaw_range_deg", [0, 0], "yaw_range_deg = [0, 0]: must be two numbers, the first below"),
        (TERMINAL + "yaw_range_deg", [0, 721], "yaw_range_deg[1] = 721.0: must lie in [-720, 720]"),
        (
            TERMINAL + "yaw_range_deg",
            [0],
            "yaw_range_deg = [0]: must be an array of 2 numbers, least and largest",
        ),
        (TERMINAL + "yaw_limit_deg", 90, "yaw_range_deg: stands in the place of yaw_limit_deg"),
        (TERMINAL + "pitch_range_deg", [0, 91], "pitch_range_deg[1] = 91.0: must lie in [-90, 90]"),
        (
            TERMINAL + "pitch_range_deg",
            [85, 5],
            "pitch_range_deg = [85, 5]: must be two numbers, the first below",
        ),
        (
            TERMINAL + "pitch_range_deg",
            [89.95, 90],
            "pitch_range_deg = [89.95, 90.0]: must leave a range, of which 0.1 deg are kept from 90",
        ),
        (
            TERMINAL + "yaw_rate_limit_deg_s",
            None,
            "rate_limit_deg_s: missing (or yaw_rate_limit_deg_s and pitch_rate_limit_deg_s)",
        ),
        (
            TERMINAL + "pitch_acceleration_limit_deg_s2",
            None,
            "missing (or yaw_acceleration_limit_deg_s2 and pitch_acceleration_limit_deg_s2)",
        ),
        (DRIVE + "boresight", [0, 1, 0], "boresight = [0.0, 1.0, 0.0]: must be at least 1 deg off the axis"),
        (
            DRIVE + "boresight",
            [0, -1, 0],
            "boresight = [0.0, -1.0, 0.0]: must be at least 1 deg off the axis",
        ),
        (DRIVE + "range_deg", [200, -180], "range_deg = [200, -180]: must be two numbers, the first below"),
        (DRIVE + "range_deg", None, "spacecraft.drive[0].range_deg: missing"),
        (DRIVE + "rate_limit_deg_s", None, "spacecraft.drive[0].rate_limit_deg_s: missing"),
        (
            DRIVE + "axis",
            [0, 2, 0],
            "spacecraft.drive[0].axis = [0, 2, 0]: must be a unit vector, its norm is 2",
        ),
        (
            "spacecraft.drive",
            OBSERVER["spacecraft"]["drive"][0],
            "spacecraft.drive = (a table): must be an array of tables, each under [[spacecraft.drive]]",
        ),
        ("spacecraft.drive", [1], "spacecraft.drive[0] = 1: must be a table"),
        (DRIVE + "name", "antenna", 'drive[0].name = "antenna": the same as spacecraft.terminal[0].name'),
        (
            "start.joints_deg",
            {"antenna": [10], "array": [30]},
            "start.joints_deg.antenna = [10]: must be an array of 2 numbers, yaw and pitch, not of 1",
        ),
        (
            "start.joints_deg",
            {"antenna": [10, 45], "array": [30, 2]},
            "start.joints_deg.array = [30, 2]: must be an array of 1 number, the angle of a drive, not of 2",
        ),
        (
            "start.joints_deg",
            {"antena": [1, 2]},
            "joints_deg.antena: no such device with joints, perhaps antenna",
        ),
        ("start.joints_deg", {"telescope": [1]}, "joints_deg.telescope: no such device with joints"),
        (
            "start.joints_deg",
            [1, 2, 3],
            "start.joints_deg = [1, 2, 3]: must be a table from names of devices",
        ),
        ("start.yaw_deg", [1], "start.joints_deg: stands in the place of the arrays of angles, give either"),
        ("goal.targets", {"telescop": [1, 0, 0]}, "goal.targets.telescop: no such device, perhaps telescope"),
        (
            "goal.targets",
            {"telescope": [1, 1, 0]},
            "goal.targets.telescope = [1, 1, 0]: must be a unit vector",
        ),
        ("goal.targets", {}, "goal.targets = (a table): must name a device at least, and what it points at"),
        ("goal.targets", {"telescope": 3}, "goal.targets.telescope = 3: must be"),
        ("goal.hold", ["antenna"], "has a target, so it cannot keep its joints"),
        ("goal.hold", ["arra"], "perhaps array is meant"),
        ("goal.prefer", [{"device": "antenna", "direction": [1, 0, 0]}], "goal.prefer[0].device"),
        ("goal.prefer", [{"device": "array"}], "goal.prefer[0].direction: missing"),
        (
            "goal.prefer",
            [{"device": "array", "direction": one} for one in ([1, 0, 0], [0, 0, 1], [1.0, 0, 0])],
            'goal.prefer[2].device = "array": the same wish, with its direction, as goal.prefer[0]',
        ),
        ("goal.tolerance_deg", 2, "goal.tolerance_deg = 2: must lie in [1e-8, 1]"),
    ],
)
def test_every_fault_of_devices_is_told_with_its_place_and_what_would_do(place, value, fault):
    with pytest.raises(sc.ScenarioError) as caught:
        sc.scenario_from_dict(changed(place, value))
    assert any(fault in line for line in caught.value.faults), caught.value.faults
