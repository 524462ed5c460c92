"""Ready-made scenarios: the paper's four cases, and random scenes, loaded when they are first used."""

from typing import TYPE_CHECKING

from jaxplan.cases.paper import CASE_NAMES, case_path, paper_case
from jaxplan.runtime.late import late

if TYPE_CHECKING:
    from jaxplan.cases.random_scenes import RANDOM_KINDS, SKY_KINDS, random_scenario

__all__ = ["CASE_NAMES", "RANDOM_KINDS", "SKY_KINDS", "case_path", "paper_case", "random_scenario"]

_RANDOM = ("RANDOM_KINDS", "SKY_KINDS", "random_scenario")
__getattr__ = late(__name__, {name: f"jaxplan.cases.random_scenes:{name}" for name in _RANDOM})
