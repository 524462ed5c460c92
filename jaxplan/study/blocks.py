"""Chunks of a study handed out to workers, and what they answer.

How many blocks make a chunk follows the measured times: so many that handing them out costs next to nothing,
and so few that little is lost with one, that progress is seen, and that workers end together. A block of
which scenes are missing is planned anew as a whole.

Nothing that a scene raises gets out of a worker: it is a row with status ``crashed``, and the others of its
block are planned one by one. A block in which a scene kills its process cannot be planned together. It is
planned scene by scene once it has killed a worker twice that did nothing else, so not where a worker died by
chance; its rows say so.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass, replace

from jaxplan.planner import Plan, plan, plan_batch
from jaxplan.runtime.jit import working_time
from jaxplan.runtime.workers import WorkerPool
from jaxplan.study.rows import Row, row_of, times_of
from jaxplan.study.task import BLOCK, Chunk, Task
from jaxplan.version import __version__

APART = "planned by itself, since a scene of its block killed its process"
"""Note in the rows of a block that is planned scene by scene."""
AIM = 2.0
"""Seconds that a chunk should take."""
LARGEST = 16
"""Blocks in a chunk at most."""
DEATHS = 2
"""Deaths of workers with nothing else to do, after which a block is cut into scenes, or a scene given up."""
_UNDER_WAY = 2  # chunks a worker, so that none waits for the next
_IDLE = 1.5  # a chunk that is done within so many times its own time has hardly waited


@dataclass(frozen=True, eq=False)
class Answer:
    """Rows of the scenes of a chunk.

    Attributes:
        table: a row a scene.
        timings: the seconds of each scene.
        seconds: the chunk took, without those of compiling.
    """

    table: list[Row]
    timings: list[Row]
    seconds: float = 0.0


Work = Callable[[Chunk], Answer]


def plan_chunk(chunk: Chunk) -> Answer:
    """Plan the scenes of a chunk, those of a block together.

    Raises:
        RuntimeError: if the chunk is from another version of jaxplan, which may plan otherwise.
    """
    if chunk.version != __version__:
        raise RuntimeError(
            f"a worker has jaxplan {__version__}, the study is made by {chunk.version}: "
            "install the same on all machines"
        )
    began = working_time()
    answer = _answer(chunk, [outcome for block in chunk.blocks() for outcome in _outcomes(block)])
    return replace(answer, seconds=working_time() - began)


def _outcomes(block: Chunk) -> list[Plan | str]:
    """The plans of a block made together; after an unexpected error one by one, to find whose it is."""
    places = range(len(block.numbers))
    try:
        return [*plan_batch([block.scenario(place) for place in places], progress=False)]
    except Exception:
        return [_plan_or_error(block, place) for place in places]


def _plan_or_error(block: Chunk, place: int) -> Plan | str:
    try:
        return plan(block.scenario(place), throw=False, progress=False)
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def _answer(chunk: Chunk, outcomes: Iterable[Plan | str]) -> Answer:
    """The rows of what became of a chunk's scenes."""
    table, timings = [], []
    for place, outcome in enumerate(outcomes):
        head = chunk.head(place)
        row = row_of(outcome, head)
        if chunk.apart:
            row["message"] = "; ".join(filter(None, (row["message"], APART)))
        table.append(row)
        timings.append(times_of(outcome.timings if isinstance(outcome, Plan) else None, head))
    return Answer(table, timings)


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
        """The next chunk; None where there is none, or none that may run beside others.

        Args:
            under_way: how many chunks are.
            most: how many may be at once: none takes more than its share of what is left, so that all who
                plan are done at about the same time.
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
        """Take into account how long so many scenes took."""
        if self._fixed is None:
            wanted = AIM * scenes / max(seconds, 1e-9) / BLOCK
            self._size = int(min(max(wanted, self._size / 2, 1), self._size * 2, LARGEST))

    def suspect(self, chunks: Iterable[Chunk]) -> None:
        """Put back chunks of which one may have killed a worker."""
        self._suspects.extend(chunks)

    def killed(self, chunk: Chunk) -> Iterator[Answer]:
        """Put back a chunk that killed a worker by itself, cut if need be; yields the row of a lost scene."""
        parts, deaths = chunk.blocks(), chunk.deaths + 1
        if len(parts) == 1:
            if deaths < DEATHS:
                parts = [replace(chunk, deaths=deaths)]
            elif len(chunk.numbers) > 1:
                parts = chunk.singles()
            else:
                why = f"its worker died, {deaths} times while it planned nothing else"
                yield _answer(replace(chunk, apart=False), [why])
                return
        self.suspect(parts)


def in_this_process(chunks: Blocks, work: Work) -> Iterator[Answer]:
    """Answer one chunk after the other."""
    while (chunk := chunks.take(0)) is not None:
        answer = work(chunk)
        chunks.learn(len(chunk.scenes), answer.seconds)
        yield answer


def by_workers(chunks: Blocks, work: Work, pool: WorkerPool) -> Iterator[Answer]:
    """Answer chunks as workers get done with them.

    As many are handed out at once as keep all workers busy: more and more, as long as they are begun at once.
    Answers that are there when a worker dies count; the other chunks are planned again, see `Blocks`.

    Raises:
        RuntimeError: if workers die before they do anything.
        Exception: what an executor raises that cannot do its work, such as for a package that is missing.
    """
    running: dict[Future[Answer], tuple[Chunk, float]] = {}
    most = _UNDER_WAY * pool.workers
    while True:
        lost: list[Chunk] = []
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
