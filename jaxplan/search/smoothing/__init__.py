"""Path smoothing after the search: shorter paths with smoother nodes, as clear as before."""

from jaxplan.search.smoothing.smoother import Band, smooth, smooth_results, straight_bands

__all__ = ["Band", "smooth", "smooth_results", "straight_bands"]
