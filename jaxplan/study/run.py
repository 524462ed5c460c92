"""Running a study: scenes in, rows out, with a bar, and nothing that is done gets lost.

How many blocks make a chunk follows the measured times: so many that handing them out costs next to nothing,
and so few that little is lost with one, that progress is seen, and that workers end together. A block of
which scenes are missing is planned anew as a whole.

A block in which a scene kills its process cannot be planned together. It is planned scene by scene once it
has killed a worker twice that did nothing else, so not where a worker died by chance; its rows say so.
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

    On one machine the table is always the same to the last bit, whoever plans and however often the study
    is interrupted: scenes are planned together in blocks of 16 by their number, and searches have no time
    limit here, whatever the scenarios say. A scene whose planning raises an error, or kills its process, is
    a row with status ``crashed``; the others of its block are planned one by one then, and may differ in
    last digits from the same scenes in a study where nothing crashes. Ctrl-C ends the study early and returns
    what is done.

    Args:
        scenarios_or_seeds: the scenes, or seeds of `random_scenario`.
        kind: of the random scenes, "keep_out" unless told; only with seeds.
        planner: "mha", "mha-paper", "wastar", "rrt_star" or "rrt_connect".
        settings: that differ from the scenes' own, by dotted names in the keys and units of a scenario file,
            as in ``{"search.max_expansions": 500, "trajectory.duration_s": "minimum"}``.
        workers: who plans: None for this process; a number of processes of its own, which are begun anew
            when one dies; or any `concurrent.futures.Executor`, such as ``get_executor()`` of a Dask client.
        out: a folder for the results, where each chunk is safe once it is done. If it holds the same study
            already, or one of the first of these scenes with all else alike, only what is missing is planned
            (and a last block that was not full, as it is planned with those that come); another study is
            refused. Without it rows are kept in memory.
        chunk: blocks that are handed out together; by default as many as take some two seconds.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        executor: an older name of workers.
        columns: functions that make a number of a certified plan, by names for columns of their own, as in
            ``{"breaks": lambda plan: len(plan.trajectory.breaks)}``; in other processes only functions of a
            module. Where one raises an error, the value is missing and the message says why. A folder
            remembers the names, so that a study that goes on must have the same.

    Returns:
        The study.

    Raises:
        TypeError: for scenes, workers or a folder that are none.
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
    """Run a study whose arguments are checked; those that `run_study` has mean the same here.

    Args:
        task: what is to be done.
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
                pass  # what is done is returned
        return Study(
            kind=task.kind,
            planner=task.planner,
            settings=task.settings,
            scenes=len(task.scenes),
            folder=None if out is None else Path(out),
            columns=tuple(task.columns),
            _held=store.rows,
        )


class Part(Protocol):
    """What is handed to a worker at once; `scenes` are what it is made of."""

    @property
    def scenes(self) -> Sized:
        """What it is made of."""


class Done(Protocol):
    """A worker's answer, with the seconds that it took."""

    @property
    def seconds(self) -> float:
        """The time that it took, s."""


P = TypeVar("P", bound=Part)
A = TypeVar("A", bound=Done)
A_co = TypeVar("A_co", bound=Done, covariant=True)


class Parts(Protocol[P, A_co]):
    """The parts of some work that are left, as `Blocks` are those of a study."""

    def take(self, under_way: int, most: int = 1) -> P | None:
        """Take the next part off, see `Blocks.take`."""

    def learn(self, scenes: int, seconds: float) -> None:
        """Take note of the seconds that a number of scenes took."""

    def suspect(self, chunks: Iterable[P]) -> None:
        """Put back parts of which one may have killed a worker."""

    def killed(self, chunk: P) -> Iterable[A_co]:
        """Put back a part that killed a worker by itself; yields the answer for what is given up."""


def answers(chunks: Parts[P, A], workers: Workers | None, work: Callable[[P], A]) -> Generator[A, None, None]:
    """Do the work for all parts, here or by workers, which end then; yield the answers as they come."""
    if workers is None:
        yield from in_this_process(chunks, work)
        return
    pool = WorkerPool(workers)
    try:
        yield from by_workers(chunks, work, pool)
    except BaseException:  # Ctrl-C here or at whom the answers go to, among others
        pool.shutdown(at_once=True)
        raise
    pool.shutdown(at_once=False)


AIM = 2.0
"""Seconds that a chunk should take."""
LARGEST = 16
"""Blocks in a chunk at most."""
DEATHS = 2
"""Deaths of workers with nothing else to do, after which a block is cut into scenes, or a scene given up."""
_UNDER_WAY = 2  # chunks under way for each worker at first, so that none waits for the next
_IDLE = 1.5  # a chunk whose answer comes within this multiple of its own time has hardly waited


class Blocks:
    """The blocks of a study that are left to be planned.

    Where a worker dies with several chunks under way, nobody knows which of them killed it: all become
    suspects, and are planned with nothing else under way. One that kills its worker then is cut into blocks,
    and a block into scenes.

    Args:
        task: the study.
        left: numbers of the scenes that are not done.
        size: blocks a chunk, None to follow the times.
    """

    def __init__(self, task: Task, left: Iterable[int], size: int | None) -> None:
        self._task = task
        self._left = deque(sorted({number // BLOCK for number in left}))
        self._fixed, self._size = size, size or 1
        self._suspects: deque[Chunk] = deque()
        self._alone = False  # whether what is under way is a suspect, beside which nothing else may run

    def take(self, under_way: int, most: int = 1) -> Chunk | None:
        """Take the next chunk off; None where there is none, or none that may run beside others.

        Args:
            under_way: number of chunks that are.
            most: number of chunks that may be under way at once: none is larger than its share of what is
                left, so that all workers are done at about the same time.
        """
        if under_way and (self._suspects or self._alone):
            return None
        self._alone = bool(self._suspects)
        if self._suspects:
            return self._suspects.popleft()
        size = self._fixed or min(self._size, math.ceil(len(self._left) / most))
        blocks = [self._left.popleft() for _ in range(min(size, len(self._left)))]
        return self._task.chunk(blocks) if blocks else None

    def learn(self, scenes: int, seconds: float) -> None:
        """Adapt the size of chunks to the seconds that a number of scenes took."""
        if self._fixed is None:
            wanted = AIM * scenes / max(seconds, 1e-9) / BLOCK
            self._size = int(min(max(wanted, self._size / 2, 1), self._size * 2, LARGEST))

    def suspect(self, chunks: Iterable[Chunk]) -> None:
        """Put back chunks of which one may have killed a worker."""
        self._suspects.extend(chunks)

    def killed(self, chunk: Chunk) -> Iterator[Answer]:
        """Put back a chunk that killed a worker by itself, cut if need be.

        Yields:
            The answer for a scene that is given up, if this is one.
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
    """Do the work for one chunk after the other in this process, and yield the answers."""
    while (chunk := chunks.take(0)) is not None:
        answer = work(chunk)
        chunks.learn(len(chunk.scenes), answer.seconds)
        yield answer


def by_workers(chunks: Parts[P, A], work: Callable[[P], A], pool: WorkerPool) -> Iterator[A]:
    """Hand chunks out to workers, and yield their answers as they come.

    As many are handed out at once as keep all workers busy: more and more, as long as they are begun at once.
    Answers that are there when a worker dies count; the other chunks are planned again, see `Blocks`.

    Raises:
        RuntimeError: if workers die before they do anything.
        Exception: what an executor raises that cannot do its work, such as for a package that is missing.
    """
    running: dict[Future[A], tuple[P, float]] = {}
    most = _UNDER_WAY * pool.workers
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
                    if type(error).__name__ != "KilledWorker":  # Dask's word for a task whose workers died
                        raise
                    yield from chunks.killed(chunk)
                else:
                    chunks.learn(len(chunk.scenes), answer.seconds)
                    most += time.monotonic() - since < _IDLE * answer.seconds
                    yield answer
            waiting = broken  # a broken pool ends all that it was given
        if broken:
            if len(lost) == 1:
                yield from chunks.killed(lost[0])
            else:
                chunks.suspect(lost)
            pool.restart()
