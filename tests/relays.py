"""Scenes of instruments and of keep-in groups, made by hand: what blocks the straight motion is known.

The platform starts in the inertial frame's axes and turns about its z axis; azimuths and elevations in
degrees, of instruments in the body and of zones in the inertial frame.
"""

import numpy as np

from jaxplan.model.scenario import GivenState, Scenario, SearchSettings, TrajectorySettings
from jaxplan.model.spacecraft import Instrument, Spacecraft, Terminal
from jaxplan.model.zones import KeepIn, KeepOut


def look(azimuth: float, elevation: float = 0.0) -> np.ndarray:
    a, e = np.deg2rad([azimuth, elevation])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def sees(
    device: str, azimuth: float, elevation: float, half_angle: float, group: str | None = "relay"
) -> KeepIn:
    """A device's own cone, named after both; of a group unless that is None."""
    return KeepIn(
        name=f"{device} at {azimuth:g}",
        direction=look(azimuth, elevation),
        half_angle=np.deg2rad(half_angle),
        devices=(device,),
        any_of=group,
    )


def avoids(name: str, azimuth: float, elevation: float, half_angle: float, *devices: str) -> KeepOut:
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
    terminals = tuple(
        Terminal(
            name=f"terminal-{i + 1}",
            mount=np.deg2rad(mount),
            yaw_limit=np.pi / 2,
            pitch_limit=np.pi / 12,
            rate_limit=np.deg2rad(4.0),
            acceleration_limit=np.deg2rad(3.0),
        )
        for i, mount in enumerate(mounts)
    )
    start, goal = (
        GivenState(
            rotation_vector=np.array([0.0, 0.0, np.deg2rad(angle)]),
            joints=np.deg2rad([*yaw, *np.zeros(len(mounts))]),
            angular_velocity=np.zeros(3),
            joint_rates=np.zeros(2 * len(mounts)),
        )
        for angle, yaw in zip((0.0, turn), yaws, strict=True)
    )
    return Scenario(
        name="relay",
        spacecraft=Spacecraft(
            terminals=terminals,
            instruments=tuple(Instrument(name=name, boresight=axis) for name, axis in instruments.items()),
            rate_limit=np.deg2rad(3.0),
            acceleration_limit=np.deg2rad(2.0),
        ),
        start=start,
        goal=goal,
        keep_out=tuple(zone for zone in zones if isinstance(zone, KeepOut)),
        keep_in=tuple(zone for zone in zones if isinstance(zone, KeepIn)),
        search=SearchSettings(method=method, **search),
        trajectory=TrajectorySettings(),
    )
