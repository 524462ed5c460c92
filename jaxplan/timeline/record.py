"""The record of a timeline's plan: its trajectory, what became of each activity, what is proved of all."""

import os
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from jaxplan.certificate import Certificate
from jaxplan.model.activities import Segment, Timeline
from jaxplan.model.export_names import ExportNames
from jaxplan.model.scenario import Scenario
from jaxplan.model.status import Status
from jaxplan.planner.record import report_summary
from jaxplan.runtime.display import aligned, as_table, in_columns, shown
from jaxplan.timeline.choices import Choice
from jaxplan.timeline.files import read_plan, save_plan
from jaxplan.timeline.interruptions import Interruption, interruptions
from jaxplan.timeline.proving import certify_segments
from jaxplan.trajectory import Trajectory

_TABLE_HEAD = ("activity", "start s", "end s", "slew s", "error deg", "status")
# What a user of a timeline may change, where that is not what one of a single manoeuvre may.
_ADVICE = {
    Status.INVALID_GOAL: (
        "Change what the activity asks for, the zone or limit that it breaks, or when it may begin."
    ),
    Status.GOAL_UNREACHABLE: (
        "Change the activity's targets or its window, widen the range or shrink the zone in the way, or do "
        "not bind the device to it."
    ),
    Status.LIMITS_TOO_TIGHT: (
        "The message names the limit. If a motion exceeds it, let the activity begin later or what comes "
        "before it end sooner, choose targets that move less fast, or raise that limit; if wheels are full "
        "by what they store, only what the message says helps."
    ),
    Status.INFEASIBLE: "Let the activity begin at another time, or after something else.",
    Status.UNCERTIFIED: (
        "The message says what could not be proved. A larger search.clearance_deg helps slews along zones, "
        "a larger tolerance_deg what points, more room to limits and zones all else."
    ),
}


@shown("name", "status", "message", "start s", "end s", "slew s", "pointing_error deg")
@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedActivity:
    """What became of an activity.

    Attributes:
        name: of the activity.
        kind: "track", "point", "attitude" or "idle".
        status: how its planning ended.
        message: for the user, what is in the way and what to change; empty when there is nothing to say.
        start: s, from the timeline's start on; None if it is not planned.
        end: s; None likewise.
        slew: s, duration of the slew that ends at the activity; None likewise. If the platform rests on the
            way, an earlier slew leads to that rest; both are segments of their own.
        pointing_error: rad, upper bound, at all its times, of the angle between any device and its target;
            infinite if none could be proved, None where nothing is tracked.
    """

    name: str
    kind: str
    status: Status
    message: str = ""
    start: float | None = None
    end: float | None = None
    slew: float | None = None
    pointing_error: float | None = None

    @property
    def ok(self) -> bool:
        """Whether the activity is planned."""
        return self.status is Status.OK


@shown("status", "message", "activities", "trajectory.duration s", heading="Plan of {0.timeline.name}")
@dataclass(frozen=True, kw_only=True, eq=False)
class TimelinePlan:
    """The answer to a timeline.

    Attributes:
        timeline: what was asked.
        status: how planning ended: that of the first activity that is not planned, else of the certificate.
        message: for the user; empty when there is nothing to say.
        activities: what became of each activity that was tried, in order of execution.
        segments: slews and activities in order of time, without gaps.
        trajectory: the whole motion as a function of time; None where nothing is planned.
        certificate: what is proved of the trajectory.
        choices: how each activity came to begin, see `jaxplan.timeline.choices`. They are not stored in
            files, so a plan that was loaded has none.
        timings: computation times in seconds, by step; the one part that is not deterministic.
    """

    timeline: Timeline
    status: Status
    message: str = ""
    activities: tuple[PlannedActivity, ...] = ()
    segments: tuple[Segment, ...] = ()
    trajectory: Trajectory | None = None
    certificate: Certificate | None = None
    choices: tuple[Choice, ...] = ()
    timings: dict[str, float] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether all activities are planned, and the motion is certified."""
        return self.status is Status.OK

    @property
    def not_done(self) -> tuple[str, ...]:
        """Names of the activities that are not planned, in the timeline's order."""
        done = {one.name for one in self.activities if one.ok}
        return tuple(one.name for one in self.timeline.activities if one.name not in done)

    @property
    def advice(self) -> str:
        """What a user may change, in a sentence or two; empty if the plan is certified."""
        return _ADVICE.get(self.status, self.status.advice)

    @property
    def scene(self) -> Scenario:
        """The timeline's spacecraft, start, zones and settings."""
        return self.timeline.scene

    @property
    def scenario(self) -> Scenario:
        """The scene, under the name that plans of single manoeuvres use."""
        return self.timeline.scene

    @property
    def names(self) -> ExportNames | None:
        """What exported files call the spacecraft; None to export without such names."""
        return self.timeline.names

    def certify(self) -> Certificate:
        """Certify the plan anew; nothing in it is trusted except what was asked.

        Returns:
            The certificate, whose `faults` list what could not be proved. It covers that each planned
            activity is done within its window, for its duration and in its state, and that devices point
            within their tolerances.

        Raises:
            ValueError: if the plan has no trajectory.
        """
        if self.trajectory is None:
            raise ValueError(
                f"the plan of {self.timeline.name} has no trajectory: it ended as {self.status.name}"
            )
        nothing = float("nan")
        done = {
            one.name: (
                nothing if one.start is None else one.start,
                nothing if one.end is None else one.end,
            )
            for one in self.activities
            if one.ok
        }
        return certify_segments(self.timeline, self.trajectory, self.segments, done, whole=self.ok)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the plan to one compressed file, see `jaxplan.timeline.files`, without computation times."""
        save_plan(self, path)

    @property
    def pointing_error(self) -> float | None:
        """Largest proved pointing error of the activities, rad; None where nothing is tracked."""
        known = [one.pointing_error for one in self.activities if one.pointing_error is not None]
        return max(known, default=None)

    @property
    def slews(self) -> tuple[Segment, ...]:
        """All slews in order of time, to activities and to rests on the way to one."""
        return tuple(one for one in self.segments if one.kind == "slew")

    @property
    def slews_to_rests(self) -> int:
        """Number of slews that end in a rest on the way to an activity."""
        return len(self.slews) - len({one.name for one in self.slews})

    @cached_property
    def interruptions(self) -> tuple[Interruption, ...]:
        """Times in which slews interrupt devices with the same target before and after, in order."""
        if self.trajectory is None:
            return ()
        return interruptions(self.timeline, self.segments, self.trajectory)

    def rows(self) -> list[tuple[str, str]]:
        """Return the plan as (label, value) rows for a table, without computation times."""
        rows = [("status", self.status.name)]
        if self.message:
            rows.append(("", self.message))
            rows += [("", self.advice)] * bool(self.advice)
        asked = len(self.timeline.activities)
        rows.append(("activities", f"{asked - len(self.not_done)} of {asked} planned"))
        if slews := [one.end - one.start for one in self.slews]:
            rests = f", {self.slews_to_rests} of them to rests on the way" * (self.slews_to_rests > 0)
            most = f"{sum(slews):.1f} s in all, {max(slews):.1f} s the longest"
            rows.append(("slews", f"{len(slews)}{rests}, {most}"))
        if broken := [one.duration for one in self.interruptions]:
            most = f"{sum(broken):.1f} s in all, {max(broken):.1f} s the longest"
            rows.append(("interruptions", f"{len(broken)} of targets that stay, {most}"))
        if self.trajectory is not None:
            rows.append(("duration", f"{self.trajectory.duration:.2f} s, C{self.trajectory.smoothness}"))
        if self.pointing_error is not None:
            rows.append(("pointing", f"within {np.rad2deg(self.pointing_error):.2g} deg of every target"))
        if self.certificate is not None:
            rows += self.certificate.rows()
        return rows

    def summary(self) -> dict[str, Any]:
        """Return the plan as a dict of plain values in the units of files, computation times included."""
        return {
            "name": self.timeline.name,
            "status": self.status.name,
            "message": self.message,
            "activities": [_activity_summary(one) for one in self.activities],
            "segments": [
                {"name": one.name, "kind": one.kind, "start_s": one.start, "end_s": one.end}
                for one in self.segments
            ],
            "interruptions": [
                {
                    "device": one.device,
                    "before": one.before,
                    "after": one.after,
                    "start_s": one.start,
                    "end_s": one.end,
                    "off_deg": _to_degrees(one.off),
                }
                for one in self.interruptions
            ],
            "duration_s": None if self.trajectory is None else self.trajectory.duration,
            "pointing_error_deg": _to_degrees(self.pointing_error),
            **report_summary(self.certificate),
            "timings_s": dict(self.timings),
        }

    def table(self) -> str:
        """Return a text table with a line for each activity: its times, slew, pointing error and status."""
        tried = {one.name for one in self.activities}
        left = [name for name in self.not_done if name not in tried]
        cells = [
            (
                one.name,
                _format_cell(one.start, ".2f"),
                _format_cell(one.end, ".2f"),
                _format_cell(one.slew, ".2f"),
                _format_cell(None if one.pointing_error is None else np.rad2deg(one.pointing_error), ".1e"),
                one.status.name,
            )
            for one in self.activities
        ]
        cells += [("not tried", "", "", "", "", ", ".join(left))] * bool(left)
        head, *lines = in_columns([_TABLE_HEAD, *cells], "<>>>><")
        below = " " * (2 + max(len(row[0]) for row in (_TABLE_HEAD, *cells)))
        messages = [*(one.message for one in self.activities), *[""] * bool(left)]
        told = [
            [line, *[below + message] * bool(message)] for line, message in zip(lines, messages, strict=True)
        ]
        return "\n".join([head, *chain.from_iterable(told)])

    def __str__(self) -> str:
        lines = [f"Plan of {self.timeline.name}"]
        lines += [f"  {line}" for line in aligned(self.rows())]
        return "\n".join([*lines, "", self.table()])

    def _repr_html_(self) -> str:
        return as_table(f"Plan of {self.timeline.name}", self.rows())


def load_timeline_plan(path: str | os.PathLike[str]) -> TimelinePlan:
    """Read a plan of a timeline from a file that `TimelinePlan.save` wrote.

    Args:
        path: the file.

    Returns:
        The plan: its trajectory is the same to the last bit; computation times and choices are missing.

    Raises:
        PlanFileError: if the file is missing, too large, or not a plan of a timeline.

    Example:
        >>> day = jp.load_timeline_plan("out/plan.npz")
        >>> day.certify().certified
    """
    read = read_plan(path)
    return TimelinePlan(
        **read
        | {
            "activities": tuple(PlannedActivity(**one) for one in read["activities"]),
            "segments": tuple(Segment(**one) for one in read["segments"]),
        }
    )


def _activity_summary(one: PlannedActivity) -> dict[str, Any]:
    """Return what became of an activity as a dict in the units of files."""
    return {
        "name": one.name,
        "kind": one.kind,
        "status": one.status.name,
        "message": one.message,
        "start_s": one.start,
        "end_s": one.end,
        "slew_s": one.slew,
        "pointing_error_deg": _to_degrees(one.pointing_error),
    }


def _to_degrees(angle: float | None) -> float | None:
    """Convert an angle from rad to degrees; None for None, and for infinity, which JSON cannot write."""
    return None if angle is None or not np.isfinite(angle) else float(np.rad2deg(angle))


def _format_cell(value: float | None, form: str) -> str:
    """Return a number as text in the given format; a dash for None."""
    return "-" if value is None else f"{value:{form}}"


class TimelineError(Exception):
    """Raised by `plan_timeline` where an activity cannot be planned, or the motion not certified.

    Attributes:
        plan: what was found before planning failed.
        status: why it failed.
    """

    def __init__(self, plan: TimelinePlan) -> None:
        self.plan, self.status = plan, plan.status
        super().__init__(plan)

    def __str__(self) -> str:
        return f"{self.status.name}: {self.status.value}. {self.plan.message}".strip()
