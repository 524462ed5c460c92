"""Starts and goals that a file gives in the local orbital frame, beside circles by hand."""

import re
import tomllib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan import schema as sc

pytest.importorskip("erfa", reason="pyerfa is not installed")

RADIUS, MU = 6378.137 + 550.0, 398600.4418  # km, km^3/s^2
RATE = np.sqrt(MU / RADIUS**3)  # rad/s
NODE, INCLINATION, LATITUDE = np.deg2rad([220.0, 97.5, 120.0])
TURN = [0.5, -0.2, 0.9]
DURATION = 60.0
SKY = """
[sky]
epoch_utc = 2026-03-20T12:00:00
[sky.observer]
altitude_km = 550.0
inclination_deg = 97.5
ascending_node_deg = 220
argument_of_latitude_deg = 120
"""
SCENE = f"""
schema_version = 1
name = "camera"
[spacecraft]
rate_limit_deg_s = 2.0
acceleration_limit_deg_s2 = 0.2
[[spacecraft.instrument]]
name = "camera"
boresight = [0.0, 0.0, 1.0]
{SKY}
[start]
frame = "local"
attitude = [0.0, 0.0, 0.0]
[goal]
frame = "local"
attitude = {TURN}
[trajectory]
duration_s = {DURATION}
"""
TIMELINE = (
    SCENE.replace("[goal]", "[timeline]\nuntil_s = 600.0\n[[activity]]")
    .replace(
        f'frame = "local"\nattitude = {TURN}', 'name = "look"\ntrack = { camera = "nadir" }\nfor_s = 60.0'
    )
    .replace(f"[trajectory]\nduration_s = {DURATION}", "")
    .replace("schema_version", 'kind = "timeline"\nschema_version')
)


def frame(time):
    """The local frame's axes as columns, by the orbit's own angles."""
    along = LATITUDE + RATE * time
    plane = Rotation.from_euler("ZX", [NODE, INCLINATION]).as_matrix()
    up = plane @ [np.cos(along), np.sin(along), 0]
    ahead = plane @ [-np.sin(along), np.cos(along), 0]
    return np.stack([ahead, np.cross(-up, ahead), -up], axis=-1)


def test_ends_are_those_of_the_frame_at_their_instants():
    read = sc.parse_scenario(SCENE)
    for state, time, turn in ((read.start, 0.0, np.zeros(3)), (read.goal, DURATION, TURN)):
        body = Rotation.from_rotvec(turn).as_matrix()
        np.testing.assert_allclose(state.attitude, frame(time) @ body, atol=1e-9)
        np.testing.assert_allclose(state.angular_velocity, body.T @ [0.0, -RATE, 0.0], atol=1e-9)


def test_an_attitude_of_another_form_and_a_rate_within_the_frame_are_taken():
    x, y, z, w = (Rotation.from_rotvec(TURN).as_quat()).tolist()
    body = Rotation.from_rotvec(TURN).as_matrix()
    tables = tomllib.loads(SCENE)
    del tables["start"]["attitude"]
    tables["start"] |= {"quaternion_wxyz": [w, x, y, z], "angular_velocity_rad_s": [0.0, 0.0, 1e-3]}
    read = sc.scenario_from_dict(tables)
    np.testing.assert_allclose(read.start.attitude, frame(0.0) @ body, atol=1e-9)
    spin = body.T @ [0.0, -RATE, 0.0] + [0.0, 0.0, 1e-3]
    np.testing.assert_allclose(read.start.angular_velocity, spin, atol=1e-9)


def test_what_is_written_means_the_same_without_the_frame():
    read = sc.parse_scenario(SCENE)
    written = sc.scenario_to_dict(read)
    assert "frame" not in written["start"]
    again = sc.scenario_from_dict(written)
    np.testing.assert_array_equal(again.start.attitude, read.start.attitude)
    np.testing.assert_array_equal(again.goal.angular_velocity, read.goal.angular_velocity)


def test_a_plan_leads_from_frame_to_frame():
    plan = jp.plan(sc.parse_scenario(SCENE), progress=False)
    assert plan.ok
    ends = plan.trajectory.sample([0.0, DURATION])
    np.testing.assert_allclose(ends.angular_velocity[0], [0.0, -RATE, 0.0], atol=1e-9)
    np.testing.assert_allclose(
        ends.attitude[1], frame(DURATION) @ Rotation.from_rotvec(TURN).as_matrix(), atol=1e-9
    )


def test_a_timeline_begins_in_the_frame():
    start = sc.timeline_from_dict(tomllib.loads(TIMELINE)).scene.start
    np.testing.assert_allclose(start.attitude, frame(0.0), atol=1e-9)
    np.testing.assert_allclose(start.angular_velocity, [0.0, -RATE, 0.0], atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"local"', '"lvlh"', 'start.frame = "lvlh": must be "inertial" or "local"'),
        (f"= {DURATION}", '= "minimum"', 'goal.frame = "local": needs trajectory.duration_s to be a number'),
        (SKY, "", 'start.frame = "local": needs [sky], with epoch_utc'),
        (f"attitude = {TURN}", 'targets = { camera = "nadir" }', "goal.frame: the goal has targets"),
        (
            "attitude = [0.0, 0.0, 0.0]",
            'targets = { camera = "nadir" }',
            "start.frame: the start has targets",
        ),
        ("altitude_km = 550.0", "altitude_km = -5", "sky.observer.altitude_km = -5: must lie in"),
    ],
)
def test_a_frame_that_cannot_be_is_refused(old, new, said):
    with pytest.raises(jp.ScenarioError, match=re.escape(said)):
        sc.parse_scenario(SCENE.replace(old, new))


def test_an_activity_has_no_frame():
    tables = tomllib.loads(TIMELINE)
    tables["activity"][0] = {"name": "hold", "frame": "local", "attitude": [0.0, 0.0, 0.0], "for_s": 60.0}
    with pytest.raises(jp.ScenarioError, match="held at rest along inertial axes; track what turns"):
        sc.timeline_from_dict(tables)
