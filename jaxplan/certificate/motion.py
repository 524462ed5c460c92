"""Motion of platform, joints and moving axes, computed anew for the certificate from its definition.

**Trajectories.** ``R`` maps body to inertial coordinates, and angular velocities are in body axes. Joints are
numbered all yaws, all pitches, all angles of drives: J = 2 T + D for T terminals and D drives. The S *sights*
are the boresights of terminals, drives and instruments, then axes of the body, then vectors of moving parts.
Each piece of the platform has a *chart*, a reference motion at constant rate (``R_a``, ``t_a``, ``Omega``).
On it (equation 25, corrected)

    R(t) = R_a U exp(eta^) U,   U = exp((t - t_a) Omega^ / 2),   eta(t) = b(t) - (t - t_a) Omega,

where ``b``, a rotation vector, and the joint angles are polynomials. Nothing else is used of how the
trajectory was made: the angular velocity and its derivatives are those of the quaternion of ``R``. In its own
axes (`Mountings`) a terminal points along ``v(yaw, pitch)`` of equation (13), and the directions to its left
and upwards turn with it. A drive has a yaw alone; its pitch stays as it is mounted.

The motion is sampled at `NODES` of intervals, each within one piece of the platform and one of the joints.
Both ends are among the nodes, so that values just before and after a break can be compared. Trajectories of
one spacecraft are evaluated together, with their intervals one after the other. Results on an interval do not
depend, to the last bit, on which others there are, but on whether there are any, as numpy sums in another
order over a single one. So every trajectory is cut into two at least.

**Moving axes** (*ways*) are ``e = s / |s|``, where ``s`` is the cubic between two samples with given slopes
there. The majorant of ``e`` on an interval (see `series`) is that of ``s`` times that of ``q^(-1/2)`` with
``q = |s|^2``. If ``q`` is at least ``l`` on the interval and ``Q`` is its majorant without the constant term,
then ``(l - Q)^(-1/2)`` is a majorant of ``q^(-1/2)``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Protocol, Self

import numpy as np

from jaxplan.certificate import series
from jaxplan.certificate.series import ROUNDING, Pieces
from jaxplan.model.constraints import Constraints
from jaxplan.model.directions import DirectionPath
from jaxplan.model.spacecraft import Spacecraft

DEGREE = 10  # of the polynomials through the samples of an interval
NODES = -np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)  # in [-1, 1]: extrema of the Chebyshev polynomial


class Trajectory(Protocol):
    """A trajectory as the certificate reads it: N pieces of the platform, M of the J joints; degree p."""

    @property
    def breaks(self) -> np.ndarray:
        """(N + 1,) s, ends of the platform's pieces, from 0 to the duration."""

    @property
    def chart_attitude(self) -> np.ndarray:
        """(N, 3, 3) rotation matrices ``R_a``, body to inertial."""

    @property
    def chart_start(self) -> np.ndarray:
        """(N,) s, ``t_a``, the time at which each chart's own turn ``U`` is zero."""

    @property
    def chart_rate(self) -> np.ndarray:
        """(N, 3) rad/s, ``Omega``, the constant angular velocity of each chart."""

    @property
    def coefficients(self) -> np.ndarray:
        """(N, p + 1, 3) rad, Legendre coefficients of ``b`` on each piece."""

    @property
    def joint_breaks(self) -> np.ndarray:
        """(M + 1,) s, ends of the joints' pieces, from 0 to the duration."""

    @property
    def joint_coefficients(self) -> np.ndarray:
        """(M, p + 1, J) rad, Legendre coefficients of the joint angles on each piece."""

    @property
    def smoothness(self) -> int:
        """Number of time derivatives that are claimed to be continuous at all breaks, to be proved."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """A moving inertial axis as a function of time, a cubic spline ``s`` scaled to unit length.

    Attributes:
        breaks: (n,) s, ends of its pieces.
        cubics: (4, 3, n - 1) Taylor coefficients of ``s`` on each piece about the start of the piece.
    """

    breaks: np.ndarray
    cubics: np.ndarray

    @classmethod
    def of(cls, path: DirectionPath) -> Self:
        """Make the way of a path, whose numbers must be finite and whose times must rise."""
        times, p, m = (np.asarray(part, np.float64) for part in (path.times, path.samples, path.slopes))
        h = np.diff(times)[:, None]
        chord = np.diff(p, axis=0) / h
        square, cube = (3 * chord - 2 * m[:-1] - m[1:]) / h, (m[:-1] + m[1:] - 2 * chord) / h**2
        return cls(breaks=times, cubics=np.moveaxis(np.stack([p[:-1], m[:-1], square, cube]), 1, 2))

    def holding(self, time: np.ndarray) -> np.ndarray:
        """Return indices (n,) of the pieces that contain times (n,) s; the later one at a break."""
        return np.clip(np.searchsorted(self.breaks, time, side="right") - 1, 0, len(self.breaks) - 2)

    def at(self, piece: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Return unit vectors (3, n, m), inertial, at times (n, m) s of pieces with indices (n,)."""
        value = self._taylor(piece, time)[0]
        return value / np.linalg.norm(value, axis=0)

    def majorant(self, centre: np.ndarray, half: np.ndarray, orders: int) -> np.ndarray:
        """Return the majorant (orders, n) on intervals within pieces, in the unit of half widths.

        Args:
            centre: (n,) s, centres of the intervals.
            half: (n,) s, their half widths.
            orders: number of orders to return.
        """
        cubic = self._scaled_taylor(centre, half)
        padded = np.concatenate([cubic, np.zeros((3, *cubic.shape[1:]))])
        square = series.product("in,in->n", padded, padded)  # of degree 6
        least = square[0] - np.abs(square[1:]).sum(axis=0)
        inverse = _inverse_root(np.where(least > 0, least, np.nan), series.majorant(np.abs(square), orders))
        found = series.product("n,n->n", series.majorant(np.linalg.norm(cubic, axis=1), orders), inverse)
        found[0] = 1
        return found

    def rounding(self, centre: np.ndarray, half: np.ndarray) -> np.ndarray:
        """Return sizes (n,) of rounding errors of `at` on intervals, by centres and half widths (n,) s."""
        return ROUNDING * (1 + np.linalg.norm(self._scaled_taylor(centre, half), axis=1).sum(axis=0))

    def _scaled_taylor(self, centre: np.ndarray, half: np.ndarray) -> np.ndarray:
        """Return Taylor coefficients (4, 3, n) of ``s`` about centres (n,) s, in units of `half` (n,) s."""
        about = self._taylor(self.holding(centre), centre[:, None])[..., 0]
        return about * half ** np.arange(4)[:, None, None]

    def _taylor(self, piece: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Return Taylor coefficients (4, 3, n, m) of ``s`` about times (n, m) s, on pieces by index (n,)."""
        x = time - self.breaks[piece, None]
        a, b, c, d = self.cubics[:, :, piece, None]
        return np.stack(
            [a + x * (b + x * (c + x * d)), b + x * (2 * c + 3 * x * d), c + 3 * x * d, d + 0 * x]
        )


def _inverse_root(least: np.ndarray, majorant: np.ndarray) -> np.ndarray:
    """Return the series (orders, n) of ``(least - Q)^(-1/2)``.

    Args:
        least: (n,) positive constant term; NaN makes the result NaN.
        majorant: (orders, n) ``Q``, of which order zero is not used.
    """
    result = np.empty_like(majorant)
    result[0] = least**-0.5
    for k in range(1, len(majorant)):
        terms = [(k - i / 2) * majorant[i] * result[k - i] for i in range(1, k + 1)]
        result[k] = np.sum(terms, axis=0) / (k * least)
    return result


def places(sizes: np.ndarray) -> np.ndarray:
    """Return the ranges ``0 .. size - 1`` for all sizes (k,), one after the other: (sum of sizes,)."""
    return np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)


@dataclass(frozen=True, kw_only=True, eq=False)
class Intervals:
    """Intervals of time with the pieces that contain them, trajectory by trajectory and in order of time.

    Attributes:
        low: (n,) s, where each begins.
        high: (n,) s, where it ends.
        piece: (n,) index of the platform's piece.
        joint_piece: (n,) index of the joints' piece.
        trajectory: (n,) index of the trajectory, not falling.
    """

    low: np.ndarray
    high: np.ndarray
    piece: np.ndarray
    joint_piece: np.ndarray
    trajectory: np.ndarray

    @cached_property
    def centre(self) -> np.ndarray:
        """(n,) s, midpoints of the intervals."""
        return (self.low + self.high) / 2

    @cached_property
    def half(self) -> np.ndarray:
        """(n,) s, half widths of the intervals."""
        return (self.high - self.low) / 2

    @cached_property
    def begins(self) -> np.ndarray:
        """(trajectories + 1,) index of the first interval of each trajectory, then n."""
        return np.searchsorted(self.trajectory, np.arange(self.trajectory[-1] + 2))

    @classmethod
    def joined(cls, several: Sequence[Self]) -> Self:
        """Concatenate the intervals of several trajectories."""
        names = [each.name for each in fields(cls)]
        return cls(**{name: np.concatenate([getattr(on, name) for on in several]) for name in names})

    def cut(self, parts: np.ndarray) -> Self:
        """Return the intervals with each cut into equal parts, as many as `parts` (n,) int says."""
        whole = {each.name: np.repeat(getattr(self, each.name), parts) for each in fields(self)}
        share = places(parts) / np.repeat(parts, parts)
        low = whole["low"] + share * (whole["high"] - whole["low"])
        high = np.append(low[1:], 0.0)
        high[np.cumsum(parts) - 1] = self.high
        return type(self)(**whole | {"low": low, "high": high})


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """A motion at m instants of each of n intervals.

    Attributes:
        time: (n, m) s.
        attitude: (3, 3, n, m) rotation matrices, body to inertial.
        spin: (3, 3, n, m) angular velocity and its two derivatives (first axis), body axes, rad/s, rad/s^2,
            rad/s^3.
        joints: (4, J, n, m) joint angles and their three derivatives, rad, rad/s, ...
        in_body: (S, 3, n, m) sights, unit vectors in body axes.
        boresights: (S, 3, n, m) sights, inertial unit vectors.
    """

    time: np.ndarray
    attitude: np.ndarray
    spin: np.ndarray
    joints: np.ndarray
    in_body: np.ndarray
    boresights: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Views:
    """Directions that are sampled beside the boresights of the devices; none by default.

    Attributes:
        body: (b, 3) unit vectors, axes of the body that are sights.
        carrier: (v,) int, indices of the devices whose moving parts carry further sights.
        carried: (v, 3) unit vectors, these sights at zero joint angles, by components ahead, left and up of
            their device's axes (`Mountings.axes`).
        within: (k, 2) int, pairs of directions that are compared in body axes: index of a sight, and index of
            the sight that is the axis, or -1 where the axis is fixed in the body.
    """

    body: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    carrier: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    carried: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    within: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), int))

    @classmethod
    def of(cls, cones: Constraints, within: np.ndarray) -> Self:
        """Return the views of checked constraints with arrays in float64; `within` is as in `Views`."""
        return cls(
            body=cones.body / np.linalg.norm(cones.body, axis=-1, keepdims=True),
            carrier=cones.carrier.astype(int),
            carried=cones.carried / np.linalg.norm(cones.carried, axis=-1, keepdims=True),
            within=within,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Mountings:
    """How devices with joints are mounted on the body: T terminals, then D drives.

    Attributes:
        axes: (T + D, 3, 3) unit vectors in body axes as rows: ahead, left, up. Up is the axis of rotation of
            yaw or drive; ahead is the boresight at zero angles, for a drive projected onto the plane across
            its axis.
        tilts: (D,) rad, elevation of drives' boresights above the plane across their axes.
    """

    axes: np.ndarray
    tilts: np.ndarray

    @classmethod
    def of(cls, spacecraft: Spacecraft) -> Self:
        """Return the mountings of a spacecraft whose numbers have been checked."""
        axes, tilts = list[np.ndarray](), list[float]()
        for terminal in spacecraft.terminals:
            if terminal.mounting is None:
                angle = np.float64(np.nan if terminal.mount is None else terminal.mount)
                ahead = np.array([np.cos(angle), np.sin(angle), 0.0])
                axes.append(np.array([ahead, [-ahead[1], ahead[0], 0.0], [0.0, 0.0, 1.0]]))
            else:
                axes.append(_axes_and_tilt(terminal.mounting.yaw_axis, terminal.mounting.boresight)[0])
        for drive in spacecraft.drives:
            found, tilt = _axes_and_tilt(drive.axis, drive.boresight)
            axes.append(found)
            tilts.append(tilt)
        return cls(axes=np.array(axes, np.float64).reshape(-1, 3, 3), tilts=np.array(tilts, np.float64))

    def split(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split joints (J, ...) into yaws and pitches (T + D, ...); drives have yaw alone, pitch zero."""
        terminals = len(self.axes) - len(self.tilts)
        yaw, pitch, angle = np.split(joints, [terminals, 2 * terminals])
        return np.concatenate([yaw, angle]), np.concatenate([pitch, np.zeros_like(angle)])


def _axes_and_tilt(axis: np.ndarray, boresight: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the axes of a device as in `Mountings.axes`, and the tilt of its boresight.

    The rows (3, 3) are the boresight's part across the axis, the axis times it, and the axis. The tilt, rad,
    is the angle of the boresight from the plane across the axis, positive towards the axis.

    Args:
        axis: (3,) body axes, about which the device turns.
        boresight: (3,) body axes, at zero angle; not along the axis.
    """
    up = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    ahead = np.asarray(boresight, np.float64)
    level = ahead - (ahead @ up) * up
    size = np.linalg.norm(level)
    return np.array([level / size, np.cross(up, level / size), up]), float(np.arctan2(ahead @ up, size))


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Curves of platform and joints, of one trajectory or of several, with the sights they carry.

    All trajectories are of one spacecraft; their pieces are numbered one after the other, N in all.

    Attributes:
        platform: polynomials of ``b``, rad.
        joints: polynomials of the joint angles, rad.
        chart_attitude: (N, 3, 3) ``R_a``, body to inertial.
        chart_start: (N,) s, ``t_a``.
        chart_rate: (N, 3) rad/s, ``Omega``.
        mountings: those of terminals and drives.
        fixed_boresights: (i, 3) unit vectors of the instruments, body axes.
        views: directions that are sampled beside the devices' boresights.
    """

    platform: Pieces
    joints: Pieces
    chart_attitude: np.ndarray
    chart_start: np.ndarray
    chart_rate: np.ndarray
    mountings: Mountings
    fixed_boresights: np.ndarray
    views: Views = field(default_factory=Views)

    @classmethod
    def of(cls, spacecraft: Spacecraft, views: Views, *trajectories: Trajectory) -> Self:
        """Join checked trajectories in float64, all with the same number of coefficients in each piece."""
        fixed = spacecraft.fixed_boresights
        return cls(
            platform=Pieces.of(*((one.breaks, one.coefficients) for one in trajectories)),
            joints=Pieces.of(*((one.joint_breaks, one.joint_coefficients) for one in trajectories)),
            chart_attitude=np.concatenate([one.chart_attitude for one in trajectories]),
            chart_start=np.concatenate([one.chart_start for one in trajectories]),
            chart_rate=np.concatenate([one.chart_rate for one in trajectories]),
            mountings=Mountings.of(spacecraft),
            fixed_boresights=fixed / np.linalg.norm(fixed, axis=-1, keepdims=True),
            views=views,
        )

    @cached_property
    def fixed(self) -> np.ndarray:
        """(f, 3) unit vectors in body axes, all sights that are fixed in the body: instruments, then axes."""
        return np.concatenate([self.fixed_boresights, self.views.body])

    def between(self, edges: np.ndarray, trajectory: int = 0) -> Intervals:
        """Return the intervals of the trajectory of this index between edges (n + 1,) s, breaks included."""
        centre = (edges[:-1] + edges[1:]) / 2
        return Intervals(
            low=edges[:-1],
            high=edges[1:],
            piece=self.platform.holding(centre, trajectory),
            joint_piece=self.joints.holding(centre, trajectory),
            trajectory=np.full(len(centre), trajectory),
        )

    def pieces(self, ways: Sequence[Way] = ()) -> Intervals:
        """Return the longest intervals within single pieces; at least two for each trajectory.

        Args:
            ways: the moving inertial axes, only for a single trajectory.
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
        """Return jets (orders, 3, n, m) of ``eta``, rad, at times (n, m) s of n intervals; `orders` > 1."""
        eta = self.platform.taylor(on.piece, time, orders)
        rate = self.chart_rate[on.piece].T[..., None]
        eta[0] -= (time - self.chart_start[on.piece, None]) * rate
        eta[1] -= rate
        return eta

    def sample(self, on: Intervals, nodes: np.ndarray = NODES) -> Samples:
        """Sample the motion at the same places (m,) in [-1, 1] of each interval.

        It is NaN where ``eta`` or the turn of a chart is longer than `series.LARGEST_TURN`.
        """
        time = on.centre[:, None] + on.half[:, None] * nodes
        turn = self.turn(on, time, 4)
        half_chart = np.zeros_like(turn)
        half_chart[1] = self.chart_rate[on.piece].T[..., None] / 2
        half_chart[0] = (time - self.chart_start[on.piece, None]) * half_chart[1]
        both = series.quaternion(np.concatenate([turn, half_chart], axis=2).reshape(4, 3, -1))
        middle, side = np.split(both, 2, axis=2)
        relative = series.multiply(series.multiply(side, middle), side)
        rotation = series.rotation(relative[0]).reshape(3, 3, *time.shape)
        attitude = np.einsum("nij,jknm->iknm", self.chart_attitude[on.piece], rotation)
        spin = series.body_rate(relative).reshape(3, 3, *time.shape)
        joints = self.joints.taylor(on.joint_piece, time, 4)
        factorial = np.array([1, 1, 2, 6]).reshape(4, 1, 1, 1)
        in_body = self._sights_in_body(joints[0])
        boresights = np.einsum("ijnm,djnm->dinm", attitude, in_body)
        return Samples(
            time=time,
            attitude=attitude,
            spin=spin * factorial[:3],
            joints=joints * factorial,
            in_body=in_body,
            boresights=boresights / np.linalg.norm(boresights, axis=1, keepdims=True),
        )

    def _sights_in_body(self, joints: np.ndarray) -> np.ndarray:
        """Return the sights (S, 3, n, m), unit vectors in body axes, at joint angles (J, n, m) rad."""
        azimuth, elevation = self.mountings.split(joints)
        if len(self.mountings.tilts):
            elevation[-len(self.mountings.tilts) :] += self.mountings.tilts[:, None, None]
        level = np.cos(elevation)
        own = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)
        axes = self.mountings.axes
        moving = np.einsum("dcnm,dci->dinm", own, axes)
        fixed = self.fixed[..., None, None]
        seen = [moving, np.broadcast_to(fixed, (*fixed.shape[:2], *joints.shape[1:]))]
        if len(self.views.carrier):
            azimuth, elevation = azimuth[self.views.carrier], elevation[self.views.carrier]
            tilt = -np.sin(elevation)
            left = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=1)
            up = np.stack([tilt * np.cos(azimuth), tilt * np.sin(azimuth), np.cos(elevation)], axis=1)
            x, y, z = (self.views.carried[:, i, None, None, None] for i in range(3))
            further = x * own[self.views.carrier] + y * left + z * up
            seen.append(np.einsum("dcnm,dci->dinm", further, axes[self.views.carrier]))
        return np.concatenate(seen)
