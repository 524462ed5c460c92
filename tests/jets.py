"""Intervals of numbers, and of a function with its first two derivatives by one parameter.

Both have arrays for ends, and hold whatever value is in each of many boxes at once. Ends are rounded to the
nearest number, not outward: who proves anything with them adds what rounding may do.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Interval:
    """Numbers between two ends, arrays of one shape; `ZERO` is the one that needs no computing."""

    low: np.ndarray
    high: np.ndarray

    def __add__(self, other):
        if self is ZERO or other is ZERO:
            return other if self is ZERO else self
        return Interval(self.low + other.low, self.high + other.high)

    def __sub__(self, other):
        return self + -1.0 * other

    def __mul__(self, other):
        if self is ZERO or other is ZERO:
            return ZERO
        if np.min(self.low) >= 0 and np.min(other.low) >= 0:
            return Interval(self.low * other.low, self.high * other.high)
        products = [a * b for a in (self.low, self.high) for b in (other.low, other.high)]
        return Interval(np.minimum.reduce(products), np.maximum.reduce(products))

    def __rmul__(self, factor):
        """With a number."""
        if self is ZERO:
            return ZERO
        ends = factor * self.low, factor * self.high
        return Interval(*ends) if factor >= 0 else Interval(*ends[::-1])

    def __pow__(self, exponent):
        """Of positive numbers."""
        ends = self.low**exponent, self.high**exponent
        return Interval(*ends) if exponent >= 0 else Interval(*ends[::-1])


ZERO = Interval(np.zeros(()), np.zeros(()))
ONE = Interval(np.ones(()), np.ones(()))


@dataclass(frozen=True, eq=False)
class Jet:
    """Intervals of a function's values, and of its first and second derivatives by a parameter."""

    value: Interval
    slope: Interval = ZERO
    bend: Interval = ZERO

    def __add__(self, other):
        return Jet(self.value + other.value, self.slope + other.slope, self.bend + other.bend)

    def __sub__(self, other):
        return self + -1.0 * other

    def __mul__(self, other):
        return Jet(
            self.value * other.value,
            self.value * other.slope + self.slope * other.value,
            self.value * other.bend + 2.0 * (self.slope * other.slope) + self.bend * other.value,
        )

    def __rmul__(self, factor):
        """With a number."""
        return Jet(factor * self.value, factor * self.slope, factor * self.bend)

    def __radd__(self, number):
        return Jet(Interval(number + self.value.low, number + self.value.high), self.slope, self.bend)

    def __pow__(self, exponent):
        """Of a positive function."""
        if exponent == 0:
            return Jet(ONE)
        first = exponent * self.value ** (exponent - 1)
        second = exponent * (exponent - 1) * self.value ** (exponent - 2)
        return Jet(
            self.value**exponent,
            first * self.slope,
            second * (self.slope * self.slope) + first * self.bend,
        )
