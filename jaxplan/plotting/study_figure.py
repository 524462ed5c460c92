"""Studies side by side: success, outcomes, and how time, length, duration and margin are spread."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from jaxplan.plotting.canvas import Canvas, new_figure, panels
from jaxplan.plotting.studied import Studies, named
from jaxplan.plotting.study_panels import distribution, outcomes, success_rates
from jaxplan.plotting.style import plain

_SPREADS = ("total_s", "length_steps", "duration_s", "min_margin_deg")
_ROWS, _COLUMNS = 3, 2
_CURVES = 2.6  # inches: of a row of curves
_LINE, _AROUND = 0.26, 0.75  # inches: of a study's line, and of what is around the lines


def study(studies: Studies, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Success rates, outcomes, and the spreads of planning time, path length, duration and margin.

    Args:
        studies: one, several such as of several planners, or several by their names.
        ax: six axes, a figure to put them in, or None for a new one.
        legend: whether to name statuses and studies beside the panels.

    Returns:
        The axes, from left to right and from top to bottom.

    Raises:
        TypeError: if something else than studies is given.
        ValueError: if there is nothing to draw, or another number of axes is given.

    Example:
        >>> jp.plot.study([jp.run_study(range(50), planner=name) for name in ("mha", "rrt_connect")])
    """
    every = named(studies)
    if ax is None:
        ax = new_figure(_size(len(every)))
    if isinstance(ax, Figure | SubFigure):
        heights = [_AROUND + _LINE * len(every), _CURVES, _CURVES]
        ax = ax.subplots(_ROWS, _COLUMNS, gridspec_kw={"height_ratios": heights})
    grid = panels(ax, _ROWS * _COLUMNS, _size(len(every)))
    success_rates(every, grid[0])
    outcomes(every, grid[1], legend=legend)
    grid[1].tick_params(axis="y", labelleft=False)
    for place, (quantity, axes) in enumerate(zip(_SPREADS, grid[2:], strict=True)):
        distribution(every, quantity, axes, legend=legend and place == 1)
    kinds = ", ".join(sorted({one.kind or "given scenarios" for one in every.values()}))
    counts = sorted({len(one.table) for one in every.values()})
    told = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    plain(grid[0].set_title(f"{kinds}: {told} scene{'s' * (counts != [1])}", loc="left", fontsize=10))
    return grid


def study_figure(studies: Studies) -> Figure:
    """The same on a page of its own, which does not belong to pyplot.

    Args:
        studies: see `study`.
    """
    every = named(studies)
    figure = Figure(figsize=_size(len(every)), layout="constrained")
    study(every, figure)
    return figure


def _size(studies: int) -> tuple[float, float]:
    """Width and height of the page, inches."""
    return 11.0, _AROUND + _LINE * studies + 2 * _CURVES + 0.3
