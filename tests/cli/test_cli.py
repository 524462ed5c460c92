import gc
import json
import re
import shutil
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxplan as jp
from jaxplan import plotting
from jaxplan.cases import RANDOM_KINDS, case_path
from jaxplan.cli import common, main, plans
from jaxplan.exporting.formats import FORMATS
from jaxplan.schema import find_observer
from jaxplan.search import PLANNERS


def run(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    code = main([str(word) for word in words])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture(scope="module")
def folder_of_case_4(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("case-4")
    assert main(["plan", "case-4", "-o", str(folder)]) == 0
    return folder


@pytest.fixture
def planned(folder_of_case_4, tmp_path, capsys) -> Path:
    """A folder with the plan of case 4 and its figures, as the command leaves it."""
    shutil.copytree(folder_of_case_4, tmp_path, dirs_exist_ok=True)
    capsys.readouterr()
    return tmp_path


@pytest.fixture
def case_file() -> Path:
    return Path(str(case_path("case-4")))


def edited(case_file: Path, target: Path, old: str, new: str) -> Path:
    text = case_file.read_text()
    assert old in text
    target.write_text(text.replace(old, new, 1))
    return target


@pytest.mark.slow
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


@pytest.mark.parametrize("seconds", ["-1", "nan", "inf", "ten", ""])
def test_a_time_to_improve_is_refused_unless_it_is_one(capsys, seconds):
    with pytest.raises(SystemExit) as ended:
        main(["plan", "case-4", "--improve-for", seconds])
    assert ended.value.code == 2
    assert "must be a number of seconds in [0, inf)" in capsys.readouterr().err


def test_only_shortest_manoeuvres_are_improved(capsys):
    code, _, err = run(capsys, "plan", "case-4", "--improve-for", "3")
    assert code == 2
    assert '--improve-for 3: needs trajectory.duration_s = "minimum", and that of case-4 is 80' in err


def test_improve_for_is_what_python_is_given(capsys, case_file, tmp_path, monkeypatch):
    file = edited(case_file, tmp_path / "scene.toml", 'method = "paper"', 'method = "global"')
    file = edited(file, file, "duration_s = 80.0", 'duration_s = "minimum"')
    asked = []

    def planned(scenario, **options):
        asked.append(options)
        return jp.Plan(scenario=scenario, status=jp.Status.TIME_LIMIT)

    monkeypatch.setattr(plans.planner, "plan", planned)
    for words, seconds in (([], 0.0), (["--improve-for", "2.5"], 2.5)):
        assert run(capsys, "plan", file, *words)[0] == 1
        assert asked.pop()["improve_for_s"] == seconds


def test_what_figures_call_proved_is_not_what_a_file_claims(planned, monkeypatch):
    file = planned / "plan.json"
    told = jp.load_plan(file).certificate.min_margin
    content = json.loads(file.read_text())
    claims = content["report" if "report" in content else "certificate"]
    claims["min_margin"] = 1.0
    file.write_text(json.dumps(content))
    drawn = []
    monkeypatch.setattr(plans, "draw", lambda plan, *_: drawn.append(plan))
    assert main(["plot", str(file)]) == 0
    assert drawn[0].certificate.min_margin == pytest.approx(told, abs=1e-12)


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
    for words in (("check",), ("export", "--format", "csv"), ("plot",), ("report",)):
        code, out, err = run(capsys, *words, tmp_path / "plan.json")
        assert (code, out) == (1, "")
        assert "has no trajectory; it ended as INVALID_START" in err or words[0] in ("plot", "report")
    code, _, err = run(capsys, "export", "--format", "cvs", tmp_path / "plan.json")
    assert code == 2  # the words are wrong, whatever became of the plan
    assert "2 faults" in err


def test_bad_files_are_bad_input_without_a_traceback(capsys, case_file, tmp_path):
    broken = edited(case_file, tmp_path / "a.toml", "half_angle_deg = 28.0", "half_angle_deg = 210.0")
    cases = {
        "keep_out[2].half_angle_deg = 210": ("plan", broken),
        "missing.toml": ("plan", tmp_path / "missing.toml"),
        "case-5": ("plan", "case-5"),
        "missing.json": ("check", tmp_path / "missing.json"),
        f"{broken}: is a scenario by its name and no plan file; make out/plan.json of it with": (
            "check",
            broken,
        ),
        "keep_out[2].half_angle_deg = 210.0": ("plot", broken),
        "SCENARIO is empty": ("plan", ""),
        "PLAN is empty": ("check", ""),
        "FILE is empty, it must name a plan or a scenario file": ("plot", ""),
        f"{tmp_path}: is a folder, name a plan.json in it": ("check", tmp_path),
        f"{tmp_path}: is a folder, name a scenario file in it": ("plan", tmp_path),
    }
    for word, words in cases.items():
        code, out, err = run(capsys, *words)
        assert code == 2, word
        assert not out
        assert word in err
        assert "Traceback" not in err


def test_the_spacecraft_of_a_scenario_is_drawn_before_it_is_planned(capsys, case_file, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(case_file.read_text())
    for words, file in {
        (scene,): tmp_path / "spacecraft.png",
        ("case-2", "-o", tmp_path / "out"): tmp_path / "out" / "spacecraft.png",
    }.items():
        code, out, err = run(capsys, "plot", *words)
        assert (code, out) == (0, "")
        assert f"wrote {file}" in err
        assert file.read_bytes().startswith(b"\x89PNG")


def test_a_frequency_is_refused_where_there_is_no_plan(capsys, case_file, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(case_file.read_text())
    for given in (scene, "case-2"):
        code, out, err = run(capsys, "plot", given, "--frequency", "0.5", "-o", tmp_path / "out")
        assert (code, out) == (2, "")
        assert f"--frequency 0.5: is for a plan, and {given} is a scenario" in err
        assert f"jaxplan plan {given} -o out" in err
    assert not (tmp_path / "out").exists()


def test_what_is_given_for_something_else_is_told_what_it_is(capsys, tmp_path):
    plan, timings, study = tmp_path / "plan.json", tmp_path / "plan.timings.json", tmp_path / "study.toml"
    plan.write_text('{"schema_version": 1, "scenario": {}}')
    timings.write_text('{"total": 1.0}')
    study.write_bytes(bytes(range(256)))
    (tmp_path / "empty.json").write_text("")
    (tmp_path / "empty.toml").write_text("")
    for words, said in {
        (
            "plan",
            plan,
        ): f"{plan}: not TOML but JSON, as plan files are; jaxplan check, plot, report and export",
        ("check", tmp_path): f"{tmp_path}: is a folder, perhaps {plan} is meant",
        ("check", timings): f"{timings}: holds the timings of a plan, perhaps {plan} is meant",
        ("check", tmp_path / "empty.json"): "jaxplan plan SCENARIO -o DIR makes plan files",
        ("check", tmp_path / "absent.json"): "no such file; jaxplan plan SCENARIO -o DIR makes DIR/plan.json",
        (
            "check",
            "case-2",
        ): "case-2: is a scenario by its name and no plan file; make out/plan.json of it with: jaxplan",
        ("plan", tmp_path / "absent.toml"): "jaxplan new writes a file to begin with",
        ("plan", tmp_path / "empty.toml"): "spacecraft: missing, must be a table",
        ("plan", study): "study.toml: not UTF-8 text",
    }.items():
        code, out, err = run(capsys, *words)
        assert (code, out) == (2, ""), words
        assert said in err
        assert "Traceback" not in err


def test_a_place_that_cannot_be_written_is_named_and_nothing_beside_it(capsys, monkeypatch, planned):
    monkeypatch.setattr("jaxplan.planner.certify", lambda *_: pytest.fail("certified"))
    plan, file = planned / "plan.json", planned / "file"
    file.write_text("mine")
    for words in (("new",), ("report", plan, "-o"), ("export", plan, "--format", "csv", "-o")):
        for place, said in {
            "/proc/x": "jaxplan: /proc: nothing can be written there: ",
            file / "x": f"jaxplan: {file}: cannot be a folder, {file} is a file",
        }.items():
            code, out, err = run(capsys, *words, place)
            assert (code, out) == (2, ""), words
            assert err.startswith(said)
            assert ".part" not in err
    assert file.read_text() == "mine"


def test_wrong_words_are_told_with_the_command_whose_help_says_more(capsys):
    for words, said in {
        ("plan", "case-4", "case-3"): "jaxplan plan: error: unrecognized arguments: case-3; see jaxplan plan",
        ("check", "--quick", "x"): "jaxplan check: error: unrecognized arguments: --quick; see jaxplan check",
        ("check", "p", "--scene", "x"): "unrecognized arguments: --scene x, perhaps --scenario is meant; see",
        ("export", "plan.json", "exp.c"): "arguments: exp.c; what is written is named by -o exp.c; see",
        ("new",): "jaxplan new: error: the following arguments are required: FILE; see jaxplan new --help",
        ("scene.toml",): "invalid choice: 'scene.toml'",
        ("--quick",): "jaxplan: error: unrecognized arguments: --quick; see jaxplan --help",
    }.items():
        with pytest.raises(SystemExit) as caught:
            main(list(words))
        assert caught.value.code == 2
        assert said in capsys.readouterr().err


def test_a_new_file_is_valid_and_replaces_another_only_if_it_is_told_to(capsys, tmp_path):
    file = tmp_path / "my scenes" / "scene.toml"
    code, out, err = run(capsys, "new", file)
    assert (code, out) == (0, "")
    assert err == f"wrote {file}; plan it with: jaxplan plan '{file}' -o out\n"
    written = file.read_text()
    assert run(capsys, "new", "-") == (0, written, "")
    observer = Path(__file__).parents[1] / "scenarios" / "earth_observer.toml"
    code, out, _ = run(capsys, "validate", file, "case-4", observer)
    assert code == 0
    assert ": ok: 1 terminal, 1 drive, 3 instruments, " in out.splitlines()[2]
    assert out.splitlines()[0] == (
        f"{file}: ok: 3 terminals, 2 instruments, 1 keep-out zone, 1 keep-in zone; "
        "the start keeps all limits and zones"
    )
    file.write_text("mine")
    code, out, err = run(capsys, "new", file, "--from", "case-4")
    assert code == 2
    assert f"{file}: is there already; take another name, or replace it with --force" in err
    assert file.read_text() == "mine"
    assert run(capsys, "new", file, "--from", "case-4", "--force")[0] == 0
    assert file.read_bytes() == case_path("case-4").read_bytes()
    for name, said in {
        "": "FILE: must name a file",
        tmp_path: f"must name a file, such as {tmp_path / 'scene.toml'}",
        f"{tmp_path}/absent/": "must name a file",
    }.items():
        code, _, err = run(capsys, "new", name)
        assert code == 2
        assert said in err
    code, _, err = run(capsys, "new", "-", "--from", "case-5")
    assert code == 2
    assert "--from case-5: must be one of case-1, case-2, case-3, case-4" in err


def test_validating_tells_faults_apart_from_a_start_or_goal_that_breaks_something(
    capsys, monkeypatch, case_file, tmp_path
):
    monkeypatch.setattr("jaxplan.planner.plan", lambda *_, **__: pytest.fail("planned"))
    faulty = edited(case_file, tmp_path / "faulty.toml", "half_angle_deg = 28.0", "half_angle_deg = 210.0")
    edited(faulty, faulty, "schema_version = 1", "schema_version = 2")
    wide = edited(case_file, tmp_path / "wide.toml", "half_angle_deg = 28.0", "half_angle_deg = 80.0")
    text = case_file.read_text()
    start, goal = text.index("[start]"), text.index("[goal]")
    ends = text.index("[[keep_out]]")
    held = tmp_path / "held.toml"  # the goal is the start, but for a pitch of 1 rad
    again = text[start:goal].replace("[start]", "[goal]")
    held.write_text(text[:goal] + re.sub(r"(pitch_rad = \[)[^,]+", r"\g<1>1.0", again) + text[ends:])
    plan = tmp_path / "plan.json"
    plan.write_text("{}")
    names = (faulty, wide, held, plan, tmp_path / "absent.toml", case_file)
    code, out, err = run(capsys, "validate", *names)
    assert (code, err) == (2, "")
    assert (
        f"{faulty} has 2 faults:\n  schema_version = 2: must be 1\n  keep_out[2].half_angle_deg = 210" in out
    )
    assert f"{wide}: 3 terminals, 3 keep-out zones, 1 keep-in zone\n  the start breaks a constraint: " in out
    assert re.search(r"terminal-\d is [\d.]+ deg inside keep-out zone CZ4", out)
    assert f"{held}: 3 terminals, 3 keep-out zones, 1 keep-in zone\n  the goal breaks a constraint: " in out
    assert "terminal-1 pitch is" in out
    assert f"{plan}: not TOML but JSON, as plan files are" in out
    assert f"{tmp_path / 'absent.toml'}: no such file" in out
    assert f"{case_file}: ok: " in out
    assert run(capsys, "validate", case_file, wide)[0] == 1
    assert run(capsys, "validate", held)[0] == 1
    code, out, _ = run(capsys, "validate", "--json", *names)
    assert code == 2
    found = json.loads(out)
    assert [one["file"] for one in found] == [str(name) for name in names]
    assert [one["valid"] for one in found] == [False] * 5 + [True]
    assert [len(one["faults"]) for one in found] == [2, 0, 0, 1, 1, 0]
    assert [bool(one["start"]) for one in found] == [False, True, False, False, False, False]
    assert [bool(one["goal"]) for one in found] == [
        False,
        True,
        True,
        False,
        False,
        False,
    ]  # in CZ4 both ends
    assert found[5]["holds"] == {
        "name": "case 4", "terminals": 3, "drives": 0, "instruments": 0, "wheels": 0, "keep_out": 3,
        "keep_in": 1, "joint_bounds": 0, "masks": 0
    }  # fmt: skip


def test_a_plan_that_does_not_hold_fails_the_check(capsys, planned):
    file = planned / "plan.json"
    content = json.loads(file.read_text())
    content["trajectory"]["joint_coefficients"][0][3][1] += 0.02
    file.write_text(json.dumps(content))
    code, out, _ = run(capsys, "check", file)
    assert code == 3
    assert "not certified" in out
    code, out, _ = run(capsys, "check", file, "--json")
    assert code == 3
    assert json.loads(out)["certified"] is False
    code, out, err = run(capsys, "export", "--format", "csv", file)
    assert (code, out) == (3, "")
    assert "fails its certificate, made anew" in err


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


def test_each_figure_is_named_on_the_bar_while_it_is_drawn(monkeypatch, tmp_path, capsys):
    told = []

    class Bar:
        def step(self, name):
            told.append(name)

        def update(self):
            told.append("done")

        def say(self, text):
            told.append(text)

    @contextmanager
    def bar_of(what, unit, *, total):
        told.append((what, unit, total))
        yield Bar()

    monkeypatch.setattr(common, "progress_bar", bar_of)
    made = [("orbital_sphere", Figure), ("angles", Figure)]
    monkeypatch.setattr(plotting, "drawings", lambda *_: made)
    common.draw(None, tmp_path)
    assert told == [
        ("drawing", "figures", 2),
        "orbital sphere",
        "angles",  # is drawn while the one before is written
        *(f"wrote {tmp_path / 'orbital_sphere.png'}", "done"),
        *(f"wrote {tmp_path / 'angles.png'}", "done"),
    ]
    assert all((tmp_path / f"{name}.png").stat().st_size for name, _ in made)


def test_a_failed_plan_leaves_no_figures_of_an_earlier_one(capsys, case_file, planned):
    (planned / "rates.png").write_bytes(b"somebody's own")
    (planned / "mine.png").write_bytes((planned / "angles.png").read_bytes())
    scene = edited(case_file, planned / "scene.toml", "half_angle_deg = 28.0", "half_angle_deg = 80.0")
    code, _, err = run(capsys, "plan", scene, "-o", planned)
    assert code == 1
    assert "removed" in err
    assert "anew" not in err  # there is no report
    made = [planned / "plan.aem", planned / "plan.html"]
    for file in made:
        file.write_text("of the plan before")
    _, _, err = run(capsys, "plan", scene, "-o", planned)
    assert f"{made[0]}, {made[1]}: of an earlier plan, make them anew" in err
    assert all(file.exists() for file in made)
    assert {file.name for file in planned.glob("*.png")} == {
        "spacecraft.png",
        "sphere.png",
        "rates.png",
        "mine.png",
    }


@pytest.mark.slow
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
    code, _, err = run(capsys, "table4", "--first-seed", "-1")
    assert code == 2
    assert "--first-seed -1: seeds must be at least 0" in err


def test_the_comparison_is_drawn_where_it_is_asked_for(capsys, monkeypatch, tmp_path):
    words = ("table4", "-n", 1, "--kind", "keep_in", "--planner", "rrt_connect")
    code, out, err = run(capsys, *words, "-o", tmp_path / "out")
    assert code == 0
    assert "rrt_connect" in out
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["table4.png"]
    assert f"wrote {tmp_path / 'out' / 'table4.png'}" in err
    monkeypatch.setattr("jaxplan.study.printed_planners.compare", lambda *_, **__: pytest.fail("searched"))
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
    steps = re.findall(r"^  jaxplan (\w+) scene.toml", err.partition("first steps:")[2], re.MULTILINE)
    assert steps == ["new", "validate", "plan"]
    code, out, _ = run(capsys, "--version")
    assert code == 0
    assert out.startswith("jaxplan ")


def test_help_tells_all_kinds_planners_and_formats(capsys):
    for command, names in {
        "study": (*RANDOM_KINDS, *PLANNERS),
        "table4": (*RANDOM_KINDS, *PLANNERS),
        "export": FORMATS,
    }.items():
        with pytest.raises(SystemExit):
            main([command, "--help"])
        words = re.findall(r"[\w-]+", capsys.readouterr().out)
        assert set(names) <= set(words), command


def test_help_needs_no_jax():
    program = (
        "import sys; from jaxplan.cli import main\n"
        "try: main(['--help'])\n"
        "finally: assert 'jax' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "plan" in done.stdout


def test_checking_a_file_loads_neither_what_plans_nor_what_draws(planned):
    others = ["matplotlib", "optax", "scipy", "tqdm", "jaxplan.goal", "jaxplan.planner.entry_points"]
    others += ["jaxplan.search.mha", "jaxplan.trajectory.sqp", "jaxplan.report", "jaxplan.exporting"]
    program = (
        "import json, sys; from jaxplan.cli import main\n"
        f"code = main(['check', {str(planned / 'plan.json')!r}, '--json'])\n"
        f"print(json.dumps([code, [name for name in {others} if name in sys.modules]]))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == [0, []]


def test_a_command_leaves_the_callers_collector_alone(capsys):
    before = gc.get_threshold()
    assert run(capsys, "validate", "case-4")[0] == 0
    assert run(capsys, "validate", "nothing.toml")[0] == 2
    assert gc.get_threshold() == before


def test_kernels_that_xla_refuses_are_told_of_on_stderr(capsys, monkeypatch):
    monkeypatch.setattr("jaxplan.runtime.kernel_files._refused_count", 2)
    code, out, err = run(capsys, "validate", "case-1")
    assert code == 0
    assert "2 of the kernels that earlier runs had kept" in err
    assert "refused" not in out


SKY = """[sky]
observer = { altitude_km = 600, inclination_deg = 60, ascending_node_deg = 30, argument_of_latitude_deg = 9 }
"""


@pytest.mark.slow
def test_the_orbit_of_a_scene_adds_figures_along_it_to_a_plan_and_its_report(capsys, planned, tmp_path):
    pytest.importorskip("erfa", reason="the extra orbit is not installed")
    scene, file = tmp_path / "scene.toml", tmp_path / "plan.json"
    scene.write_text(SKY)
    code, _, err = run(capsys, "plot", file, "--observer", scene, "-o", tmp_path / "along")
    assert (code, "has no epoch" in err) == (2, True)
    plan = jp.load_plan(file)
    dated = replace(plan, scenario=replace(plan.scenario, epoch=np.datetime64("2026-06-20T09:00:00", "ns")))
    dated.save(file)
    code, _, _ = run(capsys, "plot", file, "--observer", scene, "-o", tmp_path / "along")
    assert code == 0
    pictures = {one.stem for one in (tmp_path / "along").glob("*.png")}
    assert {"orbital_sphere", "attitude", "ground_track"} <= pictures
    code, _, err = run(capsys, "plot", file, "-o", tmp_path / "along")  # those of before are taken away
    assert code == 0
    assert not (tmp_path / "along" / "ground_track.png").exists()
    code, _, _ = run(capsys, "report", file, "--observer", scene, "-o", tmp_path / "page.html")
    assert code == 0
    page = (tmp_path / "page.html").read_text()
    assert all(f'id="figure-{name}"' in page for name in ("orbital_sphere", "attitude", "ground_track"))


def test_an_orbit_for_figures_is_refused_where_there_is_none_or_it_has_no_place(capsys, planned, tmp_path):
    bare = tmp_path / "bare.toml"
    bare.write_text('schema_version = 1\nname = "bare"\n')
    plan = jp.load_plan(tmp_path / "plan.json")
    epoch = np.datetime64("2026-06-20T09:00:00", "ns")
    replace(plan, scenario=replace(plan.scenario, epoch=epoch)).save(tmp_path / "plan.json")
    for command in ("plot", "report"):
        code, _, err = run(capsys, command, tmp_path / "plan.json", "--observer", bare)
        assert (code, "sky.observer: missing, must say the orbit" in err) == (2, True)
    code, _, err = run(capsys, "plot", "case-4", "--observer", bare, "-o", tmp_path)
    assert (code, "is for a plan, and case-4 is a scenario" in err) == (2, True)


def test_a_file_may_have_no_orbit_where_none_is_needed(tmp_path):
    bare, orbit, wrong = (tmp_path / f"{name}.toml" for name in ("bare", "orbit", "wrong"))
    bare.write_text('name = "observer"\n')
    orbit.write_text(SKY)
    wrong.write_text(SKY.replace("600", "-1"))
    assert find_observer(bare) is None
    assert find_observer(orbit) == jp.load_observer(orbit)
    with pytest.raises(jp.ScenarioError, match="altitude_km"):
        find_observer(wrong)
