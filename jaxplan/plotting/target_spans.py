"""When devices follow targets on a day, for its figures."""

from dataclasses import dataclass

from jaxplan.model.directions import DirectionPath
from jaxplan.timeline.record import PlannedActivity, TimelinePlan


@dataclass(frozen=True, kw_only=True, eq=False)
class Following:
    """A device that follows a target for an activity.

    Attributes:
        planned: the activity as it is planned, with its times.
        device: number of the device.
        path: of the target.
        begin: s, from when on the device follows it, perhaps before the activity's window opens.
        tolerance: rad, that was asked for.
    """

    planned: PlannedActivity
    device: int
    path: DirectionPath
    begin: float
    tolerance: float

    @property
    def start(self) -> float:
        """When the activity begins, s."""
        assert self.planned.start is not None
        return self.planned.start

    @property
    def end(self) -> float:
        """When it ends, s."""
        assert self.planned.end is not None
        return self.planned.end

    @property
    def name(self) -> str:
        """Name of the target where its path has one, else nothing."""
        return self.path.target


def followings(plan: TimelinePlan) -> list[Following]:
    """All that devices follow on a day, in order; those of planned activities alone."""
    asked = {activity.name: activity.targets for activity in plan.timeline.activities}
    begins = {
        segment.name: segment.start for segment in plan.segments if segment.kind not in ("slew", "idle")
    }
    craft = plan.timeline.scene.spacecraft
    found = []
    for planned in plan.activities:
        targets = asked.get(planned.name)  # the rest after the last activity is not asked for
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
