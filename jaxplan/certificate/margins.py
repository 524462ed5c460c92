"""Zones as constraints on boresights, and proved lower bounds of their margins over all time.

The margin of a device to a zone is the angle by which it is clear, as in equations (11) and (12). It is
taken from the square of the chord between boresight and axis,

    c = |p - e|^2 = 2 - 2 p . e = 4 sin^2(angle / 2),

which is linear in p and loses no digit at small angles. A cone of more than a right angle is the complement
of the opposite one.

An axis that moves is taken where it is at each instant; how far polynomials in time may be off by its motion
is in the evidence.

A zone binds each of its devices by itself: each is a clause (see `bounds`). Zones of one group are one clause
with an entry for each zone, which holds where all devices of the zone do.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from jaxplan.certificate import bounds
from jaxplan.certificate.axes import Way
from jaxplan.certificate.bounds import LEBESGUE, Layout, Minima, Rows
from jaxplan.certificate.errors import Evidence
from jaxplan.certificate.motion import DEGREE, Motion
from jaxplan.certificate.pieces import ROUNDING

if TYPE_CHECKING:
    from jaxplan.zones import Cones


def tolerance(margin: np.ndarray) -> np.ndarray:
    """How close a bound comes to the least margin met: one in a hundred, at most 1e-4 rad, at least 1e-10."""
    return np.clip(np.abs(margin) / 100, 1e-10, 1e-4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bindings:
    """Pairs of a zone and a device that it binds; they are the kinds of `layout`.

    Attributes:
        cones: the zones as they were given.
        zone: (pairs,) row of the zone.
        device: (pairs,) number of the device.
        axis: (pairs, 3) unit vector, the zone's or its opposite; NaN where it moves.
        ways: of the axes that move, by the zone's row.
        flip: (pairs,) -1 where the axis is the zone's opposite, else +1.
        angle: (pairs,) rad, at most a right angle: half angle of the cone about that axis.
        side: (pairs,) +1 to stay outside of that cone, -1 to stay inside.
        layout: how pairs make up constraints.
    """

    cones: "Cones"
    zone: np.ndarray
    device: np.ndarray
    axis: np.ndarray
    ways: dict[int, Way]
    flip: np.ndarray
    angle: np.ndarray
    side: np.ndarray
    layout: Layout

    @classmethod
    def of(cls, cones: "Cones") -> Self:
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
        )
        wide = (cones.half_angle > np.pi / 2)[zone]
        flip = np.where(wide, -1.0, 1.0)
        direction = cones.direction / np.linalg.norm(cones.direction, axis=-1, keepdims=True)
        return cls(
            cones=cones,
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
        """Margins in rad from ``side c``, with which they rise: (rows, ...), for pairs (rows,)."""
        side, angle = (x[pair].reshape(-1, *[1] * (guarded.ndim - 1)) for x in (self.side, self.angle))
        return side * (2 * np.arcsin(np.sqrt(np.clip(side * guarded, 0, 4)) / 2) - angle)

    def prove(self, evidence: Evidence) -> Minima:
        """Bounds the least margin of every clause, rad, over all time."""
        minima = Minima.of(len(self.layout.quantity))
        pairs = np.arange(len(self.zone))
        if len(pairs) == 0:
            return minima
        # First a cap around the boresight at mid-interval, as wide as it may move: that settles nearly all.
        middle = evidence.samples.boresights[..., DEGREE // 2]
        axes, number = self.axis[..., None], len(evidence.on.centre)
        if self.ways:
            centre = np.tile(evidence.on.centre, len(pairs))
            found = self.axes(np.repeat(pairs, number), centre, centre[:, None])
            axes = np.moveaxis(found[..., 0].reshape(len(pairs), number, 3), 2, 1)
        chord = np.linalg.norm(middle[self.device] - axes, axis=1)
        reach = (evidence.majorants.direction[1] + evidence.rounding.direction)[self.device]
        side = self.side[:, None]
        near = np.clip(chord - side * reach, 0, 2)
        lower = self.layout.fold(pairs, self.margin(side * near**2, pairs))
        met = self.layout.fold(pairs, self.margin(side * chord**2, pairs))
        least = met.argmin(axis=1)
        minima.meet(np.arange(len(met)), met.min(axis=1), evidence.on.centre[least])
        settled = lower >= minima.wanted(self.layout, tolerance)[:, None]
        minima.bound[:] = np.where(settled, lower, np.inf).min(axis=1)
        if not np.all(settled):
            rows = self._rows(evidence, *np.nonzero(~settled))
            bounds.minimise(rows, self.layout, minima, self.margin, tolerance)
        return minima

    def _rows(self, evidence: Evidence, clause: np.ndarray, interval: np.ndarray) -> Rows:
        """The polynomials of ``side c`` for some clauses on some intervals, (tasks,) each."""
        opening = np.flatnonzero(self.layout.opens_clause)
        size = np.diff(np.append(opening, len(self.zone)))[clause]
        within = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
        pair, where = np.repeat(opening[clause], size) + within, np.repeat(interval, size)
        device = self.device[pair]
        apart = evidence.samples.boresights[device, :, where] - self.axes(
            pair, evidence.on.centre[where], evidence.samples.time[where]
        )
        square = np.einsum("rim,rim->rm", apart, apart)
        largest = square.max(axis=1)
        # With |p| = 1 an error d of p changes c by 2 |p - e| d at most, but what is left out by 2 d.
        noise = LEBESGUE * 2 * evidence.rounding.direction[device, where] * np.sqrt(largest)
        conversion = ROUNDING * bounds.growth(DEGREE) * largest
        return Rows(
            coefficients=self.side[pair][:, None] * square @ bounds.to_bernstein(DEGREE).T,
            error=2 * evidence.left_out.direction[device, where] + noise + conversion,
            kind=pair,
            low=(evidence.on.centre - evidence.on.half)[interval],
            high=(evidence.on.centre + evidence.on.half)[interval],
        )

    def deciding(self, clause: int, time: float, motion: Motion) -> tuple[int, int]:
        """Zone and device whose margin is the clause's at some time: the best entry's worst pair."""
        pairs = np.flatnonzero(self.layout.clause == clause)
        if len(pairs) > 1:
            instant = motion.sample(motion.between(np.array([time, time])), np.zeros(1))
            when = np.full((len(pairs), 1), time)
            chord = (
                instant.boresights[self.device[pairs], :, 0, 0] - self.axes(pairs, when[:, 0], when)[..., 0]
            )
            margin = self.margin(self.side[pairs] * np.sum(chord**2, axis=1), pairs)
            pairs = pairs[margin == self.layout.fold(pairs, margin)]
        return int(self.zone[pairs[0]]), int(self.device[pairs[0]])

    def faults(
        self,
        minima: Minima,
        motion: Motion,
        device_names: Sequence[str],
        zone_names: Sequence[str],
        allowance: float,
    ) -> Iterator[str]:
        """A sentence for each clause whose margin is not proved to be at least minus the allowance."""
        for clause in np.flatnonzero(~(minima.bound >= -allowance)).tolist():
            time, seen, bound = minima.time[clause], minima.seen[clause], minima.bound[clause]
            zone, device = self.deciding(clause, time, motion)
            kind, wrong = ("keep-out", "inside") if self.cones.side[zone] > 0 else ("keep-in", "outside")
            place = f"the {kind} zone {zone_names[zone]}"
            if seen < -allowance:
                single = len(np.unique(self.zone[self.layout.clause == clause])) == 1
                rest = "" if single else ", the nearest to hold of its group,"
                overlap = f"{device_names[device]} is {np.rad2deg(-seen):.3g} deg {wrong} {place}"
                yield f"{overlap}{rest} at t = {time:.6g} s"
            else:
                met = f"{np.rad2deg(seen):.3g} deg was met at t = {time:.6g} s"
                proof = f"is not proved: {met}, the bound is {np.rad2deg(bound):.3g} deg"
                yield f"the margin of {device_names[device]} to {place} {proof}"
