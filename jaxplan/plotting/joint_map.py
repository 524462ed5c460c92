"""Yaw against pitch of every terminal over a manoeuvre, with masks and ranges; outlines of fields of view.

Such a map shows what the sphere cannot: a mask is a polygon of joint angles, however the platform is turned.
Where a range of yaw spans more than a turn, a mask is drawn at each turn at which it lies in the range.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon, Rectangle

from jaxplan.geometry.vectors import unit
from jaxplan.model.devices import Instrument
from jaxplan.model.outlines import FORWARD, UP, field_corners
from jaxplan.model.scenario import Scenario
from jaxplan.model.zones import Mask, masks
from jaxplan.planner import Plan
from jaxplan.plotting.day import DayPlan
from jaxplan.plotting.style import (
    GREY,
    HALO,
    KEEP_OUT,
    SMALL,
    TEXT,
    WIDTH,
    Canvas,
    Entries,
    Look,
    device_style,
    expect_plan,
    legend_beside,
    motion,
    panels,
    plain,
    tidy,
)
from jaxplan.plotting.tracks import band_entry, draw_squares

_PANEL_SIZE = (WIDTH, 2.6)  # inches: width and height of a terminal's panel
_MASK: Look = {"facecolor": "#B2182B22", "edgecolor": KEEP_OUT, "linewidth": 1.1, "zorder": 1.6}
_RANGE: Look = {"fill": False, "edgecolor": GREY, "linewidth": 1.0, "zorder": 1.5}
_START_MARK: Look = {"marker": "*", "markersize": 12, "linestyle": "none", "markeredgecolor": "white"}
_END_MARK: Look = {
    "marker": "s",
    "markersize": 10,
    "linestyle": "none",
    "fillstyle": "none",
    "markeredgewidth": 1.8,
}
_NODE_MARK: Look = {"marker": ".", "markersize": 4.5, "linestyle": "none"}
_EDGE_FRACTIONS = np.linspace(0, 1, 33)[:-1, None]  # of an outline's points along an edge of the field


def joint_map_size(terminals: int) -> tuple[float, float]:
    """Return width and height in inches of a figure with the maps of so many terminals."""
    return _PANEL_SIZE[0], 0.8 + _PANEL_SIZE[1] * terminals


def joint_map(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Draw the yaw of each terminal against its pitch over the manoeuvre, with its range and its masks.

    Args:
        plan: a plan of any status; without a trajectory the nodes of its path, or start and goal, are drawn.
        ax: as many axes as terminals, a figure to put them in, or None for a new one.
        legend: whether to explain lines and marks beside the first map.

    Returns:
        The axes: yaw horizontally, pitch vertically, deg.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the spacecraft has no terminals, or another number of axes is given.
    """
    plan = expect_plan(plan)
    craft = plan.scenario.spacecraft
    count = len(craft.terminals)
    if not count:
        raise ValueError(
            f"the spacecraft of {plan.scenario.name!r} has no terminals, whose joints would be drawn"
        )
    found = panels(ax, count, joint_map_size(count), shared=False)
    for number, axes in enumerate(found):
        _draw_map(axes, plan, number)
    if legend:
        legend_beside(found[0], _entries(plan))
    return found


def _draw_map(axes: Axes, plan: Plan, number: int) -> None:
    """Draw the map of terminal `number`."""
    craft, colour = plan.scenario.spacecraft, device_style(number)["color"]
    own = [number, number + len(craft.terminals)]
    tidy(axes)
    low, high = np.rad2deg(craft.joint_ranges[own]).T
    axes.add_patch(Rectangle(tuple(low), *(high - low), **_RANGE))
    beyond = (high - low) * [0.025, 0.05]
    (left, bottom), (right, top) = low - beyond, high + beyond
    axes.set(xlim=(left, right), ylim=(bottom, top))
    for mask in masks(craft):
        if mask.device == craft.terminals[number].name:
            _draw_mask(axes, mask, low, high)
    if plan.trajectory is not None:
        track = np.rad2deg(motion(plan).values.joints[:, own])
        axes.plot(*track.T, **device_style(number), linewidth=1.8, zorder=3)
        if plan.scenario.robust is not None:
            draw_squares(axes, track, float(np.rad2deg(plan.scenario.robust.joint_error)), colour)
    if plan.path is not None:
        axes.plot(*np.rad2deg(plan.path.joints[:, own]).T, color=colour, zorder=3.2, **_NODE_MARK)
    for look, state in ((_START_MARK, plan.scenario.start), (_END_MARK, plan.goal)):
        if state is not None:
            edge = {} if look is _START_MARK else {"markeredgecolor": colour}
            axes.plot(*np.rad2deg(np.asarray(state.joints)[own]), color=colour, zorder=4, **look | edge)
    axes.set_xlabel("yaw (deg)", fontsize=TEXT)
    axes.set_ylabel("pitch (deg)", fontsize=TEXT)
    plain(axes.set_title(craft.terminals[number].name, fontsize=TEXT, loc="left"))


def _draw_mask(axes: Axes, mask: Mask, low: np.ndarray, high: np.ndarray) -> None:
    """Fill a mask at every turn of yaw, and write its name within the range `low` to `high`, (2,) deg."""
    for turn in mask.turns:
        corners = np.rad2deg(mask.corners) + np.array([360.0 * turn, 0.0])
        axes.add_patch(Polygon(corners, **_MASK))
        inside = 0.05 * (high - low)
        middle = np.clip(np.mean(corners, axis=0), low + inside, high - inside)
        name = mask.name.removesuffix(f" of {mask.device}")
        across, up = middle.tolist()
        plain(axes.text(across, up, name, fontsize=SMALL, color=KEEP_OUT, clip_on=True, **HALO))


def _entries(plan: Plan) -> Entries:
    """Return legend entries for what the maps of a plan show."""
    drawn: Entries = [(Line2D([], [], color=GREY, linewidth=1.8), "trajectory")] if plan.trajectory else []
    drawn += [(Line2D([], [], color=GREY, **_NODE_MARK), "node of the path")] if plan.path is not None else []
    drawn.append((Line2D([], [], color=GREY, **_START_MARK), "start"))
    word = "end" if isinstance(plan, DayPlan) else "goal"
    drawn += [(Line2D([], [], color=GREY, **_END_MARK), word)] if plan.goal is not None else []
    error = 0.0 if plan.scenario.robust is None else float(plan.scenario.robust.joint_error)
    drawn += band_entry(error) if plan.trajectory and error > 0 else []
    return [*drawn, (Patch(**_MASK), "mask"), (Patch(**_RANGE), "range")]


def field_outlines(
    scenario: Scenario, attitude: np.ndarray, joints: np.ndarray
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the outline of each device's field of view in a state, for devices that have a field.

    Args:
        scenario: whose devices are meant.
        attitude: (3, 3) body to inertial.
        joints: (J,) rad, angles of all joints.

    Yields:
        The device's number, and (k, 3) inertial unit vectors, the last of which is the first.
    """
    craft, rows = scenario.spacecraft, scenario.constraints
    sights = rows.sights(craft.gimbals, craft.fixed_boresights)
    for number, device in enumerate(craft.devices):
        if device.field_of_view is None:
            continue
        forward, up = FORWARD, UP if device.up is None else device.up
        if isinstance(device, Instrument):
            forward = device.boresight
        corners = field_corners(forward, up, device.field_of_view)
        ends = zip(corners, np.roll(corners, -1, axis=0), strict=True)
        line = np.concatenate(
            [(1 - _EDGE_FRACTIONS) * here + _EDGE_FRACTIONS * there for here, there in ends]
        )
        line = np.stack(unit(np.concatenate([line, line[:1]]).T), axis=-1)
        if not isinstance(device, Instrument):
            moved = replace(sights, carrier=np.full(len(line), number), carried=line)
            line = np.asarray(moved.in_body(joints))[-len(line) :]
        yield number, line @ np.asarray(attitude).T
