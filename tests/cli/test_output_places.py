"""Where commands and functions write, and what they leave as it is whatever they are told."""

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
from builders import make_scenario

import jaxplan as jp
from jaxplan.cli import main, plans, timelines

TIMELINE = """# a comment, which only this file has
schema_version = 1
kind = "timeline"
name = "still"
[spacecraft]
rate_limit_deg_s = 1.0
acceleration_limit_deg_s2 = 0.5
[start]
attitude = [0, 0, 0]
[[activity]]
name = "wait"
idle = true
until_s = 20
"""


@pytest.fixture(scope="module")
def resting() -> jp.Plan:
    """A plan that ends where it starts."""
    scenario = make_scenario(2, 1)
    return jp.plan(replace(scenario, goal=scenario.start))


@pytest.fixture
def here(resting, tmp_path, monkeypatch) -> Path:
    """The working folder, with a plan, a scene, an orbit and a pipe."""
    monkeypatch.chdir(tmp_path)
    resting.save("plan.json")
    jp.save_scenario(resting.scenario, "scene.toml")
    (tmp_path / "orbit.toml").write_text("[sky]\nobserver = { altitude_km = 600, inclination_deg = 60 }\n")
    os.mkfifo("pipe")
    return tmp_path


def content(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}


WRITERS = [["export", "--format", "csv"], ["report"], ["view"]]


@pytest.mark.parametrize("writer", WRITERS, ids=lambda words: words[0])
def test_no_force_replaces_a_plan_a_scene_or_a_pipe(here, capsys, writer):
    pytest.importorskip("k3d", reason="the extra view is not installed")
    before = content(here)
    os.link("plan.json", "same.json")
    for place, said in {
        "plan.json": "-o plan.json: is what this command reads, take another name",
        "same.json": "-o same.json: is what this command reads, take another name",
        "scene.toml": "scene.toml: holds a scenario or timeline, which no other kind of file replaces",
        "pipe": "pipe: is a device, pipe or socket, and only files are replaced",
    }.items():
        assert main([*writer, "plan.json", "-o", place, "--force"]) == 2
        assert capsys.readouterr().err.startswith(f"jaxplan: {said}")
    os.unlink("same.json")
    assert content(here) == before
    assert Path("pipe").is_fifo()


def test_no_file_that_a_command_reads_is_replaced(here, capsys):
    before = content(here)
    words = ["export", "plan.json", "--format", "czml", "--epoch", "2026-01-01", "--observer", "orbit.toml"]
    assert main([*words, "-o", "orbit.toml", "--force"]) == 2
    assert "-o orbit.toml: is what this command reads" in capsys.readouterr().err
    assert content(here) == before


def test_a_new_scene_replaces_a_scene_and_no_plan(here, capsys):
    before = content(here)
    assert main(["new", "plan.json", "--force"]) == 2
    assert "plan.json: holds a plan, which no other kind" in capsys.readouterr().err
    assert main(["new", "pipe"]) == 2
    assert "pipe: is a device, pipe or socket" in capsys.readouterr().err
    assert content(here) == before
    assert main(["new", "scene.toml", "--force"]) == 0


def test_what_a_plan_would_replace_is_looked_at_before_anything_is_planned(here, monkeypatch, capsys):
    monkeypatch.setattr(plans.planner, "plan", lambda *_, **__: pytest.fail("planned"))
    (here / "out").mkdir()
    (here / "plan.json").write_bytes((here / "scene.toml").read_bytes())
    os.mkfifo("out/plan.json")
    for words, said in {
        ("plan.json", "-o", "."): "plan.json: holds a scenario or timeline, which no other",
        ("scene.toml", "-o", "out"): "out/plan.json: is a device, pipe or socket",
    }.items():
        assert main(["plan", *words]) == 2
        assert capsys.readouterr().err.startswith(f"jaxplan: {said}")


@pytest.mark.parametrize(
    "words",
    [
        *([*writer, "plan.json"] for writer in WRITERS),
        ["plan", "scene.toml"],
        ["plot", "plan.json"],
        ["plot", "scene.toml"],
        ["timeline", "case-day"],
        ["study", "-n", "1"],
        ["table4", "-n", "1"],
    ],
    ids=" ".join,
)
def test_a_dash_is_stdout_for_new_alone_and_refused_elsewhere(here, capsys, words):
    pytest.importorskip("k3d", reason="the extra view is not installed")
    before = content(here)
    assert main([*words, "-o", "-"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "jaxplan: -o -: must be a name, since only jaxplan new writes a file to stdout" in err
    assert content(here) == before
    assert not Path("-").exists()


def test_a_file_may_be_called_dash(here, capsys):
    assert main(["export", "plan.json", "--format", "csv", "-o", "./-"]) == 0
    assert main(["new", "./-", "--force"]) == 0
    assert jp.load_scenario("-")


@pytest.mark.slow
def test_a_timeline_that_is_planned_in_its_own_folder_stays_as_it_was_written(here, capsys, monkeypatch):
    monkeypatch.setattr(timelines, "draw", lambda *_, **__: None)
    Path("timeline.toml").write_text(TIMELINE)
    assert main(["timeline", "timeline.toml", "-o", "."]) == 0
    assert "wrote timeline.toml" not in capsys.readouterr().err
    assert Path("timeline.toml").read_text() == TIMELINE
    assert main(["timeline", "timeline.toml", "-o", "out"]) == 0
    assert "wrote out/timeline.toml" in capsys.readouterr().err


def test_functions_replace_no_source_of_another_kind(here, resting):
    pytest.importorskip("k3d", reason="the extra view is not installed")
    before = content(here)
    for call in (
        lambda: resting.save("scene.toml"),
        lambda: resting.save("pipe"),
        lambda: jp.save_scenario(resting.scenario, "plan.json"),
        lambda: jp.save_scenario(resting.scenario, "pipe"),
        lambda: jp.export(resting, "plan.json", format="csv", overwrite=True),
        lambda: jp.export(resting, "pipe", format="csv", overwrite=True),
        lambda: jp.report_html(resting, "scene.toml", overwrite=True),
        lambda: jp.view(resting).save("plan.json", overwrite=True),
        lambda: jp.view(resting).save("pipe", overwrite=True),
    ):
        with pytest.raises(FileExistsError):
            call()
    assert content(here) == before
    assert Path("pipe").is_fifo()


def test_a_plan_with_its_keys_in_another_order_is_a_plan(here, resting, capsys):
    held = json.loads(Path("plan.json").read_text())
    Path("plan.json").write_text(json.dumps(held, sort_keys=True))
    assert jp.load_plan("plan.json").ok
    with pytest.raises(FileExistsError, match="holds a plan"):
        jp.export(resting, "plan.json", format="csv", overwrite=True)
