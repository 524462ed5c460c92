"""A timeline's plan as one figure: rows of what is done above panels of margins, rates, joints and so on.

All share one axis of time. From top to bottom there are rows of activities and devices
(`jaxplan.plotting.activity_bars`), the smallest margin to each zone, the pointing error of each device beside
its tolerance, the platform's angular velocity, the angles of joints, and the momenta of wheels. Slews are
grey in all of them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D

from jaxplan.geometry.vectors import separation
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.plotting import margin_panels
from jaxplan.plotting.activity_bars import (
    draw_rows,
    lane_height,
    row_count,
    row_entries,
    row_height,
    shade_slews,
    slews,
    write_names,
)
from jaxplan.plotting.day import followings
from jaxplan.plotting.limit_lines import barrier
from jaxplan.plotting.margin_panels import margins_over_time
from jaxplan.plotting.style import (
    GREY,
    KEEP_OUT,
    LINE_STYLES,
    TEXT,
    WIDTH,
    Canvas,
    Entries,
    Look,
    Motion,
    curve,
    device_style,
    expect_plan,
    legend_beside,
    legend_height,
    motion,
    note,
    panels,
    plain,
    time_axis,
)
from jaxplan.plotting.time_panels import draw_platform_rate, draw_wheel_momenta, joint_panels
from jaxplan.runtime.arguments import expect
from jaxplan.timeline.record import TimelinePlan

_MIN_ROW_HEIGHT, _HEAD_HEIGHT, _PANEL_HEIGHT, _FOOT_HEIGHT = 0.3, 0.35, 1.4, 0.6  # inches
_WIDTH_SHARE, _HEIGHT_SHARE = 0.66, 0.93  # left to a panel: of the figure's width, of its own height
_MIN_HEIGHT_SHARE = 0.75  # the same of its own height, where legends of other panels are higher than these
_ZONE_COLOURS = ("#B2182B", "#0B6394", "#8C510A", "#7A3E9D", "#1B7837", "#E08214", "#000000", "#C51B7D")
_MAX_COLOURED_ZONES = len(_ZONE_COLOURS)  # zones with the least margins that have a colour; others are grey
_LEAST_FLOOR_RATIO = 1e-2  # times the least proved error or tolerance: smaller errors are drawn as that
_TOLERANCE_FLOOR_RATIO = 1e-5  # the same with the least tolerance alone; the larger of both counts
_WINDOW_COUNT = 40  # a curve of errors shows the largest one within windows of 1 / 40 of its span
# Fractions of the day: what is followed for less than the first has a dot of its largest error, for less than
# the second a level line. Curves so narrow would be mere vertical strokes.
_MAX_DOT_SHARE, _MAX_LEVEL_SHARE = 0.006, 0.1
_LIMIT_LABEL = "limit, its ticks on\nthe side beyond it"
_LEVEL_LINE: Look = {"linewidth": 2.4, "solid_capstyle": "butt", "linestyle": "-"}
_PEAK_MARK: Look = {"markersize": 3.0, "markeredgewidth": 0.0}
_SLEW_LINE: Look = {"linewidth": 0.6, "alpha": 0.8}
_PROVED_LINE: Look = {"color": "black", "linewidth": 1.0, "linestyle": (0, (1, 1))}


class _Panel(NamedTuple):
    """A panel: its height in inches, and a function that draws it on axes and returns legend entries."""

    height: float
    draw: Callable[[Axes], Entries]


def timeline(plan: TimelinePlan, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Draw a timeline's plan: what is done, and margins, pointing, rates, joints and wheels over the day.

    A row for each device has bars while it follows a target, with the target's name where it is known; where
    the target is hidden the row is hatched. Slews are grey throughout. Below follow the smallest margin to
    each zone, pointing errors beside their tolerances and proved bounds, the platform's angular velocity,
    joint angles with their ranges, and the momenta of wheels, as far as there are any. The axis of time is in
    UTC if the scene has an epoch.

    Args:
        plan: a plan of a timeline, of any status; without a trajectory the rows stand alone.
        ax: as many axes as there are panels, a figure to put them in, or None for a new one.
        legend: whether to name curves beside the panels.

    Returns:
        The axes, from top to bottom.

    Raises:
        TypeError: if it is no plan of a timeline.
        ValueError: if another number of axes is given.

    Example:
        >>> day = jp.plan_timeline(timeline)
        >>> jp.plot.timeline(day)[0].figure.savefig("day.png")
    """
    expect("plan", plan, TimelinePlan, "jp.plan_timeline makes one")
    moves = None if plan.trajectory is None else motion(plan)
    shown = _make_panels(plan, moves)
    heights = [panel.height for panel in shown]
    size = WIDTH, _FOOT_HEIGHT + sum(heights)
    new = ax is None or isinstance(ax, Figure | SubFigure)
    grid = panels(ax, len(shown), size, heights=heights)
    for axes, panel in zip(grid, shown, strict=True):
        entries = panel.draw(axes)
        if axes is not grid[0]:
            shade_slews(axes, plan, edges=False)
            axes.set_ylabel(axes.get_ylabel().replace(" (", "\n("))
        if legend:
            legend_beside(
                axes, [(handle, _LIMIT_LABEL if text == "limit" else text) for handle, text in entries]
            )
    _write_title(grid[0], plan)
    if moves is not None:
        time_axis(grid, moves)
        grid[0].grid(False, axis="y")
        grid[0].tick_params(axis="y", length=0)
    write_names(grid[0], plan, _day_end(plan), _panel_extent(grid[0], heights[0] / size[1] if new else None))
    return grid


def timeline_size(plan: TimelinePlan) -> tuple[float, float]:
    """Return width and height of the figure, inches."""
    moves = None if plan.trajectory is None else motion(plan)
    return WIDTH, _FOOT_HEIGHT + sum(panel.height for panel in _make_panels(plan, moves))


def _write_title(axes: Axes, plan: TimelinePlan) -> None:
    """Write above the rows the name of the timeline, how many activities are planned, and a failed status."""
    asked = {activity.name for activity in plan.timeline.activities}  # without the rest after the last one
    done = sum(one.ok and one.name in asked for one in plan.activities)
    words = f"{plan.timeline.name}: {done} of {len(asked)} activities planned"
    outcome = "" if plan.ok else f", {plan.status.name}"
    plain(axes.set_title(words + outcome, fontsize=TEXT + 1, loc="left"))


def _make_panels(plan: TimelinePlan, moves: Motion | None) -> list[_Panel]:
    """Return the panels that a plan has, from top to bottom; `moves` is None without a trajectory."""
    end = _day_end(plan)
    row = max(_MIN_ROW_HEIGHT, row_height(plan, _WIDTH_SHARE * WIDTH * 72, end) / 72)
    lane = lane_height(plan, _WIDTH_SHARE * WIDTH * 72, end) / 72
    legend = legend_height(row_entries(plan, end)) / _MIN_HEIGHT_SHARE  # else it makes a gap below the rows
    row = max(row, (legend - _HEAD_HEIGHT - lane) / row_count(plan))
    found = [
        _Panel(
            _HEAD_HEIGHT + row * row_count(plan) + lane, lambda axes: draw_rows(axes, plan, end, lane / row)
        )
    ]
    if moves is None:
        return found
    craft = plan.timeline.scene.spacecraft
    if plan.timeline.scene.zones:
        found.append(_Panel(_PANEL_HEIGHT, lambda axes: _draw_margins(axes, plan, moves)))
    if followings(plan):
        found.append(_Panel(_PANEL_HEIGHT, lambda axes: _draw_errors(axes, plan, moves)))
    found.append(_Panel(_PANEL_HEIGHT, lambda axes: _draw_rate(axes, plan, moves, craft)))
    found += [_Panel(_PANEL_HEIGHT, draw) for draw in joint_panels(craft, moves)]
    if craft.wheels:
        own = expect_plan(plan)
        found.append(_Panel(_PANEL_HEIGHT, lambda axes: draw_wheel_momenta(axes, own, moves)))
    return found


def _panel_extent(axes: Axes, share: float | None) -> tuple[float, float]:
    """Return width and height, points, of a panel.

    Args:
        axes: the panel.
        share: fraction of the figure's height that the panel will have once the figure is laid out; then the
            layout is run first, or without one the size is estimated. None for a panel that is measured as it
            is.
    """
    figure = axes.get_figure(root=False)
    assert figure is not None
    if share is not None and isinstance(figure, Figure) and (engine := figure.get_layout_engine()):
        engine.execute(figure)
        share = None
    box = (
        axes.get_window_extent() if share is None else figure.bbox.shrunk(_WIDTH_SHARE, share * _HEIGHT_SHARE)
    )
    return box.width * 72 / figure.dpi, box.height * 72 / figure.dpi


def _day_end(plan: TimelinePlan) -> float:
    """Return when the day ends, s; without a trajectory when its last window closes, 1 s at least."""
    if plan.trajectory is not None:
        return plan.trajectory.duration
    ends = [one.latest for one in plan.timeline.activities if one.latest is not None]
    return max([plan.timeline.until or 0.0, *ends, 1.0])


def _draw_margins(axes: Axes, plan: TimelinePlan, moves: Motion) -> Entries:
    """Draw the smallest margin of any device to each zone, deg; returns legend entries.

    Margins are positive where the zone is kept.
    """
    axes.set_ylabel("margin (deg)", fontsize=TEXT)
    of_zones: dict[str, np.ndarray] = {}
    for margin in margins_over_time(plan.timeline.scene, moves):
        values = np.rad2deg(margin.values)
        of_zones[margin.zone] = np.fmin(of_zones.get(margin.zone, np.full_like(values, np.nan)), values)
    if not of_zones:
        note(axes, "no margins")
        return []
    order = sorted(of_zones, key=lambda name: float(np.nanmin(of_zones[name])))
    entries: Entries = []
    for number, name in reversed(list(enumerate(order))):
        look: Look = {"color": "0.7", "linewidth": 0.7}
        if number < _MAX_COLOURED_ZONES:
            look = {"color": _ZONE_COLOURS[number], "linestyle": LINE_STYLES[number % 4], "linewidth": 1.4}
            entries.insert(0, (Line2D([], [], **look), name))
        curve(axes, moves.times, of_zones[name], **look)
    if len(order) > _MAX_COLOURED_ZONES:
        entries.append(
            (Line2D([], [], color="0.7", linewidth=0.7), f"{len(order) - _MAX_COLOURED_ZONES} others")
        )
    margin_panels.span(axes, list(of_zones.values()))
    return [*entries, (Line2D([], [], color=KEEP_OUT, **barrier(-1)), "limit: below it\na zone is broken")]


def _draw_rate(axes: Axes, plan: TimelinePlan, moves: Motion, craft: Spacecraft) -> Entries:
    """Draw the platform's angular velocity by body axis, thin in slews; returns legend entries.

    On a long time axis a slew is a vertical stroke, which would hide the curve around it.
    """
    entries = draw_platform_rate(axes, moves, craft)
    axes.set_ylabel("platform rate (deg/s)", fontsize=TEXT)
    spans = slews(plan)
    within = np.zeros(len(moves.times), dtype=bool)
    for start, end in spans:
        within |= (moves.times >= start) & (moves.times <= end)
    inner = within.copy()  # so that the two parts of a line meet
    inner[1:-1] = within[:-2] & within[1:-1] & within[2:]
    for line in [line for line in axes.lines if np.size(line.get_xdata()) == len(moves.times)]:
        values = np.asarray(line.get_ydata(), float)
        line.set_ydata(np.where(inner, np.nan, values))
        axes.plot(moves.times, np.where(within, values, np.nan), color=line.get_color(), **_SLEW_LINE)
    return [*entries, *[(Line2D([], [], color=GREY, **_SLEW_LINE), "in slews")] * bool(spans)]


def _draw_errors(axes: Axes, plan: TimelinePlan, moves: Motion) -> Entries:
    """Draw devices' angles from targets, tolerances and proved bounds, deg; returns legend entries."""
    axes.set_ylabel("pointing error (deg)", fontsize=TEXT)
    craft = plan.timeline.scene.spacecraft
    errors: dict[int, np.ndarray] = {}
    levels: dict[int, list[tuple[float, float, float]]] = {}  # of those too short for a curve
    peaks: dict[int, list[tuple[float, float]]] = {}  # of those too short for a level
    proved, asked = list[tuple[float, float, float]](), list[tuple[float, float, float]]()
    for own in followings(plan):
        within = (moves.times >= own.begin) & (moves.times <= own.end)
        line = errors.setdefault(own.device, np.full(len(moves.times), np.nan))
        seen = np.asarray(own.path.at(moves.times[within]))
        off = np.rad2deg(separation(moves.boresights[within, own.device], seen))
        lasts, highest = own.end - own.begin, float(np.max(off, initial=0.0))
        if lasts > _MAX_LEVEL_SHARE * moves.times[-1]:
            line[within] = _running_maximum(off)
        elif lasts > _MAX_DOT_SHARE * moves.times[-1]:
            levels.setdefault(own.device, []).append((own.begin, own.end, highest))
        else:
            peaks.setdefault(own.device, []).append(((own.begin + own.end) / 2, highest))
        asked.append((own.begin, own.end, float(np.rad2deg(own.tolerance))))
        if own.planned.pointing_error is not None:
            proved.append((own.begin, own.end, float(np.rad2deg(own.planned.pointing_error))))
    least, most = (pick(value for *_, value in (*asked, *proved)) for pick in (min, max))
    lowest = max(_LEAST_FLOOR_RATIO * least, _TOLERANCE_FLOOR_RATIO * min(value for *_, value in asked))
    axes.set_yscale("log")
    axes.set_ylim(lowest / 2, 4 * most)  # before anything is drawn: levels alone have no height to scale to
    one = len({value for *_, value in asked}) == 1
    for device, line in errors.items():
        style = device_style(device)
        curve(axes, moves.times, np.maximum(line, lowest), **{**style, "linewidth": 1.2})
    for device, spans in levels.items():
        times, values = _to_gapped_line(spans)
        axes.plot(times, np.maximum(values, lowest), color=device_style(device)["color"], **_LEVEL_LINE)
    for device, dots in peaks.items():
        times, values = np.array(dots).T
        axes.plot(times, np.maximum(values, lowest), "o", color=device_style(device)["color"], **_PEAK_MARK)
    if one:
        axes.axhline(asked[0][2], color=GREY, **barrier(1))
    else:
        axes.plot(*_to_gapped_line(asked), color=GREY, linewidth=1)
    entries: Entries = [
        (Line2D([], [], **{**device_style(device), "linewidth": 1.2}), craft.device_names[device])
        for device in sorted(errors)
    ]
    short: Look = {
        "color": GREY,
        "marker": "o",
        **_PEAK_MARK,
        **(_LEVEL_LINE if levels else {"linestyle": "none"}),
    }
    entries += [(Line2D([], [], **short), "largest, of one\nthat is short")] * bool(peaks or levels)
    entries.append((Line2D([], [], color=GREY, **barrier(1)), "tolerance"))
    if proved:
        axes.plot(*_to_gapped_line(proved), **_PROVED_LINE)
        entries.append((Line2D([], [], **_PROVED_LINE), "proved for all time"))
    return entries


def _running_maximum(errors: np.ndarray) -> np.ndarray:
    """Return the running maximum of errors (k,), over windows of 1 / `_WINDOW_COUNT` of their number.

    Errors vanish at nodes, so the curve itself would be vertical strokes.
    """
    half = len(errors) // (2 * _WINDOW_COUNT)
    padded = np.pad(errors, half, mode="edge")
    return np.asarray(np.max(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=-1))


def _to_gapped_line(levels: list[tuple[float, float, float]]) -> tuple[Any, Any]:
    """Convert levels (start in s, end in s, value) to times and values of one line with gaps between them."""
    starts, ends, values = np.array(levels).T
    gaps = np.full(len(levels), np.nan)
    return np.stack([starts, ends, gaps], axis=1).ravel(), np.stack([values, values, gaps], axis=1).ravel()
