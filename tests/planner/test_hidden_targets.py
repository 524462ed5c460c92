"""Targets that are hidden when the manoeuvre ends: refused with when they are seen, or waited for."""

from dataclasses import replace

import numpy as np
import pytest
from builders import great_circle, make_scenario

import jaxplan as jp
from jaxplan import sky
from jaxplan.cli import main
from jaxplan.model.directions import DirectionPath
from jaxplan.model.goals import Targets
from jaxplan.model.hidden_spans import Hidden
from jaxplan.model.status import Status
from jaxplan.planner.steps import find_goals

KNOWN = 200.0


def path_of(first, toward, *spans):
    times = np.linspace(0, KNOWN, 21)
    path = DirectionPath.through(times, great_circle(np.array(first), np.array(toward), 1e-3, times))
    return replace(path, hidden=tuple(Hidden(target=name, by=by, start=a, end=b) for name, by, a, b in spans))


def scenario_of(duration, *spans, second=()):
    """Two terminals that turn by some 40 deg to targets of which the first is hidden for some spans."""
    scenario = make_scenario(2)
    targets = (
        path_of([0.8, 0.6, 0.0], [0.0, 0.0, 1.0], *spans),
        path_of([-0.8, 0.0, 0.6], [0, 1, 0.0], *second),
    )
    settings = replace(scenario.trajectory, duration=duration)
    return replace(scenario, goal=Targets(directions=targets), trajectory=settings)


EARLY = ("lisbon", "its horizon", 0.0, 75.0)
LATE = ("ahead", "the Earth", 60.0, KNOWN + 1e-6)


def test_a_target_that_is_hidden_in_the_end_is_refused_with_when_it_is_seen():
    plan = jp.plan(scenario_of(40.0, EARLY), throw=False)
    assert plan.status is Status.INVALID_GOAL
    assert plan.goal is None
    assert plan.message == (
        "lisbon, the target of terminal-1, is hidden by its horizon when the motion ends, at 40 s; "
        "it is seen from 75 s on: set trajectory.duration_s = 75, "
        'or "minimum" to have it found'
    )
    with pytest.raises(jp.PlanningError, match="lisbon, the target of terminal-1"):
        jp.plan(scenario_of(40.0, EARLY))


def test_the_time_that_is_named_is_one_at_which_all_are_seen():
    spans = [("lisbon", "its horizon", 0.0, 50.0014), ("lisbon", "the Moon", 40.0, 70.123456)]
    scenario = scenario_of(45.0, *spans, second=[("ahead", "the Earth", 65.0, 90.5001)])
    found = find_goals(scenario, 45.0)
    assert "hidden by its horizon and the Moon when the motion ends, at 45 s; it is seen from 70.13 s on" in (
        found.message
    )
    assert "set trajectory.duration_s = 90.51, when all targets are seen," in found.message
    assert not isinstance(find_goals(scenario, 90.51), jp.Plan)
    assert find_goals(scenario, 80.0).message.startswith(
        "ahead, the target of terminal-2, is hidden by the Earth"
    )


def test_a_given_duration_at_whose_end_all_are_seen_is_planned():
    plan = jp.plan(scenario_of(80.0, EARLY))
    assert plan.ok
    assert plan.trajectory.duration == 80.0


@pytest.mark.parametrize("duration", ["minimum", "stretched"])
def test_a_shortest_manoeuvre_waits_until_the_target_is_seen_and_no_longer(duration):
    free = jp.plan(scenario_of(duration))
    plan = jp.plan(scenario_of(duration, EARLY))
    assert free.trajectory.duration < 75
    assert plan.ok
    assert plan.goal.time == plan.trajectory.duration == 75.0


def test_a_shortest_manoeuvre_that_ends_while_the_target_is_seen_is_as_without_the_spans():
    plain = jp.plan(scenario_of("minimum"))
    for span in (("lisbon", "its horizon", 0.0, 2.0), ("lisbon", "its horizon", 100.0, 150.0)):
        plan = jp.plan(scenario_of("minimum", span))
        np.testing.assert_array_equal(plan.trajectory.coefficients, plain.trajectory.coefficients)


def test_a_window_that_closes_before_the_motion_is_there_is_not_the_one():
    shortest = jp.plan(scenario_of("minimum")).trajectory.duration
    closed = ("lisbon", "its horizon", 0.5 * shortest, 2.0 * shortest)
    plan = jp.plan(scenario_of("minimum", closed))
    assert plan.ok
    assert plan.trajectory.duration == pytest.approx(2 * shortest)


def test_two_targets_wait_for_each_other_and_may_never_be_seen_together():
    later = ("ahead", "the Earth", 70.0, 110.0)
    assert jp.plan(scenario_of("minimum", EARLY, second=[later])).trajectory.duration == 110.0
    plan = jp.plan(scenario_of("minimum", EARLY, second=[LATE]), throw=False)
    assert plan.status is Status.INVALID_GOAL
    assert (
        "change goal.targets, or let it be known for longer, by more samples or a longer sky.for_duration_s"
        in (plan.message)
    )
    never = jp.plan(scenario_of(KNOWN, LATE), throw=False)
    assert "hidden by the Earth when the motion ends, at 200 s; it is not seen again in" in never.message


def test_a_plan_without_a_goal_for_what_is_hidden_is_written_and_read_back(tmp_path):
    plan = jp.plan(scenario_of(40.0, EARLY), throw=False)
    plan.save(tmp_path / "plan.json")
    again = jp.load_plan(tmp_path / "plan.json")
    assert again.message == plan.message
    assert again.goal is None
    assert again.scenario == plan.scenario
    assert again.scenario.goal.directions[0].hidden == plan.scenario.goal.directions[0].hidden
    assert jp.report_html(again, tmp_path / "report.html") or (tmp_path / "report.html").exists()


def test_the_certificate_knows_a_target_that_is_hidden_in_the_end():
    plan = jp.plan(scenario_of(80.0, EARLY))
    dark = replace(plan, scenario=scenario_of(80.0, LATE))
    (fault,) = jp.certify(dark).faults
    assert fault.startswith(
        "ahead, the target of terminal-1, is hidden by the Earth when the motion ends, at 80 s;"
    )
    assert fault.endswith("it is not seen again in all the 200 s that are known")
    assert jp.certify(plan).certified


def test_validate_tells_of_a_hidden_target(tmp_path, capsys):
    jp.save_scenario(scenario_of(40.0, EARLY), tmp_path / "scene.toml")
    assert main(["validate", str(tmp_path / "scene.toml")]) == 1
    told = capsys.readouterr().out
    assert "the goal breaks a constraint: lisbon, the target of terminal-1, is hidden by its horizon" in told
    jp.save_scenario(scenario_of(90.0, EARLY), tmp_path / "scene.toml")
    assert main(["validate", str(tmp_path / "scene.toml")]) == 0


def test_a_picture_of_the_ground_is_taken_when_it_is_above_the_horizon(tmp_path):
    pytest.importorskip("erfa", reason="pyerfa is not installed")
    here = sky.KeplerOrbit(
        semi_major_axis=6900.0, eccentricity=0.01, inclination=1.702, node=3.84, perigee=1.571, anomaly=0.0
    )
    lisbon = sky.GroundPoint(latitude=0.6758, longitude=-0.1595, minimum_elevation=np.deg2rad(20))
    asked = {"epoch": "2026-06-20T09:30:00", "observer": here, "duration_s": 1500.0}
    target = sky.target(lisbon, name="lisbon", **asked)
    down = sky.path("nadir", **asked)
    scenario = replace(make_scenario(1), goal=Targets(directions=(target,)))
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, duration="minimum"))
    plan = jp.plan(scenario)
    assert plan.ok
    end = plan.trajectory.duration
    beam = plan.goal.attitude @ _beam(plan)
    at = {"epoch": asked["epoch"], "times": end}
    there, place = sky.positions(here, **at), sky.positions(lisbon, **at)
    line = (place - there) / np.linalg.norm(place - there)
    np.testing.assert_allclose(beam, line, atol=1e-8)
    above = np.pi / 2 - np.arccos(
        -line @ place / np.linalg.norm(place)
    )  # of a sphere, 0.2 deg from the ellipsoid's
    assert np.rad2deg(above) == pytest.approx(20, abs=0.25)
    assert down.at(end) @ line > 0


def _beam(plan):
    """Boresight of the only terminal at the goal, body axes."""
    yaw, pitch = plan.goal.joints
    azimuth = yaw + plan.scenario.spacecraft.terminals[0].mount
    return np.array([np.cos(pitch) * np.cos(azimuth), np.cos(pitch) * np.sin(azimuth), np.sin(pitch)])
