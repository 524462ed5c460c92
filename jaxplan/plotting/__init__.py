"""Figures of a plan, of planners compared, and of studies, reached as ``jp.plot``.

    >>> jp.plot.sphere(plan)
    >>> jp.plot.margins(plan, ax=axes).figure.savefig("margins.png")

Most figures take a plan, also one of a timeline. Others take something else: `compare` and `segments` several
trajectories by name, `durations` the durations of several methods, `table4` rows of a comparison of planners,
`study` and its panels `success_rates`, `outcomes` and `distribution` studies, `constellation` a planned
constellation, `timeline` the plan of a timeline, `spacecraft` a spacecraft, and `tuning` the result of a
tuning.

The argument ``ax`` says where to draw: axes (a sequence of them for a figure of several panels), a figure to
put the axes in, or None for a new figure. All functions but two return the axes; `animate` returns a film,
and `figures` yields all figures of a plan by name. Matplotlib's global settings are left alone, and
``plt.show()`` is never called.

A device has one colour and line style in all figures of plans, and a planner one colour in all comparisons. A
line at a limit has ticks on the side that is out of bounds. Axes are in degrees and seconds, torques in N m,
spectra in Hz and N m s.
"""

from typing import TYPE_CHECKING

from jaxplan.plotting.ground_track import ground_track
from jaxplan.plotting.joint_map import joint_map
from jaxplan.plotting.margin_panels import margins
from jaxplan.plotting.mounting import spacecraft
from jaxplan.plotting.mounting import spacecraft_figure as spacecraft_figure
from jaxplan.plotting.orbital import attitude
from jaxplan.plotting.sky import globe, sphere
from jaxplan.plotting.spectrum import spectrum
from jaxplan.plotting.time_panels import accelerations, angles, rates, torque
from jaxplan.plotting.timeline import timeline
from jaxplan.plotting.whole_plan import FIGURE_NAMES as FIGURE_NAMES
from jaxplan.plotting.whole_plan import draw_png as draw_png
from jaxplan.plotting.whole_plan import drawings as drawings
from jaxplan.plotting.whole_plan import figures, overview
from jaxplan.plotting.whole_plan import inline_figures as inline_figures
from jaxplan.runtime.lazy_imports import late

if TYPE_CHECKING:  # those that are not drawn of a single plan
    from jaxplan.plotting.constellation_figure import constellation
    from jaxplan.plotting.film import animate
    from jaxplan.plotting.method_comparison import comparison_figure as comparison_figure
    from jaxplan.plotting.method_comparison import durations, table4
    from jaxplan.plotting.study_figures import distribution, outcomes, study, success_rates
    from jaxplan.plotting.study_figures import study_figure as study_figure
    from jaxplan.plotting.trajectory_columns import compare, segments
    from jaxplan.plotting.tuning_panels import tuning

_HOMES = {
    "animate": "jaxplan.plotting.film:animate",
    "compare": "jaxplan.plotting.trajectory_columns:compare",
    "comparison_figure": "jaxplan.plotting.method_comparison:comparison_figure",
    "constellation": "jaxplan.plotting.constellation_figure:constellation",
    "distribution": "jaxplan.plotting.study_figures:distribution",
    "durations": "jaxplan.plotting.method_comparison:durations",
    "outcomes": "jaxplan.plotting.study_figures:outcomes",
    "segments": "jaxplan.plotting.trajectory_columns:segments",
    "study": "jaxplan.plotting.study_figures:study",
    "study_figure": "jaxplan.plotting.study_figures:study_figure",
    "success_rates": "jaxplan.plotting.study_figures:success_rates",
    "table4": "jaxplan.plotting.method_comparison:table4",
    "tuning": "jaxplan.plotting.tuning_panels:tuning",
}

__getattr__ = late(__name__, _HOMES)

# Functions for users; names imported "as" themselves are for the command line and the report.
__all__ = [
    "accelerations",
    "angles",
    "animate",
    "attitude",
    "compare",
    "constellation",
    "distribution",
    "durations",
    "figures",
    "globe",
    "ground_track",
    "joint_map",
    "margins",
    "outcomes",
    "overview",
    "rates",
    "segments",
    "spacecraft",
    "spectrum",
    "sphere",
    "study",
    "success_rates",
    "table4",
    "timeline",
    "torque",
    "tuning",
]


def __dir__() -> list[str]:
    return sorted(__all__)
