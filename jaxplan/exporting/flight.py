"""The motion that an export writes: that of one plan, or of a whole day.

A `Flight` is made from a plan, which is one manoeuvre without segments, or from a `Day`. That is any object
with the few attributes named there, whatever its class.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from jaxplan.model.export_names import ExportNames
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.planner import Plan, certify
from jaxplan.runtime.arguments import expect, number
from jaxplan.trajectory import Trajectory

APART = 1e-6  # s: instants closer together would coincide in files that count seconds from the year 2000
HELD_S = 1.0
"""s: for which tables hold a motion that takes no time, as readers need two rows."""


class UncertifiedError(ValueError):
    """A plan or day is not written, because its motion or its table is not certified."""


class DaySegment(Protocol):
    """A part of a day: an activity, or a slew between activities.

    Attributes:
        name: name of the activity or slew.
        kind: one word, such as ``"slew"`` or ``"track"``.
        start: s from the epoch.
        end: s from the epoch.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def kind(self) -> str: ...  # noqa: D102
    @property
    def start(self) -> float: ...  # noqa: D102
    @property
    def end(self) -> float: ...  # noqa: D102


class Proof(Protocol):
    """The result of certifying a motion: whether all is proved, and a sentence for each thing that is not."""

    @property
    def certified(self) -> bool: ...  # noqa: D102
    @property
    def faults(self) -> Sequence[str]: ...  # noqa: D102


class Day(Protocol):
    """A motion of many activities and slews, with what exports need of it.

    It may also have an attribute ``names``, an `ExportNames` or None, which is used where `export` gets none.

    Attributes:
        ok: whether it is certified.
        scene: the scene, with name, spacecraft and epoch.
        trajectory: over the whole day; None where there is none.
        segments: its parts in order; each begins where the one before ends, from 0 to the duration.
    """

    @property
    def ok(self) -> bool: ...  # noqa: D102
    @property
    def scene(self) -> Scenario: ...  # noqa: D102
    @property
    def trajectory(self) -> Trajectory | None: ...  # noqa: D102
    @property
    def segments(self) -> Sequence[DaySegment]: ...  # noqa: D102

    def certify(self) -> Proof:
        """Certify the motion anew, without relying on earlier results."""
        ...


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A part of a flight that has a name in files.

    Attributes:
        name: name of the activity or slew.
        kind: one word, such as ``"slew"`` or ``"track"``.
        start: s from the epoch.
        end: s from the epoch; never before the start.
    """

    name: str
    kind: str
    start: float
    end: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Flight:
    """A motion to be exported.

    Attributes:
        name: name of the scenario.
        spacecraft: the one that moves.
        trajectory: the motion.
        start: UTC of time zero; None where that is not known.
        segments: parts without gaps from 0 to the duration; empty for a single manoeuvre.
        names: how files call things where the user gives no names; None for defaults.
        cones: keep-out and keep-in zones, to be drawn.
    """

    name: str
    spacecraft: Spacecraft
    trajectory: Trajectory
    start: np.datetime64 | None
    segments: tuple[Segment, ...] = ()
    names: ExportNames | None = None
    cones: tuple[KeepOut | KeepIn, ...] = ()

    @property
    def boundaries(self) -> np.ndarray:
        """(b,) s, rising: starts of segments and the end of the last; those that coincide only once."""
        ends = (each.end for each in self.segments)
        times = np.unique([0.0, *ends, self.trajectory.duration])
        kept = times[np.concatenate([[True], np.diff(times) > APART])]
        if len(kept) > 1:
            kept[-1] = self.trajectory.duration
        return np.asarray(kept)


def flight_of(subject: Plan | Day) -> Flight:
    """Return what is exported of a plan or day; it must be certified, but is not certified anew here.

    Args:
        subject: the plan or day.

    Raises:
        TypeError: if its ``names`` are no `ExportNames`.
        UncertifiedError: if it is not certified, or has no trajectory.
        ValueError: if its segments have gaps, or their times are no numbers.
    """
    scene, trajectory = scene_of(subject), subject.trajectory
    parts = () if isinstance(subject, Plan) else tuple(subject.segments)
    if trajectory is None or not subject.ok:
        raise UncertifiedError(ending(subject))
    names = getattr(subject, "names", None)
    if names is not None:
        expect("names of the day", names, ExportNames)
    return Flight(
        name=scene.name,
        spacecraft=scene.spacecraft,
        trajectory=trajectory,
        start=scene.epoch,
        segments=_join_segments(parts, trajectory.duration),
        names=names,
        cones=(*scene.keep_out, *scene.keep_in),
    )


def held(flight: Flight) -> Flight:
    """Return a flight that takes no time as a rest of `HELD_S`, and any other as it is.

    A motion that takes no time starts and ends at rest, so its only polynomial is constant.
    """
    if len(flight.boundaries) > 1:
        return flight
    own = flight.trajectory
    breaks, joint_breaks = (np.append(each[:-1], HELD_S) for each in (own.breaks, own.joint_breaks))
    return replace(flight, trajectory=replace(own, breaks=breaks, joint_breaks=joint_breaks))


def proof_of(subject: Plan | Day) -> Proof:
    """Certify a plan or a day anew."""
    return certify(subject) if isinstance(subject, Plan) else subject.certify()


def scene_of(subject: Plan | Day) -> Scenario:
    """Return the scenario from which an export takes name and epoch: that of a plan, or of a whole day."""
    return subject.scenario if isinstance(subject, Plan) else subject.scene


def expect_motion(subject: object) -> None:
    """Raise a TypeError unless the object is a plan or has the attributes of a `Day`."""
    names = ("ok", "scene", "trajectory", "segments", "certify")
    if isinstance(subject, type) or not all(hasattr(subject, name) for name in names):
        expect("plan", subject, Plan, "jp.load_plan reads one from a file")


def ending(subject: Plan | Day) -> str:
    """Return a message on what an uncertified plan or day lacks, and how its planning ended."""
    lack = "has no trajectory" if subject.trajectory is None else "is not certified"
    status, message = (getattr(subject, name, "") for name in ("status", "message"))
    how = ": ".join(filter(None, [getattr(status, "name", str(status)), str(message)]))
    return f"the plan of {scene_of(subject).name} {lack}" + (f"; it ended as {how}" if how else "")


def _join_segments(parts: Sequence[Any], duration: float) -> tuple[Segment, ...]:
    """Turn the parts of a day into segments that meet exactly.

    Raises:
        ValueError: if one does not begin where the one before ends, to 1e-6 s, or ends before it begins; if
            the last one does not end with the motion.
    """
    segments: list[Segment] = []
    reached = 0.0
    for place, part in enumerate(parts):
        start, end = (
            number(f"segments[{place}].{key}", getattr(part, key), "a number of seconds")
            for key in ("start", "end")
        )
        if not abs(start - reached) <= APART:
            raise ValueError(
                f"segments[{place}].start = {start!r} s: must be {reached!r} s, where the one before ends"
            )
        if not start - APART <= end <= duration + APART:
            raise ValueError(
                f"segments[{place}].end = {end!r} s: must lie in [{start!r}, {duration!r}] s, the start of "
                "the segment and the end of the motion"
            )
        end = min(max(end, reached), duration)
        segments.append(Segment(name=str(part.name), kind=str(part.kind), start=reached, end=end))
        reached = end
    if parts and not abs(reached - duration) <= APART:
        raise ValueError(
            f"segments[{len(parts) - 1}].end = {reached!r} s: must be {duration!r} s, the end of the motion"
        )
    return tuple(segments)
