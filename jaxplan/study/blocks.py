"""The scenes that are left of a study: in blocks, which are planned together, handed out some at a time.

Scenes of a block are planned together, and a plan may differ in its last digits with what it is planned
beside. So blocks are fixed: the scenes 0 to 15 of a study are one, those from 16 to 31 the next, whatever is
done already and whoever plans them. A block of which scenes are missing is planned anew as a whole. What does
follow the measured times is how many blocks are handed out at once, as a *chunk*: so many that handing them
out costs next to nothing, and so few that little is lost with one, that progress is seen, and that workers
end together.

A block in which a scene kills its process cannot be planned together. It is planned scene by scene once it
has killed a worker twice that did nothing else, so not where a worker died by chance; its rows say so.
"""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace

from jaxplan.study.task import Chunk, Task

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
