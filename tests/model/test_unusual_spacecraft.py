"""Keep-in groups and spacecraft of instruments alone, from scenario to certificate, plan file and figures.

What a plan does is sampled in plain numpy from the definition of its trajectory (`manoeuvres`).
"""

from dataclasses import replace

import numpy as np
import pytest
from builders import avoids, look, make_relay, sees
from reference import assert_each, boresights, boresights_of, zone_margins
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.cli import main
from jaxplan.model.path import Goal
from jaxplan.planner.proving import certify
from jaxplan.search import make_scene

METHODS = ("mha", "rrt_connect")
INSTANTS = 6001

# The third camera looks along the axis of the turn, in no group: all scenes of three share their kernels.
PAIR = {"camera-1": look(0), "camera-2": look(-120), "camera-3": look(0, 90)}
CLOSE_PAIR = {**PAIR, "camera-2": look(-100)}
TRACKERS = {"tracker-1": look(0), "tracker-2": look(-50), "tracker-3": look(150, 40)}


def behind_the_sun(method: str) -> jp.Scenario:
    """Each camera holds for a part of the straight motion, which leads camera-1 through the Sun."""
    zones = sees("camera-1", 30, 0, 60), sees("camera-2", 10, 0, 60), avoids("Sun", 60, 5, 20)
    return make_relay(160, PAIR, *zones, method=method)


def out_of_reach(method: str) -> jp.Scenario:
    """On the straight motion camera-1 has left its cone before camera-2 is in its own."""
    zones = sees("camera-1", 20, 30, 45), sees("camera-2", 0, -30, 45), avoids("Moon", -60, 60, 10)
    return make_relay(120, CLOSE_PAIR, *zones, method=method)


def terminal_and_camera(method: str) -> jp.Scenario:
    """The terminal must follow its narrow cone until the platform has brought the camera into its own."""
    zones = sees("terminal-1", 60, 0, 5), sees("camera-1", 40, 0, 30)
    camera, yaws = {"camera-1": look(-100)}, ((60.0,), (20.0,))
    return make_relay(160, camera, *zones, method=method, mounts=(0.0,), yaws=yaws)


def one_tracker(method: str) -> jp.Scenario:
    return make_relay(120, {"tracker": look(0)}, avoids("Sun", 60, 3, 35), method=method)


def three_trackers(method: str) -> jp.Scenario:
    """Each tracker has its own exclusion angles about Sun and Earth; tracker-1's Sun is in the way.

    One of the others has to see its guide stars.
    """
    angles = {"tracker-1": (45, 40), "tracker-2": (20, 30), "tracker-3": (10, 25)}
    zones = [avoids(f"Sun for {name}", 60, 30, sun, name) for name, (sun, _) in angles.items()]
    zones += [avoids(f"Earth for {name}", 60, -80, earth, name) for name, (_, earth) in angles.items()]
    zones += [sees("tracker-2", 10, 0, 75), sees("tracker-3", 210, 40, 75)]
    return make_relay(120, TRACKERS, *zones, method=method)


def margins(plan: jp.Plan, instants: int = INSTANTS) -> tuple[np.ndarray, np.ndarray]:
    """Sampled margins (zones, k), rad, of the keep-out zones and of the keep-in zones each by itself."""
    scenario, trajectory = plan.scenario, plan.trajectory
    time = np.linspace(0, trajectory.duration, instants)
    zones = [*scenario.keep_out, *scenario.keep_in]
    table = zone_margins(trajectory, scenario.spacecraft, zones, time)
    return table[: len(scenario.keep_out)], table[len(scenario.keep_out) :]


def straight_margin(scenario: jp.Scenario) -> float:
    """The smallest margin of the straight motion about z, rad; a group counts as its best zone."""
    craft, goal = scenario.spacecraft, scenario.goal.rotation_vector[2]
    part = np.linspace(0, 1, 1001)[:, None]
    joints = scenario.start.joints + part * (scenario.goal.joints - scenario.start.joints)
    seen = boresights(craft, Rotation.from_rotvec(part * [0, 0, goal]).as_matrix(), joints)

    def inside(zone) -> np.ndarray:
        bound = [name in (zone.devices or craft.device_names) for name in craft.device_names]
        return zone.half_angle - np.arccos(np.clip(seen[:, bound] @ zone.direction, -1, 1))

    worst = [-np.max(inside(zone), axis=1) for zone in scenario.keep_out]
    groups = [np.min(inside(zone), axis=1) for zone in scenario.keep_in]
    worst += [np.max(groups, axis=0)] if groups else []
    return float(np.min(worst))


@pytest.fixture(scope="module")
def relay_plans() -> dict[str, jp.Plan]:
    return {method: jp.plan(behind_the_sun(method)) for method in METHODS}


def assert_certified(plan: jp.Plan) -> None:
    """The plan is proved, and so it looks when it is sampled."""
    keep_out, keep_in = margins(plan)
    worst = np.min([*np.min(keep_out, axis=1), *([np.min(np.max(keep_in, axis=0))] if len(keep_in) else [])])
    assert plan.certificate.certified
    assert worst >= 0
    assert plan.certificate.min_margin <= worst + 1e-9
    assert plan.certificate.min_margin >= worst - np.deg2rad(0.1)
    states = plan.trajectory.sample(np.array([0.0, plan.trajectory.duration]))
    turn = plan.scenario.goal.rotation_vector[2]
    goal = [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    np.testing.assert_allclose(states.attitude, [np.eye(3), goal], atol=1e-9)
    assert straight_margin(plan.scenario) < 0, "the straight motion is blocked"


@pytest.mark.parametrize("method", METHODS)
def test_a_group_changes_hands_on_the_way_round_a_keep_out_zone(relay_plans, method):
    plan = relay_plans[method]
    assert_certified(plan)
    _, cameras = margins(plan)
    np.testing.assert_array_less(np.min(cameras, axis=1), -1, err_msg="no camera holds throughout")
    assert cameras[0, 0] > 0 > cameras[1, 0]
    assert cameras[0, -1] < 0 < cameras[1, -1]


@pytest.mark.parametrize("method", METHODS)
def test_a_way_is_found_where_the_straight_motion_leaves_the_group(method):
    plan = jp.plan(out_of_reach(method))
    assert_certified(plan)
    np.testing.assert_array_less(np.min(margins(plan)[1], axis=1), 0)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_terminal_holds_a_narrow_cone_until_a_camera_takes_over(method):
    plan = jp.plan(terminal_and_camera(method))
    assert_certified(plan)
    terminal, camera = margins(plan)[1]
    assert min(terminal[0], camera[-1]) > 0 > max(terminal[-1], camera[0])
    handover = int(np.argmax(camera >= 0))
    assert_each(terminal[:handover], ">=", 0)
    duration = plan.trajectory.duration
    seen = boresights_of(
        plan.trajectory, plan.scenario.spacecraft, np.array([0.0, handover / 6000 * duration])
    )
    assert np.arccos(seen[0, 1] @ seen[1, 1]) > np.deg2rad(90), "the platform turned beneath it"


@pytest.mark.parametrize("method", METHODS)
def test_a_group_that_nothing_can_hold_in_between_is_named(method):
    """At most 20 + 45 + 45 deg lie between directions in the two cones, and the cameras are 120 deg apart."""
    zones = sees("camera-1", 20, 0, 45), sees("camera-2", 0, 0, 45), avoids("Sun", 60, 60, 5)
    scenario = make_relay(160, PAIR, *zones, method=method, max_expansions=40)
    with pytest.raises(jp.PlanningError, match="keep-in group relay is most in the way") as caught:
        jp.plan(scenario)
    assert caught.value.status is jp.Status.NODE_LIMIT
    behind = replace(scenario, goal=replace(scenario.goal, rotation_vector=np.array([0.0, 0.0, -2.8])))
    plan = jp.plan(behind, throw=False)
    assert plan.status is jp.Status.INVALID_GOAL
    assert "group relay" in plan.message


def test_the_certificate_sees_a_group_left_for_milliseconds():
    """Camera-1 leaves at 80 deg of the turn, camera-2 comes in there, give or take a hundredth."""
    early, late = (
        make_relay(160, PAIR, sees("camera-1", 30, 0, 50 + gap), sees("camera-2", 10, 0, 50 + gap))
        for gap in (0.01, -0.01)
    )
    wide = tuple(replace(zone, half_angle=np.deg2rad(60)) for zone in early.keep_in)
    plan = jp.plan(replace(early, keep_in=wide, search=replace(early.search, clearance=0.0)))
    assert certify(replace(plan, scenario=early)).certified
    left = replace(plan, scenario=late)
    assert_each(np.max(margins(left, 200)[1], axis=0), ">=", 0, "the samples see nothing")
    report = certify(left)
    assert not report.certified
    assert -np.deg2rad(0.0101) <= report.min_margin < 0
    (fault,) = report.faults
    assert "nearest to hold of its group" in fault


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("make", [one_tracker, three_trackers])
def test_a_spacecraft_of_trackers_alone_turns_round_the_sun(make, method):
    plan = jp.plan(make(method))
    assert_certified(plan)
    assert plan.path.joints.shape[1] == plan.goal.joints.size == 0
    assert {"yaw", "pitch", "joint_rates"}.isdisjoint(plan.certificate.peaks)


def test_a_tracker_may_look_where_another_must_not():
    plan = jp.plan(three_trackers("mha"))
    time = np.linspace(0, plan.trajectory.duration, INSTANTS)
    seen = boresights_of(plan.trajectory, plan.scenario.spacecraft, time)
    from_sun = np.rad2deg(np.arccos(seen @ look(60, 30))).min(axis=0)
    assert from_sun[0] >= 45 > from_sun[1] >= 20


@pytest.mark.parametrize("method", METHODS)
def test_plans_of_groups_are_kept_and_proved_again(relay_plans, method, tmp_path):
    plan = relay_plans[method]
    plan.save(tmp_path / "plan.json")
    again = jp.load_plan(tmp_path / "plan.json")
    assert again.scenario == plan.scenario
    assert [zone.any_of for zone in again.scenario.keep_in] == ["relay"] * 2
    assert certify(again).min_margin == plan.certificate.min_margin
    apart = replace(plan.scenario, keep_in=tuple(replace(z, any_of=None) for z in plan.scenario.keep_in))
    assert not certify(replace(again, scenario=apart)).certified


def test_the_command_line_draws_instruments_and_groups(relay_plans, tmp_path, monkeypatch, capsys):
    jp.save_scenario(behind_the_sun("mha"), tmp_path / "scene.toml")
    assert main(["plan", str(tmp_path / "scene.toml"), "-o", str(tmp_path)]) == 0
    assert f"{np.rad2deg(relay_plans['mha'].certificate.min_margin):.3f} deg" in capsys.readouterr().out
    pictures = {file.stem for file in tmp_path.glob("*.png")}
    assert pictures == {"overview", "spacecraft", "sphere", "rates", "accelerations", "margins"}
    axes = jp.plot.sphere(relay_plans["mha"])
    assert [text.get_text() for text in axes.texts] == [
        "Sun",
        "camera-1 at 30\nfor camera-1\nany of relay",
        "camera-2 at 10\nfor camera-2\nany of relay",
    ]
    assert "keep-in zone,\nany of its group" in {text.get_text() for text in axes.get_legend().get_texts()}


def test_terminals_are_held_by_their_own_zone_or_by_the_nearest_of_a_group():
    stations = [sees(name, azimuth, 0, 5) for name in ("terminal-1", "terminal-2") for azimuth in (60, -60)]
    yaws = ((60.0, -20.0, 0.0), (20.0, -30.0, 0.0))
    for extra, held, azimuths in (
        ([], [True, True, False], [60, -60]),
        ([sees("terminal-1", 45, 0, 30, group=None)], [True, True, False], [45, -60]),
        ([sees("terminal-3", 90, 0, 30)], [True, True, True], [60, -60, 90]),
    ):
        scenario = make_relay(150, {}, *stations, *extra, mounts=(0.0, 180.0, 90.0), yaws=yaws)
        turn = np.deg2rad(150)
        attitude = [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
        goal = Goal(attitude=np.array(attitude), joints=scenario.goal.joints, slew_angle=turn)
        axes = make_scene(scenario, goal).held_axes
        assert list(axes) == list(np.flatnonzero(held))
        for axis, azimuth in zip(axes.values(), azimuths, strict=True):
            np.testing.assert_allclose(axis, look(azimuth))
