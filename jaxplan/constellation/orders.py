"""The timeline of one satellite of a fleet: what a worker receives, how it plans, and what it sends back.

An `Order` is small, so that it is cheap to send: the satellite's orbit, its links from change to change, and
the orbits of the satellites that it is linked to. The worker builds the timeline from it. Each time between
two changes of links is an activity: it begins as soon as the slew to the links can end, follows them, and
ends with the next change. Sun, Moon and Earth are keep-out cones that move as the satellite sees them.

The satellite starts with its terminals on its first links and with rates that keep them there, in the
attitude nearest to the nominal one (x axis of the body in the direction of flight, z axis away from the
Earth). Where no attitude allows that, it starts at rest in the nominal attitude, and the plan says what is in
the way.
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
from jaxplan.constellation.link_schedules import LONGEST, LinkSchedule, Span
from jaxplan.constellation.switch import nominal_attitudes
from jaxplan.goal.pointing_start import NotPointingError, point
from jaxplan.model.activities import Activity, Timeline
from jaxplan.model.directions import DirectionPath
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepOut
from jaxplan.runtime.stopwatch import working_time
from jaxplan.schema.reading import with_settings
from jaxplan.timeline import PlannedActivity, TimelinePlan, plan_timeline
from jaxplan.version import __version__

CRASHED = "crashed"
_EXTRA_DIRECTION_TIME = 120.0  # s after the end with known directions, so that late slews can be tried


@dataclass(frozen=True, kw_only=True, eq=False)
class Order:
    """What a worker needs to plan one satellite.

    Attributes:
        satellite: number of the satellite.
        orbits: of it and of all satellites that it is linked to, by satellite number.
        spans: the times between changes of its links, in order and without gaps.
        spacecraft: the satellite's devices and limits.
        epoch: UTC of time zero.
        cones: half angle in rad of each body's keep-out cone, by the body's name ("sun", "moon", "earth").
        tolerance: rad, greatest angle between a terminal and its link.
        slew: "shortest" or "calm", see `Timeline`.
        settings: scenario settings that differ from the defaults, by dotted names in a scenario file's keys
            and units.
        version: of jaxplan where the order was made; a worker of another version refuses it.
        deaths: number of workers that have died while they planned this order and nothing else.
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
        """The satellite's number, as a tuple of one: `answers` asks what a part of the work consists of."""
        return (self.satellite,)

    @property
    def until(self) -> float:
        """Time in s at which the last span, and with it the timeline, ends."""
        return self.spans[-1].end

    def timeline(self) -> Timeline:
        """Make the timeline to be planned; its searches have no time limit.

        A span in which the satellite has no links becomes an idle activity.

        Raises:
            ValueError: if the direction of a link turns too fast.
        """
        own, names = self.orbits[self.satellite], [one.name for one in self.spacecraft.terminals]
        known = min(self.until + _EXTRA_DIRECTION_TIME, LONGEST)
        paths = {
            number: sky.path(orbit, epoch=self.epoch, observer=own, duration_s=known)
            for number, orbit in self.orbits.items()
            if number != self.satellite
        }
        zones = tuple(self._make_keep_out(body, half_angle, known) for body, half_angle in self.cones.items())
        links = [
            {name: paths[link] for name, link in zip(names, span.links, strict=True) if link in paths}
            for span in self.spans
        ]
        start = self._find_start(links[0], zones)
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

    def _make_keep_out(self, body: str, half_angle: float, known: float) -> KeepOut:
        """Make the moving keep-out cone of a body, for all terminals.

        Args:
            body: name of the body, as `sky.path` knows it.
            half_angle: rad, of the cone.
            known: s, until which the body's direction is computed.
        """
        return KeepOut(
            name=body,
            direction=sky.path(
                body, epoch=self.epoch, observer=self.orbits[self.satellite], duration_s=known
            ),
            half_angle=half_angle,
            devices=tuple(one.name for one in self.spacecraft.terminals),
        )

    def _find_start(self, links: Mapping[str, DirectionPath], zones: tuple[KeepOut, ...]) -> GivenState:
        """Find the state in which the terminals follow their first links, nearest to the nominal attitude.

        Args:
            links: direction of each linked terminal's first link, by the terminal's name.
            zones: keep-out cones that the state must keep.

        Returns:
            The state; the nominal attitude at rest if there are no links, or no state lets the terminals
            follow them.
        """
        own = self.orbits[self.satellite]
        place, moving = (ask(own, epoch=self.epoch)[None] for ask in (sky.positions, sky.velocities))
        nominal = nominal_attitudes(place, moving)[0]
        if links:
            try:
                return point(self.spacecraft, links, attitude=nominal, keep_out=zones)
            except NotPointingError:
                pass  # planning the first activity will say what is in the way
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
    """Make the order of one satellite of a schedule.

    Args:
        schedule: of the whole shell.
        satellite: its number.
        tolerance: rad, greatest angle between a terminal and its link.
        slew: "shortest" or "calm".
        settings: scenario settings that differ from the defaults.
    """
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
    """What a worker sends back for an order.

    Attributes:
        satellite: number of the satellite.
        row: its row of the fleet's table, with the columns `COLUMNS`.
        data: bytes of the plan's file (.npz); None where planning crashed.
        seconds: computation time, compilation excluded; 0 where planning crashed.
        steps: computation time in s of each planning step, by its name; empty where planning crashed.
    """

    satellite: int
    row: dict[str, Any]
    data: bytes | None
    seconds: float
    steps: Mapping[str, float] = field(default_factory=dict)


def plan_order(order: Order) -> Planned:
    """Plan the satellite of an order; an error raised while planning becomes a row with status "crashed".

    Raises:
        RuntimeError: if the order is from another version of jaxplan, which may plan differently.
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
    """Make the answer for a satellite without a plan, with status "crashed".

    Args:
        order: the satellite's order.
        why: message for the row: the error that planning raised, or that workers died.
    """
    return Planned(satellite=order.satellite, row=row_of(order, None, why), data=None, seconds=0.0)


# Columns of a fleet's table with their types; a value may also be None where it is not known.
COLUMNS: Mapping[str, type] = {
    "satellite": int,
    "status": str,
    "message": str,
    "certified": bool,  # whether the whole motion is proved
    "activities": int,  # number of times between changes of links
    "planned": int,  # number of these that are planned
    "linked_s": float,  # time that terminals follow their links, summed over terminals
    "scheduled_s": float,  # time that terminals have links, summed over terminals
    "slews": int,
    "slew_s": float,  # total duration of all slews
    "longest_slew_s": float,
    "pointing_error_deg": float,  # proved upper bound of the largest
    "min_margin_deg": float,  # proved lower bound of the smallest to a zone; positive where all are kept
    "worst_device": str,
    "worst_zone": str,
}


def row_of(order: Order, plan: TimelinePlan | None, why: str = "") -> dict[str, Any]:
    """Make a satellite's row of the fleet's table, with the columns `COLUMNS`.

    Args:
        order: the satellite's order.
        plan: its plan, which may have failed; None where planning crashed.
        why: what happened, where there is no plan; otherwise the plan's own message counts.

    Returns:
        The row; values that are not known are None.
    """
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
        "linked_s": float(sum(_activity_duration(one) * terminals.get(one.name, 0) for one in done)),
        "slews": len(slews),
        "slew_s": float(sum(slews)),
        "longest_slew_s": float(max(slews, default=0.0)),
        "pointing_error_deg": None if error is None or not math.isfinite(error) else math.degrees(error),
    }
    if proof is not None and proof.min_margin is not None:
        row["min_margin_deg"] = math.degrees(proof.min_margin)
        row["worst_device"], row["worst_zone"] = proof.worst_device, proof.worst_zone
    return row


def _activity_duration(activity: PlannedActivity) -> float:
    """Duration in s of a planned activity, from its start to its end."""
    assert activity.start is not None
    assert activity.end is not None
    return activity.end - activity.start
