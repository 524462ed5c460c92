"""Blocks in which Python looks for no cyclic garbage, since what they make is kept.

To trace a kernel, or to import modules, makes many objects that stay, through all of which Python would go
again and again: a tenth of the processor's time of a first plan or gradient, and a fifth of that of imports.
"""

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager

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
