"""The sky against almanacs, eclipses, handbooks' frames and closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest
from heavens import TEME_ACCURACY, almanac_sun, on_the_ground, teme_to_j2000

from jaxplan import sky
from jaxplan.geometry.vectors import separation
from jaxplan.model.epochs import parse_epoch
from jaxplan.sky import frames, orbits
from jaxplan.sky.frames import elapsed, teme_to_gcrs

pytest.importorskip("erfa", reason="pyerfa is not installed")

EPOCH = "2026-03-01T06:30:15.25"
LOW = sky.CircularOrbit(altitude=500.0, inclination=0.9, node=0.2, latitude=1.0)
AHEAD = sky.CircularOrbit(altitude=520.0, inclination=0.95, node=0.25, latitude=1.1)


def degrees(first, second):
    return np.rad2deg(separation(np.asarray(first), np.asarray(second)))


@pytest.mark.parametrize("year", [1973, 1987, 2000, 2013, 2026, 2049])
def test_the_sun_is_where_the_almanac_has_it(year):
    for month in range(1, 13):
        utc = f"{year}-{month:02d}-17T05:00:00"
        assert degrees(sky.directions("sun", epoch=utc, observer="earth"), almanac_sun(utc)) < 0.01


@pytest.mark.parametrize(
    ("utc", "gamma"),  # of greatest eclipse: NASA's Five Millennium Canon
    [("2017-08-21T18:25:31", 0.4367), ("2024-04-08T18:17:19", 0.3431), ("2027-08-02T10:06:38", 0.1421)],
)
def test_the_moons_shadow_passes_the_earths_centre_as_far_as_published(utc, gamma):
    times = np.arange(-600.0, 601.0, 5.0)
    sun, moon = (sky.positions(body, epoch=utc, times=times) for body in ("sun", "moon"))
    axis = (moon - sun) / np.linalg.norm(moon - sun, axis=1, keepdims=True)
    miss = np.linalg.norm(np.cross(moon, axis), axis=1) / 6378.137
    assert miss.min() == pytest.approx(gamma, abs=0.003)  # 10 arc seconds of the Moon's way
    assert abs(times[miss.argmin()]) < 120  # light takes its time


def test_sun_and_moon_meet_where_the_eclipse_of_2024_was_greatest():
    utc = "2024-04-08T18:17:19"
    mexico = on_the_ground(utc, 25.29, -104.14)
    seen = [sky.directions(body, epoch=utc, observer=mexico) for body in ("sun", "moon")]
    assert degrees(*seen) < 0.015
    assert degrees(seen[0], mexico) == pytest.approx(90 - 69.8, abs=0.3)  # the published height of the Sun
    radii = [sky.angular_radius(body, epoch=utc, observer=mexico) for body in ("sun", "moon")]
    assert radii[1] / radii[0] == pytest.approx(1.0566, abs=0.003)  # the published magnitude


def test_the_moon_stands_opposite_the_sun_in_an_eclipse_of_the_moon():
    utc = "2025-03-14T06:58:43"
    sun, moon = (sky.positions(body, epoch=utc) for body in ("sun", "moon"))
    offset = np.arcsin(
        0.3485 * 6378.137 / np.linalg.norm(moon)
    )  # the published distance from the shadow's axis
    assert degrees(-sun, moon) == pytest.approx(np.rad2deg(offset), abs=0.01)


def test_bodies_move_as_their_velocities_say():
    for body in ("sun", "moon"):
        around = sky.positions(body, epoch=EPOCH, times=[-60.0, 60.0])
        speed = np.diff(around, axis=0)[0] / 120
        np.testing.assert_allclose(
            sky.velocities(body, epoch=EPOCH), speed, atol=2e-4 * np.linalg.norm(speed)
        )
    np.testing.assert_array_equal(sky.velocities("earth", epoch=EPOCH, times=[0.0, 1.0]), 0)


def test_teme_turns_into_the_gcrs_as_in_vallados_example():
    # Fundamentals of Astrodynamics and Applications, example 3-15
    rotation = teme_to_gcrs(parse_epoch("2004-04-06T07:51:28.386009"), np.array(0.0))
    found = rotation @ [5094.18016210, 6127.64465950, 6380.34453270]
    np.testing.assert_allclose(found, [5102.508958, 6123.011401, 6378.136928], atol=1e-4)


@pytest.mark.parametrize(
    "utc", ["1975-06-01T00:00:00", "2000-01-01T12:00:00", "2012-09-30T18:00:00", EPOCH, "2060-05-05"]
)
def test_teme_turns_into_the_gcrs_as_handbooks_say(utc):
    found = teme_to_gcrs(parse_epoch(utc), np.array([0.0]))[0]
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-14)
    assert np.linalg.norm(found - teme_to_j2000(utc), 2) < TEME_ACCURACY


@pytest.mark.parametrize("span", [0.0, 600.0, 86400.0, 250_000.0])
def test_teme_turns_at_many_instants_as_at_each_by_itself(span):
    times = np.linspace(-span / 3, 2 * span / 3, 120).reshape(12, 10)
    found = teme_to_gcrs(parse_epoch(EPOCH), times)
    alone = [teme_to_gcrs(parse_epoch(EPOCH), each) for each in times.flat]
    np.testing.assert_allclose(found.reshape(-1, 3, 3), alone, rtol=0, atol=5e-13)


def test_leap_seconds_are_counted():
    before, after = (parse_epoch(text) for text in ("2016-12-31T12:00:00", "2017-01-01T12:00:00"))
    assert elapsed(before, after, np.array([0.0, 2.0])).tolist() == [86401.0, 86403.0]
    assert elapsed(after, before, np.array(0.0)) == -86401.0


def test_circular_orbits_are_those_of_the_module_orbits():
    times = np.array([-5.0, 0.0, 80.0])
    late = sky.CircularOrbit(**{**vars(LOW), "epoch": "2026-03-01T06:30:05.25"})
    here = orbits.position(500.0, 0.9, 0.2, 1.0, times)
    there = orbits.position(520.0, 0.95, 0.25, 1.1, times)
    np.testing.assert_allclose(sky.positions(LOW, epoch=EPOCH, times=times), here, atol=1e-8)
    np.testing.assert_allclose(
        sky.directions(AHEAD, epoch=EPOCH, observer=LOW, times=times),
        orbits.line_of_sight(here, there),
        atol=1e-12,
    )
    shifted = orbits.position(500.0, 0.9, 0.2, 1.0, times + 10)
    np.testing.assert_allclose(sky.positions(late, epoch=EPOCH, times=times), shifted, atol=1e-8)
    assert sky.positions(LOW, epoch=EPOCH).shape == (3,)


@pytest.mark.parametrize("target", ["sun", "moon", "earth", AHEAD])
def test_rates_are_the_derivatives_of_directions(target):
    times, step = np.array([0.0, 40.0, 80.0]), 0.5
    found = sky.direction_rates(target, epoch=EPOCH, observer=LOW, times=times)
    ahead, behind = (
        sky.directions(target, epoch=EPOCH, observer=LOW, times=times + shift) for shift in (step, -step)
    )
    np.testing.assert_allclose(found, (ahead - behind) / (2 * step), atol=1e-9)
    now = sky.directions(target, epoch=EPOCH, observer=LOW, times=times)
    np.testing.assert_allclose(np.sum(found * now, axis=-1), 0, atol=1e-15)


def test_a_given_position_may_look_and_be_looked_at():
    places = sky.positions(LOW, epoch=EPOCH, times=[0.0, 9.0])
    seen = sky.directions(AHEAD, epoch=EPOCH, observer=places, times=[0.0, 9.0])
    np.testing.assert_array_equal(seen, sky.directions(AHEAD, epoch=EPOCH, observer=LOW, times=[0.0, 9.0]))
    back = sky.directions(places[0], epoch=EPOCH, observer=AHEAD)
    np.testing.assert_array_equal(back, -seen[0])


def test_rays_inside_the_limb_meet_the_earth_and_rays_outside_do_not():
    rng = np.random.default_rng(4)
    for altitude in (200.0, 500.0, 35_786.0):
        here = orbits.position(altitude, *rng.uniform(-3, 3, 3))
        for atmosphere in (0.0, 100.0):
            limb = float(sky.angular_radius("earth", epoch=EPOCH, observer=here, atmosphere_km=atmosphere))
            down = -np.asarray(here) / np.linalg.norm(here)
            across = np.cross(down, rng.normal(size=3))
            across /= np.linalg.norm(across)
            for angle, meets in ((limb - 1e-6, True), (limb + 1e-6, False)):
                end = here + 2 * altitude * 40 * (np.cos(angle) * down + np.sin(angle) * across)
                assert bool(orbits.grazing_altitude(here, jnp.asarray(end)) < atmosphere) == meets


def test_the_drift_is_how_far_a_direction_gets():
    for target in ("sun", "moon", "earth", AHEAD):
        seen = sky.directions(target, epoch=EPOCH, observer=LOW, times=np.linspace(0, 83.7, 3001))
        furthest = separation(seen[0], seen).max()
        found = sky.drift(target, epoch=EPOCH, observer=LOW, duration_s=83.7)
        assert furthest <= found < 1.002 * furthest
    # from a circular orbit the Earth turns with the orbit
    found = sky.drift("earth", epoch=EPOCH, observer=LOW, duration_s=80.0)
    assert found == pytest.approx(80 * float(orbits.mean_motion(500.0)), rel=2e-3)
    assert sky.drift("earth", epoch=EPOCH, observer=LOW, duration_s=0.0) == 0


def test_a_zone_of_an_instant_is_the_body_and_what_is_wanted_beyond():
    for body in sky.BODIES:
        zone = sky.keep_out(body, epoch=EPOCH, observer=LOW, exclusion_deg=12.5, devices=["a"])
        radius = sky.angular_radius(body, epoch=EPOCH, observer=LOW)
        assert (zone.name, zone.devices) == (body, ("a",))
        assert -1e-15 < zone.half_angle - radius - np.deg2rad(12.5) < 2e-11
        np.testing.assert_allclose(
            zone.direction, sky.directions(body, epoch=EPOCH, observer=LOW), atol=1e-15
        )
        plain = sky.keep_out(body, epoch=EPOCH, observer=LOW, half_angle_deg=21, name="x")
        assert (plain.name, plain.half_angle) == ("x", np.deg2rad(21))
    high = sky.keep_out("earth", epoch=EPOCH, observer=LOW, exclusion_deg=10, atmosphere_km=100)
    expected = np.rad2deg(np.arcsin((6378.137 + 100) / (6378.137 + 500))) + 10
    assert np.rad2deg(high.half_angle) == pytest.approx(expected, abs=2e-9)


@pytest.mark.parametrize("body", sky.BODIES)
def test_a_zone_for_a_duration_holds_that_of_every_instant_and_little_more(body):
    times = np.linspace(0, 80, 4001)
    seen = sky.directions(body, epoch=EPOCH, observer=LOW, times=times)
    limb = sky.angular_radius(body, epoch=EPOCH, observer=LOW, times=times)
    for wanted, own in (({"half_angle_deg": 20.0}, 0.0), ({"exclusion_deg": 20.0}, limb)):
        zone = sky.keep_out(body, epoch=EPOCH, observer=LOW, for_duration_s=80, **wanted)
        needed = np.max(separation(zone.direction, seen) + own + np.deg2rad(20))
        assert needed <= zone.half_angle < needed + np.deg2rad(0.006)
    whole = sky.drift(body, epoch=EPOCH, observer=LOW, duration_s=80)
    assert np.max(separation(zone.direction, seen)) < 0.56 * whole  # the axis is in the middle of the way


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: sky.positions("sol", epoch=EPOCH), "body = 'sol': must be 'sun', 'moon' or 'earth'"),
        (lambda: sky.positions("sun", epoch="soon"), "epoch = 'soon': must be a time in UTC"),
        (lambda: sky.positions("sun", epoch=EPOCH, times=[0, np.nan]), "times = nan: must lie in"),
        (lambda: sky.positions("sun", epoch=EPOCH, times=[[0.0]]), r"not of shape \(1, 1\)"),
        (lambda: sky.positions([7000.0, 0.0], epoch=EPOCH), r"must be of shape \(3,\), km, not \(2,\)"),
        (lambda: sky.positions(np.ones((2, 3)), epoch=EPOCH, times=np.ones(3)), r"\(3,\) or \(3, 3\)"),
        (lambda: sky.positions([7000, 0, np.inf], epoch=EPOCH), "position = inf: must be finite"),
        (lambda: sky.velocities([7000, 0, 0], epoch=EPOCH), "velocity is not known"),
        (lambda: sky.directions(LOW, epoch=EPOCH, observer=LOW), "in one place"),
        (lambda: sky.angular_radius("earth", epoch=EPOCH, observer=[0, 0, 6378.0]), "must be beyond 6378.14"),
        (
            lambda: sky.angular_radius("sun", epoch=EPOCH, observer=LOW, atmosphere_km=-1),
            r"must lie in \[0, 1000\]",
        ),
        (
            lambda: sky.drift("sun", epoch=EPOCH, observer=LOW, duration_s=np.nan),
            r"must lie in \[0, 86400\] s",
        ),
        (lambda: sky.keep_out("sun", epoch=EPOCH, observer=LOW), "give either half_angle_deg"),
        (
            lambda: sky.keep_out("sun", epoch=EPOCH, observer=LOW, half_angle_deg=np.nan),
            r"must lie in \(0, 180\)",
        ),
        (lambda: sky.keep_out("sun", epoch=EPOCH, observer=LOW, exclusion_deg=-1), r"must lie in \[0, 180\)"),
        (lambda: sky.keep_out("earth", epoch=EPOCH, observer=LOW, exclusion_deg=113), "must stay below 180"),
        (
            lambda: sky.keep_out("sun", epoch=EPOCH, observer=[7e3, 0, 0], exclusion_deg=1, for_duration_s=1),
            "a given position says nothing of its motion over 1 s",
        ),
        (
            lambda: sky.CircularOrbit(**{**vars(LOW), "altitude": -3.0}),
            r"altitude = -3.0: must lie in \(0, 150000\]",
        ),
        (
            lambda: sky.CircularOrbit(**{**vars(LOW), "altitude": 500e3}),
            "altitude = 500000.0: .* it is in km",
        ),
        (lambda: sky.CircularOrbit(**{**vars(LOW), "node": np.nan}), "node = nan: must lie in"),
        (lambda: sky.CircularOrbit(**{**vars(LOW), "node": "a"}), "node = 'a': must be a number"),
        (
            lambda: sky.CircularOrbit(**{**vars(LOW), "inclination": 97.4}),
            r"97.4: must lie in \[-pi, pi\] rad",
        ),
        (lambda: sky.parse_tle(None), "must be a text, not NoneType"),
        (lambda: sky.CircularOrbit(**{**vars(LOW), "epoch": "x"}), "epoch = 'x'"),
    ],
)
def test_what_cannot_be_answered_is_an_error_with_key_and_value(ask, words):
    with pytest.raises(ValueError, match=words):
        ask()


def test_a_missing_extra_is_named(monkeypatch):
    def absent(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(frames, "import_module", absent)
    assert sky.directions("earth", epoch=EPOCH, observer=LOW).shape == (3,)  # nothing but two-body motion
    with pytest.raises(ImportError, match=r"pyerfa is missing: pip install 'jaxplan\[orbit\]'"):
        sky.directions("sun", epoch=EPOCH, observer=LOW)
