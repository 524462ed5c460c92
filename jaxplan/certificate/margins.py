"""Zones as constraints on boresights, and proved lower bounds of their margins over all time.

The margin of a device to a zone is the angle by which it is clear, as in equations (11) and (12). It is
taken from the square of the chord between boresight and axis,

    c = |p - e|^2 = 2 - 2 p . e = 4 sin^2(angle / 2),

which is linear in p and loses no digit at small angles. A cone of more than a right angle is the complement
of the opposite one.

An axis that moves is taken where it is at each instant; how far polynomials in time may be off by its motion
is in the evidence.

A zone binds each of its devices by itself: each is a clause (see `bounds`). Zones of one group are one clause
with an entry for each zone, which holds where all devices of the zone do. A trajectory's pairs of zones and
devices are tasks on its own intervals only, so what is proved of it is the same alone and among others.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from jaxplan.certificate import bounds
from jaxplan.certificate.axes import Way
from jaxplan.certificate.bounds import LEBESGUE, Layout, Minima, Rows
from jaxplan.certificate.errors import Evidence
from jaxplan.certificate.motion import DEGREE, Motion, places
from jaxplan.certificate.pieces import ROUNDING

if TYPE_CHECKING:
    from jaxplan.model.constraints import Constraints

    pass


def tolerance(margin: np.ndarray) -> np.ndarray:
    """How close a bound comes to the least margin met: one in a hundred, at most 1e-4 rad, at least 1e-10."""
    return np.clip(np.abs(margin) / 100, 1e-10, 1e-4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bindings:
    """Pairs of a zone and a device that it binds; they are the kinds of `layout`.

    Attributes:
        zone: (pairs,) row of the zone, among those of its trajectory.
        device: (pairs,) number of the device.
        axis: (pairs, 3) unit vector, the zone's or its opposite; NaN where it moves.
        ways: of the axes that move, by the zone's row.
        flip: (pairs,) -1 where the axis is the zone's opposite, else +1.
        angle: (pairs,) rad, at most a right angle: half angle of the cone about that axis.
        side: (pairs,) +1 to stay outside of that cone, -1 to stay inside.
        layout: how pairs make up constraints; owners are the trajectories on which they must hold.
    """

    zone: np.ndarray
    device: np.ndarray
    axis: np.ndarray
    ways: dict[int, Way]
    flip: np.ndarray
    angle: np.ndarray
    side: np.ndarray
    layout: Layout

    @classmethod
    def of(cls, cones: "Constraints") -> Self:
        """From cones of arrays in float64 whose form has been checked."""
        zone, device = np.nonzero(cones.bound)
        order = np.lexsort((device, zone, cones.group[zone]))
        zone, device = zone[order], device[order]
        group = cones.group[zone]
        new_group = np.append(True, group[1:] != group[:-1])[: len(zone)]
        new_zone = np.append(True, zone[1:] != zone[:-1])[: len(zone)]
        number = np.cumsum(new_group) - 1
        shared = np.bincount(number, new_zone)[number] > 1
        opens_clause = new_group | ~shared
        layout = Layout(
            opens_entry=new_zone | ~shared,
            opens_clause=opens_clause,
            quantity=np.zeros(np.count_nonzero(opens_clause), dtype=int),
            owner=np.zeros(np.count_nonzero(opens_clause), dtype=int),
        )
        wide = (cones.half_angle > np.pi / 2)[zone]
        flip = np.where(wide, -1.0, 1.0)
        direction = cones.axis / np.linalg.norm(cones.axis, axis=-1, keepdims=True)
        return cls(
            zone=zone,
            device=device,
            axis=flip[:, None] * direction[zone],
            ways={
                row: Way.of(path)
                for row, path in enumerate(cones.paths)
                if path is not None and np.any(cones.bound[row])
            },
            flip=flip,
            angle=np.where(wide, np.pi - cones.half_angle[zone], cones.half_angle[zone]),
            side=flip * cones.side[zone],
            layout=layout,
        )

    @classmethod
    def joined(cls, several: "Sequence[Bindings]") -> "Bindings":
        """Those of several trajectories, of which no axis moves; or of one."""
        if len(several) == 1:
            return several[0]
        names = ("zone", "device", "axis", "flip", "angle", "side")
        return cls(
            **{name: np.concatenate([getattr(own, name) for own in several]) for name in names},
            layout=Layout.joined([own.layout for own in several]),
            ways={},
        )

    def axes(self, pair: np.ndarray, centre: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Axes of some pairs at some times.

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
        for zone, way in self.ways.items():
            rows = np.flatnonzero(self.zone[pair] == zone)
            seen = way.at(way.holding(centre[rows]), time[rows])
            axes[rows] = self.flip[pair[rows], None, None] * np.moveaxis(seen, 0, 1)
        return axes

    def margin(self, guarded: np.ndarray, pair: np.ndarray) -> np.ndarray:
        """Margins in rad from ``side c``, with which they rise: (..., rows), for pairs (rows,)."""
        side, angle = self.side[pair], self.angle[pair]
        return side * (2 * np.arcsin(np.sqrt(np.clip(side * guarded, 0, 4)) / 2) - angle)

    def prove(self, evidence: Evidence) -> Minima:
        """Bounds the least margin of every clause, rad, over all time."""
        minima, on = Minima.of(len(self.layout.quantity)), evidence.on
        if len(self.zone) == 0:
            return minima
        number = np.diff(on.begins)[self.layout.owner]
        clause = np.repeat(np.arange(len(number)), number)
        interval = on.begins[self.layout.owner][clause] + places(number)
        # First a cap around the boresight at mid-interval, as wide as it may move: that settles nearly all.
        pair, where = self._rows_of(clause, interval)
        device, side, centre = self.device[pair], self.side[pair], on.centre[where]
        middle = evidence.samples.boresights[device, :, where, DEGREE // 2]
        chord = np.linalg.norm(middle - self.axes(pair, centre, centre[:, None])[..., 0], axis=1)
        reach = (evidence.majorants.direction[1] + evidence.rounding.direction)[device, where]
        near = np.clip(chord - side * reach, 0, 2)
        squares = np.stack([near, chord]) ** 2
        lower, met = self.layout.fold(pair, self.margin(side * squares, pair))
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
        size = np.diff(np.append(opening, len(self.zone)))[clause]
        return np.repeat(opening[clause], size) + places(size), np.repeat(interval, size)

    def _rows(self, evidence: Evidence, clause: np.ndarray, interval: np.ndarray) -> Rows:
        """The polynomials of ``side c`` for some clauses on some intervals, (tasks,) each."""
        pair, where = self._rows_of(clause, interval)
        device, on = self.device[pair], evidence.on
        axes = self.axes(pair, on.centre[where], evidence.samples.time[where])
        apart = evidence.samples.boresights[device, :, where] - axes
        square = np.einsum("rim,rim->rm", apart, apart)
        largest = square.max(axis=1)
        # With |p| = 1 an error d of p changes c by 2 |p - e| d at most, but what is left out by 2 d.
        noise = LEBESGUE * 2 * evidence.rounding.direction[device, where] * np.sqrt(largest)
        conversion = ROUNDING * bounds.growth(DEGREE) * largest
        return Rows(
            coefficients=self.side[pair] * bounds.to_rows(square),
            error=2 * evidence.left_out.direction[device, where] + noise + conversion,
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
            instant = motion.sample(motion.between(np.array([time, time]), trajectory), np.zeros(1))
            when = np.full((len(pairs), 1), time)
            chord = (
                instant.boresights[self.device[pairs], :, 0, 0] - self.axes(pairs, when[:, 0], when)[..., 0]
            )
            margin = self.margin(self.side[pairs] * np.sum(chord**2, axis=1), pairs)
            pairs = pairs[margin == self.layout.fold(pairs, margin)]
        return int(pairs[0])

    def faults(
        self,
        minima: Minima,
        motion: Motion,
        device_names: Sequence[str],
        zone_names: Sequence[str],
        allowance: float,
        trajectory: int = 0,
    ) -> Iterator[str]:
        """A sentence for each clause whose margin is not proved to be at least minus the allowance."""
        for clause in np.flatnonzero(~(minima.bound >= -allowance)).tolist():
            time, seen, bound = minima.time[clause], minima.seen[clause], minima.bound[clause]
            pair = self.deciding(clause, time, motion, trajectory)
            outside = self.flip[pair] * self.side[pair] > 0
            kind, wrong = ("keep-out", "inside") if outside else ("keep-in", "outside")
            device, place = device_names[self.device[pair]], f"the {kind} zone {zone_names[self.zone[pair]]}"
            if seen < -allowance:
                single = len(np.unique(self.zone[self.layout.clause == clause])) == 1
                rest = "" if single else ", the nearest to hold of its group,"
                overlap = f"{device} is {np.rad2deg(-seen):.3g} deg {wrong} {place}"
                yield f"{overlap}{rest} at t = {time:.6g} s"
            else:
                met = f"{np.rad2deg(seen):.3g} deg was met at t = {time:.6g} s"
                proof = f"is not proved: {met}, the bound is {np.rad2deg(bound):.3g} deg"
                yield f"the margin of {device} to {place} {proof}"
