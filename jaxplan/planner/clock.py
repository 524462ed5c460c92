"""The time that a plan takes, step by step."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from jaxplan.runtime.batching import Seconds
from jaxplan.runtime.jit import working_time


class Clock:
    """Seconds by step, and what is left of a time limit.

    Attributes:
        seconds: by the name of a step, without those of compiling. Only what was spent on the plan counts,
            not what other plans took that are made at the same time.
        compiling: seconds spent on that by all steps.
        show: is told the name of a step that begins.
    """

    def __init__(self, time_limit: float, show: Callable[[str], object] = lambda name: None) -> None:
        self.seconds: dict[str, float] = {}
        self.compiling = 0.0
        self._left, self.show = time_limit, show

    def spent(self) -> float:
        """Seconds spent on all steps."""
        return sum(self.seconds.values()) + self.compiling

    def left(self) -> float:
        """Seconds that are left of the limit, which does not count what is spent on compiling."""
        return max(self._left, 0.0)

    def add(self, name: str, seconds: float, working: float) -> None:
        """Count seconds, of which those that are not spent on compiling are the step's, and the limit's."""
        worked = min(max(working, 0.0), seconds)  # others may compile at the same time, in threads
        self.seconds[name] = self.seconds.get(name, 0.0) + worked
        self.compiling += seconds - worked
        self._left -= working

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Count the time of a block to a step."""
        begin, began = time.monotonic(), working_time()
        self.show(name)
        yield
        self.add(name, time.monotonic() - begin, working_time() - began)

    def timings(self) -> dict[str, float]:
        """Seconds by step, of compiling, and in all."""
        return {**self.seconds, "compile": self.compiling, "total": self.spent()}


@contextmanager
def shared_step(name: str, clocks: Sequence[Clock]) -> Iterator[Seconds]:
    """Count the time of a block to a step of several plans.

    Args:
        name: of the step.
        clocks: of the plans; without any nothing is counted.

    Yields:
        Where the block says what each plan has taken; what is nobody's own is shared equally.
    """
    seconds = Seconds(len(clocks))
    begin, began = time.monotonic(), working_time()
    for clock in clocks:
        clock.show(name)
    yield seconds
    if not clocks:
        return
    wall, working = time.monotonic() - begin, working_time() - began
    spent = seconds.spent + (working - seconds.spent.sum()) / len(clocks)
    for clock, own in zip(clocks, spent.tolist(), strict=True):
        clock.add(name, own + (wall - working) / len(clocks), own)
