"""The paper's scheme (section 4), corrected: segments on charts of SO(3), planned one after another."""

from jaxplan.trajectory.paper.method import fit_paper
from jaxplan.trajectory.paper.method import steps as paper_steps
from jaxplan.trajectory.paper.refit import refit as refit_paper

__all__ = ["fit_paper", "paper_steps", "refit_paper"]
