"""Real spacecraft, each described in a file, planned and checked from what that file says."""

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from dense import assert_kept, breaches, instants, shares
from reference import (
    angle,
    attitudes_of,
    boresights_of,
    direction,
    field_distance,
    in_body,
    joints_of,
    seen,
    stated_margins,
    unit,
)
from scipy.spatial.transform import Rotation
from telescopes import hubble, load

import jaxplan as jp
from jaxplan import sky

pytestmark = pytest.mark.slow
EPOCH = "2026-06-20T10:30:00"
OBSERVER = sky.KeplerOrbit(
    semi_major_axis=6928.0,
    eccentricity=0.001,
    inclination=np.deg2rad(97.6),
    node=np.deg2rad(234.0),
    perigee=np.deg2rad(90.0),
    anomaly=np.deg2rad(46.0),
)
LISBON = sky.GroundPoint(latitude=np.deg2rad(38.72), longitude=np.deg2rad(-9.14), altitude=100.0)
MASPALOMAS = sky.GroundPoint(latitude=np.deg2rad(27.763), longitude=np.deg2rad(-15.634), altitude=205.0)
deg = np.deg2rad


def needs_erfa():
    pytest.importorskip("erfa", reason="pyerfa is not installed")


@cache
def planned(name, duration):
    """The plan of a file's scenario, made once."""
    return jp.plan(load(name, duration=duration))


@pytest.mark.parametrize("duration", ["stretched", "minimum"])
def test_an_earth_observer_turns_to_a_place_beside_its_track_and_holds_its_station(duration):
    needs_erfa()
    plan = planned("earth_observer", duration)
    scenario = plan.scenario
    assert plan.ok
    assert breaches(plan) == []
    end = plan.trajectory.duration
    craft, times = scenario.spacecraft, np.array([0.0, end])
    beams = dict(
        zip(craft.device_names, np.moveaxis(boresights_of(plan.trajectory, craft, times), 1, 0), strict=True)
    )

    def toward(place, time):
        here, there = (
            np.asarray(sky.positions(one, epoch=EPOCH, times=time)).ravel() for one in (OBSERVER, place)
        )
        return unit(there - here), unit(-here)

    (station, down), (station_then, down_then) = (toward(MASPALOMAS, time) for time in times)
    np.testing.assert_allclose(beams["telescope"][0], down, atol=1e-7)
    np.testing.assert_allclose(beams["telescope"][1], toward(LISBON, end)[0], atol=1e-7)
    np.testing.assert_allclose(beams["antenna"], [station, station_then], atol=1e-7)
    assert 20 < np.rad2deg(angle(beams["telescope"][1], down_then)) < 35
    # the array is as near to the Sun as any of its angles, and the roll brings it there to the full
    (sun,) = scenario.goal.prefer
    for time, beam in zip(times, beams["array"], strict=True):
        assert angle(beam, seen(sun.direction, time)) < 2e-6


def test_one_tracker_of_the_earth_observer_sees_stars_all_the_while():
    needs_erfa()
    plan = planned("earth_observer", "stretched")
    time = instants(plan.trajectory)
    directions = boresights_of(plan.trajectory, plan.scenario.spacecraft, time)
    names = plan.scenario.spacecraft.device_names
    free = []
    for tracker in ("tracker-1", "tracker-2"):
        zones = [zone for zone in plan.scenario.keep_out if zone.devices == (tracker,)]
        beam = directions[:, names.index(tracker)]
        free.append([angle(beam, seen(zone.direction, time)) - zone.half_angle for zone in zones])
    assert np.min(np.max(np.min(free, axis=1), axis=0)) > 0


@pytest.mark.parametrize("duration", ["stretched", "minimum"])
def test_a_satellite_hands_one_laser_link_over_while_it_holds_three(duration):
    needs_erfa()
    scenario = load("laser_links", duration=duration)
    plan = jp.plan(scenario)
    assert plan.ok
    assert breaches(plan) == []
    time = instants(plan.trajectory)
    beams = boresights_of(plan.trajectory, scenario.spacecraft, time)[:, :4]
    for one, other in combinations(range(4), 2):
        assert np.min(angle(beams[:, one], beams[:, other])) >= deg(2)
    for link, (zone, beam) in enumerate(zip(scenario.keep_in, np.moveaxis(beams, 1, 0), strict=False)):
        assert zone.devices == (scenario.spacecraft.terminals[link].name,)
        assert np.max(angle(beam, seen(zone.direction, time))) <= deg(1) + 1e-9
    assert angle(beams[0, 3], beams[-1, 3]) > deg(40)


@pytest.mark.parametrize("seed", range(3))
def test_hubble_slews_within_its_rates_and_torque_clear_of_the_sun(seed):
    scenario = hubble(seed, duration="minimum")
    plan = jp.plan(scenario)
    assert plan.certificate.certified
    assert_kept(plan.trajectory, scenario.spacecraft, scenario.keep_out)
    found = shares(plan.trajectory, scenario.spacecraft)
    assert np.abs(found["torque"]).max() == pytest.approx(1, abs=0.01)
    assert plan.trajectory.duration > plan.duration_bound
    stretched = jp.plan(hubble(seed))
    assert stretched.trajectory.duration > plan.trajectory.duration
    assert max(stretched.certificate.peaks.values()) == pytest.approx(1, abs=3e-6)
    # With the rates of x about every axis it is quicker where rates bind, and never slower.
    loose = replace(scenario, spacecraft=replace(scenario.spacecraft, rate_limit=deg(0.5)))
    assert jp.plan(loose).trajectory.duration < 1.02 * plan.trajectory.duration


def test_hubble_gets_from_a_hundred_random_starts_to_as_many_goals():
    plans = jp.plan_batch([hubble(seed) for seed in range(100)], progress=False)
    for plan in plans:
        assert plan.ok, plan.message
        assert breaches(plan) == []


# Right ascension and declination of fields of a survey, deg, within what the file allows at its epoch.
FIELDS = [(215.0, 38.0), (160.0, -20.0), (185.0, -45.0)]


@pytest.mark.parametrize("name", ["ultrasat", "uvex"])
@pytest.mark.parametrize("duration", ["stretched", "minimum"])
def test_a_survey_goes_from_field_to_field_with_its_square_away_from_sun_moon_and_earth(name, duration):
    needs_erfa()
    scenario = load(name, duration=duration)
    for ascension, declination in FIELDS:
        toward = direction(deg(ascension), deg(declination))
        plan = jp.plan(replace(scenario, goal=jp.Targets.of({"telescope": toward}, clearance=deg(0.1))))
        assert plan.ok, plan.message
        assert breaches(plan) == []
        trajectory, time = plan.trajectory, instants(plan.trajectory, 501)
        attitudes, joints = attitudes_of(trajectory, time), joints_of(trajectory, time, orders=1)[0]
        for zone in scenario.keep_out:
            axis = np.einsum("kij,ki->kj", attitudes, seen(zone.direction, time))
            assert np.min(field_distance(scenario.spacecraft, "telescope", joints, axis)) >= zone.half_angle
        beam = attitudes[-1] @ in_body(scenario.spacecraft, "telescope", joints[-1:])[0]
        assert angle(beam, toward) <= 2e-8
        turn = Rotation.from_matrix(attitudes[-1]).as_rotvec()
        scenario = replace(scenario, start=replace(scenario.start, rotation_vector=turn))


def test_a_field_that_is_reached_only_on_the_edge_of_a_zone_is_reached_just_off_it():
    needs_erfa()
    scenario = load("ultrasat")
    targets = jp.Targets.of({"telescope": direction(deg(160.0), deg(-20.0))})
    plan = jp.plan(
        replace(
            scenario,
            start=replace(scenario.start, rotation_vector=np.array([-0.08016306, -0.78453126, -0.30327364])),
            goal=targets,
            search=replace(scenario.search, max_goals=1),
        )
    )
    assert breaches(plan) == []
    assert plan.certificate.min_margin >= 0
    at_end = stated_margins(plan.scenario, plan.trajectory, np.array([plan.trajectory.duration]))
    assert 0 <= min(float(np.min(own)) for own in at_end.values()) < 1e-5  # the Sun on the panels
