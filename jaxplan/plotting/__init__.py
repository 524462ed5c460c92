"""Figures of a plan, reached as ``jp.plot``.

    >>> jp.plot.sphere(plan)
    >>> jp.plot.margins(plan, ax=axes).figure.savefig("margins.png")

Every figure takes a plan and, with ``ax``, where to draw: axes (several for a figure of several panels), a
figure to put them in, or None for a new one. It returns the axes, leaves matplotlib's global settings alone
and never calls ``plt.show()``. A device has one colour and line style in all figures. Axes are in degrees and
seconds.
"""

from jaxplan.plotting.margin_panel import margins
from jaxplan.plotting.motion_panels import accelerations, angles, rates
from jaxplan.plotting.sphere_map import sphere
from jaxplan.plotting.whole_plan import FIGURE_NAMES, figures, overview

__all__ = ["FIGURE_NAMES", "accelerations", "angles", "figures", "margins", "overview", "rates", "sphere"]
