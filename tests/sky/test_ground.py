"""Points of the ground against handbooks' chains, and the observer's own directions against closed forms."""

import numpy as np
import pytest
from heavens import on_the_ground

from jaxplan import sky
from jaxplan.geometry.vectors import separation
from jaxplan.model.epochs import parse_epoch
from jaxplan.sky.ground import elevation

erfa = pytest.importorskip("erfa", reason="pyerfa is not installed")

EPOCH = "2026-06-20T09:30:00"
LISBON = sky.GroundPoint(latitude=np.deg2rad(38.72), longitude=np.deg2rad(-9.14), altitude=100.0)
LOW = sky.CircularOrbit(altitude=500.0, inclination=1.7, node=0.2, latitude=1.0)


def turned(utc, times, place):
    """Earth-fixed axes to the GCRS by the equinox: sidereal time, nutation and precession, not by the CIO."""
    tt = erfa.taitt(
        *erfa.utctai(
            *erfa.dtf2d("UTC", *[int(p) for p in utc.replace("T", "-").replace(":", "-").split("-")])
        )
    )
    days = times / 86400
    ut = erfa.dtf2d("UTC", *[int(p) for p in utc.replace("T", "-").replace(":", "-").split("-")])
    gast = erfa.gst06a(ut[0], ut[1] + days, tt[0], tt[1] + days)
    c, s = np.cos(gast), np.sin(gast)
    true = np.stack([c * place[0] - s * place[1], s * place[0] + c * place[1], 0 * c + place[2]], axis=-1)
    return np.einsum("...ji,...j->...i", erfa.pnm06a(tt[0], tt[1] + days), true)


@pytest.mark.parametrize(
    ("latitude", "longitude"), [(0, 0), (38.72, -9.14), (-77.8, 166.7), (90, 0), (-33, 151)]
)
def test_a_place_at_sea_level_is_where_handbooks_have_it(latitude, longitude):
    point = sky.GroundPoint(latitude=np.deg2rad(latitude), longitude=np.deg2rad(longitude))
    for utc in ("1999-05-01T17:30:00", "2026-06-20T09:30:00"):
        found = sky.positions(point, epoch=utc)
        np.testing.assert_allclose(found, on_the_ground(utc, latitude, longitude), atol=0.03)  # km


@pytest.mark.parametrize("span", [0.0, 600.0, 86400.0, 250_000.0])
def test_many_instants_have_the_earth_where_each_by_itself_has_it(span):
    place = erfa.gd2gc(1, LISBON.longitude, LISBON.latitude, LISBON.altitude) * 1e-3
    times = np.linspace(0, span, 200)
    found = sky.positions(LISBON, epoch=EPOCH, times=times)
    tai = erfa.utctai(*erfa.dtf2d("UTC", 2026, 6, 20, 9, 30, 0.0))
    ut = erfa.dtf2d("UTC", 2026, 6, 20, 9, 30, 0.0)
    tt = erfa.taitt(*tai)
    turns = erfa.c2t06a(tt[0], tt[1] + times / 86400, ut[0], ut[1] + times / 86400, 0.0, 0.0)
    np.testing.assert_allclose(found, np.einsum("kji,j->ki", turns, place), rtol=0, atol=2e-9)  # km


def test_places_turn_with_the_earth_as_by_the_equinox():
    times = np.linspace(0, 86400, 97)
    place = erfa.gd2gc(1, LISBON.longitude, LISBON.latitude, LISBON.altitude) * 1e-3
    np.testing.assert_allclose(
        sky.positions(LISBON, epoch=EPOCH, times=times), turned(EPOCH, times, place), atol=1e-5
    )


def test_a_place_is_back_after_a_sidereal_day_and_moves_as_its_velocity_says():
    day = 86164.0905
    before, after = sky.positions(LISBON, epoch=EPOCH, times=[0.0, day])
    assert np.linalg.norm(before - after) < 0.01
    around = sky.positions(LISBON, epoch=EPOCH, times=[-1.0, 1.0])
    velocity = sky.velocities(LISBON, epoch=EPOCH)
    np.testing.assert_allclose(velocity, np.diff(around, axis=0)[0] / 2, atol=2e-8)  # nutation
    assert np.linalg.norm(velocity) == pytest.approx(0.4651 * np.cos(LISBON.latitude), rel=3e-3)


def test_altitudes_are_along_the_normal_of_the_ellipsoid():
    for latitude in (-1.2, 0.0, 0.7, np.pi / 2):
        low, high = (sky.GroundPoint(latitude=latitude, longitude=0.4, altitude=h) for h in (0.0, 8000.0))
        np.testing.assert_allclose(high.place - low.place, 8 * low.up, atol=1e-12)
        assert low.place[:2] @ low.place[:2] / 6378.137**2 + (
            low.place[2] / 6356.752314245
        ) ** 2 == pytest.approx(1)


def test_elevations_are_those_of_the_angles_in_a_triangle():
    epoch, times = parse_epoch(EPOCH), np.linspace(0, 6000, 301)
    here = sky.positions(LOW, epoch=EPOCH, times=times)
    there = sky.positions(LISBON, epoch=EPOCH, times=times)
    above = sky.positions(
        sky.GroundPoint(latitude=LISBON.latitude, longitude=LISBON.longitude, altitude=1e5),
        epoch=EPOCH,
        times=times,
    )
    found = elevation(LISBON, here, epoch, times)
    np.testing.assert_allclose(found, np.pi / 2 - separation(above - there, here - there), atol=1e-9)


def test_names_of_directions_go_with_the_observers_own_motion():
    times = np.linspace(0, 5000, 11)
    asked = {"epoch": EPOCH, "observer": LOW, "times": times}
    u = 1.0 + np.sqrt(398600.4418 / 6878.137**3) * times
    node = np.array([np.cos(0.2), np.sin(0.2), 0])
    normal = np.array([np.sin(1.7) * np.sin(0.2), -np.sin(1.7) * np.cos(0.2), np.cos(1.7)])
    up = np.cos(u)[:, None] * node + np.sin(u)[:, None] * np.cross(normal, node)
    for name, expected in {
        "nadir": -up,
        "zenith": up,
        "ram": np.cross(normal, up),
        "orbit_normal": np.broadcast_to(normal, up.shape),
    }.items():
        np.testing.assert_allclose(sky.directions(name, **asked), expected, atol=1e-12)
        path = sky.path(name, epoch=EPOCH, observer=LOW, duration_s=5000.0)
        np.testing.assert_allclose(path.at(times), expected, atol=2e-9)
        rate = sky.direction_rates(name, **asked)
        np.testing.assert_allclose(rate, path.rate(times), atol=2e-8)
    np.testing.assert_array_equal(sky.directions("nadir", **asked), sky.directions("earth", **asked))


def test_ram_is_along_the_inertial_velocity_of_an_eccentric_orbit():
    orbit = sky.KeplerOrbit(
        semi_major_axis=8000.0, eccentricity=0.15, inclination=1.0, node=0.3, perigee=0.2, anomaly=1.4
    )
    around = sky.positions(orbit, epoch=EPOCH, times=[-0.05, 0.05])
    moved = np.diff(around, axis=0)[0]
    found = sky.directions("ram", epoch=EPOCH, observer=orbit)
    np.testing.assert_allclose(found, moved / np.linalg.norm(moved), atol=1e-9)
    climbing = found @ sky.directions("zenith", epoch=EPOCH, observer=orbit)
    slope = 0.15 * np.sin(1.4) / (1 + 0.15 * np.cos(1.4))  # of the flight path
    assert climbing == pytest.approx(np.sin(np.arctan(slope)), abs=1e-12)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: sky.GroundPoint(latitude=38.7, longitude=0.0), r"latitude = 38.7: must lie in \[-pi / 2"),
        (lambda: sky.GroundPoint(latitude=np.nan, longitude=0.0), "latitude = nan: must lie in"),
        (lambda: sky.GroundPoint(latitude=0.0, longitude=100.0), "longitude = 100.0: must lie in"),
        (lambda: sky.GroundPoint(latitude=0.0, longitude="e"), "longitude = 'e': must be a number"),
        (lambda: sky.GroundPoint(latitude=0.0, longitude=0, altitude=2e5), "altitude = 200000.0: must lie"),
        (
            lambda: sky.GroundPoint(latitude=0.0, longitude=0, minimum_elevation=5.0),
            "minimum_elevation = 5.0",
        ),
        (
            lambda: sky.directions("ram", epoch=EPOCH, observer="earth"),
            "'ram': the observer is at the Earth's",
        ),
        (lambda: sky.directions("ram", epoch=EPOCH, observer=[7e3, 0, 0]), "velocity is not known"),
    ],
)
def test_what_cannot_be_answered_is_an_error_with_key_and_value(ask, words):
    with pytest.raises(ValueError, match=words):
        ask()
