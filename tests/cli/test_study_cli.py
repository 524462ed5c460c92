import json

import pytest
from fake_study import plan_nothing

from jaxplan.cases import case_path
from jaxplan.cli import main


def run(capsys, *words: object) -> tuple[int, str, str]:
    code = main([str(word) for word in words])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture(autouse=True)
def _nothing_is_planned(monkeypatch):
    monkeypatch.setattr("jaxplan.study.run.plan_chunk", plan_nothing)


def test_a_study_is_made_kept_and_reported(capsys, tmp_path):
    words = ("study", "--kind", "hard_keep_out", "-n", 12, "--first-seed", 3, "--set", "search.max_goals=1")
    code, out, _ = run(capsys, *words, "--out", tmp_path / "a")
    assert code == 0
    assert out.startswith("Study of 12 hard_keep_out scenes by mha, search.max_goals = 1\n")
    assert "8: 66.67 %" in out
    again = run(capsys, *words, "--out", tmp_path / "a")
    assert (again[0], again[1]) == (0, out)
    header = json.loads((tmp_path / "a" / "study.json").read_text())
    assert (header["seeds"], header["settings"]) == ([[3, 14]], {"search.max_goals": 1})
    code, reported, err = run(capsys, "study", "--report", tmp_path / "a", "-o", tmp_path / "figures")
    assert (code, reported) == (0, out)
    assert f"wrote {tmp_path / 'figures' / 'study.png'}" in err
    assert (tmp_path / "figures" / "study.png").stat().st_size > 10_000


def test_several_studies_are_reported_with_their_comparison(capsys, tmp_path):
    for planner in ("mha", "wastar"):
        run(capsys, "study", "-n", 6, "--planner", planner, "--out", tmp_path / planner)
    code, out, _ = run(capsys, "study", "--report", tmp_path / "mha", tmp_path / "wastar")
    assert code == 0
    assert out.count("Study of 6 keep_out scenes by") == 2
    assert "p = 1 (McNemar, exact)" in out
    code, out, _ = run(capsys, "study", "--report", tmp_path / "mha", tmp_path / "wastar", "--json")
    record = json.loads(out)
    assert [study["planned"] for study in record["studies"]] == [4, 4]
    assert record["comparisons"][0]["both"] == 4
    code, out, _ = run(capsys, "study", "-n", 3, "--json")
    assert json.loads(out)["success_rate"] == 2 / 3


def test_mistakes_are_bad_input_without_a_traceback(capsys, tmp_path):
    (tmp_path / "file").write_text("mine")
    run(capsys, "study", "-n", 3, "--out", tmp_path / "study")
    for words, said in {
        ("--kind", "easy"): "kind = 'easy': must be one of keep_out",
        ("--planner", "a-star"): "planner = 'a-star': must be one of mha",
        ("--first-seed", "-3"): "--first-seed -3: seeds must be at least 0",
        ("--set", "search.seed"): "--set search.seed: must be NAME=VALUE",
        ("--set", "search.seed=-1"): "search.seed = -1: must be",
        ("--set", "trajectory.duration_s=quick"): 'trajectory.duration_s = "quick"',
        ("--out", ""): "out is empty",
        ("--out", tmp_path): "holds file, but no study",
        ("--out", tmp_path / "file"): "file is a file",
        ("--out", "/proc/nowhere"): "/proc/nowhere: ",
        ("-n", 2, "--out", tmp_path / "study"): "scenes 3 there, 2 here",
        ("--report", tmp_path): f"{tmp_path}: holds no study; jaxplan study -o {tmp_path} makes one there",
        ("--report", tmp_path / "study", "-n", 4): "-n says what to plan, but --report plans nothing",
        ("--report", tmp_path / "study", "--first-seed", 0): "--first-seed says what to plan",
        ("--report", tmp_path / "study", "-o", tmp_path / "file"): "file is a file",
    }.items():
        code, out, err = run(capsys, "study", *words)
        assert (code, out) == (2, ""), words
        assert said in err
        assert "Traceback" not in err
    for words in (("-n", "0"), ("--workers", "0"), ("--workers", "two")):
        with pytest.raises(SystemExit) as caught:
            run(capsys, "study", *words)
        assert caught.value.code == 2
        assert f"argument {words[0]}: {words[1]}: must be a whole number" in capsys.readouterr().err


def test_an_interrupted_study_says_how_it_goes_on(capsys, monkeypatch, tmp_path):
    def interrupted(chunk):
        if 20 in chunk.numbers:
            raise KeyboardInterrupt
        return plan_nothing(chunk)

    monkeypatch.setattr("jaxplan.study.run.plan_chunk", interrupted)
    code, out, err = run(capsys, "study", "-n", 24, "--out", tmp_path)
    assert code == 130
    assert "16 done of 24" in out
    assert "interrupted after 16 of 24 scenes: the same command goes on" in err
    monkeypatch.setattr("jaxplan.study.run.plan_chunk", plan_nothing)
    code, out, _ = run(capsys, "study", "-n", 24, "--out", tmp_path)
    assert code == 0
    assert "16: 66.67 %" in out


def test_the_scenario_files_of_a_folder_are_a_study_of_their_own(capsys, tmp_path):
    folder = tmp_path / "scenes"
    folder.mkdir()
    for name in ("case-1", "case-2", "case-4"):
        (folder / f"{name}.toml").write_text(case_path(name).read_text())
    (folder / "wrong.toml").write_text("schema_version = 1\n")
    (folder / "notes.txt").write_text("no scene")
    words = ("study", folder, "--out", tmp_path / "kept")
    code, out, err = run(capsys, *words)
    assert code == 0
    assert f"left out: {folder / 'wrong.toml'} has" in err
    table, _, summary = out.partition("\n\n")
    head, *rows = table.splitlines()
    assert head.split()[:2] == ["file", "status"]
    assert [row.split()[0] for row in rows] == ["case-1.toml", "case-2.toml", "case-4.toml"]
    assert summary.startswith("Study of 3 scenarios by mha")
    assert run(capsys, *words)[:2] == (0, out)  # goes on where it was, with nothing left to do
    record = json.loads(run(capsys, "study", folder, "--json")[1])
    assert record["files"] == ["case-1.toml", "case-2.toml", "case-4.toml"]
    for more, said in {
        ("-n", "3"): "-n is of random scenes",
        ("--kind", "keep_in"): "--kind is of random scenes",
        ("--report", tmp_path / "kept"): "says what to plan, but --report plans nothing",
    }.items():
        code, _, err = run(capsys, "study", folder, *more)
        assert code == 2
        assert said in err
    empty = tmp_path / "empty"
    empty.mkdir()
    for place, said in ((empty, "has no scenario file (.toml)\n"), (tmp_path / "absent", "must be a folder")):
        code, _, err = run(capsys, "study", place)
        assert code == 2
        assert said in err
