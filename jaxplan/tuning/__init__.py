"""Tuning of numbers of scenarios, along the gradient of what follows from them or, without one, by trials.

`parameters` keeps numbers within their bounds, `objectives` has the functions that may be lowered, `descent`
follows the gradient, and `trials` does without one. `by_key` tells what each number does to a plan.
"""

from jaxplan.tuning.by_key import Sensitivities, Sensitivity, sensitivities
from jaxplan.tuning.descent import tune
from jaxplan.tuning.objectives import OBJECTIVES
from jaxplan.tuning.trials import SearchTuning, tune_search
from jaxplan.tuning.tuned import Tuning

__all__ = [
    "OBJECTIVES",
    "SearchTuning",
    "Sensitivities",
    "Sensitivity",
    "Tuning",
    "sensitivities",
    "tune",
    "tune_search",
]
