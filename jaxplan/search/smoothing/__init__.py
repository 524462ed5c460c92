"""Path smoothing after the search: shorter paths with smoother nodes, as clear as before."""

from jaxplan.search.smoothing.bends import Bend
from jaxplan.search.smoothing.smoother import bend_straight, smooth

__all__ = ["Bend", "bend_straight", "smooth"]
