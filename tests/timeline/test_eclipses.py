"""Eclipses from the directions to Sun and Earth alone, beside those from positions."""

import numpy as np
import pytest
from scipy.optimize import brentq

from jaxplan import sky
from jaxplan.model.directions import DirectionPath
from jaxplan.timeline.eclipses import eclipses, paths_of

EPOCH = np.datetime64("2026-06-20T09:30:00")
END = 12000.0
ORBITS = {
    "circular": sky.CircularOrbit(altitude=550.0, inclination=np.deg2rad(53), node=1.0, latitude=0.3),
    "eccentric": sky.KeplerOrbit(
        semi_major_axis=9000.0,
        eccentricity=0.2,
        inclination=np.deg2rad(30),
        node=0.4,
        perigee=1.0,
        anomaly=0.5,
    ),
}


def _paths(orbit):
    return [sky.path(body, epoch=EPOCH, observer=orbit, duration_s=END) for body in ("sun", "earth")]


@pytest.mark.parametrize("name", ORBITS)
def test_eclipses_are_those_of_the_positions(name):
    orbit = ORBITS[name]

    def clearance(time):
        here = sky.positions(orbit, epoch=EPOCH, times=time)
        distance = np.linalg.norm(here)
        sun = sky.directions("sun", epoch=EPOCH, observer=orbit, times=time)
        return np.arccos(-here @ sun / distance) - np.arcsin(sky.RADII["earth"] / distance)

    times = np.linspace(0, END, 400)
    values = np.array([clearance(time) for time in times])
    places = np.flatnonzero((values[1:] < 0) != (values[:-1] < 0))
    wanted = [brentq(clearance, times[place], times[place + 1]) for place in places]
    assert len(wanted) >= 2
    found = eclipses(*_paths(orbit), END)
    np.testing.assert_allclose(found.times, wanted, atol=0.02)
    np.testing.assert_array_equal(found.rising, values[places] < 0)


def test_nothing_is_told_of_what_does_not_move_as_on_an_orbit():
    sun = DirectionPath.still(np.array([1.0, 0.0, 0.0]))
    assert eclipses(sun, sun, END) is None
    times = np.linspace(0, END, 200)
    angle = times / 1000 + 0.3 * np.sin(times / 150)
    wobbly = DirectionPath.through(times, np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1))
    assert eclipses(sun, wobbly, END) is None
    short = sky.path("earth", epoch=EPOCH, observer=ORBITS["circular"], duration_s=100.0)
    assert eclipses(sun, short, 100.0) is None


def test_paths_are_those_of_zones_with_the_bodies_names():
    zones = [
        sky.keep_out(body, epoch=EPOCH, observer=ORBITS["circular"], half_angle_deg=10, name=name)
        for body, name in (("earth", "Nadir"), ("sun", "SUN"), ("moon", "moon"))
    ]
    sun, earth = paths_of(zones)
    assert (sun, earth) is not None
    np.testing.assert_array_equal(sun.at(0.0), zones[1].axis_at())
    np.testing.assert_array_equal(earth.at(0.0), zones[0].axis_at())
    assert paths_of(zones[:1]) is None
