"""Figures: cones on the map, curves, limits, legends and where they are drawn; properties, not pixels."""

import inspect
from dataclasses import replace
from types import SimpleNamespace

import jax
import matplotlib as mpl
import numpy as np
import pytest
from builders import make_observer, make_plan, make_scenario, spacecraft_of
from drawn import assert_apart, filled
from matplotlib import pyplot
from matplotlib.figure import Figure
from oblique import oblique_craft
from PIL import Image
from reference import angle, assert_each, direction, unit
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model import constraints
from jaxplan.model import path as motions
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.scenario import Scenario
from jaxplan.model.status import Status
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.planner import Plan
from jaxplan.plotting import draw_png, margin_panels, projections, sky, style, tracks, zones
from jaxplan.plotting.limit_lines import both_sides, limit_lines
from jaxplan.plotting.projections import FlatMap
from jaxplan.trajectory.zone_margins import ZoneMargins

OVER_TIME = (jp.plot.angles, jp.plot.rates, jp.plot.accelerations, jp.plot.margins, jp.plot.overview)


def _direction(points: np.ndarray) -> np.ndarray:
    return direction(*np.deg2rad(points).T)


def _cones() -> list[tuple[np.ndarray, float]]:
    """Random cones, and all that is awkward: on poles and edges, touching poles, half spheres, huge ones."""
    rng = np.random.default_rng(0)
    axes = [unit(axis) for axis in rng.standard_normal((12, 3))]
    special = [(0, 90), (0, -90), (180, 0), (-180, 20), (179.9, -10), (90, 0), (-90, 0), (0, 0), (35, 60)]
    axes += list(_direction(np.array(special, dtype=float)))
    half_angles = np.deg2rad([0.5, 12, 30, 60, 89.9, 90, 100, 150, 179])
    cones = [(axis, half_angle) for axis in axes for half_angle in half_angles]
    touching = [(_direction(np.array([[170.0, 90.0 - h]]))[0], np.deg2rad(h)) for h in (10, 40, 90, 130)]
    nearly = [(axis, half_angle + gap) for axis, half_angle in touching for gap in (-1e-9, 1e-9, 1e-5)]
    return cones + touching + nearly


def _steps(line: np.ndarray) -> np.ndarray:
    """Pairs of successive points of a line with gaps, (2, k, 2)."""
    pairs = np.stack([line[:-1], line[1:]])
    return pairs[:, ~np.isnan(pairs).any(axis=(0, 2))]


# The map


def _outline(axis: np.ndarray, half_angle: float) -> np.ndarray:
    ((line, opacity),) = FlatMap().parts(projections.circle(axis, half_angle))
    assert opacity == 1
    return line


def test_outline_lies_on_the_cone_and_on_the_map() -> None:
    for axis, half_angle in _cones():
        line = _outline(axis, half_angle)
        points = line[~np.isnan(line[:, 0])]
        assert_each(np.abs(points), "<=", [180, 90])
        # where the map's edge cuts it, the chord on the map leaves the cone by less than is seen
        cut, pole = np.abs(points[:, 0]) > 180 - 1e-9, np.abs(points[:, 1]) == 90
        depth = angle(_direction(points), axis) - half_angle
        np.testing.assert_allclose(depth[~cut & ~pole], 0, atol=1e-9)
        np.testing.assert_allclose(depth[cut & ~pole], 0, atol=1e-4)
        np.testing.assert_allclose(depth[pole], 0, atol=np.deg2rad(1.0))


def test_outline_goes_all_the_way_round_without_a_streak() -> None:
    for axis, half_angle in _cones():
        first, second = _steps(_outline(axis, half_angle))
        assert_each(np.abs(second - first)[:, 0], "<=", 180)
        lengths = angle(_direction(first), _direction(second))
        over_pole = np.any(np.abs(first[:, 1]) == 90)  # whose surroundings are left out
        assert lengths.max() < np.deg2rad(1.6 if over_pole else 0.6)
        left_out = np.deg2rad(2.5) if over_pole else 0.0
        np.testing.assert_allclose(lengths.sum(), 2 * np.pi * np.sin(half_angle), rtol=1e-4, atol=left_out)


def test_a_zone_is_filled_on_the_map_where_the_cone_is_and_nowhere_else() -> None:
    rng = np.random.default_rng(1)
    probes = rng.standard_normal((60, 3))
    probes /= np.linalg.norm(probes, axis=1, keepdims=True)
    near_poles = _direction(np.array([[a, s * 89.7] for a in (-170.0, -60.0, 10.0, 120.0) for s in (-1, 1)]))
    points = projections.unfold(np.concatenate([probes, near_poles]))
    axes = Figure().subplots()
    for axis, half_angle in _cones()[::3]:
        zone = KeepOut(name="zone", direction=axis, half_angle=half_angle)
        areas = [area for area in zones.draw_zone(axes, FlatMap(), zone) if hasattr(area, "get_paths")]
        depth = half_angle - angle(_direction(points), axis)
        clear = np.abs(depth) > np.deg2rad(0.3)
        inside = np.any([filled(area, points) for area in areas] or [np.zeros(len(points))], axis=0)
        np.testing.assert_array_equal(inside[clear], depth[clear] > 0)
        for area in areas:
            area.remove()


def test_ticks_of_margins_do_not_run_together() -> None:
    for lowest in (0.3, 40.0):
        axes = Figure(figsize=(6, 3)).subplots()
        axes.set_ylim(-1.0, 150.0)
        margin_panels.open_near_zero(axes, "y", lowest)
        axes.figure.canvas.draw()
        ticks = np.array([*axes.yaxis.get_minorticklocs(), 0.0])
        assert len(ticks) > 5
        heights = np.sort(axes.transData.transform(np.stack([np.zeros_like(ticks), ticks], axis=1))[:, 1])
        assert np.diff(heights).min() > 2.0
        assert all(label.get_text() == "" for label in axes.yaxis.get_minorticklabels())


def test_a_line_is_cut_where_it_leaves_the_map() -> None:
    line = projections.cut(
        np.array([[170.0, 0.0], [-170.0, 10.0], [-175.0, 12.0], [175.0, 14.0], [180.0, 15.0]])
    )
    expected = [
        [170, 0], [180, 5], [np.nan, np.nan], [-180, 5], [-170, 10],
        [-175, 12], [-180, 13], [np.nan, np.nan], [180, 13], [175, 14], [180, 15],
    ]  # fmt: skip
    np.testing.assert_allclose(line, expected)


def test_no_line_across_the_map_has_a_streak() -> None:
    rng = np.random.default_rng(3)
    for normal in [*rng.standard_normal((30, 3)), [0, 0, 1], [1, 0, 0], [0, 1e-9, 1]]:
        turned = Rotation.from_rotvec(np.outer(np.linspace(0, 2 * np.pi, 400), unit(normal)))
        way = turned.apply(unit(np.cross(normal, [0.3, 0.5, 0.7])))
        first, second = _steps(projections.cut(projections.unfold(way)))
        assert_each(np.abs(second - first)[:, 0], "<=", 180)
        # where it is cut, the chord on the map leaves the great circle by far less than a step
        assert angle(_direction(first), _direction(second)).max() < 3 * 2 * np.pi / 400


def test_a_line_over_a_pole_goes_up_to_it_and_down_again_without_a_stroke() -> None:
    rng = np.random.default_rng(7)
    for tilt, count in [
        (0.0, 400),
        (0.0, 33),
        (1e-3, 400),
        (1e-3, 12),
        (0.3, 20),
        (-1e-4, 1000),
        (0.012, 64),
    ]:
        turn = Rotation.from_euler("z", rng.uniform(0, 6)) * Rotation.from_euler("x", np.pi / 2 - tilt)
        angles = np.linspace(0.1, 2 * np.pi + 0.1, count)
        way = turn.apply(np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)]))
        ((line, _),) = FlatMap().parts(way)
        first, second = _steps(line)
        middles = (first + second) / 2
        on_a_pole = (np.abs(first[:, 1]) == 90) & (np.abs(second[:, 1]) == 90)
        assert not np.any(on_a_pole & (np.abs(first - second)[:, 0] > 1))
        # between its points, too, the line on the map is where the way is, up to the width of the line
        across = np.abs(np.arcsin(np.clip(_direction(middles) @ turn.apply([0, 0, 1]), -1, 1)))
        assert_each(np.rad2deg(across), "<", 1.5)
        assert np.sum(angle(_direction(first), _direction(second))) > 2 * np.pi - 0.2


def test_nothing_is_marked_at_azimuth_zero_of_a_pole_where_a_path_begins() -> None:
    plan = make_plan(craft=spacecraft_of([0.0], {"eye": np.array([0.0, 0.0, -1.0])}))
    attitudes = plan.path.attitudes[0].T @ plan.path.attitudes
    attitudes[0] = np.eye(3)
    axes = jp.plot.sphere(replace(plan, path=replace(plan.path, attitudes=attitudes)))
    marked = np.concatenate(
        [np.column_stack(line.get_data()) for line in axes.lines if len(line.get_xdata())]
    )
    assert len(marked) > 10
    assert not np.any((np.abs(marked[:, 0]) < 1e-6) & (np.abs(marked[:, 1]) > 89.99))


def test_what_rests_at_a_pole_is_drawn_as_it_is() -> None:
    small = projections.circle(_direction(np.array([[30.0, 89.9]]))[0], np.deg2rad(0.3))
    ((line, _),) = FlatMap().parts(small)
    np.testing.assert_allclose(
        angle(_direction(line[np.isfinite(line[:, 0])]), _direction(np.array([[30.0, 89.9]]))[0]),
        np.deg2rad(0.3),
        atol=1e-6,
    )


def test_the_discs_have_true_angles_and_are_cut_where_a_line_leaves_them() -> None:
    discs, rng = projections.TwoDiscs(), np.random.default_rng(4)
    directions = rng.standard_normal((500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    places = discs.project(directions)
    from_middle = places - np.where(directions[:, 2:] > 0, [-104.0, 0.0], [104.0, 0.0])
    np.testing.assert_allclose(
        np.hypot(*from_middle.T), np.rad2deg(angle(np.abs(directions) * [0, 0, 1], np.abs(directions)))
    )
    np.testing.assert_allclose(
        np.arctan2(*from_middle.T), np.arctan2(directions[:, 1], directions[:, 0]), atol=1e-12
    )
    np.testing.assert_allclose(discs.directions(places, directions[0]), directions, atol=1e-12)
    assert np.all(np.isnan(discs.directions(np.array([[0.0, 0.0], [-104.0, 91.0]]), directions[0])))
    for axis, half_angle in _cones():
        ((line, _),) = discs.parts(projections.circle(axis, half_angle))
        first, second = _steps(line)
        assert_each(
            np.linalg.norm(second - first, axis=1), "<", 2
        )  # half a turn of azimuth is 1.6 of an angle
        np.testing.assert_allclose(
            angle(discs.directions((first + second) / 2 * [1, 1], axis), axis), half_angle, atol=1e-3
        )


# The numbers


def _mixed_scenario() -> Scenario:
    """Four terminals, an instrument, every kind of zone; the groups change hands along `_mixed_moves`."""
    keep_out = (
        KeepOut(name="sun", direction=unit([1, 2, 3]), half_angle=0.3),
        KeepOut(name="moon", direction=unit([-1, 2, -1]), half_angle=2.0, devices=("terminal-2", "camera-1")),
    )
    both = ("terminal-1", "terminal-3")
    keep_in = (
        KeepIn(name="earth", direction=unit([1, 0, 1]), half_angle=1.2, devices=("terminal-4",)),
        KeepIn(name="east", direction=unit([1, 0.2, 0]), half_angle=1.0, devices=both, any_of="link"),
        KeepIn(name="west", direction=unit([-1, 0, 0.2]), half_angle=0.7, devices=both[1:], any_of="link"),
        KeepIn(
            name="north", direction=unit([0, 1, 0]), half_angle=1.0, devices=("camera-1",), any_of="other"
        ),
        KeepIn(
            name="south", direction=unit([0, -1, 0]), half_angle=1.0, devices=("camera-1",), any_of="other"
        ),
    )
    return make_scenario(4, 1, keep_out=keep_out, keep_in=keep_in)


def _mixed_moves(scenario: Scenario) -> style.Motion:
    """Random states, one an instant."""
    rng, craft = np.random.default_rng(6), scenario.spacecraft
    times = np.arange(200.0)
    values = SimpleNamespace(
        attitude=Rotation.random(200, rng=rng).as_matrix(),
        joints=rng.uniform(-1.5, 1.5, (200, len(craft.joint_names))),
    )
    ways = craft.boresights(values.attitude, values.joints)
    return style.Motion(times=times, values=values, boresights=ways, node_times=times[[0, -1]])


def test_margins_are_those_of_every_zone_and_device_it_binds() -> None:
    scenario = _mixed_scenario()
    moves = _mixed_moves(scenario)
    ways = moves.boresights
    names = scenario.spacecraft.device_names
    found = {
        (names[margin.device], margin.zone): margin.values
        for margin in margin_panels.margins_over_time(scenario, moves)
    }
    expected = {}
    for zone in (*scenario.keep_out, scenario.keep_in[0]):
        for device in zone.devices or names:
            angle = np.arccos(ways[:, names.index(device)] @ zone.direction)
            inward = isinstance(zone, KeepIn)
            expected[device, zone.name] = zone.half_angle - angle if inward else angle - zone.half_angle
    assert {pair for pair in found if pair[1] not in ("link", "other")} == set(expected)
    for pair, values in expected.items():
        np.testing.assert_allclose(found[pair], values, atol=1e-9)


def test_a_group_counts_as_its_best_zone() -> None:
    scenario = _mixed_scenario()
    moves = _mixed_moves(scenario)
    ways = moves.boresights
    names = scenario.spacecraft.device_names
    found = {
        names[margin.device]: margin.values
        for margin in margin_panels.margins_over_time(scenario, moves)
        if margin.zone == "link"
    }
    east, west = scenario.keep_in[1:3]
    for instant, directions in enumerate(ways):
        inside = {
            (zone.name, device): zone.half_angle - np.arccos(directions[names.index(device)] @ zone.direction)
            for zone in (east, west)
            for device in zone.devices
        }
        in_east = min(inside["east", "terminal-1"], inside["east", "terminal-3"])
        if in_east >= inside["west", "terminal-3"]:
            expected = [inside["east", "terminal-1"], inside["east", "terminal-3"]]
        else:
            expected = [np.nan, inside["west", "terminal-3"]]
        values = [found["terminal-1"][instant], found["terminal-3"][instant]]
        np.testing.assert_allclose(values, expected, atol=1e-9)


def test_a_mask_that_repeats_every_turn_counts_once_where_it_is_nearest() -> None:
    scenario = _mixed_scenario()
    craft = scenario.spacecraft
    corners = np.deg2rad([[150.0, -10.0], [170.0, -10.0], [170.0, 5.0]])
    wide = replace(craft.terminals[0], yaw_limit=None, yaw_range=np.deg2rad([-270.0, 270.0]), mask=(corners,))
    scenario = replace(scenario, spacecraft=replace(craft, terminals=(wide, *craft.terminals[1:])))
    moves = _mixed_moves(scenario)
    found = margin_panels.margins_over_time(scenario, moves)
    pairs = [(margin.device, margin.zone) for margin in found]
    assert len(set(pairs)) == len(pairs)
    (mask,) = [margin.values for margin in found if margin.zone.startswith("mask")]
    margins = ZoneMargins(scenario)
    table = margins.at(moves.times, moves.values.attitude, moves.values.joints)
    copies = [column for pair, column in zip(margins.pairs, table.T, strict=True) if "mask" in pair.zone]
    assert len(copies) > 1
    np.testing.assert_array_equal(mask, np.min(copies, axis=0))


def test_the_smallest_margin_is_that_of_the_scene() -> None:
    scenario = _mixed_scenario()
    moves = _mixed_moves(scenario)
    ways = moves.boresights
    cones = scenario.constraints
    expected = constraints.constraint_margins(cones, constraints.pair_margins(cones, ways, cones.axis)).min(
        axis=-1
    )
    values = np.nanmin([margin.values for margin in margin_panels.margins_over_time(scenario, moves)], axis=0)
    np.testing.assert_allclose(values, expected, atol=1e-9)


def test_the_path_is_drawn_along_geodesics_and_lines() -> None:
    plan = make_plan(3, 1)
    craft, path = plan.scenario.spacecraft, plan.path
    ways = tracks.path_boresights(plan.path, plan.scenario.spacecraft, points_an_edge=4)
    turns = Rotation.from_matrix(np.swapaxes(path.attitudes[:-1], 1, 2) @ path.attitudes[1:]).as_rotvec()
    along = jax.vmap(lambda *edge: motions.motion(*edge, np.arange(5) / 4))
    attitudes, joints = along(path.attitudes[:-1], path.joints[:-1], turns, np.diff(path.joints, axis=0))
    expected = np.asarray(craft.boresights(attitudes, joints))
    for edge, boresights in enumerate(expected):
        np.testing.assert_allclose(ways[4 * edge : 4 * edge + 5], boresights, atol=1e-9)


# The figures


def _curves(axes: mpl.axes.Axes) -> list[mpl.lines.Line2D]:
    """The lines that are drawn over the grid of times."""
    return [line for line in axes.lines if len(line.get_xdata()) == style.INSTANTS]


def _limits(axes: mpl.axes.Axes) -> list[float]:
    """Heights of the limits across the panel."""
    return sorted({round(float(line.get_ydata()[0]), 9) for line in _barriers(axes)})


def _barriers(axes: mpl.axes.Axes) -> list[mpl.lines.Line2D]:
    """The lines across the panel."""
    return [line for line in axes.lines if list(line.get_xdata()) == [0, 1]]


def _plus_minus(*values: float) -> list[float]:
    return sorted({sign * value for value in values for sign in (-1, 1)})


def test_curves_are_the_trajectory_in_degrees_and_seconds() -> None:
    plan = make_plan(4, 1)
    times = np.linspace(0, plan.trajectory.duration, style.INSTANTS)
    values = plan.trajectory.sample(times)
    yaw, pitch = slice(0, 4), slice(4, 8)
    shown = [
        (jp.plot.angles, [values.joints[:, yaw], values.joints[:, pitch]]),
        (jp.plot.rates, [values.joint_rates[:, yaw], values.joint_rates[:, pitch], values.angular_velocity]),
        (
            jp.plot.accelerations,
            [
                values.joint_accelerations[:, yaw],
                values.joint_accelerations[:, pitch],
                values.angular_acceleration,
            ],
        ),
    ]
    for figure, panels in shown:
        for axes, columns in zip(figure(plan), panels, strict=True):
            curves = _curves(axes)
            assert len(curves) == columns.shape[1]
            for curve, column in zip(curves, columns.T, strict=True):
                np.testing.assert_allclose(curve.get_xdata(), times)
                np.testing.assert_allclose(np.deg2rad(curve.get_ydata()), column, atol=1e-12)


def test_limits_stand_at_their_values() -> None:
    plan = make_plan(3, 0)
    yaw, pitch = jp.plot.angles(plan)
    assert (_limits(yaw), _limits(pitch)) == (_plus_minus(90), _plus_minus(15))


def test_limits_far_from_the_curves_are_told_so_that_curves_can_be_read() -> None:
    plan = make_plan(3, 0)
    panels = [*jp.plot.rates(plan), *jp.plot.accelerations(plan)]
    for axes, limit in zip(panels, (4, 4, 3, 3, 3, 2), strict=True):
        highest = max(np.abs(curve.get_ydata()).max() for curve in _curves(axes))
        near = limit <= 4 * highest
        assert _limits(axes) == (_plus_minus(limit) if near else [])
        assert [text.get_text() for text in axes.texts] == ([] if near else [f"limit ±{limit}"])
        assert max(axes.get_ylim()) <= 1.2 * (limit if near else highest)
    assert {bool(axes.texts) for axes in panels} == {True, False}
    still = jp.plot.accelerations(make_plan(3, 0, duration=0.0, edges=0))
    assert [_limits(axes) for axes in still] == [_plus_minus(v) for v in (3, 3, 2)]


def test_no_curve_looks_like_a_limit() -> None:
    plan = make_plan(7, 1)
    craft = replace(plan.scenario.spacecraft, inertia=np.eye(3), torque_limit=np.array([0.001, 0.002, 0.003]))
    plan = replace(plan, scenario=replace(plan.scenario, spacecraft=craft))
    for figure in (jp.plot.angles, jp.plot.rates, jp.plot.torque, jp.plot.margins):
        for axes in np.ravel(figure(plan)):
            barriers = _barriers(axes)
            assert barriers
            for line in barriers:
                (ticks,) = line.get_path_effects()
                above = line.get_ydata()[0] > 0
                assert (ticks._angle > 0) == above, "ticks stand where it is forbidden"
            assert not any(curve.get_path_effects() for curve in _curves(axes))


# Machado, Oliveira and Fernandes 2009: what the three kinds of colour blindness make of linear RGB.
_BLIND = {
    "none": np.eye(3),
    "protan": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deutan": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritan": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}


def _lab(colour: str, blindness: str) -> np.ndarray:
    """CIELAB of a colour as it is seen."""
    rgb = np.array(mpl.colors.to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.asarray(_BLIND[blindness]) @ linear, 0, 1)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    xyz = np.asarray(to_xyz) @ seen / [0.9505, 1.0, 1.089]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("blindness", _BLIND)
def test_body_axes_and_devices_are_told_apart_by_the_colour_blind(blindness: str) -> None:
    def apart(one: str, other: str) -> float:
        return float(np.linalg.norm(_lab(one, blindness) - _lab(other, blindness)))

    axes = [look["color"] for look in style.AXIS_STYLES]
    assert min(apart(one, other) for i, one in enumerate(axes) for other in axes[:i]) > 30
    assert len({str(look["linestyle"]) for look in style.AXIS_STYLES}) == 3
    assert len({str(style.device_style(number)) for number in range(44)}) == 44
    for first in range(16):
        for second in range(first):
            one, other = style.device_style(first), style.device_style(second)
            lines_differ = str(one["linestyle"]) != str(other["linestyle"])
            assert lines_differ or apart(one["color"], other["color"]) > 20
            if first < 11:  # dots and areas have no line style
                assert apart(one["color"], other["color"]) > (25 if blindness == "none" else 13)


def test_different_limits_have_their_terminals_colours() -> None:
    plan = make_plan(3, 0)
    craft = plan.scenario.spacecraft
    tight = replace(craft.terminals[1], yaw_limit=np.deg2rad(70))
    other = replace(craft, terminals=(craft.terminals[0], tight, craft.terminals[2]))
    yaw, pitch = jp.plot.angles(replace(plan, scenario=replace(plan.scenario, spacecraft=other)))
    assert _limits(yaw) == _plus_minus(70, 90)
    assert _limits(pitch) == _plus_minus(15)
    colours = {abs(round(line.get_ydata()[0])): line.get_color() for line in _barriers(yaw)}
    assert colours[70] == style.device_style(1)["color"]
    assert colours[90] == style.GREY
    assert {text.get_text() for text in yaw.texts} == {"limit of terminal-1 and terminal-3"}
    assert not pitch.texts, "what is the limit of all needs no names"


@pytest.mark.parametrize("highest", [0.05, 2.0])
def test_limits_say_whose_they_are_unless_all_have_one(highest: float) -> None:
    names = [f"wheel {number}" for number in range(6)]
    looks = [style.device_style(number) for number in range(6)]

    def told(limits: list[float]) -> list[str]:
        axes = Figure().subplots()
        axes.set_ylim(-4, 4)
        limit_lines(axes, both_sides(np.array(limits)), looks, highest, far=4.0, owners=names)
        return [text.get_text() for text in axes.texts]

    far = highest < 1
    assert told([2.0] * 6) == (["limit ±2"] if far else [])
    two = told([1.0, 1.0, 2.0, 2.0, 2.0, 2.0])
    if far:
        assert two == ["limits ±1 wheel 0 and wheel 1, ±2 wheel 2, wheel 3 and 2 more"]
    else:
        assert set(two) == {"limit of wheel 0 and wheel 1", "limit of wheel 2, wheel 3 and 2 more"}
    assert len(two) == (1 if far else 2), "each once, not at both ends"
    assert ("wheel 3" in " ".join(told([1.0, 1.0, 1.0, 3.0, 1.0, 1.0]))) == far, (
        "a line of its own colour says it"
    )


def test_path_nodes_are_marked_on_the_angles() -> None:
    plan = make_plan(2, 0)
    nodes = [line for axes in jp.plot.angles(plan) for line in axes.lines if line.get_marker() == "."]
    for line, column in zip(nodes, plan.path.joints.T, strict=True):
        np.testing.assert_allclose(line.get_xdata(), plan.trajectory.node_times)
        np.testing.assert_allclose(np.deg2rad(line.get_ydata()), column)


def test_margin_curves_and_the_proved_bound_stand_at_their_values() -> None:
    plan = make_plan(3, 1, zones=3)
    axes = jp.plot.margins(plan)
    thin = [line for line in _curves(axes) if line.get_linewidth() < 1]
    bold = [line for line in _curves(axes) if line.get_linewidth() > 1]
    assert (len(thin), len(bold)) == (12, 4)
    times = np.linspace(0, plan.trajectory.duration, style.INSTANTS)
    values = plan.trajectory.sample(times)
    boresights = np.asarray(plan.scenario.spacecraft.boresights(values.attitude, values.joints))
    table = np.stack(
        [np.arccos(boresights @ zone.direction) - zone.half_angle for zone in plan.scenario.keep_out]
    )
    drawn = np.reshape([line.get_ydata() for line in thin], (3, 4, -1))
    np.testing.assert_allclose(np.deg2rad(drawn), np.moveaxis(table, 2, 1), atol=1e-9)
    for device, line in enumerate(bold):
        np.testing.assert_allclose(np.deg2rad(line.get_ydata()), table[:, :, device].min(axis=0), atol=1e-9)
    (mark,) = [line for line in axes.lines if line.get_marker() == "^"]
    assert (mark.get_xdata()[0], mark.get_ydata()[0]) == (plan.certificate.worst_time, np.rad2deg(0.02))
    assert any("1.146 deg" in text.get_text() for text in axes.get_legend().get_texts())
    low, high = axes.get_ylim()
    assert low < 0 < np.rad2deg(table.max()) < high, "no line leaves the panel"


def _margins_of(*lines: np.ndarray, ax: mpl.axes.Axes | None = None) -> mpl.axes.Axes:
    """The panel of given margins, deg, over the motion of a plan whose proved bound is not drawn."""
    plan = make_plan(len(lines), 0)
    made = [
        margin_panels.Margin(device=i, zone=f"CZ{i}", values=np.deg2rad(line)) for i, line in enumerate(lines)
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(margin_panels, "margins_over_time", lambda *_: made)
        axes = jp.plot.margins(replace(plan, certificate=None), ax=ax)
    axes.figure.draw_without_rendering()
    return axes


def _height(axes: mpl.axes.Axes, value: float) -> float:
    """Where a margin is drawn, as a share of the panel's height."""
    return float(axes.transAxes.inverted().transform(axes.transData.transform((0, value)))[1])


def test_half_a_degree_of_margin_is_seen_beside_a_hundred_and_thirty() -> None:
    share = np.linspace(0, 1, style.INSTANTS)
    axes = _margins_of(0.5 + 3 * share, 130 - 20 * share)
    assert _height(axes, 0.5) - _height(axes, 0.0) > 0.06
    assert _height(axes, 1.0) - _height(axes, 0.0) == pytest.approx(
        2 * (_height(axes, 0.5) - _height(axes, 0.0)), rel=0.15
    ), "linear near the limit"
    assert _height(axes, 130.0) < 1
    labels = {label.get_text(): y for y, label in zip(axes.get_yticks(), axes.get_yticklabels(), strict=True)}
    assert {"0", "1", "10", "100"} <= set(labels)
    assert all(float(text) == value for text, value in labels.items() if value >= 0)
    boxes = [label.get_window_extent() for label in axes.get_yticklabels()]
    assert not any(one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i])


def test_panels_that_share_an_axis_hide_none_of_their_margins() -> None:
    share = np.linspace(0, 1, style.INSTANTS)
    lines = 8 - 20 * share, 30 + 100 * share
    for order in (lines, lines[::-1]):
        panels = Figure().subplots(1, 2, sharey=True)
        for axes, line in zip(panels, order, strict=True):
            _margins_of(line, ax=axes)
        low, high = panels[0].get_ylim()
        assert low < -12 < 130 < high


def test_margins_below_the_limit_are_drawn_on_red() -> None:
    share = np.linspace(0, 1, style.INSTANTS)
    axes = _margins_of(40 * share - 10, 50 + share)
    (red,) = [patch for patch in axes.patches if isinstance(patch, mpl.patches.Rectangle)]
    assert red.get_y() + red.get_height() == 0
    assert red.get_y() < axes.get_ylim()[0] < -10
    assert [line.get_color() for line in _barriers(axes)] == [style.KEEP_OUT]
    assert "limit: below it\na zone is broken" in _legend(axes)
    assert "\N{MINUS SIGN}10" in {label.get_text() for label in axes.get_yticklabels()}


def test_every_boresight_starts_at_a_star_and_ends_at_a_square() -> None:
    plan = make_plan(3, 1)
    axes = jp.plot.sphere(plan)
    for marker, node in (("*", 0), ("s", -1)):
        marks = [line.get_xydata()[0] for line in axes.lines if line.get_marker() == marker]
        boresights = plan.scenario.spacecraft.boresights(plan.path.attitudes[node], plan.path.joints[node])
        np.testing.assert_allclose(angle(_direction(np.array(marks)), np.asarray(boresights)), 0, atol=1e-9)
    names = {text.get_text() for text in axes.texts}
    assert names == {"zone-0", "zone-1", "zone-2", "zone-3"}
    assert len(axes.collections) == 4, "a filled area for each zone"


def test_a_device_has_one_look_in_all_figures() -> None:
    plan = make_plan(12, 3)
    looks: dict[str, set[object]] = {}
    for figure in (jp.plot.sphere, jp.plot.angles, jp.plot.rates, jp.plot.accelerations, jp.plot.margins):
        for axes in np.ravel(figure(plan)):
            legend = axes.get_legend()
            if legend is not None:
                for handle, text in zip(legend.get_lines(), legend.get_texts(), strict=False):
                    looks.setdefault(text.get_text(), set()).add(
                        (handle.get_color(), str(handle._dash_pattern))
                    )
    devices = [looks[name] for name in plan.scenario.spacecraft.device_names]
    assert all(len(look) == 1 for look in devices)
    assert len({look.pop() for look in devices}) == 15


def test_axes_say_their_units() -> None:
    plan = make_plan()
    axes = jp.plot.sphere(plan)
    assert axes.get_xlabel().endswith("(deg)")
    assert axes.get_ylabel().endswith("(deg)")
    for figure in OVER_TIME[:-1]:
        panels = list(np.ravel(figure(plan)))
        assert all("(deg" in panel.get_ylabel() for panel in panels)
        assert [panel.get_xlabel() for panel in panels] == ["", "", "", "time (s)"][-len(panels) :]
    alone = Figure().subplots(2)
    jp.plot.angles(plan, ax=alone)
    assert [panel.get_xlabel() for panel in alone] == ["time (s)", "time (s)"]


@pytest.mark.slow
@pytest.mark.parametrize(("terminals", "instruments", "zones"), [(3, 1, 4), (12, 3, 64)])
def test_legends_cover_no_panel_and_stay_on_the_page(terminals: int, instruments: int, zones: int) -> None:
    plan = make_plan(terminals, instruments, zones=zones)
    for name, figure in jp.plot.figures(plan):
        figure.draw_without_rendering()
        panels = [axes for part in [figure, *figure.subfigs] for axes in part.axes]
        legends = [axes.get_legend() for axes in panels if axes.get_legend() is not None]
        assert legends, name
        for legend in legends:
            box = legend.get_window_extent()
            assert not any(box.overlaps(axes.get_window_extent()) for axes in panels), name
            assert box.x1 <= figure.bbox.x1 + 1, name
            assert box.y0 >= figure.bbox.y0 - 1, name
        for axes in panels:
            assert axes.get_tightbbox().x0 >= -1, name


def _legend(axes: mpl.axes.Axes) -> set[str]:
    return {text.get_text() for text in axes.get_legend().get_texts()}


def test_the_overview_is_saved_by_the_figure_of_any_of_its_axes(tmp_path) -> None:
    for axes in jp.plot.overview(make_plan()):
        axes.figure.savefig(tmp_path / "overview.svg")


def test_the_overview_says_what_thick_and_thin_margins_are() -> None:
    margin_axes = jp.plot.overview(make_plan())[3]
    assert {"smallest of a device", "to each zone"} <= _legend(margin_axes)


@pytest.mark.slow
@pytest.mark.parametrize("figure", [lambda plan: jp.plot.overview(plan)[3], jp.plot.margins])
@pytest.mark.parametrize("place", [0.0, 0.4, 1.0])
def test_names_of_margins_cover_neither_each_other_nor_the_mark(figure, place) -> None:
    plan = make_plan(3, 1)
    times = np.linspace(0, 1, style.INSTANTS)
    lines = {device: np.rad2deg(abs(times - place) + 0.005 * device + 0.02) for device in range(4)}
    moves = style.motion(plan)
    made = [
        margin_panels.Margin(device=i, zone=f"CZ{i}", values=np.deg2rad(line)) for i, line in lines.items()
    ]
    report = replace(plan.certificate, worst_time=place * 40.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(margin_panels, "margins_over_time", lambda *_: made)
        axes = figure(replace(plan, certificate=report))
    axes.figure.figure.draw_without_rendering()
    assert len(moves.times) == len(times)
    boxes = [mpl.text.Text.get_window_extent(text) for text in axes.texts]  # without leaders
    assert len(boxes) >= 2
    panel = axes.get_window_extent()
    assert all(panel.x0 - 1 <= box.x0 and box.x1 <= panel.x1 + 1 for box in boxes)
    (mark,) = [line for line in axes.lines if line.get_marker() == "^"]
    x, y = axes.transData.transform(mark.get_xydata()[0])
    radius = 0.4 * mark.get_markersize() * axes.figure.figure.dpi / 72
    boxes.append(mpl.transforms.Bbox.from_extents(x - radius, y - radius, x + radius, y + radius))
    pairs = [(one, other) for i, one in enumerate(boxes) for other in boxes[:i]]
    assert not any(one.overlaps(other) for one, other in pairs)


@pytest.mark.parametrize("figure", [lambda plan: jp.plot.overview(plan)[3], jp.plot.margins])
@pytest.mark.parametrize("spike", [0.02, 0.3, 0.62, 0.97])
def test_a_zone_is_named_where_it_binds(figure, spike: float) -> None:
    share = np.linspace(0, 1, style.INSTANTS)
    spike = share[np.argmin(abs(share - spike))]
    spiked = 0.2 + 4000 * abs(share - spike)  # the lowest of all, for so short that a name beside it misleads
    level = np.where(abs(share - 0.5) < 0.1, 0.5, 30.0) + 20 * (abs(share - spike) < 0.01)
    plan = make_plan(1, 0)
    lines = {"spiked": spiked, "level": level}
    made = [
        margin_panels.Margin(device=0, zone=name, values=np.deg2rad(line)) for name, line in lines.items()
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(margin_panels, "margins_over_time", lambda *_: made)
        axes = figure(replace(plan, certificate=None))
    axes.figure.figure.draw_without_rendering()
    binds = {"spiked": spiked < level, "level": level < spiked}
    times = share * plan.trajectory.duration
    for text in axes.texts:
        box = mpl.text.Text.get_window_extent(text)  # without its leader
        at = axes.transData.inverted().transform([(box.x0 + box.x1) / 2, box.y0])
        place = at[0] if text.arrow_patch is None else text.xy[0]
        assert binds[text.get_text()][np.argmin(abs(times - place))]
        assert at[1] >= 0, "nothing is written in the red while no zone is broken"
    assert {text.get_text() for text in axes.texts} == set(lines)


@pytest.mark.parametrize("margin", [20.0, -20.0])
def test_a_name_stands_in_the_red_only_where_its_zone_is_broken(margin: float) -> None:
    line = np.full(style.INSTANTS, margin)
    axes = _margins_of(line, line + 40)
    heights = {text.get_text(): text.get_window_extent().y0 for text in axes.texts}
    limit = axes.transData.transform((0, 0))[1]
    assert (heights["CZ0"] < limit) == (margin < 0)
    assert heights["CZ1"] >= limit


def test_the_duration_can_be_read_off_the_time_axis() -> None:
    for duration, text in ((49.72, "49.7"), (80.0, "80"), (5.678, "5.68"), (1234.4, "1234"), (0.02, "0.02")):
        axes = jp.plot.margins(make_plan(duration=duration))
        axes.figure.draw_without_rendering()
        labels = {label.get_position()[0]: label.get_text() for label in axes.get_xticklabels()}
        assert labels[duration] == text
        shown = sorted(time for time in labels if 0 <= time <= duration)
        assert np.diff(shown).min() > 0.07 * duration


def test_times_of_nodes_are_marked_below_every_panel() -> None:
    plan = make_plan()
    assert plan.trajectory is not None
    for axes in jp.plot.rates(plan):
        (marks,) = axes.collections
        offsets = np.asarray(marks.get_offsets())
        np.testing.assert_array_equal(offsets[:, 0], plan.trajectory.node_times)
        on_page = marks.get_offset_transform().transform(offsets)
        frame = axes.transAxes.transform([(0, 0), (1, 0)])
        np.testing.assert_allclose(on_page[[0, -1]], frame, rtol=0, atol=1e-9)  # pixels
        np.testing.assert_allclose(on_page[:, 1], frame[0, 1], rtol=0, atol=1e-9)


def test_a_picture_is_that_of_savefig(tmp_path) -> None:
    jp.plot.sphere(make_plan()).figure.savefig(tmp_path / "saved.png", dpi=150)
    draw_png(jp.plot.sphere(make_plan()).figure, "us")(tmp_path / "written.png")
    with Image.open(tmp_path / "saved.png") as saved, Image.open(tmp_path / "written.png") as written:
        assert (written.mode, written.text) == ("RGB", {"Software": "us"})
        np.testing.assert_allclose(written.info["dpi"], 150, rtol=1e-4)
        np.testing.assert_array_equal(written, saved.convert("RGB"))


def test_start_and_goal_both_show_where_a_device_does_not_move() -> None:
    axes = jp.plot.sphere(make_plan(2, 1, duration=0.0, edges=0))
    stars, squares = ([line for line in axes.lines if line.get_marker() == marker] for marker in "*s")
    for star, square in zip(stars, squares, strict=True):
        np.testing.assert_allclose(star.get_xydata(), square.get_xydata())
        assert square.get_fillstyle() == "none"
        assert square.get_markersize() >= star.get_markersize()
        assert star.get_zorder() > square.get_zorder()


def test_marks_at_the_edges_of_the_map_are_within_the_frame() -> None:
    plan = make_plan(0, 2, zones=0)
    start = replace(plan.scenario.start, rotation_vector=np.zeros(3))
    looks = [np.array([0.0, 0.0, 1.0]), np.array([-1.0, 0.0, 0.0])]
    instruments = tuple(
        replace(instrument, boresight=axis)
        for instrument, axis in zip(plan.scenario.spacecraft.instruments, looks, strict=True)
    )
    craft = replace(plan.scenario.spacecraft, instruments=instruments)
    axes = jp.plot.sphere(replace(plan, scenario=replace(plan.scenario, start=start, spacecraft=craft)))
    axes.figure.draw_without_rendering()
    frame = axes.get_window_extent()
    stars = [line for line in axes.lines if line.get_marker() == "*"]
    assert len(stars) == 2
    for star in stars:
        x, y = axes.transData.transform(star.get_xydata()[0])
        radius = star.get_markersize() / 2 * axes.figure.dpi / 72
        assert frame.x0 <= x - radius
        assert x + radius <= frame.x1
        assert y + radius <= frame.y1


def test_a_map_without_devices_says_so() -> None:
    axes = jp.plot.sphere(make_plan(0, 0, zones=0))
    assert [text.get_text() for text in axes.texts] == ["no devices"]
    assert axes.get_legend() is None


def test_the_name_of_a_keep_in_zone_of_more_than_half_the_sphere_stands_in_it() -> None:
    plan = make_plan(1, 0, zones=0)
    for azimuth, elevation in ((0, 60), (120, -80), (-170, 5), (40, 20)):
        for half_angle in (95, 120, 160):
            axis = _direction(np.array([[azimuth, elevation]], dtype=float))[0]
            zone = KeepIn(
                name="wide", direction=axis, half_angle=np.deg2rad(half_angle), devices=("terminal-1",)
            )
            axes = jp.plot.sphere(replace(plan, scenario=replace(plan.scenario, keep_in=(zone,))))
            (label,) = axes.texts
            spot = _direction(np.array([label.get_position()], dtype=float))[0]
            assert np.rad2deg(angle(spot, axis)) < half_angle


def test_zones_about_one_axis_are_all_named() -> None:
    plan = make_plan(0, 3, zones=0)
    names = plan.scenario.spacecraft.device_names
    for elevation, angles in ((-80, (40, 30, 25)), (3, (40, 30, 25)), (30, (45, 20, 10))):
        axis = _direction(np.array([[60, elevation]], dtype=float))[0]
        zones = tuple(
            KeepOut(name=f"zone {name}", direction=axis, half_angle=np.deg2rad(angle), devices=(name,))
            for name, angle in zip(names, angles, strict=True)
        )
        axes = jp.plot.sphere(replace(plan, scenario=replace(plan.scenario, keep_out=zones)))
        axes.figure.draw_without_rendering()
        boxes = [label.get_window_extent() for label in axes.texts]
        assert len(boxes) == 3
        assert not any(one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i])
        for label, zone in zip(axes.texts, reversed(zones), strict=True):  # the smallest comes first
            assert label.get_text().startswith(zone.name)
            spot = _direction(np.array([label.get_position()], dtype=float))[0]
            assert angle(spot, axis) < zone.half_angle


def test_zones_about_one_axis_that_have_no_room_inside_are_named_beside_them_and_not_over_each_other() -> (
    None
):
    plan = make_plan(0, 3, zones=0)
    axis = _direction(np.array([[60.0, 10.0]]))[0]
    zones = tuple(
        KeepOut(name=f"zone number {k}", direction=axis, half_angle=np.deg2rad(6 + k)) for k in range(5)
    )
    figure = Figure(figsize=sky.SPHERE_SIZE, layout="constrained")
    axes = jp.plot.sphere(replace(plan, scenario=replace(plan.scenario, keep_out=zones)), figure)
    assert_apart(figure, axes.texts, 5)


def test_zones_of_a_group_look_and_are_called_other_than_those_that_must_hold() -> None:
    plan = make_plan(4, 1, zones=0)
    axes = jp.plot.sphere(replace(plan, scenario=_mixed_scenario()))
    last = {text.get_text().splitlines()[0]: text.get_text().splitlines()[-1] for text in axes.texts}
    groups = {zone.name: zone.any_of for zone in _mixed_scenario().keep_in}
    assert len({group for group in groups.values() if group is not None}) == 2
    for name, group in groups.items():
        assert (last[name] == f"any of {group}") == (group is not None)
    assert {"keep-in zone", "keep-in zone,\nany of its group"} <= _legend(axes)


def test_completion_offers_what_draws_and_nothing_else() -> None:
    assert dir(jp.plot) == sorted(jp.plot.__all__)
    for name in dir(jp.plot):
        figure = getattr(jp.plot, name)
        assert inspect.isfunction(figure)
        assert "ax" in inspect.signature(figure).parameters or name == "figures"
    everything = {
        name: value for name, value in vars(jp.plot).items() if inspect.isfunction(value) and name[0] != "_"
    }
    drawing = {name for name, value in everything.items() if "ax" in inspect.signature(value).parameters}
    assert set(dir(jp.plot)) == drawing | {"figures"}


# Where they are drawn


def test_given_axes_are_drawn_on_and_returned() -> None:
    plan = make_plan()
    for figure, count in ((jp.plot.sphere, 1), (jp.plot.margins, 1), (jp.plot.angles, 2), (jp.plot.rates, 3)):
        given = list(np.ravel(Figure().subplots(count)))
        answer = list(np.ravel(figure(plan, ax=given)))
        assert all(one is other for one, other in zip(answer, given, strict=True))
        assert all(axes.has_data() for axes in answer)
    single = Figure().subplots()
    assert jp.plot.sphere(plan, ax=single) is single
    with pytest.raises(ValueError, match="3 panels, but 2 axes"):
        jp.plot.accelerations(plan, ax=Figure().subplots(2))


def test_a_figure_or_a_part_of_one_is_filled() -> None:
    plan = make_plan()
    left, right = Figure(layout="constrained").subfigures(1, 2)
    assert jp.plot.rates(plan, ax=left) == left.axes
    sphere, *panels = jp.plot.overview(plan, ax=right)
    assert len(panels) == 4
    assert all(axes.figure.figure is left.figure for axes in (sphere, *panels))


def test_nothing_global_changes_and_no_figure_stays_open() -> None:
    before = dict(mpl.rcParams)
    plan = make_plan()
    for figure in (jp.plot.sphere, *OVER_TIME):
        figure(plan)
    assert [type(figure) for _, figure in jp.plot.figures(plan)] == [Figure] * 7
    assert pyplot.get_fignums() == []
    assert dict(mpl.rcParams) == before


def test_a_notebook_shows_what_is_drawn() -> None:
    pytest.importorskip("matplotlib_inline")
    backend = mpl.get_backend()
    mpl.use("module://matplotlib_inline.backend_inline")
    try:
        axes = jp.plot.sphere(make_plan(1, 0, zones=1))
        assert [pyplot.figure(number) for number in pyplot.get_fignums()] == [axes.figure]
    finally:
        pyplot.close("all")
        mpl.use(backend)


# Edges


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plan", "expected"),
    [
        (make_plan(0, 2), "overview spacecraft sphere rates accelerations margins"),
        (make_plan(1, 0, zones=0), "overview spacecraft sphere angles rates accelerations"),
        (make_plan(0, 0), "overview sphere rates accelerations margins"),
        (
            make_plan(2, 1, duration=0.0, edges=0),
            "overview spacecraft sphere angles rates accelerations margins",
        ),
    ],
    ids=["no terminals", "no zones", "no devices", "no time"],
)
def test_figures_are_those_that_the_plan_has(plan: Plan, expected: str) -> None:
    drawn = []
    for name, figure in jp.plot.figures(plan):
        figure.draw_without_rendering()
        drawn.append(name)
    assert drawn == expected.split()
    for draw in (jp.plot.angles, jp.plot.margins):
        draw(plan)


def test_a_plan_without_a_trajectory_says_what_it_lacks() -> None:
    failed = replace(
        make_plan(),
        status=Status.NODE_LIMIT,
        message="Raise it.",
        trajectory=None,
        certificate=None,
        path=None,
    )
    for figure in OVER_TIME:
        with pytest.raises(ValueError, match=r"'test' has no trajectory .* NODE_LIMIT: Raise it\."):
            figure(failed)
    assert [name for name, _ in jp.plot.figures(failed)] == ["spacecraft", "sphere"]


def test_the_sphere_of_a_failed_plan_shows_what_there_is() -> None:
    plan = replace(make_plan(3, 1), status=Status.INFEASIBLE, trajectory=None, certificate=None)
    craft = plan.scenario.spacecraft

    def marks(plan: Plan) -> dict[str, int]:
        lines = jp.plot.sphere(plan).lines
        return {marker: sum(line.get_marker() == marker for line in lines) for marker in "*sx."}

    assert marks(plan) == {"*": 4, "s": 4, "x": 0, ".": 4}
    assert marks(replace(plan, path=None)) == {"*": 4, "s": 4, "x": 0, ".": 0}
    assert isinstance(plan.scenario.goal, GivenState)
    assert marks(replace(plan, path=None, goal=None)) == {"*": 4, "s": 4, "x": 0, ".": 0}
    targets = Targets(directions=np.eye(3), angular_velocity=np.zeros(3), joint_rates=np.zeros(6))
    lost = replace(plan, path=None, goal=None, scenario=replace(plan.scenario, goal=targets))
    assert marks(lost) == {"*": 4, "s": 0, "x": 3, ".": 0}
    assert len(craft.device_names) == 4
    assert jp.plot.sphere(lost).get_title(loc="left") == "test: INFEASIBLE"


def test_names_are_shown_letter_by_letter() -> None:
    plan = make_plan(1, 0, zones=0)
    craft = plan.scenario.spacecraft
    odd = replace(craft, terminals=(replace(craft.terminals[0], name="_$x^{"),))
    zone = KeepOut(name="$\\bad{$", direction=np.array([0.0, 0.0, 1.0]), half_angle=0.2)
    scenario = replace(plan.scenario, name="a $ b $", spacecraft=odd, keep_out=(zone,))
    odd_plan = replace(plan, scenario=scenario)
    for axes in (jp.plot.sphere(odd_plan), jp.plot.margins(odd_plan)):
        axes.figure.draw_without_rendering()
        assert "_$x^{" in axes.get_legend().texts[0].get_text()
        assert "$\\bad{$" in {text.get_text() for text in axes.texts}


# Drives, ranges and targets by name


def test_yaws_pitches_and_drives_have_panels_with_both_ends_of_their_ranges() -> None:
    craft = make_observer()
    plan = make_plan(craft=craft)
    panels = jp.plot.angles(plan)
    assert [_limits(axes) for axes in panels] == [[-150, 290], [-5, 85], [-120, 200]]
    assert [axes.get_ylabel() for axes in panels] == ["yaw (deg)", "pitch (deg)", "drive angle (deg)"]
    times = np.linspace(0, plan.trajectory.duration, style.INSTANTS)
    for number, axes in enumerate(panels):
        (own,) = _curves(axes)
        np.testing.assert_allclose(
            np.deg2rad(own.get_ydata()), plan.trajectory.sample(times).joints[:, number], atol=1e-12
        )
        assert own.get_color() == style.device_style(number // 2)["color"]
        low, high = sorted(_barriers(axes), key=lambda line: line.get_ydata()[0])
        assert [line.get_path_effects()[0]._angle > 0 for line in (low, high)] == [False, True]
    told = [text.get_text() for text in panels[0].get_legend().get_texts()]
    assert told == ["antenna", "array", "node of the path", "limit"]


def test_derivatives_of_drives_stand_beside_those_of_terminals() -> None:
    plan = make_plan(craft=oblique_craft(2, 3, 1))
    times = np.linspace(0, plan.trajectory.duration, style.INSTANTS)
    values = plan.trajectory.sample(times)
    for figure, own, platform in (
        (jp.plot.rates, values.joint_rates, values.angular_velocity),
        (jp.plot.accelerations, values.joint_accelerations, values.angular_acceleration),
    ):
        panels = figure(plan)
        for axes, columns in zip(panels, (own[:, :2], own[:, 2:4], own[:, 4:], platform), strict=True):
            assert len(_curves(axes)) == columns.shape[1]
            for curve, column in zip(_curves(axes), columns.T, strict=True):
                np.testing.assert_allclose(np.deg2rad(curve.get_ydata()), column, atol=1e-12)
        assert [axes.get_ylabel().split()[0] for axes in panels] == ["yaw", "pitch", "drive", "platform"]
        drives = [curve.get_color() for curve in _curves(panels[2])]
        assert drives == [style.device_style(number)["color"] for number in (2, 3, 4)]


@pytest.mark.parametrize(
    ("craft", "joints"),
    [
        (oblique_craft(0, 2, 1), 1),
        (oblique_craft(0, 0, 2), 0),
        (oblique_craft(5, 2, 1), 3),
        (make_observer(), 3),
    ],
    ids=["drives", "instruments", "eight devices", "observer"],
)
def test_every_figure_is_drawn_of_any_devices(craft, joints) -> None:
    plan = make_plan(craft=craft)
    assert len(jp.plot.overview(plan)) == 3 + joints
    assert len(jp.plot.rates(plan)) == 1 + joints
    titles = [axes.get_title() for axes in jp.plot.compare({"one": plan.trajectory}, craft)[:4]]
    assert (titles[3] in craft.joint_names) == bool(joints)
    drawn = dict(jp.plot.figures(plan))
    assert ("angles" in drawn) == bool(joints)
    jp.plot.animate(plan, frames=2).figure.draw_without_rendering()
    (axes,) = jp.plot.angles(plan) if not joints else [None]
    assert axes is None or [text.get_text() for text in axes.texts] == ["no joints"]


def test_targets_by_name_and_wishes_are_marked_with_their_devices() -> None:
    craft = make_observer()
    plan = make_plan(craft=craft)
    toward = unit(np.array([[0.3, 0.5, 0.2], [-0.4, 0.2, 0.9], [0.1, -0.9, 0.3]]))
    goal = Targets.of(
        {"telescope": toward[0], "antenna": toward[1]},
        prefer=(jp.Wish(device="array", direction=toward[2]),),
    )
    named = replace(plan, scenario=replace(plan.scenario, goal=goal))
    failed = replace(named, status=Status.NO_PATH, trajectory=None, path=None, goal=None)
    for one in (named, failed):
        axes = jp.plot.sphere(one)
        for marker, devices, directions in (("x", (2, 0), toward[:2]), ("D", (1,), toward[2:])):
            marks = [line for line in axes.lines if line.get_marker() == marker]
            assert [mark.get_color() for mark in marks] == [style.device_style(n)["color"] for n in devices]
            points = np.array([mark.get_xydata()[0] for mark in marks])
            np.testing.assert_allclose(points, projections.unfold(directions))
        told = [text.get_text() for text in axes.get_legend().get_texts()]
        assert {"target", "wish"} <= set(told)
        jp.plot.globe(one)
    told = [text.get_text() for text in jp.plot.sphere(plan).get_legend().get_texts()]
    assert not {"target", "wish"} & set(told)
