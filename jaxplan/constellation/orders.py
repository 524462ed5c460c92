"""The timeline of one satellite of a fleet: what a worker is sent, what it plans, and what comes back.

An order holds little, the satellite's orbit, its links from change to change and the orbits of those it is
linked to, so that it travels well; the worker makes the timeline of it. Each time between two changes is an
activity that follows the links, from as soon as the slew to them can end until the next change. Sun, Moon and
Earth are cones that move, as the satellite sees them. It starts at rates with which its terminals follow the
first links, in the attitude next to that with the body's x axis ahead and its z axis up; where no attitude is
fit for that, at rest in the latter, and the plan says what is in the way.
"""

import math
import tempfile
import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan import sky, so3
from jaxplan.constellation.schedule import LONGEST, LinkSchedule, Span
from jaxplan.constellation.switch import nominal_attitudes
from jaxplan.goal.pointing_start import NotPointingError, point
from jaxplan.model.directions import DirectionPath
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.timeline import Activity, Timeline
from jaxplan.model.zones import KeepOut
from jaxplan.runtime.jit import working_time
from jaxplan.schema.reading import with_settings
from jaxplan.timeline import PlannedActivity, TimelinePlan, plan_timeline
from jaxplan.version import __version__

CRASHED = "crashed"
_BEYOND = 120.0  # s after the end for which directions are known, in which late slews may be tried


@dataclass(frozen=True, kw_only=True, eq=False)
class Order:
    """A satellite that is to be planned.

    Attributes:
        satellite: its number.
        orbits: of it and of all that it is linked to, by number.
        spans: the times between changes of its links.
        spacecraft: what it is.
        epoch: UTC of the start.
        cones: rad, half angle of the keep-out cone of each body, by its name.
        tolerance: rad, by which a terminal may be off its link.
        slew: "shortest" or "calm".
        settings: that differ from the defaults, by dotted names in a file's keys and units.
        version: of jaxplan, which must be that of all who plan.
        deaths: how many workers died that had nothing else to do.
    """

    satellite: int
    orbits: Mapping[int, sky.CircularOrbit]
    spans: tuple[Span, ...]
    spacecraft: Spacecraft
    epoch: np.datetime64
    cones: Mapping[str, float]
    tolerance: float
    slew: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    version: str = __version__
    deaths: int = 0

    @property
    def scenes(self) -> tuple[int, ...]:
        """The number of the satellite, which alone says what is planned."""
        return (self.satellite,)

    @property
    def until(self) -> float:
        """When it all ends, s."""
        return self.spans[-1].end

    def timeline(self) -> Timeline:
        """The timeline that is to be planned; raises a ValueError where a link's direction turns too fast."""
        own, names = self.orbits[self.satellite], [one.name for one in self.spacecraft.terminals]
        known = min(self.until + _BEYOND, LONGEST)
        paths = {
            number: sky.path(orbit, epoch=self.epoch, observer=own, duration_s=known)
            for number, orbit in self.orbits.items()
            if number != self.satellite
        }
        zones = tuple(self._zone(body, half_angle, known) for body, half_angle in self.cones.items())
        links = [
            {name: paths[link] for name, link in zip(names, span.links, strict=True) if link in paths}
            for span in self.spans
        ]
        start = self._start(links[0], zones)
        scene = with_settings(
            Scenario(
                name=f"satellite {self.satellite}",
                epoch=self.epoch,
                spacecraft=self.spacecraft,
                start=start,
                goal=start,
                keep_out=zones,
            ),
            self.settings,
        )
        scene = replace(scene, search=replace(scene.search, time_limit=math.inf))
        activities = [
            Activity(
                name=span.name,
                track=Targets.of(targets, tolerance=self.tolerance) if targets else None,
                idle=not targets,
                earliest=span.start,
                latest=span.end,
            )
            for span, targets in zip(self.spans, links, strict=True)
        ]
        return Timeline(
            name=scene.name, scene=scene, activities=tuple(activities), until=self.until, slew=self.slew
        )

    def _zone(self, body: str, half_angle: float, known: float) -> KeepOut:
        """The cone of a body as it moves, for all terminals and for a time, s."""
        return KeepOut(
            name=body,
            direction=sky.path(
                body, epoch=self.epoch, observer=self.orbits[self.satellite], duration_s=known
            ),
            half_angle=half_angle,
            devices=tuple(one.name for one in self.spacecraft.terminals),
        )

    def _start(self, links: Mapping[str, DirectionPath], zones: tuple[KeepOut, ...]) -> GivenState:
        """The state in which the terminals follow their first links, or the nominal one at rest."""
        own = self.orbits[self.satellite]
        place, moving = (ask(own, epoch=self.epoch)[None] for ask in (sky.positions, sky.velocities))
        nominal = nominal_attitudes(place, moving)[0]
        if links:
            try:
                return point(self.spacecraft, links, attitude=nominal, keep_out=zones)
            except NotPointingError:
                pass  # the first activity tells what is in the way
        return GivenState(
            rotation_vector=np.asarray(so3.log(nominal)),
            joints=np.clip(np.zeros(self.spacecraft.joint_count), *self.spacecraft.joint_ranges.T),
        )


def order_of(
    schedule: LinkSchedule,
    satellite: int,
    *,
    tolerance: float,
    slew: str,
    settings: Mapping[str, Any],
) -> Order:
    """The order of one satellite of a schedule."""
    spans = tuple(schedule.spans(satellite))
    linked = {link for span in spans for link in span.links if link >= 0}
    shell = schedule.shell
    nodes, latitudes = shell.nodes, shell.latitudes
    return Order(
        satellite=satellite,
        orbits={
            number: sky.CircularOrbit(
                altitude=shell.altitude,
                inclination=shell.inclination,
                node=float(nodes[number]),
                latitude=float(latitudes[number]),
            )
            for number in sorted({satellite, *linked})
        },
        spans=spans,
        spacecraft=schedule.spacecraft,
        epoch=schedule.epoch,
        cones=dict(schedule.cones),
        tolerance=tolerance,
        slew=slew,
        settings=dict(settings),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Planned:
    """What comes back of an order.

    Attributes:
        satellite: its number.
        row: of the table.
        data: bytes of the plan's file; None where planning crashed.
        seconds: that it took, without those of compiling.
        steps: seconds by step.
    """

    satellite: int
    row: dict[str, Any]
    data: bytes | None
    seconds: float
    steps: Mapping[str, float] = field(default_factory=dict)


def plan_order(order: Order) -> Planned:
    """Plan a satellite; an error that planning must not raise makes a row with status "crashed".

    Raises:
        RuntimeError: if the order is from another version of jaxplan, which may plan otherwise.
    """
    if order.version != __version__:
        raise RuntimeError(
            f"a worker has jaxplan {__version__}, the fleet is planned by {order.version}: "
            "install the same on all machines"
        )
    began, since = working_time(), clock.monotonic()
    try:
        timeline = order.timeline()
        made = clock.monotonic() - since
        plan = plan_timeline(timeline, throw=False, go_on=True, progress=False)
    except Exception as error:
        return given_up(order, f"{type(error).__name__}: {error}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "plan.npz"
        plan.save(file)
        data = file.read_bytes()
    return Planned(
        satellite=order.satellite,
        row=row_of(order, plan),
        data=data,
        seconds=working_time() - began,
        steps={"timeline": made, **plan.timings},
    )


def given_up(order: Order, why: str) -> Planned:
    """The answer for a satellite whose planning raised an error, or killed its worker."""
    return Planned(satellite=order.satellite, row=row_of(order, None, why), data=None, seconds=0.0)


# Of each column of the table the type, beside None.
COLUMNS: Mapping[str, type] = {
    "satellite": int,
    "status": str,
    "message": str,
    "certified": bool,  # the motion, at every instant
    "activities": int,  # times between changes of links
    "planned": int,  # of these
    "linked_s": float,  # of all terminals, that they follow their links
    "scheduled_s": float,  # of all terminals, that they have links
    "slews": int,
    "slew_s": float,  # of all slews
    "longest_slew_s": float,
    "pointing_error_deg": float,  # the largest, proved
    "min_margin_deg": float,  # the smallest to a zone, proved
    "worst_device": str,
    "worst_zone": str,
}


def row_of(order: Order, plan: TimelinePlan | None, why: str = "") -> dict[str, Any]:
    """A satellite's row of `COLUMNS`; of one without a plan `why` says what happened."""
    counts = [sum(link >= 0 for link in span.links) for span in order.spans]
    row: dict[str, Any] = dict.fromkeys(COLUMNS)
    row |= {
        "satellite": order.satellite,
        "status": CRASHED,
        "message": why,
        "certified": False,
        "activities": len(order.spans),
        "planned": 0,
        "linked_s": 0.0,
        "slews": 0,
        "slew_s": 0.0,
        "longest_slew_s": 0.0,
        "scheduled_s": float(
            sum((span.end - span.start) * count for span, count in zip(order.spans, counts, strict=True))
        ),
    }
    if plan is None:
        return row
    done = [one for one in plan.activities if one.ok]
    slews = [one.slew for one in done if one.slew]
    terminals = {span.name: count for span, count in zip(order.spans, counts, strict=True)}
    proof, error = plan.certificate, plan.pointing_error
    row |= {
        "status": plan.status.name,
        "message": plan.message,
        "certified": proof is not None and bool(proof.certified),
        "planned": len(done),
        "linked_s": float(sum(_lasting(one) * terminals.get(one.name, 0) for one in done)),
        "slews": len(slews),
        "slew_s": float(sum(slews)),
        "longest_slew_s": float(max(slews, default=0.0)),
        "pointing_error_deg": None if error is None or not math.isfinite(error) else math.degrees(error),
    }
    if proof is not None and proof.min_margin is not None:
        row["min_margin_deg"] = math.degrees(proof.min_margin)
        row["worst_device"], row["worst_zone"] = proof.worst_device, proof.worst_zone
    return row


def _lasting(activity: PlannedActivity) -> float:
    """How long a planned activity takes, s."""
    assert activity.start is not None
    assert activity.end is not None
    return activity.end - activity.start
