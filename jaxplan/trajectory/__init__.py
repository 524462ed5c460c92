"""Step 3: from a path to a trajectory that can be flown; `METHODS` by the names that settings give them."""

from jaxplan.trajectory.curve import Samples, Trajectory, evaluate
from jaxplan.trajectory.fit import Fit
from jaxplan.trajectory.paper import fit_paper

METHODS = {"paper": fit_paper}

__all__ = ["METHODS", "Fit", "Samples", "Trajectory", "evaluate", "fit_paper"]
