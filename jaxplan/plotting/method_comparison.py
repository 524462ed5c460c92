"""Planners and methods compared, one per line: the paper's Table 4 as figures, and durations beside a bound.

A *row* is the result of one planner on the scenes of one kind (`jaxplan.study.printed_planners.Row`); a
*printed* row is one that the paper prints, and is drawn in grey. A path is *found* when its planner says so,
and *clear* when no zone is broken along its whole edges. A planner has one colour in all panels, by its
position in `jaxplan.search.PLANNERS`, whichever planners are compared. The first line of a panel is at height
0 of the vertical axis, the next at 1 below it.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle, islice

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator

from jaxplan.plotting.style import (
    COLOURS,
    GREY,
    SMALL,
    TEXT,
    WIDTH,
    Canvas,
    Entries,
    Look,
    expect_mapping,
    legend_at_foot,
    legend_beside,
    name_lines,
    panels,
    plain,
    plain_numbers,
    tidy,
)
from jaxplan.runtime.arguments import expect_any, several
from jaxplan.search import PLANNERS
from jaxplan.study.printed_planners import Row

_CLEAR_MARK: Look = {"marker": "o", "markersize": 5.5, "linestyle": "none"}
_FOUND_MARK: Look = {"marker": "D", "markersize": 5, "linestyle": "none", "markerfacecolor": "white"}
_INTERVAL_LINE: Look = {"linewidth": 1.4, "solid_capstyle": "butt"}
_MEAN_MARK: Look = {
    "marker": "|",
    "markersize": 15,
    "markeredgewidth": 1.8,
    "linestyle": "none",
    "color": "black",
    "zorder": 4,
}
_SPREAD_LINE: Look = {"linewidth": 1.4, "marker": "|", "markersize": 6, "color": GREY}
_DOT: Look = {"marker": "o", "linestyle": "none", "markeredgewidth": 0.8}
_LARGE_DOT, _SMALL_DOT, _FEW_SCENES = 4.2, 1.6, 10  # points: for up to `_FEW_SCENES` scenes, and at least
_MARK_OFFSET = 0.17  # lines: half the distance between the marks for paths found and for paths clear
_DOT_BAND = 0.62  # lines: height over which dots are spread
_ROW_HEIGHT, _TITLE_HEIGHT, _FOOT_HEIGHT = 0.25, 0.45, 1.5  # inches: of a planner, a kind's title, below all
_LEGEND_COLUMNS = 4  # columns of the legend
_COLUMNS = {  # attributes of a row that have a panel, with the label of its axis
    "seconds": "search time (s)",
    "steps": "path length\n(steps)",
    "nodes": "path length\n(interior nodes)",
}
_MIN_SPAN = 4.0  # steps or nodes that an axis shows at least
_MARKERS = ("o", "s", "D", "^", "v", "P", "X")  # of the methods whose durations are compared
_FRAME_HEIGHT, _METHOD_HEIGHT = 1.0, 0.26  # inches: around the panel of durations; a method of a scene
_SCENE_GAP = 0.6  # lines of methods: free height between scenes
_IMPOSSIBLE_AREA: Look = {"color": "0.93", "linewidth": 0}
_BOUND_LINE: Look = {"color": "black", "linewidth": 1.6}


def table4(rows: Iterable[Row], ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Draw success rates, search times and path lengths of planners that searched the same scenes.

    Each kind of scenes has four panels with one planner per line: the fractions of scenes in which a path was
    found and is clear; the times of all searches, on a logarithmic axis; and the lengths of the clear paths,
    in steps and in interior nodes. A dot is a scene. A printed row shows the span from least to largest with
    the mean, and stands last.

    Args:
        rows: what `jaxplan.study.printed_planners.compare` returns, perhaps with `printed_rows` of the same
            module. Kinds and planners are drawn in the order in which they first appear.
        ax: four axes per kind, from left to right; a figure to put them in, or None for a new one.
        legend: whether to explain the marks at the foot of the figure.

    Returns:
        The axes, four per kind.

    Raises:
        TypeError: if they are no rows.
        ValueError: if there are no rows, or another number of axes is given.

    Example:
        >>> from jaxplan.study.printed_planners import compare, printed_rows
        >>> jp.plot.table4([*compare(["keep_out"], count=5), *printed_rows(["keep_out"])])
    """
    kinds = _group_by_kind(rows)
    if not kinds:
        raise ValueError("there are no rows to draw")
    across = 1 + len(_COLUMNS)
    heights = [_TITLE_HEIGHT + _ROW_HEIGHT * len(of_kind) for of_kind in kinds]
    every = panels(ax, across * len(kinds), _figure_size(kinds), columns=across, heights=heights)
    for number, of_kind in enumerate(kinds):
        first, *others = every[across * number : across * (number + 1)]
        planners = [row.planner for row in of_kind]
        for label, row in zip(name_lines(first, planners), of_kind, strict=True):
            label.set_color(GREY if _is_printed(row) else "black")
        _draw_success(first, of_kind)
        for axes, column in zip(others, _COLUMNS, strict=True):
            name_lines(axes, planners, shown=False)
            _draw_spreads(axes, of_kind, column)
        plain(first.set_title(_title(of_kind), fontsize=TEXT + 1, loc="left"))
    for place in range(across):
        _align_limits(every[place::across])
    if legend:
        legend_at_foot(every[0], _entries([row for of_kind in kinds for row in of_kind]), _LEGEND_COLUMNS)
    return every


def comparison_figure(rows: Iterable[Row]) -> Figure:
    """Draw `table4` of `rows` in a new figure that does not belong to pyplot."""
    every = list(rows)
    figure = Figure(figsize=_figure_size(_group_by_kind(every)), layout="constrained")
    table4(every, ax=figure)
    return figure


def planner_colour(name: str) -> str:
    """Return the colour of a planner in all figures; grey for a name that is not in `PLANNERS`."""
    names = tuple(PLANNERS)
    return COLOURS[names.index(name) % len(COLOURS)] if name in names else GREY


def _is_printed(row: Row) -> bool:
    """Return True for a printed row, which has least, largest and mean instead of a value for each scene."""
    return row.solved is None


def _group_by_kind(rows: Iterable[Row]) -> list[list[Row]]:
    """Check rows and group them by their kind of scenes; printed rows come last in each group."""
    kinds: dict[str, list[Row]] = {}
    for number, row in enumerate(
        several("rows", rows, "rows, as jaxplan.study.printed_planners.compare returns")
    ):
        expect_any(f"rows[{number}]", row, (Row,), "a row of jaxplan.study.printed_planners.compare")
        kinds.setdefault(row.kind, []).append(row)
    return [sorted(of_kind, key=_is_printed) for of_kind in kinds.values()]


def _figure_size(kinds: Sequence[Sequence[Row]]) -> tuple[float, float]:
    """Return width and height of the figure, inches."""
    return WIDTH, _FOOT_HEIGHT + sum(_TITLE_HEIGHT + _ROW_HEIGHT * len(of_kind) for of_kind in kinds)


def _title(rows: Sequence[Row]) -> str:
    """Return the title of a kind's panels: its name and the number of scenes, printed ones apart."""
    own, printed = ([row.scenes for row in rows if _is_printed(row) == of] for of in (False, True))
    told = [f"{_format_range(own)} scene{'s' * (set(own) != {1})}"] if own else []
    told += [f"{_format_range(printed)} as printed"] if printed else []
    return f"{rows[0].kind}: {', '.join(told)}"


def _format_range(counts: Sequence[int]) -> str:
    """Return the least and the largest count as text, "5 to 20", or the only one, "20"."""
    low, high = min(counts), max(counts)
    return f"{low}" if low == high else f"{low} to {high}"


def _draw_success(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw the percentages of scenes in which a path was found and is clear, with Wilson intervals."""
    for line, row in enumerate(rows):
        if row.scenes == 0:
            _write_remark(axes, line, "no scenes")
            continue
        pairs = [(row.found, _FOUND_MARK, 0.0)]
        if row.clear is not None:
            pairs = [(row.found, _FOUND_MARK, -_MARK_OFFSET), (row.clear, _CLEAR_MARK, _MARK_OFFSET)]
        for count, look, offset in pairs:
            bounds, colour = 100 * np.array(row.interval(count)), planner_colour(row.planner)
            axes.plot(bounds, [line + offset] * 2, color=colour, **_INTERVAL_LINE)
            rate = 100 * count / row.scenes
            axes.plot([rate], [line + offset], color=colour, clip_on=False, zorder=3, **look)
    axes.set(xlim=(-2, 102), xticks=range(0, 101, 25))
    axes.set_xlabel("success rate (%)", fontsize=TEXT)


def _draw_spreads(axes: Axes, rows: Sequence[Row], column: str) -> None:
    """Draw one column of `_COLUMNS` for each row: times of all searches, or lengths of the clear paths.

    In the panel of times the dot of a search that led to no clear path is hollow.
    """
    times = column == "seconds"
    if times:
        axes.set_xscale("log")
    for line, row in enumerate(rows):
        values = getattr(row, column)
        if values is None:
            _write_remark(axes, line, "not printed")
        else:
            _draw_values(axes, line, row, values, row.solved if times else None)
    if times:
        axes.xaxis.set_major_locator(LogLocator(numticks=4))
        plain_numbers(axes.xaxis)
    elif column == "nodes":
        axes.xaxis.set_major_locator(MaxNLocator(nbins=4, integer=True))
    axes.set_xlabel(_COLUMNS[column], fontsize=TEXT)


def _draw_values(
    axes: Axes, line: int, row: Row, values: np.ndarray, solved: np.ndarray | None = None
) -> None:
    """Draw a row's values on the line at height `line`: a dot for each scene, and the mean.

    Args:
        axes: the panel.
        line: height of the line.
        row: whose values they are.
        values: (k,) one per scene; of a printed row (3,) least, largest and mean, drawn as a bar with the
            mean.
        solved: (k,) bool, which dots are filled; None for all.
    """
    if _is_printed(row):
        least, largest, mean = values
        axes.plot([least, largest], [line, line], **_SPREAD_LINE)
        axes.plot([mean], [line], **_MEAN_MARK)
        return
    if not len(values):
        _write_remark(axes, line, "no clear path" if row.scenes else "no scenes")
        return
    filled = np.ones(len(values), dtype=bool) if solved is None else solved
    heights = line + _DOT_BAND * ((0.5 + np.arange(len(values)) * 0.618034) % 1 - 0.5)
    dot = {
        **_DOT,
        "markersize": float(np.clip(_LARGE_DOT * (_FEW_SCENES / row.scenes) ** 0.4, _SMALL_DOT, _LARGE_DOT)),
    }
    colour = planner_colour(row.planner)
    for chosen, face in ((filled, colour), (~filled, "white")):
        if np.any(chosen):
            axes.plot(values[chosen], heights[chosen], color=colour, markerfacecolor=face, **dot)
    axes.plot([np.mean(values)], [line], **_MEAN_MARK)


def _write_remark(axes: Axes, line: int, text: str) -> None:
    """Write on the line at height `line` why nothing is drawn there."""
    place = axes.get_yaxis_transform()
    axes.text(0.02, line, text, transform=place, ha="left", va="center", color=GREY, fontsize=SMALL)


def _entries(rows: Sequence[Row]) -> Entries:
    """Return legend entries for what the panels of these rows show."""
    drawn = any(row.scenes for row in rows)
    own = [row for row in rows if row.scenes and row.solved is not None]
    possible: list[tuple[bool, Look, str]] = [
        (drawn, _FOUND_MARK, "path found"),
        (bool(own), _CLEAR_MARK, "path clear\nalong whole edges"),
        (drawn, _INTERVAL_LINE, "95 % interval\n(Wilson)"),
        (bool(own), {**_DOT, "markersize": _LARGE_DOT}, "a scene"),
        (
            any(not np.all(row.solved) for row in own),
            {**_DOT, "markersize": _LARGE_DOT, "markerfacecolor": "white"},
            "a scene without\nclear path",
        ),
        (drawn, {**_MEAN_MARK, "markersize": 9}, "mean"),
        (any(map(_is_printed, rows)), _SPREAD_LINE, "as printed:\nleast to largest"),
    ]
    return [(Line2D([], [], **{"color": GREY, **look}), text) for there, look, text in possible if there]


def _align_limits(column: Sequence[Axes]) -> None:
    """Give a column of panels the same limits; of those that share the axis only the lowest has its label."""
    decades = column[0].get_xscale() == "log"
    drawn = [axes for axes in column if axes.lines]
    spans = np.array([axes.dataLim.intervalx if decades else axes.get_xlim() for axes in drawn])
    for axes in column:
        if drawn:
            axes.set_xlim(_round_limits(np.min(spans), np.max(spans), decades=decades))
        else:
            axes.set_xticks([])
        if axes is not column[-1] and axes.get_shared_x_axes().joined(axes, column[-1]):
            axes.set_xlabel("")


def _round_limits(low: float, high: float, *, decades: bool) -> tuple[float, float]:
    """Return axis limits that contain `low` and `high`: whole decades, or at least `_MIN_SPAN` apart."""
    if decades:
        return 0.9 * 10 ** np.floor(np.log10(low)), 1.1 * 10 ** np.ceil(np.log10(high))
    missing = max(_MIN_SPAN - (high - low), 0.0)
    return low - missing / 2, high + missing / 2


def durations(
    seconds: Mapping[str, Mapping[str, float]],
    bounds: Mapping[str, float],
    ax: Canvas = None,
    *,
    legend: bool = True,
) -> Axes:
    """Draw durations of several methods for each scene, with their excess over a lower bound in percent.

    Args:
        seconds: durations in s, by method and then by scene; a scene without a value has no mark.
        bounds: by scene, in s: no motion to the same goal is shorter (`Plan.duration_bound`). Bounds ignore
            zones, and another goal that meets the same targets may be reached sooner.
        ax: axes, a figure to put them in, or None for a new one.
        legend: whether to name the methods beside the panel.

    Returns:
        The axes.

    Raises:
        TypeError: if they are no dicts.
        ValueError: if there are no methods or no scenes.

    Example:
        >>> jp.plot.durations({"minimum": {"case 1": 20.9}, "stretched": {"case 1": 25.5}}, {"case 1": 20.6})
    """
    for method, of_method in expect_mapping("seconds", seconds).items():
        expect_mapping(f"seconds[{method!r}]", of_method)
    expect_mapping("bounds", bounds)
    if not (seconds and bounds):
        raise ValueError("there are no durations to draw")
    pitch = len(seconds) + _SCENE_GAP
    (axes,) = panels(ax, 1, (9.0, _FRAME_HEIGHT + _METHOD_HEIGHT * pitch * len(bounds)))
    tidy(axes)
    axes.grid(False, axis="y")
    marks: list[Look] = [
        {"color": colour, "marker": marker, "markersize": 6, "linestyle": "none"}
        for colour, marker in islice(zip(cycle(COLOURS), cycle(_MARKERS)), len(seconds))
    ]
    for number, (scene, bound) in enumerate(bounds.items()):
        top = number * pitch
        low, high = top - 0.5, top + len(seconds) - 0.5
        axes.fill_between([0, bound], low, high, **_IMPOSSIBLE_AREA, zorder=0.5)
        axes.plot([bound, bound], [low, high], **_BOUND_LINE)
        for line, (of_method, look) in enumerate(zip(seconds.values(), marks, strict=True)):
            if scene in of_method:
                _draw_duration(axes, top + line, float(of_method[scene]), bound, look)
    axes.set_yticks(np.arange(len(bounds)) * pitch + (len(seconds) - 1) / 2, list(bounds))
    for label in axes.get_yticklabels():
        plain(label)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(bounds) * pitch - _SCENE_GAP - 0.2, -0.8)
    reached = [
        float(of_method[scene]) for of_method in seconds.values() for scene in bounds if scene in of_method
    ]
    axes.set_xlim(0, 1.1 * max([*bounds.values(), *reached]))
    axes.set_xlabel("duration (s)", fontsize=TEXT)
    if legend:
        entries: Entries = [(Line2D([], [], **look), name) for name, look in zip(seconds, marks, strict=True)]
        bound_line = (Line2D([], [], **_BOUND_LINE), "strict bound\nfor the goal,\nwithout zones")
        legend_beside(axes, [*entries, bound_line, (Patch(**_IMPOSSIBLE_AREA), "impossible")])
    return axes


def _draw_duration(axes: Axes, height: float, value: float, bound: float, look: Look) -> None:
    """Draw a duration, s, as a mark at a height, with a line from its bound and its excess in percent."""
    axes.plot([bound, value], [height] * 2, color=look["color"], linewidth=1, alpha=0.6)
    axes.plot([value], [height], **look)
    axes.annotate(
        f"{100 * (value / bound - 1):+.{1 if value < 1.1 * bound else 0}f} %",
        (value, height),
        xytext=(7, 0),
        textcoords="offset points",
        va="center",
        fontsize=SMALL,
        color=GREY,
    )
