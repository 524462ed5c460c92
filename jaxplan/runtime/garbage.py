"""Context managers under which Python never or seldom looks for cyclic garbage, where objects are kept.

Tracing kernels and importing modules makes many objects that stay, and Python would search all of them again
and again: a tenth of the processor's time of a first plan or gradient, and a fifth of that of imports.
Planning makes little cyclic garbage, and with Python's own threshold the search for it takes a twentieth.
"""

import atexit
import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_COLLECTION_THRESHOLD = 100_000  # new objects before Python looks for garbage in `seldom_collected`; else 700

_uncollected_blocks = 0  # with blocks of `uncollected` that are running, in all threads
_was_collecting = False  # whether Python looked for garbage before the first of them
_count_lock = threading.Lock()


@contextmanager
def uncollected() -> Iterator[None]:
    """Stop Python's search for cyclic garbage while this with block, or one in another thread, runs."""
    global _uncollected_blocks, _was_collecting
    with _count_lock:
        if not _uncollected_blocks:
            _was_collecting = gc.isenabled()
            gc.disable()
        _uncollected_blocks += 1
    try:
        yield
    finally:
        with _count_lock:
            _uncollected_blocks -= 1
            if not _uncollected_blocks and _was_collecting:
                gc.enable()


_seldom_blocks = 0  # with blocks of `seldom_collected` that are running, in all threads
_usual_thresholds = gc.get_threshold()  # Python's thresholds before the first of them


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Make Python's search for cyclic garbage a hundred times rarer while this with block runs."""
    global _seldom_blocks, _usual_thresholds
    with _count_lock:
        if not _seldom_blocks:
            _usual_thresholds = gc.get_threshold()
            if _usual_thresholds[0]:  # else it never looks
                gc.set_threshold(max(_COLLECTION_THRESHOLD, _usual_thresholds[0]), *_usual_thresholds[1:])
        _seldom_blocks += 1
    try:
        yield
    finally:
        with _count_lock:
            _seldom_blocks -= 1
            if not _seldom_blocks:
                gc.set_threshold(*_usual_thresholds)


def end_without_collection() -> None:
    """Let Python not look for cyclic garbage when the process ends, which takes it a fifth of a second.

    This is for programs whose files are all closed by then: a file that is part of a cycle would not be.
    """
    atexit.register(gc.freeze)
