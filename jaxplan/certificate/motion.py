"""A trajectory evaluated anew from what it is.

Conventions. ``R`` maps body to inertial, angular velocities are in body axes, joints are all yaws and then
all pitches (2T), devices all terminals and then all instruments (D). On a piece (equation 25, corrected)

    R(t) = R_a U exp(eta^) U,   U = exp((t - t_a) Omega^ / 2),   eta(t) = b(t) - (t - t_a) Omega,

with ``b`` and the joints polynomials. Of the trajectory's making nothing else is used: the angular velocity
and its derivatives are those of the quaternion of ``R``. A terminal points along ``v(yaw + mount, pitch)``
of equation (13).

The motion is sampled on intervals, each within one piece of the platform and one of the joints, at `NODES`,
which include both ends; so what lies left and right of a break is there to be compared.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from jaxplan.certificate import jets
from jaxplan.certificate.pieces import Pieces

if TYPE_CHECKING:
    from jaxplan.spacecraft import Spacecraft
    from jaxplan.trajectory.curve import Trajectory

DEGREE = 10  # of the polynomials through the samples of an interval
NODES = -np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)  # in [-1, 1]: extrema of the Chebyshev polynomial


@dataclass(frozen=True, kw_only=True, eq=False)
class Intervals:
    """Intervals of time with the pieces that hold on them.

    Attributes:
        centre: (n,) s.
        half: (n,) s, half widths.
        piece: (n,) number of the platform's piece.
        joint_piece: (n,) number of the joints' piece.
    """

    centre: np.ndarray
    half: np.ndarray
    piece: np.ndarray
    joint_piece: np.ndarray


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
    """The platform's and the joints' curves with the devices they carry.

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
    def of(cls, trajectory: "Trajectory", spacecraft: "Spacecraft") -> Self:
        """From a trajectory of arrays in float64 whose form has been checked."""
        fixed = spacecraft.fixed_boresights
        return cls(
            platform=Pieces.of(trajectory.breaks, trajectory.coefficients),
            joints=Pieces.of(trajectory.joint_breaks, trajectory.joint_coefficients),
            chart_attitude=trajectory.chart_attitude,
            chart_start=trajectory.chart_start,
            chart_rate=trajectory.chart_rate,
            mounts=spacecraft.mounts,
            fixed_boresights=fixed / np.linalg.norm(fixed, axis=-1, keepdims=True),
        )

    def between(self, edges: np.ndarray) -> Intervals:
        """The intervals between edges (n + 1,) in s, which must include the breaks of both curves."""
        centre = (edges[:-1] + edges[1:]) / 2
        return Intervals(
            centre=centre,
            half=np.diff(edges) / 2,
            piece=self.platform.holding(centre),
            joint_piece=self.joints.holding(centre),
        )

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
