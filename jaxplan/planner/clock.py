"""The clock of a plan: seconds by step, what is left of its time limit, and what who waits is told."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from jaxplan.model.scenario import MINIMUM, Scenario
from jaxplan.runtime.jit import working_time


class Clock:
    """Seconds spent by each step of a plan, and what is left of its time limit.

    Attributes:
        seconds: by the name of a step, without those of compiling. Only what was spent on the plan counts,
            not what other plans took that are made at the same time.
        compiling: seconds that all steps spent on compiling.
        improve_for: s, for which a shorter plan is looked for than the first one.
        shortest: s, of the plans so far, which the progress bar tells; inf before the first one.
    """

    def __init__(
        self,
        time_limit: float,
        show: Callable[[str], object] = lambda name: None,
        *,
        improve_for: float = 0.0,
    ) -> None:
        self.seconds: dict[str, float] = {}
        self.compiling = 0.0
        self.shortest = math.inf
        self._left, self._show, self.improve_for = time_limit, show, improve_for

    def left(self) -> float:
        """Seconds that are left of the limit, which leaves out compiling; at least zero."""
        return max(self._left, 0.0)

    def show(self, name: str) -> None:
        """Show on the progress bar that a step, given by name, begins."""
        self._show(name if math.isinf(self.shortest) else f"{name}, {self.shortest:.2f} s so far")

    def add(self, name: str, seconds: float, working: float) -> None:
        """Count `seconds` to the step `name`, of which `working` s were not spent on compiling.

        The latter are the step's and reduce what is left of the limit; the others count as compiling.
        """
        worked = min(max(working, 0.0), seconds)  # others may compile at the same time, in threads
        self.seconds[name] = self.seconds.get(name, 0.0) + worked
        self.compiling += seconds - worked
        self._left -= working

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Count the time of a `with` block to the step `name`."""
        begin, began = time.monotonic(), working_time()
        self.show(name)
        yield
        self.add(name, time.monotonic() - begin, working_time() - began)

    def timings(self) -> dict[str, float]:
        """Seconds by step, of compiling, and in all."""
        total = sum(self.seconds.values()) + self.compiling
        return {**self.seconds, "compile": self.compiling, "total": total}


def expect_shortest(asked: str, improve_for: float, scenario: Scenario, name: str) -> None:
    """Refuse to look for a shorter plan where the duration is not the shortest.

    Args:
        asked: what was asked for, by its key and value, to begin the message.
        improve_for: s, for which it is to be looked for.
        scenario: the problem.
        name: of the scenario.

    Raises:
        ValueError: if that is any time, and the duration is given or stretched.
    """
    duration = scenario.trajectory.duration
    if improve_for and duration != MINIMUM:
        needed = f'needs trajectory.duration_s = "{MINIMUM}"'
        raise ValueError(f"{asked}: {needed}, and that of {name} is {duration}")
