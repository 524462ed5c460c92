"""Planned days made by hand, whose events have closed forms.

A platform with a telescope along x turns about z at a steady rate, so that the telescope is at an azimuth of
that rate times the time. A target goes along with it, above it by an error. There is a terminal, too, which
stays where it is.
"""

from dataclasses import replace

import numpy as np
from builders import at_rest, spacecraft_of
from reference import direction

import jaxplan as jp
from jaxplan.certificate import Certificate
from jaxplan.model.hidden_spans import Hidden
from jaxplan.model.status import Status
from jaxplan.timeline import PlannedActivity, Segment, TimelinePlan
from jaxplan.trajectory import Trajectory

RATE = np.deg2rad(0.5)  # rad/s
END = 720.0  # s: a turn
ERROR = np.deg2rad(1e-3)
TOLERANCE = np.deg2rad(0.01)
HIDDEN = (
    Hidden(target="site", by="its horizon", start=-5.0, end=90.0),
    Hidden(target="site", by="its horizon", start=450.0, end=600.0),
    Hidden(target="site", by="the Earth", start=590.0, end=650.0),
)
EPOCH = np.datetime64("2026-06-20T23:55:00")


def turning(end=END, joints=2):
    """The motion: a steady turn about z, joints at rest."""
    half = np.array([0.0, 0.0, RATE * end / 2])
    coefficients = np.zeros((1, 6, 3))
    coefficients[0, :2] = half
    return Trajectory(
        breaks=np.array([0.0, end]),
        chart_attitude=np.eye(3)[None],
        chart_start=np.zeros(1),
        chart_rate=np.array([[0.0, 0.0, RATE]]),
        coefficients=coefficients,
        joint_breaks=np.array([0.0, end]),
        joint_coefficients=np.zeros((1, 6, joints)),
        node_times=np.array([0.0, end]),
        smoothness=2,
        method="timeline",
    )


def zone(name, azimuth, elevation, half_angle, **more):
    """A keep-out zone that stands still, angles in deg; it binds the telescope unless more is said."""
    place = direction(np.deg2rad(azimuth), np.deg2rad(elevation))
    more = {"devices": ("telescope",)} | more
    return jp.KeepOut(name=name, direction=place, half_angle=np.deg2rad(half_angle), **more)


def target(hidden=HIDDEN):
    """The path of a target just above where the telescope looks."""
    times = np.linspace(0.0, END, 145)
    seen = direction(RATE * times, np.full(len(times), ERROR))
    return replace(jp.DirectionPath.through(times, seen), hidden=hidden)


def scene(*zones, craft=None, epoch=EPOCH):
    """The scene of a day."""
    own = spacecraft_of([0.0], {"telescope": np.array([1.0, 0.0, 0.0])}) if craft is None else craft
    start = jp.GivenState(
        rotation_vector=np.zeros(3),
        joints=np.zeros(own.joint_count),
        angular_velocity=np.array([0.0, 0.0, RATE]),
        joint_rates=np.zeros(own.joint_count),
    )
    still = at_rest(np.zeros(3), np.zeros(own.joint_count))
    return jp.Scenario(
        name="scene", spacecraft=own, start=start, goal=still, keep_out=tuple(zones), epoch=epoch
    )


def day(*zones, craft=None, epoch=EPOCH, hidden=HIDDEN, name="day", image="image"):
    """A day with a slew, an image from its window on, a second slew, rest, and one that is not planned."""
    place = scene(*zones, craft=craft, epoch=epoch)
    targets = jp.Targets.of({"telescope": target(hidden)}, tolerance=TOLERANCE)
    lost = jp.Targets.of({"telescope": np.array([0.0, 0.0, 1.0])}, tolerance=TOLERANCE)
    timeline = jp.Timeline(
        name=name,
        scene=place,
        activities=(
            jp.Activity(name=image, track=targets, earliest=120.0, latest=400.0),
            jp.Activity(name="lost", point=lost, earliest=410.0, latest=480.0),
            jp.Activity(name="rest", idle=True, latest=END),
        ),
    )
    message = "telescope cannot point there"
    return TimelinePlan(
        timeline=timeline,
        status=Status.GOAL_UNREACHABLE,
        message=f"activity lost: {message}",
        activities=(
            PlannedActivity(
                name=image,
                kind="track",
                status=Status.OK,
                start=120.0,
                end=400.0,
                slew=100.0,
                pointing_error=1.1 * ERROR,
            ),
            PlannedActivity(name="lost", kind="point", status=Status.GOAL_UNREACHABLE, message=message),
            PlannedActivity(name="rest", kind="idle", status=Status.OK, start=500.0, end=END, slew=100.0),
        ),
        segments=(
            Segment(name=image, kind="slew", start=0.0, end=100.0),
            Segment(name=image, kind="track", start=100.0, end=400.0),
            Segment(name="rest", kind="slew", start=400.0, end=500.0),
            Segment(name="rest", kind="idle", start=500.0, end=END),
        ),
        trajectory=turning(joints=place.spacecraft.joint_count),
        certificate=Certificate(
            certified=True,
            faults=(),
            min_margin=0.1,
            worst_time=180.0,
            worst_device="telescope",
            worst_zone="sun",
            peaks={"angular_velocity": 0.25},
            peak_times={"angular_velocity": 3.0},
            evaluations=7,
        ),
        timings={"motions": 1.0, "slews": 2.0, "proof": 0.5},
    )
