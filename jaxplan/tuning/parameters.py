"""Numbers that are tuned: their names, bounds and first values, in a file's keys and units.

Trials vary settings within a `Range`. A descent has a *free* parameter ``z`` for each number, which may take
any value; the number is ``low + (high - low) / (1 + exp(-z))``, always within its bounds. If the bounds are
positive and far apart, the number's logarithm is transformed so instead. So a step in ``z`` means about the
same for a weight and a duration.
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
from jaxplan.schema.layout import ROBUST, SEARCH, TRAJECTORY
from jaxplan.schema.numbers import NumberPlace, find_number
from jaxplan.schema.value_kinds import Integer
from jaxplan.study.task import Task, make_task

_DIGITS = 4  # significant digits of the numbers tried, so that settings are easy to write down
_TABLES = {"search": SEARCH, "trajectory": TRAJECTORY, "robust": ROBUST}
_LOGARITHMIC_RATIO = 10.0  # least ratio of the bounds for which the logarithm is transformed
_DEFAULT_BOUND_FACTOR = 1e3  # factor from the first value to either bound where none are given


@dataclass(frozen=True, kw_only=True)
class Range:
    """A setting that trials vary.

    Attributes:
        name: its dotted name, as in ``search.heuristic_weight``.
        low: the least value, in the file's unit.
        high: the largest value, likewise.
        integer: whether the setting is a whole number.
        own: the value that all scenes have; NaN if they differ, or have a word or nothing there.
    """

    name: str
    low: float
    high: float
    integer: bool
    own: float

    def number(self, value: float) -> float | int:
        """Return a value rounded as it is written into a file: to an integer, or to `_DIGITS` digits."""
        if self.integer:
            return round(value)
        return min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)


def make_ranges(task: Task, over: object) -> tuple[Range, ...]:
    """Check the names and bounds of the settings that trials vary, and return their ranges.

    Args:
        task: the study that is made in each trial.
        over: a dict of bounds (low, high) by name.

    Raises:
        TypeError: if `over` is not a dict.
        ScenarioError: if it is empty, or has names or bounds that a file may not hold; all are listed.
    """
    if not isinstance(over, Mapping):
        raise TypeError(
            f'over must be a dict such as {{"search.heuristic_weight": (1, 20)}}, not {type(over).__name__}'
        )
    faults = [] if over else ["is empty: there is nothing to tune"]
    for name, bounds in over.items():
        if _parse_bounds(bounds) is None:
            faults.append(f"{name} = {bounds!r}: must be two numbers, the lower one first")
            continue
        for bound in bounds:  # what a file may hold are intervals, so all between two good bounds is good
            try:
                make_task(task.scenes, task.kind, task.planner, {str(name): bound})
            except ScenarioError as error:
                faults += error.faults
    if faults:
        raise ScenarioError(dict.fromkeys(faults), "over")
    scenarios = [task.scenario(place) for place in range(task.examples)]
    return tuple(_make_range(str(name), bounds, scenarios) for name, bounds in over.items())


def _parse_bounds(bounds: Any) -> tuple[float, float] | None:
    """Return bounds as two finite floats, the lower one first; None if they are anything else."""
    if not isinstance(bounds, tuple | list) or len(bounds) != 2:
        return None
    numeric = all(isinstance(one, int | float | np.number) and type(one) is not bool for one in bounds)
    low, high = map(float, bounds) if numeric else (math.nan, math.nan)
    return (low, high) if math.isfinite(low) and math.isfinite(high) and low < high else None


def _make_range(name: str, bounds: tuple[float, float], scenarios: Sequence[Scenario]) -> Range:
    """Return the range of a setting by its dotted name, with the value that all scenarios have."""
    table, _, key = name.partition(".")
    entry = next(entry for entry in _TABLES[table].fields if entry.key == key)
    held = [getattr(getattr(scenario, table), entry.attribute, None) for scenario in scenarios]
    values: list[Any] = [None if value is None else entry.kind.write(value) for value in held]  # not set
    first = values[0]
    return Range(
        name=name,
        low=bounds[0],
        high=bounds[1],
        integer=isinstance(entry.kind, Integer),
        own=first if type(first) in (int, float) and values.count(first) == len(values) else math.nan,
    )


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A number that is tuned.

    Attributes:
        place: where it stands in a scenario.
        low: its lower bound, in the file's unit.
        high: its upper bound, likewise.
        first: its first value, likewise, between the bounds.
    """

    place: NumberPlace
    low: float
    high: float
    first: float

    @property
    def logarithmic(self) -> bool:
        """Whether the transform is applied to the logarithm of the number."""
        return self.low > 0 and self.high / self.low >= _LOGARITHMIC_RATIO

    def value(self, free: Array) -> Array:
        """Return the number, in the file's unit, for a free parameter."""
        share = 1 / (1 + jnp.exp(-free))
        if self.logarithmic:
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share

    def free(self) -> float:
        """Return the free parameter of the first value."""
        if self.logarithmic:
            share = math.log(self.first / self.low) / math.log(self.high / self.low)
        else:
            share = (self.first - self.low) / (self.high - self.low)
        return math.log(share / (1 - share))


def parameters(
    scenario: Scenario, over: Sequence[str] | Mapping[str, tuple[float, float]]
) -> tuple[Parameter, ...]:
    """Check the names and bounds of the numbers that are to be tuned, and return their parameters.

    Args:
        scenario: a scenario with the first values.
        over: dotted names, or a mapping from names to bounds (low, high), in the file's units. Without bounds
            a number may vary as far as the file allows, but only from a thousandth to a thousand times its
            first value; a number that may be negative, such as an angle, needs bounds.

    Raises:
        ScenarioError: if a scenario has no such number; the message says what there is.
        ValueError: if `over` is empty or has a setting of the search, if bounds are not two numbers that a
            file may hold, or if the first value does not lie between them.
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
        place = number_of(scenario, name)
        first = float(place.get(scenario))
        if isinstance(over, Mapping):
            bounds = _parse_bounds(over[name])
            if bounds is None:
                wanted = "must be two finite numbers, the lower one first"
                raise ValueError(f"bounds of {name} = {over[name]!r}: {wanted}")
        else:
            bounds = _default_bounds(place, first)
        low, high = bounds
        if not low < first < high:
            hint = "" if isinstance(over, Mapping) else ", which over may give"
            raise ValueError(f"{name} = {first:g}: must lie between its bounds {low:g} and {high:g}{hint}")
        for bound in bounds:
            if place.interval is not None and not place.interval.low <= bound <= place.interval.high:
                raise ValueError(f"bound {bound:g} of {name}: must {place.interval.wanted()}")
        found.append(Parameter(place=place, low=low, high=high, first=first))
    if not found:
        raise ValueError("over names nothing to tune")
    return tuple(found)


def number_of(scenario: Scenario, name: str) -> NumberPlace:
    """Return where the number with a dotted name stands in a scenario; ScenarioError if there is none."""
    try:
        return find_number(scenario, name)
    except KeyError as error:
        raise ScenarioError(error.args, "over") from None


def _default_bounds(place: NumberPlace, first: float) -> tuple[float, float]:
    """Return bounds for a number for which none are given; raises ValueError if it may be negative."""
    interval = place.interval
    if interval is None or interval.low < 0:
        raise ValueError(
            f"{place.name} = {first:g}: may be negative, so its size does not tell how far it may go; "
            f'give bounds, as in over={{"{place.name}": (low, high)}}'
        )
    return max(interval.low, first / _DEFAULT_BOUND_FACTOR), min(interval.high, first * _DEFAULT_BOUND_FACTOR)


def as_dict(tuned: Sequence[Parameter], free: np.ndarray) -> dict[str, float]:
    """Return the numbers for free parameters (k,) as a dict by name, in the file's units."""
    return {one.place.name: float(one.value(z)) for one, z in zip(tuned, free, strict=True)}
