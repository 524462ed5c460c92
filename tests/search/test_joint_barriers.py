"""Proofs from a device's own joints, against closed forms and against paths that exist."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.devices import Drive, Instrument, Mount, Terminal
from jaxplan.model.goals import GivenState
from jaxplan.model.path import Goal
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.search import make_scene
from jaxplan.search.joint_barriers import JointBarrier, find_joint_barrier, narrowest

deg = np.deg2rad
LIMITS = {"rate_limit": deg(3.0), "acceleration_limit": deg(2.0)}
CAMERA = Instrument(name="camera", boresight=np.array([0.0, 1.0, 0.0]))


def array(low, high):
    """A drive about z that points along x at zero."""
    ends = deg([low, high])
    return Drive(name="array", axis=np.eye(3)[2], boresight=np.eye(3)[0], range=ends, **LIMITS)


def antenna(*mask, yaw=(-170, 170), pitch=(-40, 40)):
    return Terminal(
        name="antenna",
        mounting=Mount(yaw_axis=np.eye(3)[1], boresight=np.eye(3)[2]),
        yaw_range=deg(yaw),
        pitch_range=deg(pitch),
        mask=tuple(map(deg, mask)),
        **LIMITS,
    )


def scenario_of(device, start, goal, *zones, aimed=False):
    """A device that turns between two places in deg while the platform stays; or to a target there."""
    kind = {"terminals": (device,)} if isinstance(device, Terminal) else {"drives": (device,)}
    craft = Spacecraft(instruments=(CAMERA,), **LIMITS, **kind)
    start, goal = (
        GivenState(rotation_vector=np.zeros(3), joints=deg(joints), **_rest(len(joints)))
        for joints in (start, goal)
    )
    wanted = goal
    if aimed:
        seen = craft.boresights(np.eye(3), goal.joints)
        wanted = jp.Targets.of(dict(zip(craft.device_names, seen, strict=True)), **_rest(len(goal.joints)))
    out = tuple(zone for zone in zones if isinstance(zone, KeepOut))
    inside = tuple(zone for zone in zones if isinstance(zone, KeepIn))
    return Scenario(name="x", spacecraft=craft, start=start, goal=wanted, keep_out=out, keep_in=inside)


def _rest(count):
    return {"angular_velocity": np.zeros(3), "joint_rates": np.zeros(count)}


def found(scenario):
    goal = scenario.goal
    place = Goal(attitude=np.eye(3), joints=goal.joints, slew_angle=0.0)
    return find_joint_barrier(make_scene(scenario, place))


def beam(half_angle, **more):
    """Of the array beside the camera, which is at 90 deg."""
    cone = {"axis_device": "camera", "half_angle": deg(half_angle), "devices": ("array",)}
    return KeepOut(name="beam", **cone | more)


@pytest.mark.parametrize(
    "zone",
    [
        beam(5),
        beam(5, axis_device=None, axis_body=np.array([0.0, 1.0, 0.0])),
        beam(5, axis_device="array", devices=("camera",)),
        KeepIn(name="beam", axis_body=np.array([0.0, -1.0, 0.0]), half_angle=deg(175.0), devices=("array",)),
    ],
)
def test_a_drive_does_not_pass_a_cone_that_is_fixed_to_the_body(zone):
    assert found(scenario_of(array(-180, 180), [10], [150], zone)) == JointBarrier(device=0, zones=(0,))
    assert found(scenario_of(array(-180, 180), [10], [80], zone)) is None
    assert found(scenario_of(array(-180, 180), [-150], [80], zone)) is None  # not the way of -210 deg
    away = Rotation.from_euler("x", 20, degrees=True).apply([0.0, 1.0, 0.0])
    if zone.axis_body is not None and zone.side > 0:
        assert found(scenario_of(array(-180, 180), [10], [150], replace(zone, axis_body=away))) is None


def test_the_sky_and_devices_that_move_prove_nothing():
    sky = KeepOut(name="sun", direction=np.array([0.0, 1.0, 0.0]), half_angle=deg(5), devices=("array",))
    assert found(scenario_of(array(-180, 180), [10], [150], sky)) is None
    alternatives = (beam(5, any_of="either"), replace(sky, any_of="either"))
    assert found(scenario_of(array(-180, 180), [10], [150], *alternatives)) is None


WALL = [[40, -40.5], [60, -40.5], [60, 40.5], [40, 40.5]]


def test_a_mask_across_the_pitch_parts_the_yaw_and_one_with_a_gap_does_not():
    apart = scenario_of(antenna(WALL), [0, 0], [90, 0])
    assert found(apart) == JointBarrier(device=0, zones=(0,))
    gap = [[40, -40.5], [60, -40.5], [60, 35], [40, 35]]
    assert found(scenario_of(antenna(gap), [0, 0], [90, 0])) is None
    above = [[40, 20], [60, 20], [60, 41], [40, 41]]
    below = [[40, 22], [60, 22], [60, -41], [40, -41]]
    assert found(scenario_of(antenna(above, below), [0, 0], [90, 0])) == JointBarrier(device=0, zones=(0, 1))
    thin = [[40, -40.5], [40.5, -40.5], [40.5, 40.5], [40, 40.5]]
    assert found(scenario_of(antenna(thin), [0, 0], [90, 0])) is None  # it is no proof, though it is so


def test_a_wall_that_is_met_again_after_a_turn_parts_there_too():
    wide = antenna(WALL, yaw=(-350, 350))
    assert found(scenario_of(wide, [0, 0], [-340, 0])).zones == (0,)
    assert found(scenario_of(wide, [0, 0], [-290, 0])) is None


def test_a_proof_is_a_status_that_names_device_and_constraint():
    plan = jp.plan(scenario_of(array(-180, 180), [10], [150], beam(5)), throw=False)
    assert plan.status is jp.Status.NO_PATH
    assert plan.message == (
        "array cannot get from its angle at the start to what is wanted at the goal, since beam lies between "
        "the two: make it smaller, widen the range, or change the goal"
    )
    plan = jp.plan(scenario_of(antenna(WALL), [0, 0], [90, 0]), throw=False)
    assert "antenna cannot get from its yaw and pitch at the start" in plan.message
    assert "mask 1 of antenna lies between the two" in plan.message


def test_a_device_that_is_free_ends_beside_what_is_in_its_way():
    scenario = scenario_of(array(-100, 180), [10], [150], beam(5), aimed=True)
    camera, wished = ([0.0, 1.0, 0.0], [np.cos(deg(150)), np.sin(deg(150)), 0.0])
    wish = jp.Wish(device="array", direction=wished)
    targets = jp.Targets.of({"camera": camera}, prefer=(wish,), **_rest(1))
    plan = jp.plan(replace(scenario, goal=targets, search=replace(scenario.search, max_goals=1)))
    assert plan.ok
    assert 84.5 < np.rad2deg(plan.goal.joints[0]) < 85
    assert "array cannot get from its angle at the start" in plan.message
    # where more goals are tried there is one that meets the wish, from the other side of the camera
    plan = jp.plan(replace(scenario, goal=targets))
    np.testing.assert_allclose(np.rad2deg([plan.goal.slew_angle, *plan.goal.joints]), [180, 30], atol=1e-3)


def test_what_leaves_a_narrow_gap_is_named_where_no_path_is_found():
    gap = [[40, -40.5], [60, -40.5], [60, 39.3], [40, 39.3]]
    scenario = scenario_of(antenna(gap), [0, 0], [90, 0])
    scene = make_scene(scenario, Goal(attitude=np.eye(3), joints=scenario.goal.joints, slew_angle=0.0))
    barrier, by = narrowest(scene)
    assert barrier == JointBarrier(device=0, zones=(0,))
    assert 0.7 < np.rad2deg(by) < 2.5
    plan = jp.plan(replace(scenario, search=replace(scenario.search, max_expansions=1)), throw=False)
    assert plan.status is jp.Status.NODE_LIMIT
    assert "the joints of antenna get past mask 1 of antenna by a gap of" in plan.message
    wide = [[40, -40.5], [60, -40.5], [60, -10], [40, -10]]
    scenario = scenario_of(antenna(wide), [0, -20], [90, -20])
    assert (
        narrowest(make_scene(scenario, Goal(attitude=np.eye(3), joints=scenario.goal.joints, slew_angle=0.0)))
        is None
    )


def test_where_a_cone_is_in_the_way_the_device_goes_round_by_another_turn():
    plan = jp.plan(scenario_of(array(-220, 180), [10], [150], beam(5), aimed=True))
    assert plan.ok
    np.testing.assert_allclose(np.rad2deg(plan.goal.joints), [-210], atol=1e-5)
    assert "array cannot get" in plan.message
    plan = jp.plan(scenario_of(antenna(WALL, yaw=(-350, 170)), [0, 0], [90, 10], aimed=True))
    assert plan.ok
    np.testing.assert_allclose(np.rad2deg(plan.goal.joints), [-270, 10], atol=1e-5)
    # without room for that turn the other attitude is left from which both devices see their targets
    plan = jp.plan(scenario_of(array(-200, 180), [10], [150], beam(5), aimed=True))
    np.testing.assert_allclose(np.rad2deg([plan.goal.slew_angle, *plan.goal.joints]), [180, 30], atol=1e-5)


def test_where_a_mask_is_in_the_way_the_platform_turns_until_the_device_can_get_there():
    mount = Mount(yaw_axis=np.eye(3)[2], boresight=np.eye(3)[0])
    wall = [[[170, -1], [190, -1], [190, 86], [170, 86]]]
    dish = replace(antenna(*wall, yaw=(-400, 400), pitch=(0, 85)), mounting=mount)
    along = Instrument(name="camera", boresight=np.eye(3)[2])
    craft = Spacecraft(terminals=(dish,), instruments=(along,), **LIMITS)
    start = GivenState(rotation_vector=np.zeros(3), joints=deg([-390, 60]), **_rest(2))
    yaw, pitch = deg([-150, 40])  # 20 deg beside the wall, which is passed by a turn of 40 deg about z
    station = [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)]
    goal = jp.Targets.of({"antenna": station, "camera": np.eye(3)[2]}, **_rest(2))
    plan = jp.plan(Scenario(name="x", spacecraft=craft, start=start, goal=goal))
    assert plan.ok
    np.testing.assert_allclose(
        np.rad2deg([plan.goal.slew_angle, *plan.goal.joints]), [40, -190, 40], atol=1e-5
    )
    assert "antenna cannot get from its yaw and pitch at the start" in plan.message
