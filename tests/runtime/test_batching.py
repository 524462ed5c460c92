"""Tests of `jaxplan.runtime.batching`: alike ones together, padding, shares of time, and runs."""

import time
from dataclasses import dataclass

import pytest
from reference import assert_each

from jaxplan.runtime.batching import Seconds, grouped, in_groups, padded_count, parts, run_all


def test_groups_hold_every_number_once_in_the_order_of_first_appearance():
    assert grouped("abcab", str) == [[0, 3], [1, 4], [2]]
    assert grouped([], str) == []


def test_answers_come_in_the_order_of_the_items_whatever_their_groups():
    seen = []

    def answer(items):
        seen.append(list(items))
        return [10 * item for item in items]

    found = in_groups([5, 2, 7, 4, 9], lambda item: item % 2, answer, most=2)
    assert found == [50, 20, 70, 40, 90]
    assert seen == [[5, 7], [9], [2, 4]]


def test_an_answer_too_few_is_an_error():
    with pytest.raises(ValueError, match="zip"):
        in_groups([1, 2], lambda item: 0, lambda items: items[:1])


def test_parts_cover_everything_and_none_is_too_large():
    assert [list(part) for part in parts(range(5), 2)] == [[0, 1], [2, 3], [4]]
    assert [list(part) for part in parts(range(3), None)] == [[0, 1, 2]]
    assert list(parts([], None)) == []


@pytest.mark.parametrize(
    ("count", "least", "size"), [(0, 8, 0), (1, 8, 8), (8, 8, 8), (9, 8, 16), (33, 4, 64)]
)
def test_sizes_double_from_the_least(count, least, size):
    assert padded_count(count, least) == size


def test_what_is_done_together_is_shared_equally():
    seconds = Seconds(3)
    with seconds.shared([0, 2]):
        time.sleep(0.02)
    with seconds.shared([]):
        time.sleep(0.001)
    assert seconds.spent[0] == seconds.spent[2] >= 0.01
    assert seconds.spent[1] == 0


@dataclass
class _Ask:
    kind: str
    number: int


class _Adder:
    """Asks for the doubles of some numbers, one after the other, and adds them up."""

    def __init__(self, *asks: _Ask) -> None:
        self.asks, self.total = list(asks), 0

    def next_request(self) -> _Ask | None:
        return self.asks[0] if self.asks else None

    def accept(self, answer: int) -> None:
        self.asks.pop(0)
        self.total += answer


def test_runs_go_on_together_and_each_gets_its_own_answers():
    runs = [
        _Adder(_Ask("a", 1), _Ask("b", 2)),
        _Adder(_Ask("b", 3)),
        _Adder(),
        _Adder(_Ask("a", 5), _Ask("a", 6)),
    ]
    calls, seconds = [], Seconds(len(runs))

    def answer(numbers, asks):
        assert len({ask.kind for ask in asks}) == 1
        calls.append((asks[0].kind, list(numbers)))
        return [2 * ask.number for ask in asks]

    run_all(runs, answer, most=2, seconds=seconds)
    assert [run.total for run in runs] == [6, 6, 0, 22]
    assert calls == [("a", [0, 3]), ("b", [1, 0]), ("a", [3])]
    assert_each(seconds.spent, ">=", 0)


def test_work_that_is_named_several_times_gets_as_many_parts_of_the_time():
    seconds = Seconds(3)
    with seconds.shared([1, 1, 1, 0]):
        sum(range(100_000))
    assert seconds.spent[1] == pytest.approx(3 * seconds.spent[0])
    assert seconds.spent[2] == 0


def test_no_call_answers_more_requests_than_it_may():
    sizes = []

    def answer(numbers, asks):
        sizes.append(len(asks))
        return [ask.number for ask in asks]

    runs = [_Adder(_Ask("a", number)) for number in range(7)]
    run_all(runs, answer, most=3)
    assert sizes == [3, 3, 1]
    assert [run.total for run in runs] == list(range(7))
