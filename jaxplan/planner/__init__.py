"""From a scenario to a certified plan, and plans as files."""

from jaxplan.planner.files import PlanFileError, save_plan
from jaxplan.planner.proof import certify, check_margins
from jaxplan.planner.record import Plan, PlanningError, load_plan
from jaxplan.planner.runs import plan, plan_batch

__all__ = [
    "Plan",
    "PlanFileError",
    "PlanningError",
    "certify",
    "check_margins",
    "load_plan",
    "plan",
    "plan_batch",
    "save_plan",
]
