"""Spans of time in which devices follow targets on a day, the motion of a timeline, for its figures."""

from dataclasses import dataclass

from jaxplan.model.directions import DirectionPath
from jaxplan.timeline.record import PlannedActivity, TimelinePlan


@dataclass(frozen=True, kw_only=True, eq=False)
class Following:
    """A span of time in which one device follows a target for one activity.

    Attributes:
        planned: the activity as it is planned, with its times.
        device: number of the device.
        path: inertial direction of the target over time.
        begin: s, when the device begins to follow it; may be before `start`, while the window is not yet
            open.
        tolerance: rad, largest pointing error that the activity allows.
    """

    planned: PlannedActivity
    device: int
    path: DirectionPath
    begin: float
    tolerance: float

    @property
    def start(self) -> float:
        """When the activity begins, s from the timeline's start."""
        assert self.planned.start is not None
        return self.planned.start

    @property
    def end(self) -> float:
        """When the activity ends, s from the timeline's start."""
        assert self.planned.end is not None
        return self.planned.end

    @property
    def name(self) -> str:
        """Name of the target; empty where its path has none."""
        return self.path.target


def followings(plan: TimelinePlan) -> list[Following]:
    """Return the spans in which devices follow targets, for planned activities in their order."""
    asked = {activity.name: activity.targets for activity in plan.timeline.activities}
    begins = {
        segment.name: segment.start for segment in plan.segments if segment.kind not in ("slew", "idle")
    }
    craft = plan.timeline.scene.spacecraft
    found = []
    for planned in plan.activities:
        targets = asked.get(planned.name)  # None for the rest after the last activity
        if planned.start is None or planned.end is None or targets is None:
            continue
        begin = min(planned.start, begins.get(planned.name, planned.start))
        for device, path in zip(targets.numbers(craft), targets.paths, strict=True):
            found.append(
                Following(
                    planned=planned, device=device, path=path, begin=begin, tolerance=float(targets.tolerance)
                )
            )
    return found
