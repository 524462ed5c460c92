"""The clock of a plan: computation time by step, what is left of the time limit, the progress bar."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from jaxplan.model.scenario import MINIMUM, Scenario
from jaxplan.runtime.stopwatch import working_time


class Clock:
    """Counts the seconds that each step of a plan takes, and what is left of the plan's time limit.

    Args:
        time_limit: s, for all steps together, compiling left out.
        show: called with the name of a step when it begins, for a progress bar.
        improve_for: s, see the attribute.

    Attributes:
        seconds: computation time by name of step, compiling left out. Of work that is done for several plans
            at once, only this plan's share counts.
        compiling: seconds that all steps spent on compiling.
        improve_for: s, how long to look for a plan that is shorter than the first one.
        shortest: s, duration of the shortest plan so far, for the progress bar; inf before the first one.
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
        self._seconds_left, self._show, self.improve_for = time_limit, show, improve_for

    def left(self) -> float:
        """Return the seconds that are left of the time limit, at least zero; compiling does not count."""
        return max(self._seconds_left, 0.0)

    def show(self, name: str) -> None:
        """Show on the progress bar that the step `name` begins."""
        self._show(name if math.isinf(self.shortest) else f"{name}, {self.shortest:.2f} s so far")

    def add(self, name: str, seconds: float, working: float) -> None:
        """Add `seconds` of wall time to the step `name`, `working` s of which were not spent on compiling.

        The working seconds count as the step's and reduce what is left of the limit; the rest is compiling.
        """
        worked = min(max(working, 0.0), seconds)  # others may compile at the same time, in threads
        self.seconds[name] = self.seconds.get(name, 0.0) + worked
        self.compiling += seconds - worked
        self._seconds_left -= working

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Count the time of a `with` block to the step `name`."""
        begin, began = time.monotonic(), working_time()
        self.show(name)
        yield
        self.add(name, time.monotonic() - begin, working_time() - began)

    def timings(self) -> dict[str, float]:
        """Return the computation times in seconds: by step, then "compile" and "total"."""
        total = sum(self.seconds.values()) + self.compiling
        return {**self.seconds, "compile": self.compiling, "total": total}


def expect_shortest(asked: str, improve_for: float, scenario: Scenario, name: str) -> None:
    """Raise ValueError if a shorter plan is asked for although the duration is not "minimum".

    Args:
        asked: key and value of what was asked for, with which the message begins.
        improve_for: s, how long to look for a shorter plan; 0 is always accepted.
        scenario: the problem.
        name: of the scenario, for the message.

    Raises:
        ValueError: if `improve_for` is not 0 and the duration is a number or "stretched".
    """
    duration = scenario.trajectory.duration
    if improve_for and duration != MINIMUM:
        needed = f'needs trajectory.duration_s = "{MINIMUM}"'
        raise ValueError(f"{asked}: {needed}, and that of {name} is {duration}")
