"""Motions that stay in keep-in zones of less than a degree."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.path import Goal
from jaxplan.search.kernel_calls import Scenes
from jaxplan.search.paths import straight_paths
from jaxplan.search.scene import in_narrow_zones, make_scene

CAMERA = jp.Instrument(name="camera", boresight=np.array([0.0, 0.0, 1.0]))
LINK = jp.Terminal(
    name="link",
    mounting=jp.Mount(yaw_axis=[0.0, 0.0, 1.0], boresight=[1.0, 0.0, 0.0]),
    yaw_range=(-np.pi, np.pi),
    pitch_range=(-1.4, 1.4),
    rate_limit=np.deg2rad(2.0),
    acceleration_limit=np.deg2rad(1.0),
)
CRAFT = jp.Spacecraft(instruments=(CAMERA,), rate_limit=np.deg2rad(1.0), acceleration_limit=np.deg2rad(0.2))
SUN = jp.KeepOut(
    name="sun",
    direction=np.array([0.05, np.sin(0.6), np.cos(0.6)]) / np.hypot(1.0, 0.05),
    half_angle=np.deg2rad(12.0),
    devices=["camera"],
)


def roll_about_the_boresight(half_angle_deg):
    zone = jp.KeepIn(
        name="star", direction=[0.0, 0.0, 1.0], half_angle=np.deg2rad(half_angle_deg), devices=["camera"]
    )
    return jp.Scenario(
        name="roll",
        spacecraft=CRAFT,
        start=jp.GivenState(rotation_vector=[0.0, 0.0, 0.0], joints=[]),
        goal=jp.GivenState(rotation_vector=[0.0, 0.0, 1.0], joints=[]),
        keep_in=(zone,),
    )


def slew_that_keeps_the_link(half_angle_deg, *, past_the_sun=False, **search):
    zone = jp.KeepIn(
        name="partner", direction=[1.0, 0.0, 0.0], half_angle=np.deg2rad(half_angle_deg), devices=["link"]
    )
    return jp.Scenario(
        name="link",
        spacecraft=replace(CRAFT, terminals=(LINK,)),
        start=jp.GivenState(rotation_vector=[0.0, 0.0, 0.0], joints=[0.0, 0.0]),
        goal=jp.Targets.of({"camera": [0.0, np.sin(1.2), np.cos(1.2)], "link": [1.0, 0.0, 0.0]}),
        keep_in=(zone,),
        keep_out=(SUN,) if past_the_sun else (),
        search=jp.SearchSettings(**search),
    )


def margins_deg(plan):
    """Of the zone's half angle, what is left at 2,001 instants, deg."""
    craft, zone = plan.scenario.spacecraft, plan.scenario.keep_in[0]
    samples = plan.trajectory.sample(np.linspace(0.0, plan.trajectory.duration, 2001))
    seen = np.asarray(craft.boresights(samples.attitude, samples.joints))
    own = seen[:, craft.device_names.index(zone.devices[0])]
    return np.rad2deg(
        zone.half_angle
        - np.arctan2(np.linalg.norm(np.cross(own, zone.direction), axis=1), own @ zone.direction)
    )


@pytest.mark.parametrize(
    "scenario",
    [*(roll_about_the_boresight(each) for each in (0.5, 0.1, 0.02)), slew_that_keeps_the_link(0.2)],
    ids=["roll 0.5 deg", "roll 0.1 deg", "roll 0.02 deg", "link 0.2 deg"],
)
def test_a_straight_motion_that_stays_in_a_narrow_zone_is_found(scenario):
    plan = jp.plan(scenario, throw=False, progress=False)
    assert plan.status is jp.Status.OK, plan.message
    assert np.all(margins_deg(plan) >= -1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("half_angle_deg", [1.0, 0.5, 0.2])
def test_a_way_round_a_zone_is_found_while_a_link_is_kept(half_angle_deg):
    plan = jp.plan(slew_that_keeps_the_link(half_angle_deg, past_the_sun=True), progress=False)
    assert np.all(margins_deg(plan) >= -1e-9)


def test_where_shorter_steps_find_nothing_either_they_are_told():
    scenario = slew_that_keeps_the_link(0.1, past_the_sun=True, max_expansions=20)
    plan = jp.plan(scenario, throw=False, progress=False)
    assert plan.status is jp.Status.NODE_LIMIT
    assert plan.message.startswith(
        "no path within search.max_expansions = 20 (in steps of 0.1 rad, and then of 0.0035, as keep-in zone "
        "partner is narrow): raise it, or try another search.seed"
    )


@pytest.mark.parametrize(("side", "stays"), [(1.0, False), (-1.0, True)])
def test_half_a_turn_is_straight_only_if_it_swings_to_the_side_on_which_the_zone_is_wider(side, stays):
    """Camera and axis of the turn are off the zone's axis, so that both ends are within 0.092 deg of it."""
    off, swing = np.deg2rad(0.07), np.deg2rad(0.06)
    axis = np.array([np.sin(off), 0.0, np.cos(off)])
    first = Rotation.from_rotvec([side * swing, off, 0.0])  # of the camera, onto one side of the axis
    last = Rotation.from_rotvec(0.999 * np.pi * axis) * first
    scenario = replace(
        roll_about_the_boresight(0.1),
        start=jp.GivenState(rotation_vector=first.as_rotvec(), joints=[]),
        goal=jp.GivenState(rotation_vector=last.as_rotvec(), joints=[]),
    )
    goal = Goal(attitude=last.as_matrix(), joints=np.zeros(0), slew_angle=0.999 * np.pi)
    scene = make_scene(scenario, goal)
    path = straight_paths(Scenes([scene]), [replace(scenario.search, clearance=0.0)])[0]
    assert (path is not None) == stays


@pytest.mark.parametrize(
    ("half_angle_deg", "step"), [(0.5, np.deg2rad(1.0)), (0.02, 1e-3), (2.8, np.deg2rad(5.6)), (2.9, None)]
)
def test_steps_are_shorter_only_where_zones_are_narrow(half_angle_deg, step):
    scenario = slew_that_keeps_the_link(half_angle_deg, past_the_sun=True)
    goal = Goal(attitude=np.eye(3), joints=np.zeros(2), slew_angle=0.0)
    shorter = in_narrow_zones(scenario, make_scene(scenario, goal))
    assert (shorter is None) == (step is None)
    if shorter is not None:
        assert shorter.attitude_step == pytest.approx(step)
        assert in_narrow_zones(scenario, shorter) is None


def test_steps_are_short_for_what_a_tube_leaves_of_a_zone():
    tube = jp.Robust(attitude_error=np.deg2rad(0.2))
    scenario = replace(slew_that_keeps_the_link(0.5), robust=tube)
    goal = Goal(attitude=np.eye(3), joints=np.zeros(2), slew_angle=0.0)
    shorter = in_narrow_zones(scenario, make_scene(scenario, goal))
    assert shorter is not None
    assert shorter.attitude_step == pytest.approx(np.deg2rad(0.6))
