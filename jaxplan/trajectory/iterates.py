"""Curves with all that is known of them; those of alike problems are worked on as one stack."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from jaxplan.model.limits import time_factor
from jaxplan.trajectory import options
from jaxplan.trajectory.motion import Motion, evaluate
from jaxplan.trajectory.problem import DiscreteProblem, System, Tube

LIMIT, ZONE, TUBE = range(3)  # kinds of rows


class SQPSolution(NamedTuple):
    """A curve with its duration, and what is known of it.

    Attributes:
        coefficients: (n, A).
        duration: s.
        margins: (S, D, Z) rad, as `Motion` has them.
        violations: (3,) by kind of row, the largest; zero or less where none is broken.
        finite: whether all numbers are.
        steps: how many were taken, or tried, from the curve that it began with.
    """

    coefficients: np.ndarray
    duration: float
    margins: np.ndarray
    violations: np.ndarray
    finite: bool
    steps: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Iterates:
    """A stack of G curves with their durations, and all that is known of them.

    Attributes:
        coefficients: (G, n, A).
        duration: (G,) s.
        motion: at the places of the search.
        violations: (G, 3) by kind of row, the largest; zero or less where none is broken.
    """

    coefficients: np.ndarray
    duration: np.ndarray
    motion: Motion
    violations: np.ndarray

    @property
    def is_sound(self) -> np.ndarray:
        """(G,) whether nothing is broken."""
        return np.all(self.violations <= options.ROWS.broken, axis=1)

    def one(self, number: int, steps: int) -> SQPSolution:
        """One of them, after so many steps."""
        return SQPSolution(
            coefficients=self.coefficients[number].copy(),  # no view, which would keep the whole stack
            duration=float(self.duration[number]),
            margins=self.motion.margins[number].copy(),
            violations=self.violations[number].copy(),
            finite=bool(self.motion.finite[number]),
            steps=steps,
        )

    def some(self, which: np.ndarray) -> "Iterates":
        """Some of them, by number or as (G,) bool."""
        return Iterates(
            coefficients=self.coefficients[which],
            duration=self.duration[which],
            motion=self.motion.some(which),
            violations=self.violations[which],
        )

    @staticmethod
    def chosen(first: "Iterates", other: "Iterates", others: np.ndarray) -> "Iterates":
        """Of two stacks of as many, the other's where `others` (G,) says so."""
        if np.all(others) or not np.any(others):
            return other if np.any(others) else first

        def mixed(own: np.ndarray, another: np.ndarray) -> np.ndarray:
            found = own.copy()
            found[others] = another[others]
            return found

        return Iterates(
            coefficients=mixed(first.coefficients, other.coefficients),
            duration=mixed(first.duration, other.duration),
            motion=first.motion.mixed(other.motion, others),
            violations=mixed(first.violations, other.violations),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Stack:
    """Tasks of one kind, G of them.

    Attributes:
        members: the problems.
        places: (G, S).
        rows: (G, 4, S, n).
        wanted: (G, D, Z) rad.
        free: (G, n, k).
        by_time: (G, n, A).
        energies: (G, 4, n, n) of the curve and its first three derivatives.
        weights: (G, 3).
        tube_rows: (G, m, n), zero where a problem has fewer nodes; m is 0 without tubes.
        tube_values: (G, m, A).
        tube_radius: (G, A).
    """

    members: Sequence[DiscreteProblem]
    places: np.ndarray
    rows: np.ndarray
    wanted: np.ndarray
    free: np.ndarray
    by_time: np.ndarray
    energies: np.ndarray
    weights: np.ndarray
    tube_rows: np.ndarray
    tube_values: np.ndarray
    tube_radius: np.ndarray

    @classmethod
    def of(cls, members: Sequence[DiscreteProblem]) -> "Stack":
        """The stack of problems of one kind."""
        size, axes = members[0].space.fixed.shape
        tubes = [_padded(discrete.tube, size, axes) for discrete in members]
        return cls(
            members=members,
            places=stacked([discrete.places for discrete in members]),
            rows=stacked([discrete.rows for discrete in members]),
            wanted=stacked([discrete.wanted for discrete in members]),
            free=stacked([discrete.space.free for discrete in members]),
            by_time=stacked([discrete.space.by_time for discrete in members]),
            energies=stacked([discrete.space.energies for discrete in members]),
            weights=np.array([discrete.weights for discrete in members]),
            tube_rows=stacked([tube.rows for tube in tubes]),
            tube_values=stacked([tube.values for tube in tubes]),
            tube_radius=stacked([tube.radius for tube in tubes]),
        )

    def some(self, which: np.ndarray) -> "Stack":
        """Some of them, by number or as (G,) bool."""
        numbers = np.arange(len(self.members))[which].tolist()
        arrays = {name: taken(own, which) for name, own in vars(self).items() if name != "members"}
        return replace(self, members=[self.members[number] for number in numbers], **arrays)

    @property
    def systems(self) -> list[System]:
        """The systems of the members."""
        return [discrete.system for discrete in self.members]

    def iterates(self, coefficients: np.ndarray, duration: np.ndarray, *, as_given: bool = False) -> Iterates:
        """Curves (G, n, A) with all known of them.

        Those of free time and rest at both ends are taken in the time needed, unless in that which is given.
        """
        motion = evaluate(self.systems, self.places, self.rows @ coefficients[:, None])
        kind = self.members[0]
        found = np.full((len(self.members), 3), -np.inf)
        ranges = np.stack([system.spacecraft.joint_limits for system in self.systems])
        found[:, ZONE] = _most(self.wanted[:, None] - motion.margins)
        found[:, LIMIT] = _most(np.abs(motion.curves[:, 0, :, 3:]) - ranges[:, None])
        if kind.limited:
            needed = needed_durations(self.systems, motion)
            if kind.free_time and not (as_given or np.any(self.by_time)):
                duration = needed
            found[:, LIMIT] = np.maximum(found[:, LIMIT], needed / duration - 1)
        if kind.tube is not None:
            off = np.abs(self.tube_rows @ coefficients - self.tube_values) - self.tube_radius[:, None]
            found[:, TUBE] = _most(off)
        found[~motion.finite, LIMIT] = np.inf
        return Iterates(coefficients=coefficients, duration=duration, motion=motion, violations=found)


def stacked(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays (G, ...); what all share is there but once."""
    first = arrays[0]
    if all(array is first for array in arrays):
        return np.broadcast_to(first, (len(arrays), *first.shape))
    return np.stack(arrays)


def taken(array: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Some of `stacked` arrays, by rising number or as (G,) bool, to be read only: no copy of all of them."""
    count = int(np.sum(which)) if which.dtype == bool else len(which)
    if count == len(array):
        return array
    if array.strides[0] == 0:
        return np.broadcast_to(array[0], (count, *array.shape[1:]))
    return array[which]


def needed_durations(systems: Sequence[System], motion: Motion) -> np.ndarray:
    """The shortest durations (G,) in which motions keep all limits of rates and loads at their places, s."""
    limits = np.stack([system.limits for system in systems])
    found = [
        (np.abs(motion.loads[:, :, q]) / limits[:, None, q], power)
        for q, power in enumerate(systems[0].powers)
    ]
    for each in zip(*(system.joint_limits for system in systems), strict=True):
        bound, power = np.stack([limit.bound for limit in each]), each[0].quantity.power
        found.append((np.abs(motion.curves[:, power, :, 3:]) / bound[:, None], power))
    return np.asarray(
        np.max([time_factor(np.max(shares, axis=(1, 2)), power) for shares, power in found], axis=0)
    )


def _most(values: np.ndarray) -> np.ndarray:
    """(G,) the largest of values (G, ...), -inf of none."""
    return np.asarray(np.max(values.reshape(len(values), -1), axis=1, initial=-np.inf))


def _padded(tube: Tube | None, size: int, axes: int) -> Tube:
    """A tube padded to one of few numbers of nodes; those beyond its own have no row and much room."""
    if tube is None:
        return Tube(np.zeros((0, size)), np.zeros((0, axes)), np.ones(axes))
    extra = tube.padded_nodes - len(tube.rows)
    return Tube(
        np.pad(tube.rows, ((0, extra), (0, 0))), np.pad(tube.values, ((0, extra), (0, 0))), tube.radius
    )
