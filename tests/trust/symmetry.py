"""What must not change what the certificate says: the frame, the hand, the names, the order, the pace.

Each symmetry turns a trajectory with its spacecraft and zones into another whose margins are the same; rates
and accelerations follow.
"""

from dataclasses import replace

import numpy as np
from manoeuvres import craft, judge, manoeuvre
from scipy.spatial.transform import Rotation

from jaxplan.certificate import Certificate
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.trajectory import Trajectory
from trust.verdicts import Sampler, random_zone, tuned

MIRROR = np.diag([1.0, -1.0, 1.0])
SYMMETRIES = ("frame", "mirror", "terminals", "zones", "pace")
# Bounds may differ by what the certificate leaves open, rad or a share of the margin.
SHARP, OPEN = 2e-6, 0.02

Scene = tuple[Trajectory, Spacecraft, list[KeepOut | KeepIn]]


def scene(seed: int, terminals: int = 3) -> Scene:
    """A random trajectory with two instruments, zones near its ways, one of them a group."""
    rng = np.random.default_rng([seed, 5])
    spacecraft = craft(terminals, instruments=2, joints={"yaw_limit": 3.0})
    trajectory = manoeuvre(seed, terminals=terminals, pieces=1 + seed % 3, wiggle=0.3)
    sampler, zones = Sampler(trajectory, spacecraft), []
    while len(zones) < 5:
        wanted = np.deg2rad(10 ** rng.uniform(-3, 1)) * (1 if rng.random() < 0.8 else -1)
        zone = tuned(random_zone(rng, spacecraft.device_names, len(zones)), sampler, wanted)
        if 0.01 < zone.half_angle < 3.13:
            zones.append(replace(zone, any_of="g") if isinstance(zone, KeepIn) and len(zones) > 2 else zone)
    return trajectory, spacecraft, zones


def transformed(what: str, given: Scene, rng: np.random.Generator) -> tuple[Scene, float]:
    """The other scene, and by how much slower it is."""
    trajectory, spacecraft, zones = given
    count = len(spacecraft.terminals)
    if what == "frame":
        turn = Rotation.random(rng=rng).as_matrix()
        moved = replace(trajectory, chart_attitude=turn @ trajectory.chart_attitude)
        return (moved, spacecraft, [replace(z, direction=turn @ z.direction) for z in zones]), 1.0
    if what == "mirror":  # vectors are reflected, rotation vectors are pseudovectors
        hand = np.concatenate([-np.ones(count), np.ones(count)])
        moved = replace(
            trajectory,
            chart_attitude=MIRROR @ trajectory.chart_attitude @ MIRROR,
            chart_rate=-trajectory.chart_rate @ MIRROR,
            coefficients=-trajectory.coefficients @ MIRROR,
            joint_coefficients=trajectory.joint_coefficients * hand,
        )
        other = replace(
            spacecraft,
            terminals=tuple(replace(t, mount=-t.mount) for t in spacecraft.terminals),
            instruments=tuple(replace(i, boresight=MIRROR @ i.boresight) for i in spacecraft.instruments),
        )
        return (moved, other, [replace(z, direction=MIRROR @ z.direction) for z in zones]), 1.0
    if what == "terminals":
        order = rng.permutation(count)
        columns = np.concatenate([order, order + count])
        moved = replace(trajectory, joint_coefficients=trajectory.joint_coefficients[:, :, columns])
        other = replace(spacecraft, terminals=tuple(spacecraft.terminals[i] for i in order))
        return (moved, other, zones), 1.0
    if what == "zones":
        return (trajectory, spacecraft, [zones[i] for i in rng.permutation(len(zones))]), 1.0
    slower = 2.0 ** rng.uniform(-2, 2)
    times = ("breaks", "chart_start", "joint_breaks", "node_times")
    moved = replace(
        trajectory,
        chart_rate=trajectory.chart_rate / slower,
        **{name: getattr(trajectory, name) * slower for name in times},
    )
    return (moved, spacecraft, zones), slower


def compare(what: str, first: Certificate, second: Certificate, slower: float) -> None:
    """Two reports say the same."""
    near = SHARP + OPEN * abs(first.min_margin)
    assert abs(first.min_margin - second.min_margin) <= near, (what, first.min_margin, second.min_margin)
    assert first.certified == second.certified, (what, first.faults, second.faults)
    if abs(first.min_margin) > 1e-4:
        assert (first.worst_zone, first.worst_device) == (second.worst_zone, second.worst_device), what
    powers = {"angular_velocity": 1, "joint_rates": 1, "angular_acceleration": 2, "joint_accelerations": 2}
    assert first.peaks.keys() == second.peaks.keys()
    for name, peak in first.peaks.items():
        scaled = peak / slower ** powers.get(name, 0)
        assert abs(scaled - second.peaks[name]) <= 1e-5 + 1e-4 * scaled, (what, name)


def attempt(seed: int) -> None:
    """Every symmetry of one scene."""
    given = scene(seed)
    first = judge(*given)
    for number, what in enumerate(SYMMETRIES):
        other, slower = transformed(what, given, np.random.default_rng([seed, 6, number]))
        compare(what, first, judge(*other), slower)
