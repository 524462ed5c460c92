"""Path smoothing after the search: shorter paths with smoother nodes, as clear as before."""

from jaxplan.search.smoothing.smoother import bend_straight, smooth

__all__ = ["bend_straight", "smooth"]
