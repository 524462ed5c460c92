"""Ready-made scenarios and timelines: the paper's four cases, two example timelines, and random scenes."""

from typing import TYPE_CHECKING

from jaxplan.cases.paper import CASE_NAMES, TIMELINE_NAMES, case_path, example_timeline, paper_case
from jaxplan.runtime.lazy_imports import late

if TYPE_CHECKING:
    from jaxplan.cases.random_scenes import RANDOM_KINDS, SKY_KINDS, random_scenario

__all__ = [
    "CASE_NAMES",
    "RANDOM_KINDS",
    "SKY_KINDS",
    "TIMELINE_NAMES",
    "case_path",
    "example_timeline",
    "paper_case",
    "random_scenario",
]

_LAZY_NAMES = ("RANDOM_KINDS", "SKY_KINDS", "random_scenario")
__getattr__ = late(__name__, {name: f"jaxplan.cases.random_scenes:{name}" for name in _LAZY_NAMES})
