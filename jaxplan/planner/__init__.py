"""From a scenario to a certified plan, and plans as files."""

from jaxplan.planner.check import check_margins, check_plan
from jaxplan.planner.record import Plan, PlanningError
from jaxplan.planner.runs import plan, plan_batch
from jaxplan.planner.storage import PlanFileError, load_plan, save_plan

__all__ = [
    "Plan",
    "PlanFileError",
    "PlanningError",
    "check_margins",
    "check_plan",
    "load_plan",
    "plan",
    "plan_batch",
    "save_plan",
]
