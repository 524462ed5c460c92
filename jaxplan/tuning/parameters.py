"""Numbers of a scenario as free parameters: a transform keeps each within its bounds.

A number between bounds is ``low + (high - low) / (1 + exp(-z))`` of a free ``z``; where the bounds are
positive and far apart its logarithm is. So a step in ``z`` means about the same for a weight and a duration.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.model.scenario import Scenario
from jaxplan.scenario.numbers import NumberPlace, find_number

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
