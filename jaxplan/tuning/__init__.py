"""Tuning of numbers of scenarios by the gradient of what follows from them.

`parameters` keeps numbers within their bounds, `objectives` are what may be lowered, `descent` follows the
gradient.
"""

from jaxplan.tuning.descent import Tuning, tune
from jaxplan.tuning.objectives import OBJECTIVES

__all__ = ["OBJECTIVES", "Tuning", "tune"]
