"""Trajectories evaluated anew from what they are.

Conventions. ``R`` maps body to inertial, angular velocities are in body axes, joints are all yaws and then
all pitches (2T), devices all terminals and then all instruments (D). On a piece (equation 25, corrected)

    R(t) = R_a U exp(eta^) U,   U = exp((t - t_a) Omega^ / 2),   eta(t) = b(t) - (t - t_a) Omega,

with ``b`` and the joints polynomials. Of the trajectory's making nothing else is used: the angular velocity
and its derivatives are those of the quaternion of ``R``. A terminal points along ``v(yaw + mount, pitch)``
of equation (13).

The motion is sampled on intervals, each within one piece of the platform and one of the joints, at `NODES`,
which include both ends; so what lies left and right of a break is there to be compared.

Trajectories of one spacecraft are evaluated together, their intervals one after the other. What is found on
an interval is, to the last bit, the same whichever others there are, as long as there are others: over a
single one numpy sums in another order. So every trajectory is cut in two at least.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

from jaxplan.certificate import jets
from jaxplan.certificate.pieces import Pieces

if TYPE_CHECKING:
    from jaxplan.certificate.axes import Way
    from jaxplan.spacecraft import Spacecraft
    from jaxplan.trajectory.curve import Trajectory

DEGREE = 10  # of the polynomials through the samples of an interval
NODES = -np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)  # in [-1, 1]: extrema of the Chebyshev polynomial


def places(sizes: np.ndarray) -> np.ndarray:
    """Numbers from zero on within each of some runs of such sizes (k,), one after the other: (sum,)."""
    return np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)


@dataclass(frozen=True, kw_only=True, eq=False)
class Intervals:
    """Intervals of time with the pieces that hold on them, those of a trajectory in the order of time.

    Attributes:
        low: (n,) s, where each begins.
        high: (n,) s, where it ends.
        piece: (n,) number of the platform's piece.
        joint_piece: (n,) number of the joints' piece.
        trajectory: (n,) its number, rising.
    """

    low: np.ndarray
    high: np.ndarray
    piece: np.ndarray
    joint_piece: np.ndarray
    trajectory: np.ndarray

    @cached_property
    def centre(self) -> np.ndarray:
        """(n,) s."""
        return (self.low + self.high) / 2

    @cached_property
    def half(self) -> np.ndarray:
        """(n,) s, half widths."""
        return (self.high - self.low) / 2

    @cached_property
    def begins(self) -> np.ndarray:
        """(trajectories + 1,) number of the first interval of each, and n."""
        return np.searchsorted(self.trajectory, np.arange(self.trajectory[-1] + 2))

    @classmethod
    def joined(cls, several: Sequence[Self]) -> Self:
        """Those of several trajectories."""
        names = ("low", "high", "piece", "joint_piece", "trajectory")
        return cls(**{name: np.concatenate([getattr(on, name) for on in several]) for name in names})

    def cut(self, parts: np.ndarray) -> "Intervals":
        """Each in so many equal parts, (n,) int."""
        share = places(parts) / np.repeat(parts, parts)
        low = np.repeat(self.low, parts) + share * np.repeat(self.high - self.low, parts)
        high = np.append(low[1:], 0.0)
        high[np.cumsum(parts) - 1] = self.high
        return Intervals(
            low=low,
            high=high,
            piece=np.repeat(self.piece, parts),
            joint_piece=np.repeat(self.joint_piece, parts),
            trajectory=np.repeat(self.trajectory, parts),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """A motion at m instants of each of n intervals.

    Attributes:
        time: (n, m) s.
        attitude: (3, 3, n, m) body to inertial.
        spin: (3, 3, n, m) angular velocity and its two derivatives (first axis), rad/s, rad/s^2, rad/s^3.
        joints: (4, 2T, n, m) joints and their three derivatives, rad, rad/s, ...
        boresights: (D, 3, n, m) inertial unit vectors.
    """

    time: np.ndarray
    attitude: np.ndarray
    spin: np.ndarray
    joints: np.ndarray
    boresights: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Curves of the platform and the joints, of one trajectory or of several, with the devices they carry.

    Attributes:
        platform: polynomials of ``b``, rad.
        joints: polynomials of the joints, rad.
        chart_attitude: (N, 3, 3) ``R_a``.
        chart_start: (N,) s, ``t_a``.
        chart_rate: (N, 3) rad/s, ``Omega``.
        mounts: (T,) rad.
        fixed_boresights: (D - T, 3) unit vectors of the instruments, body axes.
    """

    platform: Pieces
    joints: Pieces
    chart_attitude: np.ndarray
    chart_start: np.ndarray
    chart_rate: np.ndarray
    mounts: np.ndarray
    fixed_boresights: np.ndarray

    @classmethod
    def of(cls, spacecraft: "Spacecraft", *trajectories: "Trajectory") -> Self:
        """From trajectories of arrays in float64 whose form has been checked, with as many coefficients."""
        fixed = spacecraft.fixed_boresights
        return cls(
            platform=Pieces.of(*((one.breaks, one.coefficients) for one in trajectories)),
            joints=Pieces.of(*((one.joint_breaks, one.joint_coefficients) for one in trajectories)),
            chart_attitude=np.concatenate([one.chart_attitude for one in trajectories]),
            chart_start=np.concatenate([one.chart_start for one in trajectories]),
            chart_rate=np.concatenate([one.chart_rate for one in trajectories]),
            mounts=spacecraft.mounts,
            fixed_boresights=fixed / np.linalg.norm(fixed, axis=-1, keepdims=True),
        )

    def between(self, edges: np.ndarray, trajectory: int = 0) -> Intervals:
        """The intervals between edges (n + 1,) in s, which must include the breaks of both its curves."""
        centre = (edges[:-1] + edges[1:]) / 2
        return Intervals(
            low=edges[:-1],
            high=edges[1:],
            piece=self.platform.holding(centre, trajectory),
            joint_piece=self.joints.holding(centre, trajectory),
            trajectory=np.full(len(centre), trajectory),
        )

    def pieces(self, ways: Sequence["Way"] = ()) -> Intervals:
        """The longest intervals on which no piece changes, those of ways included; two a trajectory at least.

        Args:
            ways: of zones' axes that move, where there is a single trajectory.
        """
        found = []
        for number in range(len(self.platform.begins) - 1):
            edges = np.union1d(self.platform.breaks(number), self.joints.breaks(number))
            for way in ways:
                inner = (way.breaks > edges[0]) & (way.breaks < edges[-1])
                edges = np.union1d(edges, way.breaks[inner])
            on = self.between(edges, number)
            found.append(on if len(on.low) > 1 else on.cut(np.array([2])))
        return Intervals.joined(found)

    def turn(self, on: Intervals, time: np.ndarray, orders: int) -> np.ndarray:
        """Jets (orders, 3, n, m) of ``eta`` at some times (n, m) of some intervals; at least two orders."""
        eta = self.platform.taylor(on.piece, time, orders)
        rate = self.chart_rate[on.piece].T[..., None]
        eta[0] -= (time - self.chart_start[on.piece, None]) * rate
        eta[1] -= rate
        return eta

    def sample(self, on: Intervals, nodes: np.ndarray = NODES) -> Samples:
        """The motion at the same places (m,) in [-1, 1] of each interval.

        Where a chart turns by more than `jets.LARGEST_TURN` it is NaN.
        """
        time = on.centre[:, None] + on.half[:, None] * nodes
        turn = self.turn(on, time, 4)
        half_chart = np.zeros_like(turn)
        half_chart[1] = self.chart_rate[on.piece].T[..., None] / 2
        half_chart[0] = (time - self.chart_start[on.piece, None]) * half_chart[1]
        both = jets.quaternion(np.concatenate([turn, half_chart], axis=2).reshape(4, 3, -1))
        middle, side = np.split(both, 2, axis=2)
        relative = jets.multiply(jets.multiply(side, middle), side)
        rotation = jets.rotation(relative[0]).reshape(3, 3, *time.shape)
        attitude = np.einsum("nij,jknm->iknm", self.chart_attitude[on.piece], rotation)
        spin = jets.body_rate(relative).reshape(3, 3, *time.shape)
        joints = self.joints.taylor(on.joint_piece, time, 4)
        factorial = np.array([1, 1, 2, 6]).reshape(4, 1, 1, 1)
        boresights = np.einsum("ijnm,djnm->dinm", attitude, self._in_body(joints[0]))
        return Samples(
            time=time,
            attitude=attitude,
            spin=spin * factorial[:3],
            joints=joints * factorial,
            boresights=boresights / np.linalg.norm(boresights, axis=1, keepdims=True),
        )

    def _in_body(self, joints: np.ndarray) -> np.ndarray:
        """Boresights (D, 3, n, m) in body axes."""
        azimuth, elevation = np.split(joints, 2)
        azimuth = azimuth + self.mounts[:, None, None]
        level = np.cos(elevation)
        moving = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)
        fixed = self.fixed_boresights[..., None, None]
        return np.concatenate([moving, np.broadcast_to(fixed, (*fixed.shape[:2], *joints.shape[1:]))])
