"""One spline over the whole manoeuvre, by sequential quadratic programming.

`method` chooses durations and repairs; `build` makes a task of a path; `sqp` improves a curve of a
`curve_space` step by step, each by a `program` over `families` of rows, which look at the `motion` in its
`chart`.
"""

from jaxplan.trajectory.global_spline.method import fit_global

__all__ = ["fit_global"]
