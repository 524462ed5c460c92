"""One spline over the whole manoeuvre, by sequential quadratic programming.

`method` chooses durations and `attempts` what to try; `build` makes a task of a path; `sqp` improves the
curves of a `stack` of tasks step by step, each by a `program` over `families` of rows, which look at the
`motion` in its `chart`, and which its `dual` solves. `holding` tells which rows are `binding` at the end,
`refit` follows the curve while its `inputs` change.
"""

from jaxplan.trajectory.global_spline.method import fit_global
from jaxplan.trajectory.global_spline.method import steps as global_steps
from jaxplan.trajectory.global_spline.refit import refit as refit_global

__all__ = ["fit_global", "global_steps", "refit_global"]
