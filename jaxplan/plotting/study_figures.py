"""Studies side by side: success rates, outcomes, and distributions of time, length, duration and margin.

A study is a set of scenes with the plan of each; success means a certified plan. Curves count all scenes of a
study, also those without a plan: since these have no values, a curve ends at the success rate and continues
as a thin dotted line.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, LogLocator

from jaxplan.model.status import Status
from jaxplan.plotting.margin_panels import open_near_zero
from jaxplan.plotting.method_comparison import planner_colour
from jaxplan.plotting.style import (
    COLOURS,
    GREY,
    LINE_STYLES,
    SMALL,
    TEXT,
    WIDTH,
    Canvas,
    Entries,
    Look,
    legend_beside,
    name_lines,
    note,
    panels,
    plain,
    plain_numbers,
    tidy,
)
from jaxplan.runtime.arguments import expect_any, several
from jaxplan.study import Study

Studies: TypeAlias = Study | Iterable[Study] | Mapping[str, Study]
Named: TypeAlias = dict[str, Study]

OK = Status.OK.name
_SIZE = (WIDTH, 4.2)  # inches
_ROW_HEIGHT, _FRAME_HEIGHT = 0.4, 1.1  # inches: height of a study's line, and around the lines
_BAR_HEIGHT = 0.6  # lines: height of a bar
# Multiples of powers of ten at which ticks have numbers, for ratios of largest to least value below the key.
_TICK_MULTIPLES = {4.0: (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0), 50.0: (1.0, 2.0, 5.0), np.inf: (1.0,)}
_UNPLANNED_LINE: Look = {"linewidth": 0.9, "linestyle": ":"}
# Colours of statuses: blues where no planner could have found a plan, other colours where this one failed.
_OUTCOME_COLOURS = {
    Status.OK.name: "0.87",
    Status.INVALID_START.name: "#92C5DE",
    Status.INVALID_GOAL.name: "#4393C3",
    Status.GOAL_UNREACHABLE.name: "#2166AC",
    Status.NO_PATH.name: "#053061",
    Status.NODE_LIMIT.name: "#B2182B",
    Status.TIME_LIMIT.name: "#D6604D",
    Status.LIMITS_TOO_TIGHT.name: "#F4A582",
    Status.GOAL_MISSED.name: "#E08214",
    Status.INFEASIBLE.name: "#FDDBC7",
    Status.UNCERTIFIED.name: "#762A83",
    "crashed": "black",
}
_DISTRIBUTED_QUANTITIES = ("total_s", "length_steps", "duration_s", "min_margin_deg")
_CURVES_HEIGHT = 2.3  # inches: height of a row of distributions
_LOW_ROW_HEIGHT, _LOW_FRAME_HEIGHT = 0.26, 0.75  # inches: of a study's line above these, and around the lines


class Quantity(NamedTuple):
    """A quantity whose distribution is drawn as a curve.

    Attributes:
        label: of the axis, with its unit.
        decades: whether the axis is logarithmic.
        margin: whether larger values are better: then the curve counts scenes with at least a value, not at
            most, and the axis has the scale of margins, linear near zero.
    """

    label: str
    decades: bool = False
    margin: bool = False


QUANTITIES = {
    "total_s": Quantity("time to plan (s)", decades=True),
    "search_s": Quantity("search time (s)", decades=True),
    "expansions": Quantity("expansions", decades=True),
    "length_steps": Quantity("path length (steps)"),
    "interior_nodes": Quantity("path length (interior nodes)"),
    "duration_s": Quantity("duration (s)"),
    "slew_deg": Quantity("slew (deg)"),
    "peak": Quantity("largest share of a limit"),
    "min_margin_deg": Quantity("smallest margin, proved (deg)", margin=True),
}


def study(studies: Studies, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Draw success rates, outcomes, and the distributions of planning time, path length, duration and margin.

    Args:
        studies: one study, several, such as those of several planners, or a dict of them by names for the
            legend.
        ax: six axes, a figure to put them in, or None for a new one.
        legend: whether to name statuses and studies beside the panels.

    Returns:
        The axes, from left to right and from top to bottom.

    Raises:
        TypeError: if something other than studies is given.
        ValueError: if there is nothing to draw, or another number of axes is given.

    Example:
        >>> jp.plot.study([jp.run_study(range(50), planner=name) for name in ("mha", "rrt_connect")])
    """
    every = named(studies)
    heights = [_LOW_FRAME_HEIGHT + _LOW_ROW_HEIGHT * len(every), _CURVES_HEIGHT, _CURVES_HEIGHT]
    grid = panels(ax, 6, _figure_size(len(every)), columns=2, heights=heights, shared=False)
    success_rates(every, grid[0])
    outcomes(every, grid[1], legend=legend)
    grid[1].tick_params(axis="y", labelleft=False)
    for place, (quantity, axes) in enumerate(zip(_DISTRIBUTED_QUANTITIES, grid[2:], strict=True)):
        distribution(every, quantity, axes, legend=legend and place == 1)
    kinds = ", ".join(sorted({one.kind or "given scenarios" for one in every.values()}))
    counts = sorted({len(one.table) for one in every.values()})
    told = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    plain(grid[0].set_title(f"{kinds}: {told} scene{'s' * (counts != [1])}", loc="left", fontsize=10))
    return grid


def study_figure(studies: Studies) -> Figure:
    """Draw `study` in a new figure that does not belong to pyplot; `studies` are as there."""
    every = named(studies)
    figure = Figure(figsize=_figure_size(len(every)), layout="constrained")
    study(every, figure)
    return figure


def _figure_size(studies: int) -> tuple[float, float]:
    """Return width and height of the figure for a number of studies, inches."""
    return WIDTH, _LOW_FRAME_HEIGHT + _LOW_ROW_HEIGHT * studies + 2 * _CURVES_HEIGHT + 0.3


def success_rates(studies: Studies, ax: Canvas = None) -> Axes:
    """Draw percentages of scenes with a certified plan and 95 % Wilson intervals, one study per line.

    Args:
        studies: one, several, or a dict of them by names.
        ax: axes, a figure to put them in, or None for a new one.

    Returns:
        The axes.

    Raises:
        TypeError: if something other than studies is given.
        ValueError: if there is nothing to draw.
    """
    every = named(studies)
    (axes,) = panels(ax, 1, (_SIZE[0], _FRAME_HEIGHT + _ROW_HEIGHT * len(every)))
    name_lines(axes, list(every))
    axes.grid(False, axis="y")
    for line, (study, look) in enumerate(zip(every.values(), _looks(every), strict=True)):
        low, high = (100 * bound for bound in study.interval)
        axes.plot([low, high], [line, line], color=look["color"], linewidth=1.6, solid_capstyle="butt")
        axes.plot(
            [100 * study.planned / study.done],
            [line],
            color=look["color"],
            marker="o",
            clip_on=False,
            zorder=3,
        )
        end, aside, anchor = (low, -6, "right") if low > 25 else (high, 6, "left")
        place: Look = {"xytext": (aside, 0), "textcoords": "offset points", "ha": anchor, "va": "center"}
        axes.annotate(f"{study.planned}/{study.done}", (end, line), fontsize=SMALL, color=GREY, **place)
    axes.set(xlim=(-2, 102), xticks=range(0, 101, 25))
    axes.set_xlabel("success rate, 95 % interval (%)", fontsize=TEXT)
    return axes


def outcomes(studies: Studies, ax: Canvas = None, *, legend: bool = True) -> Axes:
    """Draw how the scenes ended, each status as a percentage of all scenes, one study per line.

    Args:
        studies: one, several, or a dict of them by names.
        ax: axes, a figure to put them in, or None for a new one.
        legend: whether to name the statuses beside the panel.

    Returns:
        The axes.

    Raises:
        TypeError: if something other than studies is given.
        ValueError: if there is nothing to draw.
    """
    every = named(studies)
    (axes,) = panels(ax, 1, (_SIZE[0], _FRAME_HEIGHT + _ROW_HEIGHT * len(every)))
    name_lines(axes, list(every))
    axes.grid(False)
    seen = set()
    for line, study in enumerate(every.values()):
        left, counts = 0.0, Counter(row["status"] for row in study.table)
        for name in (name for name in _OUTCOME_COLOURS if counts[name]):
            share = 100 * counts[name] / len(study.table)
            look: Look = {"color": _OUTCOME_COLOURS[name], "edgecolor": "white", "linewidth": 0.5}
            axes.barh(line, share, _BAR_HEIGHT, left=left, **look)
            left += share
            seen.add(name)
    axes.set(xlim=(0, 100), xticks=range(0, 101, 25))
    axes.set_xlabel("outcome (% of scenes)", fontsize=TEXT)
    if legend:
        legend_beside(
            axes, [(Patch(color=_OUTCOME_COLOURS[name]), name) for name in _OUTCOME_COLOURS if name in seen]
        )
    return axes


def distribution(
    studies: Studies, quantity: str = "duration_s", ax: Canvas = None, *, legend: bool = True
) -> Axes:
    """Draw the percentage of all scenes planned with at most each value (for margins at least each value).

    Args:
        studies: one, several, or a dict of them by names.
        quantity: a key of `QUANTITIES`.
        ax: axes, a figure to put them in, or None for a new one.
        legend: whether to name the studies beside the panel.

    Returns:
        The axes.

    Raises:
        TypeError: if something other than studies is given.
        ValueError: if there is nothing to draw, or no such quantity.

    Example:
        >>> jp.plot.distribution([mha, wastar], "total_s")
    """
    if quantity not in QUANTITIES:
        raise ValueError(f"quantity = {quantity!r}: must be one of {', '.join(QUANTITIES)}")
    every, what = named(studies), QUANTITIES[quantity]
    (axes,) = panels(ax, 1, _SIZE)
    tidy(axes)
    curves = [np.sort(study.values(quantity)) for study in every.values()]
    known = [values for values in curves if len(values)]
    if known:
        low, high = min(values[0] for values in known), max(values[-1] for values in known)
        if what.decades:
            _use_log_scale(axes, low, high)
        else:
            if what.margin:
                open_near_zero(axes, "x", low)
            axes.set_xlim(min(0.0, 1.05 * low), 1.05 * high if high > 0 else 1.0)
        for study, values, look in zip(every.values(), curves, _looks(every), strict=True):
            if len(values):
                _draw_curve(axes, values, len(study.table), look, what)
    else:
        note(axes, "no plans")
    axes.set_ylim(0, 104)
    axes.set_yticks(range(0, 101, 25))
    axes.set_xlabel(what.label, fontsize=TEXT)
    axes.set_ylabel(f"scenes with at {'least' if what.margin else 'most'} that (%)", fontsize=TEXT)
    if legend:
        entries: Entries = [
            (Line2D([], [], linewidth=1.8, **look), name)
            for name, look in zip(every, _looks(every), strict=True)
        ]
        failures = any(row["status"] != OK for study in every.values() for row in study.table)
        legend_beside(
            axes,
            entries + [(Line2D([], [], color=GREY, **_UNPLANNED_LINE), "no plan for\nthe others")] * failures,
        )
    return axes


def _draw_curve(axes: Axes, values: np.ndarray, scenes: int, look: Look, what: Quantity) -> None:
    """Draw the cumulative percentage of a study's scenes over a quantity as a step curve.

    Args:
        axes: the panel, with its horizontal limits set.
        values: (k,) of the scenes that have one, rising.
        scenes: number of all scenes; if there are more than values, a dotted line continues to the right
            edge, but not for margins.
        look: of the curve.
        what: the quantity.
    """
    left, right = axes.get_xlim()
    shares = 100 * np.arange(len(values) + 1) / scenes
    top = shares[-1]
    if what.margin:
        axes.step([left, *values, values[-1]], [top, *shares[::-1]], where="pre", linewidth=1.8, **look)
    else:
        axes.step([values[0], *values], shares, where="post", linewidth=1.8, **look)
        if len(values) < scenes:
            axes.plot([values[-1], right], [top, top], color=look["color"], **_UNPLANNED_LINE)


def _use_log_scale(axes: Axes, low: float, high: float) -> None:
    """Make the horizontal axis logarithmic from `low` to `high`, with at least two numbered ticks.

    If `low` is 0 the axis is linear up to 1.
    """
    if low > 0:
        axes.set_xscale("log")
        axes.set_xlim(0.8 * low, 1.4 * high)
        subs = next(subs for ratio, subs in _TICK_MULTIPLES.items() if high < ratio * low)
        axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=8))
    else:
        axes.set_xscale("symlog", linthresh=1)
        axes.set_xlim(0, 1.4 * max(high, 1.0))
        axes.xaxis.set_major_locator(FixedLocator([0, *(10.0 ** np.arange(10))]))
    plain_numbers(axes.xaxis)


def named(studies: Studies) -> Named:
    """Check studies and name them: by the keys of a dict, or by planner and what else differs between them.

    Raises:
        TypeError: if something other than studies is given.
        ValueError: if there are none, or one has no scenes yet.
    """
    if isinstance(studies, Mapping):
        places, every = [repr(name) for name in studies], list(studies.values())
    else:
        wanted = "studies, as jp.run_study returns, or one"
        every = [studies] if isinstance(studies, Study) else list(several("studies", studies, wanted))
        places = [str(place) for place in range(len(every))]
    for place, one in zip(places, every, strict=True):
        expect_any(f"studies[{place}]", one, (Study,), "a Study, as jp.run_study returns")
    result = dict(zip(studies if isinstance(studies, Mapping) else _unique_names(every), every, strict=True))
    if not result:
        raise ValueError("there are no studies to draw")
    for name, one in result.items():
        if not one.table:
            raise ValueError(f"study {name} has no scenes to draw yet")
    return result


def _unique_names(studies: Sequence[Study]) -> list[str]:
    """Return unique names of studies: planner, kind and settings if they differ, and perhaps a number."""
    kinds, settings = {study.kind for study in studies}, [dict(study.settings) for study in studies]
    names = []
    for study in studies:
        parts = [study.planner]
        if len(kinds) > 1:
            parts.append(study.kind or "scenarios")
        if any(other != settings[0] for other in settings):
            parts += [f"{name} = {value}" for name, value in study.settings.items()]
        names.append(", ".join(parts))
    often, seen = Counter(names), Counter[str]()
    for place, name in enumerate(names):
        if often[name] > 1:
            seen[name] += 1
            names[place] = f"{name} ({seen[name]})"
    return names


def _looks(studies: Named) -> list[Look]:
    """Return a look for each study; its colour is the planner's unless two studies have the same planner.

    Where curves coincide, solid lines lie below broken ones, through whose gaps they are seen.
    """
    planners = [study.planner for study in studies.values()]
    distinct = len(set(planners)) == len(planners)
    return [
        {
            "color": planner_colour(name) if distinct else COLOURS[place % len(COLOURS)],
            "linestyle": LINE_STYLES[place % len(LINE_STYLES)],
            "zorder": 2 + 0.1 * (place % len(LINE_STYLES)),
        }
        for place, name in enumerate(planners)
    ]
