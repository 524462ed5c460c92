"""Trajectories certified together: what is said of each is what is said of it alone, to the last bit."""

from dataclasses import replace

import numpy as np
import pytest
from manoeuvres import craft, ends, manoeuvre
from reference import random_units

from jaxplan.certificate import Claim, bounds, certify_batch, proof
from jaxplan.model.directions import DirectionPath
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut

LIMITED = {"rate_limit": 0.05, "acceleration_limit": 0.01, "jerk_limit": 0.01}
HEAVY = {"inertia": np.diag([120.0, 80.0, 150.0]), "torque_limit": 0.5, "wheel_momentum_limit": 4.0}


def zones_of(rng, names, groups):
    """Keep-out zones, a keep-in zone, and perhaps a group of two."""
    out = [
        KeepOut(
            name=f"out-{i}", direction=random_units(rng), half_angle=angle, devices=(names[i % len(names)],)
        )
        for i, angle in enumerate(rng.uniform(0.1, 2.0, 3))
    ]
    inside = [KeepIn(name="in", direction=random_units(rng), half_angle=1.8, devices=names[:1])]
    if groups:
        inside += [
            KeepIn(name=f"g{i}", direction=random_units(rng), half_angle=1.2, devices=names, any_of="g")
            for i in range(2)
        ]
    return out, inside


def claim(trajectory, spacecraft, out=(), inside=(), **changes):
    return Claim(
        trajectory=trajectory,
        spacecraft=spacecraft,
        cones=tabulate(out, inside, spacecraft),
        zone_names=[zone.name for zone in (*out, *inside)],
        **(ends(trajectory, spacecraft) | changes),
    )


@pytest.fixture(scope="module")
def claims():
    """Of several spacecraft, safe and not, among moving zones, at rest, illegible."""
    found = []
    for seed in range(36):
        rng = np.random.default_rng(seed)
        limits = ({}, LIMITED, LIMITED | HEAVY)[seed % 3]
        spacecraft = craft((2, 2, 4, 0)[seed % 4], instruments=1, **limits)
        joints = 2 * len(spacecraft.terminals)
        trajectory = manoeuvre(
            seed,
            terminals=joints // 2,
            pieces=1 + seed % 5,
            joint_pieces=1 + seed % 2,
            duration=rng.uniform(20, 200),
        )
        out, inside = zones_of(rng, spacecraft.device_names, groups=seed % 2)
        found.append(claim(trajectory, spacecraft, out, inside))
    first = found[0]
    angle = np.linspace(0, 1, 9)
    arc = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    path = DirectionPath.through(np.linspace(-1, 300, 9), arc)
    moving = KeepOut(name="swift", direction=path, half_angle=0.2)
    still = replace(
        first.trajectory,
        breaks=np.zeros(2),
        joint_breaks=np.zeros(2),
        chart_attitude=first.trajectory.chart_attitude[:1],
        chart_start=np.zeros(1),
        chart_rate=np.zeros((1, 3)),
        coefficients=np.zeros((1, 13, 3)),
        joint_coefficients=np.eye(13)[:1, :, None] * first.trajectory.joint_coefficients[:1, :1],
    )
    wild = replace(first.trajectory, chart_rate=1e200 * first.trajectory.chart_rate)
    several = found[4].trajectory
    jump = several.coefficients.copy()
    jump[-1, 0] += 1e-3
    odd = [
        claim(first.trajectory, first.spacecraft),
        claim(first.trajectory, first.spacecraft, [moving]),
        claim(found[5].trajectory, found[5].spacecraft, [moving]),
        replace(first, trajectory=wild),
        replace(first, trajectory=replace(first.trajectory, breaks=np.nan * first.trajectory.breaks)),
        replace(first, goal=first.start),
        replace(first, start=replace(first.start, joint_rates=np.ones(4))),
        replace(first, trajectory=still, goal=first.start),
        replace(found[4], trajectory=replace(several, coefficients=jump)),
    ]
    return found + odd


@pytest.fixture(scope="module")
def alone(claims):
    return [certify_batch([one])[0] for one in claims]


def test_the_claims_are_of_many_kinds(claims, alone):
    assert sum(report.certified for report in alone) >= 3
    said = " ".join(fault for report in alone for fault in report.faults)
    for words in (
        "inside the keep-out zone",
        "outside the keep-in zone",
        "the nearest to hold of its group",
        "jump",
        "is not finite",
        "the goal is missed",
        "the start is missed",
        "reaches",
        "torque",
        "a chart turns",
    ):
        assert words in said, words
    assert len({report.evaluations for report in alone}) > 10


@pytest.mark.parametrize("together", [2, 5, 64])
def test_reports_made_together_are_those_made_alone(claims, alone, together, monkeypatch):
    monkeypatch.setattr(proof, "_TRAJECTORIES_PER_BATCH", together)
    for order in (np.arange(len(claims)), np.random.default_rng(together).permutation(len(claims))):
        reports = certify_batch([claims[number] for number in order])
        for number, report in zip(order, reports, strict=True):
            assert repr(vars(report)) == repr(vars(alone[number])), number


@pytest.mark.parametrize(("name", "most"), [("_MOST_ROWS", 40), ("_MOST_INTERVALS", 3)])
def test_a_budget_of_work_is_each_trajectorys_own(claims, name, most, monkeypatch):
    monkeypatch.setattr(bounds, name, most)
    tight = [certify_batch([one])[0] for one in claims[:24]]
    reports = certify_batch(claims[:24])
    assert [repr(vars(report)) for report in reports] == [repr(vars(report)) for report in tight]


def test_faults_name_the_devices_of_their_own_spacecraft(claims):
    one = claims[1]  # breaks limits
    other = replace(
        one,
        spacecraft=replace(
            one.spacecraft,
            terminals=tuple(replace(t, name=f"other-{i}") for i, t in enumerate(one.spacecraft.terminals)),
        ),
    )
    first, second = certify_batch([one, other])
    assert any("terminal-0" in fault for fault in first.faults)
    assert any("other-0" in fault for fault in second.faults)
    assert not any("terminal-" in fault for fault in second.faults)


def test_of_no_claims_nothing_is_said():
    assert certify_batch([]) == []
