"""Progress bars: quiet for a second, then counting, and telling that JAX compiles."""

import io
import os
import re
import select
import threading
import time
from contextlib import redirect_stderr

import jax
import pytest

import jaxplan as jp
from jaxplan.runtime import progress
from jaxplan.runtime.progress import progress_bar, seldom_lines

LOWERED, COMPILED = (
    "/jax/core/compile/jaxpr_to_mlir_module_duration",
    "/jax/core/compile/backend_compile_duration",
)


class Terminal(io.StringIO):
    """Keeps what is written, as somebody reads it, and tells when something new is there."""

    def __init__(self) -> None:
        super().__init__()
        self.new = threading.Event()

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        count = super().write(text)
        if text.strip():
            self.new.set()
        return count

    def wait(self) -> str:
        """The newest line after something new was written."""
        self.new.clear()
        assert self.new.wait(10)
        return [line for line in re.split(r"[\r\n]|\x1b\[\w", self.getvalue()) if line.strip()][-1]


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setattr(progress, "_REFRESH_TIME", 0.05)
    return Terminal()


def test_a_bar_tells_that_something_compiles_until_it_has(terminal):
    with redirect_stderr(terminal), progress_bar("planning") as bar:
        bar.step("search")
        assert terminal.wait().startswith("planning: search [")
        jax.monitoring.record_event_duration_secs(LOWERED, 0.1)
        terminal.wait()
        assert terminal.wait().startswith("planning: search, compiling [")
        jax.monitoring.record_event_duration_secs(COMPILED, 0.1)
        for _ in range(3):
            terminal.wait()
        assert terminal.wait().startswith("planning: search [")


def test_a_bar_tells_for_which_size_something_compiles(terminal):
    with redirect_stderr(terminal), progress_bar("planning") as bar:
        bar.compiles_for("8 zones")
        jax.jit(lambda x: x * 18.25)(1.0)
        terminal.wait(), terminal.wait()
    assert "planning: compiling for 8 zones [" in terminal.getvalue()


def test_what_jax_compiles_is_noticed(terminal):
    with redirect_stderr(terminal), progress_bar("planning"):
        jax.jit(lambda x: x * 17.25)(1.0)
        terminal.wait(), terminal.wait()
    assert "planning: compiling [" in terminal.getvalue()


def test_a_terminal_that_tells_no_size_shows_the_bar(monkeypatch):
    monkeypatch.setattr(progress, "_REFRESH_TIME", 0.02)
    reader, writer = os.openpty()  # of 0 x 0
    assert 0 in os.get_terminal_size(writer)
    seen = b""
    with (
        open(writer, "w") as stderr,
        redirect_stderr(stderr),
        progress_bar("planning", "scenes", total=4) as bar,
    ):
        bar.update(2)
        while b"2/4" not in seen and b"hidden" not in seen:
            assert select.select([reader], [], [], 10)[0], "nothing is shown"
            seen += os.read(reader, 1000)
    os.close(reader)
    assert re.search(rb"planning:  50%\|\S+ *\| 2/4 \[", seen)


def test_a_bar_counts_and_is_wiped_out_in_the_end(terminal):
    with redirect_stderr(terminal), progress_bar("study: mha", "scenes", total=7, initial=2) as bar:
        bar.update(3)
        bar.note("4 planned")
        line = terminal.wait()
        assert "study: mha:" in line
        assert " 5/7 " in line
        assert "4 planned" in line
    assert terminal.getvalue().endswith("\r")
    assert terminal.getvalue().split("\r")[-2].strip() == ""


def test_lines_are_printed_above_a_bar_and_without_one(terminal, monkeypatch):
    with redirect_stderr(terminal), progress_bar("drawing", "figures", total=3) as bar:
        bar.step("sphere")
        assert terminal.wait().startswith("drawing: sphere:")
        bar.say("wrote sphere.png")
        bar.update()
        terminal.wait()
    assert re.search(r"\rwrote sphere\.png\n", terminal.getvalue())
    quiet = io.StringIO()
    with redirect_stderr(quiet), progress_bar("drawing", "figures", total=3) as bar:
        bar.say("wrote sphere.png")
    assert quiet.getvalue() == "wrote sphere.png\n"


def test_nothing_is_shown_of_what_is_quick_or_not_to_be_seen(terminal, monkeypatch):
    with redirect_stderr(terminal), progress_bar("planning", shown=False) as bar:
        bar.step("search")
        bar.update()
    monkeypatch.setattr(progress, "_REFRESH_TIME", 60.0)
    with redirect_stderr(terminal), progress_bar("planning") as bar:
        bar.step("search")
        bar.update()
    assert terminal.getvalue() == ""


def test_a_bar_ends_with_what_raises_in_it(terminal):
    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt), redirect_stderr(terminal), progress_bar("planning"):
        raise KeyboardInterrupt
    assert threading.active_count() == before
    assert not progress._open_bars


def test_a_plan_says_at_which_step_it_is(monkeypatch):
    steps = []
    monkeypatch.setattr(progress.Bar, "step", lambda self, name: steps.append(name))
    jp.plan(jp.paper_case(4))
    assert steps[0] == "decompose"
    assert steps[-1] == "certificate"


def told_by(monkeypatch, seldom: float, steps: list[str], *, shown: bool = True) -> list[str]:
    """The plain lines, without times, of a bar whose steps last until they are told and some ticks more."""
    monkeypatch.setattr(progress, "_REFRESH_TIME", 0.01)
    monkeypatch.setattr(progress, "_TIME_BETWEEN_LINES", seldom)
    monkeypatch.setattr(progress.Bar, "compiles", lambda self, begins: None)  # what others do meanwhile
    pipe = io.StringIO()
    with (
        redirect_stderr(pipe),
        seldom_lines(),
        progress_bar("planning", "activities", total=9, initial=3, shown=shown) as bar,
    ):
        for step in steps:
            bar.step(step)
            for _ in range(100 if seldom < 1 and shown else 1):
                if f"{step}, " in pipe.getvalue():
                    break
                time.sleep(0.05)
            time.sleep(0.2)
    return [re.sub(r" \[\d\d:\d\d\]$", "", line) for line in pipe.getvalue().splitlines()]


def test_a_pipe_is_told_by_a_line_what_has_changed_and_nothing_twice(monkeypatch):
    assert told_by(monkeypatch, 0.02, ["search", "fit"]) == [
        "planning: search, 3 of 9 activities",
        "planning: fit, 3 of 9 activities",
    ]


def test_a_pipe_is_told_seldom_and_only_where_it_is_asked_for(monkeypatch):
    assert told_by(monkeypatch, 60.0, ["search"]) == []
    assert told_by(monkeypatch, 0.02, ["search"], shown=False) == []
    pipe = io.StringIO()
    with redirect_stderr(pipe), progress_bar("planning") as bar:
        bar.step("search")
        time.sleep(0.1)
    assert pipe.getvalue() == ""


def test_bars_after_each_other_share_the_time_between_lines(monkeypatch):
    monkeypatch.setattr(progress, "_REFRESH_TIME", 0.01)
    monkeypatch.setattr(progress, "_TIME_BETWEEN_LINES", 0.3)
    pipe, began = io.StringIO(), time.monotonic()
    with redirect_stderr(pipe), seldom_lines():
        for number in range(20):
            with progress_bar(f"drawing {number}"):
                time.sleep(0.05)
    lines = pipe.getvalue().splitlines()
    assert 1 <= len(lines) <= (time.monotonic() - began) / 0.3
