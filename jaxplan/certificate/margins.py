"""Pointing constraints, and proved lower bounds of their margins over all time.

The margin of a sight to a cone is the angle by which it is clear, as in equations (11) and (12). It is taken
from the square of the chord between sight and axis,

    c = |p - e|^2 = 2 - 2 p . e = 4 sin^2(angle / 2),

which is linear in p and in e and loses no digit at small angles. A cone of more than a right angle is the
complement of the opposite one.

An inertial axis that moves is taken where it is at each instant. An axis of the body, or one that is itself a
sight, is taken in body axes, where the platform's turn does not count. The errors of polynomials in time that
follow from the motion of both are in the evidence. The margin of a row of joints is ``f . (yaw, pitch) - d``.

An entry holds where all its rows do, for all that they bind; a constraint where one of its entries does. A
constraint of a single entry must hold for each sight by itself, so each is a clause (see `bounds`); one of
several entries is a single clause. The clauses of a trajectory are tasks on its own intervals only, so what
is proved of it is the same alone and among others.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Self

import numpy as np

from jaxplan.certificate import bounds
from jaxplan.certificate.bounds import LEBESGUE, Evidence, Layout, Minima, Rows
from jaxplan.certificate.claims import Claim
from jaxplan.certificate.motion import DEGREE, Intervals, Motion, Samples, Views, Way, places
from jaxplan.certificate.series import ROUNDING
from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT, Constraints

_SHARED = ("views", "ways", "terminals", "layout")  # attributes of `Bindings` that are no arrays
_ALL = slice(None)
_MIDDLE = slice(DEGREE // 2, DEGREE // 2 + 1)  # of an interval, among its samples


def tolerance(margin: np.ndarray) -> np.ndarray:
    """How close a bound comes to the least margin met: one in a hundred, at most 1e-4 rad, at least 1e-10."""
    return np.clip(np.abs(margin) / 100, 1e-10, 1e-4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bindings:
    """All pairs of a row and a sight that it binds; they are the kinds of `layout`.

    Attributes:
        row: (pairs,) number of the row, among those of its trajectory.
        sight: (pairs,) number of the sight.
        frame: (pairs,) what the axis belongs to, as in `jaxplan.model.constraints`.
        partner: (pairs,) the sight that is the axis, where one is.
        axis: (pairs, 3) unit vector, the cone's or its opposite; NaN where it moves; of rows of joints ``f``.
        flip: (pairs,) -1 where the axis is the cone's opposite, else +1.
        angle: (pairs,) rad, at most a right angle: half angle of the cone about that axis; of rows of
            joints ``d``; either with what errors take of the margin (`tube`).
        side: (pairs,) +1 to stay outside of that cone, -1 to stay inside; +1 for a row of joints.
        view: (pairs,) number of the pair's scalar product among those of `bounds.Errors`.
        views: directions that are sampled beside the devices' boresights.
        ways: the inertial axes that move, by row.
        terminals: number of terminals, T.
        layout: how pairs make up constraints; owners are the trajectories on which they must hold.
    """

    row: np.ndarray
    sight: np.ndarray
    frame: np.ndarray
    partner: np.ndarray
    axis: np.ndarray
    flip: np.ndarray
    angle: np.ndarray
    side: np.ndarray
    view: np.ndarray
    views: Views
    ways: dict[int, Way]
    terminals: int
    layout: Layout

    @classmethod
    def of(cls, cones: Constraints, terminals: int, lost: np.ndarray | None = None) -> Self:
        """The pairs of constraints in float64 whose form has been checked.

        Args:
            cones: the constraints.
            terminals: number of them.
            lost: (Z, S) rad, what the margin of each pair loses to errors; None for nothing.
        """
        row, sight, layout = _nested(cones)
        frame, partner = cones.frame[row].astype(int), cones.partner[row].astype(int)
        axis, linear = cones.axis[row], frame == JOINTS
        half_angle = cones.half_angle[row]
        if lost is not None:
            half_angle = half_angle + np.where(linear, 1.0, cones.side[row]) * lost[row, sight]
        wide = (half_angle > np.pi / 2) & ~linear
        flip = np.where(wide, -1.0, 1.0)
        length = np.where(linear, 1.0, np.linalg.norm(axis, axis=-1))
        inner = np.flatnonzero((frame == BODY) | (frame == SIGHT))
        seen_from = np.where(frame == SIGHT, partner, -1)
        looks = list(zip(sight[inner].tolist(), seen_from[inner].tolist(), strict=True))
        number = {look: number for number, look in enumerate(sorted(set(looks)), cones.bound.shape[1])}
        view = sight.copy()
        view[inner] = [number[look] for look in looks]
        paths = enumerate(cones.paths)
        return cls(
            row=row,
            sight=sight,
            frame=frame,
            partner=partner,
            axis=flip[:, None] * axis / length[:, None],
            flip=flip,
            angle=np.where(wide, np.pi - half_angle, half_angle),
            side=np.where(linear, 1.0, flip * cones.side[row]),
            view=view,
            views=Views.of(cones, np.array(list(number), int).reshape(-1, 2)),
            ways={row: Way.of(path) for row, path in paths if path is not None and cones.bound[row].any()},
            terminals=terminals,
            layout=layout,
        )

    @classmethod
    def joined(cls, several: Sequence[Self]) -> Self:
        """The pairs of several trajectories of the same views without moving axes, or of a single one."""
        if len(several) == 1:
            return several[0]
        arrays = [field.name for field in fields(cls) if field.name not in _SHARED]
        return cls(
            **{name: np.concatenate([getattr(own, name) for own in several]) for name in arrays},
            layout=Layout.joined([own.layout for own in several]),
            views=several[0].views,
            ways={},
            terminals=several[0].terminals,
        )

    @property
    def narrowest(self) -> float:
        """The least half angle of a cone, at most a right angle, rad."""
        return float(np.min(self.angle[self.frame != JOINTS], initial=np.pi / 2))

    @cached_property
    def has_joints(self) -> bool:
        """Whether there are rows of joints, whose margins are angles of joints."""
        return bool((self.frame == JOINTS).any())

    def margin(self, value: np.ndarray, pair: np.ndarray) -> np.ndarray:
        """Margins in rad from values of `_values`, with which they rise.

        Args:
            value: (..., rows).
            pair: (rows,) int, number of each row's pair.

        Returns:
            (..., rows).
        """
        side, angle = self.side[pair], self.angle[pair]
        margin = side * (2 * np.arcsin(np.sqrt(np.clip(side * value, 0, 4)) / 2) - angle)
        return np.where(self.frame[pair] == JOINTS, value, margin) if self.has_joints else margin

    def _values(
        self, samples: Samples, on: Intervals, pair: np.ndarray, where: np.ndarray, at: slice = _ALL
    ) -> np.ndarray:
        """Samples (rows, m) of ``side c`` of some pairs, and of ``f . (yaw, pitch) - d`` of rows of joints.

        Args:
            samples: of the motion.
            on: the intervals that were sampled.
            pair: (rows,) int, number of each row's pair.
            where: (rows,) int, number of each row's interval.
            at: which samples of an interval, m of them.
        """
        sight, frame, flip = self.sight[pair], self.frame[pair], self.flip[pair, None, None]

        def apart_from(axes: np.ndarray, seen: np.ndarray, of: np.ndarray | slice = _ALL) -> np.ndarray:
            """Vectors (rows, 3, m) from axes to the sights, inertial or in body axes."""
            difference: np.ndarray = seen[sight[of], :, where[of], at] - axes
            return difference

        apart = apart_from(self.axis[pair, :, None], samples.boresights)
        inner, of_sights = np.flatnonzero(frame != INERTIAL), np.flatnonzero(frame == SIGHT)
        if len(inner):
            apart[inner] = apart_from(self.axis[pair[inner], :, None], samples.in_body, inner)
        if len(of_sights):
            beams = samples.in_body[self.partner[pair[of_sights]], :, where[of_sights], at]
            apart[of_sights] = apart_from(flip[of_sights] * beams, samples.in_body, of_sights)
        for row, way in self.ways.items():
            rows = np.flatnonzero(self.row[pair] == row)
            axes = way.at(way.holding(on.centre[where[rows]]), samples.time[where[rows], at])
            apart[rows] = apart_from(flip[rows] * np.moveaxis(axes, 0, 1), samples.boresights, rows)
        values = self.side[pair, None] * (apart * apart).sum(axis=1)
        linear = self._linear(pair)
        if len(linear):
            pair, joints = pair[linear], samples.joints[0][..., at]
            values[linear] = (
                self._weighed(self.axis[pair], joints, pair, where[linear]) - self.angle[pair, None]
            )
        return values

    def _linear(self, pair: np.ndarray) -> np.ndarray:
        """Indices of those of some pairs (rows,) that are of rows of joints."""
        return np.flatnonzero(self.frame[pair] == JOINTS)

    def _weighed(
        self, weight: np.ndarray, joints: np.ndarray, pair: np.ndarray, where: np.ndarray
    ) -> np.ndarray:
        """Weighted sums (rows, ...) of yaw and pitch of pairs on intervals `where`, both (rows,) int.

        Weights are (rows, 3), of which the last counts for nothing, joints (J, n, ...).
        """
        # rows of joints are of terminals, whose yaws come first and whose pitches follow
        yaw = joints[self.sight[pair], where].T
        pitch = joints[self.sight[pair] + self.terminals, where].T
        total: np.ndarray = weight[:, 0] * yaw + weight[:, 1] * pitch
        return total.T

    def prove(self, evidence: Evidence) -> Minima:
        """Bound the least margin of every clause, rad, over all time."""
        minima, on = Minima.of(len(self.layout.quantity)), evidence.on
        if len(self.row) == 0:
            return minima
        number = np.diff(on.begins)[self.layout.owner]
        clause = np.repeat(np.arange(len(number)), number)
        interval = on.begins[self.layout.owner][clause] + places(number)
        # First a cap around the direction at mid-interval, as wide as it may move: that settles nearly all.
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
        """Pairs and intervals (rows,) of all rows of tasks, given by clauses and intervals, (tasks,) each."""
        opening = np.flatnonzero(self.layout.opens_clause)
        size = np.diff(np.append(opening, len(self.row)))[clause]
        return np.repeat(opening[clause], size) + places(size), np.repeat(interval, size)

    def _caps(self, evidence: Evidence, pair: np.ndarray, where: np.ndarray) -> np.ndarray:
        """Lower bounds of `_values` on intervals, and the values in their middles: (2, rows).

        Args:
            evidence: of the trajectories.
            pair: (rows,) int, number of each row's pair.
            where: (rows,) int, number of each row's interval.
        """
        side = self.side[pair]
        middle = self._values(evidence.samples, evidence.on, pair, where, _MIDDLE)[:, 0]
        reach = (evidence.majorants.direction[1] + evidence.rounding.direction)[self.view[pair], where]
        least = side * np.clip(np.sqrt(side * middle) - side * reach, 0, 2) ** 2
        linear = self._linear(pair)
        if len(linear):
            pair, where = pair[linear], where[linear]
            reach = self._weighed(np.abs(self.axis[pair]), evidence.majorants.joints[1], pair, where)
            least[linear] = middle[linear] - reach - self._noise(evidence, pair, where)
        return np.stack([least, middle])

    def _noise(self, evidence: Evidence, pair: np.ndarray, where: np.ndarray) -> np.ndarray:
        """Sizes (rows,) of the rounding errors of `_values` of rows of joints; arguments as of `_caps`."""
        angle, weight = self.angle[pair], np.abs(self.axis[pair])
        return self._weighed(weight, evidence.rounding.joints[0], pair, where) + ROUNDING * np.abs(angle)

    def _rows(self, evidence: Evidence, clause: np.ndarray, interval: np.ndarray) -> Rows:
        """The polynomials through `_values` for tasks, given by clause (tasks,) and interval (tasks,)."""
        pair, where = self._rows_of(clause, interval)
        view, on = self.view[pair], evidence.on
        values = self._values(evidence.samples, on, pair, where)
        largest = np.abs(values).max(axis=1)
        # With |p| = 1 an error d of p changes c by 2 |p - e| d at most, but what is left out by 2 d.
        noise = 2 * evidence.rounding.direction[view, where] * np.sqrt(largest)
        left_out = 2 * evidence.left_out.direction[view, where]
        linear = self._linear(pair)
        if len(linear):
            own = pair[linear], where[linear]
            noise[linear] = self._noise(evidence, *own)
            left_out[linear] = self._weighed(np.abs(self.axis[own[0]]), evidence.left_out.joints[0], *own)
        return Rows(
            coefficients=bounds.to_rows(values),
            error=left_out + LEBESGUE * noise + ROUNDING * bounds.growth(DEGREE) * largest,
            kind=pair,
            low=on.low[interval],
            high=on.high[interval],
        )

    def deciding(self, clause: int, time: float, motion: Motion) -> int:
        """Number of the pair whose margin is that of a clause, by number, at a time, s.

        It is the worst one of the best entry; `motion` is that of all trajectories.
        """
        pairs = np.flatnonzero(self.layout.clause == clause)
        if len(pairs) > 1:
            on = motion.between(np.array([time, time]), self.layout.owner[clause])
            values = self._values(motion.sample(on, np.zeros(1)), on, pairs, np.zeros(len(pairs), int))
            margin = self.margin(values[:, 0], pairs)
            pairs = pairs[margin == self.layout.fold(pairs, margin)]
        return int(pairs[0])

    def faults(
        self, clauses: np.ndarray, minima: Minima, motion: Motion, claim: Claim, allowance: float
    ) -> Iterator[str]:
        """Yield a sentence for each clause whose margin is not proved to be at least minus the allowance.

        Args:
            clauses: (k,) int, those of the trajectory of the claim.
            minima: of all clauses.
            motion: of all trajectories.
            claim: what is claimed.
            allowance: rad.
        """
        for clause in clauses[~(minima.bound[clauses] >= -allowance)].tolist():
            time, seen, bound = minima.time[clause], minima.seen[clause], minima.bound[clause]
            pair = self.deciding(clause, time, motion)
            own = self.layout.clause == clause
            single = self.layout.opens_entry[own].sum() == 1
            alone = len({claim.zone_names[row] for row in self.row[own]}) == 1  # and no group of zones
            kind, wrong = self._kind(pair)
            if alone and not single and self.frame[pair] != JOINTS:  # a field of view by its edges
                kind, wrong = "zone", "too close to"
            sight, name = claim.sights[self.sight[pair]], claim.zone_names[self.row[pair]]
            place = name if name.startswith(f"{kind} ") else f"the {kind} {name}"
            if seen < -allowance:
                rest = "" if single or alone else ", the nearest to hold of its group,"
                overlap = f"{sight} is {np.rad2deg(-seen):.3g} deg {wrong} {place}"
                yield f"{overlap}{rest} at t = {time:.6g} s"
            else:
                met = f"{np.rad2deg(seen):.3g} deg was met at t = {time:.6g} s"
                proof = f"is not proved: {met}, the bound is {np.rad2deg(bound):.3g} deg"
                yield f"the margin of {sight} to {place} {proof}"

    def _kind(self, pair: int) -> tuple[str, str]:
        """The kind of a pair's row and the side on which a sight breaks it, as messages have them."""
        if self.frame[pair] == JOINTS:
            return "mask", "inside"
        outside = self.flip[pair] * self.side[pair] > 0
        return ("keep-out zone", "inside") if outside else ("keep-in zone", "outside")


def _nested(cones: Constraints) -> tuple[np.ndarray, np.ndarray, Layout]:
    """Rows and sights (pairs,) of all pairs that are bound, and their layout, with a single owner."""
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
