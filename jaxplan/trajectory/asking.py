"""Fits as generators that ask for what is quicker done for many at once, so that one of them or many can run.

A fit yields an `Ask` wherever it needs such work, and is sent the answer. `alone` answers the asks of one
fit, `together` those of many: always those of the kind that most of them wait for. Whoever answers must give
each the same to the last bit, whatever else is asked for beside it.
"""

from collections import defaultdict
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np

from jaxplan.runtime.stopwatch import working_time
from jaxplan.runtime.threads import one_thread

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Ask:
    """What a fit asks for.

    Attributes:
        many: from what is asked about to as many answers.
        about: what it is asked about.
    """

    many: Callable[[Sequence[Any]], list[Any]]
    about: Any


Steps = Generator[Ask, Any, T]


def in_turn(function: Callable[..., Any], **arguments: Any) -> Ask:
    """Ask for what a function answers, even if it knows nothing of many.

    In a row it is quicker than between other work: instructions and data are then in the processor's caches.
    """
    return Ask(_in_turn(function), arguments)


@cache
def _in_turn(function: Callable[..., Any]) -> Callable[[Sequence[Any]], list[Any]]:
    def many(asked: Sequence[dict[str, Any]]) -> list[Any]:
        return [function(**arguments) for arguments in asked]

    return many


def alone(steps: Steps[T]) -> T:
    """What one fit returns, its asks answered one by one."""
    with one_thread():
        try:
            ask = next(steps)
            while True:
                ask = steps.send(ask.many([ask.about])[0])
        except StopIteration as end:
            answer: T = end.value
            return answer


def together(fits: Sequence[Steps[T]], spent: np.ndarray | None = None) -> list[T]:
    """What many fits return, their asks answered together.

    Args:
        fits: that have not begun.
        spent: (n,) to which the seconds of each are added, without those of compiling: of what is answered
            together an equal share.
    """
    seconds = np.zeros(len(fits)) if spent is None else spent
    answers: dict[int, T] = {}
    waiting: dict[Any, list[tuple[int, Any]]] = defaultdict(list)

    def go_on(number: int, answer: Any) -> None:
        began = working_time()
        try:
            ask = fits[number].send(answer)
        except StopIteration as end:
            answers[number] = end.value
        else:
            waiting[ask.many].append((number, ask.about))
        seconds[number] += working_time() - began

    with one_thread():
        for number in range(len(fits)):
            go_on(number, None)
        while waiting:
            many = max(waiting, key=lambda kind: len(waiting[kind]))
            numbers, about = zip(*waiting.pop(many), strict=True)
            began = working_time()
            found = many(about)
            seconds[list(numbers)] += (working_time() - began) / len(numbers)
            for number, answer in zip(numbers, found, strict=True):
                go_on(number, answer)
    return [answers[number] for number in range(len(fits))]
