"""What a worker does: plan the scenes of a chunk, and answer with rows alone.

Nothing that a scene raises gets out: it is a row with status ``crashed``, and the others of its block are
planned one by one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from jaxplan.planner import Plan, plan, plan_batch
from jaxplan.runtime.stopwatch import working_time
from jaxplan.study.blocks import in_blocks
from jaxplan.study.rows import Row, crashed, no_times, row_of, times_of
from jaxplan.study.task import Chunk
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
