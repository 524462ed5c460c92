"""Doing many things at once: like with like, padded to few sizes, and each with its share of the time.

A stage of the planner is a function of many problems. It passes those of one kind to one call (`in_groups`),
pads the arrays of jitted kernels to few sizes (`padded_count`), and divides the seconds of a common call
among the problems it was for (`Seconds`). A stage that proceeds in steps, such as a search with its queues,
is a `Run`: an object that says what it needs next and is given it. `run_all` drives one run or many, and
answers their requests of one kind together.

The same call on the same machine gives the same answer to the byte. If a problem is solved along with others,
the last digits of its answer may differ.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol, TypeVar

import numpy as np

from jaxplan.runtime.stopwatch import working_time

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def grouped(items: Sequence[Item], kind: Callable[[Item], Hashable]) -> list[list[int]]:
    """Return the indices of the items of each kind; groups are in the order in which their kinds first occur.

    Args:
        items: the items, in any order.
        kind: function from an item to its kind; items of equal kinds make up a group.
    """
    groups: dict[Hashable, list[int]] = {}
    for number, item in enumerate(items):
        groups.setdefault(kind(item), []).append(number)
    return list(groups.values())


def in_groups(
    items: Sequence[Item],
    kind: Callable[[Item], Hashable],
    answer: Callable[[list[Item]], Sequence[Answer]],
    *,
    most: int | None = None,
    seconds: "Seconds | None" = None,
) -> list[Answer]:
    """Answer all items, those of one kind in one call.

    Args:
        items: the items, in any order.
        kind: function from an item to its kind.
        answer: function from items of one kind to a sequence of as many answers.
        most: the most items in one call; None for any number.
        seconds: where the time of the calls is added to that of their items; None not to measure it.

    Returns:
        The answers in the order of the items.
    """
    answers: dict[int, Answer] = {}
    for numbers in grouped(items, kind):
        for part in parts(numbers, most):
            with seconds.shared(part) if seconds is not None else _untimed():
                answers.update(zip(part, answer([items[number] for number in part]), strict=True))
    return [answers[number] for number in range(len(items))]


def parts(items: Sequence[Item], most: int | None) -> Iterator[Sequence[Item]]:
    """Yield the items in consecutive parts of at most `most`; None makes one part of all."""
    size = len(items) if most is None else most
    for first in range(0, len(items), max(size, 1)):
        yield items[first : first + size]


def padded_count(count: int, least: int = 8) -> int:
    """Return the size to which some rows, nodes or calls are padded, so that kernels compile for few sizes.

    Args:
        count: number of rows, nodes or calls.
        least: the smallest size above zero.

    Returns:
        Zero for zero; else `least`, doubled until it is at least `count`.
    """
    if count == 0:
        return 0
    size = least
    while size < count:
        size *= 2
    return size


class Seconds:
    """Computing time of each of n pieces of work, without the time spent on compiling.

    Attributes:
        spent: (n,) s.
    """

    def __init__(self, count: int) -> None:
        self.spent = np.zeros(count)

    @contextmanager
    def shared(self, numbers: Sequence[int] | np.ndarray) -> Iterator[None]:
        """Divide the time that a with block takes equally among the pieces of work with these indices.

        An index that occurs several times gets as many parts.
        """
        began = working_time()
        yield
        if len(numbers):
            np.add.at(self.spent, np.asarray(numbers), (working_time() - began) / len(numbers))


class Request(Protocol):
    """Something that a run needs before it can go on."""

    @property
    def kind(self) -> Hashable:
        """Key of the request; requests with equal keys can be answered in one call."""


class Run(Protocol):
    """Work that proceeds in steps: it asks for something, and goes on when it is given that."""

    def next_request(self) -> Any:
        """Return the `Request` to be answered next; None when the run is at its end."""

    def accept(self, answer: Any) -> None:
        """Go on with the answer to the last request."""


def run_all(
    runs: Sequence[Run],
    answer: Callable[[Sequence[int], list[Any]], Sequence[Any]],
    *,
    most: int,
    seconds: Seconds | None = None,
) -> None:
    """Drive runs to their ends; the kind of requests that most runs wait for is answered next.

    Args:
        runs: runs that have a next request or are at their end; they are changed in place.
        answer: function from the indices of some runs and their requests, all of one kind, to as many
            answers.
        most: the most requests that are answered in one call.
        seconds: where the time of each run is added: its own, and its share of that of the answers. None not
            to measure it.
    """
    own = Seconds(len(runs)) if seconds is None else seconds
    waiting: dict[Hashable, list[tuple[int, Any]]] = {}

    def ask(number: int) -> None:
        request = runs[number].next_request()
        if request is not None:
            waiting.setdefault(request.kind, []).append((number, request))

    for number in range(len(runs)):
        with own.shared([number]):
            ask(number)
    while waiting:
        kind = max(waiting, key=lambda one: len(waiting[one]))
        asked = waiting.pop(kind)
        now, later = asked[:most], asked[most:]
        if later:
            waiting[kind] = later
        numbers = [number for number, _ in now]
        with own.shared(numbers):
            answers = answer(numbers, [request for _, request in now])
        for number, found in zip(numbers, answers, strict=True):
            with own.shared([number]):
                runs[number].accept(found)
                ask(number)


@contextmanager
def _untimed() -> Iterator[None]:
    """Do nothing, in the place of `Seconds.shared`."""
    yield
