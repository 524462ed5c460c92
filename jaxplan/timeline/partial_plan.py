"""A partly planned timeline: what is planned so far, the state at its end, and whether it can be kept.

An earlier plan can be kept up to an activity, and continued from there, if start, epoch and all before that
activity are the same as in that plan, since its motion is reused. That it breaks nothing of what is asked now
is proved anew.
"""

import time as clock
from collections.abc import Sequence
from copy import copy
from dataclasses import fields, replace
from typing import Self

import numpy as np

from jaxplan.certificate import Certificate
from jaxplan.model.activities import Activity, Segment, Timeline, in_order
from jaxplan.model.equality import same
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.planner.validity import start_breaches
from jaxplan.runtime.arguments import expect
from jaxplan.schema.faults import nearest
from jaxplan.schema.timelines import take_in_timeline
from jaxplan.timeline import curves, proving
from jaxplan.timeline.choices import Choice
from jaxplan.timeline.record import PlannedActivity, TimelinePlan
from jaxplan.timeline.tracking import State
from jaxplan.timeline.wheel_momentum import holding, total_in
from jaxplan.trajectory import Trajectory


class SoFar:
    """What is planned of a timeline so far.

    Args:
        timeline: what is to be planned; it is checked as one from a file is.

    Attributes:
        timeline: the timeline.
        scene: spacecraft, zones and settings, in the timeline's times.
        state: the state in which the plan so far ends.
        time: s, when it ends.
        total: (3,) N m s, momentum of platform and wheels in inertial axes; None without wheels.
        parts: parts of the motion, each as (s at which it begins, trajectory).
        proofs: the same with certificates: (s at which it begins, trajectory, certificate).
        segments: slews and what activities do, in order of time.
        activities: what became of each activity that was tried.
        choices: how each planned activity came to begin.
        seconds: computation time in seconds, by step.
        broken: phrases for what the start breaks; empty if it breaks nothing.
    """

    def __init__(self, timeline: Timeline) -> None:
        timeline = take_in_timeline(timeline)
        scene, start = timeline.scene, timeline.scene.start
        self.timeline, self.scene = timeline, scene
        zero = np.zeros(len(start.joints))
        self.state = State(
            attitude=start.attitude,
            joints=start.joints,
            velocity=np.asarray(start.angular_velocity, float),
            rates=np.asarray(start.joint_rates, float),
            acceleration=np.zeros(3),
            bends=zero,
        )
        self.time = 0.0
        self.total = total_in(scene.spacecraft, self.state)
        self.parts: list[tuple[float, Trajectory]] = []
        self.proofs: list[tuple[float, Trajectory, Certificate]] = []
        self.segments: list[Segment] = []
        self.activities: list[PlannedActivity] = []
        self.choices: list[Choice] = []
        self.seconds = {"motions": 0.0, "slews": 0.0, "proof": 0.0}
        self.broken = start_breaches(replace(scene, goal=start))

    def _copy(self) -> Self:
        """Return a copy that can be continued independently; the lists are copied, their elements shared."""
        own = copy(self)
        own.parts, own.proofs, own.segments = list(self.parts), list(self.proofs), list(self.segments)
        own.activities, own.choices = list(self.activities), list(self.choices)
        return own

    def _mark(self) -> tuple[State, float, int]:
        """Return a mark of how far the plan is, for `_roll_back`."""
        return self.state, self.time, len(self.parts)

    def _roll_back(self, mark: tuple[State, float, int]) -> None:
        """Remove the parts of the motion that were added after a mark, and return to its state and time."""
        self.state, self.time, kept = mark
        del self.parts[kept:], self.proofs[kept:], self.segments[kept:]

    def _add_part(self, name: str, kind: str, trajectory: Trajectory, proof: Certificate) -> None:
        """Append a part of the motion with its certificate, and continue from its end."""
        self.parts.append((self.time, trajectory))
        self.proofs.append((self.time, trajectory, proof))
        end = self.time + trajectory.duration
        self.segments.append(Segment(name=name, kind=kind, start=self.time, end=end))
        self.state, self.time = State.of(trajectory, trajectory.duration), end

    def _loaded_craft(self, further: Trajectory | None = None) -> Spacecraft:
        """Return the spacecraft with the momentum that its wheels hold now, or after a part `further`."""
        state = self.state if further is None else State.of(further, further.duration)
        return holding(self.scene.spacecraft, self.total, state)

    def result(self) -> TimelinePlan:
        """Return the plan of all that was done, with one trajectory and certificate over all parts."""
        failed = next((one for one in self.activities if not one.ok), None)
        trajectory = certificate = None
        status, message = Status.OK, ""
        if self.parts:
            begun = clock.monotonic()
            trajectory = curves.joined(self.parts)
            certificate = proving.merged(self.proofs)
            self.seconds["proof"] += clock.monotonic() - begun
            if not certificate.certified:
                status, message = Status.UNCERTIFIED, "; ".join(certificate.faults)
        if failed is not None:
            told = f"activity {failed.name}: {failed.message}"
            status, message = failed.status, "; ".join(filter(None, (told, message)))
        return TimelinePlan(
            timeline=self.timeline,
            status=status,
            message=message,
            activities=tuple(self.activities),
            segments=tuple(self.segments),
            trajectory=trajectory,
            certificate=certificate,
            choices=tuple(self.choices),
            timings=dict(self.seconds),
        )


def first_again(timeline: Timeline, kept: TimelinePlan, name: str) -> int:
    """Return the index of the activity, in order of execution, from which a timeline is planned anew.

    Args:
        timeline: the timeline to plan.
        kept: an earlier plan, which is kept before that activity.
        name: name of the activity.

    Raises:
        TypeError: if `kept` is no plan of a timeline, or `name` no text.
        ValueError: if there is no such activity, or if what comes before it is not what was planned.
    """
    expect("after", kept, TimelinePlan, "jp.plan_timeline makes one")
    expect("from_activity", name, str)
    names = [one.name for one in in_order(timeline.activities)]
    if name not in names:
        raise ValueError(f"from_activity = {name!r}: no such activity, {nearest(name, names, 'names')}")
    first = names.index(name)
    if [one.name for one in kept.activities[:first]] != names[:first]:
        raise ValueError(f"after: the activities before {name} are not those of the timeline")
    _expect_unchanged(timeline, kept, names[:first])
    return first


def _expect_unchanged(timeline: Timeline, kept: TimelinePlan, names: Sequence[str]) -> None:
    """Raise ValueError if start, epoch or an activity of these names differs from that in a kept plan."""
    were, are = ({one.name: one for one in own.activities} for own in (kept.timeline, timeline))
    for own in names:
        changed = [
            part.name
            for part in fields(Activity)
            if not same(getattr(were.get(own), part.name, None), getattr(are[own], part.name))
        ]
        if changed:
            raise ValueError(
                f"after: activity {own} differs from the one that was planned in "
                f"{', '.join(changed)}: plan anew from it on, by from_activity, or leave it as it was"
            )
    for part in ("start", "epoch"):  # from which the motion and all times count
        if not same(getattr(kept.timeline.scene, part), getattr(timeline.scene, part)):
            raise ValueError(
                f"after: the {part} differs from the one that was planned: plan the whole timeline"
            )
