"""A timeline's plan in the form that figures of plans take, and the instants and spans that they draw.

A *day* is the whole motion of a timeline, however long. The figures of a plan draw it as a `DayPlan`, made by
`as_plan`, in the same way as a single manoeuvre. Slews of seconds lie between hours of other segments, so
instants are shared out by segments: half of them evenly, half in proportion to duration. Slews get some more,
so that their curves do not look like polygons. A `Following` is a span of time in which a device follows a
target.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jaxplan import so3
from jaxplan.model.activities import Segment
from jaxplan.model.directions import DirectionPath
from jaxplan.model.goals import GivenState
from jaxplan.model.path import Goal
from jaxplan.planner import Plan
from jaxplan.runtime.display import shown
from jaxplan.timeline.record import PlannedActivity, TimelinePlan

_INSTANTS_PER_DAY = 3072  # approximately, if a day has fewer segments than a quarter of this
_MIN_PER_SEGMENT = 4  # instants of a segment at least
_SLEW_INSTANTS, _MAX_PER_SLEW = 3072, 24  # instants shared out evenly among slews; most of one slew


@shown("status", "message", heading="Plan of {0.scenario.name}")
@dataclass(frozen=True, kw_only=True, eq=False)
class DayPlan(Plan):
    """A timeline's plan presented as one manoeuvre from its start to its end.

    It has the attributes of `Plan` and these.

    Attributes:
        instants: (k,) s, rising, at which it is drawn.
        followed: for each time that a device follows a target: number of the device, start and end in s.
    """

    instants: np.ndarray = field(default_factory=lambda: np.zeros(1))
    followed: tuple[tuple[int, float, float], ...] = ()


def as_plan(plan: Plan | TimelinePlan) -> Plan:
    """Return a plan as it is, or a timeline's plan as a `DayPlan`.

    The goal of the latter is the state in which its motion ends, its scenario has the timeline's name, and
    without a trajectory its goal is None.
    """
    if not isinstance(plan, TimelinePlan):
        return plan
    trajectory, scene, goal = plan.trajectory, plan.timeline.scene, None
    end: GivenState = scene.start
    if trajectory is not None:
        last = trajectory.sample(trajectory.duration)
        vector: np.ndarray = so3.log(last.attitude)
        end = GivenState(
            rotation_vector=vector,
            joints=last.joints,
            angular_velocity=last.angular_velocity,
            joint_rates=last.joint_rates,
        )
        goal = Goal(
            attitude=last.attitude,
            joints=last.joints,
            slew_angle=float(so3.distance(scene.start.attitude, last.attitude)),
            time=trajectory.duration,
            angular_velocity=last.angular_velocity,
            joint_rates=last.joint_rates,
        )
    return DayPlan(
        scenario=replace(scene, name=plan.timeline.name, goal=end),
        status=plan.status,
        message=plan.message,
        goal=goal,
        trajectory=trajectory,
        certificate=plan.certificate,
        instants=np.zeros(1)
        if trajectory is None
        else _clip_times_to_end(instants(plan.segments), trajectory.duration),
        followed=tuple((one.device, one.start, one.end) for one in followings(plan)),
    )


def _clip_times_to_end(times: np.ndarray, end: float) -> np.ndarray:
    """Clip times to [0, end], s, since rounding may take them beyond, and return them sorted, each once."""
    return np.unique(np.clip(times, 0.0, end))


def instants(segments: Sequence[Segment]) -> np.ndarray:
    """Choose the times (k,) s at which a day is drawn: both ends of each segment, and some between."""
    spans = np.array([segment.end - segment.start for segment in segments])
    whole = max(float(np.sum(spans)), np.finfo(float).tiny)
    each = _INSTANTS_PER_DAY / 2 / len(spans) + _INSTANTS_PER_DAY / 2 * spans / whole
    slews = np.array([segment.kind == "slew" for segment in segments])
    of_slew = min(_SLEW_INSTANTS // max(int(np.sum(slews)), 1), _MAX_PER_SLEW)
    counts = np.maximum(np.where(slews, max(of_slew, _MIN_PER_SEGMENT), _MIN_PER_SEGMENT), each.astype(int))
    inner = [
        np.linspace(segment.start, segment.end, count, endpoint=False)
        for segment, count in zip(segments, counts, strict=True)
    ]
    return np.unique(np.concatenate([*inner, [segments[-1].end]]))


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
