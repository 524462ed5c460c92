"""A scale for margins in degrees: linear near the limit at zero, where they matter, and logarithmic beyond.

It is ``asinh(margin / width)``, so that half a degree and 130 deg are both read off one panel.
"""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FixedLocator, FuncFormatter, Locator, NullFormatter

from jaxplan.plotting.style import GREY

_WIDTHS = np.array([1.0, 2.0, 5.0, 10.0, 20.0, 50.0])  # deg, within which the scale may be linear
_DEGREES = [digit * 10.0**power for power in (-2, -1, 0, 1, 2) for digit in range(1, 10)]
_TICKS = [0.0, *(sign * value for sign in (-1, 1) for value in _DEGREES if value <= 180)]
_FINEST = 0.1  # deg, of ticks without a number: finer ones would run into zero


def open_near_zero(axes: Axes, which: Literal["x", "y"], lowest: float) -> None:
    """Give one axis of a panel the scale, with ticks at round numbers.

    Args:
        axes: the panel.
        which: of its axes.
        lowest: deg, the smallest margin of the panel: the scale is linear up to about there, and at least up
            to a degree.
    """
    width = float(np.max(_WIDTHS[lowest >= _WIDTHS], initial=_WIDTHS[0]))
    axis: Axis = getattr(axes, f"{which}axis")
    getattr(axes, f"set_{which}scale")("asinh", linear_width=width)
    axis.set_major_locator(_DegreeLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "\N{MINUS SIGN}")))
    axis.set_minor_locator(FixedLocator([tick for tick in _TICKS if abs(tick) >= _FINEST]))
    axis.set_minor_formatter(NullFormatter())
    axis.set_tick_params(which="minor", length=2, color=GREY)


class _DegreeLocator(Locator):
    """Round numbers of degrees, decades before what lies between them, as many as there is room for."""

    def __call__(self) -> Sequence[float]:
        assert self.axis is not None
        return self.tick_values(*self.axis.get_view_interval())

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """The ticks of a view, so far apart that their labels do not touch."""
        axis: Any = self.axis
        place = axis.get_transform().transform
        apart = abs(place(vmax) - place(vmin)) / max(axis.get_tick_space(), 1)
        ticks: list[float] = []
        for digit in (0, 1, 5, 2, 3):
            for tick in sorted((tick for tick in _TICKS if f"{abs(tick):e}"[0] == str(digit)), key=abs):
                if vmin <= tick <= vmax and all(abs(place(tick) - place(other)) >= apart for other in ticks):
                    ticks.append(tick)
        return sorted(ticks)
