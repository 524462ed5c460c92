"""The panels of the comparison: success rates, search times and path lengths, a planner a line.

The first planner stands at height 0, the next at 1, downward. A panel draws the rows of one kind of scenes.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from jaxplan.plotting.compared import Compared, colour, is_printed
from jaxplan.plotting.style import GREY, SMALL, TEXT, Entries, Look

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
