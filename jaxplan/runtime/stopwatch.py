"""A clock that stands still while JAX compiles, for limits on computing time.

Code is compiled once for all scenes of the same sizes, so a limit must not depend on which of them comes
first.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import jax

from jaxplan.runtime.progress import COMPILE_ENDS

_COMPILE_EVENTS = (
    "/jax/core/compile/jaxpr_trace_duration",
    "/jax/core/compile/jaxpr_to_mlir_module_duration",
    COMPILE_ENDS,
)


class _StoppedTime(threading.local):
    """How long, in s, the clock of this thread (`working_time`) has stood still."""

    seconds = 0.0


_stopped_time = _StoppedTime()


def _add_compile_time(event: str, duration_secs: float, **_: str | int) -> None:
    """Add the time of a compilation that has ended to that for which the clock has stood still."""
    if event in _COMPILE_EVENTS:  # JAX reports them in the thread that compiles
        _stopped_time.seconds += duration_secs


jax.monitoring.register_event_duration_secs_listener(_add_compile_time)


def working_time() -> float:
    """Return seconds since some instant, without those in which this thread compiled or waited for it."""
    return time.monotonic() - _stopped_time.seconds


@contextmanager
def lock_with_clock_stopped(turn: threading.RLock) -> Iterator[None]:
    """Hold the lock `turn` in a with block; this thread's clock stands still, as it does during the wait."""
    stopped, began = _stopped_time.seconds, time.monotonic()
    with turn:
        try:
            yield
        finally:
            _stopped_time.seconds = stopped + time.monotonic() - began
