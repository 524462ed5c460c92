"""How long several methods take for the same goals, beside the strict bound that none can beat."""

from collections.abc import Mapping
from itertools import cycle, islice

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxplan.plotting.canvas import Canvas, panels
from jaxplan.plotting.given import expect_mapping
from jaxplan.plotting.style import COLOURS, GREY, SMALL, TEXT, Entries, Look, legend_beside, plain, tidy

_MARKERS = ("o", "s", "D", "^", "v", "P", "X")
_HEIGHT, _ROW = 1.0, 0.26  # inches: of what is around the panel, and of a method of a scene
_GAP = 0.6  # between scenes, in rows
_AREA: Look = {"color": "0.93", "linewidth": 0}
_BOUND: Look = {"color": "black", "linewidth": 1.6}


def durations(
    seconds: Mapping[str, Mapping[str, float]],
    bounds: Mapping[str, float],
    ax: Canvas = None,
    *,
    legend: bool = True,
) -> Axes:
    """Durations of several methods for each scene, with their excess over the bound in percent.

    Args:
        seconds: of each method, by the names of scenes; a scene without a value has no mark.
        bounds: s, no motion to the same goal is shorter, by the names of scenes
            (`jaxplan.trajectory.duration_bound`); another goal that meets the same targets may be met sooner.
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
    pitch = len(seconds) + _GAP
    (axes,) = panels(ax, 1, (9.0, _HEIGHT + _ROW * pitch * len(bounds)))
    tidy(axes)
    axes.grid(False, axis="y")
    longest = max(bounds.values())
    for number, (scene, bound) in enumerate(bounds.items()):
        top = number * pitch
        low, high = top - 0.5, top + len(seconds) - 0.5
        axes.fill_between([0, bound], low, high, **_AREA, zorder=0.5)
        axes.plot([bound, bound], [low, high], **_BOUND)
        for line, (of_method, look) in enumerate(zip(seconds.values(), looks(len(seconds)), strict=True)):
            if scene in of_method:
                value = float(of_method[scene])
                longest = max(longest, value)
                axes.plot([bound, value], [top + line] * 2, color=look["color"], linewidth=1, alpha=0.6)
                axes.plot([value], [top + line], **look)
                axes.annotate(
                    f"{100 * (value / bound - 1):+.{1 if value < 1.1 * bound else 0}f} %",
                    (value, top + line),
                    xytext=(7, 0),
                    textcoords="offset points",
                    va="center",
                    fontsize=SMALL,
                    color=GREY,
                )
    centres = np.arange(len(bounds)) * pitch + (len(seconds) - 1) / 2
    axes.set_yticks(centres, list(bounds))
    for label in axes.get_yticklabels():
        plain(label)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(bounds) * pitch - _GAP - 0.2, -0.8)
    axes.set_xlim(0, 1.1 * longest)
    axes.set_xlabel("duration (s)", fontsize=TEXT)
    if legend:
        entries: Entries = [
            (Line2D([], [], **look), name) for name, look in zip(seconds, looks(len(seconds)), strict=True)
        ]
        bound_line = (Line2D([], [], **_BOUND), "strict bound\nfor the goal")
        legend_beside(axes, [*entries, bound_line, (Patch(**_AREA), "impossible")])
    return axes


def looks(count: int) -> list[Look]:
    """Marks of so many methods."""
    return [
        {"color": colour, "marker": marker, "markersize": 6, "linestyle": "none"}
        for colour, marker in islice(zip(cycle(COLOURS), cycle(_MARKERS)), count)
    ]
