"""Spacecraft, orbits and targets for the tests of timelines, and what a plan does by numpy and scipy alone.

Orbits are circles about a round Earth that turns at a steady rate, so that where a target is at any time is a
formula, of which the planner only has samples. Positions are in km, inertial, times in s, angles in rad
unless a name or text says deg.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from reference import angle, attitudes_of, boresights, joints_of, unit
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.directions import DirectionPath
from jaxplan.model.hidden_spans import Hidden
from jaxplan.trajectory.curve import Trajectory

EARTH, ATTRACTION, DAY = 6378.137, 398600.4418, 7.292115e-5  # km, km^3/s^2, rad/s of the Earth's turn
LAST = 3000.0  # s, until when targets are known
STEP = 10.0  # s between their samples, by which a neighbour in orbit is known to 1e-9 rad
FINE = 1.0  # s between those of what is passed over closely, likewise


def deg(*angles):
    """Angles, deg, in rad."""
    return np.deg2rad(angles if len(angles) != 1 else angles[0])


# Where things are.


@dataclass(frozen=True)
class Orbit:
    """A circular orbit: altitude in km, the others in deg; latitude is the argument of latitude at 0 s."""

    altitude: float
    inclination: float
    node: float
    latitude: float

    def position(self, time):
        """(k, 3) at times (k,)."""
        radius = EARTH + self.altitude
        along = np.deg2rad(self.latitude) + np.sqrt(ATTRACTION / radius**3) * np.asarray(time)
        flat = radius * np.stack([np.cos(along), np.sin(along), 0 * along], axis=-1)
        return Rotation.from_euler("ZX", [self.node, self.inclination], degrees=True).apply(flat)

    def normal(self):
        """(3,) unit vector."""
        turn = Rotation.from_euler("ZX", [self.node, self.inclination], degrees=True)
        return turn.apply([0.0, 0.0, 1.0])

    def frame(self, time):
        """(3, 3) attitude whose x is along the motion, and z away from the Earth."""
        up = unit(self.position(np.atleast_1d(time))[0])
        return np.stack([np.cross(self.normal(), up), self.normal(), up], axis=1)


@dataclass(frozen=True)
class Aim:
    """A target: function of times (k,) to unit vectors (k, 3), s between samples, and when it is hidden."""

    at: Callable[[np.ndarray], np.ndarray]
    step: float = STEP
    hidden: tuple[Hidden, ...] = ()

    def path(self, last: float = LAST) -> DirectionPath:
        """The path that the planner is given, through samples until a time."""
        times = np.arange(0.0, last + self.step / 2, self.step)
        found = DirectionPath.through(times, self.at(times))
        return DirectionPath(
            samples=found.samples, times=found.times, slopes=found.slopes, hidden=self.hidden
        )


def satellite(orbit: Orbit, seen_from: Orbit) -> Aim:
    """Another satellite."""
    return Aim(lambda time: unit(orbit.position(time) - seen_from.position(time)))


def site(beneath: Orbit, time: float, beside: float = 0.0, last: float = LAST) -> Aim:
    """The place on the ground over which a satellite flies at a time, or some deg beside its track.

    It is hidden while it is below its horizon, which is looked at until a last time.
    """
    up = unit(beneath.position(np.array([time]))[0])
    place = EARTH * Rotation.from_rotvec(np.deg2rad(beside) * np.cross(beneath.normal(), up)).apply(up)

    def position(at):
        turned = DAY * (np.atleast_1d(at) - time)
        return Rotation.from_rotvec(turned[:, None] * [0.0, 0.0, 1.0]).apply(place)

    def high(at):
        return np.sum(position(at) * (beneath.position(np.atleast_1d(at)) - position(at)), axis=1)

    every = np.arange(0.0, last + 0.5, 1.0)
    below = np.concatenate([[False], high(every) < 0, [False]])
    begins, ends = (
        np.flatnonzero(np.diff(below.astype(int)) == 1),
        np.flatnonzero(np.diff(below.astype(int)) == -1),
    )
    spans = tuple(
        Hidden(target=f"site at {time:g}", by="its horizon", start=float(a), end=float(min(b, last)))
        for a, b in zip(begins, ends, strict=True)
    )
    return Aim(lambda at: unit(position(at) - beneath.position(at)), step=FINE, hidden=spans)


# The link satellite: four terminals, and zones about the Sun and the Earth.

MINE = Orbit(550.0, 53.0, 0.0, 0.0)
LINKS = {
    "fore": satellite(Orbit(550.0, 53.0, 0.0, 18.0), MINE),
    "aft": satellite(Orbit(550.0, 53.0, 0.0, -18.0), MINE),
    "east": satellite(Orbit(550.0, 53.0, 12.0, -5.0), MINE),
    "west": satellite(Orbit(550.0, 53.0, -12.0, -6.0), MINE),
}
OTHERS = {
    "east": satellite(Orbit(550.0, 53.0, 12.0, 6.0), MINE),
    "west": satellite(Orbit(550.0, 53.0, -12.0, 5.0), MINE),
}
SUN = unit(np.array([0.05, 0.92, 0.39]))
NADIR = Aim(lambda time: -unit(MINE.position(time)))


def relay() -> jp.Spacecraft:
    """The link satellite."""
    return jp.Spacecraft(
        terminals=tuple(
            jp.Terminal(
                name=name,
                mount=deg(mount),
                yaw_limit=deg(80),
                pitch_limit=deg(40),
                rate_limit=deg(6),
                acceleration_limit=deg(4),
            )
            for name, mount in (("fore", 0), ("aft", 180), ("east", -90), ("west", 90))
        ),
        rate_limit=deg(1.0),
        acceleration_limit=deg(0.5),
    )


def relay_zones() -> tuple[jp.KeepOut, ...]:
    """Zones of the link satellite."""
    earth = np.arcsin(EARTH / (EARTH + 550.0))
    return (
        jp.KeepOut(name="sun", direction=SUN, half_angle=deg(8)),
        jp.KeepOut(name="earth", direction=NADIR.path(), half_angle=float(earth) + deg(1)),
    )


def links(*others: str, **more) -> jp.Targets:
    """Targets of all four terminals; of those named, the other neighbour."""
    aims = LINKS | {name: OTHERS[name] for name in others}
    return jp.Targets.of({name: aim.path() for name, aim in aims.items()}, tolerance=deg(0.01), **more)


def relay_scene(**more) -> jp.Scenario:
    """The link satellite, pointing at its neighbours at the start."""
    start = jp.point(
        relay(),
        {name: aim.at(np.zeros(1))[0] for name, aim in LINKS.items()},
        attitude=MINE.frame(0.0),
    )
    given = {"spacecraft": relay(), "keep_out": relay_zones(), **more}
    return jp.Scenario(name="relay", start=start, goal=start, **given)


# The observer: telescope, second camera, antenna, solar array and four wheels.

LOW = Orbit(520.0, 97.5, 10.0, 20.0)
INERTIA = np.array([[80.0, 3.0, 0.0], [3.0, 110.0, -4.0], [0.0, -4.0, 95.0]])
AXES = unit(np.array([[1.0, 1, 1], [-1, 1, 1], [1, -1, 1], [-1, -1, 1]]))


def observer() -> jp.Spacecraft:
    """A spacecraft with one device or more of each kind."""
    return jp.Spacecraft(
        terminals=(
            jp.Terminal(
                name="antenna",
                mounting=jp.Mount(yaw_axis=np.array([0.0, 0, 1]), boresight=np.array([1.0, 0, 0])),
                yaw_range=deg(-170.0, 170.0),
                pitch_range=deg(-85.0, 85.0),
                rate_limit=deg(4.0),
                acceleration_limit=deg(1.0),
            ),
        ),
        drives=(
            jp.Drive(
                name="array",
                axis=np.array([0.0, 1, 0]),
                boresight=np.array([0.0, 0, -1]),
                range=deg(-180.0, 180.0),
                rate_limit=deg(1.0),
                acceleration_limit=deg(0.2),
            ),
        ),
        instruments=(
            jp.Instrument(name="telescope", boresight=np.array([0.0, 0, 1])),
            jp.Instrument(name="camera", boresight=unit(np.array([0.1, 0, 1]))),
        ),
        rate_limit=deg(2.0),
        acceleration_limit=deg(0.5),
        inertia=INERTIA,
        wheels=tuple(
            jp.Wheel(name=f"wheel-{number}", axis=axis, torque=3.0, momentum=20.0, stored=stored)
            for number, (axis, stored) in enumerate(zip(AXES, (0.5, 0.2, -0.4, 1.0), strict=True), 1)
        ),
    )


def observer_zones() -> tuple[jp.KeepOut, ...]:
    """The telescope stays away from the Sun."""
    return (jp.KeepOut(name="sun", direction=SUN, half_angle=deg(30), devices=("telescope",)),)


def observer_scene(**more) -> jp.Scenario:
    """The observer at rest, its telescope to the nadir of the start."""
    attitude = LOW.frame(0.0) @ np.diag([1.0, -1, -1])
    start = jp.GivenState(rotation_vector=Rotation.from_matrix(attitude).as_rotvec(), joints=np.zeros(3))
    given = {"spacecraft": observer(), "keep_out": observer_zones(), **more}
    return jp.Scenario(name="observer", start=start, goal=start, **given)


# What a plan does.


def beams(trajectory: Trajectory, craft: jp.Spacecraft, time: np.ndarray) -> np.ndarray:
    """Directions (k, D, 3) of all devices at times (k,)."""
    return boresights(craft, attitudes_of(trajectory, time), joints_of(trajectory, time, orders=1)[0])


def misses(trajectory, craft, aims: dict[str, Aim], time: np.ndarray) -> np.ndarray:
    """Angles (k, n) rad between devices and where their targets truly are, at times (k,)."""
    found = beams(trajectory, craft, time)
    names = list(craft.device_names)
    return np.stack([angle(found[:, names.index(name)], aim.at(time)) for name, aim in aims.items()], axis=1)
