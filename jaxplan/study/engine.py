"""From chunks to answers: in this process, or by workers, of whom some may die."""

import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait

from jaxplan.runtime.workers import Crew
from jaxplan.study.blocks import Blocks
from jaxplan.study.task import Chunk
from jaxplan.study.work import Answer, Work, died

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
