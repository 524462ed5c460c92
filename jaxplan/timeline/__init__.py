"""A day of operations: activities that track, point or rest, and the slews between them, in one plan."""

from typing import TYPE_CHECKING

from jaxplan.model.activities import Segment
from jaxplan.runtime.lazy_imports import late
from jaxplan.timeline.record import PlannedActivity, TimelineError, TimelinePlan, load_timeline_plan

if TYPE_CHECKING:
    from jaxplan.timeline.planning import plan_timeline

__all__ = [
    "PlannedActivity",
    "Segment",
    "TimelineError",
    "TimelinePlan",
    "load_timeline_plan",
    "plan_timeline",
]

__getattr__ = late(__name__, {"plan_timeline": "jaxplan.timeline.planning:plan_timeline"})
