"""A partly planned timeline: what is planned so far, and the state in which that ends."""

import time as clock
from copy import copy
from dataclasses import replace
from typing import Self

import numpy as np

from jaxplan.certificate import Certificate
from jaxplan.model.activities import Segment, Timeline
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.planner.validity import start_breaches
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
