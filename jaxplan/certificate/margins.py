"""Constraints on what points, and proved lower bounds of their margins over all time.

The margin of a sight to a cone is the angle by which it is clear, as in equations (11) and (12). It is taken
from the square of the chord between sight and axis,

    c = |p - e|^2 = 2 - 2 p . e = 4 sin^2(angle / 2),

which is linear in p and in e and loses no digit at small angles. A cone of more than a right angle is the
complement of the opposite one.

An inertial axis that moves is taken where it is at each instant. An axis of the body, or one that is itself a
sight, is seen in body axes, where the platform's turn does not count. How far polynomials in time may be off
by the motion of both is in the evidence. The margin of a row of joints is ``f . (yaw, pitch) - d``.

An entry holds where all its rows do, for all that they bind; a constraint where one of its entries does. A
constraint of a single entry must hold for each sight by itself, so each is a clause (see `bounds`); one of
several entries is a single clause. The clauses of a trajectory are tasks on its own intervals only, so what
is proved of it is the same alone and among others.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

from jaxplan.certificate import bounds
from jaxplan.certificate.bounds import LEBESGUE, Evidence, Layout, Minima, Rows
from jaxplan.certificate.form import BODY, INERTIAL, JOINTS, SIGHT
from jaxplan.certificate.motion import DEGREE, Motion, Samples, Views, Way, places
from jaxplan.certificate.series import ROUNDING

if TYPE_CHECKING:
    from jaxplan.model.constraints import Constraints

_MIDDLE = slice(DEGREE // 2, DEGREE // 2 + 1)  # of an interval, among its samples


def tolerance(margin: np.ndarray) -> np.ndarray:
    """How close a bound comes to the least margin met: one in a hundred, at most 1e-4 rad, at least 1e-10."""
    return np.clip(np.abs(margin) / 100, 1e-10, 1e-4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bindings:
    """Pairs of a row and a sight that it binds; they are the kinds of `layout`.

    Attributes:
        row: (pairs,) number of the row, among those of its trajectory.
        sight: (pairs,) number of the sight.
        frame: (pairs,) what the axis belongs to, see `form`.
        partner: (pairs,) the sight that is the axis, where one is.
        entry: (pairs,) the first row of the row's entry.
        axis: (pairs, 3) unit vector, the cone's or its opposite; NaN where it moves; of rows of joints ``f``.
        ways: of the inertial axes that move, by row.
        flip: (pairs,) -1 where the axis is the cone's opposite, else +1.
        angle: (pairs,) rad, at most a right angle: half angle of the cone about that axis; of rows of
            joints ``d``.
        side: (pairs,) +1 to stay outside of that cone, -1 to stay inside; +1 for a row of joints.
        views: what is looked at beside boresights from inertial axes.
        view: (pairs,) number of the pair's scalar product among those of `errors.Errors`.
        layout: how pairs make up constraints; owners are the trajectories on which they must hold.
    """

    row: np.ndarray
    sight: np.ndarray
    frame: np.ndarray
    partner: np.ndarray
    entry: np.ndarray
    axis: np.ndarray
    ways: dict[int, Way]
    flip: np.ndarray
    angle: np.ndarray
    side: np.ndarray
    views: Views
    view: np.ndarray
    layout: Layout

    @classmethod
    def of(cls, cones: "Constraints") -> Self:
        """From constraints of arrays in float64 whose form has been checked."""
        row, sight, layout = _nested(cones)
        frame, partner = cones.frame[row].astype(int), cones.partner[row].astype(int)
        linear = frame == JOINTS
        wide = (cones.half_angle[row] > np.pi / 2) & ~linear
        flip = np.where(wide, -1.0, 1.0)
        direction = cones.axis / np.linalg.norm(cones.axis, axis=-1, keepdims=True)
        within = (frame == BODY) | (frame == SIGHT)
        seen = np.stack([sight, np.where(frame == SIGHT, partner, -1)], axis=1)[within]
        looks, number = np.unique(seen, axis=0, return_inverse=True)
        view = sight.copy()
        view[within] = cones.bound.shape[1] + number.ravel()
        return cls(
            row=row,
            sight=sight,
            frame=frame,
            partner=partner,
            entry=cones.entry[row].astype(int),
            axis=np.where(linear[:, None], cones.axis[row], flip[:, None] * direction[row]),
            ways={
                row: Way.of(path)
                for row, path in enumerate(cones.paths)
                if path is not None and np.any(cones.bound[row])
            },
            flip=flip,
            angle=np.where(wide, np.pi - cones.half_angle[row], cones.half_angle[row]),
            side=np.where(linear, 1.0, flip * cones.side[row]),
            views=Views.of(cones, looks),
            view=view,
            layout=layout,
        )

    @classmethod
    def joined(cls, several: "Sequence[Bindings]") -> "Bindings":
        """Join the pairs of several trajectories of the same views, none with axes that move; or of one."""
        if len(several) == 1:
            return several[0]
        names = ("row", "sight", "frame", "partner", "entry", "axis", "flip", "angle", "side", "view")
        return cls(
            **{name: np.concatenate([getattr(own, name) for own in several]) for name in names},
            layout=Layout.joined([own.layout for own in several]),
            views=several[0].views,
            ways={},
        )

    @cached_property
    def _linear(self) -> np.ndarray:
        """(pairs,) bool, those of rows of joints."""
        return self.frame == JOINTS

    @property
    def narrowest(self) -> float:
        """The least half angle of a cone, at most a right angle, rad."""
        return float(np.min(self.angle[~self._linear], initial=np.pi / 2))

    def axes(self, pair: np.ndarray, centre: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Axes of some pairs at some times, inertial ones and those of the body.

        Args:
            pair: (rows,) int.
            centre: (rows,) s, of the intervals that the times are of: it tells the piece of a path.
            time: (rows, m) s.

        Returns:
            (rows, 3, m), or (rows, 3, 1) where none moves.
        """
        axes = self.axis[pair][..., None]
        if self.ways:
            axes = np.repeat(axes, time.shape[1], axis=2)
        for row, way in self.ways.items():
            rows = np.flatnonzero(self.row[pair] == row)
            seen = way.at(way.holding(centre[rows]), time[rows])
            axes[rows] = self.flip[pair[rows], None, None] * np.moveaxis(seen, 0, 1)
        return axes

    def margin(self, guarded: np.ndarray, pair: np.ndarray) -> np.ndarray:
        """Margins in rad from ``side c``, or those of rows of joints, with which they rise.

        Args:
            guarded: (..., rows).
            pair: (rows,) int.

        Returns:
            (..., rows).
        """
        side, angle = self.side[pair], self.angle[pair]
        margin = side * (2 * np.arcsin(np.sqrt(np.clip(side * guarded, 0, 4)) / 2) - angle)
        return np.where(self._linear[pair], guarded, margin) if np.any(self._linear) else margin

    def _chords(
        self, samples: Samples, pair: np.ndarray, where: np.ndarray, centre: np.ndarray, at: slice
    ) -> np.ndarray:
        """Vectors (rows, 3, m) from the axes of some pairs to their sights; of rows of joints anything.

        Args:
            samples: of the motion.
            pair: (rows,) int.
            where: (rows,) int, interval of each.
            centre: (rows,) s, of these intervals.
            at: which samples of an interval.
        """
        sight, frame = self.sight[pair], self.frame[pair]
        seen = samples.boresights[sight, :, where, at]
        axes = self.axes(pair, centre, samples.time[where, at])
        within = np.flatnonzero(frame != INERTIAL)
        if len(within):
            seen[within] = samples.in_body[sight[within], :, where[within], at]
        of_sights = np.flatnonzero(frame == SIGHT)
        if len(of_sights):
            partner, flip = self.partner[pair[of_sights]], self.flip[pair[of_sights]]
            axes = np.repeat(axes, seen.shape[2] // axes.shape[2], axis=2)
            axes[of_sights] = flip[:, None, None] * samples.in_body[partner, :, where[of_sights], at]
        return seen - axes

    def _beyond(self, samples: Samples, pair: np.ndarray, where: np.ndarray, at: slice) -> np.ndarray:
        """How far terminals are within rows of joints, ``f . (yaw, pitch) - d``: (rows, m) rad."""
        yaw, pitch = np.split(samples.joints[0], 2)
        terminal, (along_yaw, along_pitch, _) = self.sight[pair], self.axis[pair].T[..., None]
        value = along_yaw * yaw[terminal, where, at] + along_pitch * pitch[terminal, where, at]
        return value - self.angle[pair, None]

    def _weighed(self, joints: np.ndarray, pair: np.ndarray, where: np.ndarray) -> np.ndarray:
        """Bounds (rows,) of what ``f . (yaw, pitch)`` changes by from those of the joints, (2T, n)."""
        yaw, pitch = np.split(joints, 2)
        terminal, size = self.sight[pair], np.abs(self.axis[pair])
        return size[:, 0] * yaw[terminal, where] + size[:, 1] * pitch[terminal, where]

    def prove(self, evidence: Evidence) -> Minima:
        """Bounds the least margin of every clause, rad, over all time."""
        minima, on = Minima.of(len(self.layout.quantity)), evidence.on
        if len(self.row) == 0:
            return minima
        number = np.diff(on.begins)[self.layout.owner]
        clause = np.repeat(np.arange(len(number)), number)
        interval = on.begins[self.layout.owner][clause] + places(number)
        # First a cap around where it is at mid-interval, as wide as it may move: that settles nearly all.
        pair, where = self._rows_of(clause, interval)
        lower, met = self.layout.fold(pair, self.margin(self._caps(evidence, pair, where), pair))
        minima.meet(clause[::-1], met[::-1], on.centre[interval[::-1]])  # of equals the first
        settled = lower >= minima.wanted(self.layout, tolerance)[clause]
        np.minimum.at(minima.bound, clause[settled], lower[settled])
        if not np.all(settled):
            rows = self._rows(evidence, clause[~settled], interval[~settled])
            bounds.minimise(rows, self.layout, minima, self.margin, tolerance)
        return minima

    def _rows_of(self, clause: np.ndarray, interval: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs and intervals (rows,) of the rows of some clauses on some intervals, (tasks,) each."""
        opening = np.flatnonzero(self.layout.opens_clause)
        size = np.diff(np.append(opening, len(self.row)))[clause]
        return np.repeat(opening[clause], size) + places(size), np.repeat(interval, size)

    def _caps(self, evidence: Evidence, pair: np.ndarray, where: np.ndarray) -> np.ndarray:
        """The least that ``side c`` may be on intervals, and what it is in their middle: (2, rows)."""
        side, samples, centre = self.side[pair], evidence.samples, evidence.on.centre[where]
        chord = np.linalg.norm(self._chords(samples, pair, where, centre, _MIDDLE)[..., 0], axis=1)
        reach = (evidence.majorants.direction[1] + evidence.rounding.direction)[self.view[pair], where]
        near = np.clip(chord - side * reach, 0, 2)
        found = side * np.stack([near, chord]) ** 2
        linear = np.flatnonzero(self._linear[pair])
        if len(linear):
            pair, where = pair[linear], where[linear]
            middle = self._beyond(samples, pair, where, _MIDDLE)[:, 0]
            reach = self._weighed(evidence.majorants.joints[1], pair, where)
            found[:, linear] = middle - reach - self._noise(evidence, pair, where), middle
        return found

    def _noise(self, evidence: Evidence, pair: np.ndarray, where: np.ndarray) -> np.ndarray:
        """Sizes (rows,) of the rounding errors of `_beyond`."""
        own = ROUNDING * np.abs(self.angle[pair])
        return self._weighed(evidence.rounding.joints[0], pair, where) + own

    def _rows(self, evidence: Evidence, clause: np.ndarray, interval: np.ndarray) -> Rows:
        """The polynomials of ``side c``, or of joints, for some clauses on some intervals, (tasks,) each."""
        pair, where = self._rows_of(clause, interval)
        view, on, every = self.view[pair], evidence.on, slice(None)
        apart = self._chords(evidence.samples, pair, where, on.centre[where], every)
        values = np.einsum("rim,rim->rm", apart, apart)
        # With |p| = 1 an error d of p changes c by 2 |p - e| d at most, but what is left out by 2 d.
        noise = 2 * evidence.rounding.direction[view, where] * np.sqrt(values.max(axis=1))
        left_out = 2 * evidence.left_out.direction[view, where]
        linear = np.flatnonzero(self._linear[pair])
        if len(linear):
            own = pair[linear], where[linear]
            values[linear] = self._beyond(evidence.samples, *own, every)
            noise[linear] = self._noise(evidence, *own)
            left_out[linear] = self._weighed(evidence.left_out.joints[0], *own)
        conversion = ROUNDING * bounds.growth(DEGREE) * np.abs(values).max(axis=1)
        return Rows(
            coefficients=self.side[pair] * bounds.to_rows(values),
            error=left_out + LEBESGUE * noise + conversion,
            kind=pair,
            low=on.low[interval],
            high=on.high[interval],
        )

    def deciding(self, clause: int, time: float, motion: Motion, trajectory: int = 0) -> int:
        """The pair whose margin is the clause's at some time: the best entry's worst one.

        Args:
            clause: its number.
            time: s.
            motion: of the trajectory, maybe among others.
            trajectory: its number there.
        """
        pairs = np.flatnonzero(self.layout.clause == clause)
        if len(pairs) > 1:
            on = motion.between(np.array([time, time]), trajectory)
            instant, where = motion.sample(on, np.zeros(1)), np.zeros(len(pairs), int)
            chord = self._chords(instant, pairs, where, on.centre[where], slice(None))[..., 0]
            value = self.side[pairs] * np.sum(chord**2, axis=1)
            linear = np.flatnonzero(self._linear[pairs])
            if len(linear):
                value[linear] = self._beyond(instant, pairs[linear], where[linear], slice(None))[:, 0]
            margin = self.margin(value, pairs)
            pairs = pairs[margin == self.layout.fold(pairs, margin)]
        return int(pairs[0])

    def faults(
        self,
        minima: Minima,
        motion: Motion,
        sight_names: Sequence[str],
        zone_names: Sequence[str],
        allowance: float,
        trajectory: int = 0,
    ) -> Iterator[str]:
        """A sentence for each clause whose margin is not proved to be at least minus the allowance."""
        for clause in np.flatnonzero(~(minima.bound >= -allowance)).tolist():
            time, seen, bound = minima.time[clause], minima.seen[clause], minima.bound[clause]
            pair = self.deciding(clause, time, motion, trajectory)
            kind, wrong = self._kind(pair)
            sight, place = sight_names[self.sight[pair]], f"the {kind} {zone_names[self.row[pair]]}"
            if seen < -allowance:
                single = len(np.unique(self.entry[self.layout.clause == clause])) == 1
                rest = "" if single else ", the nearest to hold of its group,"
                overlap = f"{sight} is {np.rad2deg(-seen):.3g} deg {wrong} {place}"
                yield f"{overlap}{rest} at t = {time:.6g} s"
            else:
                met = f"{np.rad2deg(seen):.3g} deg was met at t = {time:.6g} s"
                proof = f"is not proved: {met}, the bound is {np.rad2deg(bound):.3g} deg"
                yield f"the margin of {sight} to {place} {proof}"

    def _kind(self, pair: int) -> tuple[str, str]:
        """Name the kind of a pair's row, and the side on which a sight breaks it."""
        if self._linear[pair]:
            return "mask", "inside"
        outside = self.flip[pair] * self.side[pair] > 0
        return ("keep-out zone", "inside") if outside else ("keep-in zone", "outside")


def _nested(cones: "Constraints") -> tuple[np.ndarray, np.ndarray, Layout]:
    """Rows and sights (pairs,) of all pairs that are bound, and how they nest, of one owner."""
    row, sight = np.nonzero(cones.bound)
    entry, group = cones.entry[row].astype(int), cones.group[row].astype(int)
    leading = cones.group[np.unique(entry)].astype(int)  # a constraint for each of its entries
    shared = np.bincount(leading, minlength=len(cones.group))[group] > 1
    part = np.where(shared, entry, sight)  # of a constraint: what must hold by itself
    order = np.lexsort((sight, row, part, group))
    row, sight, part, group, shared = (each[order] for each in (row, sight, part, group, shared))
    new_group = np.append(True, group[1:] != group[:-1])[: len(row)]
    new_part = new_group | np.append(True, part[1:] != part[:-1])[: len(row)]
    opens_clause = np.where(shared, new_group, new_part)
    alone = np.zeros(np.count_nonzero(opens_clause), dtype=int)
    return row, sight, Layout(opens_entry=new_part, opens_clause=opens_clause, quantity=alone, owner=alone)
