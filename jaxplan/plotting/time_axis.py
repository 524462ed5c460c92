"""Time axes: in seconds for a manoeuvre, with a tick at its end, and in UTC or hours and minutes for a day.

A *day* is the motion of a timeline, however long. Labels in UTC ignore a leap second within the day.
"""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.path import Path
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator
from matplotlib.transforms import IdentityTransform

_NODE_TICK_LENGTH, _NODE_TICK_SHAPE = 3.0, Path([(0, 0), (0, -1)])  # length in points
_TICK_STEPS = (  # s between ticks; the shortest that gives no more than `_MAX_TICKS` ticks is taken
    *(1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800),
    *(3600, 7200, 10800, 21600, 43200, 86400, 172800, 604800),
)
_MAX_TICKS = 9  # most ticks of an axis of a day
_NODE_GREY = "0.35"  # of the marks of nodes
_LABEL_SIZE = 9.5  # points, of labels


def day_axis(grid: Sequence[Axes], end: float, epoch: np.datetime64 | None) -> None:
    """Give panels, ordered from top to bottom, the time axis of a day, with labels in hours and minutes.

    Args:
        grid: the panels; the label of the axis stands under the lowest, and under those that do not share its
            axis.
        end: s from the start, right end of the axis; the left end is the start.
        epoch: UTC of the start, for labels in UTC; None for labels that count from the start.
    """
    start = np.datetime64(0, "ns") if epoch is None else epoch.astype("datetime64[ns]")
    midnight = start.astype("datetime64[D]").astype("datetime64[ns]")
    into = float((start - midnight) / np.timedelta64(1, "ns")) * 1e-9  # s of the day at the start
    step = next((step for step in _TICK_STEPS if end / step <= _MAX_TICKS), _TICK_STEPS[-1])
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
        axes.set_xlabel(words if lowest else "", fontsize=_LABEL_SIZE)


def mark_nodes(axes: Axes, times: np.ndarray) -> None:
    """Mark times (k,) s below a panel by one artist; drawing them as minor ticks would double the time."""
    marks = PathCollection(
        [_NODE_TICK_SHAPE],
        sizes=[_NODE_TICK_LENGTH**2],
        offsets=np.stack([times, np.zeros_like(times)], axis=1),
        offset_transform=axes.get_xaxis_transform(),
        transform=IdentityTransform(),
        edgecolors=_NODE_GREY,
        linewidths=0.6,
        clip_on=False,
        zorder=2.01,
    )
    marks.set_in_layout(False)
    axes.add_collection(marks, autolim=False)


class EndLocator(MaxNLocator):
    """Locator of ticks at round times and at the end of a manoeuvre, s."""

    def __init__(self, end: float) -> None:
        super().__init__(nbins=8, steps=[1, 2, 2.5, 5, 10])
        self.end = end

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """Return the ticks of a view, without those whose labels would run into that of the end."""
        ticks = np.asarray(super().tick_values(vmin, vmax), dtype=float)
        return [*ticks[np.abs(ticks - self.end) > 0.08 * (vmax - vmin)].tolist(), self.end]


def seconds(end: float, time: float, _: int | None = None) -> str:
    """Return the label of a tick at `time`, s; that of the end has three digits, or else whole seconds."""
    if time != end:
        return f"{time:.6g}"
    text = f"{end:.{max(0, 2 - math.floor(math.log10(end)))}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
