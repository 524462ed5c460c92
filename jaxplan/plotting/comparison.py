"""Planners side by side, after the paper's Table 4: how often, how fast and how near the shortest."""

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxplan.given import expect_like, several
from jaxplan.plotting.canvas import Canvas, panels
from jaxplan.plotting.compared import Compared, is_printed
from jaxplan.plotting.comparison_panels import PANELS, entries
from jaxplan.plotting.style import GREY, TEXT, legend_beside, plain, tidy

_WIDTH, _LEAST = 12.5, 2.7  # inches: of the page, and at least its height, so that the legend has room
_ROW, _HEAD, _FOOT = 0.25, 0.45, 0.5  # inches that a planner, the title of a kind and the last axes take
_LEAST_SPAN = 4.0  # steps or nodes that an axis shows


def table4(rows: Iterable[Compared], ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Success rates, search times and path lengths of planners that searched the same scenes.

    Each kind of scenes has four panels with a planner a line: the shares of scenes where a path was found and
    where it is clear along whole edges; the times of all searches, logarithmic; and the lengths of the clear
    paths, in steps and in interior nodes. A dot is a scene. Rows that are only known from print span
    least to largest and stand last.

    Args:
        rows: what `jaxplan.table4.compare` returns, with `jaxplan.table4.printed_rows` where they are to be
            seen beside. Kinds and planners stand in the order in which they come first.
        ax: four axes a kind, from left to right; a figure to put them in, or None for a new one.
        legend: whether to explain the marks beside the panels.

    Returns:
        The axes, four a kind.

    Raises:
        TypeError: if they are no rows.
        ValueError: if there are no rows, or another number of axes is given.

    Example:
        >>> from jaxplan.table4 import compare, printed_rows
        >>> jp.plot.table4([*compare(["keep_out"], count=5), *printed_rows(["keep_out"])])
    """
    kinds = _by_kind(rows)
    if not kinds:
        raise ValueError("there are no rows to draw")
    across = len(PANELS)
    heights = [_HEAD + _ROW * len(of_kind) for of_kind in kinds]
    every = panels(ax, across * len(kinds), _size(kinds), columns=across, heights=heights)
    grid = [every[start : start + across] for start in range(0, len(every), across)]
    for line, of_kind in zip(grid, kinds, strict=True):
        for axes, draw in zip(line, PANELS, strict=True):
            tidy(axes)
            draw(axes, of_kind)
            _lines(axes, of_kind, named=axes is line[0])
        plain(line[0].set_title(_title(of_kind), fontsize=TEXT + 1, loc="left"))
    for column in zip(*grid, strict=True):
        _align(column)
    if legend:
        legend_beside(grid[0][-1], entries(row for of_kind in kinds for row in of_kind))
    return every


def comparison_figure(rows: Iterable[Compared]) -> Figure:
    """The same on a page of its own, which does not belong to pyplot.

    Args:
        rows: see `table4`.
    """
    every = list(rows)
    figure = Figure(figsize=_size(_by_kind(every)), layout="constrained")
    table4(every, ax=figure)
    return figure


def _by_kind(rows: Iterable[Compared]) -> list[list[Compared]]:
    """The rows of each kind, those from print last."""
    kinds: dict[str, list[Compared]] = {}
    for number, row in enumerate(several("rows", rows, "rows, as jaxplan.table4.compare returns")):
        expect_like(f"rows[{number}]", row, ("kind", "planner", "solved"), "a row of jaxplan.table4.compare")
        kinds.setdefault(row.kind, []).append(row)
    return [sorted(of_kind, key=is_printed) for of_kind in kinds.values()]


def _size(kinds: Sequence[Sequence[Compared]]) -> tuple[float, float]:
    """Width and height of the page, inches."""
    return _WIDTH, max(_FOOT + sum(_HEAD + _ROW * len(of_kind) for of_kind in kinds), _LEAST)


def _title(rows: Sequence[Compared]) -> str:
    """The kind, and how many scenes the rows are of."""
    own, printed = ([row.scenes for row in rows if is_printed(row) == of] for of in (False, True))
    told = [f"{_range(own)} scene{'s' * (set(own) != {1})}"] if own else []
    told += [f"{_range(printed)} as printed"] if printed else []
    return f"{rows[0].kind}: {', '.join(told)}"


def _range(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return f"{low}" if low == high else f"{low} to {high}"


def _lines(axes: Axes, rows: Sequence[Compared], *, named: bool) -> None:
    """A line a planner, from top to bottom, with its name to the left of the first panel."""
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_yticks(range(len(rows)), [row.planner for row in rows])
    axes.tick_params(axis="y", length=0, labelleft=named)
    for label, row in zip(axes.get_yticklabels() if named else (), rows, strict=named):
        plain(label).set_color(GREY if is_printed(row) else "black")


def _align(column: Sequence[Axes]) -> None:
    """The same scale for all kinds; where they share it, the lowest panel alone says what it is."""
    drawn = [axes for axes in column if axes.lines]
    spans = np.array([axes.dataLim.intervalx if _decades(axes) else axes.get_xlim() for axes in drawn])
    for axes in column:
        if drawn:
            axes.set_xlim(_rounded(np.min(spans), np.max(spans), decades=_decades(axes)))
        else:
            axes.set_xticks([])
        if axes is not column[-1] and axes.get_shared_x_axes().joined(axes, column[-1]):
            axes.set_xlabel("")


def _decades(axes: Axes) -> bool:
    return axes.get_xscale() == "log"


def _rounded(low: float, high: float, *, decades: bool) -> tuple[float, float]:
    """Limits between which there are at least two ticks: whole decades, or a few units."""
    if decades:
        return 0.9 * 10 ** np.floor(np.log10(low)), 1.1 * 10 ** np.ceil(np.log10(high))
    missing = max(_LEAST_SPAN - (high - low), 0.0)
    return low - missing / 2, high + missing / 2
