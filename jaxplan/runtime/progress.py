"""Progress bars on stderr, or in a notebook, of what takes longer than a second.

A bar ticks by itself, so that it shows and counts seconds while nothing gets done, and it says when that is
because JAX compiles.
"""

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_SIZE = {"ncols": 80, "nrows": 24}  # characters and lines, of a terminal that tells no size
_TICK = 1.0  # s, until a bar shows, and between two looks at whether something compiles
# JAX tells only of ends; the end of lowering is the beginning of compiling.
_BEGINS = "/jax/core/compile/jaxpr_to_mlir_module_duration"
_ENDS = "/jax/core/compile/backend_compile_duration"

_open: set["Bar"] = set()
_listening = False


class Bar:
    """A bar that is open; `progress_bar` makes it."""

    def __init__(self, what: str, tqdm: Any) -> None:
        self._what, self._step, self._tqdm = what, "", tqdm
        self._compiling = self._compiled = False
        self._closed = threading.Event()

    @property
    def done(self) -> int:
        """The count so far."""
        return int(self._tqdm.n)

    def update(self, count: int = 1) -> None:
        """Add to the count of what is done."""
        self._tqdm.update(count)

    def step(self, name: str) -> None:
        """Name, on the bar, the step that is being done; an empty name takes the last one away."""
        self._step = name
        self._describe()

    def note(self, text: str) -> None:
        """Show a text after the bar, with its next refresh."""
        self._tqdm.set_postfix_str(text, refresh=False)

    def say(self, text: str) -> None:
        """Print a line to stderr, above the bar where that shows."""
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

    def close(self) -> None:
        """End the ticking."""
        self._closed.set()

    def _describe(self) -> None:
        """Set the words before the bar: what is done, the step, and whether something compiles."""
        parts = [self._step] * bool(self._step) + ["compiling"] * (self._compiling or self._compiled)
        text = ": ".join([self._what, ", ".join(parts)] if parts else [self._what])
        self._tqdm.set_description_str(text, refresh=False)


@contextmanager
def progress_bar(
    what: str, unit: str = "", *, total: int | None = None, initial: int = 0, shown: bool = True
) -> Iterator[Bar]:
    """Show a bar while a block runs, once it takes longer than a second; gives the `Bar` to count with.

    Args:
        what: the first words of the bar, such as "tuning".
        unit: name of what is counted, in the plural, such as "steps"; empty to show the time alone.
        total: the count at the end, None if it is not known.
        initial: the count at the beginning.
        shown: False never to show it; it is not shown either where stderr is neither terminal nor notebook.
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
        bar = Bar(what, shape)
        if shape.disable:
            yield bar
            return
        _listen_to_jax()
        _open.add(bar)
        ticking = threading.Thread(target=bar.tick_until_closed, daemon=True)
        ticking.start()
        try:
            yield bar
        finally:
            _open.discard(bar)
            bar.close()
            ticking.join()


def _tells_no_size() -> bool:
    """Whether stderr is a terminal that says it has zero columns or lines, as those of some programs do."""
    try:
        return 0 in os.get_terminal_size(sys.stderr.fileno())
    except (AttributeError, OSError, ValueError):  # it is none
        return False


def _listen_to_jax() -> None:
    """Have JAX call `_hear` for its events, from the first call on."""
    global _listening
    if not _listening:
        import jax

        _listening = True
        jax.monitoring.register_event_duration_secs_listener(_hear)


def _hear(event: str, duration_secs: float, **_: str | int) -> None:
    """Tell all open bars if an event of JAX begins or ends a compilation."""
    if event in (_BEGINS, _ENDS):
        for bar in tuple(_open):
            bar.compiles(event == _BEGINS)
