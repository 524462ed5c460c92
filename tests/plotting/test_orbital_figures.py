"""Figures along an orbit: directions and attitudes in the local orbital frame, and the ground track.

References are plain numpy: a circular orbit in closed form, Euler angles by scipy, and the turning Earth by
the formulas of handbooks (`heavens`).
"""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_observer, make_plan
from drawn import assert_apart
from heavens import almanac_sun, earth_to_j2000, on_the_ground
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.path import Path
from reference import assert_each
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.plotting.ground_track import (
    _SITE_MARK,
    _TRACK_LINE,
    FILE,
    FINE,
    GROUND_SIZE,
    _name_sites,
    _Site,
    coasts,
    land,
    within,
)
from jaxplan.plotting.sky import SPHERE_SIZE
from jaxplan.plotting.style import device_style, motion
from jaxplan.sky.ground import geodetic, surface_point

pytest.importorskip("erfa", reason="the extra orbit is not installed")
ORBIT = jp.sky.CircularOrbit(altitude=620.0, inclination=np.deg2rad(97.9), node=0.7, latitude=2.1)
EPOCH = np.datetime64("2026-06-20T09:30:00", "ns")
DURATION = 3000.0  # s, half a revolution
BARS = 3e-5  # rad: by which handbooks and pyerfa differ in the turning Earth, with room


def orbit(times):
    """Positions and velocities of the orbit (k, 3), in radii and without a unit, by plain numpy."""
    radius = 6378.137 + 620.0
    turned = 2.1 + np.sqrt(398600.4418 / radius**3) * np.atleast_1d(times)
    c, s, i = np.cos(0.7), np.sin(0.7), np.deg2rad(97.9)
    first, second = np.array([c, s, 0]), np.array([-s * np.cos(i), c * np.cos(i), np.sin(i)])
    here = np.cos(turned)[:, None] * first + np.sin(turned)[:, None] * second
    return radius * here, np.cos(turned)[:, None] * second - np.sin(turned)[:, None] * first


def frames(times):
    """Axes (k, 3, 3) of the local orbital frame as rows: along the velocity, to the right, down."""
    here, ahead = orbit(times)
    down = -here / np.linalg.norm(here, axis=1, keepdims=True)
    return np.stack([ahead, np.cross(down, ahead), down], axis=1)


def utc(time):
    return str(EPOCH + np.timedelta64(round(time * 1e9), "ns"))


@pytest.fixture(scope="module")
def plan():
    made = make_plan(zones=3, duration=DURATION, craft=make_observer())
    return replace(made, scenario=replace(made.scenario, epoch=EPOCH))


def lines_of(axes, number):
    """The points of curves that have the colour of a device, and no mark."""
    wanted = device_style(number)["color"]
    return [
        np.column_stack(line.get_data())
        for line in axes.lines
        if line.get_color() == wanted and line.get_marker() == "None" and len(line.get_xdata()) > 2
    ]


def on_discs(directions):
    """Where directions (..., 3) of the local frame are on the two discs: true angles from nadir or zenith."""
    off = np.rad2deg(np.arccos(np.clip(directions[..., 2], -1, 1)))
    turn = np.arctan2(directions[..., 1], directions[..., 0])
    below = off <= 90
    off = np.where(below, off, 180 - off)
    return np.stack([np.where(below, -104.0, 104.0) + off * np.sin(turn), off * np.cos(turn)], axis=-1)


def nearest(points, drawn):
    """Distance (k,) of each of (k, 2) points from the nearest of those drawn (m, 2)."""
    known = drawn[np.isfinite(drawn[:, 0])]
    return np.linalg.norm(points[:, None] - known[None], axis=-1).min(axis=1)


def test_the_local_frame_has_nadir_below_and_the_right_against_the_orbits_normal():
    times = np.linspace(-500, 5000, 40)
    axes = jp.sky.local_axes(ORBIT, epoch=EPOCH, times=times)
    np.testing.assert_allclose(axes, frames(times), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(axes), 1, atol=1e-12)
    assert jp.sky.local_axes(ORBIT, epoch=EPOCH).shape == (3, 3)


def test_on_an_eccentric_orbit_down_and_across_are_kept_and_ahead_is_level():
    there = jp.sky.KeplerOrbit(
        semi_major_axis=9000.0, eccentricity=0.2, inclination=1.0, node=0.3, perigee=0.5, anomaly=1.3
    )
    times = np.linspace(0, 6000, 20)
    ahead, right, down = np.moveaxis(jp.sky.local_axes(there, epoch=EPOCH, times=times), 1, 0)
    r, v = (
        jp.sky.positions(there, epoch=EPOCH, times=times),
        jp.sky.velocities(there, epoch=EPOCH, times=times),
    )
    assert_each(np.sum(down * r, axis=1) / np.linalg.norm(r, axis=1), "<", -1 + 1e-12)
    np.testing.assert_allclose(np.sum(right * v, axis=1), 0, atol=1e-9)
    assert_each(np.sum(ahead * v, axis=1), ">", 0)


def test_boresights_zones_and_marks_stand_on_the_discs_where_they_are_in_the_frame(plan):
    axes = jp.plot.sphere(plan, frame="orbital", observer=ORBIT)
    moves, craft = motion(plan), plan.scenario.spacecraft
    seen = np.einsum("kij,kdj->kdi", frames(moves.times), moves.boresights)
    for device in range(len(craft.device_names)):
        drawn = max(lines_of(axes, device), key=len)
        assert_each(nearest(on_discs(seen[:, device]), drawn), "<", 1e-5)
        steps = np.linalg.norm(np.diff(drawn, axis=0), axis=-1)
        assert_each(steps[np.isfinite(steps)], "<", 3)  # no stroke from disc to disc, none across one
        known = drawn[np.isfinite(drawn[:, 0])]
        assert_each(np.hypot(np.abs(known[:, 0]) - 104, known[:, 1]), "<", 90 + 1e-9)
    start, goal = ([line for line in axes.lines if line.get_marker() == mark] for mark in "*s")
    for marks, time in ((start, 0), (goal, -1)):
        places = np.array([line.get_xydata()[0] for line in marks if len(line.get_xdata())])
        np.testing.assert_allclose(places, on_discs(seen[time]), atol=1e-6)


def test_the_earth_is_drawn_to_its_limb_about_nadir(plan):
    axes = jp.plot.sphere(plan, frame="orbital", observer=ORBIT)
    limb = np.rad2deg(np.arcsin(6378.137 / (6378.137 + 620.0)))
    found = [own for own in axes.patches if isinstance(own, Circle) and np.isclose(own.radius, limb)]
    assert [own.center for own in found] == [(-104.0, 0.0)]
    assert "the Earth, to its limb" in [text.get_text() for text in axes.get_legend().get_texts()]


def test_what_stands_still_in_space_moves_and_the_earth_does_not(plan):
    down = jp.sky.keep_out(
        "earth", epoch=EPOCH, observer=ORBIT, exclusion_deg=5.0, for_duration_s=DURATION, moving=True
    )
    still = plan.scenario.keep_out[0]
    scene = replace(plan.scenario, keep_out=(down, still))
    axes = jp.plot.sphere(replace(plan, scenario=scene), frame="orbital", observer=ORBIT)
    names = {text.get_text().split("\n")[0]: np.array(text.get_position()) for text in axes.texts}
    assert np.linalg.norm(names["earth"] + [104, 0]) < 70
    there = frames([0.0, DURATION]) @ still.direction
    tracks = [line.get_xydata() for line in axes.lines if line.get_zorder() == 1.7]
    (track,) = tracks  # of the zone that stands still; that of the Earth is a point
    np.testing.assert_allclose(track[[0, -1]], on_discs(there), atol=1e-6)


def test_names_on_the_discs_do_not_lie_over_each_other_or_over_what_is_looked_at(plan):
    down = jp.sky.keep_out(
        "earth", epoch=EPOCH, observer=ORBIT, exclusion_deg=20.0, for_duration_s=DURATION, moving=True
    )
    sun = jp.sky.keep_out(
        "sun", epoch=EPOCH, observer=ORBIT, half_angle_deg=30, for_duration_s=DURATION, moving=True
    )
    scene = replace(plan.scenario, keep_out=(down, sun, *plan.scenario.keep_out))
    figure = Figure(figsize=SPHERE_SIZE, layout="constrained")
    axes = jp.plot.sphere(replace(plan, scenario=scene), figure, frame="orbital", observer=ORBIT)
    assert_apart(figure, [text for text in axes.texts if text.get_visible()])


def test_the_globe_has_the_zenith_up_and_the_right_to_the_right_of_ahead(plan):
    axes = jp.plot.globe(plan, view=(180.0, 0.0), frame="orbital", observer=ORBIT)  # the eye is behind
    moves = motion(plan)
    seen = np.einsum("kij,kdj->kdi", frames(moves.times), moves.boresights)[:, 0]
    drawn = np.concatenate(lines_of(axes, 0))
    known = drawn[np.isfinite(drawn[:, 0])]
    expected = np.column_stack([seen[:, 1], -seen[:, 2]])
    apart = np.linalg.norm(expected[:, None] - known[None], axis=-1).min(axis=1)
    assert_each(apart, "<", 1e-9)
    assert "zenith up" in axes.texts[0].get_text() or any(
        "zenith up" in text.get_text() for text in axes.texts
    )


def test_roll_pitch_and_yaw_are_those_of_the_sequence_about_z_y_x(plan):
    angles, boresights = jp.plot.attitude(plan, ORBIT)
    moves = motion(plan)
    body = Rotation.from_matrix(frames(moves.times) @ moves.values.attitude)
    yaw, pitch, roll = body.as_euler("ZYX", degrees=True).T
    for line, expected in zip(angles.lines[:3], (roll, pitch, yaw), strict=True):
        times, drawn = line.get_data()
        places = np.isin(times, moves.times) & np.isfinite(drawn)
        assert np.sum(places) == len(moves.times)
        np.testing.assert_allclose(drawn[places], expected, atol=1e-6)
    down = frames(moves.times)[:, 2]
    for device, line in enumerate(boresights.lines[: len(plan.scenario.spacecraft.device_names)]):
        off = np.rad2deg(np.arccos(np.clip(np.sum(moves.boresights[:, device] * down, axis=1), -1, 1)))
        np.testing.assert_allclose(line.get_ydata(), off, atol=1e-5)


def test_the_ground_track_is_below_the_spacecraft_on_the_turning_earth(plan):
    axes = jp.plot.ground_track(plan, ORBIT)
    (way,) = [
        line for line in axes.lines if line.get_color() == _TRACK_LINE["color"] and len(line.get_xdata()) > 9
    ]
    points = way.get_xydata()
    moves = motion(plan)
    assert_each(np.abs(np.diff(points[:, 0]))[np.isfinite(np.diff(points[:, 0]))], "<", 180)
    kept = points[np.isfinite(points[:, 0]) & (np.abs(points[:, 0]) < 180)]
    assert len(kept) == len(moves.times)
    here, _ = orbit(moves.times)
    for place in range(0, len(kept), 97):
        time = moves.times[place]
        longitude, latitude = np.deg2rad(kept[place])
        up = earth_to_j2000(utc(time)) @ [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ]
        above = here[place] - on_the_ground(utc(time), *np.rad2deg([latitude, longitude]))
        assert np.linalg.norm(np.cross(up, above)) < BARS * 7000
        assert up @ above > 600


def test_boresights_meet_the_near_side_of_the_earth_and_leave_gaps_beside_it(plan):
    axes = jp.plot.ground_track(plan, ORBIT)
    moves, craft = motion(plan), plan.scenario.spacecraft
    here, _ = orbit(moves.times)
    told = [text.get_text() for text in axes.get_legend().get_texts()]
    met = 0
    for device, name in enumerate(craft.device_names):
        down = -here / np.linalg.norm(here, axis=1, keepdims=True)
        off = np.arccos(np.clip(np.sum(moves.boresights[:, device] * down, axis=1), -1, 1))
        radius = np.linalg.norm(here[0])
        tracks = lines_of(axes, device)
        if name == "array" or np.min(off) > np.arcsin(6378.2 / radius):
            assert not tracks
            assert name == "array" or any(name in text and "past the Earth" in text for text in told)
            continue
        (track,) = tracks
        inside, outside = off < np.arcsin(6356.7 / radius), off > np.arcsin(6378.2 / radius)
        drawn = track[~(np.abs(track[:, 0]) == 180)]
        if np.any(np.abs(track[:, 0]) == 180):  # three rows more for each crossing of the edge
            edges = np.flatnonzero(np.abs(track[:-2, 0]) == 180)
            drawn = np.delete(track, np.concatenate([edges[::2] + i for i in range(3)]), axis=0)
        assert len(drawn) == len(moves.times)
        there = np.isfinite(drawn[:, 0])
        assert np.all(there[inside])
        assert not np.any(there[outside])
        for place in np.flatnonzero(there)[::61]:
            ground = on_the_ground(utc(moves.times[place]), drawn[place, 1], drawn[place, 0])
            way = ground - here[place]
            near = np.linalg.norm(way)
            assert np.linalg.norm(np.cross(way, moves.boresights[place, device])) < 7000 * BARS
            assert way @ ground < 0 < near
            met += 1
        words = next(text for text in told if text.startswith(name))
        assert ("of the time" in words) == (not np.all(there))
    assert met > 5


def test_targets_on_the_ground_are_found_again_and_named_and_others_are_not(plan):
    points = {"lisbon": (38.72, -9.14, 100.0), "high": (-20.0, 135.0, 3000.0)}
    when = {"epoch": EPOCH, "observer": ORBIT, "duration_s": DURATION}
    paths = {
        name: jp.sky.target(
            jp.sky.GroundPoint(latitude=np.deg2rad(lat), longitude=np.deg2rad(lon), altitude=height),
            name=name,
            **when,
        )
        for name, (lat, lon, height) in points.items()
    }
    other = jp.sky.CircularOrbit(altitude=800.0, inclination=1.0, node=2.0, latitude=0.0)
    paths["moon"] = jp.sky.target("moon", **when)
    paths["neighbour"] = jp.sky.target(other, name="neighbour", **when)
    devices = ("antenna", "telescope", "tracker-1", "tracker-2")
    goal = jp.Targets(directions=tuple(paths.values()), devices=devices)
    axes = jp.plot.ground_track(replace(plan, scenario=replace(plan.scenario, goal=goal)), ORBIT)
    assert {text.get_text() for text in axes.texts} == set(points)
    marks = np.array(
        [line.get_xydata()[0] for line in axes.lines if line.get_marker() == _SITE_MARK["marker"]]
    )
    np.testing.assert_allclose(marks, [(lon, lat) for lat, lon, _ in points.values()], atol=1e-5)


@pytest.mark.parametrize("covered", [None, (1, 0), (-1, 0), (0, 1), (0, -1), "sides"])
@pytest.mark.parametrize("name", ["illilli", "MWMWMWM"])
def test_names_of_places_stand_right_at_their_marks_or_have_a_line(name, covered):
    figure = Figure(figsize=GROUND_SIZE)
    axes = figure.add_axes((0.08, 0.1, 0.62, 0.75))
    axes.set(xlim=(-180, 180), ylim=(-90, 90))
    place, points = np.array([10.0, 20.0]), np.zeros((0, 2))
    if covered is not None:  # by curves that a name should not cover
        sides = [(1, 0), (-1, 0), (0, 1), (0, -1)] if covered == "sides" else [covered]
        spread = np.linspace(-1, 1, 9)
        points = np.concatenate([place + np.array([15.0, 8.0]) * one + spread[:, None] for one in sides])
    _name_sites(axes, [_Site(name, place)], points)
    figure.draw_without_rendering()
    (text,) = axes.texts
    box, mark = text.get_window_extent(), axes.transData.transform(place)
    corner = np.clip(mark, [box.x0, box.y0], [box.x1, box.y1])
    away = np.abs(corner - mark) / figure.dpi
    assert np.max(away) < 0.16, "inches from the mark to the name"
    beside = np.all(away > 0.02)
    assert beside == (covered == "sides") == bool(axes.lines)
    for line in axes.lines:
        ends = axes.transData.transform(line.get_xydata())
        np.testing.assert_allclose(ends[0], mark)
        assert box.padded(3).contains(*ends[1])


def test_it_is_night_where_the_sun_is_below_the_horizon(plan):
    axes = jp.plot.ground_track(plan, ORBIT)
    (night,) = [one for one in axes.collections if isinstance(one, ContourSet)]
    sun = earth_to_j2000(utc(DURATION / 2)).T @ almanac_sun(utc(DURATION / 2))
    east, north = np.meshgrid(np.arange(-175, 180, 10), np.arange(-85, 90, 10))
    if axes.get_xlim() != (-180, 180):
        pytest.fail("the track of half a revolution needs the whole Earth")
    up = np.array(
        [
            np.cos(np.deg2rad(north)) * np.cos(np.deg2rad(east)),
            np.cos(np.deg2rad(north)) * np.sin(np.deg2rad(east)),
            np.sin(np.deg2rad(north)),
        ]
    )
    height = np.tensordot(sun, up, axes=1).ravel()
    dark = night.get_paths()[0].contains_points(np.column_stack([east.ravel(), north.ravel()]))
    sure = np.abs(height) > 0.02
    np.testing.assert_array_equal(dark[sure], height[sure] < 0)


@pytest.mark.parametrize("file", [FILE, FINE])
def test_the_map_has_coasts_and_land_where_they_are_known_to_be(file):
    inside = {"Moscow": (37.6, 55.8), "Brasilia": (-47.9, -15.8), "Alice Springs": (133.9, -23.7)}
    inside |= {"the south pole": (0, -89.0), "Wrangel's other side": (-178, 67.0), "Reykholt": (-19, 64.7)}
    water = {
        "the Atlantic": (-40, 30),
        "the Gulf of Guinea": (0, 0),
        "Bengal": (88, 15),
        "Tasman": (160, -38),
    }
    for places, expected in ((inside, 1), (water, 0)):
        for name, place in places.items():
            assert sum(Path(ring).contains_point(place) for ring in land(file)) == expected, name
    for ring in land(file):
        np.testing.assert_allclose(ring[0], ring[-1], atol=1e-9)
        assert_each(np.abs(ring[:, 1]), "<=", 90.0 + 1e-9)
    for line in coasts(file):  # none runs along the edge of the map, or across it
        steps = np.abs(np.diff(line, axis=0))
        assert_each(steps[:, 0], "<", 30)
        assert np.max(line[:, 1]) > -89
    nice = np.concatenate(coasts(file)) - [7.26, 43.70]
    assert np.min(np.hypot(*nice.T)) < 2.0


def test_a_map_of_a_region_has_the_finer_coasts_and_none_that_are_elsewhere():
    low, high = np.array([-30.0, 20.0]), np.array([10.0, 45.0])
    near = within(coasts(FINE), low, high)
    assert 0 < len(near) < len(coasts(FINE)) / 5
    assert all(np.any(np.all((line >= low) & (line <= high), axis=1)) or len(line) > 50 for line in near)
    canaries = Path(next(ring for ring in land(FINE) if Path(ring).contains_point((-15.6, 28.0))))
    assert canaries.get_extents().width < 1.0
    assert not any(Path(ring).contains_point((-15.6, 28.0)) for ring in land(FILE))


def test_lines_meet_the_ellipsoid_first_on_its_near_side():
    rng = np.random.default_rng(1)
    places = rng.normal(size=(200, 3))
    places *= (rng.uniform(6800, 42000, 200) / np.linalg.norm(places, axis=1))[:, None]
    ways = rng.normal(size=(200, 3)) - 2 * places / np.linalg.norm(places, axis=1)[:, None]
    axes = np.array([6378.137, 6378.137, 6378.137 * (1 - 1 / 298.257223563)])
    found = surface_point(places, ways)
    a, b = np.sum((ways / axes) ** 2, axis=1), 2 * np.sum(ways * places / axes**2, axis=1)
    c = np.sum((places / axes) ** 2, axis=1) - 1
    with np.errstate(invalid="ignore"):
        share = (-b - np.sqrt(b**2 - 4 * a * c)) / (2 * a)
    expected = np.where((share > 0)[:, None], places + share[:, None] * ways, np.nan)
    assert 20 < np.sum(np.isfinite(expected[:, 0])) < 190
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert np.all(np.isnan(surface_point(places, places)))  # away from it
    assert np.all(np.isnan(surface_point(np.array([100.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))))


def test_geodetic_coordinates_are_those_of_the_point():
    rng = np.random.default_rng(2)
    given = np.column_stack(
        [rng.uniform(-1.5, 1.5, 30), rng.uniform(-3.1, 3.1, 30), rng.uniform(-1e3, 1e5, 30)]
    )
    places = [jp.sky.GroundPoint(latitude=a, longitude=b, altitude=c).place for a, b, c in given.tolist()]
    latitude, longitude, altitude = geodetic(np.array([*places, [np.nan] * 3]))
    np.testing.assert_allclose(latitude[:-1], given[:, 0], atol=1e-12)
    np.testing.assert_allclose(longitude[:-1], given[:, 1], atol=1e-12)
    np.testing.assert_allclose(altitude[:-1], given[:, 2], atol=1e-5)
    assert np.isnan([latitude[-1], longitude[-1], altitude[-1]]).all()


@pytest.mark.parametrize(
    ("draw", "kind", "words"),
    [
        (lambda p: jp.plot.sphere(p, frame="orbital"), ValueError, "frame = 'orbital': needs observer"),
        (lambda p: jp.plot.sphere(p, frame="lvlh", observer=ORBIT), ValueError, "frame = 'lvlh': must be"),
        (lambda p: jp.plot.globe(p, observer=ORBIT), ValueError, "observer: frame 'inertial'"),
        (lambda p: jp.plot.globe(p, frame="orbital", observer="me"), TypeError, "observer must be an orbit"),
        (lambda p: jp.plot.attitude(p), ValueError, "attitude: needs observer"),
        (lambda p: jp.plot.ground_track(p), ValueError, "ground_track: needs observer"),
        (
            lambda p: jp.plot.ground_track(replace(p, scenario=replace(p.scenario, epoch=None)), ORBIT),
            ValueError,
            "has no epoch",
        ),
        (lambda p: jp.plot.attitude(replace(p, trajectory=None), ORBIT), ValueError, "has no trajectory"),
    ],
)
def test_what_is_missing_is_named(plan, draw, kind, words):
    with pytest.raises(kind, match=words.replace("(", r"\(")):
        draw(plan)


def test_a_plan_has_these_figures_where_its_orbit_is_known(plan):
    wanted = {"orbital_sphere", "attitude", "ground_track"}
    assert not wanted & {name for name, _ in jp.plot.figures(plan)}
    assert wanted <= {name for name, _ in jp.plot.figures(plan, observer=ORBIT)}
    without = replace(plan, scenario=replace(plan.scenario, epoch=None))
    assert not wanted & {name for name, _ in jp.plot.figures(without, observer=ORBIT)}
