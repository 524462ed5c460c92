"""The certificate among zones that move, against dense sampling by scipy."""

from dataclasses import replace

import numpy as np
import pytest
from builders import great_circle, turning_direction, wandering_direction
from manoeuvres import claimed, craft, judge, manoeuvre
from reference import boresights_of, random_units, sampled, seen

from jaxplan.certificate import EndState, certify, prove_margins
from jaxplan.certificate.motion import Way
from jaxplan.model.directions import DirectionPath
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut


def random_zones(rng, duration, devices):
    """Slow, quick and wandering zones of all sizes, and one that stands still."""
    paths = [
        turning_direction(rng, 0.001, np.linspace(0, duration, 5)),
        turning_direction(rng, 0.06, np.linspace(-1, duration + 3, 40)),
        wandering_direction(rng, duration, 15, 0.12),
        random_units(rng),
    ]
    zones = []
    for i, path in enumerate(paths):
        bound = tuple(np.array(devices)[rng.permutation(len(devices))[: rng.integers(1, len(devices) + 1)]])
        kind = (KeepOut, KeepIn)[rng.integers(2)]
        zones.append(kind(name=f"z{i}", direction=path, half_angle=rng.uniform(0.05, 3.0), devices=bound))
    return zones


@pytest.mark.parametrize("terminals", [0, 2, 4])
def test_margin_bound_among_moving_zones_is_below_every_sample_and_near_the_least(terminals):
    spacecraft = craft(terminals, instruments=2)
    for seed in range(5):
        rng = np.random.default_rng([seed, terminals])
        trajectory = manoeuvre(seed, terminals=terminals, pieces=1 + seed % 3, wiggle=0.5)
        zones = random_zones(rng, trajectory.duration, spacecraft.device_names)
        least = sampled(trajectory, spacecraft, zones).min()
        report = judge(trajectory, spacecraft, zones)
        assert report.min_margin <= least + 1e-12
        assert report.min_margin >= least - max(0.01 * abs(least), 1e-6) - 1e-5
        assert report.certified == (least > 0)


def test_every_margin_to_moving_zones_is_bound_below_its_samples_and_near_their_least():
    spacecraft = craft(2, instruments=1)
    for seed in range(4):
        trajectory = manoeuvre(seed, terminals=2, wiggle=0.5)
        zones = random_zones(np.random.default_rng(seed), trajectory.duration, spacecraft.device_names)
        out = [zone for zone in zones if isinstance(zone, KeepOut)]
        inside = [zone for zone in zones if isinstance(zone, KeepIn)]
        grouped = [replace(zone, name=f"g{zone.name}", any_of="g") for zone in inside]
        every = (*out, *inside, *grouped)
        cones = tabulate(out, (*inside, *grouped), spacecraft)
        found = prove_margins(
            claimed(trajectory, spacecraft, cones, zone_names=[zone.name for zone in every])
        )
        by_name = {zone.name: zone for zone in every}
        for one in found:
            if len(one.zones) > 1:
                least = sampled(trajectory, spacecraft, grouped).max(axis=0).min()
            else:
                alone = replace(by_name[one.zones[0]], devices=(one.device,))
                least = sampled(trajectory, spacecraft, [alone]).min()
            assert one.bound <= least + 1e-12
            assert one.bound >= least - 0.01 * abs(least) - 2e-5


def test_a_zone_that_sweeps_across_a_beam_between_two_samples_is_seen():
    spacecraft = craft(0, instruments=1)
    trajectory = manoeuvre(4, terminals=0, pieces=1, step=1e-3, wiggle=0.0, duration=20.0)
    beam = boresights_of(trajectory, spacecraft, np.array([10.0]))[0, 0]
    aside = np.cross(beam, [0.3, 0.5, 0.8])
    aside /= np.linalg.norm(aside)
    # 0.3 rad to the one side at first and to the other at last; a cone of 0.01 rad passes in 0.7 s
    before = great_circle(beam, aside, 1.0, np.array([-0.3, 0.3]))
    zone = KeepOut(name="swift", direction=DirectionPath.through([0.0, 20.0], before), half_angle=0.01)
    least = sampled(trajectory, spacecraft, [zone], 40_001).min()
    assert least < -0.009
    assert sampled(trajectory, spacecraft, [zone], 10).min() > 0.02  # seldom looked at it is clear
    report = judge(trajectory, spacecraft, [zone])
    assert not report.certified
    assert report.min_margin == pytest.approx(least, abs=2e-4)
    assert report.min_margin <= least
    assert any("inside the keep-out zone swift" in fault for fault in report.faults)
    # seen at all and not only where somebody happened to look
    for miss in np.linspace(0.0102, 0.0108, 4):
        shifted = before + miss * np.cross(aside, beam)
        shifted /= np.linalg.norm(shifted, axis=1, keepdims=True)
        near = replace(zone, direction=DirectionPath.through([0.0, 20.0], shifted))
        least = sampled(trajectory, spacecraft, [near], 40_001).min()
        report = judge(trajectory, spacecraft, [near])
        assert report.certified == (least > 0)
        assert report.min_margin <= least + 1e-12
        assert report.min_margin >= least - 0.01 * abs(least) - 1e-6


def test_the_majorant_bounds_every_taylor_coefficient_of_an_axis():
    rng = np.random.default_rng(8)
    path = wandering_direction(rng, 30.0, 9, 0.2)
    way = Way.of(path)
    centre, half = (path.times[1:] + path.times[:-1]) / 2, np.diff(path.times) / 2
    bound = way.majorant(centre, half, 15)
    from numpy.polynomial import chebyshev

    nodes = chebyshev.chebpts2(60)
    for n in range(len(centre)):
        values = seen(path, centre[n] + half[n] * nodes)
        fitted = chebyshev.chebfit(nodes, values, 59)
        for order in range(9):
            slope = chebyshev.chebder(fitted, order) if order else fitted
            most = np.linalg.norm(chebyshev.chebval(np.linspace(-1, 1, 101), slope), axis=0).max()
            size = most / np.prod(np.arange(1, order + 1), initial=1.0)
            assert size <= bound[order, n] * (1 + 1e-6) + 1e-9 * 60 ** (2 * order) / np.prod(
                np.arange(1, order + 1), initial=1.0
            )


def test_what_is_wrong_with_a_path_is_a_fault_and_no_certificate():
    spacecraft = craft(1, instruments=1)
    trajectory = manoeuvre(2, terminals=1)
    path = turning_direction(np.random.default_rng(0), 0.001, np.linspace(0, 80, 5))
    zone = KeepOut(name="z", direction=path, half_angle=1e-3)
    assert judge(trajectory, spacecraft, [zone]).certified
    broken = {
        "is not finite": replace(path, slopes=np.where(path.slopes == path.slopes[2], np.nan, path.slopes)),
        "known from 0 to 40 s": DirectionPath.through(path.times[:3], path.samples[:3]),
        "known from 20 to 80 s": DirectionPath.through(path.times[1:], path.samples[1:]),
        "do not rise": replace(path, times=path.times[[0, 2, 1, 3, 4]]),
        "no unit vector": replace(path, samples=1.1 * path.samples),
        "has the shape": replace(path, samples=path.samples[:3]),
    }
    for words, wrong in broken.items():
        report = judge(trajectory, spacecraft, [replace(zone, direction=wrong)])
        assert not report.certified
        assert any(words in fault for fault in report.faults), (words, report.faults)


def test_a_nan_among_many_samples_of_a_path_is_found():
    spacecraft = craft(1, instruments=1)
    trajectory = manoeuvre(2, terminals=1)
    path = turning_direction(np.random.default_rng(0), 0.001, np.linspace(0, 80, 9000))
    samples = path.samples.copy()
    samples[8777, 1] = np.nan
    zone = KeepOut(name="z", direction=replace(path, samples=samples), half_angle=1e-3)
    assert not judge(trajectory, spacecraft, [zone]).certified


def test_a_state_without_duration_is_judged_by_zones_as_they_are_at_first():
    spacecraft = craft(0, instruments=1)
    motion = manoeuvre(4, terminals=0, pieces=1, step=1e-9, wiggle=0.0)
    still = replace(
        motion,
        breaks=np.zeros(2),
        joint_breaks=np.zeros(2),
        coefficients=np.zeros((1, 1, 3)),
        joint_coefficients=np.zeros((1, 1, 0)),
        chart_rate=np.zeros((1, 3)),
        node_times=np.zeros(1),
    )
    beam = spacecraft.fixed_boresights[0] @ motion.chart_attitude[0].T
    aside = np.cross(beam, [0.3, 0.5, 0.8])
    aside /= np.linalg.norm(aside)
    times = np.linspace(0, 2, 41)
    path = DirectionPath.through(times, great_circle(beam, aside, 1.0, 0.2 * times))
    zone = KeepIn(name="z", direction=path, half_angle=0.1, devices=("instrument-0",))
    end = EndState(attitude=motion.chart_attitude[0], joints=np.zeros(0))
    cones = tabulate([], [zone], spacecraft)
    report = certify(claimed(still, spacecraft, cones, zone_names=["z"], start=end, goal=end))
    assert report.certified
    assert report.min_margin == pytest.approx(0.1, abs=1e-8)
