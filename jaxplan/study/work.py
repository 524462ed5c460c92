"""What a worker does: plan the scenes of a chunk, and answer with rows alone.

Nothing that a scene raises gets out: it is a row with status ``crashed``, and the others of its chunk are
planned as if it were not there.
"""

from collections.abc import Callable
from dataclasses import dataclass

from jaxplan.planner import Plan, plan, plan_batch
from jaxplan.runtime.stopwatch import working_time
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


Work = Callable[[Chunk], Answer]


def plan_chunk(chunk: Chunk) -> Answer:
    """Plan the scenes of a chunk in lockstep; after an unexpected error one by one, to find whose it is.

    Raises:
        RuntimeError: if the chunk is from another version of jaxplan, which may plan otherwise.
    """
    if chunk.version != __version__:
        raise RuntimeError(
            f"a worker has jaxplan {__version__}, the study is made by {chunk.version}: "
            "install the same on all machines"
        )
    began = working_time()
    places = range(len(chunk.scenes))
    found: list[Plan | Exception]
    try:
        found = list(plan_batch([chunk.scenario(place) for place in places], progress=False))
    except Exception:
        found = [_plan_or_error(chunk, place) for place in places]
    table, timings = [], []
    for place, result in enumerate(found):
        first = head(chunk, place)
        if isinstance(result, Plan):
            table.append(row_of(result, first))
            timings.append(times_of(result.timings, first))
        else:
            table.append(crashed(f"{type(result).__name__}: {result}", first))
            timings.append(no_times(first))
    return Answer(table, timings, working_time() - began)


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
