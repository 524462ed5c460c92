"""Two searches that take turns until one has a path.

Heuristics lead a search well or, now and then, long astray; trees that grow at random are seldom quick and
seldom astray. Side by side, call by call, they are never much slower than the better of the two.
"""

import numpy as np

from jaxplan.search.lockstep import Call, Steps
from jaxplan.search.problem import SearchResult


def race(first: Steps[SearchResult], second: Steps[SearchResult], *, head_start: int) -> Steps[SearchResult]:
    """The answer of the search that finds a path sooner.

    Args:
        first: a search.
        second: another of the same scene.
        head_start: how many calls of the first are answered before the second begins.

    Returns:
        The first answer with a path; where there is none, that of `first`.
    """
    one = _Runner(first)
    for _ in range(head_start):
        if one.call is not None:
            one.go_on((yield one.call))
    if one.has_path():
        return one.result()
    other = _Runner(second)
    mine = False
    while not (one.has_path() or other.has_path()):
        runner = one if (mine and one.call is not None) or other.call is None else other
        if runner.call is None:
            return one.result()
        runner.go_on((yield runner.call))
        mine = not mine
    return one.result() if one.has_path() else other.result()


class _Runner:
    """A search: the call that it waits for while it is under way, then its answer."""

    def __init__(self, steps: Steps[SearchResult]) -> None:
        self._steps = steps
        self.call: Call | None = None
        self.answer: SearchResult | None = None
        self.go_on(None)

    def go_on(self, answer: np.ndarray | None) -> None:
        """Send the answer to the call; None begins."""
        try:
            self.call = self._steps.send(answer)  # type: ignore[arg-type]
        except StopIteration as end:
            self.call, self.answer = None, end.value

    def has_path(self) -> bool:
        """Whether it has ended with a path."""
        return self.answer is not None and self.answer.path is not None

    def result(self) -> SearchResult:
        """The answer at its end."""
        assert self.answer is not None
        return self.answer
