"""Tasks ahead of need: run in threads of their own, while something else goes on.

XLA releases Python's global lock while it compiles, so on several cores a kernel that will be needed soon can
be compiled beside the one that is needed now. A *task* is a call of one kernel with arguments of the right
shapes; its result is not used. Whoever needs the kernel meanwhile waits for it and does not compile it twice
(`jaxplan.runtime.jit.quick_jit`). If nobody waits for a kernel any more, its thread stops once it has been
traced, so that a process need not wait for it at its end.
"""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager

Task = Callable[[], object]


class _ThreadState(threading.local):
    """The event by which this thread is told to end, if it works ahead; None in all other threads."""

    over: threading.Event | None = None


_thread_state = _ThreadState()


def still_wanted() -> bool:
    """Tell whether this thread's work may still be needed: until `ahead` has ended, and in other threads."""
    return _thread_state.over is None or not _thread_state.over.is_set()


def cores() -> int:
    """Return how many cores this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1


class NoLongerWantedError(Exception):
    """Ends a thread that compiles ahead once nobody waits for its work."""


class Ahead:
    """Tasks that run in threads of their own, as many at once as there are cores; see `ahead`."""

    def __init__(self) -> None:
        self._tasks_left: deque[Task] = deque()
        self._lock, self._ended, self._running_threads = threading.Lock(), threading.Event(), 0

    def add(self, tasks: Sequence[Task]) -> None:
        """Run further tasks after those there are; they are dropped on a single core, or after the end."""
        with self._lock:
            if cores() == 1 or self._ended.is_set():
                return
            self._tasks_left.extend(tasks)
            new = min(len(self._tasks_left), cores() - self._running_threads)
            self._running_threads += new
        for _ in range(new):
            threading.Thread(target=self._run_tasks).start()

    def end(self) -> None:
        """Drop the tasks that have not begun, and make those that run end early."""
        self._ended.set()

    def _run_tasks(self) -> None:
        """Run one task after the other, until none is left, one fails, or `end` has been called."""
        _thread_state.over = self._ended
        try:
            while (task := self._take_task()) is not None:
                task()
        except Exception:
            with self._lock:
                self._running_threads -= 1

    def _take_task(self) -> Task | None:
        """Return the next task for this thread; None, and count one thread less, where there is none."""
        with self._lock:
            if self._tasks_left and not self._ended.is_set():
                return self._tasks_left.popleft()
            self._running_threads -= 1
            return None


@contextmanager
def ahead(tasks: Sequence[Task]) -> Iterator[Ahead]:
    """Run tasks in threads of their own while a with block runs; those not begun at its end are dropped.

    There are as many threads as cores, in addition to the block's own. Only one thread can trace at a time,
    so with fewer a core would be idle. On a single core there are none.

    Args:
        tasks: the tasks, in the order in which they will be needed. One that fails ends its thread silently:
            whoever needs its result will meet and report the same error.

    Yields:
        An object that takes further tasks.
    """
    found = Ahead()
    found.add(tasks)
    try:
        yield found
    finally:
        found.end()


def side_by_side(tasks: Sequence[Task], done: Callable[[], object]) -> None:
    """Run all tasks, as many at once as there are cores; if one fails, raise its error and drop the rest.

    Args:
        tasks: the tasks, in any order.
        done: called after each task, in the calling thread.
    """
    pool = ThreadPoolExecutor(cores())
    futures = [pool.submit(task) for task in tasks]
    try:
        for future in as_completed(futures):
            future.result()
            done()
    finally:  # at once, after Ctrl-C as well
        pool.shutdown(wait=False, cancel_futures=True)
