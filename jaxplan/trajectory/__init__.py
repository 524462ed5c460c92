"""Step 3: from a path to a trajectory that can be flown; `METHODS` by the names that settings give them."""

from collections.abc import Sequence

import numpy as np

from jaxplan.trajectory.asking import together
from jaxplan.trajectory.bound import duration_bound, excess
from jaxplan.trajectory.curve import Samples, Trajectory, evaluate
from jaxplan.trajectory.fit import Fit, FitQuery
from jaxplan.trajectory.global_spline import fit_global, global_steps, refit_global
from jaxplan.trajectory.paper import fit_paper, paper_steps, refit_paper

METHODS = {"global": global_steps, "paper": paper_steps}  # as generators, see `asking`
REFITS = {
    "global": refit_global,
    "paper": refit_paper,
}  # the same near a fit, as functions that differentiate

__all__ = [
    "METHODS",
    "REFITS",
    "Fit",
    "FitQuery",
    "Samples",
    "Trajectory",
    "duration_bound",
    "evaluate",
    "excess",
    "fit_batch",
    "fit_global",
    "fit_paper",
]


def fit_batch(queries: Sequence[FitQuery], spent: np.ndarray | None = None) -> list[Fit]:
    """Fit many trajectories together, each by the method of its settings.

    Args:
        queries: what is asked; they need not be alike.
        spent: (n,) to which the seconds of each fit are added, without those of compiling: of what is done
            together an equal share.

    Returns:
        The fits in the same order: those of the method one by one, on the CPU to the last bit.

    Raises:
        ValueError: as the methods do, before anything is fitted.
    """
    return together([METHODS[query.settings.method](query) for query in queries], spent)
