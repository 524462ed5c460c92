"""What every figure over time shares: curves with their limits, the nodes as ticks, and the time axis."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import ArrayLike

from jaxplan.model.limits import Quantity
from jaxplan.plotting.samples import Motion
from jaxplan.plotting.style import TEXT, Entries, Look, limit_lines, tidy

_LONG = 10  # letters of a word, beside more of which its unit has no place
FAR = 4.0  # times the highest value: a limit beyond is told and not drawn


def labelled(words: str, quantity: Quantity) -> str:
    """What a panel of a quantity is labelled with: words and the unit, which stands below a long word."""
    below = len(words.split()[-1]) > _LONG and "\n" not in words
    between = "\n" if below else " "
    return f"{words}{between}({quantity.printed_unit})"


def panel(
    axes: Axes,
    motion: Motion,
    values: np.ndarray,
    limits: np.ndarray,
    styles: Sequence[Look],
    label: str,
    *,
    degrees: bool = True,
    far: float = FAR,
) -> Entries:
    """Draw curves over time with their limits.

    Args:
        axes: where to.
        motion: whose times are meant.
        values: (k, c) a column for each curve, in radians and seconds; drawn in degrees.
        limits: (c,) likewise; an infinite one is not drawn.
        styles: of the curves.
        label: of the vertical axis, with the unit.
        degrees: False if the values are drawn as they are.
        far: times the highest value, beyond which a limit is told above the panel and not drawn.

    Returns:
        Legend entries for the limits, if there are any.
    """
    shown = np.rad2deg if degrees else np.asarray
    for column, style in zip(shown(values).T, styles, strict=True):
        curve(axes, motion.times, column, **style)
    highest = float(np.max(np.abs(shown(values)), initial=0.0))
    entries = limit_lines(axes, shown(limits), styles, highest, far=far)
    axes.set_ylabel(label, fontsize=TEXT)
    return entries


def curve(axes: Axes, times: np.ndarray, values: np.ndarray, **style: Any) -> None:
    """Draw one curve; a manoeuvre that takes no time is a dot."""
    marker = "o" if len(times) == 1 else None
    axes.plot(times, values, **{"linewidth": 1.6, "marker": marker, "markersize": 5, **style})


def time_axis(panels: Sequence[Axes], motion: Motion) -> None:
    """Time in seconds under the lowest of some panels, and under those that do not share its axis."""
    time_span(panels, float(motion.times[-1]), motion.node_times)


def time_span(panels: Sequence[Axes], end: float, node_times: ArrayLike = ()) -> None:
    """The same from zero to an end, s, with ticks for nodes."""
    lowest = panels[-1]
    for axes in panels:
        tidy(axes)
        axes.set_xticks(np.asarray(node_times), minor=True)
        axes.tick_params(axis="x", which="minor", length=3, color="0.35")
        if end > 0:
            axes.set_xlim(0, end)
            axes.xaxis.set_major_locator(_EndLocator(end))
            axes.xaxis.set_major_formatter(FuncFormatter(partial(_seconds, end)))
        else:
            axes.set(xlim=(-1, 1), xticks=[0])
        shared = axes is not lowest and axes.get_shared_x_axes().joined(axes, lowest)
        axes.set_xlabel("" if shared else "time (s)", fontsize=TEXT)


class _EndLocator(MaxNLocator):
    """Round times, and the duration, so that it can be read off."""

    def __init__(self, end: float) -> None:
        super().__init__(nbins=8, steps=[1, 2, 2.5, 5, 10])
        self.end = end

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """The ticks of a view, less those whose labels would run into that of the end."""
        ticks = np.asarray(super().tick_values(vmin, vmax), dtype=float)
        return [*ticks[np.abs(ticks - self.end) > 0.08 * (vmax - vmin)].tolist(), self.end]


def _seconds(end: float, time: float, _: int | None = None) -> str:
    """A time as its tick says it; the duration to three digits, or to the second."""
    if time != end:
        return f"{time:.6g}"
    text = f"{end:.{max(0, 2 - math.floor(math.log10(end)))}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
