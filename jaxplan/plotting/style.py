"""How the figures look: one colour and line style a device, limits, legends beside the data.

The colours keep apart for the kinds of colour blindness, above all those that share a line style, and the
line styles keep apart in print without colour. There are 7 colours and 4 styles; as these have no common
divisor, 28 devices differ in one or the other. Limits are barriers with ticks on the far side. Nothing here
changes matplotlib's global settings.
"""

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withTickedStroke
from matplotlib.text import Text

Look: TypeAlias = dict[str, Any]  # what matplotlib is told about a line, a mark or an area
Entry: TypeAlias = tuple[Artist, str]  # of a legend
Entries: TypeAlias = list[Entry]

COLOURS = ("#0072B2", "#E69F00", "#882255", "#56B4E9", "#332288", "#117733", "#CC79A7")
LINE_STYLES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (6, 1.5, 1, 1.5)), (0, (1.5, 1.2)))
AXIS_STYLES: tuple[Look, ...] = (  # of the body axes; no device has these colours
    {"color": "black", "linestyle": LINE_STYLES[0]},
    {"color": "#D55E00", "linestyle": LINE_STYLES[1]},
    {"color": "#009E73", "linestyle": LINE_STYLES[3]},
)
KEEP_OUT, KEEP_IN, GREY = "#B2182B", "#1B7837", "0.35"
TEXT, SMALL = 9, 7.5  # points
_LEGEND_ROWS = 14
_STILL = 1e-3  # of a limit, up to which nothing is said to move


def device_style(number: int) -> Look:
    """Colour and line style of a device, the same in every figure.

    Args:
        number: place among the spacecraft's devices.
    """
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": LINE_STYLES[number % len(LINE_STYLES)]}


def plain(text: Text) -> Text:
    """A text shown letter by letter: names come from files, and a ``$`` in one is no formula."""
    text.set_parse_math(False)
    return text


def note(axes: Axes, text: str) -> None:
    """Say in an empty panel why it is empty."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=GREY)


def tidy(axes: Axes) -> None:
    """A light grid, small figures, and no frame above and to the right."""
    axes.grid(True, color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=TEXT)
    axes.spines[["top", "right"]].set_visible(False)


def barrier(side: int) -> Look:
    """A solid line with ticks on the side that is out of bounds: above for 1, below for -1.

    Curves have no ticks, so whatever its colour a limit is not taken for one of them.
    """
    ticks = withTickedStroke(angle=side * 60, spacing=7, length=0.6)
    return {"linewidth": 1, "linestyle": "-", "path_effects": [ticks]}


def limit_lines(
    axes: Axes, limits: np.ndarray, styles: Sequence[Look], highest: float, *, far: float
) -> Entries:
    """Limits at plus and minus their values, drawn as barriers or, far from the curves, told above the panel.

    Args:
        axes: where to.
        limits: one for each curve of the panel, in its unit; an infinite one is none.
        styles: of the curves. A limit of one curve among several has its colour, one of more curves is grey.
        highest: magnitude of the curves.
        far: times the highest, beyond which a limit is told, since the curves would shrink to a line. Where
            nearly nothing moves every limit is drawn, or the panel would show rounding errors.

    Returns:
        Entry for a legend; none where no limit is drawn.
    """
    values = np.unique(np.round(limits[np.isfinite(limits)], 9))
    near = (values <= far * highest) | (highest < _STILL * values)
    drawn, told = values[near], values[~near]
    for value in drawn:
        owners = np.flatnonzero(np.isclose(limits, value, rtol=0, atol=1e-8))
        colour = styles[owners[0]]["color"] if len(owners) == 1 and len(values) > 1 else GREY
        for side in (-1, 1):
            axes.axhline(side * value, color=colour, zorder=1.5, **barrier(side))
    if len(told):
        words = f"limit{'s' * (len(told) > 1)} {', '.join(f'±{value:.3g}' for value in told)}"
        place: Look = {"xy": (1, 1), "xycoords": "axes fraction", "xytext": (0, 2), "ha": "right"}
        axes.annotate(words, textcoords="offset points", va="bottom", color=GREY, fontsize=SMALL, **place)
    return [(Line2D([], [], color=GREY, **barrier(1)), "limit")] if len(drawn) else []


def legend_beside(axes: Axes, entries: Sequence[Entry]) -> None:
    """A legend to the right of the axes, so that it covers no data."""
    if not entries:
        return
    # a label that begins with an underscore would be left out
    labels = [f"\N{ZERO WIDTH SPACE}{label}" if label.startswith("_") else label for _, label in entries]
    legend = axes.legend(
        [handle for handle, _ in entries],
        labels,
        loc="upper left",
        bbox_to_anchor=(1.01, 1.0),
        borderaxespad=0.0,
        frameon=False,
        fontsize=SMALL,
        handlelength=3.2,
        ncols=-(-len(entries) // _LEGEND_ROWS),
    )
    for text in legend.get_texts():
        plain(text)


def device_entries(names: Sequence[str]) -> Entries:
    """Legend entries of the devices, or of the first of them."""
    return [(Line2D([], [], linewidth=1.8, **device_style(i)), name) for i, name in enumerate(names)]
