"""Context managers under which Python never or seldom looks for cyclic garbage, where objects are kept.

Tracing kernels and importing modules makes many objects that stay, and Python would search all of them again
and again: a tenth of the processor's time of a first plan or gradient, and a fifth of that of imports.
Planning makes little cyclic garbage, and with Python's own threshold the search for it takes a twentieth.
"""

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_NEW_OBJECTS = 100_000  # new objects before Python looks for garbage in `seldom_collected`; else 700

_blocks = 0  # with blocks of `uncollected` that are running, in all threads
_collects = False  # whether Python looked for garbage before the first of them
_count_lock = threading.Lock()


@contextmanager
def uncollected() -> Iterator[None]:
    """Stop Python's search for cyclic garbage while this with block, or one in another thread, runs."""
    global _blocks, _collects
    with _count_lock:
        if not _blocks:
            _collects = gc.isenabled()
            gc.disable()
        _blocks += 1
    try:
        yield
    finally:
        with _count_lock:
            _blocks -= 1
            if not _blocks and _collects:
                gc.enable()


_seldom = 0  # with blocks of `seldom_collected` that are running, in all threads
_before = gc.get_threshold()  # Python's thresholds before the first of them


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Make Python's search for cyclic garbage a hundred times rarer while this with block runs."""
    global _seldom, _before
    with _count_lock:
        if not _seldom:
            _before = gc.get_threshold()
            if _before[0]:  # else it never looks
                gc.set_threshold(max(_NEW_OBJECTS, _before[0]), *_before[1:])
        _seldom += 1
    try:
        yield
    finally:
        with _count_lock:
            _seldom -= 1
            if not _seldom:
                gc.set_threshold(*_before)
