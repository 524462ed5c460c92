import json
import subprocess
import sys
from pathlib import Path

import pytest

from jaxplan.cases import case_path
from jaxplan.cli import main


def run(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    code = main([str(word) for word in words])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture
def case_file() -> Path:
    return Path(str(case_path("case-4")))


def edited(case_file: Path, target: Path, old: str, new: str) -> Path:
    text = case_file.read_text()
    assert old in text
    target.write_text(text.replace(old, new, 1))
    return target


def test_plan_check_and_plot_follow_one_another(capsys, tmp_path):
    code, out, err = run(capsys, "plan", "case-4", "-o", tmp_path / "out")
    assert code == 0
    assert "certified" in out
    assert "plan.json" in err
    pictures = sorted(file.name for file in (tmp_path / "out").glob("*.png"))
    assert len(pictures) >= 5
    code, out, _ = run(capsys, "check", tmp_path / "out" / "plan.json")
    assert code == 0
    assert "certified" in out
    code, _, err = run(capsys, "plot", tmp_path / "out" / "plan.json", "-o", tmp_path / "again")
    assert code == 0
    assert sorted(file.name for file in (tmp_path / "again").glob("*.png")) == pictures


def test_a_scenario_file_is_planned_like_the_case_it_holds(capsys, case_file):
    first = run(capsys, "plan", "case-4", "--json")
    second = run(capsys, "plan", case_file, "--json")
    assert first[0] == second[0] == 0
    one, other = json.loads(first[1]), json.loads(second[1])
    assert one.pop("timings_s").keys() == other.pop("timings_s").keys()
    assert one == other
    assert one["status"] == "OK"
    assert one["certified"] is True


def test_an_invalid_scene_is_no_plan(capsys, case_file, tmp_path):
    scene = edited(case_file, tmp_path / "scene.toml", "half_angle_deg = 28.0", "half_angle_deg = 80.0")
    code, out, _ = run(capsys, "plan", scene, "-o", tmp_path)
    assert code == 1
    assert "INVALID_START" in out
    assert "CZ4" in out
    code, _, err = run(capsys, "check", tmp_path / "plan.json")
    assert code == 2
    assert "no trajectory" in err


def test_bad_files_are_bad_input_without_a_traceback(capsys, case_file, tmp_path):
    broken = edited(case_file, tmp_path / "a.toml", "half_angle_deg = 28.0", "half_angle_deg = 210.0")
    cases = {
        "keep_out[2].half_angle_deg = 210": ("plan", broken),
        "missing.toml": ("plan", tmp_path / "missing.toml"),
        "case-5": ("plan", "case-5"),
        "missing.json": ("check", tmp_path / "missing.json"),
        "not a plan file": ("plot", broken),
        "SCENARIO is empty": ("plan", ""),
        "PLAN is empty": ("check", ""),
        f"{tmp_path}: cannot be read: Is a directory": ("check", tmp_path),
        "cannot be read: Is a directory": ("plan", tmp_path),
    }
    for word, words in cases.items():
        code, out, err = run(capsys, *words)
        assert code == 2, word
        assert not out
        assert word in err
        assert "Traceback" not in err


def test_a_plan_that_does_not_hold_fails_the_check(capsys, tmp_path):
    run(capsys, "plan", "case-4", "-o", tmp_path)
    content = json.loads((tmp_path / "plan.json").read_text())
    content["trajectory"]["joint_coefficients"][0][3][1] += 0.02
    (tmp_path / "plan.json").write_text(json.dumps(content))
    code, out, _ = run(capsys, "check", tmp_path / "plan.json")
    assert code == 3
    assert "not certified" in out
    code, out, _ = run(capsys, "check", tmp_path / "plan.json", "--json")
    assert code == 3
    assert json.loads(out)["certified"] is False


def test_the_folder_is_tried_before_anything_is_planned(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("jaxplan.planner.plan", lambda *_, **__: pytest.fail("planned"))
    (tmp_path / "file").write_text("mine")
    for out, words in {
        "": "DIR of -o is empty",
        tmp_path / "file": f"{tmp_path / 'file'} is a file",
        tmp_path / "file" / "below": f"cannot be a folder, {tmp_path / 'file'} is a file",
        "/proc/nowhere": "/proc/nowhere: nothing can be written there",
        "/proc/self": "/proc/self: nothing can be written there",
    }.items():
        code, printed, err = run(capsys, "plan", "case-4", "-o", out)
        assert (code, printed) == (2, "")
        assert words in err
    assert (tmp_path / "file").read_text() == "mine"


def test_a_failed_plan_leaves_no_figures_of_an_earlier_one(capsys, case_file, tmp_path):
    run(capsys, "plan", "case-4", "-o", tmp_path)
    foreign = tmp_path / "rates.png"
    foreign.write_bytes(b"somebody's own")
    (tmp_path / "mine.png").write_bytes((tmp_path / "angles.png").read_bytes())
    scene = edited(case_file, tmp_path / "scene.toml", "half_angle_deg = 28.0", "half_angle_deg = 80.0")
    code, _, err = run(capsys, "plan", scene, "-o", tmp_path)
    assert code == 1
    assert "removed" in err
    assert {file.name for file in tmp_path.glob("*.png")} == {"sphere.png", "rates.png", "mine.png"}


def test_the_check_says_all_of_the_certificate_that_the_plan_says(capsys, tmp_path):
    planned = json.loads(run(capsys, "plan", "case-4", "--json", "-o", tmp_path)[1])
    code, out, _ = run(capsys, "check", tmp_path / "plan.json", "--json")
    checked = json.loads(out)
    assert code == 0
    assert {key: planned[key] for key in checked} == checked
    assert 0 < checked["min_margin_deg"] < 30
    assert checked["worst_device"].startswith("terminal-")
    assert checked["worst_zone"].startswith("CZ")
    assert 0 <= checked["worst_time_s"] <= planned["duration_s"] == 80
    assert checked["peak_times_s"].keys() == checked["peaks"].keys()
    assert checked["faults"] == []


def test_planners_are_compared_on_the_command_line(capsys):
    code, out, _ = run(capsys, "table4", "-n", 1, "--kind", "keep_in", "--planner", "mha")
    assert code == 0
    assert "paper's MHA*" in out
    assert sum(line.split()[:1] == ["mha"] for line in out.splitlines()) == 1
    code, out, _ = run(capsys, "table4", "-n", 1, "--kind", "held_links", "--planner", "mha", "--json")
    assert code == 0
    (row,) = json.loads(out)
    assert row["kind"] == "held_links"
    assert row["found"] == row["clear"] == row["scenes"] == 1
    code, _, err = run(capsys, "table4", "--kind", "easy")
    assert code == 2
    assert "--kind easy: must be one of keep_out" in err


def test_the_comparison_is_drawn_where_it_is_asked_for(capsys, monkeypatch, tmp_path):
    words = ("table4", "-n", 1, "--kind", "keep_in", "--planner", "rrt_connect")
    code, out, err = run(capsys, *words, "-o", tmp_path / "out")
    assert code == 0
    assert "rrt_connect" in out
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["table4.png"]
    assert f"wrote {tmp_path / 'out' / 'table4.png'}" in err
    monkeypatch.setattr("jaxplan.table4.compare", lambda *_, **__: pytest.fail("searched"))
    (tmp_path / "file").write_text("mine")
    for folder, said in {
        "": "DIR of -o is empty",
        tmp_path / "file": f"{tmp_path / 'file'} is a file",
        "/proc/nowhere": "/proc/nowhere: nothing can be written there",
    }.items():
        code, out, err = run(capsys, *words, "-o", folder)
        assert (code, out) == (2, "")
        assert said in err


def test_the_command_without_words_says_what_it_can_do(capsys):
    code, _, err = run(capsys)
    assert code == 2
    assert "plan" in err
    code, out, _ = run(capsys, "--version")
    assert code == 0
    assert out.startswith("jaxplan ")


def test_help_needs_no_jax():
    program = (
        "import sys; from jaxplan.cli import main\n"
        "try: main(['--help'])\n"
        "finally: assert 'jax' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "plan" in done.stdout
