"""Spacecraft with devices mounted in any way, drives among them, and scenarios with zones of every kind.

Devices are named terminal-1, ..., drive-1, ... and camera-1, ...; angles in rad.
"""

from dataclasses import replace

import numpy as np
from kinds import pair_margins_of
from reference import direction, random_units
from scipy.spatial.transform import Rotation

from jaxplan.model.devices import Drive, Instrument, Mount, Terminal
from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import Scenario, SearchSettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import FixedVector, JointBound, KeepIn, KeepOut, Zone

MARGIN = np.deg2rad(6.0)  # that each zone has left at start and goal


def oblique_craft(terminals: int, drives: int = 0, instruments: int = 0, *, seed: int = 0) -> Spacecraft:
    """Devices mounted in any way, with ranges about anything and limits that all differ."""
    rng = np.random.default_rng((seed, terminals, drives, instruments))

    def mounting() -> Mount:
        ahead, _, up = Rotation.random(rng=rng).as_matrix().T
        return Mount(yaw_axis=up, boresight=ahead)

    def span(least: float, most: float, width: float) -> np.ndarray:
        low = rng.uniform(least, most - width)
        return np.array([low, low + width])

    def limit(most: float) -> float:
        return float(np.deg2rad(rng.uniform(0.3, 1.0) * most))

    return Spacecraft(
        terminals=tuple(
            Terminal(
                name=f"terminal-{i + 1}",
                mounting=mounting(),
                yaw_range=span(-6.0, 6.0, rng.uniform(2.0, 8.0)),
                pitch_range=span(-1.5, 1.5, rng.uniform(0.8, 2.4)),
                yaw_rate_limit=limit(6.0),
                pitch_rate_limit=limit(5.0),
                yaw_acceleration_limit=limit(5.0),
                pitch_acceleration_limit=limit(4.0),
            )
            for i in range(terminals)
        ),
        drives=tuple(
            Drive(
                name=f"drive-{i + 1}",
                axis=frame[2],
                boresight=direction(0.0, rng.uniform(-1.3, 1.3)) @ frame,
                range=span(-5.0, 5.0, rng.uniform(1.5, 8.0)),
                rate_limit=limit(4.0),
                acceleration_limit=limit(3.0),
            )
            for i, frame in enumerate(Rotation.random(drives, rng=rng).as_matrix())
        ),
        instruments=tuple(
            Instrument(name=f"camera-{i + 1}", boresight=axis)
            for i, axis in enumerate(random_units(rng, instruments))
        ),
        rate_limit=np.deg2rad(rng.uniform(1.5, 3.5, 3)),
        acceleration_limit=np.deg2rad(rng.uniform(1.0, 2.5, 3)),
    )


def oblique_scenario(
    terminals: int = 2,
    drives: int = 2,
    instruments: int = 1,
    *,
    seed: int = 0,
    kinds: tuple[str, ...] | None = None,
    turn: float = 0.9,
    **search: object,
) -> Scenario:
    """A scenario with a given goal, and a zone of each kind that the spacecraft can have.

    Args:
        terminals: at least one for most kinds of zones.
        drives: likewise.
        instruments: likewise.
        seed: of all that is random.
        kinds: names of zones, for some of them; None for all.
        turn: rad, of the platform.
        search: settings.
    """
    craft = oblique_craft(terminals, drives, instruments, seed=seed)
    rng = np.random.default_rng((seed, 17))
    first = Rotation.random(rng=rng)
    last = first * Rotation.from_rotvec(turn * random_units(rng))
    middle, reach = craft.joint_ranges.mean(axis=1), np.ptp(craft.joint_ranges, axis=1) / 2
    joints = middle + 0.8 * reach * rng.uniform(-1, 1, len(reach))
    moved = np.clip(joints + rng.uniform(-0.8, 0.8, len(reach)), middle - 0.85 * reach, middle + 0.85 * reach)
    start, goal = (
        GivenState(
            rotation_vector=attitude.as_rotvec(),
            joints=angles,
            angular_velocity=np.zeros(3),
            joint_rates=np.zeros(len(reach)),
        )
        for attitude, angles in ((first, joints), (last, moved))
    )
    bare = Scenario(
        name="oblique",
        spacecraft=craft,
        start=start,
        goal=goal,
        search=SearchSettings(**search),
    )
    zones = [zone for zone in _zones(rng, craft) if kinds is None or zone.name in kinds]
    return _fitted(_with_zones(bare, zones), rng)


def _with_zones(scenario: Scenario, zones: list[Zone]) -> Scenario:
    return replace(
        scenario,
        keep_out=tuple(zone for zone in zones if isinstance(zone, KeepOut)),
        keep_in=tuple(zone for zone in zones if isinstance(zone, KeepIn)),
        joint_bounds=tuple(zone for zone in zones if isinstance(zone, JointBound)),
    )


def _zones(rng: np.random.Generator, craft: Spacecraft) -> list[Zone]:
    """Zones of every kind that the devices allow, whose sizes are still to be chosen."""
    terminals, drives, instruments = (
        [one.name for one in devices] for devices in (craft.terminals, craft.drives, craft.instruments)
    )
    size, axes = 1.0, iter(random_units(rng, 20))
    zones: list[Zone] = [KeepOut(name="sun", direction=next(axes), half_angle=size)]
    if terminals:
        one, last = terminals[0], terminals[-1]
        zones.append(KeepIn(name="station", direction=next(axes), half_angle=size, devices=(one,)))
        zones.append(KeepOut(name="mast", axis_body=next(axes), half_angle=size, devices=(one, last)[:1]))
        slope = rng.uniform(0, 2 * np.pi)
        normal = np.array([np.cos(slope), np.sin(slope)])
        zones.append(JointBound(name="mask", device=last, normal=normal, least=0.0))
    if drives:
        panel = FixedVector(along=next(axes), to=drives[-1])
        zones.append(KeepOut(name="panel", direction=next(axes), half_angle=size, vectors=(panel,)))
        zones.append(KeepIn(name="array", axis_body=next(axes), half_angle=size, devices=(drives[0],)))
    if terminals and drives:
        zones.append(KeepOut(name="beam", axis_device=terminals[0], half_angle=size, devices=(drives[0],)))
        panel = FixedVector(along=next(axes), to=terminals[-1])
        zones.append(KeepIn(name="edge", axis_device=drives[-1], half_angle=size, vectors=(panel,)))
    if instruments and drives:
        for name, device in (("shade-1", instruments[0]), ("shade-2", drives[0])):
            zones.append(
                KeepOut(name=name, direction=next(axes), half_angle=size, devices=(device,), any_of="shade")
            )
    return zones


def _fitted(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """The scenario with zones of such sizes that each is kept at start and goal, with some margin."""
    ends = [scenario.start, scenario.goal]
    attitudes = np.stack([Rotation.from_rotvec(end.rotation_vector).as_matrix() for end in ends])
    joints = np.stack([end.joints for end in ends])
    rows = scenario.constraints
    margins = pair_margins_of(scenario.spacecraft, rows, attitudes, joints).min(axis=(0, 2))

    def fitted(number: int, zone: Zone) -> Zone:
        worst = margins[rows.zone == number].min() - MARGIN * rng.uniform(0.5, 1.5)
        if isinstance(zone, JointBound):
            return replace(zone, least=zone.least + worst)
        return replace(zone, half_angle=float(np.clip(zone.half_angle + zone.side * worst, 0.02, 3.1)))

    return _with_zones(scenario, [fitted(number, zone) for number, zone in enumerate(scenario.zones)])
