"""Step 3: from a path to a trajectory that can be flown; `METHODS` by the names that settings give them."""

from jaxplan.trajectory.bound import duration_bound, excess
from jaxplan.trajectory.curve import Samples, Trajectory, evaluate
from jaxplan.trajectory.fit import Fit
from jaxplan.trajectory.global_spline import fit_global, refit_global
from jaxplan.trajectory.paper import fit_paper, refit_paper

METHODS = {"global": fit_global, "paper": fit_paper}
REFITS = {
    "global": refit_global,
    "paper": refit_paper,
}  # the same near a fit, as functions that differentiate

__all__ = [
    "METHODS",
    "REFITS",
    "Fit",
    "Samples",
    "Trajectory",
    "duration_bound",
    "evaluate",
    "excess",
    "fit_global",
    "fit_paper",
]
