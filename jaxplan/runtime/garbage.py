"""Blocks in which Python looks for no cyclic garbage, or seldom, since what they make is kept.

To trace a kernel, or to import modules, makes many objects that stay, through all of which Python would go
again and again: a tenth of the processor's time of a first plan or gradient, and a fifth of that of imports.
To plan makes little cyclic garbage, and with Python's own threshold looks for it take a twentieth.
"""

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_NEW_OBJECTS = 100_000  # between two looks for garbage in blocks of `seldom_collected`; Python has 700

_blocks = 0  # those of `uncollected` that have begun and not ended, in all threads
_collects = False  # whether Python looked for garbage before the first of them
_count_lock = threading.Lock()


@contextmanager
def uncollected() -> Iterator[None]:
    """Let Python look for no cyclic garbage while a block, or one like it in another thread, runs."""
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


_seldom = 0  # blocks of `seldom_collected`, likewise
_before = gc.get_threshold()  # the threshold before the first of them


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Let Python look for cyclic garbage a hundredth as often while a block, or one like it, runs."""
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
