"""Constraints of the spline fit as blocks of linear rows near curves: joints, tubes, loads, margins.

Curves are looked at together: a stack of G, each with its own rows. A row says
``slopes . dc + time * dT / T <= slack`` of a change ``dc`` of the coefficients and ``dT`` of the duration. A
block knows the slack of all its rows and how a step changes it, and writes out only the rows that a program
asks for.

Rows of joints by the coefficients, and of nodes in a tube, are true of every step. All values of a spline lie
between the least and the largest of its coefficients, and those of a derivative likewise, so what holds for
the coefficients holds at every instant.

Rows of the platform's loads and of margins are linearised at places close to each other.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from jaxplan.trajectory import options
from jaxplan.trajectory.iterates import LIMIT, TUBE, ZONE, Iterates, Stack, stacked, taken
from jaxplan.trajectory.motion import Motion

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


class RowJacobian(NamedTuple):
    """Derivatives of rows in the coefficients: sums of J products of a row of the axes and one of the basis.

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


class ConstraintBlock(Protocol):
    """Rows of one sort, which know their slack and how a step changes it.

    Attributes:
        name: unique among the blocks of a fit.
        kind: `LIMIT`, `ZONE` or `TUBE`.
        slack: of every row (G, ...), zero where it just holds.
        tolerance: rows with less slack are in a program from the start.
        time: the coefficient of ``dT / T`` in every row.
        linear: whether the rows are true of all steps, not of small ones alone.
        may_bind: (G,) whether a step may break any of the rows.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def kind(self) -> int: ...  # noqa: D102
    @property
    def slack(self) -> np.ndarray: ...  # noqa: D102
    @property
    def tolerance(self) -> float: ...  # noqa: D102
    @property
    def time(self) -> float: ...  # noqa: D102
    @property
    def linear(self) -> bool: ...  # noqa: D102
    @property
    def may_bind(self) -> np.ndarray: ...  # noqa: D102

    def change(self, step: Step) -> np.ndarray:
        """By how much a step lessens the slack (g, ...) of the curves that take it, without its stretch."""
        ...

    def slopes(self, index: Index) -> RowJacobian:
        """Of some rows."""
        ...

    def chosen(self, wanted: np.ndarray, slack: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Of the rows that are wanted (g, ...) of some curves, those that do, given what slack they have."""
        ...


def numbers(chosen: np.ndarray) -> Index:
    """Of the rows that are chosen, (G, ...) bool; `np.nonzero`, many times as fast where they are few."""
    return np.unravel_index(np.flatnonzero(chosen), chosen.shape)


def lowest(slack: np.ndarray) -> np.ndarray:
    """Where the slack is least among neighbours along the second to last axis."""
    kept = np.ones(slack.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        down = slack[..., 1:, :] <= slack[..., :-1, :]
        up = slack[..., :-1, :] <= slack[..., 1:, :]
    kept[..., 1:, :] &= down
    kept[..., :-1, :] &= up
    return kept


@dataclass(frozen=True, eq=False)
class _Linear:
    """What these blocks share."""

    coefficients: np.ndarray  # (G, n, A)
    linear = True

    @property
    def may_bind(self) -> np.ndarray:
        """A step may break rows of every curve."""
        return np.ones(len(self.coefficients), dtype=bool)

    def chosen(self, wanted: np.ndarray, slack: np.ndarray, which: np.ndarray) -> np.ndarray:
        """All rows that are wanted; none is left out."""
        return wanted


@dataclass(frozen=True, eq=False)
class JointDerivativeBlock(_Linear):
    """Rates or accelerations of joints, by the coefficients of the derivative: rows (G, 2, n - d, joints)."""

    name: str
    power: int
    differences: np.ndarray  # (G, n - d, n)
    scale: np.ndarray  # (G, joints) 1 / (limit * duration^power)
    kind: int = LIMIT
    tolerance: float = field(default_factory=lambda: 2 * options.ROWS.near_share)

    @property
    def time(self) -> float:
        """Coefficient of the relative change of the duration."""
        return -float(self.power)

    @cached_property
    def slack(self) -> np.ndarray:
        """Slack of every row."""
        return 1 - self._shares(np.arange(len(self.scale)), self.coefficients)

    def _shares(self, which: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        differences = taken(self.differences, which)
        return _both(differences @ coefficients[:, :, 3:] * self.scale[which][:, None])

    def change(self, step: Step) -> np.ndarray:
        """How a step lessens the slack."""
        return self._shares(step.which, step.coefficients)

    def slopes(self, index: Index) -> RowJacobian:
        """Derivatives of some rows in the coefficients."""
        curve, sign, row, joint = index
        factor = SIGNS[sign] * self.scale[curve, joint]
        return _of_axis(3 + joint, factor, self.differences[curve, row], self.coefficients.shape[2])


@dataclass(frozen=True, eq=False)
class JointRangeBlock(_Linear):
    """Angles of the joints by the coefficients: rows (G, 2, n, joints)."""

    limits: np.ndarray  # (G, joints)
    name: str = "range"
    kind: int = LIMIT
    tolerance: float = field(default_factory=lambda: options.ROWS.near_angle)
    time: float = 0.0

    @cached_property
    def slack(self) -> np.ndarray:
        """Slack of every row."""
        return self.limits[:, None, None] - _both(self.coefficients[:, :, 3:])

    def change(self, step: Step) -> np.ndarray:
        """How a step lessens the slack."""
        return _both(step.coefficients[:, :, 3:])

    def slopes(self, index: Index) -> RowJacobian:
        """Derivatives of some rows in the coefficients."""
        _, sign, row, joint = index
        _, size, axes = self.coefficients.shape
        return _of_axis(3 + joint, SIGNS[sign], np.eye(size)[row], axes)


@dataclass(frozen=True, eq=False)
class TubeBlock(_Linear):
    """Tubes about nodes: rows (G, 2, m, A), as shares of the radius."""

    rows: np.ndarray  # (G, m, n)
    values: np.ndarray  # (G, m, A)
    radius: np.ndarray  # (G, A)
    name: str = "tube"
    kind: int = TUBE
    tolerance: float = field(default_factory=lambda: 2 * options.ROWS.near_share)
    time: float = 0.0

    @cached_property
    def slack(self) -> np.ndarray:
        """Slack of every row."""
        off = self.rows @ self.coefficients - self.values
        return 1 - _both(off / self.radius[:, None])

    def change(self, step: Step) -> np.ndarray:
        """How a step lessens the slack."""
        return _both(self.rows[step.which] @ step.coefficients / self.radius[step.which][:, None])

    def slopes(self, index: Index) -> RowJacobian:
        """Derivatives of some rows in the coefficients."""
        curve, sign, node, axis = index
        factor = SIGNS[sign] / self.radius[curve, axis]
        return _of_axis(axis, factor, self.rows[curve, node], self.coefficients.shape[2])


def _both(values: np.ndarray) -> np.ndarray:
    """Values (g, ...) with both signs (g, 2, ...)."""
    return np.stack([values, -values], axis=1)


def _of_axis(axis: np.ndarray, factor: np.ndarray, basis: np.ndarray, axes: int) -> RowJacobian:
    """Derivatives of rows (R,) that are of one axis each."""
    own = np.zeros((len(axis), 1, axes))
    own[np.arange(len(axis)), 0, axis] = factor
    return RowJacobian(own, basis[:, None])


@dataclass(frozen=True, eq=False)
class LoadBlock:
    """One of the platform's loads at the places: rows (G, S, 2, 3)."""

    name: str
    power: int
    motion: Motion
    load: int  # which
    scale: np.ndarray  # (G, 3) 1 / (limit * duration^power)
    rows: np.ndarray  # (G, 4, S, n) of the basis
    kind: int = LIMIT
    tolerance: float = field(default_factory=lambda: options.ROWS.near_share)
    linear: bool = False

    @property
    def time(self) -> float:
        """Coefficient of the relative change of the duration."""
        return -float(self.power)

    @cached_property
    def slack(self) -> np.ndarray:
        """Slack of every row."""
        return 1 - SIGNS[:, None] * (self.motion.loads[:, :, self.load] * self.scale[:, None])[:, :, None]

    @cached_property
    def may_bind(self) -> np.ndarray:
        """Which curves a step may take to a row's bound."""
        return ~np.all(self.slack > options.ROWS.far_share, axis=(1, 2, 3))

    def _local(self, curve: int) -> np.ndarray:
        """(S, 3, 4, 3) slopes of the shares."""
        return self.motion.load_slopes(curve)[:, self.load] * self.scale[curve, :, None, None]

    def change(self, step: Step) -> np.ndarray:
        """How a step lessens the slack."""
        change = np.empty((len(step.which), *self.slack.shape[1:]))
        for own, curve in enumerate(step.which.tolist()):
            shares = np.einsum("sida,dsa->si", self._local(curve), step.curves[own, :, :, :3])
            change[own] = SIGNS[:, None] * shares[:, None]
        return change

    def slopes(self, index: Index) -> RowJacobian:
        """Derivatives of some rows in the coefficients."""
        curve, place, sign, axis = index
        axes = np.zeros((len(place), 4, self.motion.curves.shape[3]))
        for each in np.unique(curve).tolist():
            rows = curve == each
            local = self._local(each)[place[rows], axis[rows]]
            axes[rows, :, :3] = SIGNS[sign[rows]][:, None, None] * local
        return RowJacobian(axes, self.rows[curve, :, place])

    def chosen(self, wanted: np.ndarray, slack: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Thinned, with the last place kept: unlike a margin, a load may be the worst at the end."""
        kept = _telling(slack)
        kept[:, -1] = True
        return wanted & kept


@dataclass(frozen=True, eq=False)
class MarginBlock:
    """Margins at the places: rows (G, S, D, Z)."""

    motion: Motion
    rows: np.ndarray  # (G, 4, S, n) of the basis
    slack: np.ndarray  # beyond what is wanted
    name: str = "zone"
    kind: int = ZONE
    tolerance: float = field(default_factory=lambda: options.ROWS.near_angle)
    time: float = 0.0
    linear: bool = False

    @cached_property
    def may_bind(self) -> np.ndarray:
        """Which curves a step may take to a row's bound."""
        return np.any(np.isfinite(self.slack), axis=(1, 2, 3))

    def change(self, step: Step) -> np.ndarray:
        """How a step lessens the slack; zero of rows that stay far."""
        slack = taken(self.slack, step.which)
        reach = self.tolerance + self.motion.reach(step.curves[:, 0], step.which)
        own, *rest = numbers(slack < reach)
        local = self.motion.margin_slopes(step.which[own], *rest)
        change = np.zeros_like(slack)
        change[(own, *rest)] = -np.einsum("ra,ra->r", local, step.curves[own, 0, rest[0]])
        return change

    def slopes(self, index: Index) -> RowJacobian:
        """Derivatives of some rows in the coefficients."""
        local = -self.motion.margin_slopes(*index)
        return RowJacobian(local[:, None], self.rows[index[0], 0, index[1]][:, None])

    def chosen(self, wanted: np.ndarray, slack: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Thinned, and of a constraint only the entry that holds best."""
        return wanted & _telling(slack) & np.isfinite(self.slack[which])


def _telling(slack: np.ndarray) -> np.ndarray:
    """Along the places, the second axis, each fourth one and the local minima of the slack."""
    kept = np.zeros(slack.shape, dtype=bool)
    kept[:, :: options.ROWS.stride] = True
    with np.errstate(invalid="ignore"):
        kept[:, 1:-1] |= (slack[:, 1:-1] <= slack[:, :-2]) & (slack[:, 1:-1] <= slack[:, 2:])
    return kept


def constraint_blocks(stack: Stack, at: Iterates) -> Iterator[ConstraintBlock]:
    """All blocks of a stack of problems, at curves of theirs."""
    kind, duration = stack.members[0], at.duration[:, None]
    systems = stack.systems
    crafts = [system.spacecraft for system in systems]
    if np.any(np.isfinite(at.motion.margins)):
        yield MarginBlock(at.motion, stack.rows, at.motion.margins - stack.wanted[:, None])
    if crafts[0].terminals:
        yield JointRangeBlock(at.coefficients, np.stack([craft.joint_limits for craft in crafts]))
    if kind.limited:
        for each in zip(*(system.joint_limits for system in systems), strict=True):
            quantity, bound = each[0].quantity, np.stack([limit.bound for limit in each])
            differences = stacked(
                [discrete.space.basis.differences[quantity.power] for discrete in stack.members]
            )
            scale = 1 / (bound * duration**quantity.power)
            yield JointDerivativeBlock(at.coefficients, quantity.name, quantity.power, differences, scale)
        first = systems[0]
        for q, (name, power) in enumerate(zip(first.names, first.powers, strict=True)):
            limit = np.stack([system.limits[q] for system in systems])
            yield LoadBlock(name, int(power), at.motion, q, 1 / (limit * duration**power), stack.rows)
    if kind.tube is not None:
        yield TubeBlock(at.coefficients, stack.tube_rows, stack.tube_values, stack.tube_radius)
