"""Pointing constraints, and proved lower bounds of their margins over all time.

A *sight* is a direction that a constraint binds, and a *row* a cone about an axis that sights must stay out
of or in (see `jaxplan.model.constraints`). The margin of a sight to a cone is the angle in rad by which it is
clear of the cone's edge, as in equations (11) and (12); it is positive where the constraint is kept. It is
computed from the square of the chord between sight ``p`` and axis ``e``,

    c = |p - e|^2 = 2 - 2 p . e = 4 sin^2(angle / 2),

which is linear in p and in e and loses no digit at small angles. A cone of more than a right angle is treated
as the complement of the opposite cone.

A moving inertial axis is evaluated at each instant. If the axis is fixed in the body or is itself a sight,
both directions are taken in body axes, where the platform's turn does not count. `bounds.Evidence` holds the
errors of polynomials in time that follow from the motion of both. A row of joints binds a terminal's joint
angles instead of directions; its margin is ``f . (yaw, pitch) - d``.

An entry holds where all its rows do, for all sights that they bind; a constraint holds where one of its
entries does. A constraint of a single entry must hold for each sight by itself, so each sight makes a clause
(see `bounds`); one of several entries is a single clause. The clauses of a trajectory have tasks on its own
intervals only, so what is proved of it does not depend on the other trajectories.
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

_NON_ARRAY_FIELDS = ("views", "ways", "terminals", "layout")  # attributes of `Bindings` that are no arrays
_FULL_SLICE = slice(None)
_MIDDLE_SAMPLE = slice(DEGREE // 2, DEGREE // 2 + 1)  # of an interval, among its samples


def tolerance(margin: np.ndarray) -> np.ndarray:
    """Return how close a bound must come to the least margin met: 1 % of it, from 1e-10 to 1e-4 rad."""
    return np.clip(np.abs(margin) / 100, 1e-10, 1e-4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bindings:
    """All pairs of a row and a sight that it binds; the pairs are the kinds of `layout`.

    Attributes:
        row: (pairs,) index of the row within the constraints of its trajectory.
        sight: (pairs,) index of the sight.
        frame: (pairs,) what the axis is fixed to: `INERTIAL`, `BODY`, `SIGHT` or, for rows of joints,
            `JOINTS`.
        partner: (pairs,) index of the sight that is the axis, where `frame` is `SIGHT`.
        axis: (pairs, 3) unit vector, the cone's axis or its opposite; NaN where it moves. For rows of joints
            ``f`` and a zero.
        flip: (pairs,) -1 where `axis` is the opposite of the cone's axis, else +1.
        angle: (pairs,) rad, half angle of the cone about `axis`, at most a right angle; for rows of joints
            ``d``. What errors take off the margin (`tube`) is included.
        side: (pairs,) +1 to stay outside of the cone about `axis`, -1 to stay inside; +1 for rows of joints.
        view: (pairs,) index of the pair's scalar product within `bounds.Errors.direction`.
        views: directions that are sampled beside the devices' boresights.
        ways: the moving inertial axes, by index of the row.
        terminals: number of terminals.
        layout: how pairs make up constraints; owners are the trajectories in which they must hold.
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
        """Collect the pairs of constraints whose form has been checked, with arrays in float64.

        Args:
            cones: the constraints.
            terminals: number of terminals.
            lost: (rows, sights) rad, what errors take off the margin of each pair; None for nothing.
        """
        row, sight, layout = _lay_out_pairs(cones)
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
        """Concatenate the pairs of trajectories with the same views; with moving axes only one is allowed."""
        if len(several) == 1:
            return several[0]
        arrays = [field.name for field in fields(cls) if field.name not in _NON_ARRAY_FIELDS]
        return cls(
            **{name: np.concatenate([getattr(own, name) for own in several]) for name in arrays},
            layout=Layout.joined([own.layout for own in several]),
            views=several[0].views,
            ways={},
            terminals=several[0].terminals,
        )

    @property
    def narrowest(self) -> float:
        """The least half angle of all cones, rad; a right angle where there are none."""
        return float(np.min(self.angle[self.frame != JOINTS], initial=np.pi / 2))

    @cached_property
    def has_joints(self) -> bool:
        """Whether there are rows of joints, whose margins are those of joint angles."""
        return bool((self.frame == JOINTS).any())

    def margin(self, value: np.ndarray, pair: np.ndarray) -> np.ndarray:
        """Convert values of `_sample_pairs` to margins in rad; margins rise with the values.

        Args:
            value: (..., rows).
            pair: (rows,) int, index of each row's pair.

        Returns:
            (..., rows).
        """
        side, angle = self.side[pair], self.angle[pair]
        margin = side * (2 * np.arcsin(np.sqrt(np.clip(side * value, 0, 4)) / 2) - angle)
        return np.where(self.frame[pair] == JOINTS, value, margin) if self.has_joints else margin

    def _sample_pairs(
        self, samples: Samples, on: Intervals, pair: np.ndarray, where: np.ndarray, at: slice = _FULL_SLICE
    ) -> np.ndarray:
        """Sample ``side c`` of pairs, or ``f . (yaw, pitch) - d`` of pairs of rows of joints: (rows, m).

        Args:
            samples: samples of the motion.
            on: the intervals that were sampled.
            pair: (rows,) int, index of each row's pair.
            where: (rows,) int, index of each row's interval.
            at: which m samples of an interval to take.
        """
        sight, frame, flip = self.sight[pair], self.frame[pair], self.flip[pair, None, None]

        def apart_from(
            axes: np.ndarray, seen: np.ndarray, of: np.ndarray | slice = _FULL_SLICE
        ) -> np.ndarray:
            """Return vectors (rows, 3, m) from axes to sights; both inertial or both in body axes."""
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
        linear = self._find_joint_rows(pair)
        if len(linear):
            pair, joints = pair[linear], samples.joints[0][..., at]
            values[linear] = (
                self._weigh_joints(self.axis[pair], joints, pair, where[linear]) - self.angle[pair, None]
            )
        return values

    def _find_joint_rows(self, pair: np.ndarray) -> np.ndarray:
        """Return the places in `pair` (rows,) of those pairs that are of rows of joints."""
        return np.flatnonzero(self.frame[pair] == JOINTS)

    def _weigh_joints(
        self, weight: np.ndarray, joints: np.ndarray, pair: np.ndarray, where: np.ndarray
    ) -> np.ndarray:
        """Return ``w_1 yaw + w_2 pitch`` (rows, ...) of the terminals of pairs of rows of joints.

        Args:
            weight: (rows, 3) ``w``, of which the last component is not used.
            joints: (J, n, ...) values of all joints on n intervals.
            pair: (rows,) int, index of each row's pair.
            where: (rows,) int, index of each row's interval.
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
        # First bound the direction by a cap around where it is at mid-interval: that settles nearly all.
        pair, where = self._task_rows(clause, interval)
        lower, met = self.layout.fold(pair, self.margin(self._cap_bounds(evidence, pair, where), pair))
        minima.meet(clause[::-1], met[::-1], on.centre[interval[::-1]])  # of equal values the first
        settled = lower >= minima.wanted(self.layout, tolerance)[clause]
        np.minimum.at(minima.bound, clause[settled], lower[settled])
        if not np.all(settled):
            rows = self._task_polynomials(evidence, clause[~settled], interval[~settled])
            bounds.minimise(rows, self.layout, minima, self.margin, tolerance)
        return minima

    def _task_rows(self, clause: np.ndarray, interval: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return pairs and intervals (rows,) of all rows of tasks, given clauses and intervals (tasks,)."""
        opening = np.flatnonzero(self.layout.opens_clause)
        size = np.diff(np.append(opening, len(self.row)))[clause]
        return np.repeat(opening[clause], size) + places(size), np.repeat(interval, size)

    def _cap_bounds(self, evidence: Evidence, pair: np.ndarray, where: np.ndarray) -> np.ndarray:
        """Return lower bounds of `_sample_pairs` on intervals, and the values at mid-interval: (2, rows).

        A bound is taken over the cap that the direction may reach from where it is at mid-interval.

        Args:
            evidence: samples and bounds of the trajectories.
            pair: (rows,) int, index of each row's pair.
            where: (rows,) int, index of each row's interval.
        """
        side = self.side[pair]
        middle = self._sample_pairs(evidence.samples, evidence.on, pair, where, _MIDDLE_SAMPLE)[:, 0]
        reach = (evidence.majorants.direction[1] + evidence.rounding.direction)[self.view[pair], where]
        least = side * np.clip(np.sqrt(side * middle) - side * reach, 0, 2) ** 2
        linear = self._find_joint_rows(pair)
        if len(linear):
            pair, where = pair[linear], where[linear]
            reach = self._weigh_joints(np.abs(self.axis[pair]), evidence.majorants.joints[1], pair, where)
            least[linear] = middle[linear] - reach - self._joint_rounding(evidence, pair, where)
        return np.stack([least, middle])

    def _joint_rounding(self, evidence: Evidence, pair: np.ndarray, where: np.ndarray) -> np.ndarray:
        """Return sizes (rows,) of rounding errors of `_sample_pairs` for rows of joints.

        Arguments are those of `_cap_bounds`.
        """
        angle, weight = self.angle[pair], np.abs(self.axis[pair])
        return self._weigh_joints(weight, evidence.rounding.joints[0], pair, where) + ROUNDING * np.abs(angle)

    def _task_polynomials(self, evidence: Evidence, clause: np.ndarray, interval: np.ndarray) -> Rows:
        """Return the polynomials through `_sample_pairs` for tasks, given clauses and intervals (tasks,)."""
        pair, where = self._task_rows(clause, interval)
        view, on = self.view[pair], evidence.on
        values = self._sample_pairs(evidence.samples, on, pair, where)
        largest = np.abs(values).max(axis=1)
        # With |p| = 1 an error d of p changes c by at most 2 |p - e| d, but one of p . e changes it by 2 d.
        noise = 2 * evidence.rounding.direction[view, where] * np.sqrt(largest)
        left_out = 2 * evidence.left_out.direction[view, where]
        linear = self._find_joint_rows(pair)
        if len(linear):
            own = pair[linear], where[linear]
            noise[linear] = self._joint_rounding(evidence, *own)
            left_out[linear] = self._weigh_joints(
                np.abs(self.axis[own[0]]), evidence.left_out.joints[0], *own
            )
        return Rows(
            coefficients=bounds.to_rows(values),
            error=left_out + LEBESGUE * noise + ROUNDING * bounds.growth(DEGREE) * largest,
            kind=pair,
            low=on.low[interval],
            high=on.high[interval],
        )

    def deciding(self, clause: int, time: float, motion: Motion) -> int:
        """Return the index of the pair that decides a clause's margin at a time: worst one of the best entry.

        Args:
            clause: index of the clause.
            time: s.
            motion: that of all trajectories.
        """
        pairs = np.flatnonzero(self.layout.clause == clause)
        if len(pairs) > 1:
            on = motion.between(np.array([time, time]), self.layout.owner[clause])
            values = self._sample_pairs(motion.sample(on, np.zeros(1)), on, pairs, np.zeros(len(pairs), int))
            margin = self.margin(values[:, 0], pairs)
            pairs = pairs[margin == self.layout.fold(pairs, margin)]
        return int(pairs[0])

    def faults(
        self, clauses: np.ndarray, minima: Minima, motion: Motion, claim: Claim, allowance: float
    ) -> Iterator[str]:
        """Yield a sentence for each clause whose margin is not proved to be at least minus the allowance.

        Args:
            clauses: (k,) int, indices of the clauses of the claim's trajectory.
            minima: those of all clauses.
            motion: that of all trajectories.
            claim: what is claimed.
            allowance: rad, by which a margin may be negative.
        """
        for clause in clauses[~(minima.bound[clauses] >= -allowance)].tolist():
            time, seen, bound = minima.time[clause], minima.seen[clause], minima.bound[clause]
            pair = self.deciding(clause, time, motion)
            own = self.layout.clause == clause
            single = self.layout.opens_entry[own].sum() == 1
            alone = len({claim.zone_names[row] for row in self.row[own]}) == 1  # and no group of zones
            kind, wrong = self._describe_row(pair)
            if alone and not single and self.frame[pair] != JOINTS:  # a field of view, made of its edges
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

    def _describe_row(self, pair: int) -> tuple[str, str]:
        """Return words for a pair's row and for where a sight breaks it: ("keep-out zone", "inside")."""
        if self.frame[pair] == JOINTS:
            return "mask", "inside"
        outside = self.flip[pair] * self.side[pair] > 0
        return ("keep-out zone", "inside") if outside else ("keep-in zone", "outside")


def _lay_out_pairs(cones: Constraints) -> tuple[np.ndarray, np.ndarray, Layout]:
    """Return rows and sights (pairs,) of all bound pairs, clause by clause, and their layout."""
    row, sight = np.nonzero(cones.bound)
    entry, group = cones.entry[row].astype(int), cones.group[row].astype(int)
    leading = cones.group[np.unique(entry)].astype(int)  # the constraint of each entry
    shared = np.bincount(leading, minlength=len(cones.group))[group] > 1
    part = np.where(shared, entry, sight)  # the entry of the layout, see the module's description
    order = np.lexsort((sight, row, part, group))
    row, sight, part, group, shared = (each[order] for each in (row, sight, part, group, shared))
    new_group = np.append(True, group[1:] != group[:-1])[: len(row)]
    new_part = new_group | np.append(True, part[1:] != part[:-1])[: len(row)]
    opens_clause = np.where(shared, new_group, new_part)
    alone = np.zeros(np.count_nonzero(opens_clause), dtype=int)
    return row, sight, Layout(opens_entry=new_part, opens_clause=opens_clause, quantity=alone, owner=alone)
