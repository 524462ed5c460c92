"""Settings that trials may vary: their names, bounds and own values, in a file's keys and units."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jaxplan.model.scenario import Scenario
from jaxplan.scenario import ScenarioError
from jaxplan.scenario.kinds import Integer
from jaxplan.scenario.layout import SEARCH, TRAJECTORY
from jaxplan.study.task import Task, make_task

_DIGITS = 4  # that a number tried has, so that settings found can be written down
_TABLES = {"search": SEARCH, "trajectory": TRAJECTORY}


@dataclass(frozen=True, kw_only=True)
class Range:
    """A setting that is varied.

    Attributes:
        name: dotted, as in ``search.heuristic_weight``.
        low: the least value, in the file's unit.
        high: the largest.
        integer: whether the setting is a whole number.
        own: what the scenes have; NaN where they differ, or have a word or nothing there.
    """

    name: str
    low: float
    high: float
    integer: bool
    own: float

    def number(self, value: float) -> float | int:
        """A value as a file has it, between the bounds."""
        if self.integer:
            return round(value)
        return min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)


def make_ranges(task: Task, scenarios: tuple[Scenario, ...], over: object) -> tuple[Range, ...]:
    """The settings that are asked for.

    Args:
        task: the study that is made in each trial.
        scenarios: whose own values count.
        over: bounds by name.

    Raises:
        TypeError: if it is no dict.
        ScenarioError: if it is empty, or a name or bound is none that a file may hold; all are named.
    """
    if not isinstance(over, Mapping):
        raise TypeError(
            f'over must be a dict such as {{"search.heuristic_weight": (1, 20)}}, not {type(over).__name__}'
        )
    faults = [] if over else ["is empty: there is nothing to tune"]
    faults += [
        f"{name} = {bounds!r}: must be two numbers, the lower one first"
        for name, bounds in over.items()
        if not _is_pair(bounds)
    ]
    pairs = {str(name): bounds for name, bounds in over.items() if _is_pair(bounds)}
    for name, bounds in pairs.items():
        for bound in bounds:  # what a file may hold are intervals, so all between two good bounds is good
            try:
                make_task(task.scenes, task.kind, task.planner, {name: bound})
            except ScenarioError as error:
                faults += error.faults
    if faults:
        raise ScenarioError(dict.fromkeys(faults), "over")
    return tuple(_range(name, bounds, scenarios) for name, bounds in pairs.items())


def _is_pair(bounds: Any) -> bool:
    return (
        isinstance(bounds, tuple | list)
        and len(bounds) == 2
        and all(type(bound) in (int, float) and math.isfinite(bound) for bound in bounds)
        and bounds[0] < bounds[1]
    )


def _range(name: str, bounds: tuple[float, float], scenarios: tuple[Scenario, ...]) -> Range:
    table, _, key = name.partition(".")
    entry = next(entry for entry in _TABLES[table].fields if entry.key == key)
    held = [getattr(getattr(scenario, table), entry.attribute) for scenario in scenarios]
    values: list[Any] = [None if value is None else entry.kind.write(value) for value in held]  # not set
    first = values[0]
    return Range(
        name=name,
        low=bounds[0],
        high=bounds[1],
        integer=isinstance(entry.kind, Integer),
        own=first if type(first) in (int, float) and values.count(first) == len(values) else math.nan,
    )
