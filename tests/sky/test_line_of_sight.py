"""Lines of sight against rays that are followed in small steps, through spheres and the ellipsoid."""

from dataclasses import replace

import numpy as np
import pytest
from heavens import teme_to_j2000

from jaxplan import sky
from jaxplan.model.hidden_spans import Hidden, after_hidden

EPOCH = "2026-06-20T09:30:00"
LOW = sky.CircularOrbit(altitude=600.0, inclination=1.7, node=0.2, latitude=1.0)
OTHERS = {
    "behind": sky.CircularOrbit(altitude=550.0, inclination=1.7, node=0.2, latitude=0.4),
    "across": sky.CircularOrbit(altitude=700.0, inclination=0.9, node=1.5, latitude=0.0),
    "high": sky.KeplerOrbit(
        semi_major_axis=26600.0, eccentricity=0.7, inclination=1.1, node=0.3, perigee=4.7, anomaly=2.5
    ),
    "still": sky.CircularOrbit(altitude=35786.0, inclination=0.0, node=0.0, latitude=2.0),
}
PLACES = {
    "lisbon": sky.GroundPoint(latitude=np.deg2rad(38.72), longitude=np.deg2rad(-9.14)),
    "quito": sky.GroundPoint(latitude=np.deg2rad(-0.2), longitude=np.deg2rad(-78.5)),
    "pole": sky.GroundPoint(latitude=np.deg2rad(-89.5), longitude=0.0),
}
DURATION = 9000.0
EDGE = 0.05  # s about the ends of spans at which nothing is asked


def places(thing, times):
    return sky.positions(thing, epoch=EPOCH, times=times)


def way(times, thing, share):
    """Points of the lines of sight, (k, shares, 3)."""
    here, there = (places(one, times)[:, None] for one in (LOW, thing))
    return here + share[:, None] * (there - here)


def told(spans, times):
    """Whether something is hidden at times, and whether these are not too near the ends of spans."""
    inside = np.zeros(len(times), bool)
    sure = np.ones(len(times), bool)
    for span in spans:
        inside |= (span.start <= times) & (times < span.end)
        sure &= (np.abs(times - span.start) > EDGE) & (np.abs(times - span.end) > EDGE)
    return inside, sure


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("atmosphere", [0.0, 100.0])
def test_a_satellite_is_hidden_while_the_ray_to_it_goes_through_earth_or_air(name, atmosphere):
    asked = {"epoch": EPOCH, "observer": LOW, "duration_s": DURATION, "atmosphere_km": atmosphere}
    spans = sky.hidden(OTHERS[name], name=name, **asked)
    times = np.linspace(0, DURATION, 701)
    inside, sure = told(spans, times)
    deepest = (
        np.linalg.norm(way(times, OTHERS[name], np.linspace(0, 1, 1001)), axis=-1).min(axis=1)
        - 6378.137
        - atmosphere
    )
    clear = np.abs(deepest) > 1.0  # km, of which the steps along the ray may be unaware
    np.testing.assert_array_equal((deepest < 0)[clear & sure], inside[clear & sure])
    assert np.sum(clear & sure) > 650
    assert {span.by for span in spans} <= {"the Earth"}
    assert {span.target for span in spans} <= {name}
    assert name != "across" or len(spans) > 1


def fixed_to_earth(times):
    """(k, 3, 3): from the axes of J2000 to those of the Earth, by Greenwich sidereal time (Meeus, 12.4)."""
    start = np.datetime64(EPOCH, "ns") - np.datetime64("2000-01-01T12:00:00", "ns")
    days = float(start / np.timedelta64(1, "D")) + times / 86400
    sidereal = np.deg2rad(280.46061837 + 360.98564736629 * days)
    c, s, o = np.cos(sidereal), np.sin(sidereal), np.zeros(len(times))
    about_pole = np.stack([c, s, o, -s, c, o, o, o, o + 1], axis=-1).reshape(-1, 3, 3)
    return about_pole @ teme_to_j2000(EPOCH).T


@pytest.mark.parametrize("name", PLACES)
def test_a_place_is_hidden_while_the_ray_to_it_goes_through_the_ellipsoid(name):
    pytest.importorskip("erfa", reason="pyerfa is not installed")
    spans = sky.hidden(PLACES[name], epoch=EPOCH, observer=LOW, duration_s=DURATION)
    times = np.linspace(0, DURATION, 701)
    inside, sure = told(spans, times)
    along = way(times, PLACES[name], 1 - np.geomspace(1e-6, 1, 1001)) @ np.swapaxes(
        fixed_to_earth(times), -1, -2
    )
    level = np.linalg.norm(along / [6378.137, 6378.137, 6356.752314245], axis=-1) - 1
    deepest = level.min(axis=1)
    clear = np.abs(deepest) > 1e-6
    np.testing.assert_array_equal((deepest < 0)[clear & sure], inside[clear & sure])
    assert np.sum(clear & sure) > 600
    assert inside.any()
    assert inside.all() == (name == "lisbon")  # which the orbit passes later
    assert {span.by for span in spans} == {"its horizon"}


def test_a_least_elevation_makes_spans_longer_to_just_where_it_is_reached():
    erfa = pytest.importorskip("erfa", reason="pyerfa is not installed")
    place = sky.GroundPoint(**vars(PLACES["quito"]) | {"minimum_elevation": np.deg2rad(10)})
    spans = sky.hidden(place, epoch=EPOCH, observer=LOW, duration_s=40000.0)
    ends = [span.end for span in spans if span.end < 40000] + [span.start for span in spans if span.start > 0]
    assert len(ends) >= 2
    here, there = (places(one, np.array(ends)) for one in (LOW, place))
    up = places(sky.GroundPoint(**vars(place) | {"altitude": 1e5}), np.array(ends)) - there
    found = np.pi / 2 - np.array([erfa.sepp(*pair) for pair in zip(up, here - there, strict=True)])
    np.testing.assert_allclose(np.rad2deg(found), 10, atol=1e-6)


def test_other_spheres_hide_what_is_behind_them_however_short():
    # a station that passes straight between, and once 60 km beside the line
    behind = sky.CircularOrbit(altitude=700.0, inclination=1.7, node=0.2, latitude=1.1)
    times = np.linspace(0, 600, 60001)
    passing = sky.CircularOrbit(altitude=650.0, inclination=-1.4, node=0.2 + np.pi, latitude=np.pi - 1.05)
    for shift, radius in ((0.0, 30.0), (0.0, 2.0), (0.005, 5.0), (0.02, 5.0)):
        thing = sky.CircularOrbit(**vars(passing) | {"latitude": passing.latitude + shift})
        spans = sky.hidden(
            behind,
            epoch=EPOCH,
            observer=LOW,
            duration_s=600.0,
            occulters=[sky.occulter("station", thing, radius_km=radius)],
        )
        here, there, middle = (places(one, times) for one in (LOW, behind, thing))
        line, between = there - here, middle - here
        share = np.sum(line * between, axis=-1) / np.sum(line * line, axis=-1)
        off = np.linalg.norm(between - share[:, None] * line, axis=-1)
        dark = (off < radius) & (share > 0) & (share < 1)
        assert len(spans) == (1 if dark.any() else 0)
        if dark.any():
            assert spans[0].by == "station"
            assert spans[0].start == pytest.approx(times[dark][0], abs=2e-2)
            assert spans[0].end == pytest.approx(times[dark][-1], abs=2e-2)


def test_the_moon_hides_what_is_behind_it_when_asked_to():
    pytest.importorskip("erfa", reason="pyerfa is not installed")
    moon = sky.positions("moon", epoch=EPOCH, times=1000.0)
    here = sky.positions(LOW, epoch=EPOCH, times=1000.0)
    beyond = here + 2 * (moon - here)  # where the Moon is in between after 1,000 s
    far = sky.Ephemeris.through([0, 700, 1500, 3000], np.tile(beyond, (4, 1)))
    asked = {"epoch": EPOCH, "observer": LOW, "duration_s": 3000.0}
    assert "moon" not in {span.by for span in sky.hidden(far, **asked)}
    spans = [span for span in sky.hidden(far, **asked, occulters=[sky.occulter("moon")]) if span.by == "moon"]
    times = np.linspace(0, 3000, 3001)
    looked = sky.positions("moon", epoch=EPOCH, times=times) - places(LOW, times)
    line = beyond - places(LOW, times)
    apart = np.linalg.norm(np.cross(looked, line), axis=-1) / np.linalg.norm(line, axis=-1)
    inside, sure = told(spans, times)
    np.testing.assert_array_equal((apart < 1737.4)[sure], inside[sure])
    assert inside[1000]


def test_a_target_knows_when_it_is_hidden_and_bodies_never_are():
    asked = {"epoch": EPOCH, "observer": LOW, "duration_s": 3000.0}
    path = sky.target(OTHERS["across"], name="across", **asked)
    assert path.hidden == sky.hidden(OTHERS["across"], name="across", **asked)
    assert path.hidden
    np.testing.assert_array_equal(path.samples, sky.path(OTHERS["across"], **asked).samples)
    assert sky.target("nadir", **asked).hidden == ()


def test_a_time_is_moved_behind_all_spans_that_follow_each_other():
    spans = [Hidden(target="a", by="b", start=start, end=end) for start, end in ((8, 20), (0, 10), (30, 40))]
    found = [after_hidden(spans, time) for time in (-1.0, 0.0, 9.0, 15.0, 20.0, 29.0, 30.0, 40.0)]
    assert found == [-1.0, 20, 20, 20, 20.0, 29.0, 40, 40.0]
    assert after_hidden([], 7.0) == 7.0


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: sky.occulter("earth"), "name = 'earth': must be 'sun' or 'moon'"),
        (lambda: sky.occulter("x", LOW), "radius_km: missing, since a satellite"),
        (lambda: sky.occulter("x", LOW, radius_km=0), r"radius_km = 0: must lie in \(0, 1e6\]"),
        (
            lambda: sky.hidden(LOW, epoch=EPOCH, observer=LOW, duration_s=1.0, atmosphere_km=2e3),
            "atmosphere_km = 2000.0: must lie in",
        ),
        (
            lambda: sky.hidden(
                OTHERS["high"], epoch=EPOCH, observer=LOW, duration_s=1.0, atmosphere_km=700.0
            ),
            "observer: 6978.14 km from the centre of the Earth, must be beyond 7078.14",
        ),
    ],
)
def test_what_cannot_be_answered_is_an_error_with_key_and_value(ask, words):
    with pytest.raises(ValueError, match=words):
        ask()


def test_targets_have_names_though_they_are_never_hidden():
    when = {"epoch": EPOCH, "observer": LOW, "duration_s": 100.0}
    assert sky.target("moon", **when).target == "moon"
    assert sky.target("nadir", name="down", **when).target == "down"
    assert sky.target(OTHERS["behind"], name="behind", **when).target == "behind"
    assert sky.target(OTHERS["behind"], **when).target == ""
    spans = (Hidden(target="site", by="its horizon", start=0.0, end=9.0),)
    assert replace(sky.target(OTHERS["behind"], **when), hidden=spans).target == "site"
