"""Spacecraft, scenarios, moving directions and plans that tests are made with.

All have the limits of the paper's spacecraft; angles in rad unless a name or text says deg.
"""

from dataclasses import replace
from pathlib import Path as File

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import poly2leg
from reference import direction, random_units, unit
from scipy.spatial.transform import Rotation

from jaxplan.certificate import Certificate
from jaxplan.model.devices import Drive, Instrument, Mount, Terminal
from jaxplan.model.directions import DirectionPath
from jaxplan.model.gimbals import Gimbals
from jaxplan.model.goals import GivenState
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario, SearchSettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.planner import Plan
from jaxplan.search import Scene, make_scene
from jaxplan.trajectory.curve import Trajectory

LOW_ORBIT = File(__file__).parent / "scenarios" / "low_orbit.toml"

# Spacecraft and scenarios.


def spacecraft_of(mounts, boresights: dict[str, np.ndarray]) -> Spacecraft:
    """Terminals named terminal-1, ... at their mounts, and instruments by name."""
    return Spacecraft(
        terminals=tuple(
            Terminal(
                name=f"terminal-{i + 1}",
                mount=float(mount),
                yaw_limit=np.pi / 2,
                pitch_limit=np.pi / 12,
                rate_limit=np.deg2rad(4.0),
                acceleration_limit=np.deg2rad(3.0),
            )
            for i, mount in enumerate(mounts)
        ),
        instruments=tuple(Instrument(name=name, boresight=axis) for name, axis in boresights.items()),
        rate_limit=np.deg2rad(3.0),
        acceleration_limit=np.deg2rad(2.0),
    )


def make_spacecraft(terminals: int = 3, instruments: int = 0) -> Spacecraft:
    """Terminals evenly around the z axis, and instruments camera-1, ... spread over the body."""
    mounts = np.deg2rad([0.0, 120.0, -120.0]) if terminals == 3 else 2 * np.pi * np.arange(terminals) / 16
    axes = random_units(np.random.default_rng(7), instruments)
    return spacecraft_of(mounts, {f"camera-{i + 1}": axis for i, axis in enumerate(axes)})


def make_observer(jerk_limit: float | None = None) -> Spacecraft:
    """An Earth observer: no two devices, axes, joints or limits of it are alike, and no range is about zero.

    A telescope and two trackers are fixed to it. An antenna on an oblique face yaws by more than a turn, and
    its pitch only lifts. A solar array turns about y, its normal off the axis by 80 deg.
    """
    face, edge = unit([0.6, -0.48, 0.64]), unit([0.8, 0.36, -0.48])  # at right angles
    return Spacecraft(
        terminals=(
            Terminal(
                name="antenna",
                mounting=Mount(yaw_axis=face, boresight=edge),
                yaw_range=np.deg2rad([-150.0, 290.0]),
                pitch_range=np.deg2rad([-5.0, 85.0]),
                yaw_rate_limit=np.deg2rad(4.0),
                pitch_rate_limit=np.deg2rad(2.0),
                yaw_acceleration_limit=np.deg2rad(1.5),
                pitch_acceleration_limit=np.deg2rad(1.0),
            ),
        ),
        drives=(
            Drive(
                name="array",
                axis=np.array([0.0, 1.0, 0.0]),
                boresight=direction(-np.pi / 2, np.deg2rad(10.0))[[0, 2, 1]],
                range=np.deg2rad([-120.0, 200.0]),
                rate_limit=np.deg2rad(1.2),
                acceleration_limit=np.deg2rad(0.4),
            ),
        ),
        instruments=(
            Instrument(name="telescope", boresight=np.array([0.0, 0.0, 1.0])),
            Instrument(name="tracker-1", boresight=np.array([0.0, 0.8, -0.6])),
            Instrument(name="tracker-2", boresight=np.array([0.0, -0.8, -0.6])),
        ),
        rate_limit=np.deg2rad([1.5, 1.2, 0.8]),
        rate_norm_limit=np.deg2rad(1.8),
        acceleration_limit=np.deg2rad(0.5),
        jerk_limit=jerk_limit,
    )


def gimbals_about_z(mounts) -> Gimbals:
    """Gimbals of terminals mounted at angles about z."""
    angles = np.asarray(mounts, float)
    frames = Rotation.from_euler("z", angles[:, None]).as_matrix() if len(angles) else np.zeros((0, 3, 3))
    return Gimbals(frames=frames, tilts=np.zeros(0))


def named_craft(*names: str, terminals: int = 0) -> Spacecraft:
    """A spacecraft whose devices have these names, the first ones terminals, in no special direction."""
    craft = make_spacecraft(terminals, len(names) - terminals)
    devices = [
        replace(own, name=name)
        for own, name in zip((*craft.terminals, *craft.instruments), names, strict=True)
    ]
    return replace(craft, terminals=tuple(devices[:terminals]), instruments=tuple(devices[terminals:]))


def at_rest(rotation_vector, joints) -> GivenState:
    """A state without any rates."""
    return GivenState(
        rotation_vector=np.asarray(rotation_vector, dtype=float),
        joints=np.asarray(joints, dtype=float),
        angular_velocity=np.zeros(3),
        joint_rates=np.zeros(len(joints)),
    )


def make_scenario(
    terminals: int = 3,
    instruments: int = 0,
    *,
    keep_out: tuple[KeepOut, ...] = (),
    keep_in: tuple[KeepIn, ...] = (),
    turn: tuple[float, float, float] = (0.3, -0.5, 0.4),
    seed: int = 0,
    craft: Spacecraft | None = None,
) -> Scenario:
    """A scenario with a given goal, ``turn`` away from a random start."""
    rng = np.random.default_rng(seed)
    craft = make_spacecraft(terminals, instruments) if craft is None else craft
    start = Rotation.random(rng=rng)
    middles, halves = np.mean(craft.joint_ranges, axis=1), np.ptp(craft.joint_ranges, axis=1) / 2
    states = [
        at_rest(attitude.as_rotvec(), middles + rng.uniform(-0.9, 0.9, craft.joint_count) * halves)
        for attitude in (start, start * Rotation.from_rotvec(turn))
    ]
    return Scenario(
        name="test",
        spacecraft=craft,
        start=states[0],
        goal=states[1],
        keep_out=keep_out,
        keep_in=keep_in,
    )


def scene_of(scenario: Scenario, goal: Goal | None = None) -> Scene:
    """The search problem of a scenario whose goal is given."""
    start = Rotation.from_rotvec(scenario.start.rotation_vector)
    if goal is None:
        end = Rotation.from_rotvec(scenario.goal.rotation_vector)
        slew = (start.inv() * end).magnitude()
        goal = Goal(attitude=end.as_matrix(), joints=scenario.goal.joints, slew_angle=slew)
    return make_scene(scenario, goal)


def with_search(scenario: Scenario, **changes: object) -> Scenario:
    """The scenario with other search settings."""
    return replace(scenario, search=replace(scenario.search, **changes))


# Scenes made by hand, of instruments and groups: what blocks the straight motion is known. The platform
# starts in the inertial frame's axes and turns about its z axis.


def look(azimuth: float, elevation: float = 0.0) -> np.ndarray:
    """A direction, of deg."""
    return direction(*np.deg2rad([azimuth, elevation]))


def sees(
    device: str, azimuth: float, elevation: float, half_angle: float, group: str | None = "relay"
) -> KeepIn:
    """A device's own cone, in deg, named after both; of a group unless that is None."""
    return KeepIn(
        name=f"{device} at {azimuth:g}",
        direction=look(azimuth, elevation),
        half_angle=np.deg2rad(half_angle),
        devices=(device,),
        any_of=group,
    )


def avoids(name: str, azimuth: float, elevation: float, half_angle: float, *devices: str) -> KeepOut:
    """A zone, in deg, of some devices."""
    return KeepOut(
        name=name, direction=look(azimuth, elevation), half_angle=np.deg2rad(half_angle), devices=devices
    )


def make_relay(
    turn: float,
    instruments: dict[str, np.ndarray],
    *zones: KeepIn | KeepOut,
    method: str = "mha",
    mounts: tuple[float, ...] = (),
    yaws: tuple[tuple[float, ...], tuple[float, ...]] = ((), ()),
    **search: object,
) -> Scenario:
    """A scenario with a given goal: the platform ``turn`` degrees about z, terminals at given yaws.

    Args:
        turn: deg.
        instruments: boresights (3,) by name.
        zones: of both kinds.
        method: of the search.
        mounts: deg, of the terminals named terminal-1, terminal-2, ...
        yaws: deg, at start and goal.
        search: further settings.
    """
    start, goal = (
        at_rest([0.0, 0.0, np.deg2rad(z)], np.deg2rad([*yaw, *np.zeros(len(mounts))]))
        for z, yaw in zip((0.0, turn), yaws, strict=True)
    )
    return Scenario(
        name="relay",
        spacecraft=spacecraft_of(np.deg2rad(mounts), instruments),
        start=start,
        goal=goal,
        keep_out=tuple(zone for zone in zones if isinstance(zone, KeepOut)),
        keep_in=tuple(zone for zone in zones if isinstance(zone, KeepIn)),
        search=SearchSettings(method=method, **search),
    )


# Directions that move.


def great_circle(first, toward, rate, time):
    """Directions (k, 3) of a turn at a steady rate from one direction toward another."""
    across = unit(toward - (toward @ first) * first)
    turned = np.multiply.outer(time, rate)[..., None]
    return np.cos(turned) * first + np.sin(turned) * across


def turning_direction(rng, rate, times):
    """A path that turns at a steady rate, sampled at some times."""
    first, toward = rng.normal(size=(2, 3))
    return DirectionPath.through(times, great_circle(unit(first), toward, rate, times))


def wandering_direction(rng, duration, samples, step):
    """A path through random directions, each about a step off the one before."""
    steps = np.cumsum(step * rng.normal(size=(samples, 3)), axis=0) + 2 * rng.normal(size=3)
    times = duration * (np.arange(samples) + rng.uniform(-0.3, 0.3, samples)) / (samples - 1)
    times[[0, -1]] = 0.0, duration
    return DirectionPath.through(times, unit(steps))


# Plans that need no planning, which figures and pages are drawn of.


ANGLE, DURATION = 1.2, 20.0  # rad and s of `turn_about_z`


def turn_about_z():
    """``ANGLE (3 s^2 - 2 s^3)`` in ``s = t / duration``: one piece, and no joints."""
    shape = np.outer([0.5, 0.6, 0.0, -0.1], [0.0, 0.0, 1.0])  # Legendre coefficients
    return Trajectory(
        breaks=np.array([0.0, DURATION]),
        chart_attitude=np.eye(3)[None],
        chart_start=np.zeros(1),
        chart_rate=np.zeros((1, 3)),
        coefficients=ANGLE * shape[None],
        joint_breaks=np.array([0.0, DURATION]),
        joint_coefficients=np.zeros((1, 4, 0)),
        node_times=np.array([0.0, DURATION]),
        smoothness=2,
        method="test",
    )


def make_plan(
    terminals: int = 3,
    instruments: int = 1,
    *,
    zones: int = 4,
    duration: float = 40.0,
    edges: int = 6,
    craft: Spacecraft | None = None,
) -> Plan:
    """A plan whose platform turns about one axis and whose joints move along lines, all by one smooth law.

    A spacecraft may be given instead of the numbers of its devices.
    """
    keep_out = random_zones(zones)
    scenario = make_scenario(terminals, instruments, keep_out=keep_out, turn=(0.6, -1.1, 0.9), craft=craft)
    still = 0.0 if duration == 0 else 1.0
    start, end = scenario.start, scenario.goal
    first = Rotation.from_rotvec(start.rotation_vector)
    turn = still * (first.inv() * Rotation.from_rotvec(end.rotation_vector)).as_rotvec()
    change = still * (end.joints - start.joints)
    law = Polynomial([0, 0, 0, 10, -15, 6])
    series = poly2leg(law(Polynomial([0.5, 0.5])).coef)[:, None]
    joints = series * change
    joints[0] += start.joints
    share = np.linspace(0, 1, edges + 1)
    trajectory = Trajectory(
        breaks=np.array([0, duration]),
        chart_attitude=first.as_matrix()[None],
        chart_start=np.zeros(1),
        chart_rate=np.zeros((1, 3)),
        coefficients=(series * turn)[None],
        joint_breaks=np.array([0, duration]),
        joint_coefficients=joints[None],
        node_times=duration * share,
        smoothness=2,
        method="paper",
    )
    path = Path(
        attitudes=(first * Rotation.from_rotvec(law(share)[:, None] * turn)).as_matrix(),
        joints=start.joints + law(share)[:, None] * change,
        edge_costs=np.diff(law(share)),
    )
    bound = bool(zones and scenario.spacecraft.device_names)
    report = Certificate(
        certified=True,
        min_margin=0.02 if bound else None,
        worst_time=0.25 * duration if bound else None,
        worst_device=scenario.spacecraft.device_names[0] if bound else None,
        worst_zone="zone-0" if bound else None,
        faults=(),
    )
    goal = Goal(attitude=path.attitudes[-1], joints=path.joints[-1], slew_angle=float(np.linalg.norm(turn)))
    return Plan(
        scenario=scenario, status=Status.OK, goal=goal, path=path, trajectory=trajectory, certificate=report
    )


def random_zones(count: int) -> tuple[KeepOut, ...]:
    """Keep-out zones zone-0, zone-1, ... anywhere."""
    rng = np.random.default_rng(5)
    return tuple(
        KeepOut(name=f"zone-{i}", direction=random_units(rng), half_angle=rng.uniform(0.05, 0.4))
        for i in range(count)
    )
