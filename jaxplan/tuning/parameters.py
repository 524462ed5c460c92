"""Numbers of a scenario that are tuned: names, bounds, and free parameters.

Settings that trials may vary: their names, bounds and own values, in a file's keys and units.

Numbers of a scenario as free parameters: a transform keeps each within its bounds.

A number between bounds is ``low + (high - low) / (1 + exp(-z))`` of a free ``z``; where the bounds are
positive and far apart its logarithm is. So a step in ``z`` means about the same for a weight and a duration.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.model.scenario import Scenario
from jaxplan.schema import ScenarioError
from jaxplan.schema.kinds import Integer
from jaxplan.schema.layout import SEARCH, TRAJECTORY
from jaxplan.schema.numbers import NumberPlace, find_number
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


_FAR = 10.0  # ratio of bounds from which on the logarithm is taken
_AROUND = 1e3  # times the first value, and a part of it, are the bounds where none are given


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A number that is tuned.

    Attributes:
        place: where it stands.
        low: bound in the file's units.
        high: likewise.
        first: value to begin with.
    """

    place: NumberPlace
    low: float
    high: float
    first: float

    @property
    def logarithmic(self) -> bool:
        """Whether the logarithm is between the bounds."""
        return self.low > 0 and self.high / self.low >= _FAR

    def value(self, free: Array) -> Array:
        """The number, in the file's units."""
        share = 1 / (1 + jnp.exp(-free))
        if self.logarithmic:
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share

    def free(self) -> float:
        """The free parameter to begin with."""
        if self.logarithmic:
            share = math.log(self.first / self.low) / math.log(self.high / self.low)
        else:
            share = (self.first - self.low) / (self.high - self.low)
        return math.log(share / (1 - share))


def parameters(
    scenario: Scenario, over: Sequence[str] | Mapping[str, tuple[float, float]]
) -> tuple[Parameter, ...]:
    """The parameters that are asked for.

    Args:
        scenario: with the values to begin with.
        over: dotted names, or their bounds by name, in the file's units. Without bounds a number may go to
            where the file allows it, but not beyond a thousandth and a thousandfold of its first value; one
            that may be negative, such as an angle, needs bounds.

    Raises:
        KeyError: if a scenario has no such number.
        ValueError: if bounds are none, or the first value does not lie between them.
    """
    if isinstance(over, str):
        raise ValueError(f'over = "{over}": must be a list of names, or their bounds by name')
    found = []
    for name in over:
        if not isinstance(name, str):
            raise ValueError(f"over has {name!r}: must be the name of a number")
        if name.startswith("search."):
            raise ValueError(
                f"{name}: settings of the search have no gradient, jp.tune_search tries them out"
            )
        place = find_number(scenario, name)
        first = float(place.get(scenario))
        low, high = _pair(name, over[name]) if isinstance(over, Mapping) else _usual(place, first)
        if not low < first < high:
            hint = "" if isinstance(over, Mapping) else ", which over may give"
            raise ValueError(f"{name} = {first:g}: must lie between its bounds {low:g} and {high:g}{hint}")
        for bound in (low, high):
            if place.interval is not None and not place.interval.low <= bound <= place.interval.high:
                raise ValueError(f"bound {bound:g} of {name}: must {place.interval.wanted()}")
        found.append(Parameter(place=place, low=float(low), high=float(high), first=first))
    if not found:
        raise ValueError("over names nothing to tune")
    return tuple(found)


def _pair(name: str, bounds: object) -> tuple[float, float]:
    """Bounds that are given."""
    good = isinstance(bounds, tuple | list) and len(bounds) == 2
    numbers = [float(bound) for bound in bounds if isinstance(bound, int | float | np.number)] if good else []  # type: ignore[attr-defined]
    if not (len(numbers) == 2 and all(map(math.isfinite, numbers)) and numbers[0] < numbers[1]):
        raise ValueError(f"bounds of {name} = {bounds!r}: must be two finite numbers, the lower one first")
    return numbers[0], numbers[1]


def _usual(place: NumberPlace, first: float) -> tuple[float, float]:
    """Bounds where none are given."""
    interval = place.interval
    if interval is None or interval.low < 0:
        raise ValueError(
            f"{place.name} = {first:g}: may be negative, so its size does not tell how far it may go; "
            f'give bounds, as in over={{"{place.name}": (low, high)}}'
        )
    return max(interval.low, first / _AROUND), min(interval.high, first * _AROUND)


def as_dict(tuned: Sequence[Parameter], free: np.ndarray) -> dict[str, float]:
    """The numbers by name."""
    return {one.place.name: float(one.value(z)) for one, z in zip(tuned, free, strict=True)}
