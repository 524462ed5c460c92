"""Helpers that all figures share: styles, legends, placement of names, and the axes to draw on.

A *look* is a dict of matplotlib's keyword arguments that style a line, a mark or an area. An *entry* of a
legend is a pair of a sample artist and its label. A *canvas* is what a user passes as ``ax``.

A device has one colour and line style in all figures, chosen by its number. The colours can be told apart
with the common kinds of colour blindness, above all those that share a line style; the line styles can be
told apart in print without colour. There are 11 colours and 4 styles, which have no common divisor, so 44
devices differ in one or the other; dots and areas have only the 11 colours.
Legends stand beside the data. Nothing here changes matplotlib's global settings.

A figure is drawn on given axes, in a given figure, or in a new one. A new one belongs to pyplot where pyplot
can show it: in a notebook it appears below its cell, with a window system after ``plt.show()``. Where nothing
can be shown (the backends that only write files) it is a plain figure, which nobody has to close; save it
with ``axes.figure.savefig(...)``.

All figures of a page's width are `WIDTH` wide, so that their text is as large as that of the page. A name is
put at the candidate place where it covers no other name and the fewest points of curves (`Labels`).

Arguments that cannot be drawn raise an error that names them.
"""

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, TypeAlias

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.registry import BackendFilter, backend_registry
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import ArrayLike

from jaxplan.model.spacecraft import Spacecraft
from jaxplan.planner import Plan
from jaxplan.plotting.day import DayPlan, as_plan
from jaxplan.plotting.time_axis import EndLocator, day_axis, mark_nodes, seconds
from jaxplan.runtime.arguments import as_floats, expect, show
from jaxplan.runtime.display import COLOURS as COLOURS
from jaxplan.runtime.display import KEEP_IN as KEEP_IN
from jaxplan.runtime.display import KEEP_OUT as KEEP_OUT
from jaxplan.timeline.record import TimelinePlan
from jaxplan.trajectory import Trajectory
from jaxplan.trajectory.curve import Samples

Look: TypeAlias = dict[str, Any]  # keyword arguments of matplotlib that style a line, a mark or an area
Entry: TypeAlias = tuple[Artist, str]  # of a legend: a sample of the line or mark, and its label
Entries: TypeAlias = list[Entry]
Canvas: TypeAlias = Axes | Sequence[Axes] | np.ndarray | Figure | SubFigure | None
Box: TypeAlias = tuple[np.ndarray, np.ndarray]  # centre (2,) and full size (2,), in the unit of the points

LINE_STYLES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (6, 1.5, 1, 1.5)), (0, (1.5, 1.2)))
AXIS_STYLES: tuple[Look, ...] = (  # of the body axes; no device has these colours
    {"color": "black", "linestyle": LINE_STYLES[0]},
    {"color": "#D55E00", "linestyle": LINE_STYLES[1]},
    {"color": "#009E73", "linestyle": LINE_STYLES[3]},
)
LENGTH_STYLE: Look = {"color": "#8C510A", "linestyle": LINE_STYLES[2]}  # of a vector's norm beside components
GREY = "0.35"
WIDTH = 8.0
"""Inches of a figure's width. Pages show it at some 700 pixels, where `SMALL` is 8 points."""
TEXT, SMALL = 9.5, 8.8  # points
HALO: Look = {  # of a name inside a picture: centred, with a white outline
    "ha": "center",
    "va": "center",
    "path_effects": [withStroke(linewidth=2.5, foreground="white")],
}
_LEGEND_TOP = -0.24  # top of a legend below axes, in heights of the axes: under the label of the time axis
_MAX_LINE_LETTERS = 30  # letters in a line of a legend, beyond which it is broken
_LEGEND_ROWS = 14  # entries in a column of a legend, beyond which it gets another column
INSTANTS = 1024  # times at which a manoeuvre is sampled; the paper's manoeuvres have 14 to 50 nodes


def device_style(number: int) -> Look:
    """Return the colour and line style of a device, the same in every figure.

    Args:
        number: index of the device among those of the spacecraft; styles repeat after 44.
    """
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": LINE_STYLES[number % len(LINE_STYLES)]}


def plain(text: Text) -> Text:
    """Show a text literally, so that a ``$`` in a name starts no formula; returns the same text."""
    text.set_parse_math(False)
    return text


def note(axes: Axes, text: str) -> None:
    """Write in the middle of an empty panel why it is empty."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=GREY)


def titled(axes: Axes, plan: Plan, words: str) -> None:
    """Set the title of a panel to the name of the plan's scenario and `words`, which say what is drawn."""
    plain(axes.set_title(f"{plan.scenario.name}: {words}", fontsize=TEXT + 1, loc="left"))


def tidy(axes: Axes) -> None:
    """Give a panel a light grid and small tick labels, and remove its frame above and to the right."""
    axes.grid(True, color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=TEXT)
    axes.spines[["top", "right"]].set_visible(False)


def name_lines(axes: Axes, names: Sequence[str], *, shown: bool = True) -> list[Text]:
    """Prepare a panel with one horizontal line for each name: the first at height 0, the next at 1 below it.

    Args:
        axes: the panel; its vertical axis points downward afterwards.
        names: of the lines, written as tick labels.
        shown: whether the names are written.

    Returns:
        The tick labels with the names; none if they are not shown.
    """
    tidy(axes)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_yticks(range(len(names)), list(names))
    axes.tick_params(axis="y", length=0, labelleft=shown)
    return [plain(label) for label in axes.get_yticklabels()] if shown else []


def plain_numbers(axis: Axis) -> None:
    """Write the numbers at major ticks without powers of ten, and no numbers at minor ticks."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "\N{MINUS SIGN}")))
    axis.set_minor_formatter(NullFormatter())


def legend_beside(
    axes: Axes, entries: Sequence[Entry], *, columns: int | None = None, rows: int = _LEGEND_ROWS
) -> None:
    """Put a legend to the right of the axes, so that it covers no data.

    Args:
        axes: beside which the legend stands.
        entries: of the legend; long labels are broken into lines, or they would take width from the data.
        columns: number of columns; None for as many as `rows` demands.
        rows: most entries in a column, used where `columns` is None.
    """
    columns = -(-len(entries) // rows) if columns is None else columns
    _add_legend(axes, entries, {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "ncols": columns})


def legend_height(entries: Entries) -> float:
    """Estimate the height in inches of a legend of one column."""
    lines = [1 + label.count("\n") for _, label in entries]
    return SMALL / 72 * sum(1.0 + 1.2 * (count - 1) + 0.5 for count in lines)


def legend_below(axes: Axes, entries: Sequence[Entry]) -> None:
    """Put a legend below the axes and their labels, for figures without room beside the axes."""
    _add_legend(axes, entries, {"loc": "upper left", "bbox_to_anchor": (-0.1, _LEGEND_TOP)})


def legend_at_foot(axes: Axes, entries: Sequence[Entry], columns: int) -> None:
    """Put one legend of `columns` columns at the foot of the whole figure that the axes are in."""
    _add_legend(axes.figure, entries, {"loc": "outside lower center", "ncols": columns})


def _add_legend(axes: Axes | Figure | SubFigure, entries: Sequence[Entry], place: Look) -> None:
    """Add a legend to axes or a figure at a place (matplotlib's arguments); without entries do nothing."""
    if not entries:
        return
    texts = [str(label) for _, label in entries]  # a user may have called motions by numbers
    labels = ["\n".join(map(_break_line, text.split("\n"))) for text in texts]
    # a label that begins with an underscore would be left out
    labels = [f"\N{ZERO WIDTH SPACE}{label}" if label.startswith("_") else label for label in labels]
    legend = axes.legend(
        [handle for handle, _ in entries],
        labels,
        borderaxespad=0.0,
        frameon=False,
        fontsize=SMALL,
        handlelength=3.2,
        **place,
    )
    for text in legend.get_texts():
        plain(text)


def _break_line(line: str) -> str:
    """Break a label's line between words where it exceeds `_MAX_LINE_LETTERS`, and indent what follows."""
    indent = line[: len(line) - len(line.lstrip())]
    return (
        line
        if len(line) <= _MAX_LINE_LETTERS
        else textwrap.fill(line, _MAX_LINE_LETTERS, subsequent_indent=f"{indent}  ")
    )


def device_entries(names: Sequence[str]) -> Entries:
    """Return legend entries for devices with the given names; the first name is that of device 0."""
    return [(Line2D([], [], linewidth=1.8, **device_style(i)), name) for i, name in enumerate(names)]


def new_figure(size: tuple[float, float]) -> Figure:
    """Make an empty figure whose layout leaves room for legends beside its axes.

    It belongs to pyplot unless matplotlib's backend can only write files.

    Args:
        size: width and height in inches.
    """
    if mpl.get_backend().lower() in backend_registry.list_builtin(BackendFilter.NON_INTERACTIVE):
        return Figure(figsize=size, layout="constrained")
    from matplotlib import pyplot

    return pyplot.figure(figsize=size, layout="constrained")


def panels(
    where: Canvas,
    count: int,
    size: tuple[float, float],
    *,
    columns: int = 1,
    heights: Sequence[float] | None = None,
    widths: Sequence[float] | None = None,
    shared: bool = True,
    alone: int = 0,
) -> list[Axes]:
    """Make the axes of a figure's panels or check given ones, ordered row by row from left to right.

    Args:
        where: as many axes as panels, a figure to put them in, or None for a new figure.
        count: number of panels.
        size: width and height of a new figure, inches.
        columns: number of panels in a row.
        heights: relative heights of the rows; None for equal ones.
        widths: relative widths of the columns; None for equal ones.
        shared: whether new panels share the horizontal axis within a column and the vertical axis within a
            row. Panels that share a vertical axis have its numbers in the first column alone.
        alone: number of columns, counted from the right, that keep vertical axes of their own.

    Returns:
        The axes of the panels.

    Raises:
        TypeError: if something other than axes is given.
        ValueError: if the number of given axes is wrong.
    """
    if where is None:
        where = new_figure(size)
    if isinstance(where, Figure | SubFigure):
        apart = 0.04 if shared and columns > 1 else None
        spread = {"height_ratios": heights, "width_ratios": widths, "wspace": apart}
        share: Literal["col", "none"] = "col" if shared else "none"
        grid = where.subplots(count // columns, columns, sharex=share, squeeze=False, gridspec_kw=spread)
        for first, *others in grid if shared else ():
            for axes in others[: columns - 1 - alone]:
                axes.sharey(first)
                axes.tick_params(axis="y", labelleft=False)
        return list(grid.ravel())
    given: list[Axes] = list(np.ravel(np.asarray(where, dtype=object)))
    for one in given:
        expect("ax", one, Axes, "give axes, as many as panels, or a figure to put them in")
    if len(given) != count:
        raise ValueError(
            f"the figure has {count} panel{'s' * (count != 1)}, but {len(given)} axes were given"
        )
    return given


@dataclass(frozen=True)
class Labels:
    """Chooses places for the labels of one panel, one after the other, so that they do not overlap.

    Attributes:
        points: (k, 2) what is drawn, which labels should not cover, in any one unit for both coordinates.
        taken: boxes that no label may touch, in the same unit; each label placed is added to them.
    """

    points: np.ndarray
    taken: list[Box] = field(default_factory=list)

    def place(self, places: Iterable[ArrayLike], size: ArrayLike, *, must: bool = False) -> np.ndarray | None:
        """Choose a place for a label and add its box to `taken`.

        Of the candidates that touch no taken box, the one that covers the fewest points is chosen; among
        equals the first.

        Args:
            places: candidates for the centre of the label, (2,) each, the best first.
            size: width and height of the label.
            must: whether the label has to stand somewhere, even if it overlaps another one.

        Returns:
            (2,) the centre; None if every candidate touches a taken box and `must` is False, or there are no
            candidates.
        """
        every, extent = [np.asarray(place, dtype=float) for place in places], np.asarray(size, dtype=float)
        free = [
            place for place in every if not any(_boxes_overlap((place, extent), box) for box in self.taken)
        ]
        candidates = free or (every if must else [])
        if not candidates:
            return None
        best = min(candidates, key=lambda place: self._count_covered(place, extent))  # of equals, the first
        self.taken.append((best, extent))
        return best

    def _count_covered(self, centre: np.ndarray, size: np.ndarray) -> int:
        """Count the drawn points that a label of size (2,) with its centre at (2,) would cover."""
        return int(np.sum(np.all(np.abs(self.points - centre) < size / 2, axis=-1)))


def _boxes_overlap(one: Box, other: Box) -> bool:
    """Tell whether two boxes overlap."""
    return bool(np.all(np.abs(one[0] - other[0]) < (one[1] + other[1]) / 2))


def expect_plan(plan: object) -> Plan:
    """Return a plan of any status unchanged, but that of a timeline as a `DayPlan` (see `as_plan`).

    Raises a TypeError for anything else.
    """
    if isinstance(plan, TimelinePlan):
        return as_plan(plan)
    advice = "jp.plan makes one, jp.load_plan reads one, jp.plan_timeline makes that of a timeline"
    return expect("plan", plan, Plan, advice)


def expect_trajectories(given: object, spacecraft: object) -> None:
    """Raise a TypeError unless `given` maps names to trajectories and `spacecraft` is a spacecraft."""
    for name, trajectory in expect_mapping("trajectories", given).items():
        advice = "a plan has one as plan.trajectory"
        expect(f"trajectories[{name!r}]", trajectory, Trajectory, advice)
    expect("spacecraft", spacecraft, Spacecraft, "scenario.spacecraft is one")


def expect_mapping(name: str, value: object) -> Mapping[Any, Any]:
    """Return a mapping unchanged; for anything else raise a TypeError that calls the argument `name`."""
    if isinstance(value, Mapping):
        return value
    raise TypeError(f"{name} must be a dict by names, not {type(value).__name__}")


def expect_view(view: object) -> None:
    """Raise a ValueError unless a view is a pair of numbers, azimuth and elevation of the eye."""
    angles = as_floats(view)
    if angles is None or angles.shape != (2,):
        raise ValueError(f"view = {show(view)}: must be azimuth and elevation of the eye, deg, or None")


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A trajectory sampled on a grid of times, as figures draw it.

    Attributes:
        times: (k,) s from the start, rising; a single one if the manoeuvre takes no time.
        values: attitude, joints and their derivatives at these times.
        boresights: (k, D, 3) inertial unit vectors of the boresights of the D devices.
        node_times: (m + 1,) s, at which the nodes of a path of m edges are passed.
        day: whether it is the motion of a timeline, whose time axis is drawn by `day_axis`.
        epoch: UTC of the start of a timeline; None where it is not known, and for single manoeuvres.
    """

    times: np.ndarray
    values: Samples
    boresights: np.ndarray
    node_times: np.ndarray
    day: bool = False
    epoch: np.datetime64 | None = None


def motion(plan: Plan | TimelinePlan) -> Motion:
    """Sample the trajectory of a plan for drawing.

    A manoeuvre is sampled at `INSTANTS` equidistant times, the plan of a timeline at `DayPlan.instants`.

    Raises:
        TypeError: if the argument is no plan.
        ValueError: if the plan has no trajectory.
    """
    plan = expect_plan(plan)
    trajectory, day = plan.trajectory, isinstance(plan, DayPlan)
    if trajectory is None:
        ending = ": ".join(filter(None, [plan.status.name, plan.message]))
        raise ValueError(
            f"the plan of {plan.scenario.name!r} has no trajectory to draw; it ended as {ending}"
        )
    times = np.linspace(0.0, trajectory.duration, INSTANTS if trajectory.duration > 0 else 1)
    if isinstance(plan, DayPlan):
        times = plan.instants
    values = trajectory.sample(times)
    return Motion(
        times=times,
        values=values,
        boresights=plan.scenario.spacecraft.boresights(values.attitude, values.joints),
        node_times=np.asarray(trajectory.node_times),
        day=day,
        epoch=plan.scenario.epoch if day else None,
    )


def curve(axes: Axes, times: np.ndarray, values: np.ndarray, **style: Any) -> None:
    """Draw values (k,) over times (k,) as a curve; a manoeuvre that takes no time is a dot.

    `style` are keyword arguments of matplotlib.
    """
    marker = "o" if len(times) == 1 else None
    axes.plot(times, values, **{"linewidth": 1.6, "marker": marker, "markersize": 5, **style})


def time_axis(grid: Sequence[Axes], moves: Motion) -> None:
    """Give panels, ordered from top to bottom, the time axis of a motion.

    It is that of `day_axis` for a timeline, with hours and minutes, and else that of `time_span`, with
    seconds.
    """
    if moves.day:
        for axes in grid:
            tidy(axes)
        day_axis(grid, float(moves.times[-1]), moves.epoch)
        return
    time_span(grid, float(moves.times[-1]), moves.node_times)


def time_span(grid: Sequence[Axes], end: float, node_times: ArrayLike = ()) -> None:
    """Give panels a time axis from zero to `end`, s, with marks at the nodes of a path.

    The label stands under the lowest panel, and under those that do not share its axis.

    Args:
        grid: the panels, from top to bottom.
        end: s; if it is zero the axis shows time zero in its middle.
        node_times: s, at which nodes are passed; none by default.
    """
    lowest = grid[-1]
    for axes in grid:
        tidy(axes)
        mark_nodes(axes, np.asarray(node_times))
        if end > 0:
            axes.set_xlim(0, end)
            axes.xaxis.set_major_locator(EndLocator(end))
            axes.xaxis.set_major_formatter(FuncFormatter(partial(seconds, end)))
        else:
            axes.set(xlim=(-1, 1), xticks=[0])
        shared = axes is not lowest and axes.get_shared_x_axes().joined(axes, lowest)
        axes.set_xlabel("" if shared else "time (s)", fontsize=TEXT)
