"""Trajectories made to dip into a zone for a microsecond, in the form in which trajectories are kept.

A device swings slowly past a zone and keeps a margin ``standing`` at its nearest. At that instant a
polynomial piece of the length of the dip is put in, whose two first derivatives join: there the device goes
``depth`` deeper and comes back. The least margin is known exactly, ``standing - depth``, and no grid of
samples sees it. The same with a shallower dip is a twin that is to be certified, so it is the dip that is
refused and not the odd piece.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from manoeuvres import closest, craft, grid, judge, manoeuvre
from numpy.polynomial import Polynomial, legendre
from reference import boresights_of, direction, random_units, zone_margins
from scipy.spatial.transform import Rotation

from jaxplan.certificate import MARGIN_ALLOWANCE
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.trajectory import Trajectory

KINDS = ("platform", "joint", "needle")
DURATION = 40.0
# 1 - (1 - x^2)^3 rests at both ends, and touches 0 in the middle; the bump is the rest of it.
SWING = 1 - Polynomial([1, 0, -1]) ** 3
BUMP = Polynomial([1, 0, -1]) ** 3
# Microseconds of such a depth take accelerations that no spacecraft has; zones alone shall decide.
FAST = {"rate_limit": 1e9, "acceleration_limit": 1e30}


@dataclass(frozen=True, kw_only=True)
class Dip:
    """A trajectory with its zone.

    Attributes:
        trajectory: the motion.
        spacecraft: its devices.
        zone: that it dips into, or nearly so.
        least: the least margin, rad.
        slack: how far the bound may be below, rad.
    """

    trajectory: Trajectory
    spacecraft: Spacecraft
    zone: KeepOut | KeepIn
    least: float
    slack: float


def swung(breaks: np.ndarray, swing: float, depth: float) -> np.ndarray:
    """Legendre coefficients (3, 7) of the swing with the dip in the middle piece."""
    rows = []
    for number, (first, last) in enumerate(pairwise(breaks)):
        inner = Polynomial([(first + last) / DURATION - 1, (last - first) / DURATION])
        curve = -swing * SWING(inner) + (depth * BUMP if number == 1 else 0)
        rows.append(legendre.poly2leg(np.pad(curve.coef, (0, 7 - len(curve.coef)))))
    return np.array(rows)


def make(seed: int, kind: str, *, broken: bool) -> Dip:
    """A dip of a seed; its twin that keeps clear where it is not to be broken."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    if kind == "needle":
        return needle(rng, broken)
    length = 10.0 ** rng.uniform(-6, -3) if rng.random() < 0.5 else 1e-6
    breaks = DURATION / 2 * np.array([0, 1, 1, 2]) + length / 2 * np.array([0, -1, 1, 0])
    standing = 10.0 ** rng.uniform(-7, -4.5)
    depth = standing + 10.0 ** rng.uniform(-8, -4.5) if broken else standing / 2
    coefficients = swung(breaks, rng.uniform(0.05, 0.6), depth)
    spacecraft = craft(1, 1, joints=FAST, **FAST)
    attitude = Rotation.random(rng=rng)
    pitch = rng.uniform(-0.5, 0.5)
    joints = np.zeros((3, 7, 2))
    joints[:, 0] = rng.uniform(-1, 1), pitch
    platform = np.zeros((3, 7, 3))
    half_angle = rng.uniform(0.05, 1.0)
    beyond = half_angle + standing
    if kind == "platform":
        boresight = np.array(spacecraft.fixed_boresights[0])  # scipy wants it writable
        axis = np.cross(boresight, random_units(rng))
        axis /= np.linalg.norm(axis)
        platform[:] = coefficients[:, :, None] * axis
        toward = (attitude * Rotation.from_rotvec(beyond * axis)).apply(boresight)
        device = spacecraft.instruments[0].name
    else:
        joints[:, :, 1] += coefficients
        azimuth = joints[0, 0, 0] + spacecraft.terminals[0].mount
        toward = attitude.apply(direction(azimuth, pitch + beyond))
        device = spacecraft.terminals[0].name
    zone: KeepOut | KeepIn = KeepOut(name="z", direction=toward, half_angle=half_angle, devices=(device,))
    if rng.random() < 0.5:  # the outside of the opposite cone is the same
        zone = KeepIn(name="z", direction=-toward, half_angle=np.pi - half_angle, devices=(device,))
    trajectory = Trajectory(
        breaks=breaks,
        chart_attitude=np.repeat(attitude.as_matrix()[None], 3, axis=0),
        chart_start=np.zeros(3),
        chart_rate=np.zeros((3, 3)),
        coefficients=platform,
        joint_breaks=breaks,
        joint_coefficients=joints,
        node_times=breaks[[0, -1]],
        smoothness=1,  # a second derivative over microseconds is known to few digits
        method="dip",
    )
    slack = 0.05 * abs(standing - depth) + 1e-10
    return Dip(trajectory=trajectory, spacecraft=spacecraft, zone=zone, least=standing - depth, slack=slack)


def needle(rng: np.random.Generator, broken: bool) -> Dip:
    """A zone hardly wider than a point, hit or missed by a device that passes at some speed."""
    spacecraft = craft(1, instruments=0)
    trajectory = manoeuvre(int(rng.integers(2**31)), terminals=1)
    times = rng.uniform(20, 60) + np.array([-1e-3, 0])
    before, at = boresights_of(trajectory, spacecraft, times)[:, 0]
    sideways = np.cross(at, at - before)
    distance = 10.0 ** rng.uniform(-5, -3)
    direction = np.cos(distance) * at + np.sin(distance) * sideways / np.linalg.norm(sideways)
    nearest, _ = closest(trajectory, spacecraft, "terminal-0", direction)
    least = -(10.0 ** rng.uniform(np.log10(3e-9), -8)) if broken else 10.0 ** rng.uniform(-8, -7)
    zone = KeepOut(name="z", direction=direction, half_angle=nearest - least, devices=("terminal-0",))
    return Dip(
        trajectory=trajectory, spacecraft=spacecraft, zone=zone, least=least, slack=0.1 * abs(least) + 3e-10
    )


def attempt(seed: int) -> str:
    """A dip of each kind is refused with its depth, and its twin certified."""
    for kind in KINDS:
        dip = make(seed, kind, broken=True)
        report = judge(dip.trajectory, dip.spacecraft, [dip.zone])
        assert not report.certified, f"{kind}: a dip of {-dip.least:g} rad passes"
        assert dip.least < -MARGIN_ALLOWANCE
        assert abs(report.min_margin - dip.least) <= dip.slack, (kind, report.min_margin, dip.least)
        if kind != "needle":
            samples = zone_margins(dip.trajectory, dip.spacecraft, [dip.zone], grid_beside(dip.trajectory))
            np.testing.assert_array_less(0, samples, err_msg="samples see it too")
        twin = make(seed, kind, broken=False)
        report = judge(twin.trajectory, twin.spacecraft, [twin.zone])
        assert report.certified, (kind, report.faults)
        assert twin.least - twin.slack <= report.min_margin <= twin.least + twin.slack
    return "refused, and their twins certified"


def grid_beside(trajectory: Trajectory) -> np.ndarray:
    """Four thousand samples, none of which falls into a piece that is shorter than their distance."""
    breaks, times = trajectory.breaks, grid(trajectory)
    short = np.diff(breaks) < 1e-2
    inside = [(times >= a) & (times <= b) for a, b in zip(breaks[:-1][short], breaks[1:][short], strict=True)]
    return times[~np.any(inside, axis=0)] if inside else times
