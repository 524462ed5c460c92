"""Step 3: turn a path into a trajectory that can be flown, by one of the methods in `METHODS`.

A method is chosen by its name in the settings: "global" (the spline fit) or "paper" (the paper's scheme).
"""

from collections.abc import Sequence
from pkgutil import resolve_name
from typing import Any

from jaxplan.runtime.batching import Seconds, grouped
from jaxplan.runtime.garbage import uncollected
from jaxplan.runtime.workers import one_thread
from jaxplan.trajectory.curve import Samples, Trajectory, evaluate, total_momentum
from jaxplan.trajectory.fit import NEAR_THE_BOUND, Fit, FitQuery
from jaxplan.trajectory.kernels import kernel_tasks

METHODS: dict[str, Any] = {
    "global": "jaxplan.trajectory.strategy:fit",
    "paper": "jaxplan.paper.trajectory:fit",
}
"""Methods by the names of settings: from queries and their `Seconds` to fits; loaded by `by_name`."""
REFITS: dict[str, Any] = {
    "global": "jaxplan.trajectory.derivative:refit",
    "paper": "jaxplan.paper.derivative:refit",
}
"""The same methods as functions near a fit, which can be differentiated; loaded by `by_name`."""


def by_name(methods: dict[str, Any], name: str) -> Any:
    """Return the function that `METHODS` or `REFITS` lists under a name.

    Args:
        methods: `METHODS` or `REFITS`; an entry is a function, or a string "module:function", whose module is
            imported now.
        name: of the method, as in the settings.
    """
    known = methods[name]
    if not isinstance(known, str):
        return known
    with uncollected():
        return resolve_name(known)


__all__ = [
    "METHODS",
    "NEAR_THE_BOUND",
    "REFITS",
    "Fit",
    "FitQuery",
    "Samples",
    "Trajectory",
    "by_name",
    "evaluate",
    "fit_batch",
    "kernel_tasks",
    "total_momentum",
]


def fit_batch(queries: Sequence[FitQuery], seconds: Seconds | None = None) -> list[Fit]:
    """Fit many trajectories together, each by the method that its settings name.

    Args:
        queries: one for each trajectory; they need not be alike.
        seconds: accumulates the computation time of each fit, in s, in place; time spent on several fits
            together is divided equally among them. None to measure nothing.

    Returns:
        One `Fit` for each query, in the same order. A fit that fails is returned with a status that says so.

    Raises:
        ValueError: if settings, edge costs, node fractions or rates at the ends are invalid; the message
            names which.
    """
    fits: dict[int, Fit] = {}
    with one_thread():
        for numbers in grouped(queries, lambda query: query.settings.method):
            own, method = Seconds(len(numbers)), by_name(METHODS, queries[numbers[0]].settings.method)
            fits.update(zip(numbers, method([queries[n] for n in numbers], own), strict=True))
            if seconds is not None:
                seconds.spent[numbers] += own.spent
    return [fits[n] for n in range(len(queries))]
