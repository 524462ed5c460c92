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

_FALLBACK_SIZE = {"ncols": 80, "nrows": 24}  # characters and lines, for a terminal that reports no size
_REFRESH_TIME = 1.0  # s, until a bar is shown, and between its refreshes
_TIME_BETWEEN_LINES = 30.0  # s, least time between two plain lines
# JAX reports only ends; the end of lowering is the beginning of compiling.
_COMPILE_BEGINS = "/jax/core/compile/jaxpr_to_mlir_module_duration"
COMPILE_ENDS = "/jax/core/compile/backend_compile_duration"

_open_bars: set["Bar"] = set()
_is_listening = False
_line_printer: "_LinePrinter | None" = None  # prints plain lines in place of bars; None for none


class _LinePrinter:
    """Plain lines on stderr, at most one in `_TIME_BETWEEN_LINES` s, and never the same twice in a row."""

    def __init__(self) -> None:
        self._start_time = self._last_time = time.monotonic()
        self._last_text = ""

    def tell(self, text: str) -> None:
        """Print a text and the time since the beginning, if a line is due and the text is a new one."""
        now = time.monotonic()
        if now - self._last_time < _TIME_BETWEEN_LINES or text == self._last_text:
            return
        self._last_time, self._last_text = now, text
        minutes, seconds = divmod(round(now - self._start_time), 60)
        with suppress(OSError, ValueError):  # as when the reader of stderr has gone
            print(f"{text} [{minutes:02d}:{seconds:02d}]", file=sys.stderr, flush=True)


@contextmanager
def seldom_lines() -> Iterator[None]:
    """Print plain lines now and then for bars, in a with block, where stderr is no terminal or notebook."""
    global _line_printer
    before, _line_printer = _line_printer, _LinePrinter()
    try:
        yield
    finally:
        _line_printer = before


class Bar:
    """An open progress bar, made by `progress_bar`."""

    def __init__(
        self, what: str, tqdm: Any, unit: str = "", total: int | None = None, initial: int = 0
    ) -> None:
        self._what, self._step, self._tqdm = what, "", tqdm
        self._unit, self._total, self._count, self._note = unit, total, initial, ""
        self._compiling = self._has_compiled = False
        self._size = ""
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
        self._set_description()

    def note(self, text: str) -> None:
        """Show a text after the bar, with its next refresh."""
        self._note = text
        self._tqdm.set_postfix_str(text, refresh=False)

    def say(self, text: str) -> None:
        """Print a line to stderr, above the bar where that is shown."""
        self._tqdm.write(text, file=sys.stderr)

    def compiles_for(self, size: str) -> None:
        """Say for which size class kernels are compiled, such as "8 zones"; "" for none."""
        self._size = size

    def compiles(self, begins: bool) -> None:
        """Note that JAX begins to compile (True), or has ended (False)."""
        self._compiling = begins
        self._has_compiled = True

    def tick_until_closed(self) -> None:
        """Refresh the bar every second until `close`; to be run in a thread of its own."""
        while not self._closed.wait(_REFRESH_TIME):
            self._set_description()
            self._has_compiled = self._compiling
            self._tqdm.refresh()
            self._tqdm.delay = 0  # it shows, so it must be wiped out in the end

    def tell_until_closed(self, lines: _LinePrinter) -> None:
        """Print what the bar would show, as plain lines, until `close`; to be run in a thread of its own."""
        while not self._closed.wait(_REFRESH_TIME):
            of = "" if self._total is None else f" of {self._total}"
            counted = [f"{self._count}{of} {self._unit}"] if self._unit else []
            lines.tell(", ".join([self._description(), *counted, *[self._note] * bool(self._note)]))
            self._has_compiled = self._compiling

    def close(self) -> None:
        """Stop refreshing the bar."""
        self._closed.set()

    def _set_description(self) -> None:
        """Set the words before the bar."""
        self._tqdm.set_description_str(self._description(), refresh=False)

    def _description(self) -> str:
        """Return the words before the bar: what is done, the step, and whether something compiles."""
        compiling = f"compiling for {self._size}" if self._size else "compiling"
        parts = [self._step] * bool(self._step) + [compiling] * (self._compiling or self._has_compiled)
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
        more |= _FALLBACK_SIZE  # else there would be no room for a bar
    with tqdm(
        desc=what,
        unit=f" {unit}",
        total=total,
        initial=initial,
        delay=_REFRESH_TIME,
        leave=False,
        disable=not shown or None,  # None: where stderr is no terminal
        **more,
    ) as shape:
        bar = Bar(what, shape, unit, total, initial)
        lines = _line_printer if shown else None
        if shape.disable and lines is None:
            yield bar
            return
        _listen_to_jax()
        _open_bars.add(bar)
        told = partial(bar.tell_until_closed, lines) if shape.disable and lines else bar.tick_until_closed
        ticking = threading.Thread(target=told, daemon=True)
        ticking.start()
        try:
            yield bar
        finally:
            _open_bars.discard(bar)
            bar.close()
            ticking.join()


def _tells_no_size() -> bool:
    """Tell whether stderr is a terminal that reports zero columns or lines, as those of some programs do."""
    try:
        return 0 in os.get_terminal_size(sys.stderr.fileno())
    except (AttributeError, OSError, ValueError):  # it is no terminal
        return False


def _listen_to_jax() -> None:
    """Have JAX call `_tell_bars` for its events; only the first call has an effect."""
    global _is_listening
    if not _is_listening:
        import jax

        _is_listening = True
        jax.monitoring.register_event_duration_secs_listener(_tell_bars)


def _tell_bars(event: str, duration_secs: float, **_: str | int) -> None:
    """Tell all open bars if an event of JAX is the beginning or end of a compilation."""
    if event in (_COMPILE_BEGINS, COMPILE_ENDS):
        for bar in tuple(_open_bars):
            bar.compiles(event == _COMPILE_BEGINS)
