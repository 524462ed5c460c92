"""A timeline's plan as the other figures take it, and the instants at which it is drawn.

The figures of a plan draw a `DayPlan`, made by `as_plan`, as they do any other. Between the many hours of a
day lie slews of seconds, so its instants are shared out by segments: half of them evenly, half by duration.
Slews have some more, so that their ways are no polygons.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jaxplan import so3
from jaxplan.model.goals import GivenState
from jaxplan.model.path import Goal
from jaxplan.model.timeline import Segment
from jaxplan.planner import Plan
from jaxplan.plotting.target_spans import followings
from jaxplan.runtime.display import shown
from jaxplan.timeline.record import TimelinePlan

_INSTANTS = 3072  # of a day, about, as long as it has not more segments than a quarter of this
_FEWEST = 4  # instants of a segment
_OF_SLEWS, _MOST_OF_SLEW = 3072, 24  # instants of all slews that they have at least, and of one of them


@shown("status", "message", heading="Plan of {0.scenario.name}")
@dataclass(frozen=True, kw_only=True, eq=False)
class DayPlan(Plan):
    """A timeline's plan as a manoeuvre from its start to its end.

    Attributes:
        instants: (k,) s, rising, at which it is drawn.
        followed: number of a device, and from when until when, s, it follows a target; by time.
    """

    instants: np.ndarray = field(default_factory=lambda: np.zeros(1))
    followed: tuple[tuple[int, float, float], ...] = ()


def as_plan(plan: Plan | TimelinePlan) -> Plan:
    """A plan as it is, and that of a timeline as a manoeuvre to the state in which it ends.

    Its name is that of the timeline.
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
        instants=np.zeros(1) if trajectory is None else _within(instants(plan.segments), trajectory.duration),
        followed=tuple((one.device, one.start, one.end) for one in followings(plan)),
    )


def _within(times: np.ndarray, end: float) -> np.ndarray:
    """Times (k,) s, those beyond the end, s, by rounding brought to it."""
    return np.unique(np.clip(times, 0.0, end))


def instants(segments: Sequence[Segment]) -> np.ndarray:
    """Times (k,) s at which a day is drawn: both ends of each segment, and some between."""
    spans = np.array([segment.end - segment.start for segment in segments])
    whole = max(float(np.sum(spans)), np.finfo(float).tiny)
    each = _INSTANTS / 2 / len(spans) + _INSTANTS / 2 * spans / whole
    slews = np.array([segment.kind == "slew" for segment in segments])
    of_slew = min(_OF_SLEWS // max(int(np.sum(slews)), 1), _MOST_OF_SLEW)
    counts = np.maximum(np.where(slews, max(of_slew, _FEWEST), _FEWEST), each.astype(int))
    inner = [
        np.linspace(segment.start, segment.end, count, endpoint=False)
        for segment, count in zip(segments, counts, strict=True)
    ]
    return np.unique(np.concatenate([*inner, [segments[-1].end]]))
