"""The scenes that are left of a study, cut into chunks that take about as long as they should.

A chunk is long enough that handing it out costs next to nothing, and short enough that little is lost with
it, that progress is seen, and that workers end together. The size follows the measured times, and no result
depends on it.
"""

import math
from array import array
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace

from jaxplan.study.task import Chunk, Task

AIM = 2.0  # seconds a chunk
FIRST, LARGEST = 4, 256  # scenes; the largest is what runs in lockstep at once
DEATHS = 2  # of workers with nothing else to do, after which a scene is given up


class Chunks:
    """What is left to be planned.

    Where a worker dies with several chunks under way, nobody knows which of them killed it: all become
    suspects, and are planned with nothing else under way. One that kills its worker then is cut into scenes.

    Args:
        task: the study.
        left: numbers of the scenes to plan.
        size: scenes a chunk, None to follow the times.
    """

    def __init__(self, task: Task, left: Iterable[int], size: int | None) -> None:
        self._task, self._left, self._begun = task, array("Q", left), 0
        self._fixed, self._size = size, size or FIRST
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
        numbers = tuple(self._left[self._begun : self._begun + size])
        self._begun += len(numbers)
        return self._chunk(numbers) if numbers else None

    def learn(self, scenes: int, seconds: float) -> None:
        """Take into account how long so many scenes took."""
        if self._fixed is None:
            wanted = AIM * scenes / max(seconds, 1e-9)
            self._size = int(min(max(wanted, self._size / 2, 1), self._size * 2, LARGEST))

    def suspect(self, chunks: Iterable[Chunk]) -> None:
        """Put back chunks of which one may have killed a worker."""
        self._suspects.extend(chunks)

    def killed(self, chunk: Chunk) -> Iterator[Chunk]:
        """Put back a chunk that killed a worker by itself, cut into scenes; yields what is given up."""
        guilty = replace(chunk, deaths=chunk.deaths + 1)
        if len(guilty.scenes) == 1 and guilty.deaths >= DEATHS:
            yield guilty
        else:
            self._suspects.extend(guilty.one_by_one())

    def _chunk(self, numbers: tuple[int, ...]) -> Chunk:
        task = self._task
        return Chunk(
            numbers=numbers,
            scenes=tuple(task.scenes[number] for number in numbers),
            kind=task.kind,
            planner=task.planner,
            settings=task.settings,
        )
