"""The matrix of slew times: entries are those of plans, states fit together, and nothing gets lost."""

import csv
import json
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import jaxplan as jp
from jaxplan.model.time_shift import later
from jaxplan.slew_matrix.matrix import MATRIX
from jaxplan.slew_matrix.problem import make_problem
from jaxplan.study.store import StudyFolderError

deg = np.deg2rad
SUN = np.array([-0.8, 0.0, -0.6])
CRAFT = jp.Spacecraft(
    instruments=[jp.Instrument(name="telescope", boresight=[0, 0, 1])],
    drives=[
        jp.Drive(
            name="array", axis=[0, 1, 0], boresight=[0, 0, -1], range=deg([-170, 170]), rate_limit=deg(2),
            acceleration_limit=deg(1),
        )
    ],
    rate_limit=deg([1.5, 1.5, 0.8]),
    acceleration_limit=deg(0.3),
)  # fmt: skip
ZONES = (jp.KeepOut(name="sun", direction=SUN, half_angle=deg(40), devices=["telescope"]),)
QUICK = {"trajectory.first_guesses": 0}
STRETCHED = {"trajectory.duration_s": "stretched"}


def toward(longitude, latitude):
    a, b = deg([longitude, latitude])
    return np.array([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])


def looking(longitude, latitude):
    return jp.Targets.of(
        {"telescope": toward(longitude, latitude)}, prefer=[jp.Wish(device="array", direction=SUN)]
    )


GOALS = {
    "vela": looking(60, 30),
    "crab": {"telescope": toward(100, -30)},
    "sunny": {"telescope": SUN},
    "given": jp.GivenState(rotation_vector=[0.1, 0.2, 0.3], joints=[0.2]),
}
NAMES = [*GOALS]


def times_of(goals=GOALS, **more):
    return jp.slew_times(CRAFT, goals, **{"keep_out": ZONES, "settings": QUICK, "progress": False} | more)


@pytest.fixture(scope="module")
def slews(tmp_path_factory):
    return times_of(out=tmp_path_factory.mktemp("slews"))


@pytest.fixture(scope="module")
def folder(slews, tmp_path_factory):
    return next(tmp_path_factory.getbasetemp().glob("slews*"))


def pairs_of(slews):
    return [(a, b) for a in slews.names for b in slews.names if a != b and "sunny" not in (a, b)]


def test_each_time_is_that_of_a_certified_plan(slews):
    for first, second in pairs_of(slews):
        place = NAMES.index(first), NAMES.index(second)
        plan = jp.plan(slews.scenario(first, second), progress=False)
        assert plan.certificate.certified
        assert slews.times[place] == pytest.approx(plan.trajectory.duration, abs=1e-6)
        assert slews.bounds[place] == pytest.approx(plan.duration_bound, abs=1e-9)
        assert slews.angles[place] == pytest.approx(plan.goal.slew_angle, abs=1e-9)
        assert slews.bounds[place] <= slews.times[place]
        assert slews.certified[place]
        assert slews.status[place] == "OK"


def test_slews_fit_together_as_each_ends_in_the_state_in_which_the_next_begins(slews):
    for first, second in pairs_of(slews):
        state, goal = slews.state(second), slews.scenario(first, second).goal
        assert np.array_equal(goal.rotation_vector, state.rotation_vector)
        assert np.array_equal(goal.joints, state.joints)
        assert np.array_equal(slews.scenario(second, first).start.joints, state.joints)


def test_the_state_of_targets_meets_them_and_turns_least_from_the_reference(slews):
    state = slews.state("crab")
    assert state.attitude @ [0, 0, 1] == pytest.approx(toward(100, -30), abs=1e-7)
    apart = np.arccos(toward(100, -30)[2])  # the reference is the identity, with the telescope along z
    assert np.linalg.norm(state.rotation_vector) == pytest.approx(apart, abs=1e-6)
    assert not np.any(state.angular_velocity)
    wished = slews.state("vela")
    normal = wished.attitude @ CRAFT.drives[0].boresight
    assert wished.attitude @ [0, 0, 1] == pytest.approx(toward(60, 30), abs=1e-7)
    assert np.isfinite(normal).all()


def test_goals_without_a_state_have_no_times_and_a_reason(slews):
    out = NAMES.index("sunny")
    for place in [(out, 0), (0, out), (out, out), (3, out)]:
        assert slews.times[place] == np.inf
        assert not slews.certified[place]
        assert slews.status[place] == "INVALID_GOAL"
        assert "sunny: telescope is 40 deg inside keep-out zone sun" in slews.messages[place]
    assert slews.state("sunny") is None
    with pytest.raises(ValueError, match="no slew to plan: INVALID_GOAL: sunny: telescope"):
        slews.scenario("vela", "sunny")


def test_a_goal_is_no_time_away_from_itself(slews):
    inside = [0, 1, 3]
    assert np.all(slews.times[inside, inside] == 0)
    assert np.all(slews.certified[inside, inside])
    bad = times_of({"broken": jp.GivenState(rotation_vector=[0, -2.2, 0], joints=[0.2])})
    assert bad.times.tolist() == [[np.inf]]
    assert bad.status[0, 0] == "INVALID_START"
    assert "inside keep-out zone sun" in bad.messages[0, 0]


def test_ticks_are_rounded_up_and_mark_what_cannot_be_flown(slews):
    ticks = slews.ticks(0.5)
    there = np.isfinite(slews.times)
    assert np.all(0.5 * ticks[there] >= slews.times[there])
    assert np.all(0.5 * (ticks[there] - 1) < slews.times[there])
    assert np.all(ticks[~there] == -1)
    for step in (0, np.nan, 1e7, "1"):
        with pytest.raises(ValueError, match="step"):
            slews.ticks(step)


def test_rows_and_file_say_the_same(slews, tmp_path):
    slews.to_csv(tmp_path / "slews.csv")
    with (tmp_path / "slews.csv").open(newline="") as file:
        read = list(csv.DictReader(file))
    rows = list(slews.rows())
    assert len(rows) == len(read) == 12
    assert [row["from"] for row in read] == [row["from"] for row in rows]
    for row, told in zip(rows, read, strict=True):
        assert told["time_s"] == ("" if row["time_s"] is None else str(row["time_s"]))
    json.dumps(rows, allow_nan=False)


def test_a_file_holds_the_matrix(slews, folder, tmp_path):
    slews.save(tmp_path / "one.npz")
    slews.save(tmp_path / "two.npz")
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    for path in (tmp_path / "one.npz", folder):
        read = jp.load_slew_times(path)
        assert str(read) == str(slews)
        for name in ("times", "bounds", "angles", "certified", "status", "messages"):
            assert np.array_equal(getattr(read, name), getattr(slews, name))
        with pytest.raises(ValueError, match="holds no goals"):
            read.scenario(0, 1)
    with pytest.raises(OSError, match="No such file"):
        jp.load_slew_times(tmp_path / "three.npz")
    with pytest.raises(OSError, match=r"holds no slew_times\.npz, which jp\.slew_times writes at its end"):
        jp.load_slew_times(tmp_path)


def test_damaged_files_are_refused(slews, tmp_path):
    path = tmp_path / "slews.npz"
    slews.save(path)
    whole = path.read_bytes()
    for bad in (b"", b"nonsense", whole[: len(whole) // 2]):
        path.write_bytes(bad)
        with pytest.raises(ValueError, match="no file of slew times"):
            jp.load_slew_times(path)
    for change, message in (
        ({"times": np.full((4, 4), np.nan)}, "negative or no number"),
        ({"times": np.zeros((3, 3))}, "times is of shape"),
        ({"status": np.zeros((4, 4))}, "status is of float64"),
    ):
        slews.save(path)
        with np.load(path) as held:
            np.savez(path, **{name: held[name] for name in held.files} | change)
        with pytest.raises(ValueError, match=message):
            jp.load_slew_times(path)


def test_it_shows_itself(slews):
    assert repr(slews) == "<Slew times of slew times: goals 4; planned 6; statuses OK 6, INVALID_GOAL 6>"
    text = str(slews)
    assert "slews         6 OK, 6 INVALID_GOAL" in text
    assert f"{slews.times[0, 1]:.2f}" in text
    assert "<table>" in slews._repr_html_()


def test_pairs_that_are_not_asked_for_are_not_planned(slews):
    asked = np.zeros((4, 4), bool)
    asked[0, 1] = True
    few = times_of(pairs=asked)
    assert few.times[0, 1] == pytest.approx(slews.times[0, 1], abs=1e-6)
    assert few.statuses == {"not asked": 11, "OK": 1}
    assert np.isinf(few.times).sum() == 15
    assert few.complete


def test_a_scenario_brings_its_zones_settings_and_start(slews):
    start = slews.state("given")
    scene = jp.Scenario(
        name="survey", spacecraft=CRAFT, start=start, goal=looking(0, 0), keep_out=ZONES,
        trajectory=jp.TrajectorySettings(first_guesses=0),
    )  # fmt: skip
    some = {"crab": GOALS["crab"], "given": start}
    found = jp.slew_times(scene, some, progress=False, settings=STRETCHED)
    assert str(found).startswith("Slew times of survey")
    turned = found.state("crab").attitude.T @ start.attitude
    least = np.arccos(np.clip(start.attitude[:, 2] @ toward(100, -30), -1, 1))
    assert np.arccos((np.trace(turned) - 1) / 2) == pytest.approx(least, abs=1e-6)
    assert np.all(found.times[found.times > 0] > slews.bounds[1, 3] / 2)
    assert found.scenario(0, 1).trajectory.duration == "stretched"


@pytest.mark.slow
def test_free_slews_take_no_longer_than_those_to_the_states(slews):
    asked = np.zeros((4, 4), bool)
    asked[3, :2] = True
    free = times_of(free=True, pairs=asked)
    assert free.certified[3, :2].all()
    assert np.all(free.times[3, :2] <= slews.times[3, :2] + 1e-6)
    assert free.scenario("given", "crab").goal.devices == ("telescope",)


def moved(rate, first, times=(0.0, 100.0, 200.0, 300.0, 400.0)):
    return jp.DirectionPath.through(times, [toward(first + rate * time, 10) for time in times])


PLAIN = jp.Spacecraft(
    instruments=[jp.Instrument(name="telescope", boresight=[0, 0, 1])],
    rate_limit=deg(1.5),
    acceleration_limit=deg(0.3),
)


@pytest.mark.slow
def test_moving_targets_and_zones_are_met_where_they_are_after_the_departure():
    station = moved(0.05, 20)
    goals = {"station": {"telescope": station}, "star": {"telescope": toward(40, 30)}}
    earth = jp.KeepOut(name="earth", direction=moved(0.06, 200), half_angle=deg(40), devices=["telescope"])
    departures = np.array([0.0, 120.0])
    slews = jp.slew_times(
        PLAIN, goals, keep_out=[earth], departures=departures, progress=False,
        settings=STRETCHED,
    )  # fmt: skip
    assert slews.times.shape == (2, 2, 2)
    assert slews.certified.all()
    for number, departure in enumerate(departures):
        start = slews.state("station", number)
        assert start.attitude[:, 2] == pytest.approx(station.at(departure), abs=1e-7)
        turning = start.attitude @ np.cross(start.angular_velocity, [0, 0, 1])
        assert turning == pytest.approx(station.rate(departure), abs=1e-7)
        plan = jp.plan(slews.scenario("star", "station", number), progress=False)
        assert slews.times[number, 1, 0] == pytest.approx(plan.trajectory.duration, abs=1e-6)
        end = plan.trajectory.sample(plan.trajectory.duration)
        met = station.at(departure + plan.trajectory.duration)
        assert end.attitude[:, 2] == pytest.approx(met, abs=1e-6)
        zone = plan.scenario.keep_out[0].path
        assert zone.at(30.0) == pytest.approx(earth.path.at(departure + 30.0), abs=1e-9)
    assert slews.times[0, 1, 0] != pytest.approx(slews.times[1, 1, 0], abs=1e-3)
    assert np.array_equal(slews.state("star", 0).rotation_vector, slews.state("star", 1).rotation_vector)
    assert [row["departure_s"] for row in slews.rows()] == [0.0, 0.0, 120.0, 120.0]


@pytest.mark.slow
def test_hidden_targets_have_a_reason_while_they_are_hidden():
    hidden = (jp.Hidden(target="station", by="the Earth", start=-10.0, end=250.0),)
    goals = {
        "station": jp.Targets.of({"telescope": replace(moved(0.05, 20), hidden=hidden)}),
        "star": {"telescope": toward(40, 30)},
    }
    asked = np.array([[False, True], [False, False]])
    slews = jp.slew_times(
        PLAIN, goals, departures=[0.0, 300.0], pairs=asked, progress=False,
        settings=STRETCHED,
    )  # fmt: skip
    assert slews.status[0, 0, 1] == "INVALID_GOAL"
    assert "station, the target of telescope, is hidden by the Earth" in slews.messages[0, 0, 1]
    assert slews.certified[1, 0, 1]


def test_a_later_scene_has_a_later_epoch():
    start = jp.GivenState(rotation_vector=[0, 0, 0], joints=[0])
    scene = jp.Scenario(
        name="epoch", spacecraft=CRAFT, start=start, goal=start,
        epoch=np.datetime64("2026-01-01T00:00:00", "ns"),
        keep_out=[jp.KeepOut(name="earth", direction=moved(0.06, 200), half_angle=0.5)],
    )  # fmt: skip
    after = later(scene, 1.5)
    assert after.epoch == np.datetime64("2026-01-01T00:00:01.5", "ns")
    assert after.keep_out[0].path.at(10.0) == pytest.approx(scene.keep_out[0].path.at(11.5), abs=1e-12)


def test_states_of_still_targets_leave_zones_that_move_to_the_plans():
    earth = jp.KeepOut(name="earth", direction=moved(0.06, 60), half_angle=deg(40), devices=["telescope"])
    group = [
        replace(earth, any_of="either"),
        jp.KeepOut(
            name="fixed", direction=toward(60, 30), half_angle=0.1, devices=["telescope"], any_of="either"
        ),
    ]
    problem = make_problem(
        CRAFT, {"vela": GOALS["vela"]}, zones={"keep_out": group, "keep_in": (), "joint_bounds": ()},
        departures=None, start=None, free=False, settings=None,
    )  # fmt: skip
    assert isinstance(problem.states[0][0], jp.GivenState)
    assert "INVALID_START" in problem.stay(0, 0).status


def row_of_stars():
    return {str(number): looking(50 + 9 * number, 20) for number in range(6)}


SCRIPT = """
import sys
sys.path.insert(0, sys.argv[1])
from test_slew_times import STRETCHED, row_of_stars, times_of
times_of(row_of_stars(), out=sys.argv[2], chunk=1, settings=STRETCHED)
"""


@pytest.mark.slow
def test_a_killed_call_goes_on_to_the_same_bytes(tmp_path):
    table, command = tmp_path / "killed" / "table.jsonl", [sys.executable, "-c", SCRIPT]
    process = subprocess.Popen([*command, str(Path(__file__).parent), str(tmp_path / "killed")])
    while process.poll() is None and not (table.exists() and table.stat().st_size):
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    done = len(table.read_bytes().splitlines())
    assert 0 < done < 30
    assert not (tmp_path / "killed" / MATRIX).exists()
    again = times_of(row_of_stars(), out=tmp_path / "killed", settings=STRETCHED)
    whole = times_of(row_of_stars(), out=tmp_path / "whole", settings=STRETCHED)
    assert again.complete
    assert np.array_equal(again.times, whole.times)
    for name in (MATRIX, "table.jsonl", "study.json"):
        assert (tmp_path / "killed" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_a_folder_of_another_problem_is_refused(slews, folder):
    before = sorted((path.name, path.read_bytes()) for path in folder.iterdir())
    with pytest.raises(StudyFolderError, match=r"holds another study .*scenarios"):
        times_of(out=folder, keep_out=[replace(ZONES[0], half_angle=deg(41))])
    with pytest.raises(StudyFolderError, match="scenes 6 there, 2 here"):
        times_of({name: GOALS[name] for name in ("vela", "crab")}, out=folder)
    assert sorted((path.name, path.read_bytes()) for path in folder.iterdir()) == before


def test_a_folder_that_is_done_needs_no_planning(slews, folder, monkeypatch):
    monkeypatch.setattr("jaxplan.study.run.plan_chunk", None)
    again = times_of(out=folder)
    assert np.array_equal(again.times, slews.times)


def test_an_executor_gives_the_same_matrix(slews):
    with ThreadPoolExecutor(2) as threads:
        found = times_of(workers=threads, chunk=1)
    assert np.array_equal(found.times, slews.times)
    assert found.status.tolist() == slews.status.tolist()


def test_interrupted_pairs_say_so(monkeypatch, tmp_path):
    def interrupt(chunk):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxplan.study.run.plan_chunk", interrupt)
    found = times_of(out=tmp_path)
    assert not found.complete
    assert found.statuses == {"not done": 6, "INVALID_GOAL": 6}
    assert np.isinf(found.times[0, 1])
    assert not (tmp_path / MATRIX).exists()


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"goals": {}}, ValueError, "goals is empty"),
        ({"goals": 3}, TypeError, "goals must be several goals, not int"),
        ({"goals": [3]}, TypeError, r"goals\['0'\] must be a GivenState, Targets, or a dict"),
        ({"goals": {3: GOALS["vela"]}}, TypeError, "a name in goals must be a str"),
        ({"goals": {"": GOALS["vela"]}}, ValueError, "must have 1 to 100 characters"),
        (
            {"goals": [{"radar": SUN}]},
            jp.ScenarioError,
            r"(?s)goals\['0'\].*no such device, the devices are array, telescope",
        ),
        ({"goals": [{"telescope": 2 * SUN}]}, jp.ScenarioError, r"goals\['0'\].*unit vector"),
        (
            {"goals": [jp.GivenState(rotation_vector=[0, 0, np.nan], joints=[0])]},
            jp.ScenarioError,
            r"goals\['0'\].*rotation_vector",
        ),
        ({"keep_out": [replace(ZONES[0], half_angle=4.0)]}, jp.ScenarioError, "half_angle"),
        ({"keep_out": 3}, TypeError, "keep_out must be several zones"),
        ({"departures": 3.0}, ValueError, r"departures: must be of shape \(k,\)"),
        ({"departures": []}, ValueError, r"departures: must be of shape"),
        ({"departures": "soon"}, ValueError, "departures = 'soon'"),
        ({"departures": [3.0, np.nan]}, ValueError, r"departures\[1\] = nan: must lie in \[0, 1e7\]"),
        ({"departures": [-1.0]}, ValueError, r"departures\[0\] = -1: must lie in"),
        ({"departures": [3.0, 3.0]}, ValueError, r"departures\[1\] = 3: must be later than 3"),
        (
            {"departures": [400.0], "goals": {"x": {"telescope": moved(0.05, 20)}}},
            ValueError,
            r"departures\[0\] = 400: must be earlier than 400 s, until when .* of telescope, of goal x",
        ),
        ({"pairs": np.ones((2, 2), bool)}, ValueError, r"pairs: must be of shape \(4, 4\), not \(2, 2\)"),
        ({"pairs": np.ones((4, 4))}, TypeError, "pairs must be an array of True and False"),
        ({"start": SUN}, TypeError, "start must be a GivenState"),
        ({"free": 1}, TypeError, "free must be True or False"),
        ({"settings": {"trajectory.duration_s": 80.0}}, ValueError, r"duration_s = 80: must be \"minimum\""),
        ({"settings": {"trajectory.speed": 80.0}}, jp.ScenarioError, "speed"),
        ({"settings": [1]}, TypeError, "settings must be a dict"),
        ({"workers": 0}, ValueError, "workers = 0: must be at least 1"),
        ({"workers": "two"}, TypeError, "workers must be"),
        ({"out": 3}, TypeError, "out must be a path"),
        ({"chunk": 0}, ValueError, "chunk = 0"),
    ],
)
def test_bad_arguments_are_refused_by_name(arguments, error, message):
    with pytest.raises(error, match=message):
        times_of(**arguments)


def test_bad_problems_and_places_are_refused_by_name(slews):
    with pytest.raises(TypeError, match="problem must be a Spacecraft or a Scenario, not str"):
        jp.slew_times("craft", GOALS)
    scene = slews.scenario("vela", "crab")
    with pytest.raises(ValueError, match="keep_out: the scenario has zones of its own"):
        jp.slew_times(scene, GOALS, keep_out=ZONES)
    for call, message in (
        (lambda: slews.scenario("vela", "moon"), "second = 'moon': must be one of vela, crab"),
        (lambda: slews.scenario(4, 0), "first = 4: must be one of"),
        (lambda: slews.scenario("vela", "vela"), "must be another goal"),
        (lambda: slews.state("vela", 1), r"departure = 1: must be an integer in \[0, 0\]"),
        (lambda: slews.state(True), "goal = True"),
    ):
        with pytest.raises(ValueError, match=message):
            call()
