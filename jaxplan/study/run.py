"""Running a study: scenes in, rows out, with a progress bar; an interruption keeps what is done.

A *block* is 16 scenes that are planned together, a *chunk* is the blocks that a worker gets at once (see
`task`). The number of blocks in a chunk is adapted to measured times: large enough that handing chunks out
costs next to nothing, and small enough that little is lost with one, that progress shows, and that all
workers finish at about the same time. A block of which some scenes are missing is planned again as a whole.

A block in which a scene kills its process cannot be planned together. Once it has killed a worker twice while
nothing else ran, which excludes deaths by chance, it is planned scene by scene, and its rows say so.
"""

import math
import os
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sized
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np

from jaxplan.model.scenario import Scenario
from jaxplan.planner import Plan
from jaxplan.runtime.arguments import file_path
from jaxplan.runtime.progress import progress_bar
from jaxplan.runtime.workers import WorkerPool, Workers, WorkersDiedError, who_works
from jaxplan.study.result import Study
from jaxplan.study.rows import OK, Answer, Work, answer_of, check_columns, plan_chunk
from jaxplan.study.store import Store
from jaxplan.study.task import BLOCK, Chunk, Task, make_task


def run_study(
    scenarios_or_seeds: Iterable[Scenario] | Iterable[int],
    kind: str | None = None,
    *,
    planner: str = "mha",
    settings: Mapping[str, Any] | None = None,
    workers: Workers | None = None,
    out: str | os.PathLike[str] | None = None,
    chunk: int | None = None,
    progress: bool = True,
    executor: Workers | None = None,
    columns: Mapping[str, Callable[[Plan], Any]] | None = None,
) -> Study:
    """Plan many scenes, and keep a row of the outcome of each.

    On one machine the table is always the same to the last bit, whatever the workers and however often the
    study is interrupted: scenes are planned together in blocks of 16 by their number, and searches have no
    time limit here, whatever the scenarios say. A scene whose planning raises an error, or kills its process,
    gets a row with status ``crashed``; the others of its block are then planned one by one, and may differ in
    the last digits from the same scenes in a study where nothing crashes. Ctrl-C ends the study early and
    returns what is done.

    Args:
        scenarios_or_seeds: the scenes, or seeds of `random_scenario`.
        kind: of the random scenes; None for "keep_out". Only allowed with seeds.
        planner: "mha", "mha-paper", "wastar", "rrt_star" or "rrt_connect".
        settings: scenario settings to change, by dotted names in the keys and units of a scenario file, as in
            ``{"search.max_expansions": 500, "trajectory.duration_s": "minimum"}``.
        workers: who plans: None for this process; a number of processes to start, which are restarted
            when one dies; or any `concurrent.futures.Executor`, such as ``get_executor()`` of a Dask client.
        out: a folder for the results, to which each chunk is written as soon as it is done. If it holds the
            same study already, or the same study of the first of these scenes, only missing scenes are
            planned (together with the rest of a block that was not full). Another study is refused. None to
            keep rows in memory.
        chunk: number of blocks that a worker gets at once; None for as many as take some two seconds.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        executor: an older name of workers.
        columns: functions that compute a number from a certified plan, by the names of the columns to add, as
            in ``{"breaks": lambda plan: len(plan.trajectory.breaks)}``; for other processes only functions
            defined in a module. Where one raises an error, the value is missing and the message says why. A
            folder remembers the names, so that a study that goes on must have the same.

    Returns:
        The study.

    Raises:
        TypeError: for scenes, workers or a folder of the wrong type.
        ValueError: for bad seeds, an unknown kind or planner, or chunks of less than one block.
        ScenarioError: for settings, or a scenario, that a file could not hold; all faults are named.
        StudyFolderError: if the folder holds something else or is in use.
        RuntimeError: if workers die before they plan anything, or have another version of jaxplan.

    Example:
        >>> study = jp.run_study(range(200), "hard_keep_out", workers=2, out="study")
        >>> print(study.summary())
    """
    given: object = chunk
    if (given is not None and not (isinstance(given, int | np.integer) and given >= 1)) or given is True:
        raise ValueError(f"chunk = {chunk!r}: must be a number of blocks of scenes, at least 1")
    chosen = who_works(workers, executor)
    if out is not None:
        file_path("out", out)
    if columns is not None:
        check_columns(columns, sent=isinstance(chosen, int))
    task = make_task(scenarios_or_seeds, kind, planner, settings, columns)
    try:
        return run_task(task, chosen, out, chunk, progress, plan_chunk)
    except WorkersDiedError as error:
        raise RuntimeError(str(error)) from None


def run_task(
    task: Task,
    workers: Workers | None,
    out: str | os.PathLike[str] | None,
    chunk: int | None,
    progress: bool,
    work: Work,
) -> Study:
    """Run a study whose arguments have been checked.

    Args:
        task: the scenes, and how they are planned.
        workers: see `run_study`.
        out: likewise.
        chunk: likewise.
        progress: likewise.
        work: function that plans, or searches, the scenes of a chunk; it may run in another process.

    Returns:
        The study; incomplete after Ctrl-C.
    """
    with Store(out, task) as store:
        left = (number for number, done in enumerate(store.done) if not done)
        with progress_bar(
            f"study: {task.planner}",
            "scenes",
            total=len(task.scenes),
            initial=sum(store.done),
            shown=progress,
        ) as bar:
            planned = 0
            bar.step("workers begin, and may compile" if workers is not None else "")
            try:
                with closing(answers(Blocks(task, left, chunk), workers, work)) as found:
                    for answer in () if all(store.done) else found:
                        table = store.add(answer)
                        planned += sum(row["status"] == OK for row in table)
                        bar.step("")
                        bar.update(len(table))
                        bar.note(f"{planned} planned")
            except KeyboardInterrupt:
                pass  # the rows so far are returned
        return Study(
            kind=task.kind,
            planner=task.planner,
            settings=task.settings,
            scenes=len(task.scenes),
            folder=None if out is None else Path(out),
            columns=tuple(task.columns),
            _memory_rows=store.rows,
        )


class Part(Protocol):
    """A part of some work, which a worker gets at once, such as a chunk of a study."""

    @property
    def scenes(self) -> Sized:
        """The scenes, or satellites, that the part consists of; only their number matters here."""


class Done(Protocol):
    """A worker's answer for a part."""

    @property
    def seconds(self) -> float:
        """The time in s that the part took."""


P = TypeVar("P", bound=Part)
A = TypeVar("A", bound=Done)
A_co = TypeVar("A_co", bound=Done, covariant=True)


class Parts(Protocol[P, A_co]):
    """The parts of some work that are left to do; `Blocks` is the implementation for studies."""

    def take(self, under_way: int, most: int = 1) -> P | None:
        """Remove and return the next part; None if there is none now, see `Blocks.take`."""

    def learn(self, scenes: int, seconds: float) -> None:
        """Take note that a number of scenes took so many seconds."""

    def suspect(self, chunks: Iterable[P]) -> None:
        """Put back parts, one of which may have killed a worker, to be done with nothing else running."""

    def killed(self, chunk: P) -> Iterable[A_co]:
        """Handle a part whose worker died while nothing else ran: put it back, or give it up.

        Yields:
            The answer for what is given up; nothing otherwise.
        """


def answers(chunks: Parts[P, A], workers: Workers | None, work: Callable[[P], A]) -> Generator[A, None, None]:
    """Do the work for all parts, in this process or by workers, and yield the answers as they come.

    Args:
        chunks: the parts to be done.
        workers: None for this process; a number of processes, which are started here and ended afterwards; or
            an executor, which is left running.
        work: function of a part that returns its answer.
    """
    if workers is None:
        yield from in_this_process(chunks, work)
        return
    pool = WorkerPool(workers)
    try:
        yield from by_workers(chunks, work, pool)
    except BaseException:  # such as Ctrl-C, here or in the code that uses the answers
        pool.shutdown(at_once=True)
        raise
    pool.shutdown(at_once=False)


AIM = 2.0
"""Seconds that a chunk should take."""
LARGEST = 16
"""Blocks in a chunk at most."""
DEATHS = 2
"""Deaths of workers with nothing else to do, after which a block is cut into scenes, or a scene given up."""
_CHUNKS_PER_WORKER = 2  # chunks handed out for each worker at first, so that none waits for the next
_PROMPT_RATIO = 1.5  # one more chunk goes out if an answer comes within this multiple of its working time


class Blocks:
    """The blocks of a study that are left to be planned, handed out in chunks.

    Where a worker dies while several chunks are out, any of them may have killed it: all become *suspects*,
    which are planned again one at a time with no other running. A suspect whose worker dies is divided into
    its blocks. A single block whose worker dies `DEATHS` times is divided into scenes, and a single scene
    whose worker dies so often is given up.

    Args:
        task: the study.
        left: numbers of the scenes that are not done; their whole blocks are planned.
        size: number of blocks in a chunk; None to adapt it to measured times.
    """

    def __init__(self, task: Task, left: Iterable[int], size: int | None) -> None:
        self._task = task
        self._blocks_left = deque(sorted({number // BLOCK for number in left}))
        self._fixed_size, self._chunk_size = size, size or 1
        self._suspects: deque[Chunk] = deque()
        self._suspect_running = False  # whether a suspect is under way, beside which nothing else may run

    def take(self, under_way: int, most: int = 1) -> Chunk | None:
        """Remove and return the next chunk; None if none is left, or none may run beside those under way.

        Args:
            under_way: number of chunks being planned now.
            most: number of chunks that may be under way at once. A chunk has at most 1 / most of the
                blocks left, so that all workers finish at about the same time.
        """
        if under_way and (self._suspects or self._suspect_running):
            return None
        self._suspect_running = bool(self._suspects)
        if self._suspects:
            return self._suspects.popleft()
        size = self._fixed_size or min(self._chunk_size, math.ceil(len(self._blocks_left) / most))
        blocks = [self._blocks_left.popleft() for _ in range(min(size, len(self._blocks_left)))]
        return self._task.chunk(blocks) if blocks else None

    def learn(self, scenes: int, seconds: float) -> None:
        """Adapt the size of chunks so that one takes `AIM`, given the time in s of some scenes."""
        if self._fixed_size is None:
            wanted = AIM * scenes / max(seconds, 1e-9) / BLOCK
            self._chunk_size = int(min(max(wanted, self._chunk_size / 2, 1), self._chunk_size * 2, LARGEST))

    def suspect(self, chunks: Iterable[Chunk]) -> None:
        """Put back chunks, one of which may have killed a worker, to be planned with nothing else running."""
        self._suspects.extend(chunks)

    def killed(self, chunk: Chunk) -> Iterator[Answer]:
        """Handle a chunk whose worker died while nothing else ran: put it back, divided if need be.

        Yields:
            The answer with status "crashed", if the chunk is a scene that is given up; nothing otherwise.
        """
        parts, deaths = chunk.blocks(), chunk.deaths + 1
        if len(parts) == 1:
            if deaths < DEATHS:
                parts = [replace(chunk, deaths=deaths)]
            elif len(chunk.numbers) > 1:
                parts = chunk.singles()
            else:
                why = f"its worker died, {deaths} times while it planned nothing else"
                yield answer_of(replace(chunk, apart=False), [why])
                return
        self.suspect(parts)


def in_this_process(chunks: Parts[P, A], work: Callable[[P], A]) -> Iterator[A]:
    """Do the work for one part after the other in this process, and yield the answers."""
    while (chunk := chunks.take(0)) is not None:
        answer = work(chunk)
        chunks.learn(len(chunk.scenes), answer.seconds)
        yield answer


def by_workers(chunks: Parts[P, A], work: Callable[[P], A], pool: WorkerPool) -> Iterator[A]:
    """Hand parts out to workers, and yield their answers as they come, in any order.

    At first two parts are handed out for each worker; one more whenever an answer shows that its part hardly
    waited. When a worker dies, answers that are already there count; the other parts are done again, see
    `Blocks`.

    Raises:
        RuntimeError: if workers die before they do anything.
        Exception: raised by the executor or the work itself, for instance for a package that is missing.
    """
    running: dict[Future[A], tuple[P, float]] = {}
    most = _CHUNKS_PER_WORKER * pool.workers
    while True:
        lost: list[P] = []
        broken = False
        while len(running) < most and not broken and (chunk := chunks.take(len(running), most)) is not None:
            try:
                running[pool.submit(work, chunk)] = chunk, time.monotonic()
            except BrokenExecutor:  # an idle worker has died, and the chunk was not begun
                chunks.suspect([chunk])
                broken = True
        if not running and not broken:
            return
        waiting = True
        while running and waiting:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                chunk, since = running.pop(future)
                try:
                    answer = future.result()
                except BrokenExecutor:
                    lost.append(chunk)
                    broken = True
                except Exception as error:
                    if type(error).__name__ != "KilledWorker":  # raised by Dask for a task whose workers died
                        raise
                    yield from chunks.killed(chunk)
                else:
                    chunks.learn(len(chunk.scenes), answer.seconds)
                    most += time.monotonic() - since < _PROMPT_RATIO * answer.seconds
                    yield answer
            waiting = broken  # a broken pool ends all its futures, so wait for these
        if broken:
            if len(lost) == 1:
                yield from chunks.killed(lost[0])
            else:
                chunks.suspect(lost)
            pool.restart()
