"""Disks that are full or read-only: a clear error, what was there is there, and nothing is half there."""

import contextlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import make_scenario
from disks import mounted, small_files
from exports import flown_plan
from fake_study import plan_nothing, task
from matplotlib.figure import Figure

import jaxplan as jp
from jaxplan.cli import main
from jaxplan.cli.common import save
from jaxplan.exporting import FORMATS
from jaxplan.study.run import run_task

EPOCH = "2026-03-01T06:30:15.25"
SCENES = 12


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return flown_plan()


@pytest.fixture(scope="module")
def still() -> jp.Plan:
    """A whole plan, which takes no time."""
    scenario = make_scenario(2, 1)
    return jp.plan(replace(scenario, goal=scenario.start), progress=False)


def run(folder: Path, scenes: int = SCENES, chunk: int = 2) -> jp.Study:
    return run_task(task(scenes), None, folder, chunk, False, plan_nothing)


def content(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def writers(plan: jp.Plan, still: jp.Plan):
    """Everything that writes a file, by its suffix."""
    yield ".toml", lambda path: jp.save_scenario(still.scenario, path)
    yield ".json", lambda path: still.save(path)
    for name, kind in FORMATS.items():
        if name != "ck" and not kind.exact:  # ck needs an extra
            yield (
                kind.suffix,
                lambda path, name=name: jp.export(
                    plan, path, format=name, epoch=EPOCH, step_s=1.0, overwrite=True
                ),
            )


def test_a_full_disk_leaves_what_was_there_and_no_part_of_what_was_to_be(plan, still, tmp_path):
    for number, (suffix, write) in enumerate(writers(plan, still)):
        folder = tmp_path / str(number)
        folder.mkdir()
        old, new = folder / f"old{suffix}", folder / f"new{suffix}"
        write(old)
        before = content(folder)
        for target in (old, new) if number < 3 else (new,):
            with small_files(200), pytest.raises(OSError, match="File too large"):
                write(target)
            assert content(folder) == before, suffix
            assert not new.exists()


def test_a_figure_on_a_full_disk_is_no_half_picture(tmp_path, capsys):
    figure = Figure(figsize=(1, 1))
    noise = np.random.default_rng(0).uniform(size=(100, 100))  # which takes thousands of bytes
    figure.figimage(noise)
    save(figure, tmp_path / "old.png")
    before = content(tmp_path)
    for name in ("old.png", "new.png"):
        with small_files(2000), pytest.raises(OSError, match="File too large"):
            save(figure, tmp_path / name)
    assert content(tmp_path) == before
    assert capsys.readouterr().err == f"wrote {tmp_path / 'old.png'}\n"


@pytest.mark.parametrize("size", [900, 2500, 4000])
def test_a_study_on_a_full_disk_keeps_what_is_done_and_goes_on(tmp_path, size):
    with small_files(size), pytest.raises(OSError, match="File too large"):
        run(tmp_path / "study")
    done = jp.load_study(tmp_path / "study").table
    assert len(done) < SCENES
    whole = run(tmp_path / "study")
    assert whole.complete
    assert whole.table[: len(done)] == done
    assert json.dumps(whole.table) == json.dumps(run(tmp_path / "another").table)


def test_a_disk_that_is_full_from_the_first_byte_ends_the_study_before_any_scene(tmp_path):
    planned = []
    with small_files(0), pytest.raises(OSError, match="File too large"):
        run_task(task(SCENES), None, tmp_path / "study", 2, False, planned.append)
    assert not planned
    assert run(tmp_path / "study").complete


def test_a_file_system_without_room(plan, still, tmp_path):
    with mounted(tmp_path / "full", "size=64k") as folder:
        run(folder / "study", 2)
        before = json.dumps(jp.load_study(folder / "study").table)
        filler = folder / "filler"
        with contextlib.suppress(OSError), filler.open("wb") as file:
            while True:
                file.write(b"x" * 512)
                file.flush()
        assert json.dumps(jp.load_study(folder / "study").table) == before
        with pytest.raises(OSError, match="No space left"):
            still.save(folder / "plan.json")
        with pytest.raises(OSError, match="No space left"):
            jp.export(plan, folder / "slew.npz", format="npz")
        with pytest.raises(OSError, match="No space left"):
            run(folder / "other")
        assert not {file.name for file in folder.iterdir()} - {"study", "other", "filler"}
        filler.unlink()
        assert run(folder / "other", 2).complete


def test_a_file_system_that_is_read_only(plan, still, tmp_path, capsys):
    with mounted(tmp_path / "there", "ro") as folder:
        for write in (
            lambda: still.save(folder / "plan.json"),
            lambda: jp.export(plan, folder / "slew.csv", format="csv"),
            lambda: run(folder / "study"),
        ):
            with pytest.raises(OSError, match="Read-only file system"):
                write()
        for words in (("plan", "case-1", "-o"), ("study", "-n", "2", "--out"), ("table4", "-n", "1", "-o")):
            assert main([*words, str(folder / "out")]) == 2
            captured = capsys.readouterr()
            assert not captured.out
            assert "Read-only file system" in captured.err


def test_output_that_cannot_be_written_is_said_and_not_taken_for_done():
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "jaxplan", "--version"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == "jaxplan: No space left on device\n"
