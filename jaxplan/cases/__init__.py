"""Ready-made scenarios: the paper's four cases, and random scenes of many kinds."""

from jaxplan.cases.paper import CASE_NAMES, case_path, paper_case
from jaxplan.cases.random_scenes import RANDOM_KINDS, SKY_KINDS, random_scenario

__all__ = ["CASE_NAMES", "RANDOM_KINDS", "SKY_KINDS", "case_path", "paper_case", "random_scenario"]
