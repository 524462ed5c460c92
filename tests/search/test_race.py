from itertools import pairwise

import numpy as np
import pytest

from jaxplan.model.path import Path
from jaxplan.model.status import Status
from jaxplan.search.mha import Race
from jaxplan.search.scene import SearchResult

PATH = Path(attitudes=np.eye(3)[None], joints=np.zeros((1, 2)), edge_costs=np.zeros(0))
HEAD_START = 3


class Runner:
    """A search that makes some calls, writes each down, and then has a path or none."""

    def __init__(self, name: str, calls: int, path: Path | None, log: list[str]) -> None:
        self.name, self.calls, self.path, self.log = name, calls, path, log
        self.answered = 0

    def next_request(self) -> tuple[str, int] | None:
        if self.answered == self.calls:
            return None
        self.log.append(self.name)
        return self.name, self.answered

    def accept(self, answer: tuple[str, int]) -> None:
        assert answer == (self.name, self.answered), "each gets the answers to its own calls"
        self.answered += 1

    def result(self) -> SearchResult:
        assert self.answered == self.calls, "it is asked before its end"
        status = Status.OK if self.path else Status.NODE_LIMIT
        return SearchResult(status=status, path=self.path, expansions=self.calls)


def run(first: int, second: int, *, first_finds: bool = True, second_finds: bool = True):
    log: list[str] = []
    race = Race(
        Runner("first", first, PATH if first_finds else None, log),
        Runner("second", second, PATH if second_finds else None, log),
        head_start=HEAD_START,
    )
    while (call := race.next_request()) is not None:
        race.accept(call)
    return race.result(), log


@pytest.mark.parametrize("first", [0, 1, HEAD_START])
def test_the_second_does_not_begin_before_the_head_start_is_over(first):
    answer, log = run(first, 1)
    assert log == ["first"] * first
    assert (answer.path, answer.expansions) == (PATH, first)


def test_they_take_turns_after_the_head_start():
    _, log = run(50, 50)
    turns = log[HEAD_START + 2 :]  # a call is written down when the one before is answered
    assert all(a != b for a, b in pairwise(turns))


@pytest.mark.parametrize(("first", "second", "calls"), [(50, 7, 7), (12, 40, 12), (50, 0, 0)])
def test_the_first_path_ends_it(first, second, calls):
    answer, log = run(first, second)
    assert answer.expansions == calls
    assert len(log) <= HEAD_START + 2 * calls + 1


def test_one_that_gives_up_leaves_the_turns_to_the_other():
    answer, log = run(5, 30, first_finds=False)
    assert (answer.path, log.count("first"), log.count("second")) == (PATH, 5, 30)
    answer, log = run(0, 30, first_finds=False)
    assert (answer.path, log.count("first"), log.count("second")) == (PATH, 0, 30)
    answer, log = run(30, 5, second_finds=False)
    assert (answer.path, log.count("first"), log.count("second")) == (PATH, 30, 5)


def test_without_a_path_the_answer_is_that_of_the_first():
    for first, second in ((1, 9), (9, 1), (HEAD_START, 4)):
        answer, log = run(first, second, first_finds=False, second_finds=False)
        assert (answer.status, answer.expansions) == (Status.NODE_LIMIT, first)
        assert len(log) == first + second
