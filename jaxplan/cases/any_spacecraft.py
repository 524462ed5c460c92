"""Random scenes of random spacecraft: devices of any mounting, with all that can be asked of them.

First the `Build` is drawn, which says how many devices there are and what is limited; there are few builds,
since kernels are compiled for each. Then come mountings, ranges and limits; a start and an end, which are
states at rest; masks, cones and fields of view that keep `CLEARANCE` from both; and the goal: targets along
the boresights at the end, so that all can be met together. Devices without a target keep their joints
(*held*) or are free, and some of these have a wish: a direction that they prefer. Sometimes the end itself
is the goal.

A zone is drawn again until it is clear, at most `DRAWS` times, and is then left out. What is drawn late does
not change what was drawn before. Attitudes are body to inertial, angles in radians unless said to be deg.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.cases.random_kinds import CLEARANCE, DRAWS, random_angle, random_direction, sorts
from jaxplan.cases.random_starts import admissible, at_rest
from jaxplan.geometry.vectors import cross, unit
from jaxplan.model.constraints import constraint_margins, state_margins
from jaxplan.model.devices import Drive, Instrument, Mount, Terminal
from jaxplan.model.goals import Targets, Wish
from jaxplan.model.scenario import Scenario, SearchSettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import FIELD_OF_VIEW, FixedVector, KeepIn, KeepOut, Zone

INSIDE = math.radians(3.0)
"""rad, how far start and end stay inside the ranges of joints."""
_MIN_FREE_PITCH = math.radians(8.0)  # rad, least part of the pitch's range that a mask leaves free
_MAX_YAW = math.radians(290.0)  # rad, greatest magnitude of the yaw at a mask's centre
_MAX_AXIS_COSINE = math.cos(math.radians(35.0))  # of the angle between a drive's boresight and its axis


@dataclass(frozen=True, kw_only=True)
class Build:
    """Numbers of a spacecraft's devices, and which limits of its platform there are.

    Attributes:
        terminals: number of terminals.
        drives: number of drives.
        instruments: number of instruments.
        fields: number of instruments, counted from the first, that have a rectangular field of view.
        seen: whether the first terminal has a rectangular field of view.
        lengths: whether the norms of angular velocity and acceleration are limited.
        torque: whether the torque is limited.
        jerk: whether the jerk is limited.
    """

    terminals: int
    drives: int
    instruments: int
    fields: int = 0
    seen: bool = False
    lengths: bool = False
    torque: bool = False
    jerk: bool = False


BUILDS = (
    Build(terminals=0, drives=0, instruments=1, lengths=True),
    Build(terminals=0, drives=1, instruments=2, fields=1),
    Build(terminals=0, drives=2, instruments=3, torque=True),
    Build(terminals=1, drives=0, instruments=2, fields=2),
    Build(terminals=1, drives=1, instruments=1),
    Build(terminals=1, drives=2, instruments=2, fields=1, lengths=True),
    Build(terminals=2, drives=0, instruments=3, lengths=True),
    Build(terminals=2, drives=1, instruments=2, fields=1, torque=True),
    Build(terminals=3, drives=0, instruments=1, seen=True),
    Build(terminals=3, drives=2, instruments=1),
    Build(terminals=4, drives=0, instruments=1, jerk=True),
    Build(terminals=4, drives=1, instruments=2, fields=1),
)
"""Builds of which one is drawn, each as likely as another."""

State = tuple[np.ndarray, np.ndarray]
"""An attitude (3, 3), body to inertial, and joints (J,) rad."""


@dataclass(kw_only=True)
class Drawn:
    """A scene while it is drawn; later draws change its attributes in place.

    Attributes:
        rng: source of the draws.
        craft: the spacecraft, in the end with its masks.
        start: state where the manoeuvre begins.
        end: state where it may end, which meets the goal and all constraints.
        held: names of devices that keep their joints.
        zones: zones drawn so far, all clear of start and end.
    """

    rng: np.random.Generator
    craft: Spacecraft
    start: State
    end: State
    held: tuple[str, ...] = ()
    zones: list[Zone] = field(default_factory=list)

    def likely(self, share: float) -> bool:
        """Draw a boolean that is true with the probability `share`, from 0 to 1."""
        return bool(self.rng.uniform() < share)

    def some(self, names: tuple[str, ...], least: int = 1) -> tuple[str, ...]:
        """Draw some of the names, at least `least` of them, and keep their order."""
        count = int(self.rng.integers(least, len(names) + 1))
        return tuple(names[i] for i in sorted(self.rng.permutation(len(names))[:count].tolist()))

    def is_clear(self, *zones: Zone, craft: Spacecraft | None = None) -> bool:
        """Tell whether start and end keep `CLEARANCE` from zones, and from the masks of `craft`.

        None stands for the scene's own spacecraft.
        """
        craft = self.craft if craft is None else craft
        rows = tabulate(**sorts(zones), spacecraft=craft)
        attitudes, joints = (np.stack(part) for part in zip(self.start, self.end, strict=True))
        sights = rows.sights(craft.gimbals, craft.fixed_boresights)
        margins = constraint_margins(rows, state_margins(rows, sights, attitudes, joints))
        return bool(np.all(admissible(margins - CLEARANCE)))


def draw(rng: np.random.Generator, name: str) -> Scenario:
    """Draw a scenario of a random spacecraft, and give it a name."""
    return draw_scenario(draw_scene(rng), name)


def draw_scene(rng: np.random.Generator) -> Drawn:
    """Draw spacecraft, start and end of a scene, and masks and zones that are clear of both."""
    craft = _draw_spacecraft(rng, BUILDS[int(rng.integers(len(BUILDS)))])
    low, high = craft.joint_ranges.T
    start, end = rng.uniform(low + INSIDE, high - INSIDE, (2, craft.joint_count))
    attitude = np.asarray(so3.exp(random_angle(rng, 0, 180) * random_direction(rng)))
    turned = attitude @ np.asarray(so3.exp(random_angle(rng, 15, 110) * random_direction(rng)))
    names = craft.device_names[: craft.gimbals.count]
    held = tuple(one for one in names if rng.uniform() < 0.15)
    for number, one in enumerate(names):
        if one in held:
            own = [craft.gimbals.yaws[number], *craft.gimbals.pitches[number : number + 1]]
            end[own] = start[own]
    scene = Drawn(rng=rng, craft=craft, start=(attitude, start), end=(turned, end), held=held)
    _add_masks(scene)
    for recipe in (
        _draw_sky_cones,
        _draw_sun_cone,
        _draw_structure_cone,
        _draw_beam_cone,
        _draw_light_cone,
        _draw_field_zone,
        _draw_tracker_group,
        _draw_shade_cone,
    ):
        for _ in range(DRAWS):
            zones = recipe(scene)
            if scene.is_clear(*zones):
                scene.zones += zones
                break
    return scene


def draw_scenario(scene: Drawn, name: str) -> Scenario:
    """Draw the goal of a scene, and make a scenario with the given name of it."""
    return Scenario(
        name=name,
        spacecraft=scene.craft,
        start=at_rest(*scene.start),
        goal=at_rest(*scene.end) if scene.likely(0.15) else _draw_targets(scene),
        **sorts(scene.zones),
        search=SearchSettings(attitude_step=0.1, joint_step=0.1),
    )


def _draw_spacecraft(rng: np.random.Generator, build: Build) -> Spacecraft:
    """Draw a spacecraft of a build."""

    def per_axis(least: float, most: float) -> Any:
        """Draw a limit (rad) between two in deg, either the same for all axes or each by itself, (3,)."""
        own = np.array([random_angle(rng, least, most) for _ in range(3)])
        return own if rng.uniform() < 0.5 else float(own[0])

    rate, acceleration = per_axis(0.8, 4.0), per_axis(0.2, 2.0)
    more: dict[str, Any] = {}
    if build.lengths:
        more["rate_norm_limit"] = random_angle(rng, 1.0, 4.0)
        more["acceleration_norm_limit"] = random_angle(rng, 0.3, 2.0)
    if build.torque:
        more |= {"inertia": np.diag(rng.uniform(60, 110, 3)), "torque_limit": rng.uniform(0.5, 3, 3)}
    if build.jerk:
        more["jerk_limit"] = per_axis(0.2, 1.0)
    return Spacecraft(
        rate_limit=rate,
        acceleration_limit=acceleration,
        terminals=tuple(_draw_terminal(rng, number, build) for number in range(build.terminals)),
        drives=tuple(_draw_drive(rng, number) for number in range(build.drives)),
        instruments=tuple(_draw_instrument(rng, number, build) for number in range(build.instruments)),
        **more,
    )


def _draw_terminal(rng: np.random.Generator, number: int, build: Build) -> Terminal:
    """Draw a terminal, numbered from 0, with a field of view if the build gives it one."""
    given: dict[str, Any] = {}
    if rng.uniform() < 0.4:
        given["mount"] = random_angle(rng, -180, 180)
    else:
        axis = random_direction(rng)
        given["mounting"] = Mount(yaw_axis=axis, boresight=_draw_perpendicular(rng, axis))
    sort = rng.uniform()
    if sort < 0.35:
        given["yaw_limit"] = random_angle(rng, 60, 180)
    elif sort < 0.7:
        given["yaw_range"] = _draw_range(rng, (-200, -40), (40, 200))
    else:
        given["yaw_range"] = _draw_range(rng, (-330, -190), (190, 330))
    sort = rng.uniform()
    if sort < 0.35:
        given["pitch_limit"] = random_angle(rng, 20, 85)
    elif sort < 0.7:
        given["pitch_range"] = _draw_range(rng, (-30, 0), (45, 90))
    else:
        given["pitch_range"] = _draw_range(rng, (-90, -45), (0, 30))
    if rng.uniform() < 0.5:
        given |= {"rate_limit": random_angle(rng, 1, 6), "acceleration_limit": random_angle(rng, 0.5, 4)}
    else:
        given |= {f"{joint}_rate_limit": random_angle(rng, 1, 6) for joint in ("yaw", "pitch")}
        given |= {f"{joint}_acceleration_limit": random_angle(rng, 0.5, 4) for joint in ("yaw", "pitch")}
    if build.seen and number == 0:
        given["field_of_view"] = np.array([random_angle(rng, 4, 30), random_angle(rng, 4, 30)])
    return Terminal(name=f"terminal-{number + 1}", **given)


def _draw_drive(rng: np.random.Generator, number: int) -> Drive:
    """Draw a drive, numbered from 0."""
    axis = boresight = random_direction(rng)
    while not admissible(_MAX_AXIS_COSINE - abs(axis @ boresight)):
        boresight = random_direction(rng)
    wide = rng.uniform() < 0.3
    return Drive(
        name=f"drive-{number + 1}",
        axis=axis,
        boresight=boresight,
        range=_draw_range(rng, (-360, -190), (190, 360))
        if wide
        else _draw_range(rng, (-180, -30), (30, 180)),
        rate_limit=random_angle(rng, 0.5, 5),
        acceleration_limit=random_angle(rng, 0.2, 3),
    )


def _draw_instrument(rng: np.random.Generator, number: int, build: Build) -> Instrument:
    """Draw an instrument, numbered from 0, with a field of view if the build gives it one."""
    boresight, given = random_direction(rng), dict[str, Any]()
    if number < build.fields:
        given["field_of_view"] = np.array([random_angle(rng, 4, 40), random_angle(rng, 4, 40)])
        given["up"] = _draw_perpendicular(rng, boresight)
    return Instrument(name=f"instrument-{number + 1}", boresight=boresight, **given)


def _draw_range(rng: np.random.Generator, low: tuple[float, float], high: tuple[float, float]) -> np.ndarray:
    """Draw a range (2,) in rad: its lower end from the interval `low`, its upper end from `high`, in deg."""
    return np.array([random_angle(rng, *low), random_angle(rng, *high)])


def _draw_perpendicular(rng: np.random.Generator, axis: np.ndarray) -> np.ndarray:
    """Draw a unit vector (3,) perpendicular to an axis (3,)."""
    return np.stack(unit(np.stack(cross(axis, random_direction(rng)))))


def _add_masks(scene: Drawn) -> None:
    """Give most terminals a mask that cuts into the pitch's range from one side; changes `scene.craft`."""
    for number, terminal in enumerate(scene.craft.terminals):
        if scene.likely(0.4):
            continue
        for _ in range(DRAWS):
            corners = _draw_mask_corners(scene, terminal)
            masked = replace(terminal, mask=(corners,))
            terminals = (*scene.craft.terminals[:number], masked, *scene.craft.terminals[number + 1 :])
            craft = replace(scene.craft, terminals=terminals)
            if scene.is_clear(craft=craft):
                scene.craft = craft
                break


def _draw_mask_corners(scene: Drawn, terminal: Terminal) -> np.ndarray:
    """Draw corners (3 or 4, 2), rad, of a convex mask of yaw and pitch, centred at an end of the pitch."""
    rng, (yaw, (low, high)) = scene.rng, terminal.ranges
    centre = np.array([rng.uniform(*np.clip(yaw, -_MAX_YAW, _MAX_YAW)), high if scene.likely(0.5) else low])
    deepest = min(math.radians(30), high - low - _MIN_FREE_PITCH)
    size, count = (
        np.array([random_angle(rng, 12, 60), deepest * rng.uniform(0.4, 1.0)]),
        int(rng.integers(3, 5)),
    )
    turn = 2 * np.pi * (np.arange(count) + rng.uniform()) / count
    corners = np.degrees(centre + size * np.stack([np.cos(turn), np.sin(turn)], axis=-1))
    return np.array([[math.radians(round(float(part), 6)) for part in corner] for corner in corners])


def _draw_sky_cones(scene: Drawn) -> list[Zone]:
    """Draw up to two inertial cones that all devices, or some of them, keep out of."""
    rng, names = scene.rng, scene.craft.device_names
    return [
        KeepOut(
            name=f"sky-{number + 1}",
            direction=random_direction(rng),
            half_angle=random_angle(rng, 6, 18),
            devices=() if scene.likely(0.5) else scene.some(names),
        )
        for number in range(int(rng.integers(0, 3)))
    ]


def _draw_sun_cone(scene: Drawn) -> list[Zone]:
    """Draw a wide inertial cone that some instruments keep out of."""
    names = tuple(one.name for one in scene.craft.instruments)
    half_angle = random_angle(scene.rng, 15, 40)
    return [
        KeepOut(
            name="sun",
            direction=random_direction(scene.rng),
            half_angle=half_angle,
            devices=scene.some(names),
        )
    ]


def _jointed_devices(scene: Drawn) -> tuple[str, ...]:
    """Names of the devices with joints."""
    return scene.craft.device_names[: scene.craft.gimbals.count]


def _draw_structure_cone(scene: Drawn) -> list[Zone]:
    """Draw a cone about a body axis that one device with joints keeps out of; sometimes none."""
    if not _jointed_devices(scene) or scene.likely(0.3):
        return []
    return [
        KeepOut(
            name="structure",
            axis_body=random_direction(scene.rng),
            half_angle=random_angle(scene.rng, 8, 25),
            devices=scene.some(_jointed_devices(scene))[:1],
        )
    ]


def _draw_beam_cone(scene: Drawn) -> list[Zone]:
    """Draw a cone about the boresight of one device that another keeps out of; one of them has joints.

    Sometimes, or where there are no two such devices, none is drawn.
    """
    moving = _jointed_devices(scene)
    if not moving or len(scene.craft.device_names) < 2 or scene.likely(0.3):
        return []
    one = scene.some(moving)[0]
    others = tuple(name for name in scene.craft.device_names if name != one)
    other = others[int(scene.rng.integers(len(others)))]
    axis, bound = (one, other) if scene.likely(0.5) else (other, one)
    return [
        KeepOut(name="beam", axis_device=axis, half_angle=random_angle(scene.rng, 2, 25), devices=(bound,))
    ]


def _draw_light_cone(scene: Drawn) -> list[Zone]:
    """Draw a wide inertial cone that a body axis, or one device, stays in; sometimes none."""
    if scene.likely(0.4):
        return []
    rng = scene.rng
    bound: dict[str, Any] = (
        {"vectors": (FixedVector(along=random_direction(rng)),)}
        if scene.likely(0.5)
        else {"devices": scene.some(scene.craft.device_names)[:1]}
    )
    return [
        KeepIn(name="light", direction=random_direction(rng), half_angle=random_angle(rng, 70, 110), **bound)
    ]


def _draw_field_zone(scene: Drawn) -> list[Zone]:
    """Draw an inertial direction that must stay outside all fields of view by an angle, if any exist."""
    craft, rng = scene.craft, scene.rng
    names = tuple(one.name for one in craft.devices if one.field_of_view is not None)
    if not names:
        return []
    return [
        KeepOut(
            name="beside the field",
            direction=random_direction(rng),
            half_angle=random_angle(rng, 1, 20),
            devices=names,
            outside=FIELD_OF_VIEW,
        )
    ]


def _draw_tracker_group(scene: Drawn) -> list[Zone]:
    """Draw a group of two zones, of which one must be kept: the last two instruments avoid one direction.

    Sometimes, or with fewer instruments, none is drawn.
    """
    names = tuple(one.name for one in scene.craft.instruments)[-2:]
    if len(names) < 2 or scene.likely(0.5):
        return []
    rng, toward = scene.rng, random_direction(scene.rng)
    return [
        KeepOut(
            name=f"sun for {name}",
            direction=toward,
            half_angle=random_angle(rng, 30, 70),
            devices=(name,),
            any_of="one sees stars",
        )
        for name in names
    ]


def _draw_shade_cone(scene: Drawn) -> list[Zone]:
    """Draw an inertial cone that a vector fixed to a device's moving part keeps out of; sometimes none."""
    if not _jointed_devices(scene) or scene.likely(0.6):
        return []
    vector = FixedVector(along=random_direction(scene.rng), to=scene.some(_jointed_devices(scene))[0])
    toward, half_angle = random_direction(scene.rng), random_angle(scene.rng, 8, 25)
    return [KeepOut(name="shade", direction=toward, half_angle=half_angle, vectors=(vector,))]


def _draw_targets(scene: Drawn) -> Targets:
    """Draw a goal: targets along boresights at the end for one device or more, and wishes for some others.

    Terminals may all have targets, but at most one drive and one instrument, since more cannot be met in
    general.
    """
    rng, craft = scene.rng, scene.craft
    seen = dict(zip(craft.device_names, craft.boresights(scene.end[0], scene.end[1]), strict=True))
    free = [name for name in craft.device_names if name not in scene.held]
    chosen = [one.name for one in craft.terminals if one.name in free and not scene.likely(0.25)]
    for devices, share in ((craft.drives, 0.35), (craft.instruments, 0.6 if chosen else 1.0)):
        names = [one.name for one in devices if one.name in free]
        if names and scene.likely(share):
            chosen.append(names[int(rng.integers(len(names)))])
    left = [name for name in free if name not in chosen]
    wishes = tuple(Wish(device=name, direction=random_direction(rng)) for name in left if rng.uniform() < 0.3)
    targets = {name: seen[name] for name in craft.device_names if name in chosen}
    return Targets.of(
        targets,
        hold=scene.held,
        prefer=wishes[:2],
        angular_velocity=np.zeros(3),
        joint_rates=np.zeros(craft.joint_count),
    )
