"""Worker processes that run side by side, and a single thread for linear algebra in each process.

**One thread** for linear algebra during planning. The number of threads that OpenBLAS uses changes the last
bits of its results, so plans would depend on the number of cores. Its matrices are small here, too: on cores
that other programs use, threads wait for each other many times as long as one of them computes.

**Workers** are the processes that do the work: those of an executor that the caller gives, or processes
started here, which are started again when one dies. JAX hangs in processes that are forked after it has
started, so ours are spawned, and a given pool that forks is refused. A spawned process first runs the user's
script, if there is one, so that what is defined there can be unpickled. Each of our processes reads compiled
code from the folder that this process uses, leaves Ctrl-C to this process, and ends when it does.
"""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from functools import lru_cache
from multiprocessing import current_process, parent_process, util
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from jaxplan.runtime import cache

_OPENBLAS_FUNCTIONS = [
    (f"{prefix}openblas_get_num_threads{suffix}", f"{prefix}openblas_set_num_threads{suffix}")
    for prefix in ("scipy_", "")
    for suffix in ("64_", "")
]
_blocks_lock = threading.Lock()
_running_blocks = 0
_usual_thread_counts: list[int] = []


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit OpenBLAS to one thread in the whole process while this with block, or one elsewhere, runs."""
    global _running_blocks, _usual_thread_counts
    libraries = _openblas_libraries()
    with _blocks_lock:
        if _running_blocks == 0:
            _usual_thread_counts = [get() for get, _ in libraries]
            for _, set_number in libraries:
                set_number(1)
        _running_blocks += 1
    try:
        yield
    finally:
        with _blocks_lock:
            _running_blocks -= 1
            if _running_blocks == 0:
                for (_, set_number), number in zip(libraries, _usual_thread_counts, strict=True):
                    set_number(number)


@lru_cache(maxsize=1)
def _openblas_libraries() -> tuple[tuple[Callable[[], int], Callable[[int], object]], ...]:
    """Return functions that get and set the number of threads of each OpenBLAS here, numpy's and scipy's."""
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
        for get, set_number in _OPENBLAS_FUNCTIONS:
            if hasattr(library, get) and hasattr(library, set_number):
                found.append((getattr(library, get), getattr(library, set_number)))
                break
    return tuple(found)


Workers = Executor | int
"""What does the work: a given executor, or a number of processes of our own."""

Part = TypeVar("Part")
Answer = TypeVar("Answer")

_WORKER_NAME = "jaxplan-worker"
_UNGUARDED_EXIT_CODE = 113  # of a worker in which the user's script repeats the call that started it


class _Worker(SpawnProcess):
    """A worker process, recognisable by its name even while it runs the user's script."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.name = f"{_WORKER_NAME}{self.name[len(type(self).__name__) :]}"

    def start(self) -> None:
        """Start the process, with the user's script if that is a file."""
        with _hide_missing_script():
            super().start()


class _WorkerContext(SpawnContext):
    """A multiprocessing context whose processes are `_Worker`."""

    Process = _Worker


@contextmanager
def _hide_missing_script() -> Iterator[None]:
    """Hide, in a with block, the name of a script that came by stdin, which no other process could open."""
    main = sys.modules["__main__"]
    name = getattr(main, "__file__", None)
    if name is None or Path(name).exists():
        yield
        return
    del main.__file__
    try:
        yield
    finally:
        main.__file__ = name


class WorkerPool:
    """A pool of workers to which parts of some work are given.

    Args:
        workers: a number of processes, which are started, or an executor, which is used as it is.
    """

    def __init__(self, workers: Workers) -> None:
        self._own_pool: ProcessPoolExecutor | None = None  # our own
        self._executor: Executor
        if isinstance(workers, int | np.integer):
            self._start_pool(int(workers))
        else:
            self._executor, self.workers = workers, os.cpu_count() or 1
            if isinstance(workers, ProcessPoolExecutor) and not workers._processes:
                with suppress(BrokenExecutor):  # as it does to whoever hands it work
                    _start_first_process(workers)

    def submit(self, work: Callable[[Part], Answer], part: Part) -> "Future[Answer]":
        """Have a worker call ``work(part)``; return the future with its result.

        Raises:
            BrokenExecutor: if the workers are gone.
        """
        return self._executor.submit(work, part)

    def restart(self) -> None:
        """Kill our processes and start as many new ones, after one has died."""
        self.shutdown(at_once=True)
        self._start_pool(self.workers)

    def shutdown(self, *, at_once: bool) -> None:
        """End our processes, killed at once or after their present work; a given executor is left alone."""
        if self._own_pool is None:
            return
        if at_once:
            # All of them, since one that is killed may keep a lock that others wait for. From Python 3.14 on
            # the pool itself has a method for this.
            for process in list((self._own_pool._processes or {}).values()):
                process.kill()
        self._own_pool.shutdown(cancel_futures=True)
        self._own_pool = None

    def _start_pool(self, workers: int) -> None:
        """Make a pool of so many processes, and start the first; raise a WorkersDiedError if it dies."""
        self.workers = workers
        pool = ProcessPoolExecutor(workers, _WorkerContext(), _set_up_worker, (cache.settings(),))
        self._executor = self._own_pool = pool
        try:
            _start_first_process(pool)
        except BrokenExecutor:
            raise WorkersDiedError(_DIED_MESSAGE) from None


def _start_first_process(pool: ProcessPoolExecutor) -> None:
    """Start one process of a pool, and wait until it works; the others start when there is work for them.

    Raises:
        WorkersDiedError: if it ran the user's script as far as the call that started it.
        BrokenExecutor: if it died for another reason.
    """
    begun = pool.submit(os.getpid)
    processes = list((pool._processes or {}).values())
    try:
        begun.result()
    except BrokenExecutor:
        pool.shutdown()  # after this, exit codes are known
        if any(process.exitcode == _UNGUARDED_EXIT_CODE for process in processes):
            raise WorkersDiedError(_guard_advice()) from None
        raise


class WorkersDiedError(RuntimeError):
    """Workers died as they began; public functions raise it anew, without internal lines in the traceback."""


_DIED_MESSAGE = (
    "a worker process died as it began, and what it printed says why; each reads the script first, so what "
    'only this process shall do belongs below `if __name__ == "__main__":`'
)


def _guard_advice() -> str:
    """Return the message on how to guard a script against being run completely by each of its workers."""
    known = (getattr(sys.modules["__main__"], "__file__", None), *sys.argv[:1])
    name = next((Path(path).name for path in known if path and path != "-c"), "the script")
    return (
        f'{name}: put what uses worker processes below `if __name__ == "__main__":`, since each of them '
        "reads the script, too, and would begin workers of its own"
    )


def who_works(workers: Workers | None, executor: Workers | None) -> Workers | None:
    """Check the workers that a caller gives under either name of the argument; None to work in this process.

    If one of our own processes, still running the user's script, gets here, it is ended: the same line of the
    script started it, and there the call raises an error that says what to do.

    Raises:
        TypeError: if it is neither an executor nor a number, or is given under both names.
        ValueError: for less than one process, or a pool that forks.
    """
    if workers is not None and executor is not None:
        raise TypeError("workers and executor are two names of the same argument: give workers alone")
    given = executor if workers is None else workers
    if given is not None:
        _exit_if_unguarded()
        _check_workers("executor" if workers is None else "workers", given)
    return given


def _exit_if_unguarded() -> None:
    """End this process if it is a spawned one that still runs the user's script; see `who_works`."""
    process = current_process()
    if getattr(process, "_inheriting", False):  # it is still running the user's script
        if not process.name.startswith(_WORKER_NAME):
            print(_guard_advice(), file=sys.stderr, flush=True)  # who began it may not know what to say
        finish: Any = util
        finish._run_finalizers(0)  # of a pool of the script's, else warnings of semaphores come last
        os._exit(_UNGUARDED_EXIT_CODE)  # at once: no clean-up of the script's own in its name


def _check_workers(name: str, given: object) -> None:
    """Raise a TypeError or ValueError, as of `who_works`, if an object is no usable executor or number."""
    if isinstance(given, int | np.integer) and not isinstance(given, bool):
        if given < 1:
            raise ValueError(f"{name} = {given}: must be at least 1, as a number of processes")
    elif not isinstance(given, Executor):
        raise TypeError(
            f"{name} must be a concurrent.futures.Executor or a number of processes, not "
            f"{type(given).__name__}; a Dask client has one by get_executor()"
        )
    context = getattr(given, "_mp_context", None)  # of a ProcessPoolExecutor, which tells no other way
    if context is not None and context.get_start_method() == "fork":
        raise ValueError(
            f"{name} forks, and JAX hangs in forked processes: give it "
            'mp_context=multiprocessing.get_context("spawn"), or pass a number of processes'
        )


def _set_up_worker(compiled_code: dict[str, object]) -> None:
    """Set up a worker process, which keeps compiled code by the given `cache.settings`."""
    import jax
    from tqdm import tqdm

    tqdm.set_lock(threading.RLock())  # its own is a semaphore, which a killed process leaves behind
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cache.adopt(compiled_code)
    # Most kernels take less time to run than to hand over to another thread.
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Wait for the parent process to end, then end this one: else it would wait for work forever."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
