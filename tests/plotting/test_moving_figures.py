"""Figures and pages on plans in which something moves."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from builders import LOW_ORBIT
from drawn import assert_apart
from matplotlib.figure import Figure
from reference import sampled

import jaxplan as jp
from jaxplan.geometry.vectors import pointing, separation
from jaxplan.model.zones import KeepOut
from jaxplan.plotting import margin_panels, projections, style
from jaxplan.plotting.projections import FlatMap, TwoDiscs, circle
from jaxplan.plotting.sky import SPHERE_SIZE, TRACK, view_of
from jaxplan.plotting.zones import fresh_parts, name_zones, zone_tracks, zones_at


@pytest.fixture(scope="module")
def plan():
    return jp.plan(jp.load_scenario(LOW_ORBIT))


@pytest.fixture
def failed(plan):
    """A plan without a goal."""
    wide = tuple(replace(zone, half_angle=3.1) for zone in plan.scenario.keep_out)
    other = jp.plan(replace(plan.scenario, keep_out=wide), throw=False)
    assert other.goal is None
    return other


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_margins_over_time_are_to_zones_where_they_are_then(plan):
    motion = style.motion(plan)
    scenario = plan.scenario
    found = margin_panels.margins_over_time(scenario, motion)
    names = scenario.spacecraft.device_names
    for zone in (*scenario.keep_out, *scenario.keep_in):
        rows = {names[margin.device]: margin.values for margin in found if margin.zone == zone.name}
        assert set(rows) == set(zone.devices or names)
        for device, values in rows.items():
            alone = replace(zone, devices=(device,))
            expected = sampled(plan.trajectory, scenario.spacecraft, [alone], len(motion.times))[0]
            np.testing.assert_allclose(values, expected, atol=1e-9)
    jp.plot.margins(plan)


def test_the_map_has_moving_zones_at_first_and_at_last_with_the_way_between(plan):
    scenario = plan.scenario
    axes = jp.plot.sphere(plan)
    first = {zone.name: zone.axis_at() for zone in zones_at(scenario, 0.0)}
    ways = {zone.name: (zone, way) for zone, way in zone_tracks(plan)}
    assert set(ways) == {"earth", "link ahead"}
    lines = [line.get_xydata() for line in axes.lines]
    for name, (last, way) in ways.items():
        path = next(z for z in (*scenario.keep_out, *scenario.keep_in) if z.name == name).direction
        np.testing.assert_allclose(first[name], path.at(0.0))
        np.testing.assert_allclose(last.direction, path.at(80.0))
        np.testing.assert_allclose(way[[0, -1]], path.at(np.array([0.0, 80.0])))
        drawn = projections.cut(projections.unfold(way))
        assert any(line.shape == drawn.shape and np.array_equal(line, drawn) for line in lines)
    texts = [text.get_text() for text in axes.get_figure().findobj(plt.Text)]
    assert any("way of a zone's axis" in text for text in texts)


def test_no_name_of_a_zone_lies_on_the_way_of_its_axis(plan):
    axes = jp.plot.sphere(plan)
    axes.figure.draw_without_rendering()
    names = {text.get_text().split("\n")[0]: text.get_window_extent() for text in axes.texts}
    for zone, way in zone_tracks(plan):
        places = axes.transData.transform(projections.unfold(way))
        assert not any(names[zone.name].contains(*place) for place in places), zone.name


def test_a_fixed_scene_has_nothing_of_it():
    plan = jp.plan(jp.paper_case(4))
    assert zone_tracks(plan) == []
    axes = jp.plot.sphere(plan)
    texts = [text.get_text() for text in axes.get_figure().findobj(plt.Text)]
    assert not any("way of a zone" in text for text in texts)


@pytest.mark.parametrize("figure", ["sphere", "globe", "overview", "angles", "rates", "accelerations"])
def test_every_figure_draws_a_plan_in_which_something_moves(plan, figure):
    getattr(jp.plot, figure)(plan)


def test_a_failed_plan_is_drawn_with_its_targets_where_they_are_at_first(failed):
    assert not failed.ok
    jp.plot.globe(failed)
    axes = jp.plot.sphere(failed)
    if failed.goal is None:
        marks = np.array([line.get_xydata()[0] for line in axes.lines if line.get_marker() == "x"])
        first = np.stack([one.at(0.0) for one in failed.scenario.goal.directions])
        np.testing.assert_allclose(marks, projections.unfold(first), atol=1e-9)


def test_a_film_says_the_smallest_margin_to_zones_where_they_are(plan):
    film = jp.plot.animate(plan, frames=2)
    picture = film.picture
    zones = [*plan.scenario.keep_out, *plan.scenario.keep_in]
    least = sampled(plan.trajectory, plan.scenario.spacecraft, zones, style.INSTANTS).min(axis=0)
    for number in (0, 700):
        picture(number)
        assert f"smallest margin {np.rad2deg(least[number]):.2f} deg" in picture.clock.get_text()


def test_a_film_shows_zones_where_they_are(plan):
    film = jp.plot.animate(plan, frames=2)
    (axes,) = film.figure.axes
    view = view_of(plan, None)
    zones = [zone for zone in (*plan.scenario.keep_out, *plan.scenario.keep_in) if zone.moves]
    assert zones
    for number, time in ((0, 0.0), (style.INSTANTS - 1, 80.0)):
        film.picture(number)
        bold = [line.get_xydata() for line in axes.lines if line.get_linewidth() == 1.1]
        for zone in zones:
            edge, _ = view.parts(circle(zone.axis_at(time), zone.half_angle))[0]
            same = [line for line in bold if line.shape == edge.shape]
            assert sum(np.allclose(line, edge, atol=1e-9, equal_nan=True) for line in same) == 1
        assert [text.get_text() for text in axes.texts].count("earth") == 1


@pytest.mark.slow
def test_a_page_says_what_moves_from_where_to_where(plan, failed, tmp_path):
    jp.report_html(plan, tmp_path / "plan.html")
    page = (tmp_path / "plan.html").read_text()
    assert "Zones and targets that move, inertial" in page
    for words in (
        "zone earth",
        "zone link ahead",
        "the target of port",
        "Azimuth after 80.00 s",
        "keep-out, moving",
    ):
        assert words in page
    x, y, _ = plan.scenario.goal.directions[1].at(80.0)
    assert f"{np.rad2deg(np.arctan2(y, x)):.2f}".replace("-", "\N{MINUS SIGN}") in page
    jp.report_html(failed, tmp_path / "failed.html")
    assert "Zones and targets that move, inertial" in (tmp_path / "failed.html").read_text()
    still = replace(plan.scenario, goal=jp.paper_case(1).goal, keep_out=(), keep_in=())
    assert not any(isinstance(zone, KeepOut) for zone in still.keep_out)


def test_exports_take_a_plan_in_which_something_moves(plan, tmp_path):
    jp.export(plan, tmp_path / "slew.csv", format="csv")
    lines = (tmp_path / "slew.csv").read_text().splitlines()
    assert len(lines) > 800


@pytest.mark.parametrize("turns", [1, 3, 12])
def test_a_way_that_goes_round_again_and_again_is_drawn_once(turns):
    angle = np.linspace(0, 2 * np.pi * turns, 120 * turns + 1)
    drift = np.deg2rad(0.2) * angle / (2 * np.pi)  # a turn is beside the one before
    track = pointing(angle, drift)
    drawn = sum(float(np.sum(separation(part[:-1], part[1:]))) for part in fresh_parts(track))
    assert drawn == pytest.approx(2 * np.pi, rel=0.05)
    spiral = pointing(angle, np.deg2rad(6.0) * angle / (2 * np.pi))
    for whole in (spiral, track[:100], track[:1], np.repeat(track[:1], 5, axis=0)):
        (part,) = fresh_parts(whole)
        np.testing.assert_array_equal(part, whole)


@pytest.mark.parametrize("projection", [FlatMap(), TwoDiscs()])
def test_all_names_of_zones_say_what_they_bind_or_none_does(projection):
    names = ["imager", "tracker", "wing"]
    axis = np.array([0.6, 0.0, 0.8])

    def texts(*angles):
        zones = [
            jp.KeepOut(direction=axis, half_angle=np.deg2rad(angle), name=f"sun {name}", devices=(name,))
            for name, angle in zip(names, angles, strict=False)
        ]
        figure = Figure(figsize=SPHERE_SIZE)
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set(xlim=(-200, 200), ylim=(-100, 100))
        found = name_zones(axes, projection, zones, names)
        lines = axes.plot([0, 1], [0, 1], zorder=TRACK["zorder"])
        assert all(text.get_zorder() > lines[0].get_zorder() for text in found), "lines strike none out"
        assert_apart(figure, found, least=len(angles))
        return [text.get_text() for text in found]

    assert texts(40) == ["sun imager\nfor imager"]
    assert sorted(texts(10, 13, 16)) == sorted(f"sun {name}" for name in names)
