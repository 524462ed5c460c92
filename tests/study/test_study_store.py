import json
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import fake_study
import pytest
from fake_study import plan_nothing, task

import jaxplan as jp
from jaxplan.study import StudyFolderError
from jaxplan.study.run import run_task
from jaxplan.study.store import Store
from jaxplan.study.task import BLOCK, make_task

SCENES = 70


def run(folder: Path | None, scenes: int = SCENES, planner: str = "mha", work=plan_nothing) -> jp.Study:
    return run_task(task(scenes, planner), None, folder, 1, False, work)


def text(study: jp.Study) -> str:
    return json.dumps(study.table)


def never(chunk):
    pytest.fail(f"planned {chunk.numbers} again")


def test_a_study_in_a_folder_is_the_one_in_memory_and_is_read_back(tmp_path):
    in_memory, kept = run(None), run(tmp_path / "a" / "study")
    assert text(in_memory) == text(kept) == text(jp.load_study(tmp_path / "a" / "study"))
    assert in_memory.timings == kept.timings == jp.load_study(kept.folder).timings
    assert kept.complete
    assert sorted(file.name for file in kept.folder.iterdir()) == [
        ".lock",
        "study.json",
        "table.jsonl",
        "timings.jsonl",
    ]


def test_what_is_done_is_not_planned_again(tmp_path):
    first = run(tmp_path)
    assert text(run(tmp_path, work=never)) == text(first)


@pytest.mark.parametrize("kills", [2])
def test_a_killed_study_goes_on_to_the_same_table(tmp_path, kills):
    chance = random.Random(0)
    command = [sys.executable, fake_study.__file__, str(tmp_path), str(SCENES), "0.02"]
    table = tmp_path / "table.jsonl"
    killed = 0
    for _ in range(kills):
        before = table.stat().st_size if table.exists() else 0
        process = subprocess.Popen(command)
        while (table.stat().st_size if table.exists() else 0) <= before and process.poll() is None:
            time.sleep(0.005)
        time.sleep(chance.uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
        killed += process.wait() == -signal.SIGKILL
    assert killed == kills
    done = jp.load_study(tmp_path).table
    assert 0 < len(done) < SCENES
    planned = []
    study = run(tmp_path, work=lambda chunk: planned.extend(chunk.numbers) or plan_nothing(chunk))
    assert set(planned) >= set(range(SCENES)) - {row["scene"] for row in done}
    assert len(planned) < SCENES
    assert text(study) == text(run(None))


@pytest.mark.parametrize("file", ["table.jsonl", "timings.jsonl"])
@pytest.mark.parametrize(
    "damage",
    [
        lambda lines: [*lines[:-1], lines[-1][:40]],
        lambda lines: [*lines, b"\x00" * 100],
        lambda lines: [*lines[:7], lines[7].replace(b'"scene"', b'"scent"'), *lines[8:]],
        lambda lines: [*lines[:7], lines[7].replace(b'"name": "', b'"name": 3, "x": "'), *lines[8:]],
        lambda lines: [*lines[:7], b'{"scene": 9999}\n', b"[]\n", b"NaN\n"],
        lambda lines: [],
    ],
    ids=["torn", "zeros", "key", "type", "nonsense", "empty"],
)
def test_damaged_lines_are_planned_again(tmp_path, file, damage):
    first = run(tmp_path)
    path = tmp_path / file
    path.write_bytes(b"".join(damage(path.read_bytes().splitlines(keepends=True))))
    assert text(run(tmp_path)) == text(first)
    assert len(jp.load_study(tmp_path).table) == SCENES


def test_another_study_is_refused_and_the_message_names_what_differs(tmp_path):
    first = text(run(tmp_path))
    with pytest.raises(StudyFolderError, match=r'planner "mha" there, "wastar" here'):
        run(tmp_path, planner="wastar")
    with pytest.raises(StudyFolderError, match=r"scenes 70 there, 69 here; seeds \[\[0, 69\]\] there"):
        run(tmp_path, SCENES - 1)
    with pytest.raises(StudyFolderError) as caught:
        run(tmp_path, SCENES + 30, planner="wastar")
    assert 'study (planner "mha" there, "wastar" here):' in str(caught.value)  # more scenes are no fault
    later = replace(task(SCENES), scenes=range(1, 200))
    with pytest.raises(StudyFolderError, match=r"study \(seeds \[\[0, 69\]\] there, \[\[1, 199\]\] here\)"):
        run_task(later, None, tmp_path, 1, False, never)
    header = tmp_path / "study.json"
    header.write_text(header.read_text().replace(jp.__version__, "0.0.1"))
    with pytest.raises(StudyFolderError, match=r'jaxplan "0\.0\.1" there'):
        run(tmp_path)
    assert text(jp.load_study(tmp_path)) == first


@pytest.mark.parametrize("scenes", [SCENES + 1, 200])
@pytest.mark.parametrize("first", [SCENES, 64, 3])
def test_a_longer_study_goes_on_from_a_shorter_one(tmp_path, first, scenes):
    planned: list[int] = []

    def in_company(chunk):
        """Rows that tell with which scenes each was planned, on which last digits of a real plan depend."""
        planned.extend(chunk.numbers)
        answer = plan_nothing(chunk)
        for row in answer.table:
            row["message"] = f"{[n for n in chunk.numbers if n // BLOCK == row['scene'] // BLOCK]}"
        return answer

    run(tmp_path, first, work=in_company)
    planned.clear()
    grown = run(tmp_path, scenes, work=in_company)
    assert sorted(planned) == list(range(first - first % BLOCK, scenes))
    assert grown.complete
    assert text(grown) == text(run(None, scenes, work=in_company)) == text(jp.load_study(tmp_path))
    assert [row["scene"] for row in grown.timings] == list(range(scenes))
    assert text(run(tmp_path, scenes, work=never)) == text(grown)


def test_a_study_that_was_interrupted_may_be_made_longer(tmp_path):
    run(tmp_path)
    path = tmp_path / "table.jsonl"
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[10:40]))
    assert text(run(tmp_path, 90)) == text(run(None, 90))


def test_scenes_of_ones_own_become_more_at_the_end_alone(tmp_path):
    scenes = [jp.random_scenario(seed) for seed in range(3)]
    for count in (1, 3):
        own = make_task(scenes[:count], None, "mha", None)
        assert run_task(own, None, tmp_path, 1, False, plan_nothing).complete
    other = make_task([*scenes[::-1], scenes[0]], None, "mha", None)
    with pytest.raises(StudyFolderError, match="scenarios"):
        run_task(other, None, tmp_path, 1, False, never)


def test_a_folder_of_something_else_is_refused_and_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    (tmp_path / "file").write_text("mine")
    for folder, words in {
        tmp_path: "holds file, but no study",
        tmp_path / "file": "file is a file",
        tmp_path / "file" / "below": "cannot be a folder",
        "": "out is empty",
    }.items():
        with pytest.raises(StudyFolderError, match=words):
            run(folder, work=never)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file", "thesis.tex"]
    with pytest.raises(StudyFolderError, match="holds no study"):
        jp.load_study(tmp_path)
    (tmp_path / "study.json").write_text('{"jaxplan": 1}')
    with pytest.raises(StudyFolderError, match=r"study\.json: not the head of a study \(jaxplan"):
        jp.load_study(tmp_path)


def test_links_are_not_followed(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_text("mine")
    run(tmp_path / "study")
    for name in ("table.jsonl", "timings.jsonl", ".lock"):
        path = tmp_path / "study" / name
        path.unlink()
        path.symlink_to(elsewhere)
        with pytest.raises(StudyFolderError, match=f"{name}: is a link"):
            run(tmp_path / "study", work=never)
        path.unlink()
    assert elsewhere.read_text() == "mine"


def test_two_processes_do_not_work_on_one_folder(tmp_path):
    with Store(tmp_path, task(SCENES)), pytest.raises(StudyFolderError, match="another process is working"):
        run(tmp_path, work=never)
    assert run(tmp_path).complete


def test_a_full_disk_ends_the_study_and_loses_nothing(tmp_path, monkeypatch):
    force, calls = os.fsync, []

    def full(handle):
        calls.append(handle)
        if len(calls) > 7:
            raise OSError(28, "No space left on device")
        force(handle)

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left"):
        run(tmp_path)
    monkeypatch.undo()
    assert 0 < len(jp.load_study(tmp_path).table) < SCENES
    assert text(run(tmp_path)) == text(run(None))


def test_an_interrupted_study_is_returned_as_far_as_it_is_and_goes_on(tmp_path):
    def interrupted(chunk):
        if 40 in chunk.numbers:
            raise KeyboardInterrupt
        return plan_nothing(chunk)

    for folder in (tmp_path, None):
        part = run(folder, work=interrupted)
        assert [row["scene"] for row in part.table] == list(range(32))
        assert not part.complete
        assert "32 done of 70" in str(part.summary())
    assert text(run(tmp_path)) == text(run(None))


def test_settings_that_are_infinite_are_kept_as_files_have_them(tmp_path):
    settings = {"trajectory.node_tube_deg": float("inf")}
    asked = make_task(range(4), None, "mha", settings)
    assert asked.settings == {"trajectory.node_tube_deg": "inf"}
    first = run_task(asked, None, tmp_path, 1, False, plan_nothing)
    assert text(run_task(asked, None, tmp_path, 1, False, never)) == text(first)
    with pytest.raises(ValueError, match="settings"):
        make_task(range(4), None, "mha", {"trajectory.rate_weight": float("nan")})


def test_damaged_and_absent_timings_leave_the_table_as_it_is(tmp_path):
    study = run(tmp_path)
    before = study.timings
    timings = tmp_path / "timings.jsonl"
    timings.write_bytes(b"?" + timings.read_bytes())
    again = run(tmp_path, work=never)
    assert text(again) == text(study)
    assert again.timings == before[1:]
    timings.unlink()
    absent = jp.load_study(tmp_path)
    assert text(absent) == text(study)
    assert f"{SCENES}" in str(absent.summary())
