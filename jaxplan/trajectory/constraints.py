"""Constraints of the spline fit as blocks of linear rows near curves: joints, tubes, loads, margins.

Curves are looked at together: a stack of G, each with its own rows. A row says
``slopes . dc + time * dT / T <= room`` of a change ``dc`` of the coefficients and ``dT`` of the duration. A
family knows the room of all its rows and how a step changes it, and writes out only the rows that a program
asks for.

Rows of joints by the coefficients, and of nodes in a tube, are true of every step. All values of a spline lie
between the least and the largest of its coefficients, and those of a derivative likewise, so what holds for
the coefficients holds at every instant.

Rows of the platform's loads and of margins are linearised at places close to each other.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from jaxplan.trajectory.iterates import LIMIT, TUBE, ZONE, Points, Stack, stacked, taken
from jaxplan.trajectory.motion import Motion

# Rows with less room than this are in a program from the start: shares of a limit or of a tube, and angles.
NEAR_SHARE = 0.15
NEAR_ANGLE = float(np.deg2rad(1.0))

SIGNS = np.array([1.0, -1.0])  # of a bound on both sides

Index = tuple[np.ndarray, ...]  # of rows, the number of the curve first


class Step(NamedTuple):
    """Changes of some curves of a stack.

    Attributes:
        which: (g,) numbers of the curves.
        coefficients: (g, n, A).
        curves: (g, 4, S, A) what that makes of values and derivatives at the places.
        stretch: (g,) relative change of the duration.
    """

    which: np.ndarray
    coefficients: np.ndarray
    curves: np.ndarray
    stretch: np.ndarray

    def some(self, which: np.ndarray) -> "Step":
        """Those of (g,) bool."""
        return self if np.all(which) else Step(*(own[which] for own in self))


class Slopes(NamedTuple):
    """Slopes of some rows in the coefficients: sums of J products of a row of the axes and one of the basis.

    Attributes:
        axes: (R, J, A).
        basis: (R, J, n).
    """

    axes: np.ndarray
    basis: np.ndarray

    @property
    def full(self) -> np.ndarray:
        """(R, A, n)."""
        return np.asarray(np.swapaxes(self.axes, 1, 2) @ self.basis)


class Family(Protocol):
    """Rows of one sort.

    Attributes:
        name: unique among the families of a fit.
        kind: `LIMIT`, `ZONE` or `TUBE`.
        room: of every row (G, ...).
        near: rows with less room are near.
        time: of the rows.
        linear: whether the rows are true of all steps, not of small ones alone.
        in_reach: (G,) whether a step may break any of the rows.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def kind(self) -> int: ...  # noqa: D102
    @property
    def room(self) -> np.ndarray: ...  # noqa: D102
    @property
    def near(self) -> float: ...  # noqa: D102
    @property
    def time(self) -> float: ...  # noqa: D102
    @property
    def linear(self) -> bool: ...  # noqa: D102
    @property
    def in_reach(self) -> np.ndarray: ...  # noqa: D102

    def change(self, step: Step) -> np.ndarray:
        """By how much a step lessens the room (g, ...) of the curves that take it, without its stretch."""
        ...

    def slopes(self, index: Index) -> Slopes:
        """Of some rows."""
        ...

    def chosen(self, wanted: np.ndarray, room: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Of the rows that are wanted (g, ...) of some curves, those that do, given what room they have."""
        ...


def numbers(chosen: np.ndarray) -> Index:
    """Of the rows that are chosen, (G, ...) bool; `np.nonzero`, many times as fast where they are few."""
    return np.unravel_index(np.flatnonzero(chosen), chosen.shape)


def lowest(room: np.ndarray) -> np.ndarray:
    """Where the room is least among neighbours along the second to last axis."""
    kept = np.ones(room.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        down = room[..., 1:, :] <= room[..., :-1, :]
        up = room[..., :-1, :] <= room[..., 1:, :]
    kept[..., 1:, :] &= down
    kept[..., :-1, :] &= up
    return kept


@dataclass(frozen=True, eq=False)
class _Linear:
    """What these families share."""

    coefficients: np.ndarray  # (G, n, A)
    linear = True

    @property
    def in_reach(self) -> np.ndarray:
        """Of the rows; all of them."""
        return np.ones(len(self.coefficients), dtype=bool)

    def chosen(self, wanted: np.ndarray, room: np.ndarray, which: np.ndarray) -> np.ndarray:
        """See `Family`; all of them."""
        return wanted


@dataclass(frozen=True, eq=False)
class Joints(_Linear):
    """Rates or accelerations of joints, by the coefficients of the derivative: rows (G, 2, n - d, joints)."""

    name: str
    power: int
    differences: np.ndarray  # (G, n - d, n)
    scale: np.ndarray  # (G, joints) 1 / (limit * duration^power)
    kind: int = LIMIT
    near: float = 2 * NEAR_SHARE

    @property
    def time(self) -> float:
        """Of the rows."""
        return -float(self.power)

    @cached_property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return 1 - self._shares(np.arange(len(self.scale)), self.coefficients)

    def _shares(self, which: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        differences = taken(self.differences, which)
        return _both(differences @ coefficients[:, :, 3:] * self.scale[which][:, None])

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return self._shares(step.which, step.coefficients)

    def slopes(self, index: Index) -> Slopes:
        """See `Family`."""
        curve, sign, row, joint = index
        factor = SIGNS[sign] * self.scale[curve, joint]
        return _of_axis(3 + joint, factor, self.differences[curve, row], self.coefficients.shape[2])


@dataclass(frozen=True, eq=False)
class Ranges(_Linear):
    """Angles of the joints by the coefficients: rows (G, 2, n, joints)."""

    limits: np.ndarray  # (G, joints)
    name: str = "range"
    kind: int = LIMIT
    near: float = NEAR_ANGLE
    time: float = 0.0

    @cached_property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return self.limits[:, None, None] - _both(self.coefficients[:, :, 3:])

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return _both(step.coefficients[:, :, 3:])

    def slopes(self, index: Index) -> Slopes:
        """See `Family`."""
        _, sign, row, joint = index
        _, size, axes = self.coefficients.shape
        return _of_axis(3 + joint, SIGNS[sign], np.eye(size)[row], axes)


@dataclass(frozen=True, eq=False)
class Nodes(_Linear):
    """Tubes about nodes: rows (G, 2, m, A), as shares of the radius."""

    rows: np.ndarray  # (G, m, n)
    values: np.ndarray  # (G, m, A)
    radius: np.ndarray  # (G, A)
    name: str = "tube"
    kind: int = TUBE
    near: float = 2 * NEAR_SHARE
    time: float = 0.0

    @cached_property
    def room(self) -> np.ndarray:
        """Of the rows."""
        off = self.rows @ self.coefficients - self.values
        return 1 - _both(off / self.radius[:, None])

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return _both(self.rows[step.which] @ step.coefficients / self.radius[step.which][:, None])

    def slopes(self, index: Index) -> Slopes:
        """See `Family`."""
        curve, sign, node, axis = index
        factor = SIGNS[sign] / self.radius[curve, axis]
        return _of_axis(axis, factor, self.rows[curve, node], self.coefficients.shape[2])


def _both(values: np.ndarray) -> np.ndarray:
    """Values (g, ...) with both signs (g, 2, ...)."""
    return np.stack([values, -values], axis=1)


def _of_axis(axis: np.ndarray, factor: np.ndarray, basis: np.ndarray, axes: int) -> Slopes:
    """Slopes of rows (R,) that are of one axis each."""
    own = np.zeros((len(axis), 1, axes))
    own[np.arange(len(axis)), 0, axis] = factor
    return Slopes(own, basis[:, None])


_FAR_SHARE = 0.5  # of a limit is left at every place: then no step reaches it
_STRIDE = 4  # of places next to each other one in four is held, and those that are extreme


@dataclass(frozen=True, eq=False)
class Loads:
    """One of the platform's loads at the places: rows (G, S, 2, 3)."""

    name: str
    power: int
    motion: Motion
    load: int  # which
    scale: np.ndarray  # (G, 3) 1 / (limit * duration^power)
    rows: np.ndarray  # (G, 4, S, n) of the basis
    kind: int = LIMIT
    near: float = NEAR_SHARE
    linear: bool = False

    @property
    def time(self) -> float:
        """Of the rows."""
        return -float(self.power)

    @cached_property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return 1 - SIGNS[:, None] * (self.motion.loads[:, :, self.load] * self.scale[:, None])[:, :, None]

    @cached_property
    def in_reach(self) -> np.ndarray:
        """Of the rows."""
        return ~np.all(self.room > _FAR_SHARE, axis=(1, 2, 3))

    def _local(self, curve: int) -> np.ndarray:
        """(S, 3, 4, 3) slopes of the shares."""
        return self.motion.load_slopes(curve)[:, self.load] * self.scale[curve, :, None, None]

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        change = np.empty((len(step.which), *self.room.shape[1:]))
        for own, curve in enumerate(step.which.tolist()):
            shares = np.einsum("sida,dsa->si", self._local(curve), step.curves[own, :, :, :3])
            change[own] = SIGNS[:, None] * shares[:, None]
        return change

    def slopes(self, index: Index) -> Slopes:
        """See `Family`."""
        curve, place, sign, axis = index
        axes = np.zeros((len(place), 4, self.motion.curves.shape[3]))
        for each in np.unique(curve).tolist():
            rows = curve == each
            local = self._local(each)[place[rows], axis[rows]]
            axes[rows, :, :3] = SIGNS[sign[rows]][:, None, None] * local
        return Slopes(axes, self.rows[curve, :, place])

    def chosen(self, wanted: np.ndarray, room: np.ndarray, which: np.ndarray) -> np.ndarray:
        """See `Family`; thinned, with the last place: unlike a margin, a load may be the worst at the end."""
        kept = _telling(room)
        kept[:, -1] = True
        return wanted & kept


@dataclass(frozen=True, eq=False)
class Zones:
    """Margins at the places: rows (G, S, D, Z)."""

    motion: Motion
    rows: np.ndarray  # (G, 4, S, n) of the basis
    room: np.ndarray  # beyond what is wanted
    name: str = "zone"
    kind: int = ZONE
    near: float = NEAR_ANGLE
    time: float = 0.0
    linear: bool = False

    @cached_property
    def in_reach(self) -> np.ndarray:
        """Of the rows."""
        return np.any(np.isfinite(self.room), axis=(1, 2, 3))

    def change(self, step: Step) -> np.ndarray:
        """See `Family`; zero of rows that stay far."""
        room = taken(self.room, step.which)
        reach = self.near + self.motion.reach(step.curves[:, 0], step.which)
        own, *rest = numbers(room < reach)
        local = self.motion.margin_slopes(step.which[own], *rest)
        change = np.zeros_like(room)
        change[(own, *rest)] = -np.einsum("ra,ra->r", local, step.curves[own, 0, rest[0]])
        return change

    def slopes(self, index: Index) -> Slopes:
        """See `Family`."""
        local = -self.motion.margin_slopes(*index)
        return Slopes(local[:, None], self.rows[index[0], 0, index[1]][:, None])

    def chosen(self, wanted: np.ndarray, room: np.ndarray, which: np.ndarray) -> np.ndarray:
        """See `Family`; thinned, and of a constraint only the entry that holds best."""
        return wanted & _telling(room) & np.isfinite(self.room[which])


def _telling(room: np.ndarray) -> np.ndarray:
    """Along the places, the second axis, each fourth one and the local minima of the room."""
    kept = np.zeros(room.shape, dtype=bool)
    kept[:, ::_STRIDE] = True
    with np.errstate(invalid="ignore"):
        kept[:, 1:-1] |= (room[:, 1:-1] <= room[:, :-2]) & (room[:, 1:-1] <= room[:, 2:])
    return kept


def families(stack: Stack, at: Points) -> Iterator[Family]:
    """All rows of a stack of tasks at curves of theirs."""
    kind, duration = stack.tasks[0], at.duration[:, None]
    problems = stack.problems
    crafts = [problem.spacecraft for problem in problems]
    if np.any(np.isfinite(at.motion.margins)):
        yield Zones(at.motion, stack.rows, at.motion.margins - stack.wanted[:, None])
    if crafts[0].terminals:
        yield Ranges(at.coefficients, np.stack([craft.joint_limits for craft in crafts]))
    if kind.limited:
        for each in zip(*(problem.joint_limits for problem in problems), strict=True):
            quantity, bound = each[0].quantity, np.stack([limit.bound for limit in each])
            differences = stacked([task.space.basis.differences[quantity.power] for task in stack.tasks])
            scale = 1 / (bound * duration**quantity.power)
            yield Joints(at.coefficients, quantity.name, quantity.power, differences, scale)
        first = problems[0]
        for q, (name, power) in enumerate(zip(first.names, first.powers, strict=True)):
            limit = np.stack([problem.limits[q] for problem in problems])
            yield Loads(name, int(power), at.motion, q, 1 / (limit * duration**power), stack.rows)
    if kind.tube is not None:
        yield Nodes(at.coefficients, stack.tube_rows, stack.tube_values, stack.tube_radius)
