"""Work done ahead of need: kernels compiled side by side in threads, while something else goes on.

XLA lets go of Python's lock while it compiles, so on several cores a kernel that will be needed soon can be
compiled beside the one that is needed now. A task here is a call of one kernel with arguments of the right
shapes; what it answers does not matter. Whoever needs the kernel meanwhile waits for it and does not compile
it twice (`jaxplan.runtime.jit.quick_jit`). A kernel that nobody waits for any more is left when it has been
traced, so that a process need not wait for it at its end.
"""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager

Task = Callable[[], object]


class _Own(threading.local):
    """What a thread that works ahead has been told of its end; None in all other threads."""

    over: threading.Event | None = None


_own = _Own()


def still_wanted() -> bool:
    """Tell whether somebody waits, or may soon, for what this thread does; not after the end of `ahead`."""
    return _own.over is None or not _own.over.is_set()


def cores() -> int:
    """How many cores this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1


class Ahead:
    """Tasks that run in threads of their own, as many at once as there are cores; see `ahead`."""

    def __init__(self) -> None:
        self._left: deque[Task] = deque()
        self._lock, self._over, self._running = threading.Lock(), threading.Event(), 0

    def add(self, tasks: Sequence[Task]) -> None:
        """Run further tasks after those there are; on a single core they are dropped, as after the end."""
        with self._lock:
            if cores() == 1 or self._over.is_set():
                return
            self._left.extend(tasks)
            new = min(len(self._left), cores() - self._running)
            self._running += new
        for _ in range(new):
            threading.Thread(target=self._work).start()

    def end(self) -> None:
        """Drop the tasks that are not begun, and let the others end early."""
        self._over.set()

    def _work(self) -> None:
        """Run one task after the other, until none is left, one fails, or it is over."""
        _own.over = self._over
        try:
            while (task := self._next()) is not None:
                task()
        except Exception:
            with self._lock:
                self._running -= 1

    def _next(self) -> Task | None:
        """The next task of a thread; None, and the thread counts no more, where there is none."""
        with self._lock:
            if self._left and not self._over.is_set():
                return self._left.popleft()
            self._running -= 1
            return None


@contextmanager
def ahead(tasks: Sequence[Task]) -> Iterator[Ahead]:
    """Run tasks in threads of their own while a block runs; those not begun at its end are dropped.

    There are as many threads as cores, though the block's own is at work, too: of those that trace only one
    goes on at a time, so a core would wait. On a single core there are none.

    Args:
        tasks: in the order in which they will be needed. One that fails ends its thread in silence: whoever
            needs what it would have made meets the same fault, and tells of it.

    Yields:
        What takes further tasks.
    """
    found = Ahead()
    found.add(tasks)
    try:
        yield found
    finally:
        found.end()


def side_by_side(tasks: Sequence[Task], done: Callable[[], object]) -> None:
    """Run all tasks, as many at once as there are cores; raise the error of one that fails, drop the rest.

    Args:
        tasks: in any order.
        done: called after each task, in this thread.
    """
    pool = ThreadPoolExecutor(cores())
    futures = [pool.submit(task) for task in tasks]
    try:
        for future in as_completed(futures):
            future.result()
            done()
    finally:  # at once, after Ctrl-C as well
        pool.shutdown(wait=False, cancel_futures=True)
