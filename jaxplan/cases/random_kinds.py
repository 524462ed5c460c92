"""Random constraints of the kinds that have more than cones on the sky, and how a scene is drawn with them.

A kind is a list of *recipes*: functions that draw zones that must hold together, or a group of which one must
hold. A recipe is drawn again until start and goal keep `CLEARANCE` from its zones. All recipes are drawn
again until the straight motion to the nearest goal of step 1 violates a zone. In `moved_goals` it is that
goal itself that violates one, while another goal, drawn near it, is clear. Where `DRAWS` attempts of either
are not enough, another start is drawn.

No zone may separate the joint angles into parts, since there might be no path at all then: masks and polygons
reach into the range of the pitch from one side, and leave 6 deg free at the other.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.cases.random_starts import (
    BROKEN,
    JOINT_LIMITS,
    admissible,
    at_rest,
    nearest_goal,
    setting,
    starts,
    straight_states,
)
from jaxplan.geometry.vectors import pointing
from jaxplan.model.constraints import constraint_margins, state_margins
from jaxplan.model.devices import Instrument
from jaxplan.model.directions import DirectionPath
from jaxplan.model.goals import GivenState
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import FIELD_OF_VIEW, FixedVector, JointBound, KeepIn, KeepOut, Mask, Zone

CLEARANCE = math.radians(2.0)
"""rad, least margin that start and goal have to every zone that is drawn."""
FARTHEST = math.radians(30.0)
"""rad, from the nearest goal to another that is clear, where the nearest is broken itself."""
DRAWS = 8
"""Draws of a recipe, and of all recipes of a start, before it is given up."""
KNOWN = 400.0
"""s, over which directions that move are known."""
_PATH_TIMES = np.linspace(0, KNOWN, 41)  # s, at which moving directions are given, and margins checked
_PITCH_LIMIT = 15.0  # deg, pitch limit of the paper's spacecraft
_POLYGON_EDGES = 4  # number of a polygon's edges

_TERMINAL_FIELD, _TERMINAL_UP = (
    np.radians([14.0, 8.0]),
    np.array([0.0, 0.6, 0.8]),
)  # field of view (full angles, rad) and its up axis of every terminal, in scenes with fields of view
_CAMERA = Instrument(
    name="camera",
    boresight=np.array([0.0, 0.6, 0.8]),
    field_of_view=np.radians([24.0, 14.0]),
    up=np.array([1.0, 0.0, 0.0]),
)

Recipe = Callable[[np.random.Generator], tuple[Zone, ...]]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """How the scenes of a kind are drawn.

    Attributes:
        recipes: functions that draw the zones, in the order in which they are called.
        moved: whether the nearest goal violates a zone, instead of the straight motion to it.
    """

    recipes: tuple[Recipe, ...]
    moved: bool = False


def draw(rng: np.random.Generator, kind: Kind) -> tuple[GivenState, tuple[Zone, ...]]:
    """Draw the start, at rest, and the zones of a scene of a kind."""
    for attitude, joints, _ in starts(rng, 0, 0.0):
        goal = nearest_goal(attitude)
        if goal is None:
            continue
        start, end = (attitude, joints), (goal.attitude, goal.joints)
        if kind.moved:
            clear, broken = _stack_states(start, _draw_other_goal(rng, goal.attitude)), _stack_states(end)
        else:
            clear, broken = _stack_states(start, end), straight_states(attitude, joints, goal)
        for _ in range(DRAWS):
            zones = _draw_clear_zones(rng, kind.recipes, clear)
            if zones and admissible(-BROKEN - np.min(_min_margins(zones, *broken))):
                return at_rest(attitude, joints), zones
    raise AssertionError("there are always more starts")


def sorts(zones: Sequence[Zone]) -> dict[str, Any]:
    """Group zones by the attribute of a scenario that holds them; masks, the spacecraft's, are left out."""
    return {
        "keep_out": tuple(zone for zone in zones if isinstance(zone, KeepOut)),
        "keep_in": tuple(zone for zone in zones if isinstance(zone, KeepIn)),
        "joint_bounds": tuple(zone for zone in zones if isinstance(zone, JointBound)),
    }


def equipped(zones: Sequence[Zone]) -> Spacecraft:
    """The paper's spacecraft with the masks among the zones.

    If a zone is about a field of view, every terminal has one, and there is a camera with one.
    """
    craft, _ = setting()
    own = {
        terminal.name: [
            zone.corners for zone in zones if isinstance(zone, Mask) and zone.device == terminal.name
        ]
        for terminal in craft.terminals
    }
    masked = tuple(replace(one, mask=tuple(own[one.name])) for one in craft.terminals)
    if not any(isinstance(zone, KeepOut) and zone.of_field for zone in zones):
        return replace(craft, terminals=masked)
    seeing = tuple(replace(one, field_of_view=_TERMINAL_FIELD, up=_TERMINAL_UP) for one in masked)
    return replace(craft, terminals=seeing, instruments=(_CAMERA,))


def _stack_states(*states: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Stack k states, each an attitude (3, 3) and joints (6,), to attitudes (k, 3, 3) and joints (k, 6)."""
    return np.stack([attitude for attitude, _ in states]), np.stack([joints for _, joints in states])


def _draw_other_goal(rng: np.random.Generator, attitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Draw another goal: an attitude (3, 3) turned by at most `FARTHEST`, and its joints (6,) in rad."""
    craft, targets = setting()
    while True:
        turned = attitude @ np.asarray(so3.exp(rng.uniform(0, FARTHEST) * random_direction(rng)))
        joints = np.asarray(craft.joints_toward(turned, targets.directions))
        if np.all(admissible(JOINT_LIMITS - np.abs(joints))):
            return turned, joints


def _draw_clear_zones(
    rng: np.random.Generator, recipes: Sequence[Recipe], clear: tuple[np.ndarray, np.ndarray]
) -> tuple[Zone, ...]:
    """Draw zones by all recipes, so that some states are clear of them.

    Args:
        rng: source of the draws.
        recipes: functions that draw zones.
        clear: attitudes (k, 3, 3) and joints (k, 6) of states that must keep `CLEARANCE` from all zones.

    Returns:
        The zones; empty if `DRAWS` draws of a recipe are not enough.
    """
    found: list[Zone] = []
    for recipe in recipes:
        for _ in range(DRAWS):
            zones = recipe(rng)
            if np.all(admissible(_min_margins(zones, *clear) - CLEARANCE)):
                found += zones
                break
        else:
            return ()
    return tuple(found)


def _min_margins(zones: Sequence[Zone], attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Smallest margin (k,) in rad of each of k states to any of the zones; to moving ones at any time.

    Args:
        zones: the zones.
        attitudes: (k, 3, 3) body to inertial.
        joints: (k, 6) rad.
    """
    craft = equipped(zones)
    rows = tabulate(**sorts(zones), spacecraft=craft)
    sights = rows.sights(craft.gimbals, craft.fixed_boresights)
    times = np.repeat(_PATH_TIMES[:, None], len(joints), axis=1) if rows.paths else None
    margins = constraint_margins(rows, state_margins(rows, sights, attitudes, joints, times))
    return np.asarray(np.min(margins, axis=(0, -1) if rows.paths else -1))


def random_direction(rng: np.random.Generator) -> np.ndarray:
    """Draw a unit vector (3,) that is uniform on the sphere."""
    vector = rng.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


def random_angle(rng: np.random.Generator, least: float, most: float) -> float:
    """Draw an angle uniformly between two in deg; returns it in rad."""
    return math.radians(rng.uniform(least, most))


def _round_as_filed(angle: float) -> float:
    """Round an angle (rad) so that it is unchanged by conversion to degrees and back, as in a file."""
    return math.radians(math.degrees(angle))


def _draw_sign(rng: np.random.Generator) -> int:
    """Draw 1 or -1."""
    return 1 if rng.uniform() < 0.5 else -1


def _terminal_name(number: int) -> str:
    """Name of a terminal, numbered from 0."""
    return setting()[0].terminals[number].name


def _draw_vector(rng: np.random.Generator, to: int | None) -> tuple[FixedVector]:
    """Draw a vector fixed to the body, or to the moving part of a terminal.

    Args:
        rng: source of the draws.
        to: number of the terminal, from whose boresight the vector is at least 40 deg away; None for the
            body.
    """
    along = random_direction(rng)
    while to is not None and not admissible(math.cos(math.radians(40.0)) - along[0]):
        along = random_direction(rng)
    return (FixedVector(along=along, to=None if to is None else _terminal_name(to)),)


def _draw_mask_cones(rng: np.random.Generator, number: int) -> tuple[Zone, ...]:
    """Draw two cones about body axes that a terminal keeps out of, both from above or both from below."""
    side, frame = _draw_sign(rng), setting()[0].gimbals.frames[number]
    found = []
    for i in range(2):
        half_angle, reach = random_angle(rng, 12, 25), random_angle(rng, -5, 9)
        azimuth, elevation = random_angle(rng, -80, 80), side * (half_angle - reach)
        axis = frame @ pointing(azimuth, elevation)
        found.append(
            KeepOut(
                name=f"mask-{number + 1}{'ab'[i]}",
                axis_body=axis,
                half_angle=half_angle,
                devices=(_terminal_name(number),),
            )
        )
    return tuple(found)


def _draw_beam(rng: np.random.Generator, axis: int, number: int) -> tuple[Zone, ...]:
    """Draw a cone about the boresight of the terminal `axis` that the terminal `number` keeps out of."""
    return (
        KeepOut(
            name=f"beam-{axis + 1}",
            axis_device=_terminal_name(axis),
            half_angle=random_angle(rng, 10, 40),
            devices=(_terminal_name(number),),
        ),
    )


def _draw_cone(
    rng: np.random.Generator,
    name: str,
    half_angles: tuple[float, float],
    sort: type[KeepOut] | type[KeepIn] = KeepOut,
    of: tuple[int | None, ...] = (),
) -> tuple[Zone, ...]:
    """Draw an inertial cone.

    Args:
        rng: source of the draws.
        name: of the zone.
        half_angles: least and greatest half angle, deg.
        sort: `KeepOut` or `KeepIn`.
        of: for each vector that the zone binds, the number of the terminal it is fixed to, or None for the
            body. Without vectors the zone binds the boresights of all terminals.
    """
    known: dict[str, Any] = {
        "direction": random_direction(rng),
        "half_angle": random_angle(rng, *half_angles),
    }
    return (sort(name=name, **known, vectors=tuple(vector for to in of for vector in _draw_vector(rng, to))),)


def _draw_mask(rng: np.random.Generator, number: int) -> tuple[Zone, ...]:
    """Draw a mask of the terminal `number`, which cuts into the range of the pitch from above or below."""
    corners, name = np.vectorize(_round_as_filed)(_draw_polygon_corners(rng)), _terminal_name(number)
    return (Mask(name=f"mask 1 of {name}", device=name, corners=corners, turns=(0,)),)


def _draw_field_zone(
    rng: np.random.Generator, name: str, of: str, distances: tuple[float, float]
) -> tuple[Zone, ...]:
    """Draw an inertial direction that must stay outside the field of view of the device `of`.

    Its least distance from the field's edge is drawn from the interval `distances`, in deg.
    """
    distance = _round_as_filed(random_angle(rng, *distances))
    return (
        KeepOut(
            name=name,
            direction=random_direction(rng),
            half_angle=distance,
            outside=FIELD_OF_VIEW,
            devices=(of,),
        ),
    )


def _draw_polygon_corners(rng: np.random.Generator) -> np.ndarray:
    """Draw the corners (4, 2) in rad of a convex polygon in yaw and pitch, counter-clockwise.

    It cuts into the range of the pitch from above or below.
    """
    centre = np.array([random_angle(rng, -60, 60), math.radians(_draw_sign(rng) * _PITCH_LIMIT)])
    size = np.array([random_angle(rng, 15, 35), random_angle(rng, 8, 22)])
    turn = 2 * np.pi * (np.arange(_POLYGON_EDGES) + rng.uniform()) / _POLYGON_EDGES
    return np.asarray(centre + size * np.stack([np.cos(turn), np.sin(turn)], axis=-1))


def _draw_polygon(rng: np.random.Generator, number: int) -> tuple[Zone, ...]:
    """Draw a forbidden convex polygon of a terminal's yaw and pitch: joint bounds of which one must hold."""
    corners = _draw_polygon_corners(rng)
    along = np.roll(corners, -1, axis=0) - corners  # counter-clockwise: the outside is on the right
    normals = np.stack([along[:, 1], -along[:, 0]], axis=-1) / np.linalg.norm(along, axis=-1, keepdims=True)
    name = f"corner-{number + 1}"
    return tuple(
        JointBound(
            name=f"{name}{'abcd'[i]}",
            device=_terminal_name(number),
            normal=normal,
            least=_round_as_filed(float(normal @ corner)),
            any_of=name,
        )
        for i, (normal, corner) in enumerate(zip(normals, corners, strict=True))
    )


def _draw_group(rng: np.random.Generator, number: int) -> tuple[Zone, ...]:
    """Draw a group of two alternatives for the terminal `number`, of which one must hold; each has two zones.

    Either a body vector stays away from the Sun and the terminal out of a cone on the sky; or another body
    vector stays toward the Sun and the terminal out of a cone about a body axis.
    """
    sun, terminal = random_direction(rng), (_terminal_name(number),)

    def named(what: str, entry: str) -> dict[str, Any]:
        return {"name": f"{what}-{number + 1}", "any_of": f"group-{number + 1}", "entry": entry}

    def wide() -> dict[str, Any]:
        return {"direction": sun, "half_angle": random_angle(rng, 60, 90), "vectors": _draw_vector(rng, None)}

    def narrow() -> dict[str, Any]:
        return {"half_angle": random_angle(rng, 12, 25), "devices": terminal}

    return (
        KeepOut(**named("shade", "dark"), **wide()),
        KeepOut(**named("aside", "dark"), direction=random_direction(rng), **narrow()),
        KeepIn(**named("light", "lit"), **wide()),
        KeepOut(**named("spare", "lit"), axis_body=random_direction(rng), **narrow()),
    )


def _draw_moving_cone(rng: np.random.Generator, name: str, by_body: bool) -> tuple[Zone, ...]:
    """Draw a keep-out cone that moves along a great circle.

    Args:
        rng: source of the draws.
        name: of the zone.
        by_body: whether it binds a body vector; else it binds all terminals.
    """
    first, toward, speed = random_direction(rng), random_direction(rng), random_angle(rng, 0.02, 0.08)
    across = toward - (toward @ first) * first
    across /= np.linalg.norm(across)
    turned = speed * _PATH_TIMES[:, None]
    path = DirectionPath.through(_PATH_TIMES, np.cos(turned) * first + np.sin(turned) * across)
    vectors = _draw_vector(rng, None) if by_body else ()
    return (KeepOut(name=name, direction=path, half_angle=random_angle(rng, 15, 30), vectors=vectors),)


def _for_each_terminal(recipe: Callable[..., tuple[Zone, ...]], **given: Any) -> tuple[Recipe, ...]:
    """Make a recipe for each of the three terminals, with its `number` and other arguments fixed."""
    return tuple(partial(recipe, number=number, **given) for number in range(3))


_BEAMS = tuple(partial(_draw_beam, axis=axis, number=(axis + 1) % 3) for axis in range(3))
_MASKS, _POLYGONS, _GROUPS = (
    _for_each_terminal(_draw_mask_cones),
    _for_each_terminal(_draw_polygon),
    _for_each_terminal(_draw_group),
)
_AWAY_CONE = partial(_draw_cone, half_angles=(20, 40))
_TOWARD_CONE = partial(_draw_cone, half_angles=(60, 90), sort=KeepIn)
_SHADE_CONES = tuple(partial(_AWAY_CONE, name=f"shade-{number + 1}", of=(number,)) for number in range(3))
_SUN_CONE = partial(_TOWARD_CONE, name="sun", of=(None,))
_TRACKER_CONES = tuple(partial(_AWAY_CONE, name=f"tracker-{i + 1}", of=(None,)) for i in range(3))
_SKY_CONES = tuple(partial(_draw_cone, name=f"sky-{i + 1}", half_angles=(12, 25)) for i in range(2))
_MOVING_CONES = tuple(partial(_draw_moving_cone, name=f"passing-{i + 1}", by_body=i == 3) for i in range(4))
_FIELD_ZONES = tuple(
    partial(_draw_field_zone, name=f"beside-{i + 1}", of=f"terminal-{i + 1}", distances=(3, 10))
    for i in range(3)
)
_CAMERA_ZONES = tuple(
    partial(_draw_field_zone, name=f"camera-{i + 1}", of="camera", distances=(5, 15)) for i in range(3)
)
KINDS = {
    "masks": Kind(recipes=_MASKS),
    "beams": Kind(recipes=_BEAMS),
    "panels": Kind(recipes=(_SUN_CONE, *_TRACKER_CONES)),
    "carried": Kind(recipes=(*_SHADE_CONES, partial(_TOWARD_CONE, name="lamp", of=(0,)))),
    "joint_bounds": Kind(recipes=_POLYGONS),
    "grouped": Kind(recipes=_GROUPS),
    "moving": Kind(recipes=_MOVING_CONES),
    "moved_goals": Kind(recipes=(*_SHADE_CONES, *_POLYGONS), moved=True),
    "mixed": Kind(
        recipes=(
            *_SKY_CONES,
            _MASKS[0],
            _BEAMS[1],
            _SUN_CONE,
            _TRACKER_CONES[0],
            _SHADE_CONES[1],
            _POLYGONS[2],
            _GROUPS[2],
        )
    ),
    "terminal_masks": Kind(recipes=_for_each_terminal(_draw_mask)),
    "fields": Kind(recipes=(*_CAMERA_ZONES, *_FIELD_ZONES)),
}
