"""Words on why no attitude lets devices point at their targets, where the best attitude is known."""

import re
from dataclasses import replace

import numpy as np
import pytest
from builders import make_observer

import jaxplan as jp
from jaxplan.goal import decompose
from jaxplan.goal.aims import apart, off
from jaxplan.model.breaches import in_own_zone
from jaxplan.model.tabulation import tabulate
from jaxplan.planner.steps import find_goals
from jaxplan.planner.validity import contradictions

deg = np.deg2rad


def best(craft, targets):
    rest = np.clip(np.zeros(craft.joint_count), *craft.joint_ranges.T)
    found = decompose(craft, np.eye(3), targets, tabulate((), (), craft), start_joints=rest)
    assert not found.goals
    return found.aim_excesses


def test_all_that_are_as_far_off_at_best_are_told():
    mount = jp.Mount(yaw_axis=np.eye(3)[2], boresight=np.eye(3)[0])
    craft = make_observer()
    upright = replace(craft.terminals[0], mounting=mount, pitch_range=deg([0.0, 90.0]))
    camera = jp.Instrument(name="camera", boresight=np.eye(3)[2])
    craft = replace(craft, terminals=(upright,), instruments=(camera,))
    up = jp.Targets.of({"camera": np.eye(3)[2], "antenna": np.eye(3)[2]})
    # of 0.1 deg to the pole each has its part, the camera's one of two angles in its own axes
    part = 0.1 / (1 + np.sqrt(2))
    assert off(craft, up, best(craft, up)) == (
        f"camera is {0.1 - part:.4g} deg off its target and antenna pitch is {part:.4g} deg beyond its range "
        "of 0 to 89.9 deg"
    )


def test_two_instruments_are_told_with_both_angles_and_nothing_of_those_that_agree():
    craft = make_observer()
    one, other = craft.instruments[:2]
    targets = {one.name: one.boresight, other.name: other.boresight}
    assert apart(craft, jp.Targets.of(targets)) is None
    targets[other.name] = -other.boresight
    between = np.rad2deg(np.arccos(one.boresight @ other.boresight))
    assert apart(craft, jp.Targets.of(targets)) == (
        f"{one.name} and {other.name} are {between:.6g} deg apart, their targets {180 - between:.6g} deg: "
        f"they differ by {abs(2 * between - 180):.3g} deg and 2e-06 deg is tolerated"
    )


@pytest.mark.parametrize(
    ("direction", "shown"),
    [("sun", "'sun'"), ([0, 0, 1, 0], "[0, 0, 1, 0]"), ([0, 0, 1, 1, 0, 0], "[0, 0, 1, 1, 0, 0]")],
)
def test_a_target_that_is_no_direction_is_told_with_its_device(direction, shown):
    with pytest.raises(ValueError, match=re.escape(f"targets['camera'] = {shown}: must be a unit vector")):
        jp.Targets.of({"camera": direction})


def test_a_target_in_a_zone_of_its_own_device_is_told_whatever_the_attitude():
    craft = make_observer()
    name, other = craft.instruments[0].name, craft.instruments[1].name
    camera = replace(craft.instruments[0], field_of_view=deg([20.0, 10.0]), up=[0.0, 1.0, 0.0])
    craft = replace(craft, instruments=(camera, *craft.instruments[1:]))
    scene = jp.Scenario(
        name="own",
        spacecraft=craft,
        start=jp.GivenState(rotation_vector=np.zeros(3), joints=np.zeros(craft.joint_count)),
        goal=jp.Targets.of({name: [0.0, 0.0, 1.0]}),
    )
    axis = np.array([np.sin(deg(30.0)), 0.0, np.cos(deg(30.0))])
    corner = np.rad2deg(np.arctan(np.hypot(*np.tan(deg([10.0, 5.0])))))
    field = "field_of_view"
    for out, deep in (
        (jp.KeepOut(name="z", direction=axis, half_angle=deg(31.0)), "1 deg inside keep-out"),
        (jp.KeepOut(name="z", direction=axis, half_angle=deg(29.0)), None),
        (jp.KeepOut(name="z", direction=axis, half_angle=deg(31.0), devices=(other,)), None),
        (jp.KeepOut(name="z", direction=axis, half_angle=deg(31.0), any_of="g"), None),
        (jp.KeepOut(name="z", axis_body=axis, half_angle=deg(31.0), devices=(name,)), None),
        (jp.KeepOut(name="z", direction=axis, half_angle=deg(31.0), outside=field), "1 deg inside keep-out"),
        (jp.KeepOut(name="z", direction=axis, half_angle=deg(25.0), outside=field), None),
    ):
        told = in_own_zone(craft, (out,), scene.goal, 0.0)
        assert told == (
            None
            if deep is None
            else f"{name} is {deep} zone z at every attitude that points it at its target"
        )
    for zone, by in (
        (jp.KeepIn(name="z", direction=axis, half_angle=deg(29.0), devices=(name,)), 1.0),
        (jp.KeepIn(name="z", direction=axis, half_angle=deg(31.0), devices=(name,)), None),
        (jp.KeepIn(name="z", direction=axis, half_angle=0.0, devices=(name,), inside=field), 30 - corner),
    ):
        told = in_own_zone(craft, (zone,), scene.goal, 0.0)
        assert (
            (told is None)
            if by is None
            else told.startswith(f"{name} is {by:.4g} deg outside keep-in zone z")
        )


def test_a_goal_in_a_zone_of_its_own_device_is_named_before_any_other_zone():
    craft = make_observer()
    name, other = (one.name for one in craft.instruments[:2])
    toward = np.array([0.0, 0.6, 0.8])
    zones = (
        jp.KeepOut(name="all about", direction=[1.0, 0, 0], half_angle=deg(170.0), devices=(other,)),
        jp.KeepOut(name="own", direction=toward, half_angle=deg(3.0), devices=(name,)),
    )
    scene = jp.Scenario(
        name="own",
        spacecraft=craft,
        start=jp.GivenState(rotation_vector=np.zeros(3), joints=np.zeros(craft.joint_count)),
        goal=jp.Targets.of({name: toward}),
        keep_out=zones,
    )
    (told,) = contradictions(scene)
    assert told == f"{name} is 3 deg inside keep-out zone own at every attitude that points it at its target"
    found = find_goals(scene)
    assert found.status is jp.Status.GOAL_UNREACHABLE
    assert found.message == f"{told}: change goal.targets or the zone"
    assert contradictions(replace(scene, keep_out=zones[:1])) == ()
