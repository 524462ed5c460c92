"""The command on timelines, and what other commands do with them: one small timeline, planned once."""

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import jaxplan as jp
from jaxplan.cli import main
from jaxplan.model.epochs import parse_epoch
from jaxplan.timeline.events import events

FILE = """
schema_version = 1
kind = "timeline"
name = "still"
epoch_utc = 2026-06-20T09:30:00
[timeline]
object_name = "SAT"
[spacecraft]
rate_limit_deg_s = 1.0
acceleration_limit_deg_s2 = 0.5
[[spacecraft.instrument]]
name = "telescope"
boresight = [0, 0, 1]
[start]
attitude = [0, 0, 0]
[[activity]]
name = "wait"
idle = true
until_utc = 2026-06-20T09:30:20
[[activity]]
name = "star"
track = { telescope = [0, 0.6, 0.8] }
for_s = 5
until_s = 300
"""


def run(capsys, *words):
    code = main([str(word) for word in words])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder with the file and what the command makes of it, exports too."""
    place = tmp_path_factory.mktemp("timeline")
    (place / "day.toml").write_text(FILE)
    words = ["timeline", place / "day.toml", "-o", place / "out", "--export", "csv", "aem", "--export", "csv"]
    assert main([str(word) for word in words]) == 0
    return place


@pytest.mark.slow
def test_all_is_written_and_reads_back(folder):
    out = folder / "out"
    names = {"timeline.toml", "plan.npz", "activities.csv", "segments.csv", "interruptions.csv"}
    names |= {"events.csv", "motion.csv", "motion.aem"}
    plan = jp.load_timeline_plan(out / "plan.npz")
    figures = {f"{name}.png" for name, _ in jp.plot.figures(plan)}
    assert figures
    assert {file.name for file in out.iterdir()} == names | figures
    assert plan.ok
    assert plan.timeline == jp.load_timeline(out / "timeline.toml") == jp.load_timeline(folder / "day.toml")
    assert "OBJECT_NAME = SAT" in (out / "motion.aem").read_text()


@pytest.mark.slow
def test_exports_of_an_earlier_plan_are_named_and_those_of_this_one_are_not(folder, capsys, tmp_path):
    for name in ("motion.csv", "motion.aem"):
        (tmp_path / name).write_text("earlier")
    code, _, err = run(capsys, "timeline", folder / "day.toml", "-o", tmp_path, "--export", "csv")
    assert code == 0
    assert f"{tmp_path / 'motion.aem'}: of an earlier plan, make it anew" in err
    assert f"wrote {tmp_path / 'motion.csv'}" in err
    assert (tmp_path / "motion.aem").read_text() == "earlier"


@pytest.mark.slow
def test_the_tables_say_what_the_plan_does(folder):
    plan = jp.load_timeline_plan(folder / "out" / "plan.npz")
    with (folder / "out" / "activities.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == ["wait", "star"]
    for row, one in zip(rows, plan.activities, strict=True):
        assert float(row["end_s"]) == one.end
        after = parse_epoch(row["end_utc"]) - plan.scene.epoch
        assert after / np.timedelta64(1, "s") == pytest.approx(one.end, abs=6e-4)
    with (folder / "out" / "events.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    assert [row["text"] for row in found] == [event.text for event in events(plan)]
    assert found
    with (folder / "out" / "segments.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["name"], row["kind"]) for row in rows] == [(one.name, one.kind) for one in plan.segments]
    assert float(rows[-1]["end_s"]) == plan.trajectory.duration


@pytest.mark.slow
def test_a_plan_is_certified_anew_whatever_it_says(folder, capsys, tmp_path):
    code, out, _ = run(capsys, "check", folder / "out" / "plan.npz", "--json")
    assert code == 0
    assert json.loads(out)["certified"]
    plan = jp.load_timeline_plan(folder / "out" / "plan.npz")
    plan.trajectory.coefficients[len(plan.trajectory.coefficients) // 2, 1] += 0.01
    plan.save(tmp_path / "bent.npz")
    code, out, _ = run(capsys, "check", tmp_path / "bent.npz")
    assert code == 3
    assert "no: not certified" in out
    code, _, err = run(capsys, "export", tmp_path / "bent.npz", "--format", "csv")
    assert code == 3
    assert "fails its certificate, made anew" in err


@pytest.mark.slow
def test_a_plan_is_exported_beside_itself_and_reported(folder, capsys, tmp_path):
    shutil.copy(folder / "out" / "plan.npz", tmp_path)
    before = (tmp_path / "plan.npz").read_bytes()
    assert run(capsys, "export", tmp_path / "plan.npz", "--format", "npz")[0] == 0
    assert (tmp_path / "motion.npz").is_file()
    assert (tmp_path / "plan.npz").read_bytes() == before
    assert run(capsys, "report", tmp_path / "plan.npz")[0] == 0
    assert "still" in (tmp_path / "plan.html").read_text()


@pytest.mark.slow
def test_what_cannot_be_done_has_its_own_exit_code_and_may_be_passed_over(folder, capsys, tmp_path):
    late = FILE.replace("until_s = 300", "until_s = 26")
    last = '[[activity]]\nname = "last"\nidle = true\nfor_s = 2\n'
    (tmp_path / "late.toml").write_text(late + last)
    code, out, err = run(capsys, "timeline", tmp_path / "late.toml", "--json")
    summary = json.loads(out)
    assert (code, summary["status"]) == (1, "OUT_OF_WINDOW")
    assert [one["status"] for one in summary["activities"]] == ["OK", "OUT_OF_WINDOW"]
    words = ["timeline", tmp_path / "late.toml", "--go-on", "--export", "csv", "-o", tmp_path]
    code, out, err = run(capsys, *words)
    assert code == 1
    assert "is not exported, since it ended as OUT_OF_WINDOW" in err
    found = jp.load_timeline_plan(tmp_path / "plan.npz")
    assert [one.status.name for one in found.activities] == ["OK", "OUT_OF_WINDOW", "OK"]
    assert found.not_done == ("star",)
    # what there is of it is certified, and still it is not what was asked
    code, out, err = run(capsys, "check", tmp_path / "plan.npz")
    assert code == 1
    assert "certified" in out
    assert "is not all that was asked, of 3 activities not done: star; it ended as OUT_OF_WINDOW" in err
    code, out, _ = run(capsys, "check", tmp_path / "plan.npz", "--json")
    told = json.loads(out)
    assert (code, told["status"], told["not_done"]) == (1, "OUT_OF_WINDOW", ["star"])


@pytest.mark.slow
def test_activities_are_counted_as_the_file_has_them(capsys, tmp_path):
    late = FILE.replace("until_s = 300", "until_s = 26")
    (tmp_path / "late.toml").write_text(late + '[[activity]]\nname = "last"\nidle = true\nfor_s = 2\n')
    code, out, _ = run(capsys, "timeline", tmp_path / "late.toml")
    assert code == 1
    assert re.search(r"activities +1 of 3 planned", out)
    assert re.search(r"not tried +last", out)
    plan = jp.plan_timeline(jp.load_timeline(tmp_path / "late.toml"), throw=False, progress=False)
    assert plan.advice
    assert plan.advice in out


def test_a_new_timeline_is_written_and_valid(capsys, tmp_path):
    assert run(capsys, "new", tmp_path / "day.toml", "--timeline")[0] == 0
    code, out, err = run(capsys, "validate", tmp_path / "day.toml")
    assert code == 0
    assert "5 activities" in out
    code, out, _ = run(capsys, "new", "-", "--from", "case-imaging")
    assert 'kind = "timeline"' in out
    code, _, err = run(capsys, "new", "-", "--timeline", "--from", "case-1")
    assert code == 2
    assert "--from case-1: must be one of case-day, case-imaging" in err


def test_validate_tells_all_faults_of_a_timeline(capsys, tmp_path):
    (tmp_path / "day.toml").write_text(
        FILE.replace("for_s = 5", "for_s = -5").replace("telescope = [", "tele = [")
    )
    code, out, _ = run(capsys, "validate", tmp_path / "day.toml")
    assert code == 2
    assert "activity[1].for_s = -5: must lie in [0, 86400]" in out
    assert "activity[1].track.tele: no such device, perhaps telescope is meant" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["timeline", "none.toml"],
            "no such file, and none of case-day, case-imaging; jaxplan new --timeline",
        ),
        (["timeline", ""], "TIMELINE is empty"),
        (["timeline", "."], "is a folder, name a timeline's file in it"),
        (["timeline", "{file}", "--export", "csv"], "--export needs -o DIR"),
        (["timeline", "{file}", "--export", "pdf", "-o", "{folder}"], "--export pdf: must be one of aem"),
        (["plan", "{file}"], "is a timeline; plan it with: jaxplan timeline"),
        (["check", "{file}"], "is a timeline; plan it with: jaxplan timeline"),
        (["export", "{file}", "--format", "csv"], "is a timeline; plan it with: jaxplan timeline"),
        (["timeline", "case-1"], "no such file"),
    ],
)
def test_what_is_asked_in_vain_is_told_before_anything_is_planned(capsys, tmp_path, words, message):
    (tmp_path / "day.toml").write_text(FILE)
    given = [word.format(file=tmp_path / "day.toml", folder=tmp_path / "out") for word in words]
    code, _, err = run(capsys, *given)
    assert code == 2
    assert message in err


def test_a_scenario_is_told_as_such_and_how_it_is_planned(capsys, tmp_path):
    assert run(capsys, "new", tmp_path / "scene.toml")[0] == 0
    code, _, err = run(capsys, "timeline", tmp_path / "scene.toml")
    assert code == 2
    assert "is a scenario; plan it with: jaxplan plan " in err


def test_an_export_that_needs_an_epoch_is_refused_before_planning(capsys, tmp_path):
    given = FILE.replace("epoch_utc = 2026-06-20T09:30:00", "").replace(
        "until_utc = 2026-06-20T09:30:20", "for_s = 9"
    )
    (tmp_path / "day.toml").write_text(given)
    code, _, err = run(capsys, "timeline", tmp_path / "day.toml", "-o", tmp_path / "out", "--export", "aem")
    assert code == 2
    assert "--export aem: needs an epoch" in err
    assert not (tmp_path / "out").exists()


def test_a_file_that_is_no_plan_is_refused(capsys, tmp_path):
    np.savez(tmp_path / "plan.npz", a=np.zeros(3))
    code, _, err = run(capsys, "check", tmp_path / "plan.npz")
    assert code == 2
    assert "plan.npz" in err
