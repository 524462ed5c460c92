"""Goals at which devices without a target can keep their zones, where the targets leave the attitude room."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.planner.entry_points import as_filed
from jaxplan.planner.steps import find_goals

ROLLS = np.deg2rad(np.arange(0.0, 360.0, 1.0))
ROOM = np.deg2rad(0.5)  # rad, by which a device has to be within its zone to count as able to keep it
SUN = np.array([0.0, 0.0, -1.0])
LIMITS = {"rate_limit": np.deg2rad(1.0), "acceleration_limit": np.deg2rad(0.3)}
TELESCOPE = jp.Instrument(name="telescope", boresight=np.array([0.0, 0.0, 1.0]))
ARRAY = jp.Drive(
    name="array",
    axis=np.array([0.0, 1.0, 0.0]),
    boresight=np.array([0.0, 0.0, -1.0]),
    range=(-np.pi, np.pi),
    **LIMITS,
)
ANTENNA = jp.Terminal(
    name="antenna",
    mounting=jp.Mount(yaw_axis=[0.0, 0.0, -1.0], boresight=[1.0, 0.0, 0.0]),
    yaw_range=tuple(np.deg2rad([-100.0, 100.0])),
    pitch_range=tuple(np.deg2rad([20.0, 85.0])),
    **LIMITS,
)


def scene(devices, joints, target, zones, prefer=()):
    return jp.Scenario(
        name="kept by a device that may move",
        spacecraft=jp.Spacecraft(instruments=(TELESCOPE,), **devices, **LIMITS),
        start=jp.GivenState(rotation_vector=[0.0, 0.0, 0.0], joints=joints),
        goal=jp.Targets.of({"telescope": target}, prefer=prefer),
        **zones,
    )


def kept_in(device, direction, half_angle_deg):
    zone = jp.KeepIn(name="z", direction=direction, half_angle=np.deg2rad(half_angle_deg), devices=[device])
    return {"keep_in": (zone,)}


def kept_out(device, direction, half_angle_deg):
    zone = jp.KeepOut(name="z", direction=direction, half_angle=np.deg2rad(half_angle_deg), devices=[device])
    return {"keep_out": (zone,)}


def least_slew(scenario, room):
    """Least rotation, rad, of all rolls about the target at which some joints keep the zone by `room` rad."""
    craft, target = scenario.spacecraft, np.asarray(scenario.goal.directions[0])
    toward, _ = Rotation.align_vectors([target], [TELESCOPE.boresight])
    attitudes = (Rotation.from_rotvec(ROLLS[:, None] * target) * toward).as_matrix()
    grids = [np.linspace(*each, 181) for each in craft.joint_ranges]
    joints = np.stack([axis.ravel() for axis in np.meshgrid(*grids)], axis=1)
    seen = np.asarray(craft.boresights(np.eye(3), joints))[:, 0]  # of the device that may move
    cosines = np.einsum("rij,kj->rki", attitudes, seen)
    best = -np.inf * np.ones(len(ROLLS))
    for zone in scenario.keep_in:
        off = np.arccos(np.clip(cosines @ zone.direction, -1, 1))
        best = np.max(zone.half_angle - off, axis=1)
    for zone in scenario.keep_out:
        off = np.arccos(np.clip(cosines @ zone.direction, -1, 1))
        best = np.max(off - zone.half_angle, axis=1)
    slews = Rotation.from_matrix(attitudes).magnitude()
    return np.min(slews[best >= room], initial=np.inf)


SCENES = {
    "array kept in a cone": scene({"drives": (ARRAY,)}, [0.0], [0, 0.8, -0.6], kept_in("array", SUN, 30)),
    "array seen from the side": scene({"drives": (ARRAY,)}, [0.0], [0, 1, 0], kept_in("array", SUN, 30)),
    "array kept out of the rest": scene(
        {"drives": (ARRAY,)}, [0.0], [0, 0.8, 0.6], kept_out("array", -SUN, 150)
    ),
    "antenna kept in a cone": scene(
        {"terminals": (ANTENNA,)},
        np.deg2rad([0.0, 50.0]),
        [-0.8, 0.6, 0],
        kept_in("antenna", [np.sin(np.deg2rad(40.0)), 0, -np.cos(np.deg2rad(40.0))], 25),
    ),
}


def antenna_kept_within(half_angle_deg, **more):
    """A link that the antenna reaches only after half a turn about the telescope's axis or so."""
    link = [np.sin(np.deg2rad(40.0)), 0, -np.cos(np.deg2rad(40.0))]
    devices = {"terminals": (ANTENNA,), **more}
    joints = np.deg2rad([0.0, 50.0, *[0.0] * len(more)])
    zones = kept_in("antenna", link, half_angle_deg)
    return scene(devices, joints, [-0.8, 0.6, 0], zones)


@pytest.mark.parametrize("half_angle_deg", [3.0, 0.5, 0.1])
def test_narrow_zones_are_met_as_wide_ones_are(half_angle_deg):
    scenario = antenna_kept_within(half_angle_deg)
    found = find_goals(as_filed("scenario", scenario))
    assert not isinstance(found, jp.Plan), found.message
    assert (
        found[0].slew_angle
        <= least_slew(SCENES["antenna kept in a cone"], np.deg2rad(25.0 - half_angle_deg)) + 0.02
    )


def test_two_devices_without_a_target_keep_their_zones_together():
    scenario = antenna_kept_within(0.5, drives=(ARRAY,))
    facing = replace(kept_in("array", SUN, 5)["keep_in"][0], name="sun")
    scenario = replace(scenario, keep_in=(*scenario.keep_in, facing))
    found = find_goals(as_filed("scenario", scenario))
    assert not isinstance(found, jp.Plan), found.message


@pytest.mark.parametrize("name", SCENES)
def test_the_nearest_attitude_is_found_at_which_a_device_without_a_target_can_keep_its_zone(name):
    plan = jp.plan(SCENES[name], throw=False, progress=False)
    assert plan.status is jp.Status.OK, plan.message
    assert least_slew(plan.scenario, 0.0) - np.deg2rad(1.0) <= plan.goal.slew_angle
    assert plan.goal.slew_angle <= least_slew(plan.scenario, ROOM) + np.deg2rad(1.0)


def test_there_is_no_goal_where_no_roll_lets_the_device_keep_its_zone():
    stiff = replace(ARRAY, range=(-0.8, 0.8))
    narrow = scene({"drives": (stiff,)}, [0.0], SUN, kept_in("array", SUN, 30))
    assert least_slew(narrow, 0.0) == np.inf
    plan = jp.plan(narrow, throw=False, progress=False)
    assert plan.status is jp.Status.INVALID_GOAL
    assert "array is" in plan.message


@pytest.mark.parametrize("direction", [[0.0, 1.0, 0.0], [0.0, 0.6, 0.8], [0.0, 0.8, -0.6]])
def test_a_wish_of_another_device_takes_no_goal_away(direction):
    """The wish is met as far as the zone of the array allows, by no less than any goal without the wish."""
    horn = jp.Instrument(name="horn", boresight=np.array([1.0, 0.0, 0.0]))
    scenarios = [
        scene({"drives": (ARRAY,)}, [0.0], [1, 0, 0], kept_in("array", SUN, 30), prefer=prefer)
        for prefer in ((), (jp.Wish(device="horn", direction=direction),))
    ]
    craft = scenarios[0].spacecraft
    craft = replace(craft, instruments=(*craft.instruments, horn))
    plans = jp.plan_batch([replace(each, spacecraft=craft) for each in scenarios], progress=False)
    assert [plan.message for plan in plans if not plan.ok] == []
    off, near = (np.arccos(np.clip(plan.goal.attitude[:, 0] @ direction, -1, 1)) for plan in plans)
    assert near <= off + 1e-6


def test_a_goal_that_leans_on_what_a_device_without_a_target_can_reach_has_no_slopes():
    plan = jp.plan(SCENES["array kept in a cone"], progress=False)
    with pytest.raises(ValueError, match="what a device without a target can reach"):
        jp.differentiable(plan)
