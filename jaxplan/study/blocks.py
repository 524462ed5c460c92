"""The scenes of a study in blocks that are planned together, handed out to workers.

What a worker does: plan the scenes of a chunk, and answer with rows alone.

Nothing that a scene raises gets out: it is a row with status ``crashed``, and the others of its block are
planned one by one.

The scenes that are left of a study: in blocks, which are planned together, handed out some at a time.

Scenes of a block are planned together, and a plan may differ in its last digits with what it is planned
beside. So blocks are fixed: the scenes 0 to 15 of a study are one, those from 16 to 31 the next, whatever is
done already and whoever plans them. A block of which scenes are missing is planned anew as a whole. What does
follow the measured times is how many blocks are handed out at once, as a *chunk*: so many that handing them
out costs next to nothing, and so few that little is lost with one, that progress is seen, and that workers
end together.

A block in which a scene kills its process cannot be planned together. It is planned scene by scene once it
has killed a worker twice that did nothing else, so not where a worker died by chance; its rows say so.

From chunks to answers: in this process, or by workers, of whom some may die.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass, replace

from jaxplan.planner import Plan, plan, plan_batch
from jaxplan.runtime.jit import working_time
from jaxplan.runtime.workers import Crew
from jaxplan.study.rows import Row, crashed, no_times, row_of, times_of
from jaxplan.study.task import Chunk, Task
from jaxplan.version import __version__


@dataclass(frozen=True, eq=False)
class Answer:
    """What became of a chunk.

    Attributes:
        table: a row a scene.
        timings: likewise.
        seconds: the chunk took, without those of compiling.
    """

    table: list[Row]
    timings: list[Row]
    seconds: float = 0.0

    def without(self, done: Sequence[int]) -> "Answer":
        """The rows of scenes that are not done yet, (scenes,) true where one is."""
        table, timings = (
            [row for row in rows if not done[row["scene"]]] for rows in (self.table, self.timings)
        )
        return Answer(table, timings, self.seconds)


Work = Callable[[Chunk], Answer]

APART = "planned by itself, since a scene of its block killed its process"
"""What the rows of a block that is planned scene by scene say."""


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
    table: list[Row] = []
    timings: list[Row] = []
    for block in in_blocks(chunk):
        for place, result in enumerate(_plans(block)):
            first = head(block, place)
            if isinstance(result, Plan):
                table.append(row_of(result, first))
                timings.append(times_of(result.timings, first))
            else:
                table.append(crashed(f"{type(result).__name__}: {result}", first))
                timings.append(no_times(first))
    if chunk.apart:
        table = [{**row, "message": "; ".join(filter(None, (row["message"], APART)))} for row in table]
    return Answer(table, timings, working_time() - began)


def _plans(block: Chunk) -> list[Plan | Exception]:
    """The plans of a block made together; after an unexpected error one by one, to find whose it is."""
    places = range(len(block.scenes))
    try:
        return [*plan_batch([block.scenario(place) for place in places], progress=False)]
    except Exception:
        return [_plan_or_error(block, place) for place in places]


def died(chunk: Chunk) -> Answer:
    """The answer for scenes that killed their worker."""
    heads = [head(chunk, place) for place in range(len(chunk.scenes))]
    message = f"its worker died, {chunk.deaths} times while it planned nothing else"
    return Answer([crashed(message, first) for first in heads], [no_times(first) for first in heads])


def head(chunk: Chunk, place: int) -> Row:
    """The columns that say which scene a row is of."""
    return {
        "scene": chunk.numbers[place],
        "seed": chunk.seed(place),
        "name": chunk.name(place),
        "kind": chunk.kind,
        "planner": chunk.planner,
    }


def _plan_or_error(chunk: Chunk, place: int) -> Plan | Exception:
    try:
        return plan(chunk.scenario(place), throw=False, progress=False)
    except Exception as error:
        return error


BLOCK = 16
"""Scenes that are planned together. More make a study little quicker on a processor, but its end ragged."""
AIM = 2.0
"""Seconds that a chunk should take."""
LARGEST = 16
"""Blocks in a chunk at most."""
DEATHS = 2
"""Deaths of workers with nothing else to do, after which a block is cut into scenes, or a scene given up."""


class Blocks:
    """What is left to be planned.

    Where a worker dies with several chunks under way, nobody knows which of them killed it: all become
    suspects, and are planned with nothing else under way. One that kills its worker then is cut into blocks,
    and a block into scenes.

    Args:
        task: the study.
        left: numbers of the scenes that are not done.
        size: blocks a chunk, None to follow the times.
    """

    def __init__(self, task: Task, left: Iterable[int], size: int | None) -> None:
        self._task, self._begun = task, 0
        self._left = sorted({number // BLOCK for number in left})
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
        size = self._size
        if self._fixed is None:
            size = min(size, math.ceil((len(self._left) - self._begun) / most))
        blocks = self._left[self._begun : self._begun + size]
        self._begun += len(blocks)
        return self._chunk(blocks) if blocks else None

    def learn(self, scenes: int, seconds: float) -> None:
        """Take into account how long so many scenes took."""
        if self._fixed is None:
            wanted = AIM * scenes / max(seconds, 1e-9) / BLOCK
            self._size = int(min(max(wanted, self._size / 2, 1), self._size * 2, LARGEST))

    def suspect(self, chunks: Iterable[Chunk]) -> None:
        """Put back chunks of which one may have killed a worker."""
        self._suspects.extend(chunks)

    def killed(self, chunk: Chunk) -> Iterator[Chunk]:
        """Put back a chunk that killed a worker by itself, cut if need be; yields what is given up."""
        blocks = in_blocks(chunk)
        if len(blocks) > 1:
            self._suspects.extend(blocks)
            return
        guilty = replace(chunk, deaths=chunk.deaths + 1)
        if guilty.deaths < DEATHS:
            self._suspects.append(guilty)
        elif len(guilty.scenes) > 1:
            self._suspects.extend(_in_scenes(chunk))
        else:
            yield guilty

    def _chunk(self, blocks: Iterable[int]) -> Chunk:
        task, count = self._task, len(self._task.scenes)
        numbers = [
            number for block in blocks for number in range(block * BLOCK, min((block + 1) * BLOCK, count))
        ]
        return Chunk(
            numbers=tuple(numbers),
            scenes=tuple(task.scenes[number] for number in numbers),
            kind=task.kind,
            planner=task.planner,
            settings=task.settings,
        )


def in_blocks(chunk: Chunk) -> list[Chunk]:
    """The blocks of a chunk as chunks of their own."""
    begins = [
        place
        for place, number in enumerate(chunk.numbers)
        if place == 0 or number // BLOCK != chunk.numbers[place - 1] // BLOCK
    ]
    ends = [*begins[1:], len(chunk.numbers)]
    return [_part(chunk, slice(*ends_of)) for ends_of in zip(begins, ends, strict=True)]


def _in_scenes(chunk: Chunk) -> list[Chunk]:
    """The scenes of a block as chunks of their own, planned apart for good."""
    parts = [_part(chunk, slice(place, place + 1)) for place in range(len(chunk.scenes))]
    return [replace(part, apart=True) for part in parts]


def _part(chunk: Chunk, which: slice) -> Chunk:
    return replace(chunk, numbers=chunk.numbers[which], scenes=chunk.scenes[which])


_UNDER_WAY = 2  # chunks a worker, so that none waits for the next
_IDLE = 1.5  # a chunk that is done within so many times its own time has hardly waited


def in_this_process(chunks: Blocks, work: Work) -> Iterator[Answer]:
    """Answer one chunk after the other."""
    while (chunk := chunks.take(0)) is not None:
        answer = work(chunk)
        chunks.learn(len(chunk.scenes), answer.seconds)
        yield answer


def by_workers(chunks: Blocks, work: Work, crew: Crew) -> Iterator[Answer]:
    """Answer chunks as workers get done with them.

    As many are handed out at once as keep all workers busy: more and more, as long as they are begun at once.
    Answers that are there when a worker dies count; the other chunks are planned again, see `Blocks`.

    Raises:
        RuntimeError: if workers die before they do anything.
        Exception: what an executor raises that cannot do its work, such as for a package that is missing.
    """
    running: dict[Future[Answer], tuple[Chunk, float]] = {}
    most = _UNDER_WAY * crew.workers
    while True:
        lost: list[Chunk] = []
        broken = False
        while len(running) < most and not broken and (chunk := chunks.take(len(running), most)) is not None:
            try:
                running[crew.submit(work, chunk)] = chunk, time.monotonic()
            except BrokenExecutor:  # an idle worker has died, and the chunk was not begun
                chunks.suspect([chunk])
                broken = True
        if not running and not broken:
            return
        for future in () if broken else wait(running, return_when=FIRST_COMPLETED).done:
            chunk, since = running.pop(future)
            try:
                answer = future.result()
            except BrokenExecutor:
                lost.append(chunk)
            except Exception as error:
                if not _is_death(error):
                    raise
                yield from map(died, chunks.killed(chunk))
            else:
                chunks.learn(len(chunk.scenes), answer.seconds)
                most += time.monotonic() - since < _IDLE * answer.seconds
                yield answer
        if lost or broken:
            yield from _after_a_death(chunks, crew, running, lost)


def _after_a_death(
    chunks: Blocks, crew: Crew, running: dict["Future[Answer]", tuple[Chunk, float]], lost: list[Chunk]
) -> Iterator[Answer]:
    """Keep what is done, put back what is lost, and begin anew."""
    for future in wait(running).done:  # a broken pool ends them all
        chunk, _ = running.pop(future)
        try:
            yield future.result()
        except BrokenExecutor:
            lost.append(chunk)
    if len(lost) == 1:
        yield from map(died, chunks.killed(lost[0]))
    else:
        chunks.suspect(lost)
    crew.begin_anew()


def _is_death(error: Exception) -> bool:
    """Whether it is Dask's word for a task whose workers died; Dask itself is not needed to know."""
    return type(error).__name__ == "KilledWorker"
