"""Axes of time: seconds of a manoeuvre with its end, and UTC, or hours and minutes, of a day.

Labels of a day in UTC do not count a leap second in it.
"""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.path import Path
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator
from matplotlib.transforms import IdentityTransform

_NODE_TICK, _DOWNWARD = 3.0, Path([(0, 0), (0, -1)])  # length of the mark of a node in points, and its shape
_STEPS = (  # s between ticks, of which the shortest with no more ticks than there is room for is taken
    *(1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800),
    *(3600, 7200, 10800, 21600, 43200, 86400, 172800, 604800),
)
_MOST = 9  # ticks of an axis
_GREY = "0.35"  # of the marks of nodes
_TEXT = 9.5  # points, of labels


def day_axis(grid: Sequence[Axes], end: float, epoch: np.datetime64 | None) -> None:
    """Let panels, from top to bottom, show the time of a day from zero to an end, s.

    Args:
        grid: the panels; the label stands under the lowest.
        end: s.
        epoch: UTC of the start; None for times from the start on.
    """
    start = np.datetime64(0, "ns") if epoch is None else epoch.astype("datetime64[ns]")
    midnight = start.astype("datetime64[D]").astype("datetime64[ns]")
    into = float((start - midnight) / np.timedelta64(1, "ns")) * 1e-9  # s of the day at the start
    step = next((step for step in _STEPS if end / step <= _MOST), _STEPS[-1])
    ticks = np.arange(np.ceil(into / step), np.floor((into + end) / step + 1e-9) + 1) * step - into

    def label(time: float, _: int | None = None) -> str:
        seconds = round(into + time)
        days, seconds = divmod(seconds, 86400)
        hours, minutes = divmod(seconds // 60, 60)
        if epoch is None:
            hours, days = hours + 24 * days, 0
        text = f"{hours:02d}:{minutes:02d}" + (f":{seconds % 60:02d}" if step < 60 else "")
        if epoch is not None and seconds == 0 and days:
            text += f"\n{np.datetime_as_string(midnight + np.timedelta64(days, 'D'), unit='D')}"
        return text

    form = "h:min:s" if step < 60 else "h:min"
    words = f"time from the start ({form})"
    if epoch is not None:
        words = f"UTC ({form}) from {np.datetime_as_string(midnight, unit='D')} on"
    for axes in grid:
        axes.set_xlim(0, end if end > 0 else 1)
        axes.xaxis.set_major_locator(FixedLocator(ticks.tolist()))
        axes.xaxis.set_major_formatter(FuncFormatter(label))
        lowest = axes is grid[-1] or not axes.get_shared_x_axes().joined(axes, grid[-1])
        axes.set_xlabel(words if lowest else "", fontsize=_TEXT)


def mark_nodes(axes: Axes, times: np.ndarray) -> None:
    """Mark times (k,) s below a panel, by one artist: minor ticks would take half of the time to draw it."""
    marks = PathCollection(
        [_DOWNWARD],
        sizes=[_NODE_TICK**2],
        offsets=np.stack([times, np.zeros_like(times)], axis=1),
        offset_transform=axes.get_xaxis_transform(),
        transform=IdentityTransform(),
        edgecolors=_GREY,
        linewidths=0.6,
        clip_on=False,
        zorder=2.01,
    )
    marks.set_in_layout(False)
    axes.add_collection(marks, autolim=False)


class EndLocator(MaxNLocator):
    """Locator of ticks at round times and at the duration."""

    def __init__(self, end: float) -> None:
        super().__init__(nbins=8, steps=[1, 2, 2.5, 5, 10])
        self.end = end

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """The ticks of a view, less those whose labels would run into that of the end."""
        ticks = np.asarray(super().tick_values(vmin, vmax), dtype=float)
        return [*ticks[np.abs(ticks - self.end) > 0.08 * (vmax - vmin)].tolist(), self.end]


def seconds(end: float, time: float, _: int | None = None) -> str:
    """Label of a tick at a time, s; that of the duration `end` has three digits, or whole seconds."""
    if time != end:
        return f"{time:.6g}"
    text = f"{end:.{max(0, 2 - math.floor(math.log10(end)))}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
