"""Plans toward targets that move, among zones that move: held against the sky and against dense sampling."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import LOW_ORBIT, great_circle
from reference import assert_each, attitudes_of, boresights, joints_of, sampled
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan import sky
from jaxplan.model.directions import DirectionPath
from jaxplan.model.goals import Targets
from jaxplan.model.path import Goal
from jaxplan.model.scenario import known_until
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.planner.attempts import Attempts
from jaxplan.planner.clock import Clock
from jaxplan.planner.moving import Meeting, always, swept
from jaxplan.planner.proving import certify, check_margins
from jaxplan.planner.steps import GoalQuery, SearchQuery, find_goals
from jaxplan.search import SearchResult, find_barrier, make_scene
from jaxplan.trajectory import Fit

EPOCH = "2026-03-20T12:00:00"


def satellite(node, latitude):
    return sky.CircularOrbit(
        altitude=550.0, inclination=np.deg2rad(53), node=np.deg2rad(node), latitude=np.deg2rad(latitude)
    )


HERE = satellite(10, 40)
TARGETS = {"fore": satellite(10, 60), "port": satellite(-5, 31), "starboard": satellite(25, 25)}


def with_duration(scenario, duration):
    return replace(scenario, trajectory=replace(scenario.trajectory, duration=duration))


@pytest.fixture(scope="module")
def scene():
    return jp.load_scenario(LOW_ORBIT)


@pytest.fixture(scope="module")
def plans(scene):
    durations = (80.0, "minimum", "stretched")
    return {duration: jp.plan(with_duration(scene, duration)) for duration in durations}


def end_of(plan):
    """Directions (n, 3) of the beams when the motion ends, and their rates, from what a trajectory is."""
    trajectory, craft = plan.trajectory, plan.scenario.spacecraft
    last, step = len(trajectory.breaks) - 2, 1e-3
    times = trajectory.duration + step * np.arange(-2, 3)
    attitude = attitudes_of(trajectory, times, np.full(5, last))  # of the last piece, also beyond its end
    found = boresights(craft, attitude, joints_of(trajectory, times)[0])[:, : len(craft.terminals)]
    return found[2], (8 * (found[3] - found[1]) - (found[4] - found[0])) / (12 * step)


@pytest.mark.parametrize("duration", [80.0, "minimum", "stretched"])
def test_every_beam_ends_on_its_target_and_turns_as_it_does(plans, duration):
    plan = plans[duration]
    assert plan.ok
    assert plan.goal.time == plan.trajectory.duration
    directions, rates = end_of(plan)
    for row, target in enumerate(TARGETS.values()):
        asked = {"epoch": EPOCH, "observer": HERE, "times": plan.trajectory.duration}
        assert np.linalg.norm(directions[row] - sky.directions(target, **asked)) <= 1e-8
        slip = rates[row] - sky.direction_rates(target, **asked)
        assert np.linalg.norm(slip) <= 1e-8
    assert np.linalg.norm(rates, axis=1).max() > 9e-4  # they do turn


@pytest.mark.slow
@pytest.mark.parametrize("duration", ["minimum", "stretched"])
def test_free_end_accelerations_do_not_make_it_longer(plans, scene, duration):
    settings = replace(scene.trajectory, duration=duration, end_acceleration="free")
    plan = jp.plan(replace(scene, trajectory=settings))
    assert plan.certificate.certified
    assert plan.trajectory.duration <= (1 + 1e-3) * plans[duration].trajectory.duration  # goals are others


def test_a_given_duration_is_kept_and_the_shortest_is_near_its_bound(plans):
    assert plans[80.0].trajectory.duration == 80.0
    shortest = plans["minimum"].trajectory.duration
    assert shortest <= 1.04 * plans["minimum"].duration_bound
    assert shortest < plans["stretched"].trajectory.duration < 80.0


@pytest.mark.parametrize("duration", [80.0, "minimum", "stretched"])
def test_margins_to_zones_that_move_are_proved_below_every_sample_and_near_the_least(plans, duration):
    plan = plans[duration]
    zones = [*plan.scenario.keep_out, *plan.scenario.keep_in]
    margins = sampled(plan.trajectory, plan.scenario.spacecraft, zones, 20_001)
    assert_each(margins, ">=", 0)
    assert plan.certificate.min_margin <= margins.min()
    assert plan.certificate.min_margin >= margins.min() - 0.01 * margins.min() - 1e-5
    for one in check_margins(plan):
        alone = replace(next(zone for zone in zones if zone.name == one.zone), devices=(one.device,))
        least = sampled(plan.trajectory, plan.scenario.spacecraft, [alone], 20_001).min()
        assert least - 0.01 * least - 1e-5 <= one.bound <= least


def test_final_rates_are_those_at_which_the_goal_of_step_1_moves(plans, scene):
    plan, step = plans[80.0], 0.25
    near = [jp.plan(with_duration(scene, 80.0 + sign * step)).goal for sign in (-1, 1)]
    turn = Rotation.from_matrix(near[0].attitude.T @ near[1].attitude).as_rotvec() / (2 * step)
    # turn is in axes of the goal, but for a quarter of a second's turn
    np.testing.assert_allclose(plan.goal.angular_velocity, turn, atol=2e-6)
    np.testing.assert_allclose(
        plan.goal.joint_rates, (near[1].joints - near[0].joints) / (2 * step), atol=2e-6
    )
    assert np.linalg.norm(turn) > 1e-4
    end = plan.trajectory.sample(80.0)
    np.testing.assert_allclose(end.angular_velocity, plan.goal.angular_velocity, atol=1e-10)
    np.testing.assert_allclose(end.joint_rates, plan.goal.joint_rates, atol=1e-10)


def test_a_plan_is_read_back_to_the_bit_and_checked_again(plans, tmp_path):
    plan = plans[80.0]
    plan.save(tmp_path / "plan.json")
    again = jp.load_plan(tmp_path / "plan.json")
    for name in ("attitude", "joints", "slew_angle", "time", "angular_velocity", "joint_rates"):
        np.testing.assert_array_equal(getattr(again.goal, name), getattr(plan.goal, name))
    assert certify(again).certified
    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "plan.json").read_bytes()
    content = json.loads((tmp_path / "plan.json").read_text())
    del content["goal"]["time"]
    (tmp_path / "wrong.json").write_text(json.dumps(content))
    with pytest.raises(jp.PlanFileError, match="time: missing"):
        jp.load_plan(tmp_path / "wrong.json")


def test_a_goal_that_does_not_meet_its_targets_is_not_certified(plans):
    plan = plans[80.0]
    goal = plan.goal
    wrong = {
        "the trajectory ends at 80 s": replace(goal, time=79.0),
        "fore points": replace(goal, joints=goal.joints + 2e-8 * np.eye(6)[0]),
        "starboard turns": replace(goal, joint_rates=goal.joint_rates + 2e-8 * np.eye(6)[5]),
        "port turns": replace(goal, angular_velocity=goal.angular_velocity + 1e-6),
        "points nan rad off": replace(goal, joints=np.full(6, np.nan)),
        "has no rates": Goal(attitude=goal.attitude, joints=goal.joints, slew_angle=goal.slew_angle),
    }
    for words, one in wrong.items():
        report = certify(replace(plan, goal=one))
        assert not report.certified
        assert any(words in fault for fault in report.faults), (words, report.faults)
    # the goal of an earlier instant, to which a motion could go as well
    early = jp.plan(with_duration(plan.scenario, 79.0)).goal
    assert not certify(replace(plan, goal=early)).certified


def test_start_and_goal_are_judged_by_zones_as_they_are_then(scene):
    craft = scene.spacecraft
    start = boresights(
        craft, Rotation.from_rotvec(scene.start.rotation_vector).as_matrix(), scene.start.joints
    )[0]
    goal = scene.goal.directions[1].at(80.0)
    aside = np.array([0.3, -0.5, 0.8])

    def passing(direction, when):
        """A zone that is at a direction at one time, and goes off it at half a degree a second."""
        times = np.linspace(0, 120, 121)
        return DirectionPath.through(times, great_circle(direction, aside, np.deg2rad(0.5), times - when))

    def planned(direction, when):
        zone = KeepOut(name="passing", direction=passing(direction, when), half_angle=np.deg2rad(4))
        return jp.plan(replace(scene, keep_out=(*scene.keep_out, zone)), throw=False)

    at_start = planned(start, 0.0)
    assert at_start.status is jp.Status.INVALID_START
    assert "fore is 4 deg inside keep-out zone passing" in at_start.message
    at_goal = planned(goal, 80.0)
    assert at_goal.status is jp.Status.INVALID_GOAL
    assert "port is 4 deg inside keep-out zone passing" in at_goal.message
    assert "after 80 s" in at_goal.message
    # where the goal will be, but long before: no reason not to go there
    assert planned(goal, 20.0).ok


def test_a_zone_that_sweeps_over_the_start_drives_the_device_away(scene):
    """A wider zone that stands still would hold the start, so that there would be no plan at all."""
    tracker = np.array([0.0, 0.0, 1.0]) @ Rotation.from_rotvec(scene.start.rotation_vector).as_matrix().T
    times = np.linspace(0, 120, 41)
    path = DirectionPath.through(
        times, great_circle(tracker, np.array([0.9, 0.1, -0.4]), np.deg2rad(0.25), times - 48.0)
    )
    zone = KeepOut(name="moon", direction=path, half_angle=np.deg2rad(6.0), devices=("star-tracker",))
    plan = jp.plan(replace(scene, keep_out=(*scene.keep_out, zone)), throw=False)
    assert plan.ok, plan.message
    assert sampled(plan.trajectory, scene.spacecraft, [zone], 20_001).min() >= 0


def row_of(scene, rows, zone):
    """Axis and half angle of a zone's row."""
    (row,) = np.flatnonzero(rows.zone == scene.zones.index(zone))
    return rows.axis[row], rows.half_angle[row]


def test_what_a_search_takes_for_moving_zones_leaves_both_ends_clear(plans, scene):
    plan = plans[80.0]
    attitude = Rotation.from_rotvec(scene.start.rotation_vector).as_matrix()
    seen = swept(scene, plan.goal)
    wide, still, link = (row_of(scene, seen, zone) for zone in (*scene.keep_out, *scene.keep_in))
    np.testing.assert_array_equal(still[0], scene.keep_out[1].direction)
    assert still[1] == scene.keep_out[1].half_angle
    times = np.linspace(0, 80, 50)
    ends = {
        "start": boresights(scene.spacecraft, attitude, scene.start.joints),
        "goal": boresights(scene.spacecraft, plan.goal.attitude, plan.goal.joints),
    }
    for directions in ends.values():
        assert_each(np.arccos(directions @ wide[0]), ">=", wide[1])
        assert np.arccos(directions[0] @ link[0]) <= link[1]
    # nothing here is near the Earth, so its cone holds it all the time
    apart = np.arccos(np.clip(scene.keep_out[0].direction.at(times) @ wide[0], -1, 1)).max()
    assert wide[1] >= scene.keep_out[0].half_angle + apart - 1e-9
    core = always(scene, plan.goal)
    assert row_of(scene, core, scene.keep_out[0])[1] <= scene.keep_out[0].half_angle - apart + 1e-9
    assert row_of(scene, core, scene.keep_in[0])[1] >= scene.keep_in[0].half_angle + np.deg2rad(2.4)


def ring(scene, device, axis, rate):
    """Zones that part a device's directions about an axis from all others, turning about another axis."""
    around = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    aside = np.linalg.svd(axis[None])[2][1:]
    times = np.linspace(0, 120, 25)
    zones = []
    for number, angle in enumerate(around):
        first = np.cos(0.35) * axis + np.sin(0.35) * (np.cos(angle) * aside[0] + np.sin(angle) * aside[1])
        turns = Rotation.from_rotvec(np.multiply.outer(rate * times, np.array([0.0, 0.6, 0.8])))
        path = DirectionPath.through(times, turns.apply(first))
        zones.append(
            KeepOut(name=f"ring {number}", direction=path, half_angle=np.deg2rad(9), devices=(device,))
        )
    return replace(scene, keep_out=(*scene.keep_out, *zones))


def test_no_path_is_only_claimed_of_what_is_forbidden_at_every_instant(scene):
    attitude = Rotation.from_rotvec(scene.start.rotation_vector).as_matrix()
    start = boresights(scene.spacecraft, attitude, scene.start.joints)[1]
    slow = jp.plan(ring(scene, "port", start, 1e-4), throw=False)
    assert slow.status is jp.Status.NO_PATH
    assert "overlap in a ring" in slow.message
    assert find_barrier(make_scene(slow.scenario, slow.goal, always(slow.scenario, slow.goal))) is not None
    quick = ring(scene, "port", start, 0.01)  # it is off the start before half of the time is over
    assert find_barrier(make_scene(quick, slow.goal, quick.constraints.at(0.0))) is not None
    assert find_barrier(make_scene(quick, slow.goal, always(quick, slow.goal))) is None
    # In a duration that is to be found, targets may move on; and zones, as long as they are known.
    free = with_duration(slow.scenario, "minimum")
    assert find_barrier(make_scene(free, slow.goal, always(free, slow.goal))) is None
    goal = scene.goal.at(slow.goal.time)
    for rate, duration, parted in ((1e-5, "minimum", True), (1.4e-3, 80.0, True), (1.4e-3, "minimum", False)):
        rings = with_duration(replace(ring(scene, "port", start, rate), goal=goal), duration)
        assert known_until(rings)[0] == 120 > slow.goal.time
        assert (find_barrier(make_scene(rings, slow.goal, always(rings, slow.goal))) is not None) == parted


def test_a_duration_beyond_what_is_known_is_missed_and_says_what_to_give(scene):
    def cut(direction):
        inner = direction.times <= 15.0
        return DirectionPath.through(direction.times[inner], direction.samples[inner])

    short = replace(
        with_duration(scene, "stretched"),
        goal=replace(scene.goal, directions=tuple(cut(one) for one in scene.goal.directions)),
    )
    plan = jp.plan(short, throw=False)
    assert plan.status is jp.Status.GOAL_MISSED
    assert "is known until 15 s, and the motion takes 21" in plan.message
    assert plan.path is not None
    with pytest.raises(
        ValueError, match=r"goal\.directions\[0\]\.times: must reach trajectory\.duration = 80"
    ):
        jp.plan(with_duration(short, 80.0))


def test_plans_made_together_are_those_made_one_by_one(plans, scene):
    plan, other = jp.plan_batch([scene, jp.paper_case(4)])
    assert plan.ok
    assert other.ok
    np.testing.assert_array_equal(plan.trajectory.coefficients, plans[80.0].trajectory.coefficients)
    assert plan.certificate.min_margin == plans[80.0].certificate.min_margin


def test_studies_take_scenarios_in_which_something_moves(scene):
    study = jp.run_study([scene, jp.paper_case(4)], progress=False)
    assert [row["status"] for row in study.table] == ["OK", "OK"]
    assert study.table[0]["duration_s"] == 80.0


@pytest.mark.parametrize("method", ["global", "paper"])
def test_what_a_goal_that_moves_needs_is_said_to_be_a_guess(scene, method):
    short = replace(scene, trajectory=replace(scene.trajectory, method=method, duration=14.0))
    plan = jp.plan(short, throw=False)
    assert plan.status is jp.Status.LIMITS_TOO_TIGHT
    assert re.search(r"this way takes about [\d.]+ s: set trajectory.duration_s to about", plan.message)
    assert ("stretched" in plan.message) is (method == "global")


def test_the_papers_method_meets_moving_targets_in_a_given_duration(scene):
    paper = replace(scene, trajectory=replace(scene.trajectory, method="paper"))
    plan = jp.plan(paper)
    assert plan.trajectory.method == "paper"
    directions, rates = end_of(plan)
    for row, target in enumerate(TARGETS.values()):
        asked = {"epoch": EPOCH, "observer": HERE, "times": 80.0}
        assert np.linalg.norm(directions[row] - sky.directions(target, **asked)) <= 1e-8
        assert np.linalg.norm(rates[row] - sky.direction_rates(target, **asked)) <= 1e-7


def test_a_fixed_goal_among_zones_that_move_is_met_at_rest(scene, plans):
    still = replace(
        plans[80.0].scenario,
        goal=Targets(
            directions=np.stack([one.at(40.0) for one in scene.goal.directions]),
            yaw_limit=scene.goal.yaw_limit,
            angular_velocity=np.zeros(3),
            joint_rates=np.zeros(6),
        ),
        keep_in=(),
    )
    for duration in (60.0, "minimum"):
        plan = jp.plan(with_duration(still, duration))
        np.testing.assert_array_equal(plan.goal.angular_velocity, 0)
        directions, rates = end_of(plan)
        np.testing.assert_allclose(directions, still.goal.directions, atol=1e-8)
        np.testing.assert_allclose(rates, 0, atol=1e-8)
        assert sampled(plan.trajectory, still.spacecraft, still.keep_out).min() >= 0
        turning = replace(plan.goal, angular_velocity=np.array([0.01, 0, 0]))
        assert certify(replace(plan, goal=turning)).certified  # what it says of itself does not matter
        asked = replace(still.goal, angular_velocity=np.array([0.01, 0, 0]))
        report = certify(replace(plan, scenario=replace(plan.scenario, goal=asked), goal=turning))
        assert any("goal" in fault and "0.01 rad/s" in fault for fault in report.faults), report.faults


@pytest.mark.parametrize("duration", ["minimum", "stretched"])
def test_derivatives_and_tuning_refuse_what_moves_in_a_time_that_is_not_given(plans, scene, duration):
    words = "low orbit .*has targets or zones that move: .* set trajectory.duration_s to a number"
    with pytest.raises(ValueError, match=words):
        jp.hold(plans[duration])
    with pytest.raises(ValueError, match=words):
        jp.follow(plans[80.0], with_duration(scene, duration))
    with pytest.raises(ValueError, match=words):
        jp.tune(with_duration(scene, duration), "effort", over=["trajectory.rate_weight"], steps=1)


def test_a_group_whose_zones_move_is_held_by_one_of_them_at_every_instant(scene):
    zones = tuple(
        KeepIn(
            name=f"link {terminal}",
            direction=scene.goal.directions[row],
            half_angle=np.deg2rad(40),
            devices=(terminal,),
            any_of="links",
        )
        for row, terminal in enumerate(TARGETS)
    )
    plan = jp.plan(replace(scene, keep_in=zones))
    margins = sampled(plan.trajectory, scene.spacecraft, zones, 20_001).max(axis=0)
    assert margins.min() >= 0
    assert plan.scenario.goal.moves


@pytest.mark.parametrize("timed", [jp.Status.OK, jp.Status.LIMITS_TOO_TIGHT])
def test_fits_that_do_not_settle_end_in_a_longer_time_or_miss_the_goal(scene, plans, timed):
    """Fits whose durations alternate, as where another number of intervals does."""
    asked, free_fits = [], []

    def fit(query):
        word = isinstance(query.settings.duration, str)
        asked.append((query.settings.duration, query.horizon, query.path.attitudes[-1]))
        duration = (20.0, 22.0)[len(asked) % 2] if word else query.settings.duration
        if word:
            free_fits.append((found.goal.time, duration))
        curve = plans[80.0].trajectory.scaled(duration / 80.0)
        return Fit(trajectory=curve, status=jp.Status.OK if word else timed, message="")

    free = with_duration(scene, "stretched")
    found = Meeting(free, plans[80.0].goal, plans[80.0].path)
    while found.need is not None:
        if isinstance(found.need, GoalQuery):
            found.accept_goals(find_goals(free, found.need.time))
        else:
            found.accept_fit(fit(found.need))
    last, time, node = asked[-1]
    assert last == time == found.goal.time
    np.testing.assert_array_equal(node, found.goal.attitude)
    if timed is jp.Status.OK:
        assert found.fit.status is timed
        assert any(own == time and 0.9 * time < took <= time for own, took in free_fits)
    else:
        assert found.fit.status is jp.Status.GOAL_MISSED
        assert found.fit.trajectory is None
        assert "still follow each other" in found.fit.message


def test_targets_that_ask_for_too_much_at_one_time_are_met_at_another(scene, plans):
    scenario = with_duration(scene, "minimum")
    curve = plans[80.0].trajectory
    late = replace(curve, breaks=3 * curve.breaks, joint_breaks=3 * curve.joint_breaks)
    assert late.duration > known_until(scenario)[0]
    attempts, asked = Attempts(scenario, Clock(np.inf)), []
    while attempts.need is not None:
        need = attempts.need
        if isinstance(need, GoalQuery):
            asked.append(need.time)
            attempts.accept_goals(find_goals(scenario, need.time))
        elif isinstance(need, SearchQuery):
            found = SearchResult(status=jp.Status.OK, path=plans[80.0].path, expansions=1)
            attempts.accept_path(found)
        else:
            attempts.accept_fit(Fit(trajectory=late, status=jp.Status.LIMITS_TOO_TIGHT, message="too quick"))
    assert len(asked) >= 3
    assert len(set(asked)) == len(asked)
    plan = attempts.result()
    assert plan.status is jp.Status.LIMITS_TOO_TIGHT
    assert plan.trajectory is None  # nobody knows where zones and targets are for so long
    assert plan.message == "too quick"


def test_a_second_look_takes_moving_zones_as_they_are_in_the_middle(plans, scene):
    middle = swept(scene, plans[80.0].goal, 0.0)
    axis, half_angle = row_of(scene, middle, scene.keep_out[0])
    np.testing.assert_allclose(axis, scene.keep_out[0].direction.at(40.0))
    assert half_angle == pytest.approx(scene.keep_out[0].half_angle, abs=1e-12)


@pytest.mark.parametrize("method", ["global", "paper"])
def test_a_spacecraft_that_stays_is_certified_for_all_of_a_given_time(method):
    craft = jp.Spacecraft(
        instruments=[jp.Instrument(name="tracker", boresight=[0, 0, 1])],
        rate_limit=0.05,
        acceleration_limit=0.03,
    )
    rest = jp.GivenState(rotation_vector=[0, 0, 0], joints=[])

    def hold(nearest, duration):
        angles = np.linspace(-1, 1, 41)
        seen = np.stack([np.sin(angles), np.full(41, np.tan(nearest)), np.cos(angles)], axis=1)
        sun = DirectionPath.through(
            np.linspace(0, 100, 41), seen / np.linalg.norm(seen, axis=1, keepdims=True)
        )
        return jp.Scenario(
            name="hold",
            spacecraft=craft,
            start=rest,
            goal=rest,
            keep_out=[KeepOut(name="sun", direction=sun, half_angle=0.17)],
            trajectory=jp.TrajectorySettings(method=method, duration=duration),
        )

    crossed, passed = (jp.plan(hold(nearest, 100.0), throw=False) for nearest in (0.0, 0.3))
    assert crossed.status is jp.Status.UNCERTIFIED
    assert "tracker is 9.74 deg inside the keep-out zone sun at t = 50" in crossed.message
    assert passed.ok
    assert passed.trajectory.duration == 100.0
    assert passed.certificate.min_margin == pytest.approx(0.3 - 0.17, abs=1e-3)
    at_once = [
        jp.plan(hold(0.0, word), throw=False) for word in ("stretched", "minimum") if method == "global"
    ]
    assert all(plan.ok and plan.trajectory.duration == plan.goal.time == 0.0 for plan in at_once)


def test_targets_that_move_apart_from_what_devices_can_do_are_told_by_their_angle():
    craft = jp.Spacecraft(
        instruments=tuple(
            jp.Instrument(name=name, boresight=np.array(axis))
            for name, axis in (("camera", [0.0, 0, 1]), ("star tracker", [0, 0.8, -0.6]))
        ),
        rate_limit=0.03,
        acceleration_limit=0.003,
    )
    times = np.linspace(0.0, 300.0, 31)
    around = np.stack([np.cos(1e-3 * times), np.sin(1e-3 * times), 0 * times], axis=1)
    across = np.stack([-around[:, 1], around[:, 0], around[:, 2]], axis=1)
    targets = {
        "camera": DirectionPath.through(times, around),
        "star tracker": DirectionPath.through(times, across),
    }
    start = jp.GivenState(rotation_vector=np.zeros(3), joints=np.zeros(0))
    asked = jp.Scenario(name="apart", spacecraft=craft, start=start, goal=Targets.of(targets))
    for duration in (90.0, "minimum"):
        plan = jp.plan(with_duration(asked, duration), throw=False, progress=False)
        assert plan.status is jp.Status.GOAL_UNREACHABLE
        assert "camera and star tracker are 126.87 deg apart, their targets 90 deg" in plan.message


@pytest.mark.slow
def test_the_shortest_motion_to_targets_that_move_is_looked_for_among_given_durations_too():
    image = jp.load_scenario(Path(__file__).parents[2] / "docs" / "gallery" / "earth-imaging.toml")
    given = jp.plan(with_duration(image, 11.9), progress=False)
    shortest = jp.plan(with_duration(image, "minimum"), progress=False)
    assert shortest.trajectory.duration <= given.trajectory.duration
    assert shortest.scenario.trajectory.duration == "minimum"
    assert certify(shortest).certified
