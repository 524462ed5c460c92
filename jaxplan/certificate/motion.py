"""Motion of platform, joints and moving axes, computed anew for the certificate from their definition.

**Trajectories.** Conventions. ``R`` maps body to inertial, angular velocities are in body axes, joints are
all yaws, all pitches and all angles of drives (J = 2T + D), sights the boresights of terminals, drives and
instruments, axes of the body, and vectors of moving parts (S). On a piece (equation 25, corrected)

    R(t) = R_a U exp(eta^) U,   U = exp((t - t_a) Omega^ / 2),   eta(t) = b(t) - (t - t_a) Omega,

with ``b`` and the joints polynomials. Of the trajectory's making nothing else is used: the angular velocity
and its derivatives are those of the quaternion of ``R``. In its own axes (`Mountings`) a terminal points
along ``v(yaw, pitch)`` of equation (13); what is left of that and above it turns with it. A drive has a yaw
alone, and a pitch that stays as it is.

The motion is sampled on intervals, each within one piece of the platform and one of the joints, at `NODES`,
which include both ends; so what lies left and right of a break is there to be compared. Trajectories of one
spacecraft are evaluated together, their intervals one after the other. What is found on an interval is, to
the last bit, the same whichever others there are, as long as there are others: over a single one numpy sums
in another order. So every trajectory is cut in two at least.

**Axes that move** (*ways*) are ``e = s / |s|``, with ``s`` the cubic between two samples of the given slopes
there. The majorant of ``e`` on an interval (see `series`) is that of ``s`` times that of ``q^(-1/2)`` with
``q = |s|^2``: where ``q`` is at least ``l`` on the interval, and ``Q`` is a majorant of it without its
constant term, ``(l - Q)^(-1/2)`` is one.
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
    """A trajectory as the certificate reads it: N pieces of the platform, M of the joints."""

    @property
    def breaks(self) -> np.ndarray:
        """(N + 1,) s, ends of the platform's pieces, from 0 to the duration."""

    @property
    def chart_attitude(self) -> np.ndarray:
        """(N, 3, 3) ``R_a``, body to inertial."""

    @property
    def chart_start(self) -> np.ndarray:
        """(N,) s, ``t_a``."""

    @property
    def chart_rate(self) -> np.ndarray:
        """(N, 3) rad/s, ``Omega``."""

    @property
    def coefficients(self) -> np.ndarray:
        """(N, p + 1, 3) rad, Legendre coefficients of ``b``."""

    @property
    def joint_breaks(self) -> np.ndarray:
        """(M + 1,) s, ends of the joints' pieces."""

    @property
    def joint_coefficients(self) -> np.ndarray:
        """(M, p + 1, J) rad, Legendre coefficients of the joints."""

    @property
    def smoothness(self) -> int:
        """How many derivatives by time are claimed to be continuous at all breaks, which is to be proved."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """A moving inertial axis as a function of time, a normalised cubic spline.

    Attributes:
        breaks: (n,) s, ends of its pieces.
        cubics: (4, 3, n - 1) Taylor coefficients of ``s`` on each piece about its start.
    """

    breaks: np.ndarray
    cubics: np.ndarray

    @classmethod
    def of(cls, path: DirectionPath) -> Self:
        """The axis of a path, whose numbers must be finite and whose times rise."""
        times, p, m = (np.asarray(part, np.float64) for part in (path.times, path.samples, path.slopes))
        h = np.diff(times)[:, None]
        chord = np.diff(p, axis=0) / h
        square, cube = (3 * chord - 2 * m[:-1] - m[1:]) / h, (m[:-1] + m[1:] - 2 * chord) / h**2
        return cls(breaks=times, cubics=np.moveaxis(np.stack([p[:-1], m[:-1], square, cube]), 1, 2))

    def holding(self, time: np.ndarray) -> np.ndarray:
        """Numbers (n,) of the pieces that hold at times (n,) s; at a break the later one."""
        return np.clip(np.searchsorted(self.breaks, time, side="right") - 1, 0, len(self.breaks) - 2)

    def at(self, piece: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Unit vectors (3, n, m) at times (n, m) s of some pieces (n,)."""
        value = self._taylor(piece, time)[0]
        return value / np.linalg.norm(value, axis=0)

    def majorant(self, centre: np.ndarray, half: np.ndarray, orders: int) -> np.ndarray:
        """Majorant (orders, n) on intervals within pieces, in the unit of half widths; one at order zero.

        Args:
            centre: (n,) s, of the intervals.
            half: (n,) s, their half widths.
            orders: number of orders to return.
        """
        cubic = self._cubic(centre, half)
        padded = np.concatenate([cubic, np.zeros((3, *cubic.shape[1:]))])
        square = series.product("in,in->n", padded, padded)  # of degree 6
        least = square[0] - np.abs(square[1:]).sum(axis=0)
        inverse = _inverse_root(np.where(least > 0, least, np.nan), series.majorant(np.abs(square), orders))
        found = series.product("n,n->n", series.majorant(np.linalg.norm(cubic, axis=1), orders), inverse)
        found[0] = 1
        return found

    def rounding(self, centre: np.ndarray, half: np.ndarray) -> np.ndarray:
        """Sizes (n,) of the rounding errors of `at` on intervals of centres (n,) and half widths (n,), s."""
        return ROUNDING * (1 + np.linalg.norm(self._cubic(centre, half), axis=1).sum(axis=0))

    def _cubic(self, centre: np.ndarray, half: np.ndarray) -> np.ndarray:
        """Taylor coefficients (4, 3, n) of ``s`` about centres (n,) s, in the unit of half widths (n,) s."""
        about = self._taylor(self.holding(centre), centre[:, None])[..., 0]
        return about * half ** np.arange(4)[:, None, None]

    def _taylor(self, piece: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Taylor coefficients (4, 3, n, m) of ``s`` about times (n, m) s, on pieces (n,) by number."""
        x = time - self.breaks[piece, None]
        a, b, c, d = self.cubics[:, :, piece, None]
        return np.stack(
            [a + x * (b + x * (c + x * d)), b + x * (2 * c + 3 * x * d), c + 3 * x * d, d + 0 * x]
        )


def _inverse_root(least: np.ndarray, majorant: np.ndarray) -> np.ndarray:
    """Series (orders, n) of ``(least - Q)^(-1/2)``, ``Q`` the majorant (orders, n) without constant term."""
    result = np.empty_like(majorant)
    result[0] = least**-0.5
    for k in range(1, len(majorant)):
        terms = [(k - i / 2) * majorant[i] * result[k - i] for i in range(1, k + 1)]
        result[k] = np.sum(terms, axis=0) / (k * least)
    return result


def places(sizes: np.ndarray) -> np.ndarray:
    """The ranges ``0 .. size - 1`` of sizes (k,), one after the other: (sum of sizes,)."""
    return np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)


@dataclass(frozen=True, kw_only=True, eq=False)
class Intervals:
    """Intervals of time with the pieces that hold on them, those of a trajectory in the order of time.

    Attributes:
        low: (n,) s, where each begins.
        high: (n,) s, where it ends.
        piece: (n,) number of the platform's piece.
        joint_piece: (n,) number of the joints' piece.
        trajectory: (n,) number of the trajectory, rising.
    """

    low: np.ndarray
    high: np.ndarray
    piece: np.ndarray
    joint_piece: np.ndarray
    trajectory: np.ndarray

    @cached_property
    def centre(self) -> np.ndarray:
        """(n,) s, middles."""
        return (self.low + self.high) / 2

    @cached_property
    def half(self) -> np.ndarray:
        """(n,) s, half widths."""
        return (self.high - self.low) / 2

    @cached_property
    def begins(self) -> np.ndarray:
        """(trajectories + 1,) number of the first interval of each trajectory, and n."""
        return np.searchsorted(self.trajectory, np.arange(self.trajectory[-1] + 2))

    @classmethod
    def joined(cls, several: Sequence[Self]) -> Self:
        """The intervals of several trajectories, one after the other."""
        names = [each.name for each in fields(cls)]
        return cls(**{name: np.concatenate([getattr(on, name) for on in several]) for name in names})

    def cut(self, parts: np.ndarray) -> Self:
        """The intervals, each cut into a number of equal parts, `parts` (n,) int."""
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
        attitude: (3, 3, n, m) body to inertial.
        spin: (3, 3, n, m) angular velocity and its two derivatives (first axis), rad/s, rad/s^2, rad/s^3.
        joints: (4, J, n, m) joints and their three derivatives, rad, rad/s, ...
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
    """Directions that are sampled beside the inertial boresights of the devices; none by default.

    Attributes:
        body: (b, 3) unit vectors, axes of the body that are sights.
        carrier: (v,) int, the devices whose moving parts carry further sights.
        carried: (v, 3) unit vectors, these sights at no angles: ahead, to the left, and up.
        within: (k, 2) int, pairs whose scalar products are taken in body axes: a sight, and the sight that is
            the axis, or -1 for axes of the body.
    """

    body: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    carrier: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    carried: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    within: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), int))

    @classmethod
    def of(cls, cones: Constraints, within: np.ndarray) -> Self:
        """The views of checked constraints with arrays in float64, and of pairs `within` as above."""
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
        axes: (T + D, 3, 3) unit vectors in body axes, rows: where a terminal points at no angles, or across a
            drive's axis; what is to the left of that; the axis of the yaw.
        tilts: (D,) rad, of drives' boresights above the plane across their axes.
    """

    axes: np.ndarray
    tilts: np.ndarray

    @classmethod
    def of(cls, spacecraft: Spacecraft) -> Self:
        """The mountings of a spacecraft whose numbers have been checked."""
        axes, tilts = list[np.ndarray](), list[float]()
        for terminal in spacecraft.terminals:
            if terminal.mounting is None:
                angle = np.float64(np.nan if terminal.mount is None else terminal.mount)
                ahead = np.array([np.cos(angle), np.sin(angle), 0.0])
                axes.append(np.array([ahead, [-ahead[1], ahead[0], 0.0], [0.0, 0.0, 1.0]]))
            else:
                axes.append(_axes(terminal.mounting.yaw_axis, terminal.mounting.boresight)[0])
        for drive in spacecraft.drives:
            found, tilt = _axes(drive.axis, drive.boresight)
            axes.append(found)
            tilts.append(tilt)
        return cls(axes=np.array(axes, np.float64).reshape(-1, 3, 3), tilts=np.array(tilts, np.float64))

    def split(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Yaws and pitches (T + D, ...) of devices, from joints (J, ...); of a drive its angle and zero."""
        terminals = len(self.axes) - len(self.tilts)
        yaw, pitch, angle = np.split(joints, [terminals, 2 * terminals])
        return np.concatenate([yaw, angle]), np.concatenate([pitch, np.zeros_like(angle)])


def _axes(axis: np.ndarray, boresight: np.ndarray) -> tuple[np.ndarray, float]:
    """Axes (3, 3) of a device, as rows of `Mountings.axes`, and its boresight's tilt, rad.

    `axis`, about which the device turns, and `boresight` are (3,), body axes.
    """
    up = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    ahead = np.asarray(boresight, np.float64)
    level = ahead - (ahead @ up) * up
    size = np.linalg.norm(level)
    return np.array([level / size, np.cross(up, level / size), up]), float(np.arctan2(ahead @ up, size))


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Curves of the platform and the joints, of one trajectory or of several, with the sights they carry.

    Attributes:
        platform: polynomials of ``b``, rad.
        joints: polynomials of the joints, rad.
        chart_attitude: (N, 3, 3) ``R_a``.
        chart_start: (N,) s, ``t_a``.
        chart_rate: (N, 3) rad/s, ``Omega``.
        mountings: of terminals and drives.
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
        """The motion of checked trajectories in float64, all of the same number of coefficients a piece."""
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
        """(f, 3) unit vectors, all sights that are fixed in the body."""
        return np.concatenate([self.fixed_boresights, self.views.body])

    def between(self, edges: np.ndarray, trajectory: int = 0) -> Intervals:
        """The intervals of a trajectory, by number, between edges (n + 1,) s, its breaks among them."""
        centre = (edges[:-1] + edges[1:]) / 2
        return Intervals(
            low=edges[:-1],
            high=edges[1:],
            piece=self.platform.holding(centre, trajectory),
            joint_piece=self.joints.holding(centre, trajectory),
            trajectory=np.full(len(centre), trajectory),
        )

    def pieces(self, ways: Sequence[Way] = ()) -> Intervals:
        """The longest intervals on which no piece changes, those of ways included; two a trajectory at least.

        Args:
            ways: zones' axes that move, where there is a single trajectory.
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
        """Jets (orders, 3, n, m) of ``eta``, rad, at times (n, m) s of n intervals; at least two orders."""
        eta = self.platform.taylor(on.piece, time, orders)
        rate = self.chart_rate[on.piece].T[..., None]
        eta[0] -= (time - self.chart_start[on.piece, None]) * rate
        eta[1] -= rate
        return eta

    def sample(self, on: Intervals, nodes: np.ndarray = NODES) -> Samples:
        """The motion at the same places (m,) in [-1, 1] of each interval.

        Where a chart turns by more than `series.LARGEST_TURN` it is NaN.
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
        in_body = self._in_body(joints[0])
        boresights = np.einsum("ijnm,djnm->dinm", attitude, in_body)
        return Samples(
            time=time,
            attitude=attitude,
            spin=spin * factorial[:3],
            joints=joints * factorial,
            in_body=in_body,
            boresights=boresights / np.linalg.norm(boresights, axis=1, keepdims=True),
        )

    def _in_body(self, joints: np.ndarray) -> np.ndarray:
        """Sights (S, 3, n, m), unit vectors in body axes, at joints (J, n, m) rad."""
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
