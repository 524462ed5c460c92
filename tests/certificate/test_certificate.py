"""The certificate's margins and verdicts against dense sampling by scipy."""

import re
from dataclasses import replace

import numpy as np
import pytest
from manoeuvres import claimed, closest, craft, ends, grid, judge, manoeuvre, polynomial
from reference import assert_each, boresights_of, random_units, spin_of, zone_margins

from jaxplan.certificate import certify, prove_margins
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut

DEGREE = np.deg2rad(1)


def random_zones(rng, count, devices):
    """Keep-out and keep-in zones of all sizes, also beyond a right angle, for random devices."""
    zones = []
    for i, direction in enumerate(random_units(rng, count)):
        bound = tuple(np.array(devices)[rng.permutation(len(devices))[: rng.integers(1, len(devices) + 1)]])
        kind = (KeepOut, KeepIn)[i % 2]
        zones.append(
            kind(name=f"z{i}", direction=direction, half_angle=rng.uniform(0.05, 3.0), devices=bound)
        )
    return zones


def tuned(zone, trajectory, spacecraft, margin):
    """The zone with its half angle changed so that the least margin on a grid is the given one."""
    least = zone_margins(trajectory, spacecraft, [zone], grid(trajectory)).min()
    return replace(
        zone, half_angle=zone.half_angle + (least - margin) * (1 if isinstance(zone, KeepOut) else -1)
    )


@pytest.mark.parametrize("terminals", [0, 1, 2, 4, 12])
def test_margin_bound_is_below_every_sample_and_near_the_least(terminals):
    spacecraft = craft(terminals, instruments=2)
    for seed in range(8):
        rng = np.random.default_rng([seed, terminals])
        trajectory = manoeuvre(
            seed, terminals=terminals, pieces=1 + seed % 4, joint_pieces=1 + seed % 3, wiggle=0.5
        )
        zones = random_zones(rng, 4, spacecraft.device_names)
        least = zone_margins(trajectory, spacecraft, zones, grid(trajectory)).min()
        report = judge(trajectory, spacecraft, zones)
        assert report.min_margin <= least + 1e-12
        assert report.min_margin >= least - max(0.01 * abs(least), 1e-6) - 1e-5
        assert report.certified == (least > 0)
        named = next(z for z in zones if z.name == report.worst_zone)
        alone = replace(named, devices=(report.worst_device,))
        there = zone_margins(trajectory, spacecraft, [alone], np.array([report.worst_time]))
        assert abs(there - least) <= 0.01 * abs(least) + 1e-5


def test_directions_count_whatever_their_length():
    # Within what is let pass as a unit vector.
    spacecraft, trajectory = craft(1, instruments=1), manoeuvre(7, terminals=1)
    zone = random_zones(np.random.default_rng(7), 1, spacecraft.device_names)[0]
    zone = replace(zone, devices=spacecraft.device_names[1:])
    camera = spacecraft.instruments[0]
    longer = replace(spacecraft, instruments=(replace(camera, boresight=(1 + 9e-7) * camera.boresight),))
    report = judge(trajectory, spacecraft, [zone])
    others = (
        judge(trajectory, longer, [zone]),
        judge(trajectory, spacecraft, [replace(zone, direction=(1 + 9e-7) * zone.direction)]),
    )
    for other in others:
        assert other.min_margin == pytest.approx(report.min_margin, abs=1e-12)


def test_every_margin_is_bound_below_its_samples_and_near_their_least():
    spacecraft = craft(2, instruments=2)
    for seed in range(6):
        trajectory = manoeuvre(seed, terminals=2, pieces=1 + seed % 3, wiggle=0.5)
        single = random_zones(np.random.default_rng(seed), 4, spacecraft.device_names)
        grouped = [replace(zone, name=f"g{zone.name}", any_of="g") for zone in single[1::2]]
        out = [zone for zone in single if isinstance(zone, KeepOut)]
        inside = [zone for zone in single if isinstance(zone, KeepIn)] + grouped
        names = [zone.name for zone in (*out, *inside)]
        cones = tabulate(out, inside, spacecraft)
        found = prove_margins(claimed(trajectory, spacecraft, cones, zone_names=names))
        times = grid(trajectory)
        expected = {
            ((zone.name,), device): zone_margins(
                trajectory, spacecraft, [replace(zone, devices=(device,))], times
            ).min()
            for zone in single
            for device in zone.devices
        }
        best = zone_margins(trajectory, spacecraft, grouped, times).max(axis=0).min()
        *alone, group = found
        assert {(margin.zones, margin.device) for margin in alone} == set(expected)
        for margin in alone:
            least = expected[margin.zones, margin.device]
            assert least - max(0.01 * abs(least), 1e-6) - 1e-5 <= margin.bound <= least + 1e-12
            assert (margin.zone,) == margin.zones
        assert set(group.zones) == {zone.name for zone in grouped}
        assert group.zone in group.zones
        assert best - max(0.01 * abs(best), 1e-6) - 1e-5 <= group.bound <= best + 1e-12
        at = boresights_of(trajectory, spacecraft, np.array([alone[0].time]))[0]
        zone = next(zone for zone in single if zone.name == alone[0].zone)
        angle = np.arccos(at[spacecraft.device_names.index(alone[0].device)] @ zone.direction)
        reached = (angle - zone.half_angle) * (1 if isinstance(zone, KeepOut) else -1)
        assert abs(reached - alone[0].bound) < 0.02 * abs(reached) + 1e-4
        assert (
            prove_margins(
                claimed(
                    replace(trajectory, chart_rate=np.nan * trajectory.chart_rate),
                    spacecraft,
                    cones,
                    zone_names=names,
                )
            )
            == ()
        )


def test_verdict_agrees_with_samples_down_to_small_margins():
    spacecraft = craft(3)
    for seed in range(16):
        rng = np.random.default_rng([1, seed])
        trajectory = manoeuvre(100 + seed, pieces=1 + seed % 4, wiggle=0.3)
        zones = random_zones(rng, 3, spacecraft.device_names)
        zones = [tuned(z, trajectory, spacecraft, rng.uniform(0.05, 3) * DEGREE) for z in zones]
        zones = [z for z in zones if 0.01 < z.half_angle < 3.13]
        assert judge(trajectory, spacecraft, zones).certified
        broken = tuned(zones[0], trajectory, spacecraft, -0.01 * DEGREE)
        report = judge(trajectory, spacecraft, [broken, *zones[1:]])
        assert not report.certified
        assert len(report.faults) == 1
        assert broken.name in report.faults[0]
        overlap = float(re.search(r"is (\S+) deg", report.faults[0])[1])
        assert overlap == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("distance", [0.3, 1e-2, 1e-4])
def test_dip_of_a_moment_between_samples_is_found(distance):
    spacecraft = craft(1, instruments=0)
    for seed in range(6):
        rng = np.random.default_rng([2, seed])
        trajectory = manoeuvre(200 + seed, terminals=1)
        before, at = boresights_of(trajectory, spacecraft, rng.uniform(20, 60) + np.array([-1e-3, 0]))[:, 0]
        sideways = np.cross(at, at - before)
        direction = np.cos(distance) * at + np.sin(distance) * sideways / np.linalg.norm(sideways)
        least, when = closest(trajectory, spacecraft, "terminal-0", direction)
        zones = [KeepOut(name="z", direction=direction, half_angle=least + depth) for depth in (-1e-10, 3e-9)]
        assert judge(trajectory, spacecraft, zones[:1]).certified
        report = judge(trajectory, spacecraft, zones[1:])
        assert not report.certified
        assert_each(zone_margins(trajectory, spacecraft, zones[1:], grid(trajectory)), ">", 0)
        assert report.min_margin == pytest.approx(-3e-9, abs=3e-10)
        assert report.worst_time == pytest.approx(when, abs=0.01)


def test_margin_of_zero_at_the_start_or_for_ever_is_proved():
    spacecraft = craft(1, instruments=1)
    for seed in range(10):
        trajectory = manoeuvre(300 + seed, terminals=1)
        start, later = boresights_of(trajectory, spacecraft, np.array([0.0, 3.0]))[:, 0]
        away = later - (later @ start) * start
        direction = np.cos(0.4) * start - np.sin(0.4) * away / np.linalg.norm(away)  # behind the way out
        sine = np.linalg.norm(np.cross(start, direction))
        zone = KeepOut(
            name="z",
            direction=direction,
            half_angle=np.arctan2(sine, start @ direction),
            devices=("terminal-0",),
        )
        least, _ = closest(trajectory, spacecraft, "terminal-0", direction)
        if least < zone.half_angle - 1e-12:
            continue  # it comes back later
        report = judge(trajectory, spacecraft, [zone])
        assert report.certified
        assert -1e-10 < report.min_margin <= 1e-15
        assert report.worst_time == pytest.approx(0, abs=1)


def test_without_terminals_or_instruments_or_zones():
    rng = np.random.default_rng(7)
    for terminals, instruments in ((0, 0), (0, 2), (2, 0)):
        spacecraft, trajectory = craft(terminals, instruments), manoeuvre(600, terminals=terminals)
        report = judge(trajectory, spacecraft)
        assert report.certified
        assert report.min_margin is report.worst_time is report.worst_device is report.worst_zone is None
        assert ("yaw" in report.peaks) == ("joint_rates" in report.peaks) == (terminals > 0)
        zone = KeepOut(name="z", direction=random_units(rng), half_angle=0.1)
        seen = judge(trajectory, spacecraft, [zone])
        assert (seen.min_margin is None) == (terminals + instruments == 0)


@pytest.mark.parametrize("count", [64, 1000])
def test_many_zones_and_devices(count):
    spacecraft, trajectory = craft(12), manoeuvre(700, terminals=12)
    boresights = boresights_of(trajectory, spacecraft, grid(trajectory, 2001))
    directions = random_units(np.random.default_rng(8), 3 * count)
    angle = np.arccos(np.array([np.max(boresights @ d) for d in directions]))
    directions, angle = directions[angle > 0.03][:count], angle[angle > 0.03][:count]
    assert len(angle) == count
    zones = [KeepOut(name=f"z{i}", direction=d, half_angle=0.9 * angle[i]) for i, d in enumerate(directions)]
    report = judge(trajectory, spacecraft, zones)
    assert report.certified
    assert report.worst_zone == f"z{np.argmin(angle)}"
    assert report.min_margin == pytest.approx(0.1 * angle.min(), rel=0.02)
    wide = [replace(z, half_angle=1.02 * angle[i]) if i % 7 == 0 else z for i, z in enumerate(zones)]
    faults = judge(trajectory, spacecraft, wide).faults
    assert {re.search(r"zone (z\d+)", f)[1] for f in faults} == {f"z{i}" for i in range(0, count, 7)}


def test_group_holds_while_one_of_its_zones_does():
    spacecraft = craft(2, instruments=0)
    for seed in range(6):
        trajectory = manoeuvre(800 + seed, terminals=2)
        time = grid(trajectory)
        boresights = boresights_of(trajectory, spacecraft, time)
        # At each time another zone holds both terminals best, and at the worst it holds them just so.
        names = spacecraft.device_names
        zones = [
            KeepIn(name=f"z{i}", direction=d / np.linalg.norm(d), half_angle=1.0, devices=names, any_of="g")
            for i, d in enumerate(boresights[[500, 2000, 3500]].sum(axis=1))
        ]
        margins = zone_margins(trajectory, spacecraft, zones, time)
        best = margins.max(axis=0).min()
        zones = [replace(z, half_angle=1.0 - best + 0.002) for z in zones]
        assert len(set(margins.argmax(axis=0))) > 1
        report = judge(trajectory, spacecraft, zones)
        assert report.certified
        assert 0.0015 < report.min_margin <= 0.002  # where the best changes the samples may miss a little
        alone = judge(trajectory, spacecraft, [replace(z, any_of=None) for z in zones])
        assert not alone.certified
        short = judge(trajectory, spacecraft, [replace(z, half_angle=z.half_angle - 0.003) for z in zones])
        assert len(short.faults) == 1
        assert "group" in short.faults[0]
        there = zone_margins(trajectory, spacecraft, zones, np.array([short.worst_time]))[:, 0]
        assert there[int(short.worst_zone[1:])] == pytest.approx(there.max(), abs=1e-9)
        assert there.max() - 0.003 == pytest.approx(short.min_margin, abs=1e-4)


def test_a_chart_may_turn_further_than_half_a_turn():
    rng = np.random.default_rng(9)
    spacecraft = craft(1, 1)
    for turns in (1.0, 3.0, 5.9):
        plain = manoeuvre(900, terminals=1, pieces=1, step=0.0, wiggle=0.0)
        far = polynomial(
            rng, np.zeros((3, 3)), [random_units(rng) * turns * np.pi, np.zeros(3), np.zeros(3)], 40.0, 0.3
        )
        trajectory = replace(plain, coefficients=far[None], chart_rate=plain.chart_rate + 0.01)
        time = grid(trajectory)
        zones = random_zones(rng, 3, spacecraft.device_names)
        report = judge(trajectory, spacecraft, zones)
        least = zone_margins(trajectory, spacecraft, zones, time).min()
        assert least - max(1e-4, 0.01 * abs(least)) <= report.min_margin <= least + 1e-12
        peak = np.abs(spin_of(trajectory, time)).max(axis=(1, 2))[:2] / 9
        assert list(report.peaks.values())[:2] == pytest.approx(peak, abs=2e-6)
    beyond = judge(replace(trajectory, coefficients=4 * trajectory.coefficients), spacecraft)
    assert not beyond.certified
    assert "20 rad" in beyond.faults[0]


def test_padding_and_the_order_of_zones_do_not_matter():
    spacecraft, trajectory = craft(2), manoeuvre(1000, terminals=2)
    zones = random_zones(np.random.default_rng(10), 5, spacecraft.device_names)
    reports = [judge(trajectory, spacecraft, order) for order in (zones, zones[::-1])]
    cones = tabulate(
        [z for z in zones if isinstance(z, KeepOut)],
        [z for z in zones if isinstance(z, KeepIn)],
        spacecraft,
    )
    names = [z.name for z in sorted(zones, key=lambda z: isinstance(z, KeepIn))]
    bare = replace(
        cones,
        **{
            name: getattr(cones, name)[:5]
            for name in ("axis", "frame", "partner", "half_angle", "side", "bound", "entry", "group")
        },
    )
    reports.append(
        certify(claimed(trajectory, spacecraft, bare, zone_names=names, **ends(trajectory, spacecraft)))
    )
    for report in reports[1:]:
        assert report.min_margin == pytest.approx(reports[0].min_margin, abs=1e-6)
        assert (report.worst_device, report.worst_zone) == (reports[0].worst_device, reports[0].worst_zone)
        assert sorted(report.faults) == sorted(reports[0].faults)
