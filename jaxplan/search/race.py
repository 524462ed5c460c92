"""Two searches that take turns until one has a path.

Heuristics lead a search well or, now and then, long astray; trees that grow at random are seldom quick and
seldom astray. Side by side, call by call, they are never much slower than the better of the two.
"""

from typing import Any

from jaxplan.search.calls import SearchRun
from jaxplan.search.problem import SearchResult


class Race:
    """A search made of two, whose calls are answered in turn: the one that finds a path sooner wins.

    Args:
        first: a search.
        second: another of the same scene.
        head_start: how many calls of the first are answered before the second begins.
    """

    def __init__(self, first: SearchRun, second: SearchRun, *, head_start: int) -> None:
        self._first, self._second = _Runner(first), _Runner(second)
        self._head_start = head_start
        self._turn = self._first

    def next_request(self) -> Any:
        """The call of the search whose turn it is; None once one has a path, or both have ended."""
        first, second = self._first, self._second
        if self._head_start > 0 and first.call is not None:
            self._head_start -= 1
            return first.call
        self._head_start = 0
        if first.has_path:
            return None
        other = second if self._turn is first else first
        if other.call is not None:
            self._turn = other
        return None if second.has_path else self._turn.call

    def accept(self, answer: Any) -> None:
        """Go on with the search whose call has been answered."""
        self._turn.accept(answer)

    def result(self) -> SearchResult:
        """The result with a path; where there is none, that of the first."""
        winner = self._second if self._second.has_path else self._first
        assert winner.result is not None, "the race is under way"
        return winner.result


class _Runner:
    """One of the two: the call that it waits for while it is under way, then its result."""

    def __init__(self, run: SearchRun) -> None:
        self.run = run
        self.result: SearchResult | None = None
        self._call: Any = None
        self._begun = False

    @property
    def call(self) -> Any:
        """What it waits for; it begins when that is asked first."""
        if not self._begun:
            self._begun = True
            self._go_on()
        return self._call

    @property
    def has_path(self) -> bool:
        """Whether it has ended with a path."""
        return self.result is not None and self.result.path is not None

    def accept(self, answer: Any) -> None:
        self.run.accept(answer)
        self._go_on()

    def _go_on(self) -> None:
        self._call = self.run.next_request()
        if self._call is None:
            self.result = self.run.result()
