"""From a scenario to a certified plan, and plans as files; `plan` and `plan_batch` load on first use."""

from typing import TYPE_CHECKING

from jaxplan.planner.files import PlanFileError, save_plan
from jaxplan.planner.proving import certify, check_margins
from jaxplan.planner.record import Plan, PlanningError, load_plan
from jaxplan.runtime.lazy_imports import late

if TYPE_CHECKING:
    from jaxplan.planner.entry_points import plan, plan_batch

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

__getattr__ = late(
    __name__, {name: f"jaxplan.planner.entry_points:{name}" for name in ("plan", "plan_batch")}
)
