"""Plans within a tube: whatever errors of attitude and joints are within it, nothing is broken."""

import re
from dataclasses import replace

import numpy as np
import pytest
from builders import make_observer
from dense import joint_limits
from reference import attitudes_of, joints_of, state_margins, unit
from scipy.spatial.transform import Rotation
from wheels import random_wheels, with_wheels

import jaxplan as jp
from jaxplan.planner.proving import check_margins
from jaxplan.planner.steps import find_goals
from jaxplan.planner.tube_room import with_advice
from jaxplan.planner.validity import start_breaches
from jaxplan.schema import parse_scenario
from jaxplan.schema.reading import dump_scenario, with_settings

ROUNDING = 1e-9  # rad
ROBUST = jp.Robust(attitude_error=np.deg2rad(0.4), joint_error=np.deg2rad(0.3), torque_reserve=12.0)
KINDS = ("keep_out", "keep_in", "hard_keep_out", "hard_keep_in", "held_links")
OTHERS = ("beams", "carried", "moving", "mixed", "terminal_masks", "fields")
STATES = 10_000


def perturbed(plan, robust, rng, instants=200):
    """Margins by name, and joints, of states off a plan, half of them at instants where margins are least."""
    trajectory, craft, scenario = plan.trajectory, plan.scenario.spacecraft, plan.scenario
    dense = np.linspace(0, trajectory.duration, 2001)
    margins = state_margins(scenario, attitudes_of(trajectory, dense), joints_of(trajectory, dense)[0], dense)
    least = np.min([*margins.values()] or [dense], axis=0)
    near = dense[np.argsort(least)[: instants // 2]]
    times = np.concatenate([near, rng.uniform(0, trajectory.duration, instants - len(near))])
    time = np.repeat(times, STATES // instants)
    turn = Rotation.from_rotvec(robust.attitude_error * unit(rng.standard_normal((len(time), 3))))
    attitudes = attitudes_of(trajectory, times).repeat(STATES // instants, axis=0) @ turn.as_matrix()
    off = robust.joint_error * rng.choice([-1.0, 1.0], (len(time), craft.joint_count))
    joints = joints_of(trajectory, times)[0].repeat(STATES // instants, axis=0) + off
    return state_margins(scenario, attitudes, joints, time), joints


def broken(plan, robust, seed):
    """How deep perturbed states are within what they break, rad: zones and masks, and ends of ranges."""
    margins, joints = perturbed(plan, robust, np.random.default_rng(seed))
    ranges = joint_limits(plan.scenario.spacecraft)[0]
    beyond = np.maximum(ranges[:, 0] - joints, joints - ranges[:, 1]) if joints.size else np.zeros((1, 1))
    assert not any(np.isnan(margin).any() for margin in margins.values())
    return -min([np.min(margin) for margin in margins.values()], default=np.inf), np.max(beyond)


def check_kinds(kinds, seeds):
    """Plans with a tube bear all errors within it, and enough plans without one do not."""
    scenes = [jp.random_scenario(seed, kind) for kind in kinds for seed in seeds]
    with_tube = jp.plan_batch([replace(scene, robust=ROBUST) for scene in scenes], progress=False)
    for plan in with_tube:
        assert plan.ok, f"{plan.scenario.name}: {plan.message}"
    failed = 0
    for seed, (plan, bare) in enumerate(zip(with_tube, jp.plan_batch(scenes, progress=False), strict=True)):
        deep, beyond = broken(plan, ROBUST, seed)
        assert deep <= ROUNDING, f"{plan.scenario.name} is broken by {np.rad2deg(deep)} deg"
        assert beyond <= ROUNDING, f"{plan.scenario.name}: a joint is {np.rad2deg(beyond)} deg out of range"
        failed += max(broken(bare, ROBUST, seed)) > np.deg2rad(0.05)
    return failed, len(scenes)


def test_no_error_within_the_tube_breaks_anything():
    failed, _ = check_kinds(("hard_keep_out", "any_spacecraft"), (0, 2))
    assert failed >= 2  # of the plans without a tube, so that the check sees what it is for


@pytest.mark.slow
def test_no_error_within_the_tube_breaks_anything_of_any_kind():
    failed, count = check_kinds((*KINDS, "any_spacecraft"), range(3))
    assert failed >= count // 2
    failed, count = check_kinds(OTHERS, range(2))
    assert failed >= count // 3


@pytest.fixture(scope="module")
def plain():
    """A plan without a tube."""
    return jp.plan(jp.paper_case(2), progress=False)


def asked(plan, **errors):
    """A plan as if its scenario asked for a tube."""
    return replace(plan, scenario=replace(plan.scenario, robust=jp.Robust(**errors)))


def test_the_certificate_takes_off_what_the_tube_takes_by_its_own_reckoning(plain):
    """Of a plan that knows nothing of it: margins fall by the sum of the angles, and then they break."""
    margins = {(one.zone, one.device): one.bound for one in check_margins(plain)}
    swing = 2 * np.arccos(np.cos(np.deg2rad(0.2) / 2) ** 2)
    lost = np.deg2rad(0.3) + swing
    errors = {"attitude_error": np.deg2rad(0.3), "joint_error": np.deg2rad(0.2)}
    for one in check_margins(asked(plain, **errors)):
        assert one.bound == pytest.approx(margins[one.zone, one.device] - lost, abs=2e-4)
    assert jp.certify(asked(plain, **errors)).certified
    assert not jp.certify(asked(plain, attitude_error=np.deg2rad(1.2))).certified
    beyond = jp.certify(asked(plain, joint_error=np.deg2rad(2.5)))
    assert any("yaw" in fault or "pitch" in fault for fault in beyond.faults)
    for robust, word in (
        (jp.Robust(attitude_error=-1.0), "robust has errors"),
        (jp.Robust(joint_error=np.deg2rad(60.0)), "of the range of"),
        (jp.Robust(attitude_error=np.deg2rad(89.0)), "certified"),
    ):
        found = jp.certify(replace(plain, scenario=replace(plain.scenario, robust=robust)))
        assert not found.certified
        assert word in "; ".join(found.faults) or word == "certified"


@pytest.mark.parametrize("what", ["torque", "momentum"])
def test_torque_and_momentum_are_kept_back_of_boxes_and_wheels(what):
    array = random_wheels(4, seed=1)
    if what == "momentum":
        array = tuple(replace(wheel, momentum=0.15 * wheel.momentum, stored=0.0) for wheel in array)
    scenes = [with_wheels(array, allocation) for allocation in ("pseudo_inverse", "minimax")]
    box = {"torque": {"torque_limit": 0.05}, "momentum": {"wheel_momentum_limit": 0.5}}[what]
    scenes.append(replace(scenes[0], spacecraft=replace(scenes[0].spacecraft, wheels=(), **box)))
    reserve = jp.Robust(**{f"{what}_reserve": 20.0})
    of_wheels, of_box = {
        "torque": ("wheel_torques", "torque"),
        "momentum": ("wheel_momenta", "wheel_momentum"),
    }[what]
    for scene in scenes:
        bare, kept = jp.plan_batch([scene, replace(scene, robust=reserve)], progress=False)
        name = of_wheels if scene.spacecraft.wheels else of_box
        assert kept.ok
        for plan, most in ((bare, 1.0), (kept, 0.8)):
            found = jp.certify(replace(plan, scenario=scene)).peaks[name]
            assert found <= most + 1e-9
        # the peak of a plan is of what is left, so the one without a reserve is beyond it
        told = jp.certify(replace(bare, scenario=replace(scene, robust=reserve)))
        assert told.peaks[name] == pytest.approx(bare.certificate.peaks[name] / 0.8, rel=2e-6)
        assert bare.certificate.peaks[name] > 0.8
        assert kept.certificate.peaks[name] <= 1 + 1e-9
        assert kept.trajectory.duration >= bare.trajectory.duration


def test_a_start_that_only_the_tube_breaks_says_so(plain):
    scene = plain.scenario
    beam = scene.spacecraft.boresights(scene.start.attitude, scene.start.joints)[0]
    aside = unit(np.cross(beam, [0.2, 0.3, 1.0]))
    axis = np.cos(0.3) * beam + np.sin(0.3) * aside
    near = jp.KeepOut(name="near", direction=axis, half_angle=0.29, devices=("terminal-1",))
    tube = jp.Robust(attitude_error=np.deg2rad(1.0), joint_error=np.deg2rad(0.25))
    shut = jp.plan(replace(scene, keep_out=(*scene.keep_out, near), robust=tube), progress=False, throw=False)
    assert shut.status is jp.Status.INVALID_START
    assert "near" in shut.message
    named = "without the tube of [robust] (attitude_error_deg = 1, joint_error_deg = 0.25) it breaks nothing"
    assert named in shut.message
    deep = replace(near, half_angle=0.31)
    shut = jp.plan(replace(scene, keep_out=(deep,), robust=tube), progress=False, throw=False)
    assert "this counts with the tube of [robust]" in shut.message


def test_rates_count_whatever_the_tube(plain):
    scene = replace(plain.scenario, robust=ROBUST)
    quick = replace(scene.start, angular_velocity=np.array([9.0, 0.0, 0.0]))
    (told,) = start_breaches(replace(scene, start=quick))
    assert told.startswith("the platform's rate about x is ")


def test_a_tube_that_leaves_no_goal_is_told_with_one_that_does():
    craft, toward = make_observer(), np.array([0.0, 0.6, 0.8])
    name = craft.instruments[0].name
    axis = Rotation.from_rotvec([np.deg2rad(3.0), 0, 0]).apply(toward)
    zone = jp.KeepIn(name="link", direction=axis, half_angle=np.deg2rad(5.0), devices=(name,))
    scene = jp.Scenario(
        name="tube",
        spacecraft=craft,
        start=jp.point(craft, {name: axis}),
        goal=jp.Targets.of({name: toward}),
        keep_in=(zone,),
        robust=jp.Robust(attitude_error=np.deg2rad(4.0)),
    )
    plan = jp.plan(scene, throw=False, progress=False)
    assert plan.status is jp.Status.INVALID_GOAL
    told = float(re.search(r"there is one with attitude_error_deg = ([0-9.]+)", plan.message)[1])
    assert 1.8 <= told <= 2.0  # of the 2 deg that the zone leaves, in steps of an eighth of a degree
    assert "(attitude_error_deg = 4, joint_error_deg = 0) is too wide for a goal" in plan.message
    borne = replace(plan.scenario, robust=jp.Robust(attitude_error=np.deg2rad(told)))
    assert not isinstance(find_goals(borne), jp.Plan)
    farther = Rotation.from_rotvec([np.deg2rad(6.0), 0, 0]).apply(toward)
    outside = replace(zone, direction=farther)  # so that the target is out of it without errors, too
    failed = jp.plan(replace(scene, keep_in=(outside,), start=jp.point(craft, {name: farther})), throw=False)
    assert not failed.ok
    assert "too wide" not in failed.message


def test_what_a_tube_leaves_at_an_end_is_told_of_motions_that_fail():
    craft = make_observer()
    name = craft.instruments[0].name
    beam = craft.instruments[0].boresight
    axis = Rotation.from_rotvec(np.deg2rad(10.0) * unit(np.cross(beam, [0.3, 0.5, 0.1]))).apply(beam)
    zone = jp.KeepOut(name="sun", direction=axis, half_angle=np.deg2rad(7.5), devices=(name,))
    rest = jp.GivenState(rotation_vector=np.zeros(3), joints=np.clip(np.zeros(3), *craft.joint_ranges.T))
    goal = replace(rest, rotation_vector=-0.5 * unit(np.cross(beam, axis)))
    for error, words in (
        (2.0, "0.50 deg of room to zone sun at the start: lower its errors, or begin"),
        (1.0, ""),
    ):
        robust = jp.Robust(attitude_error=np.deg2rad(error))
        scene = jp.Scenario(
            name="tube", spacecraft=craft, start=rest, goal=goal, keep_out=(zone,), robust=robust
        )
        failed = jp.Plan(scenario=scene, status=jp.Status.LIMITS_TOO_TIGHT, message="it is")
        told = with_advice(failed).message
        assert told.startswith("it is")
        assert (words in told) if words else told == "it is"


def test_files_settings_and_goals_know_the_tube(plain, tmp_path):
    scene = replace(plain.scenario, robust=ROBUST)
    again = parse_scenario(dump_scenario(scene))
    assert again == scene
    assert again.robust.attitude_error == ROBUST.attitude_error
    assert "[robust]" in dump_scenario(scene)
    assert "[robust]" not in dump_scenario(plain.scenario)
    wider = with_settings(plain.scenario, {"robust.attitude_error_deg": 0.4})
    assert wider.robust.attitude_error == ROBUST.attitude_error
    assert wider.robust.joint_error == 0
    plan = jp.plan(scene, progress=False)
    plan.save(tmp_path / "plan.json")
    read = jp.load_plan(tmp_path / "plan.json")
    assert read.scenario == scene
    assert jp.certify(read).min_margin == plan.certificate.min_margin
    assert "0.4 deg of attitude and 0.3 deg of joints, with 12 % of torque kept back" in str(plan)
    jp.report_html(plan, tmp_path / "plan.html", frequencies=[0.5])
    text = (tmp_path / "plan.html").read_text()
    assert "Errors that the plan bears" in text
    assert 'id="figure-spectrum"' in text


def test_no_errors_are_no_tube_but_one_of_no_width(plain):
    """A table of zeros, as tuning begins with, gives the plan that there is without it."""
    none = jp.plan(replace(plain.scenario, robust=jp.Robust()), progress=False)
    assert none.certificate.min_margin == pytest.approx(plain.certificate.min_margin, abs=1e-9)
    assert none.trajectory.duration == pytest.approx(plain.trajectory.duration, rel=1e-9)
