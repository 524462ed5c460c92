"""Random manoeuvres for the tests of the certificate, and their samples by scipy and by differences.

`attitudes_of`, `joints_of`, `boresights_of`, `spin_of` and `zone_margins` evaluate a trajectory from its
definition and share nothing with the package.
"""

from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from scipy.interpolate import BPoly
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from jaxplan.certificate import EndState, certify
from jaxplan.model.spacecraft import Instrument, Spacecraft, Terminal
from jaxplan.model.zones import KeepIn, KeepOut, tabulate
from jaxplan.trajectory.curve import Trajectory

# Weights of the values at -4 h ... 4 h for the first and the second derivative, of order 8.
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])


def craft(terminals=3, instruments=1, **limits):
    """A spacecraft with wide limits, but for those given; `joints` holds those of the terminals."""
    joints = {"yaw_limit": 9.0, "pitch_limit": 9.0, "rate_limit": 9.0, "acceleration_limit": 9.0}
    joints |= limits.pop("joints", {})
    boresights = np.random.default_rng(5).normal(size=(instruments, 3))
    boresights /= np.linalg.norm(boresights, axis=1, keepdims=True)
    return Spacecraft(
        terminals=tuple(
            Terminal(name=f"terminal-{i}", mount=2.1 * i - 1, **joints) for i in range(terminals)
        ),
        instruments=tuple(Instrument(name=f"instrument-{i}", boresight=b) for i, b in enumerate(boresights)),
        **({"rate_limit": 9.0, "acceleration_limit": 9.0} | limits),
    )


def polynomial(rng, first, last, half, wiggle):
    """Legendre coefficients (13, c) of a random curve with given states (3, c) at both ends.

    A state is value, rate and acceleration.
    """
    units = half ** np.arange(3)[:, None]
    base = BPoly.from_derivatives([-1, 1], [np.asarray(first) * units, np.asarray(last) * units])
    x, weights = legendre.leggauss(13)
    noise = wiggle * rng.normal(size=(7, np.shape(first)[1])) / np.arange(1, 8)[:, None]
    values = base(x) + (1 - x * x)[:, None] ** 3 * (legendre.legvander(x, 6) @ noise)
    return (np.arange(13) + 0.5)[:, None] * (legendre.legvander(x, 12).T * weights) @ values


def manoeuvre(seed, *, pieces=3, joint_pieces=2, terminals=3, duration=80.0, wiggle=0.1, step=0.4):
    """A random trajectory from rest to rest, twice continuously differentiable, a chart for each piece."""
    rng = np.random.default_rng(seed)

    def knots(count, components, half):
        """Random values, rates and accelerations (count + 1, 3, c) at knots, with rest at both ends."""
        states = rng.normal(size=(count + 1, 3, components)) * step / half ** np.arange(3)[:, None] / 2
        states[[0, -1], 1:] = 0
        return states

    half = duration / pieces / 2
    turns = rng.normal(size=(pieces, 3)) * step
    attitudes = [Rotation.random(random_state=seed)]
    for turn in turns:
        attitudes.append(attitudes[-1] * Rotation.from_rotvec(turn))
    states = knots(pieces, 3, half)
    coefficients = []
    for turn, left, right in zip(turns, states[:-1], states[1:], strict=True):
        # At the end of a chart the angular velocity and acceleration are W b' and W b'', W = exp(-turn / 2).
        ahead = Rotation.from_rotvec(turn / 2)
        first, last = [np.zeros(3), left[1], left[2]], [turn, ahead.apply(right[1]), ahead.apply(right[2])]
        coefficients.append(polynomial(rng, first, last, half, wiggle))
    joint_half = duration / joint_pieces / 2
    knot = knots(joint_pieces, 2 * terminals, joint_half)
    pairs = pairwise(knot)
    breaks = np.linspace(0, duration, pieces + 1)
    return Trajectory(
        breaks=breaks,
        chart_attitude=np.stack([a.as_matrix() for a in attitudes[:-1]]),
        chart_start=breaks[:-1],
        chart_rate=turns / (2 * half),
        coefficients=np.stack(coefficients),
        joint_breaks=np.linspace(0, duration, joint_pieces + 1),
        joint_coefficients=np.stack([polynomial(rng, a, b, joint_half, wiggle) for a, b in pairs]),
        node_times=breaks,
        smoothness=2,
        method="random",
    )


def attitudes_of(trajectory, time, piece):
    """Attitudes (k, 3, 3) from the definition of the curve; each piece also beyond its own interval."""
    first, last = trajectory.breaks[piece], trajectory.breaks[piece + 1]
    x = 2 * (time - first) / (last - first) - 1
    coefficients = trajectory.coefficients[piece]
    b = np.einsum("kj,kjc->kc", legendre.legvander(x, coefficients.shape[1] - 1), coefficients)
    chart = (time - trajectory.chart_start[piece])[:, None] * trajectory.chart_rate[piece]
    half, base = Rotation.from_rotvec(chart / 2), Rotation.from_matrix(trajectory.chart_attitude[piece])
    return (base * half * Rotation.from_rotvec(b - chart) * half).as_matrix()


def joints_of(trajectory, time, orders=3):
    """Joints, rates and accelerations (3, k, 2T), or as many of these as are asked for."""
    breaks = trajectory.joint_breaks
    piece = holding(breaks, time)
    length = (breaks[piece + 1] - breaks[piece])[:, None]
    x = 2 * (time - breaks[piece]) / length[:, 0] - 1
    curves = []
    for order in range(orders):
        coefficients = legendre.legder(trajectory.joint_coefficients, order, axis=1)[piece]
        basis = legendre.legvander(x, coefficients.shape[1] - 1)
        curves.append(np.einsum("kj,kjc->kc", basis, coefficients) * (2 / length) ** order)
    return np.stack(curves)


def holding(breaks, time):
    return np.clip(np.searchsorted(breaks, time, side="right") - 1, 0, len(breaks) - 2)


def boresights_of(trajectory, spacecraft, time):
    """Directions of all devices (k, D, 3)."""
    azimuth, elevation = np.split(joints_of(trajectory, time, orders=1)[0], 2, axis=1)
    azimuth = azimuth + spacecraft.mounts
    level = np.cos(elevation)
    moving = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)
    fixed = np.broadcast_to(spacecraft.fixed_boresights, (len(time), len(spacecraft.instruments), 3))
    attitude = attitudes_of(trajectory, time, holding(trajectory.breaks, time))
    return np.concatenate([moving, fixed], axis=1) @ np.swapaxes(attitude, 1, 2)


def spin_of(trajectory, time):
    """Angular velocity, acceleration and jerk (3, k, 3), body axes, by differences of attitudes."""
    step = 0.005 * np.diff(trajectory.breaks).min()
    piece = holding(trajectory.breaks, time)
    stencil = np.stack([attitudes_of(trajectory, time + i * step, piece) for i in range(-8, 9)])

    def antisymmetric(weights):
        """Of R^T R' and R^T R'': the angular velocity and its derivative, at -4 h ... 4 h."""
        slopes = np.stack([np.tensordot(weights, stencil[i : i + 9], 1) for i in range(9)])
        m = np.swapaxes(stencil[4:-4], -1, -2) @ slopes
        return np.stack([m[..., i, j] - m[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1) / 2

    acceleration = antisymmetric(SECOND / step**2)
    jerk = np.tensordot(FIRST / step, acceleration, 1)
    return np.stack([antisymmetric(FIRST / step)[4], acceleration[4], jerk])


def zone_margins(trajectory, spacecraft, zones, time):
    """Margin of each zone's worst device (zones, k)."""
    boresights = boresights_of(trajectory, spacecraft, time)
    rows = []
    for zone in zones:
        sine = np.linalg.norm(np.cross(boresights, zone.direction), axis=-1)
        clear = np.arctan2(sine, boresights @ zone.direction) - zone.half_angle
        names = zone.devices or spacecraft.device_names
        bound = [name in names for name in spacecraft.device_names]
        rows.append(np.min((clear if isinstance(zone, KeepOut) else -clear)[:, bound], axis=1))
    return np.array(rows)


def grid(trajectory, count=4001):
    """Times, with each break and the time just before it."""
    breaks = trajectory.breaks
    return np.unique(np.concatenate([np.linspace(0, breaks[-1], count), breaks, breaks[1:-1] - 1e-9]))


def closest(trajectory, spacecraft, device, direction):
    """Least angle of a device to a direction, to rounding, and when."""
    index = spacecraft.device_names.index(device)

    def angle(time):
        boresight = boresights_of(trajectory, spacecraft, np.atleast_1d(time))[:, index]
        return np.arctan2(np.linalg.norm(np.cross(boresight, direction), axis=-1), boresight @ direction)

    time = grid(trajectory)
    sampled = angle(time)
    padded = np.pad(sampled, 1, constant_values=np.inf)
    dips = np.flatnonzero((sampled <= padded[:-2]) & (sampled <= padded[2:]))
    found = []
    for dip in dips[np.argsort(sampled[dips])][:4]:  # samples may see a shallower one as the deepest
        around = time[max(dip - 1, 0)], time[min(dip + 1, len(time) - 1)]
        least = minimize_scalar(
            lambda t: angle(t)[0], bounds=around, method="bounded", options={"xatol": 1e-9}
        )
        found.append((min(float(least.fun), float(sampled[dip])), float(least.x)))
    return min(found)


def ends(trajectory, spacecraft):
    """The states that a trajectory really starts and ends in, at rest."""
    time = trajectory.breaks[[0, -1]]
    attitudes, joints = (
        attitudes_of(trajectory, time, holding(trajectory.breaks, time)),
        joints_of(trajectory, time)[0],
    )
    return {
        name: EndState(attitude=attitudes[i], joints=joints[i]) for name, i in (("start", 0), ("goal", -1))
    }


def judge(trajectory, spacecraft, zones=(), **changes):
    """The certificate's report, with the trajectory's own ends unless others are given."""
    keep_out = [z for z in zones if isinstance(z, KeepOut)]
    keep_in = [z for z in zones if isinstance(z, KeepIn)]
    cones = tabulate(keep_out, keep_in, spacecraft.device_names)
    names = [z.name for z in (*keep_out, *keep_in)]
    return certify(
        trajectory, spacecraft, cones, zone_names=names, **(ends(trajectory, spacecraft) | changes)
    )


def unit(rng, *shape):
    vectors = rng.normal(size=(*shape, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
