from itertools import pairwise

import numpy as np
import pytest

from jaxplan.model.path import Path
from jaxplan.model.status import Status
from jaxplan.search.problem import SearchResult
from jaxplan.search.race import race

PATH = Path(attitudes=np.eye(3)[None], joints=np.zeros((1, 2)), edge_costs=np.zeros(0))
HEAD_START = 3


def runner(name: str, calls: int, path: Path | None, log: list[str]):
    """A search that makes some calls, writes each down, and then has a path or none."""
    for number in range(calls):
        log.append(name)
        assert (yield name, number) == (name, number), "each gets the answers to its own calls"
    return SearchResult(status=Status.OK if path else Status.NODE_LIMIT, path=path, expansions=calls)


def run(first: int, second: int, *, first_finds: bool = True, second_finds: bool = True):
    log: list[str] = []
    steps = race(
        runner("first", first, PATH if first_finds else None, log),
        runner("second", second, PATH if second_finds else None, log),
        head_start=HEAD_START,
    )
    try:
        call = next(steps)
        while True:
            call = steps.send(call)
    except StopIteration as end:
        return end.value, log


def test_the_second_does_not_begin_before_the_head_start_is_over():
    answer, log = run(HEAD_START, 1)
    assert log == ["first"] * HEAD_START
    assert (answer.path, answer.expansions) == (PATH, HEAD_START)


def test_they_take_turns_after_the_head_start():
    _, log = run(50, 50)
    turns = log[HEAD_START + 2 :]  # a call is written down when the one before is answered
    assert all(a != b for a, b in pairwise(turns))


@pytest.mark.parametrize(("first", "second", "calls"), [(50, 7, 7), (12, 40, 12)])
def test_the_first_path_ends_it(first, second, calls):
    answer, log = run(first, second)
    assert answer.expansions == calls
    assert len(log) <= HEAD_START + 2 * calls + 1


def test_one_that_gives_up_leaves_the_turns_to_the_other():
    answer, log = run(5, 30, first_finds=False)
    assert (answer.path, log.count("first"), log.count("second")) == (PATH, 5, 30)
    answer, log = run(30, 5, second_finds=False)
    assert (answer.path, log.count("first"), log.count("second")) == (PATH, 30, 5)


def test_without_a_path_the_answer_is_that_of_the_first():
    for first, second in ((1, 9), (9, 1), (HEAD_START, 4)):
        answer, log = run(first, second, first_finds=False, second_finds=False)
        assert (answer.status, answer.expansions) == (Status.NODE_LIMIT, first)
        assert len(log) == first + second
