"""Plans of random spacecraft: what is certified keeps all that is stated, and what fails says why."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import make_scenario
from dense import breaches
from reference import assert_each, state_margins
from scipy.spatial.transform import Rotation
from trust.any_spacecraft import examine, scene

import jaxplan as jp
from jaxplan.model.constraints import constraint_margins
from jaxplan.model.constraints import state_margins as margins_of_rows
from jaxplan.model.zones import KeepOut

FEW = (52, 33, 12, 43)  # of two builds
MANY = 12
DRIVE = jp.Drive(
    name="array",
    axis=[0.7071, 0.7071, 0.0],
    boresight=[0.0, 0.8165, 0.5774],
    range=[-1.0, 1.0],
    rate_limit=0.01,
    acceleration_limit=0.002,
)


@pytest.fixture(scope="module")
def plans():
    return jp.plan_batch(map(scene, FEW), progress=False)


def test_what_is_certified_keeps_all_that_is_stated(plans):
    assert all(plan.ok for plan in plans)
    for plan in plans:
        examine(plan)


@pytest.mark.slow
def test_many_are_certified_and_the_others_say_why():
    found = jp.plan_batch(map(scene, range(MANY)), progress=False)
    for plan in found:
        examine(plan)
    assert sum(plan.ok for plan in found) >= MANY - 1


def test_files_hold_scenarios_and_plans_to_the_last_bit(plans, tmp_path):
    for plan in plans:
        jp.save_scenario(plan.scenario, tmp_path / "scene.toml")
        plan.save(tmp_path / "plan.json")
        again = jp.load_plan(tmp_path / "plan.json")
        pairs = (
            (plan.scenario, jp.load_scenario(tmp_path / "scene.toml")),
            (plan.scenario, again.scenario),
            (plan.trajectory, again.trajectory),
        )
        for one, other in pairs:
            (leaves, tree), (others, other_tree) = jax.tree.flatten(one), jax.tree.flatten(other)
            assert tree == other_tree
            for own, read in zip(leaves, others, strict=True):
                np.testing.assert_array_equal(own, read)
        assert jp.certify(again).certified


def test_margins_are_those_of_what_is_stated_and_never_above_the_distance_from_a_field():
    for seed in range(40):
        scenario = jp.random_scenario(seed, "any_spacecraft")
        craft, rows, rng = scenario.spacecraft, scenario.constraints, np.random.default_rng(seed)
        attitudes = Rotation.random(400, rng=rng).as_matrix()
        joints = rng.uniform(*craft.joint_ranges.T, (400, craft.joint_count))
        sights = rows.sights(craft.gimbals, craft.fixed_boresights)
        found = constraint_margins(rows, margins_of_rows(rows, sights, attitudes, joints))
        stated = state_margins(scenario, attitudes, joints, np.zeros(400))
        zones = scenario.zones
        for name, margin in stated.items():
            own = [zone >= 0 and name in (zones[zone].any_of, zones[zone].name) for zone in rows.zone]
            least = np.min(found[:, own], axis=1)
            if name.startswith("mask"):  # one that lies beyond the range is none of the spacecraft's
                assert_each(least, ">=", margin - 1e-12)
                np.testing.assert_allclose(least[margin < 0], margin[margin < 0], rtol=0, atol=1e-12)
                continue
            if name != "beside the field":
                np.testing.assert_allclose(least, margin, rtol=0, atol=1e-12)
                continue
            half_angle = next(zone.half_angle for zone in zones if zone.name == name)
            assert_each(least, "<=", margin + 1e-12)
            # short of it by a factor of sqrt 2 at a corner, and by what a field of a pyramid adds there
            near = (margin + half_angle > 0) & (margin + half_angle < np.deg2rad(30))
            assert_each(least[near] + half_angle, ">=", (margin[near] + half_angle) / 1.6)


@pytest.mark.slow
def test_where_bent_curves_swing_over_the_edge_of_a_zone_the_motion_along_the_path_is_taken():
    scenario = jp.random_scenario(967, "any_spacecraft")
    shortest = replace(scenario.trajectory, duration="minimum")
    plan = jp.plan(replace(scenario, trajectory=shortest))
    assert breaches(plan) == []


def test_the_check_sees_whatever_is_broken(plans):
    plan = plans[-1]  # of a terminal with a target and a mask, and a drive
    scenario, craft = plan.scenario, plan.scenario.spacecraft
    states = plan.trajectory.sample(np.linspace(0, plan.trajectory.duration, 101))
    middle = {"joints": states.joints[50], "attitude": states.attitude[50]}
    beam = craft.boresights(middle["attitude"], middle["joints"])[0]
    name, terminal = craft.device_names[0], craft.terminals[0]

    def found(**changes):
        return breaches(replace(plan, scenario=replace(scenario, **changes)))

    def with_terminal(**changes):
        return {"spacecraft": replace(craft, terminals=(replace(terminal, **changes), *craft.terminals[1:]))}

    assert found() == []
    ahead = KeepOut(name="ahead", direction=beam, half_angle=0.02, devices=(name,))
    assert found(keep_out=(ahead,))[0].startswith("ahead is broken by")
    inside = replace(ahead, direction=None, axis_body=middle["attitude"].T @ beam)
    assert found(keep_out=(inside,))[0].startswith("ahead is broken by")
    corners = middle["joints"][[0, len(craft.terminals)]] + 0.02 * np.array([[1, 0], [-1, 1], [-1, -1]])
    assert found(**with_terminal(mask=(corners,)))[0].startswith(f"mask 1 of {name} is broken by")
    assert any("range is" in one for one in found(**with_terminal(pitch_range=np.array([-1e-3, 1e-3]))))
    turned = plans[0].scenario
    slow = replace(turned, spacecraft=replace(turned.spacecraft, rate_limit=1e-4))
    assert any(one.startswith("rate is") for one in breaches(replace(plans[0], scenario=slow)))
    assert any(
        "misses its target" in one
        for one in found(goal=replace(scenario.goal, directions=-scenario.goal.directions))
    )
    assert any("is not held" in one for one in found(goal=replace(scenario.goal, hold=(name,))))
    start = replace(scenario.start, joints=scenario.start.joints + 1e-6)
    assert any("the start is missed" in one for one in found(start=start))


def test_a_spacecraft_typed_with_four_digits_is_certified():
    scenario = make_scenario(1, 1)
    (terminal,), (camera,) = scenario.spacecraft.terminals, scenario.spacecraft.instruments
    mount = jp.Mount(yaw_axis=[0.5774, 0.5774, 0.5774], boresight=[0.8165, -0.4082, -0.4082])
    field = {"field_of_view": [0.2, 0.1], "up": [0.0009, 0.0, 1.0]}
    craft = replace(
        scenario.spacecraft,
        terminals=(replace(terminal, mount=None, mounting=mount, **field),),
        drives=(DRIVE,),
        instruments=(replace(camera, boresight=[0.5774, 0.5774, 0.5774]),),
    )
    goal, start = (
        replace(end, joints=[*end.joints, 0.0], joint_rates=None) for end in (scenario.goal, scenario.start)
    )
    zone = jp.KeepOut(
        name="sun",
        direction=[-0.5774, -0.5774, 0.5774],
        half_angle=0.05,
        devices=[terminal.name],
        outside="field_of_view",
    )
    plan = jp.plan(
        replace(scenario, spacecraft=craft, start=start, goal=goal, keep_out=[zone]), progress=False
    )
    assert plan.certificate.certified
