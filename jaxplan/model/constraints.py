"""Pointing constraints as arrays: directions in body axes, cones about axes, and how they combine.

Everything that points is a direction. A *sight* is a direction that a constraint binds: the boresight of a
device, an axis of the body, or another vector of a device's moving part. A *row* is a cone about an axis,
with a set of sights that must stay out of it (side +1) or in it (side -1). The axis is inertial, still or
moving, or an axis of the body, or itself a sight, such as the beam of another terminal. The margin of a sight
to a row is

    side * (angle(sight, axis) - half angle),                                   equations (11) and (12)

in rad; the row is kept where it is zero or more. A row of joints asks instead for ``f . (yaw, pitch) >= d``
of a terminal, with ``f`` of length one; its margin is ``f . (yaw, pitch) - d``. Rows form *entries*, and
entries form *constraints*. The margin of a row is that of its worst sight, the margin of an entry that of its
worst row, the margin of a constraint that of its best entry: it holds while at least one of its entries does,
and which one that is may change. A margin that is not a number counts as broken, since ``jnp.min`` and
``jnp.max`` may drop a NaN on the CPU.

Rows are padded to a few fixed numbers by rows that bind nothing (margin +inf), so that scenes of different
size share compiled kernels. Everything computes with numpy or JAX, as its arguments do. Array shapes: S
sights, in the order devices (terminals, drives, instruments), axes of the body, vectors of moving parts; Z
rows, padding included; 2n + d joints of n terminals and d drives.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Self

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, array_module, arrays, max_along, min_along, separation
from jaxplan.model.directions import DirectionPath, Sights
from jaxplan.model.gimbals import Gimbals
from jaxplan.runtime.batching import padded_count
from jaxplan.runtime.compute_once import made_once
from jaxplan.runtime.display import shown

INERTIAL, BODY, SIGHT, JOINTS = range(4)
"""What the axis of a row belongs to: the inertial frame, the body, a sight, or none since it is of joints."""


@shown("side", "half_angle deg", "bound", "entry", "group", "axis", "frame", "paths")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Constraints:
    """All pointing constraints of a scene, row by row, with Z rows, padding included (see `padded_count`).

    Attributes:
        axis: (Z, 3) unit vectors, in inertial axes or in body axes according to `frame`; NaN where the axis
            moves; for a row of joints the two components of ``f`` and a zero; (0, 0, 1) where a sight is the
            axis.
        frame: (Z,) int, `INERTIAL`, `BODY`, `SIGHT` or `JOINTS`.
        partner: (Z,) int, number of the sight that is the axis; zero where none is.
        half_angle: (Z,) rad; for a row of joints ``d``.
        side: (Z,) +1 to stay out, -1 to stay in.
        bound: (Z, S) bool, which sights each row binds; none for padding.
        entry: (Z,) int, number of the first row of the entry to which each row belongs.
        group: (Z,) int, number of the first row of the constraint to which each row belongs.
        zone: (Z,) int, number of the zone from which each row was made; -1 for padding.
        body: (b, 3) unit vectors, axes of the body that are bound beside the devices.
        carrier: (v,) int, numbers of the gimbals whose moving parts carry the v further vectors.
        carried: (v, 3) these vectors along their gimbal's boresight, left and up, as in `Sights`.
        paths: for each row the path of its axis, None if it does not move; empty if none does.
        inner: whether any row is not inertial.
        nested: whether any entry has several rows.
    """

    axis: np.ndarray
    frame: np.ndarray
    partner: np.ndarray
    half_angle: np.ndarray
    side: np.ndarray
    bound: np.ndarray
    entry: np.ndarray
    group: np.ndarray
    zone: np.ndarray
    body: np.ndarray
    carrier: np.ndarray
    carried: np.ndarray
    paths: tuple[DirectionPath | None, ...] = ()
    inner: bool = field(default=False, metadata={"static": True})
    nested: bool = field(default=False, metadata={"static": True})

    def sights(self, gimbals: Gimbals, instruments: ArrayLike) -> Sights:
        """Return the sights that the rows bind.

        Args:
            gimbals: the spacecraft's devices with joints.
            instruments: (i, 3) boresights of its instruments, body axes.
        """
        xp, fixed, body = arrays(instruments, self.body)
        still = xp.concatenate([fixed, body]) if body.shape[0] else fixed
        return Sights(gimbals=gimbals, fixed=still, carrier=self.carrier, carried=self.carried)

    def spread(self, trailing: int) -> Self:
        """Return the constraints with `frame`, `side` and `half_angle` of shape (Z, 1, ...), `trailing` ones.

        So they broadcast against arrays whose first axis is that of the rows.
        """
        shape = (-1, *(1,) * trailing)
        parts = {name: getattr(self, name).reshape(shape) for name in ("frame", "side", "half_angle")}
        return replace(self, **parts)

    def some(self, which: ArrayLike) -> Self:
        """Return the rows with the numbers `which` (r,) int, to be used one by one.

        `entry` and `group` of the result mean nothing, and `paths` is empty.
        """
        names = ("axis", "frame", "partner", "half_angle", "side", "bound", "entry", "group", "zone")
        xp = array_module(which)
        return replace(self, **{name: xp.asarray(getattr(self, name))[which] for name in names}, paths=())

    def axes(self, times: ArrayLike) -> AnyArray:
        """Return the axes (..., Z, 3) of all Z rows at times (...), s, each in the frame of its row.

        The frame is inertial or that of the body. Axes of rows that do not move are repeated for every time.
        """
        xp, t, still = arrays(times, self.axis)
        return self._evaluate_paths(xp.broadcast_to(still, (*t.shape, *still.shape)), lambda path: path.at(t))

    def axis_rates(self, time: ArrayLike) -> AnyArray:
        """Return the derivatives (Z, 3) 1/s of the axes with respect to time, at a time, s.

        They are zero for axes that stand still.
        """
        return self._evaluate_paths(np.zeros(self.axis.shape), lambda path: path.rate(time))

    def _evaluate_paths(self, still: AnyArray, of_path: Callable[[DirectionPath], AnyArray]) -> AnyArray:
        """Replace those of vectors (..., Z, 3) whose rows have a moving axis.

        Args:
            still: the vectors.
            of_path: gives the vector (..., 3) for a path.
        """
        if not self.paths:
            return still
        columns = [still[..., i, :] if path is None else of_path(path) for i, path in enumerate(self.paths)]
        return array_module(*columns).stack(columns, axis=-2)

    def at(self, time: ArrayLike) -> Self:
        """Return the constraints as they are at a time, s; no axis of the result moves."""
        return replace(self, axis=self.axes(time), paths=()) if self.paths else self

    def part(self, which: np.ndarray) -> Self:
        """Return those rows that `which` (Z,) bool selects, with padding of their own.

        All rows of a constraint or none must be selected. In the result the rows of an entry lie side by
        side, and so do those of a constraint, as `worst_constraint` requires.
        """
        rows = np.flatnonzero(which)
        rows = rows[np.lexsort((self.entry[rows], self.group[rows]))]
        if np.array_equal(rows, np.flatnonzero(self.zone >= 0)):  # all of them, in order
            return self
        place = np.zeros(len(self.zone), int)
        place[rows] = np.arange(len(rows))
        padding = np.arange(len(rows), padded_count(len(rows)))

        def padded(values: np.ndarray, filling: Any) -> np.ndarray:
            own = np.asarray(values)[rows]
            return np.concatenate([own, np.broadcast_to(filling, (len(padding), *own.shape[1:]))])

        paths = [self.paths[row] for row in rows] + [None] * len(padding) if self.paths else []
        return replace(
            self,
            axis=padded(self.axis, [0.0, 0.0, 1.0]),
            frame=padded(self.frame, INERTIAL),
            partner=padded(self.partner, 0),
            half_angle=padded(self.half_angle, 0.5),
            side=padded(self.side, 1.0),
            bound=padded(self.bound, False),
            entry=np.concatenate([place[self.entry[rows]], padding]),
            group=np.concatenate([place[self.group[rows]], padding]),
            zone=padded(self.zone, -1),
            paths=tuple(paths) if any(path is not None for path in paths) else (),
            inner=bool(np.any(self.frame[rows] != INERTIAL)),
            nested=len(set(self.entry[rows])) < len(rows),
        )

    @property
    @made_once
    def single(self) -> np.ndarray:
        """(Z,) bool, whether each row's constraint has one entry only, so that the row must always hold."""
        entries = np.bincount(self.group[np.unique(self.entry)], minlength=len(self.group))
        single: np.ndarray = entries[self.group] == 1
        return single


def axes_in_body(rows: Constraints, inertial: ArrayLike, sights: ArrayLike) -> AnyArray:
    """Return the axes of all rows in body axes.

    Args:
        rows: the constraints.
        inertial: (..., Z, 3) axes from `Constraints.axes`, all of them multiplied by the rotation from
            inertial to body axes, whatever their frame.
        sights: (..., S, 3) in body axes, from `Sights.in_body`.

    Returns:
        (..., Z, 3) unit vectors in body axes; meaningless for rows of joints.
    """
    if not rows.inner:
        return inertial
    xp, turned, seen, axis = arrays(inertial, sights, rows.axis)
    frame = rows.frame[:, None]
    own = xp.where(frame == SIGHT, seen[..., rows.partner, :], axis)
    return xp.where(frame == INERTIAL, turned, own)


def pair_margins(
    rows: Constraints, sights: ArrayLike, axes: ArrayLike, values: ArrayLike | None = None
) -> AnyArray:
    """Return the margin of every sight to every row.

    Args:
        rows: the constraints.
        sights: (..., S, 3) unit vectors.
        axes: (..., Z, 3) unit vectors in the same frame.
        values: (..., S, Z) rad, from `joint_values`; without them the margins of rows of joints mean nothing.

    Returns:
        (..., Z, S) rad, positive where the row is kept; +inf where a row does not bind the sight, -inf where
        a margin is not a number.
    """
    xp, seen, along, side, half_angle = arrays(sights, axes, rows.side, rows.half_angle)
    apart = separation(seen[..., None, :, :], along[..., :, None, :])
    found = side[:, None] * (apart - half_angle[:, None])
    if rows.inner and values is not None:
        beyond = xp.swapaxes(values, -1, -2) - half_angle[:, None]
        found = xp.where((rows.frame == JOINTS)[:, None], beyond, found)
    return xp.where(rows.bound, xp.where(xp.isnan(found), -xp.inf, found), xp.inf)


def state_margins(
    rows: Constraints, sights: Sights, attitude: ArrayLike, joints: ArrayLike, times: np.ndarray | None = None
) -> AnyArray:
    """Return the margin of every sight to every row in given states.

    Args:
        rows: the constraints.
        sights: the sights that they bind.
        attitude: (..., 3, 3) body to inertial.
        joints: (..., 2n + d) rad.
        times: (...) s, at which moving axes are taken; None if no axis moves.

    Returns:
        (..., Z, S) rad, see `pair_margins`.
    """
    _, turn, axis = arrays(attitude, rows.axis if times is None else rows.axes(times))
    seen = sights.in_body(joints)
    values = joint_values(rows, sights.gimbals, joints) if rows.inner else None
    return pair_margins(rows, seen, axes_in_body(rows, axis @ turn, seen), values)


def joint_values(rows: Constraints, gimbals: Gimbals, joints: ArrayLike) -> AnyArray:
    """Return the left sides ``f . (yaw, pitch)`` of the rows of joints, for every sight.

    Args:
        rows: the constraints.
        gimbals: the devices with joints.
        joints: (..., 2n + d) rad.

    Returns:
        (..., S, Z) rad, for sights that are boresights of gimbals; the pitch of a drive counts as zero. Zero
        for other sights, and for rows that are not of joints.
    """
    xp, q, normal = arrays(joints, rows.axis)
    # Other rows get zero: an axis that moves is NaN, which would spread through derivatives of `where`.
    normal = xp.where((rows.frame == JOINTS)[:, None], normal, 0)
    yaw, pitch = gimbals.parts(q)
    value = yaw[..., None] * normal[:, 0] + pitch[..., None] * normal[:, 1]
    rest = xp.zeros((*value.shape[:-2], rows.bound.shape[1] - gimbals.count, value.shape[-1]), value.dtype)
    return xp.concatenate([value, rest], axis=-2)


def best_entries(rows: Constraints, margin: ArrayLike) -> AnyArray:
    """Return the margin of every constraint: that of its best entry, whose margin is that of its worst row.

    Args:
        rows: the constraints.
        margin: (..., Z) rad for every row, or anything else that is larger the better a row holds.

    Returns:
        (..., Z): each constraint's margin stands at its first row; +inf at all other rows, and at padding.
    """
    xp, given = arrays(margin)
    _, best = _entry_and_constraint_margins(rows, given)
    return xp.where(rows.group == np.arange(given.shape[-1]), best, xp.inf)


def chosen_entries(rows: Constraints, margin: ArrayLike) -> AnyArray:
    """Return for every row the entry by which its constraint holds best; of equally good ones the first.

    Args:
        rows: the constraints.
        margin: (..., Z) rad of every row.

    Returns:
        (..., Z) int, numbers of entries as in `Constraints.entry`.
    """
    xp, given = arrays(margin)
    of_entry, best = _entry_and_constraint_margins(rows, given)
    as_good = _equal_pairs(rows.group) & (of_entry[..., None, :] == best[..., :, None])
    count = rows.entry.shape[0]
    return xp.min(xp.where(as_good, rows.entry, count), axis=-1, initial=count)


def _entry_and_constraint_margins(rows: Constraints, margin: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return for every row the margin of its entry and that of its constraint, (..., Z) each.

    Everything that tells which entry or constraint holds uses this function. `margin` (..., Z) are those of
    the rows.
    """
    xp = array_module(margin)
    of_entry = margin
    if rows.nested:
        of_entry = min_along(xp.where(_equal_pairs(rows.entry), margin[..., None, :], xp.inf), -1)
    best = max_along(xp.where(_equal_pairs(rows.group), of_entry[..., None, :], -xp.inf), -1)
    return of_entry, best


def _equal_pairs(number: AnyArray) -> AnyArray:
    """(Z, Z) bool, which pairs of rows have equal numbers, for numbers (Z,)."""
    return number[:, None] == number[None, :]


def worst_constraint(rows: Constraints, margin: ArrayLike) -> AnyArray:
    """Return the margin of the worst constraint, in one pass over the rows.

    XLA fuses it with the operations that make the margins.

    Args:
        rows: the constraints; rows of an entry lie side by side, and so do those of a constraint.
        margin: (..., Z) rad, or anything else that is larger the better a row holds.

    Returns:
        (...); +inf where there are no rows.
    """
    xp, given = arrays(margin)
    count = given.shape[-1]
    worst = xp.full(given.shape[:-1], xp.inf)
    of_entry = of_constraint = worst
    for row in range(count):
        own = given[..., row]
        last = row == count - 1
        of_entry = xp.where(rows.entry[row] == row, own, xp.minimum(of_entry, own))
        before = xp.where(rows.group[row] == row, -xp.inf, of_constraint)
        entry_ends = last or rows.entry[row + 1] == row + 1
        of_constraint = xp.where(entry_ends, xp.maximum(before, of_entry), before)
        constraint_ends = last or rows.group[row + 1] == row + 1
        worst = xp.where(constraint_ends, xp.minimum(worst, of_constraint), worst)
    return worst


def counted(rows: Constraints, margin: np.ndarray) -> np.ndarray:
    """Tell for every row whether it belongs to the entry by which its constraint holds best, (..., Z) bool.

    Args:
        rows: the constraints.
        margin: (..., Z) rad of every row.
    """
    if np.all(rows.single):
        return np.ones(margin.shape, dtype=bool)
    return np.asarray(chosen_entries(rows, margin) == rows.entry)


def constraint_margins(rows: Constraints, margin: ArrayLike) -> AnyArray:
    """Return the margin of every constraint, (..., Z) as from `best_entries`.

    Args:
        rows: the constraints.
        margin: (..., Z, S) rad, margins of every sight to every row.
    """
    _, given = arrays(margin)
    return best_entries(rows, min_along(given, -1))
