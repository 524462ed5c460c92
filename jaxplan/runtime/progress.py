"""Progress bars on stderr, or in a notebook, for what takes longer than a second.

A bar is refreshed every second by a thread of its own, so that it appears and counts seconds while nothing
gets done, and it says when JAX is compiling. Where stderr is neither a terminal nor a notebook, a command may
ask for plain lines now and then instead (`seldom_lines`).
"""

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

_SIZE = {"ncols": 80, "nrows": 24}  # characters and lines, for a terminal that reports no size
_TICK = 1.0  # s, until a bar is shown, and between its refreshes
_SELDOM = 30.0  # s, least time between two plain lines
# JAX reports only ends; the end of lowering is the beginning of compiling.
_BEGINS = "/jax/core/compile/jaxpr_to_mlir_module_duration"
_ENDS = "/jax/core/compile/backend_compile_duration"

_open: set["Bar"] = set()
_listening = False
_lines: "_Lines | None" = None  # prints plain lines in place of bars; None for none


class _Lines:
    """Plain lines on stderr, at most one in `_SELDOM` s, and never the same twice in a row."""

    def __init__(self) -> None:
        self._began = self._last = time.monotonic()
        self._told = ""

    def tell(self, text: str) -> None:
        """Print a text and the time since the beginning, if a line is due and the text is a new one."""
        now = time.monotonic()
        if now - self._last < _SELDOM or text == self._told:
            return
        self._last, self._told = now, text
        minutes, seconds = divmod(round(now - self._began), 60)
        with suppress(OSError, ValueError):  # as when the reader of stderr has gone
            print(f"{text} [{minutes:02d}:{seconds:02d}]", file=sys.stderr, flush=True)


@contextmanager
def seldom_lines() -> Iterator[None]:
    """Print plain lines now and then for bars, in a with block, where stderr is no terminal or notebook."""
    global _lines
    before, _lines = _lines, _Lines()
    try:
        yield
    finally:
        _lines = before


class Bar:
    """An open progress bar, made by `progress_bar`."""

    def __init__(
        self, what: str, tqdm: Any, unit: str = "", total: int | None = None, initial: int = 0
    ) -> None:
        self._what, self._step, self._tqdm = what, "", tqdm
        self._unit, self._total, self._count, self._note = unit, total, initial, ""
        self._compiling = self._compiled = False
        self._closed = threading.Event()

    @property
    def done(self) -> int:
        """The count so far."""
        return self._count

    def update(self, count: int = 1) -> None:
        """Add to the count of what is done."""
        self._count += count
        self._tqdm.update(count)

    def step(self, name: str) -> None:
        """Show on the bar the name of the step that is being done; "" removes the last one."""
        self._step = name
        self._describe()

    def note(self, text: str) -> None:
        """Show a text after the bar, with its next refresh."""
        self._note = text
        self._tqdm.set_postfix_str(text, refresh=False)

    def say(self, text: str) -> None:
        """Print a line to stderr, above the bar where that is shown."""
        self._tqdm.write(text, file=sys.stderr)

    def compiles(self, begins: bool) -> None:
        """Note that JAX begins to compile (True), or has ended (False)."""
        self._compiling = begins
        self._compiled = True

    def tick_until_closed(self) -> None:
        """Refresh the bar every second until `close`; to be run in a thread of its own."""
        while not self._closed.wait(_TICK):
            self._describe()
            self._compiled = self._compiling
            self._tqdm.refresh()
            self._tqdm.delay = 0  # it shows, so it must be wiped out in the end

    def tell_until_closed(self, lines: _Lines) -> None:
        """Print what the bar would show, as plain lines, until `close`; to be run in a thread of its own."""
        while not self._closed.wait(_TICK):
            of = "" if self._total is None else f" of {self._total}"
            counted = [f"{self._count}{of} {self._unit}"] if self._unit else []
            lines.tell(", ".join([self._words(), *counted, *[self._note] * bool(self._note)]))
            self._compiled = self._compiling

    def close(self) -> None:
        """Stop refreshing the bar."""
        self._closed.set()

    def _describe(self) -> None:
        """Set the words before the bar."""
        self._tqdm.set_description_str(self._words(), refresh=False)

    def _words(self) -> str:
        """Return the words before the bar: what is done, the step, and whether something compiles."""
        parts = [self._step] * bool(self._step) + ["compiling"] * (self._compiling or self._compiled)
        return ": ".join([self._what, ", ".join(parts)] if parts else [self._what])


@contextmanager
def progress_bar(
    what: str, unit: str = "", *, total: int | None = None, initial: int = 0, shown: bool = True
) -> Iterator[Bar]:
    """Show a bar while a with block runs, once it takes longer than a second; yield the `Bar` to count with.

    Args:
        what: the first words of the bar, such as "tuning".
        unit: name of what is counted, in the plural, such as "steps"; empty to show the time alone.
        total: the count at the end; None if it is not known.
        initial: the count at the beginning.
        shown: False never to show it. It is not shown either where stderr is neither terminal nor notebook,
            except as plain lines, see `seldom_lines`.
    """
    from tqdm.auto import tqdm

    more: dict[str, Any] = {} if unit else {"bar_format": "{desc} [{elapsed}]"}
    if _tells_no_size():
        more |= _SIZE  # else there would be no room for a bar
    with tqdm(
        desc=what,
        unit=f" {unit}",
        total=total,
        initial=initial,
        delay=_TICK,
        leave=False,
        disable=not shown or None,  # None: where stderr is no terminal
        **more,
    ) as shape:
        bar = Bar(what, shape, unit, total, initial)
        lines = _lines if shown else None
        if shape.disable and lines is None:
            yield bar
            return
        _listen_to_jax()
        _open.add(bar)
        told = partial(bar.tell_until_closed, lines) if shape.disable and lines else bar.tick_until_closed
        ticking = threading.Thread(target=told, daemon=True)
        ticking.start()
        try:
            yield bar
        finally:
            _open.discard(bar)
            bar.close()
            ticking.join()


def _tells_no_size() -> bool:
    """Whether stderr is a terminal that reports zero columns or lines, as those of some programs do."""
    try:
        return 0 in os.get_terminal_size(sys.stderr.fileno())
    except (AttributeError, OSError, ValueError):  # it is no terminal
        return False


def _listen_to_jax() -> None:
    """Have JAX call `_hear` for its events; only the first call has an effect."""
    global _listening
    if not _listening:
        import jax

        _listening = True
        jax.monitoring.register_event_duration_secs_listener(_hear)


def _hear(event: str, duration_secs: float, **_: str | int) -> None:
    """Tell all open bars if an event of JAX is the beginning or end of a compilation."""
    if event in (_BEGINS, _ENDS):
        for bar in tuple(_open):
            bar.compiles(event == _BEGINS)
