"""Random manoeuvres for the tests of the certificate, and what it says of them."""

from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from reference import angle, attitudes_of, boresights_of, joints_of, random_units
from scipy.interpolate import BPoly
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from jaxplan.certificate import Claim, EndState, certify
from jaxplan.model.devices import Instrument, Terminal
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.trajectory.curve import Trajectory


def craft(terminals=3, instruments=1, **limits):
    """A spacecraft with wide limits, but for those given; `joints` holds those of the terminals."""
    joints = {"yaw_limit": 9.0, "pitch_limit": 9.0, "rate_limit": 9.0, "acceleration_limit": 9.0}
    joints |= limits.pop("joints", {})
    boresights = random_units(np.random.default_rng(5), instruments)
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


def manoeuvre(seed, *, pieces=3, joint_pieces=2, terminals=3, drives=0, duration=80.0, wiggle=0.1, step=0.4):
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
    knot = knots(joint_pieces, 2 * terminals + drives, joint_half)
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
        method="global",
    )


def grid(trajectory, count=4001):
    """Times, with each break and the time just before it."""
    breaks = trajectory.breaks
    return np.unique(np.concatenate([np.linspace(0, breaks[-1], count), breaks, breaks[1:-1] - 1e-9]))


def closest(trajectory, spacecraft, device, direction):
    """Least angle of a device to a direction, to rounding, and when."""
    index = spacecraft.device_names.index(device)
    return least(trajectory, lambda t: angle(boresights_of(trajectory, spacecraft, t)[:, index], direction))


def least(trajectory, value):
    """Least value of a function of times (k,) over a trajectory, to rounding, and when."""
    time = grid(trajectory)
    sampled = value(time)
    padded = np.pad(sampled, 1, constant_values=np.inf)
    dips = np.flatnonzero((sampled <= padded[:-2]) & (sampled <= padded[2:]))
    found = []
    for dip in dips[np.argsort(sampled[dips])][:4]:  # samples may see a shallower one as the deepest
        around = time[max(dip - 1, 0)], time[min(dip + 1, len(time) - 1)]
        fine = minimize_scalar(
            lambda t: value(np.array([t]))[0], bounds=around, method="bounded", options={"xatol": 1e-9}
        )
        found.append((min(float(fine.fun), float(sampled[dip])), float(fine.x)))
    return min(found)


def ends(trajectory, spacecraft):
    """The states that a trajectory really starts and ends in, at rest."""
    time = trajectory.breaks[[0, -1]]
    attitudes, joints = attitudes_of(trajectory, time), joints_of(trajectory, time)[0]
    return {
        name: EndState(attitude=attitudes[i], joints=joints[i]) for name, i in (("start", 0), ("goal", -1))
    }


def claimed(trajectory, spacecraft, cones, **asked):
    """The claim that a trajectory keeps what is asked."""
    return Claim(trajectory=trajectory, spacecraft=spacecraft, cones=cones, **asked)


def judge(trajectory, spacecraft, zones=(), **changes):
    """The certificate's report, with the trajectory's own ends unless others are given."""
    keep_out = [z for z in zones if isinstance(z, KeepOut)]
    keep_in = [z for z in zones if isinstance(z, KeepIn)]
    cones = tabulate(keep_out, keep_in, spacecraft)
    names = [z.name for z in (*keep_out, *keep_in)]
    asked = ends(trajectory, spacecraft) | changes
    return certify(claimed(trajectory, spacecraft, cones, zone_names=names, **asked))
