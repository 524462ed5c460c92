"""Limits, zones and nodes as families of linear rows near a curve.

A row says ``slopes . dc + time * dT / T <= room`` of a change ``dc`` of the coefficients and ``dT`` of the
duration. A family knows the room of all its rows and how a step changes it, and writes out only the rows that
a program asks for. Joints are held by the coefficients of their derivatives, so at every instant; the
platform's loads and the margins at places close enough together, where they are linearised.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from jaxplan.trajectory.global_spline.bases import Basis
from jaxplan.trajectory.global_spline.motion import Motion, Problem

LIMIT, ZONE, TUBE = range(3)  # kinds of rows

# Rows with less room than this are in a program from the start: shares of a limit or of a tube, and angles.
_NEAR_SHARE, _FAR_SHARE = 0.15, 0.5
_NEAR_ANGLE = np.deg2rad(1.0)
_KNOWN_ANGLE = np.deg2rad(20.0)  # margins beyond are not looked at: no step takes a boresight that far
_STRIDE = 4  # of places next to each other one in four is held, and those that are extreme

Index = tuple[np.ndarray, ...]
_SIGNS = np.array([1.0, -1.0])


class Step(NamedTuple):
    """A change of a curve.

    Attributes:
        coefficients: (n, A).
        curves: (4, S, A) what that makes of values and derivatives at the places.
        stretch: relative change of the duration.
    """

    coefficients: np.ndarray
    curves: np.ndarray
    stretch: float


class Family(Protocol):
    """Rows of one sort.

    Attributes:
        name: unique among the families of a fit.
        kind: `LIMIT`, `ZONE` or `TUBE`.
        room: of every row, in any shape.
        near: rows with less room are near.
        time: of the rows.
        linear: whether the rows are true of all steps, not of small ones alone.
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

    def change(self, step: Step) -> np.ndarray:
        """By how much a step lessens the room, without its stretch; like `room`."""
        ...

    def slopes(self, index: Index) -> np.ndarray:
        """Slopes (R, A, n) of some rows, in the coefficients."""
        ...

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """Of the rows that are wanted (like `room`), those that do, given what room they have."""
        ...


@dataclass(frozen=True, eq=False)
class Joints:
    """Rates or accelerations of joints, by the coefficients of the derivative: rows (2, n - d, joints)."""

    name: str
    power: int
    basis: Basis
    coefficients: np.ndarray
    scale: np.ndarray  # (joints,) 1 / (limit * duration^power)
    kind: int = LIMIT
    near: float = 2 * _NEAR_SHARE
    linear: bool = True

    @property
    def time(self) -> float:
        """Of the rows."""
        return -float(self.power)

    @property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return 1 - self._shares(self.coefficients)

    def _shares(self, coefficients: np.ndarray) -> np.ndarray:
        shares = self.basis.differences[self.power] @ coefficients[:, 3:] * self.scale
        return np.multiply.outer(_SIGNS, shares)

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return self._shares(step.coefficients)

    def slopes(self, index: Index) -> np.ndarray:
        """See `Family`."""
        sign, row, joint = index
        slopes = np.zeros((len(row), *self.coefficients.shape[::-1]))
        factor = _SIGNS[sign] * self.scale[joint]
        slopes[np.arange(len(row)), 3 + joint] = factor[:, None] * self.basis.differences[self.power][row]
        return slopes

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """See `Family`; all of them."""
        return wanted


@dataclass(frozen=True, eq=False)
class Ranges:
    """Angles of the joints by the coefficients: rows (2, n, joints)."""

    coefficients: np.ndarray
    limits: np.ndarray
    name: str = "range"
    kind: int = LIMIT
    near: float = _NEAR_ANGLE
    time: float = 0.0
    linear: bool = True

    @property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return self.limits - np.multiply.outer(_SIGNS, self.coefficients[:, 3:])

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return np.multiply.outer(_SIGNS, step.coefficients[:, 3:])

    def slopes(self, index: Index) -> np.ndarray:
        """See `Family`."""
        sign, row, joint = index
        slopes = np.zeros((len(row), *self.coefficients.shape[::-1]))
        slopes[np.arange(len(row)), 3 + joint, row] = _SIGNS[sign]
        return slopes

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """See `Family`; all of them."""
        return wanted


@dataclass(frozen=True, eq=False)
class Loads:
    """One of the platform's loads at the places: rows (S, 2, 3)."""

    name: str
    power: int
    motion: Motion
    load: int  # which
    scale: np.ndarray  # (3,) 1 / (limit * duration^power)
    rows: np.ndarray  # (4, S, n) of the basis
    kind: int = LIMIT
    near: float = _NEAR_SHARE
    linear: bool = False

    @property
    def time(self) -> float:
        """Of the rows."""
        return -float(self.power)

    @property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return 1 - _SIGNS[:, None] * (self.motion.loads[:, self.load] * self.scale)[:, None]

    @cached_property
    def _local(self) -> np.ndarray:
        """(S, 3, 4, 3) slopes of the shares."""
        return self.motion.load_slopes[:, self.load] * self.scale[:, None, None]

    def change(self, step: Step) -> np.ndarray:
        """See `Family`; where all is far from its limit, so that no step reaches it, none is looked for."""
        if np.all(self.room > _FAR_SHARE):
            return np.zeros_like(self.room)
        shares = np.einsum("sida,dsa->si", self._local, step.curves[:, :, :3])
        return _SIGNS[:, None] * shares[:, None]

    def slopes(self, index: Index) -> np.ndarray:
        """See `Family`."""
        place, sign, axis = index
        local = np.zeros((0, 4, 3))
        if len(place):
            local = _SIGNS[sign][:, None, None] * self._local[place, axis]
        slopes = np.zeros((len(place), self.motion.curves.shape[2], self.rows.shape[2]))
        slopes[:, :3] = np.einsum("rda,drn->ran", local, self.rows[:, place])
        return slopes

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """See `Family`; thinned."""
        return wanted & _telling(room)


@dataclass(frozen=True, eq=False)
class Zones:
    """Margins at the places: rows (S, D, Z)."""

    motion: Motion
    rows: np.ndarray
    room: np.ndarray  # beyond what is wanted
    name: str = "zone"
    kind: int = ZONE
    near: float = _NEAR_ANGLE
    time: float = 0.0
    linear: bool = False

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        index = np.nonzero(self.room < _KNOWN_ANGLE)
        change = np.zeros_like(self.room)
        local = self.motion.margin_slopes(*index)
        change[index] = -np.einsum("ra,ra->r", local, step.curves[0, index[0]])
        return change

    def slopes(self, index: Index) -> np.ndarray:
        """See `Family`."""
        local = -self.motion.margin_slopes(*index)
        return local[:, :, None] * self.rows[0, index[0]][:, None, :]

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """See `Family`; thinned, and of a group only the entry that holds best."""
        return wanted & _telling(room) & np.isfinite(self.room)


@dataclass(frozen=True, eq=False)
class Tube:
    """Nodes that a curve must pass within a tube.

    Attributes:
        rows: (m, n) of the basis at the nodes.
        values: (m, A) rad.
        radius: (A,) rad, for each axis.
    """

    rows: np.ndarray
    values: np.ndarray
    radius: np.ndarray

    def off(self, coefficients: np.ndarray) -> np.ndarray:
        """How far beyond the tube a curve passes the nodes, (m, A) rad; negative within."""
        return np.abs(self.rows @ coefficients - self.values) - self.radius


@dataclass(frozen=True, eq=False)
class Nodes:
    """A tube about nodes: rows (2, m, A), as shares of its radius."""

    tube: Tube
    coefficients: np.ndarray
    name: str = "tube"
    kind: int = TUBE
    near: float = 2 * _NEAR_SHARE
    time: float = 0.0
    linear: bool = True

    @property
    def room(self) -> np.ndarray:
        """Of the rows."""
        off = self.tube.rows @ self.coefficients - self.tube.values
        return 1 - np.multiply.outer(_SIGNS, off / self.tube.radius)

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        return np.multiply.outer(_SIGNS, self.tube.rows @ step.coefficients / self.tube.radius)

    def slopes(self, index: Index) -> np.ndarray:
        """See `Family`."""
        sign, node, axis = index
        slopes = np.zeros((len(node), *self.coefficients.shape[::-1]))
        factor = _SIGNS[sign] / self.tube.radius[axis]
        slopes[np.arange(len(node)), axis] = factor[:, None] * self.tube.rows[node]
        return slopes

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """See `Family`; all of them."""
        return wanted


def families(
    problem: Problem,
    basis: Basis,
    rows: np.ndarray,
    motion: Motion,
    coefficients: np.ndarray,
    duration: float,
    *,
    wanted: np.ndarray,
    tube: Tube | None,
    limited: bool,
) -> Iterator[Family]:
    """All rows at a curve.

    Args:
        problem: limits and zones.
        basis: of the curve.
        rows: (4, S, n) of the basis at the places.
        motion: of the curve at the places.
        coefficients: (n, A) of the curve.
        duration: s.
        wanted: (D, Z) rad, margins to keep.
        tube: about the nodes, or None.
        limited: whether limits of rates and loads are kept, or time will be stretched to them.
    """
    craft = problem.spacecraft
    if np.any(np.isfinite(motion.margins)):
        yield Zones(motion, rows, motion.margins - wanted)
    if craft.terminals:
        yield Ranges(coefficients, craft.joint_limits)
    if limited:
        if craft.terminals:
            of_joints = (craft.joint_rate_limits, craft.joint_acceleration_limits)
            for power, limit in enumerate(of_joints, start=1):
                yield Joints(f"joint {power}", power, basis, coefficients, 1 / (limit * duration**power))
        for q, (name, power) in enumerate(zip(problem.names, problem.powers, strict=True)):
            scale = 1 / (problem.limits[q] * duration**power)
            yield Loads(name, int(power), motion, q, scale, rows)
    if tube is not None:
        yield Nodes(tube, coefficients)


def _telling(room: np.ndarray) -> np.ndarray:
    """Along the first axis, each fourth place and the local minima of the room."""
    kept = np.zeros(room.shape, dtype=bool)
    kept[::_STRIDE] = True
    with np.errstate(invalid="ignore"):
        kept[1:-1] |= (room[1:-1] <= room[:-2]) & (room[1:-1] <= room[2:])
    return kept
