"""Planners compared: Table 4 as figures.

What the comparison of planners draws: the results of one planner, and how they look.

A planner has one colour in all panels, that of its place among the planners of step 2, whichever of them are
compared. Results that are only known from print are grey.

The panels of the comparison: success rates, search times and path lengths, a planner a line.

The first planner stands at height 0, the next at 1, downward. A panel draws the rows of one kind of scenes.

Planners side by side, after the paper's Table 4: how often, how fast and how near the shortest.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from jaxplan.plotting.style import (
    COLOURS,
    GREY,
    SMALL,
    TEXT,
    Canvas,
    Entries,
    Look,
    legend_beside,
    panels,
    plain,
    tidy,
)
from jaxplan.runtime.arguments import expect_like, several
from jaxplan.search import PLANNERS


class Compared(Protocol):
    """What one planner did on the scenes of one kind, such as a `jaxplan.study.table4.Row`.

    Attributes:
        kind: of the scenes.
        planner: its name.
        scenes: how many there were.
        found: in how many of them it found a path.
        clear: in how many of them the path is clear; None where nobody knows.
        solved: (scenes,) bool, in which of them that is so; None for printed results.
        seconds: (scenes,) of each search; of printed results (3,) least, largest, mean.
        nodes: (clear,) interior nodes of the clear paths; of printed results likewise.
        steps: (clear,) their lengths in steps; None for printed results.
    """

    @property
    def kind(self) -> str: ...  # noqa: D102

    @property
    def planner(self) -> str: ...  # noqa: D102

    @property
    def scenes(self) -> int: ...  # noqa: D102

    @property
    def found(self) -> int: ...  # noqa: D102

    @property
    def clear(self) -> int | None: ...  # noqa: D102

    @property
    def solved(self) -> np.ndarray | None: ...  # noqa: D102

    @property
    def seconds(self) -> np.ndarray: ...  # noqa: D102

    @property
    def nodes(self) -> np.ndarray: ...  # noqa: D102

    @property
    def steps(self) -> np.ndarray | None: ...  # noqa: D102

    def interval(self, successes: int) -> tuple[float, float]:
        """Bounds of a success rate in these scenes."""


def is_printed(row: Compared) -> bool:
    """Whether a row is only known from print: spreads instead of a value for each scene."""
    return row.solved is None


def colour(row: Compared) -> str:
    """Of a row in all panels."""
    return planner_colour(row.planner)


def planner_colour(name: str) -> str:
    """Of a planner in all figures; grey for one that is not ours."""
    names = tuple(PLANNERS)
    return COLOURS[names.index(name) % len(COLOURS)] if name in names else GREY


_CLEAR: Look = {"marker": "o", "markersize": 5.5, "linestyle": "none"}
_FOUND: Look = {"marker": "D", "markersize": 5, "linestyle": "none", "markerfacecolor": "white"}
_INTERVAL: Look = {"linewidth": 1.4, "solid_capstyle": "butt"}
_MEAN: Look = {
    "marker": "|",
    "markersize": 15,
    "markeredgewidth": 1.8,
    "linestyle": "none",
    "color": "black",
    "zorder": 4,
}
_SPREAD: Look = {"linewidth": 1.4, "marker": "|", "markersize": 6, "color": GREY}
_DOT: Look = {"marker": "o", "linestyle": "none", "markeredgewidth": 0.8}
_LARGE, _SMALL_DOT, _FEW = 4.2, 1.6, 10  # points: a dot where there are few scenes, and at least
_APART = 0.17  # of a line, the rates of paths found and paths clear
_BAND = 0.62  # of a line, the height over which dots are spread


def success(axes: Axes, rows: Sequence[Compared]) -> None:
    """Shares of the scenes where a path was found and where it is clear, percent."""
    for line, row in enumerate(rows):
        if row.scenes == 0:
            _remark(axes, line, "no scenes")
            continue
        pairs = [(row.found, _FOUND, -_APART), (row.clear, _CLEAR, _APART)]
        if row.clear is None:
            pairs = [(row.found, _FOUND, 0.0)]
        for count, look, offset in pairs:
            assert count is not None
            bounds = 100 * np.array(row.interval(count))
            height = line + offset
            axes.plot(bounds, [height, height], color=colour(row), **_INTERVAL)
            axes.plot(
                [100 * count / row.scenes], [height], color=colour(row), clip_on=False, zorder=3, **look
            )
    axes.set(xlim=(-2, 102), xticks=range(0, 101, 25))
    axes.set_xlabel("success rate (%)", fontsize=TEXT)


def times(axes: Axes, rows: Sequence[Compared]) -> None:
    """Times of all searches, s; hollow where one ended without a clear path."""
    axes.set_xscale("log")
    for line, row in enumerate(rows):
        _values(axes, line, row, row.seconds, row.solved)
    axes.xaxis.set_major_locator(LogLocator(numticks=6))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("search time (s)", fontsize=TEXT)


def steps(axes: Axes, rows: Sequence[Compared]) -> None:
    """Lengths of the clear paths in steps."""
    for line, row in enumerate(rows):
        if row.steps is None:
            _remark(axes, line, "not printed")
        else:
            _values(axes, line, row, row.steps)
    axes.set_xlabel("path length (steps)", fontsize=TEXT)


def nodes(axes: Axes, rows: Sequence[Compared]) -> None:
    """Lengths of the clear paths in interior nodes."""
    for line, row in enumerate(rows):
        _values(axes, line, row, row.nodes)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
    axes.set_xlabel("path length (interior nodes)", fontsize=TEXT)


PANELS: tuple[Callable[[Axes, Sequence[Compared]], None], ...] = (success, times, steps, nodes)


def _values(
    axes: Axes, line: int, row: Compared, values: np.ndarray, solved: np.ndarray | None = None
) -> None:
    """A dot a scene and the mean, or the printed spread."""
    if is_printed(row):
        least, largest, mean = values
        axes.plot([least, largest], [line, line], **_SPREAD)
        axes.plot([mean], [line], **_MEAN)
        return
    if not len(values):
        _remark(axes, line, "no clear path" if row.scenes else "no scenes")
        return
    filled = np.ones(len(values), dtype=bool) if solved is None else solved
    heights = line + _BAND * ((0.5 + np.arange(len(values)) * 0.618034) % 1 - 0.5)
    dot = {**_DOT, "markersize": float(np.clip(_LARGE * (_FEW / row.scenes) ** 0.4, _SMALL_DOT, _LARGE))}
    for chosen, face in ((filled, colour(row)), (~filled, "white")):
        if np.any(chosen):
            axes.plot(values[chosen], heights[chosen], color=colour(row), markerfacecolor=face, **dot)
    axes.plot([np.mean(values)], [line], **_MEAN)


def _remark(axes: Axes, line: int, text: str) -> None:
    """Say on a line why nothing is drawn there."""
    place = axes.get_yaxis_transform()
    axes.text(0.02, line, text, transform=place, ha="left", va="center", color=GREY, fontsize=SMALL)


def entries(rows: Iterable[Compared]) -> Entries:
    """Legend entries of what the panels of these rows show."""
    every = list(rows)
    drawn = [row for row in every if row.scenes]
    own = [row for row in drawn if not is_printed(row)]

    def mark(look: Look, **more: object) -> Line2D:
        return Line2D([], [], **{"color": GREY, **look, **more})

    possible: list[tuple[bool, Line2D, str]] = [
        (bool(drawn), mark(_FOUND), "path found"),
        (bool(own), mark(_CLEAR), "path clear\nalong whole edges"),
        (bool(drawn), mark(_INTERVAL), "95 % interval\n(Wilson)"),
        (bool(own), mark(_DOT, markersize=_LARGE), "a scene"),
        (
            any(not np.all(row.solved) for row in own if row.solved is not None),
            mark(_DOT, markersize=_LARGE, markerfacecolor="white"),
            "a scene without\nclear path",
        ),
        (bool(drawn), mark(_MEAN, markersize=9), "mean"),
        (any(map(is_printed, every)), mark(_SPREAD), "as printed:\nleast to largest"),
    ]
    return [(handle, text) for there, handle, text in possible if there]


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
        rows: what `jaxplan.study.table4.compare` returns, with `printed_rows` of the same module where they
            are to be seen beside. Kinds and planners stand in the order in which they come first.
        ax: four axes a kind, from left to right; a figure to put them in, or None for a new one.
        legend: whether to explain the marks beside the panels.

    Returns:
        The axes, four a kind.

    Raises:
        TypeError: if they are no rows.
        ValueError: if there are no rows, or another number of axes is given.

    Example:
        >>> from jaxplan.study.table4 import compare, printed_rows
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
    for number, row in enumerate(several("rows", rows, "rows, as jaxplan.study.table4.compare returns")):
        expect_like(
            f"rows[{number}]", row, ("kind", "planner", "solved"), "a row of jaxplan.study.table4.compare"
        )
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
