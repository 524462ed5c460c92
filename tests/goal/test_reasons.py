"""Words on why no attitude lets devices point at their targets, where the best attitude is known."""

from dataclasses import replace

import numpy as np
from builders import make_observer

import jaxplan as jp
from jaxplan.goal import decompose
from jaxplan.goal.reasons import apart, off
from jaxplan.model.tabulation import tabulate

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
        f"{one.name} and {other.name} are {between:.6g} deg apart, their targets {180 - between:.6g} deg"
    )
