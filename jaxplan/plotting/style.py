"""What all figures share: looks, legends, places of names, and where a figure is drawn.

A device has one colour and line style in all figures. The colours keep apart for the kinds of colour
blindness, above all those that share a line style, and the line styles keep apart in print without colour.
There are 11 colours and 4 styles; as these have no common divisor, 44 devices differ in one or the other, and
11 in the colour alone, which is all that dots and areas have.
Legends stand beside the data. Nothing here changes matplotlib's global settings.

A figure is drawn on given axes, in a given figure, or in a new one. A new one belongs to pyplot where pyplot
can show it: in a notebook it appears below its cell, with a window system after ``plt.show()``. Where nothing
can be shown (the backends that only write files) it is a plain figure, which nobody has to close; save it
with ``axes.figure.savefig(...)``.

All figures of a page's width are `WIDTH` wide, so that text in them is as large as that of the page.
A name stands at the first of some places where it covers no other name, and the fewest points of curves.

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
from jaxplan.runtime.colours import COLOURS as COLOURS
from jaxplan.runtime.colours import KEEP_IN as KEEP_IN
from jaxplan.runtime.colours import KEEP_OUT as KEEP_OUT
from jaxplan.timeline.record import TimelinePlan
from jaxplan.trajectory import Trajectory
from jaxplan.trajectory.curve import Samples

Look: TypeAlias = dict[str, Any]  # what matplotlib is told about a line, a mark or an area
Entry: TypeAlias = tuple[Artist, str]  # of a legend
Entries: TypeAlias = list[Entry]
Canvas: TypeAlias = Axes | Sequence[Axes] | np.ndarray | Figure | SubFigure | None
Box: TypeAlias = tuple[np.ndarray, np.ndarray]  # centre and size, (2,) each, in any unit

LINE_STYLES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (6, 1.5, 1, 1.5)), (0, (1.5, 1.2)))
AXIS_STYLES: tuple[Look, ...] = (  # of the body axes; no device has these colours
    {"color": "black", "linestyle": LINE_STYLES[0]},
    {"color": "#D55E00", "linestyle": LINE_STYLES[1]},
    {"color": "#009E73", "linestyle": LINE_STYLES[3]},
)
LENGTH_STYLE: Look = {"color": "#8C510A", "linestyle": LINE_STYLES[2]}  # of a vector, beside its components
GREY = "0.35"
WIDTH = 8.0
"""Inches of a figure's width. Pages show it at some 700 pixels, where `SMALL` is 8 points."""
TEXT, SMALL = 9.5, 8.8  # points
HALO: Look = {  # of a name at a place
    "ha": "center",
    "va": "center",
    "path_effects": [withStroke(linewidth=2.5, foreground="white")],
}
_BELOW = -0.24  # heights of axes below them where a legend begins, under the label of the axis
_LONGEST = 30  # letters of a line of a legend
_LEGEND_ROWS = 14  # entries in a column of a legend, beyond which it gets another column
INSTANTS = 1024  # times of the grid of a motion; the paper's manoeuvres have 14 to 50 nodes


def device_style(number: int) -> Look:
    """Colour and line style of a device, the same in every figure.

    Args:
        number: place among the spacecraft's devices.
    """
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": LINE_STYLES[number % len(LINE_STYLES)]}


def plain(text: Text) -> Text:
    """Have a text shown letter by letter, as a ``$`` in a name is no formula; returns the text."""
    text.set_parse_math(False)
    return text


def note(axes: Axes, text: str) -> None:
    """Write in an empty panel why it is empty."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=GREY)


def titled(axes: Axes, plan: Plan, words: str) -> None:
    """Write above a panel which plan it is of, and what one sees."""
    plain(axes.set_title(f"{plan.scenario.name}: {words}", fontsize=TEXT + 1, loc="left"))


def tidy(axes: Axes) -> None:
    """Give a panel a light grid and small tick labels, without frame above and to the right."""
    axes.grid(True, color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=TEXT)
    axes.spines[["top", "right"]].set_visible(False)


def name_lines(axes: Axes, names: Sequence[str], *, shown: bool = True) -> list[Text]:
    """Give a panel a line for each name at heights 0, 1, ... downward; returns the labels that are shown."""
    tidy(axes)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_yticks(range(len(names)), list(names))
    axes.tick_params(axis="y", length=0, labelleft=shown)
    return [plain(label) for label in axes.get_yticklabels()] if shown else []


def plain_numbers(axis: Axis) -> None:
    """Write the numbers of major ticks without powers, and none at minor ticks."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "\N{MINUS SIGN}")))
    axis.set_minor_formatter(NullFormatter())


def legend_beside(
    axes: Axes, entries: Sequence[Entry], *, columns: int | None = None, rows: int = _LEGEND_ROWS
) -> None:
    """Put a legend to the right of the axes, so that it covers no data.

    Args:
        axes: that it stands beside.
        entries: of the legend; long labels are broken, lest they take the width of the data.
        columns: of the legend; None for as many as are needed.
        rows: entries that a column may then have.
    """
    columns = -(-len(entries) // rows) if columns is None else columns
    _legend(axes, entries, {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "ncols": columns})


def legend_height(entries: Entries) -> float:
    """Inches that a legend of one column takes, about."""
    lines = [1 + label.count("\n") for _, label in entries]
    return SMALL / 72 * sum(1.0 + 1.2 * (count - 1) + 0.5 for count in lines)


def legend_below(axes: Axes, entries: Sequence[Entry]) -> None:
    """Put a legend below the axes and what is written there, where there is no room beside them."""
    _legend(axes, entries, {"loc": "upper left", "bbox_to_anchor": (-0.1, _BELOW)})


def legend_at_foot(axes: Axes, entries: Sequence[Entry], columns: int) -> None:
    """Put a legend of so many columns at the foot of the axes' figure, where it is that of many panels."""
    _legend(axes.figure, entries, {"loc": "outside lower center", "ncols": columns})


def _legend(axes: Axes | Figure | SubFigure, entries: Sequence[Entry], place: Look) -> None:
    """Give axes, or a figure, a legend at a place, if there is anything to tell."""
    if not entries:
        return
    labels = ["\n".join(map(_broken, label.split("\n"))) for _, label in entries]
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


def _broken(line: str) -> str:
    """A line of a label, broken between words where it is long."""
    indent = line[: len(line) - len(line.lstrip())]
    return line if len(line) <= _LONGEST else textwrap.fill(line, _LONGEST, subsequent_indent=f"{indent}  ")


def device_entries(names: Sequence[str]) -> Entries:
    """Legend entries of devices by their names, the first of which is device 0."""
    return [(Line2D([], [], linewidth=1.8, **device_style(i)), name) for i, name in enumerate(names)]


def new_figure(size: tuple[float, float]) -> Figure:
    """Make an empty figure that leaves room for legends beside its axes.

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
    """Make the axes of a figure's panels, or check given ones: row by row, each from left to right.

    Args:
        where: as many axes as panels, a figure to put them in, or None for a new one.
        count: of panels.
        size: of a new figure, inches.
        columns: panels a row.
        heights: of the rows, in proportion; equal if None.
        widths: of the columns likewise.
        shared: whether new panels share their horizontal axis with those above and below, and their vertical
            one with those of their row.
        alone: of the columns, so many last ones have a vertical axis of their own.

    Raises:
        TypeError: if something else than axes is given.
        ValueError: if another number of axes is given.
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
    """The labels of one panel, as they are placed one after the other.

    Attributes:
        points: (k, 2) of what is drawn, which labels should not cover.
        taken: boxes that no label may touch; those of the labels placed are added.
    """

    points: np.ndarray
    taken: list[Box] = field(default_factory=list)

    def place(self, places: Iterable[ArrayLike], size: ArrayLike, *, must: bool = False) -> np.ndarray | None:
        """Choose a place and take it.

        Args:
            places: centres that the label may have, the best first.
            size: width and height of the label.
            must: whether the label has to stand somewhere, be it upon another one.

        Returns:
            (2,) the centre; None if there is no room.
        """
        every, extent = [np.asarray(place, dtype=float) for place in places], np.asarray(size, dtype=float)
        free = [place for place in every if not any(_touch((place, extent), box) for box in self.taken)]
        candidates = free or (every if must else [])
        if not candidates:
            return None
        best = min(candidates, key=lambda place: self._covered(place, extent))  # of equals, the first
        self.taken.append((best, extent))
        return best

    def _covered(self, centre: np.ndarray, size: np.ndarray) -> int:
        """Number of drawn points that a label of a size (2,) at a centre (2,) would cover."""
        return int(np.sum(np.all(np.abs(self.points - centre) < size / 2, axis=-1)))


def _touch(one: Box, other: Box) -> bool:
    """Whether two boxes overlap."""
    return bool(np.all(np.abs(one[0] - other[0]) < (one[1] + other[1]) / 2))


def expect_plan(plan: object) -> Plan:
    """Return a plan of any status as figures take it, see `as_plan`; raise a TypeError for anything else."""
    if isinstance(plan, TimelinePlan):
        return as_plan(plan)
    advice = "jp.plan makes one, jp.load_plan reads one, jp.plan_timeline makes that of a timeline"
    return expect("plan", plan, Plan, advice)


def expect_trajectories(given: object, spacecraft: object) -> None:
    """Raise a TypeError unless these are trajectories by their names, and a spacecraft."""
    for name, trajectory in expect_mapping("trajectories", given).items():
        advice = "a plan has one as plan.trajectory"
        expect(f"trajectories[{name!r}]", trajectory, Trajectory, advice)
    expect("spacecraft", spacecraft, Spacecraft, "scenario.spacecraft is one")


def expect_mapping(name: str, value: object) -> Mapping[Any, Any]:
    """Return a mapping as it is; raise a TypeError that calls it `name` for anything else."""
    if isinstance(value, Mapping):
        return value
    raise TypeError(f"{name} must be a dict by names, not {type(value).__name__}")


def expect_view(view: object) -> None:
    """Raise a ValueError unless a view is two angles."""
    angles = as_floats(view)
    if angles is None or angles.shape != (2,):
        raise ValueError(f"view = {show(view)}: must be azimuth and elevation of the eye, deg, or None")


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A trajectory on a grid of times.

    Attributes:
        times: (k,) s; a single one if the manoeuvre takes no time.
        values: the trajectory there.
        boresights: (k, D, 3) inertial unit vectors of the D devices.
        node_times: (m + 1,) s, at which it passes the nodes of a path of m edges.
        day: whether it is that of a timeline, whose axis of time is that of `day_axis`.
        epoch: UTC of the start of a timeline; None where it is not known.
    """

    times: np.ndarray
    values: Samples
    boresights: np.ndarray
    node_times: np.ndarray
    day: bool = False
    epoch: np.datetime64 | None = None


def motion(plan: Plan | TimelinePlan) -> Motion:
    """Sample a plan's trajectory at `INSTANTS` equidistant times, a timeline's at the instants of its day.

    Raises:
        TypeError: if it is no plan.
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
    """Draw one curve; a manoeuvre that takes no time is a dot."""
    marker = "o" if len(times) == 1 else None
    axes.plot(times, values, **{"linewidth": 1.6, "marker": marker, "markersize": 5, **style})


def time_axis(grid: Sequence[Axes], moves: Motion) -> None:
    """Let panels, from top to bottom, show the time of a motion, s, as `time_span` or `day_axis` does."""
    if moves.day:
        for axes in grid:
            tidy(axes)
        day_axis(grid, float(moves.times[-1]), moves.epoch)
        return
    time_span(grid, float(moves.times[-1]), moves.node_times)


def time_span(grid: Sequence[Axes], end: float, node_times: ArrayLike = ()) -> None:
    """Let panels show the time from zero to an end, s, with minor ticks at nodes.

    The label stands under the lowest panel, and under those that do not share its axis.
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
