"""Figures of trajectories: values, both sides of joins, limits, and loads that only some spacecraft limit."""

import re
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from builders import make_plan, make_spacecraft
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import poly2leg
from wheels import random_wheels

import jaxplan as jp
from jaxplan.planner import Plan
from jaxplan.trajectory import Trajectory

INERTIA = np.array([[120.0, 5.0, -3.0], [5.0, 90.0, 2.0], [-3.0, 2.0, 60.0]])
HALF, SLOPE = 10.0, np.deg2rad(0.04)  # s, and rad/s^3: the acceleration rises and falls with it


def triangle(joints: int = 6, axis: int = 2, joint: int = 1) -> Trajectory:
    """A turn about a body axis whose acceleration is a triangle: the jerk jumps by twice the slope."""
    rise = Polynomial([0, 0, 0, SLOPE / 6])
    fall = Polynomial(
        [rise(HALF), rise.deriv()(HALF), rise.deriv(2)(HALF) / 2, -SLOPE / 6]
    )  # from the middle on
    on_unit = Polynomial([HALF / 2, HALF / 2])
    series = np.stack([np.pad(poly2leg(piece(on_unit).coef), (0, 2)) for piece in (rise, fall)])
    coefficients, of_joints = np.zeros((2, 6, 3)), np.zeros((2, 6, joints))
    coefficients[:, :, axis] = series
    of_joints[:, :, joint : joint + 1] = 0.5 * series[:, :, None]
    breaks = np.array([0.0, HALF, 2 * HALF])
    return Trajectory(
        breaks=breaks,
        chart_attitude=np.tile(np.eye(3), (2, 1, 1)),
        chart_start=np.zeros(2),
        chart_rate=np.zeros((2, 3)),
        coefficients=coefficients,
        joint_breaks=breaks,
        joint_coefficients=of_joints,
        node_times=breaks,
        smoothness=2,
        method="paper",
    )


def smooth() -> Trajectory:
    plan = make_plan(duration=30.0)
    assert plan.trajectory is not None
    return replace(plan.trajectory, smoothness=4, method="global")


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def levels(axes: Axes) -> set[float]:
    """Where horizontal lines across the whole panel are."""
    return {round(float(line.get_ydata()[0]), 6) for line in axes.lines if list(line.get_xdata()) == [0, 1]}


def curves(axes: Axes) -> list[np.ndarray]:
    return [line.get_xydata() for line in axes.lines if len(line.get_xdata()) > 2]


# Side by side


def test_curves_stand_at_their_values_on_both_sides_of_a_jump():
    panels = jp.plot.compare({"paper": triangle(), "global": smooth()}, make_spacecraft())
    assert [axes.get_title() for axes in panels[:4]] == ["body x", "body y", "body z", "terminal-2 yaw"]
    slope = np.rad2deg(SLOPE)
    for column, factor in ((0, 0.0), (2, 1.0), (3, 0.5)):
        rate, acceleration, jerk = (curves(panels[4 * row + column])[0].T for row in range(3))
        t = rate[0]
        rising, late = t < HALF, t - HALF
        np.testing.assert_array_equal(jerk[0], t)
        np.testing.assert_allclose(jerk[1], factor * slope * np.where(rising, 1, -1), atol=1e-9)
        np.testing.assert_allclose(acceleration[1], factor * slope * (HALF - np.abs(late)), atol=1e-9)
        after = HALF**2 / 2 + HALF * late - late**2 / 2
        np.testing.assert_allclose(rate[1], factor * slope * np.where(rising, t**2 / 2, after), atol=1e-9)
        assert np.diff(t)[np.searchsorted(t, HALF) - 1] < 1e-12
    assert panels[0].get_xlim() == (0, 30)


def test_the_joint_shown_is_the_one_nearest_to_a_limit_of_its_own():
    craft = make_spacecraft()
    slow = replace(craft.terminals[2], acceleration_limit=np.deg2rad(0.01))
    craft = replace(craft, terminals=(*craft.terminals[:2], slow))
    panels = jp.plot.compare({"one": triangle(joint=1), "other": triangle(joint=5)}, craft)
    assert panels[3].get_title() == "terminal-3 pitch"


def test_near_limits_are_drawn_and_far_ones_told():
    craft = replace(make_spacecraft(), rate_limit=np.deg2rad(4.1), jerk_limit=np.deg2rad(0.05))
    panels = jp.plot.compare({"paper": triangle()}, craft)  # up to 4 deg/s, 0.4 deg/s^2, 0.04 deg/s^3
    assert [levels(panels[4 * row]) for row in range(3)] == [{-4.1, 4.1}, set(), {-0.05, 0.05}]
    assert [texts(panels[4 * row]) for row in range(3)] == [[], ["limit ±2"], []]
    assert (levels(panels[11]), texts(panels[11])) == (set(), [])  # a joint's jerk has no limit
    assert [text.get_text() for text in panels[3].get_legend().get_texts()] == ["paper", "limit"]


def test_a_joint_has_a_scale_of_its_own_beside_the_body_axes():
    panels = jp.plot.compare({"paper": triangle(axis=2), "other": triangle(axis=0)}, make_spacecraft())
    for row in range(3):
        *platform, joint = panels[4 * row : 4 * row + 4]
        assert len({axes.get_ylim() for axes in platform}) == 1
        assert joint.get_ylim() != platform[0].get_ylim()
        highest = max(np.abs(line).max() for line in (curve[:, 1] for curve in curves(joint)))
        assert max(map(abs, joint.get_ylim())) < 1.2 * max(highest, *map(abs, levels(joint) or [0]))


def test_joins_and_the_largest_jump_are_told():
    panels = jp.plot.segments({"2 segments": triangle(), "one spline": smooth()}, make_spacecraft())
    assert [axes.get_title() for axes in panels] == [
        "2 segments",
        "one spline",
        "largest jump 0.08 deg/s³",
        "no jumps",
    ]
    for axes, joins in zip(panels, ([HALF], [], [HALF], []), strict=True):
        upright = [float(line.get_xdata()[0]) for line in axes.lines if list(line.get_ydata()) == [0, 1]]
        assert upright == joins
        assert len(curves(axes)) == 3
    names = [text.get_text() for text in panels[1].get_legend().get_texts()]
    assert names == ["body x", "body y", "body z", "join"]


def test_without_terminals_and_without_motion_there_is_a_figure_too():
    still = make_plan(0, 1, duration=0.0, edges=0).trajectory
    panels = jp.plot.compare({"still": still}, make_spacecraft(0))
    assert len(panels) == 9
    panels[0].figure.draw_without_rendering()
    jp.plot.segments({"still": still}, make_spacecraft(0))[0].figure.draw_without_rendering()


def test_nothing_to_draw_is_an_error():
    for draw in (jp.plot.compare, jp.plot.segments):
        with pytest.raises(ValueError, match="no trajectories"):
            draw({}, make_spacecraft())
    for arguments in (({}, {"a": 1.0}), ({"one": {}}, {})):
        with pytest.raises(ValueError, match="no durations"):
            jp.plot.durations(*arguments)


def test_given_axes_are_drawn_on_and_nothing_stays_open():
    before = dict(mpl.rcParams)
    two = {"$a": triangle(), "_b": smooth()}
    for draw, shape in ((jp.plot.compare, (3, 4)), (jp.plot.segments, (2, 2))):
        given = list(Figure().subplots(*shape).ravel())
        assert draw(two, make_spacecraft(), ax=given, legend=False) == given
        assert all(axes.get_legend() is None for axes in given)
        draw(two, make_spacecraft())[0].figure.draw_without_rendering()
    with pytest.raises(ValueError, match="4 panels, but 3 axes"):
        jp.plot.segments(two, make_spacecraft(), ax=Figure().subplots(3))
    assert pyplot.get_fignums() == []
    assert dict(mpl.rcParams) == before


# Durations


def test_durations_stand_at_their_values_with_their_excess_over_the_bound():
    seconds = {"paper": {"case 1": 80.0, "$b_2": 30.0}, "global": {"case 1": 20.2}}
    axes = jp.plot.durations(seconds, {"case 1": 20.0, "$b_2": 24.0})
    marks = [line for line in axes.lines if line.get_marker() in ("o", "s")]
    assert sorted(float(line.get_xdata()[0]) for line in marks) == [20.2, 30.0, 80.0]
    assert len({(line.get_marker(), line.get_color()) for line in marks}) == 2
    assert texts(axes) == ["+300 %", "+1.0 %", "+25 %"]
    legend = [text.get_text() for text in axes.get_legend().get_texts()]
    assert legend == ["paper", "global", "strict bound\nfor the goal,\nwithout zones", "impossible"]
    upright = {float(line.get_xdata()[0]) for line in axes.lines if len(set(line.get_xdata())) == 1}
    assert {20.0, 24.0} <= upright
    assert [label.get_text() for label in axes.get_yticklabels()] == ["case 1", "$b_2"]
    assert axes.get_xlim()[0] == 0
    axes.figure.draw_without_rendering()


# Torque


def loaded(**limits: object) -> Plan:
    plan = make_plan()
    craft = replace(plan.scenario.spacecraft, **limits)
    return replace(plan, scenario=replace(plan.scenario, spacecraft=craft))


def test_torque_is_what_changes_the_angular_momentum():
    """In the inertial frame ``d(R J omega)/dt = R torque``, by differences."""
    plan = loaded(inertia=INERTIA)
    torque, momentum = jp.plot.torque(plan)
    assert plan.trajectory is not None
    t = torque.lines[0].get_xdata()
    shown = [np.stack([line.get_ydata() for line in axes.lines], axis=1) for axes in (torque, momentum)]
    attitude = plan.trajectory.sample(t).attitude
    inertial = np.einsum("kij,kj->ki", attitude, shown[1])
    change = np.gradient(inertial, t, axis=0, edge_order=2)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", attitude, shown[0]), change, atol=2e-5)
    rate = plan.trajectory.sample(t).angular_velocity
    np.testing.assert_allclose(shown[1], rate @ INERTIA.T, atol=1e-12)
    assert levels(torque) == levels(momentum) == set()


def test_every_limited_load_has_a_panel_with_its_limits():
    limits = {
        "inertia": INERTIA,
        "torque_limit": np.array([1.0, 0.5, 0.5]),
        "wheel_momentum_limit": np.array([8.0, 8.0, 8.0]),
        "jerk_limit": np.deg2rad(0.3),
    }
    torque, momentum, jerk = jp.plot.torque(loaded(**limits))
    assert levels(torque) == {-1.0, -0.5, 0.5, 1.0}
    assert levels(momentum) == {-8.0, 8.0}
    assert (levels(jerk), texts(jerk)) == (set(), ["limit ±0.3"]), "far from the curves"
    assert "limit" in {text.get_text() for text in torque.get_legend().get_texts()}
    assert [axes.get_ylabel().split("(")[1] for axes in (torque, momentum, jerk)] == [
        "N m)",
        "N m s)",
        "deg/s³)",
    ]
    (only,) = jp.plot.torque(loaded(inertia=INERTIA, torque_limit=np.ones(3)))
    assert only.get_ylabel() == "torque (N m)"
    (only,) = jp.plot.torque(loaded(jerk_limit=np.deg2rad(0.1)))
    assert levels(only) == {-0.1, 0.1}


def test_wheels_have_curves_of_their_own_and_lose_the_momentum_that_their_torque_takes():
    array = random_wheels(4, seed=2)
    craft = loaded(inertia=INERTIA / 10, wheels=array, jerk_limit=np.deg2rad(0.3))
    jerk, torque, momentum = jp.plot.torque(craft)
    assert jerk.get_ylabel().endswith("(deg/s³)")
    assert [axes.get_ylabel() for axes in (torque, momentum)] == [
        "wheel torques (N m)",
        "wheel momenta (N m s)",
    ]
    t = torque.lines[0].get_xdata()
    given, held = (
        np.stack([line.get_ydata() for line in axes.lines[:4]], axis=1) for axes in (torque, momentum)
    )
    np.testing.assert_allclose(held[0], [wheel.stored for wheel in array], atol=1e-12)
    np.testing.assert_allclose(np.gradient(held, t, axis=0, edge_order=2), -given, atol=1e-4 * np.ptp(given))
    names = [text.get_text() for text in torque.get_legend().get_texts()]
    assert names[:4] == [wheel.name for wheel in array]
    told = {round(abs(level), 6) for level in levels(momentum)}
    assert told <= {round(wheel.momentum, 6) for wheel in array}
    (only,) = {len(axes.lines) for axes in jp.plot.torque(loaded(inertia=INERTIA))}
    assert only == 3


def test_each_axis_has_its_own_limit_and_a_limited_length_a_curve():
    plan = loaded(
        rate_limit=np.deg2rad([1.5, 1.0, 1.0]),
        rate_norm_limit=np.deg2rad(1.7),
        acceleration_limit=np.deg2rad([0.1, 0.2, 0.3]),
    )
    rate, acceleration = jp.plot.rates(plan)[-1], jp.plot.accelerations(plan)[-1]
    told = [float(level) for text in texts(rate) for level in re.findall(r"±([\d.]+)", text)]
    assert {abs(level) for level in levels(rate)} | set(told) == {1.0, 1.5, 1.7}
    told = [float(level) for text in texts(acceleration) for level in re.findall(r"±([\d.]+)", text)]
    assert {abs(level) for level in levels(acceleration)} | set(told) == {0.1, 0.2, 0.3}
    sample = plan.trajectory.sample(rate.lines[0].get_xdata())
    length = np.rad2deg(np.linalg.norm(sample.angular_velocity, axis=1))
    np.testing.assert_allclose(rate.lines[3].get_ydata(), length, atol=1e-12)
    names = [text.get_text() for text in rate.get_legend().get_texts()]
    assert names[:4] == ["body x", "body y", "body z", "length"]
    assert "length" not in [text.get_text() for text in acceleration.get_legend().get_texts()]


def test_a_plan_has_a_figure_of_torque_only_where_there_is_a_limit():
    assert "torque" in jp.plot.FIGURE_NAMES
    for limits, there in (
        ({}, False),
        ({"inertia": INERTIA}, False),
        ({"inertia": INERTIA, "wheel_momentum_limit": np.full(3, 9.0)}, True),
        ({"jerk_limit": 0.1}, True),
    ):
        assert ("torque" in [name for name, _ in jp.plot.figures(loaded(**limits))]) == there
    with pytest.raises(ValueError, match=r"neither an inertia nor .* give it spacecraft\.inertia_kg_m2"):
        jp.plot.torque(loaded())


def test_motions_may_be_called_by_numbers():
    given = {1: triangle(), 2: smooth()}
    figure = jp.plot.compare(given, make_spacecraft())[0].figure
    legends = [*figure.legends, *(axes.legend_ for axes in figure.axes if axes.legend_ is not None)]
    assert {"1", "2"} <= {text.get_text() for legend in legends for text in legend.get_texts()}
    assert jp.plot.segments(given, make_spacecraft())
    assert jp.plot.durations({1: {"a": 3.0}}, {"a": 2.0})
    pyplot.close("all")
