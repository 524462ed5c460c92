"""One thread for the linear algebra while something is planned.

How many threads OpenBLAS takes changes the last bits of what it computes, so a plan would depend on the
number of cores. Its matrices here are small, too: on cores that others use, threads wait for each other many
times as long as one of them computes.
"""

import ctypes
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache

_NAMES = [
    (f"{prefix}openblas_get_num_threads{suffix}", f"{prefix}openblas_set_num_threads{suffix}")
    for prefix in ("scipy_", "")
    for suffix in ("64_", "")
]
_lock = threading.Lock()
_inside = 0
_before: list[int] = []


@contextmanager
def one_thread() -> Iterator[None]:
    """Let numpy and scipy have one thread each, in the whole process, until all who asked are done."""
    global _inside, _before
    libraries = _libraries()
    with _lock:
        if _inside == 0:
            _before = [get() for get, _ in libraries]
            for _, set_number in libraries:
                set_number(1)
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0:
                for (_, set_number), number in zip(libraries, _before, strict=True):
                    set_number(number)


@lru_cache(maxsize=1)
def _libraries() -> tuple[tuple[Callable[[], int], Callable[[int], object]], ...]:
    """What gets and sets the threads of each OpenBLAS in this process: numpy and scipy bring one each."""
    import numpy  # noqa: F401
    import scipy.linalg  # noqa: F401

    try:
        with open("/proc/self/maps", encoding="utf-8") as maps:
            paths = sorted({line.split(maxsplit=5)[-1].strip() for line in maps if "openblas" in line})
    except OSError:  # no such file on this system: threads stay as they are
        return ()
    found = []
    for path in paths:
        library = ctypes.CDLL(path)
        for get, set_number in _NAMES:
            if hasattr(library, get) and hasattr(library, set_number):
                found.append((getattr(library, get), getattr(library, set_number)))
                break
    return tuple(found)
