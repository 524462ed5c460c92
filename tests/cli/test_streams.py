"""What a command does although nobody reads what it prints."""

import os
import subprocess
import sys
from contextlib import contextmanager, redirect_stderr, redirect_stdout

import pytest
from matplotlib.figure import Figure

from jaxplan import plotting
from jaxplan.cli import common, main
from jaxplan.cli.streams import outlets


@contextmanager
def unread():
    """Make stdout and stderr one pipe, whose reader has ended."""
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w", buffering=1) as stream, redirect_stdout(stream), redirect_stderr(stream):
        yield
        assert sys.stdout is sys.stderr is stream


def test_all_figures_are_drawn_though_nobody_reads_their_names(monkeypatch, tmp_path):
    names = ["sphere", "angles", "rates"]
    monkeypatch.setattr(plotting, "drawings", lambda *_: [(name, Figure) for name in names])
    with unread(), outlets():
        common.draw(None, tmp_path)
    assert {file.stem for file in tmp_path.iterdir()} == set(names)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["validate", "case-4"], 0),
        (["validate", "absent.toml"], 2),
        (["plan", "absent.toml"], 2),
        (["new", "-"], 0),
        (["--version"], 0),
        ([], 2),
    ],
)
def test_the_exit_code_is_that_of_the_work_though_nobody_reads(words, code):
    with unread():
        assert main(words) == code


def test_help_that_nobody_reads_ends_well():
    with unread(), pytest.raises(SystemExit) as ended:
        main(["plan", "--help"])
    assert ended.value.code == 0


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_a_command_works_without_the_streams_that_it_lacks(closed, tmp_path):
    file = tmp_path / "scene.toml"
    words = f"exec {sys.executable} -m jaxplan new {file} --from case-2 {closed}"
    done = subprocess.run(words, shell=True, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr == (
        "" if "2>" in closed else f"wrote {file}; plan it with: jaxplan plan {file} -o out\n"
    )
    assert file.exists()


def test_a_full_disk_is_told():
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "jaxplan", "new", "-"]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "jaxplan: No space left on device\n")
