"""Random scenes of the paper's spacecraft, and of random ones; a seed gives the same scene on every machine.

The paper's Table 4 counts successes on scenes with random starts and zones (section 5.2). In the first five
kinds all zones are cones on the sky, for terminals. They range from the two kinds of Table 4 to a satellite
that keeps two of its links while it turns. A terminal is *held* where a keep-in cone binds it to its target.
The *straight motion* turns the platform about one fixed axis while the joints change linearly.

    keep_out        4 cones of 15 to 30 deg for all terminals
    keep_in         terminal 1 held within 15 deg of its target; 3 cones of 15 to 30 deg for the others
    hard_keep_out   8 cones of 12 to 30 deg for all terminals; the straight motion to the goal breaks a zone
    hard_keep_in    terminal 1 held as in keep_in, 8 cones of 12 to 30 deg for the others; the
                    straight motion breaks a zone
    held_links      terminals 1 and 2 held within 10 deg of their targets, 4 cones of 15 to 30 deg for
                    terminal 3; the platform turns by 40 to 100 deg; the straight motion breaks a
                    zone

In the next kinds, see `random_kinds`, zones are of all sorts:

    masks           2 cones of 12 to 25 deg about axes of the body for each terminal
    beams           3 cones of 10 to 40 deg, each about a terminal's beam and for another terminal
    panels          a vector of the body held within 60 to 90 deg of a direction, three others 20 to 40 deg
                    away from one each
    carried         vectors of the terminals' moving parts, one held and three kept away as in panels
    joint_bounds    a forbidden quadrangle of yaw and pitch for each terminal
    grouped         3 groups of two entries, each of two zones: on the sky for a vector of the body, and for a
                    terminal on the sky or about an axis of the body
    moving          4 cones of 15 to 30 deg that move by 0.02 to 0.08 deg/s, one of them for a vector of the
                    body
    moved_goals     the cones of carried that vectors are kept away from, and joint_bounds; the nearest goal
                    without zones breaks one, but another within 30 deg of it none
    terminal_masks  a mask of four corners in each terminal's yaw and pitch
    fields          a field of view of 14 by 8 deg for each terminal, from which a direction stays 3 to 10
                    deg away, and one of 24 by 14 deg for a camera, from which three stay 5 to 15 deg away
    mixed           two cones on the sky and one or two zones of every other sort, but no moving zones,
                    masks of terminals or fields of view

In these the straight motion to the nearest goal breaks a zone; only in moved_goals it is that goal itself
that does. In the last kind the spacecraft is random too, and nothing of what follows holds, see
`any_spacecraft`:

    any_spacecraft  up to 4 terminals, 2 drives and 3 instruments of any mounting, with masks, zones of all
                    sorts that stand still, fields of view, limits of any axis, and goals by names of devices

In all other kinds the goal is the same: the lines of sight of the paper's orbits, to be met with yaws within
88 deg and pitches within 13 deg. Start and goal are at least 2 deg inside their joint limits and 2 deg (in
the hard kinds 1 deg) clear of their zones.

**The draws.** Joints are uniform within 88 and 13 deg and the attitude is uniform on SO(3). Of these starts
those are used whose held terminals are near enough to their targets, and whose turn to the nearest goal is as
wanted. Half angles are uniform; so are directions, outside of what must be clear at start and goal. Where
the straight motion must break a zone, zones are drawn again until it does. Only where `PATIENCE` attempts are
not enough, as between a start and a goal close by, another start is drawn too: so starts and half angles keep
their distributions as far as possible.

**On every machine.** All comes from uniform and normal draws of PCG64, in a stream for the kind and the seed,
so that numbers are the same to rounding. A decision could differ only where a candidate is at its threshold
to rounding; the tests show that none is. Thresholds are stricter by `HAIR` than what is stated above.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from jaxplan.cases import any_spacecraft, random_kinds
from jaxplan.cases.random_starts import (
    BROKEN,
    LONGEST_TURN,
    PATIENCE,
    admissible,
    at_rest,
    nearest_goal,
    setting,
    starts,
    straight_motion,
)
from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import Scenario, SearchSettings
from jaxplan.model.zones import KeepIn, KeepOut, Zone


@dataclass(frozen=True, kw_only=True)
class _Kind:
    """How the scenes of a kind are drawn; angles in rad unless they say deg.

    Attributes:
        cones: number of keep-out cones, which bind all terminals that are not held.
        half_angles: least and greatest half angle of these cones, deg.
        clearance: least angle between the cones and the boresights at start and goal.
        held: number of terminals, counted from the first, that must stay in a cone around their targets.
        hold: half angle of these keep-in cones.
        start_within: greatest angle at the start between a held terminal and its target; less than `hold`.
        turn: least and greatest rotation of the platform from start to goal, where `blocked`.
        blocked: whether the straight motion to the goal breaks a zone.
    """

    cones: int
    half_angles: tuple[float, float] = (15.0, 30.0)
    clearance: float = math.radians(2.0)
    held: int = 0
    hold: float = math.radians(15.0)
    start_within: float = math.radians(12.0)
    turn: tuple[float, float] = (0.0, LONGEST_TURN)
    blocked: bool = False


_HARD_KIND = _Kind(cones=8, half_angles=(12.0, 30.0), clearance=math.radians(1.0), blocked=True)
_KINDS = {  # a kind's place here sets its random stream: add new ones at the end
    "keep_out": _Kind(cones=4),
    "keep_in": _Kind(cones=3, held=1),
    "hard_keep_out": _HARD_KIND,
    "hard_keep_in": replace(_HARD_KIND, held=1),
    "held_links": _Kind(
        cones=4,
        held=2,
        hold=math.radians(10.0),
        start_within=math.radians(8.0),
        turn=(math.radians(40.0), math.radians(100.0)),
        blocked=True,
    ),
}
SKY_KINDS = tuple(_KINDS)
"""Kinds whose zones are all cones about directions that stand still on the sky, for terminals."""
ANY_SPACECRAFT = "any_spacecraft"
RANDOM_KINDS = (*SKY_KINDS, *random_kinds.KINDS, ANY_SPACECRAFT)
"""All kinds."""
_ANY_SPACECRAFT_STREAM = 1000  # number of its random stream, unchanged when kinds are added

DIRECTIONS = 16
"""Number of directions drawn at once for a cone, of which the first that is clear is taken."""


def random_scenario(seed: int, kind: str = "keep_out") -> Scenario:
    """Draw a random scene.

    Args:
        seed: 0 or more; scenes of different seeds or kinds are independent.
        kind: one of `RANDOM_KINDS`.

    Returns:
        The scenario. Its goal is `Targets`, but in some scenes of "any_spacecraft" a state. Its settings are
        the defaults, except for the steps of the search: 0.1 rad for the attitude, and for joints 0.08 rad as
        in the paper's Table 4, or 0.1 rad in scenes of "any_spacecraft".

    Raises:
        ValueError: if there is no such kind, or the seed is not an integer of at least 0.

    Example:
        >>> import jaxplan as jp
        >>> plan = jp.plan(jp.random_scenario(3, "keep_in"))
    """
    if kind not in RANDOM_KINDS:
        raise ValueError(f"kind = {kind!r}: must be one of {', '.join(RANDOM_KINDS)}")
    if not _is_seed(seed):
        raise ValueError(f"seed = {seed!r}: must be an integer of at least 0")
    place = _ANY_SPACECRAFT_STREAM if kind == ANY_SPACECRAFT else RANDOM_KINDS.index(kind)
    stream = np.random.SeedSequence(0, spawn_key=(place, int(seed)))
    rng = np.random.Generator(np.random.PCG64(stream))
    if kind == ANY_SPACECRAFT:
        return any_spacecraft.draw(rng, f"{kind} {seed}")
    if kind in _KINDS:
        start, keep_out, keep_in = _draw_scene(rng, _KINDS[kind])
        zones: tuple[Zone, ...] = (*keep_out, *keep_in)
    else:
        start, zones = random_kinds.draw(rng, random_kinds.KINDS[kind])
    _, targets = setting()
    return Scenario(
        name=f"{kind} {seed}",
        spacecraft=random_kinds.equipped(zones),
        start=start,
        goal=targets,
        **random_kinds.sorts(zones),
        search=SearchSettings(attitude_step=0.1, joint_step=0.08),
    )


def _is_seed(value: object) -> bool:
    """Tell whether a value is an integer of at least 0."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and int(value) >= 0


def _draw_scene(
    rng: np.random.Generator, kind: _Kind
) -> tuple[GivenState, tuple[KeepOut, ...], tuple[KeepIn, ...]]:
    """Draw the start, at rest, and the keep-out and keep-in zones of a scene of a kind."""
    craft, targets = setting()
    keep_in = tuple(
        KeepIn(name=f"link-{i + 1}", direction=direction, half_angle=kind.hold, devices=(terminal.name,))
        for i, (terminal, direction) in enumerate(
            zip(craft.terminals[: kind.held], targets.directions, strict=False)
        )
    )
    for attitude, joints, seen in starts(rng, kind.held, kind.start_within):
        goal = nearest_goal(attitude, *kind.turn) if kind.blocked else None
        if kind.blocked and goal is None:
            continue
        straight = None if goal is None else straight_motion(attitude, joints, goal)
        for _ in range(PATIENCE):
            keep_out = _draw_keep_out(rng, kind, np.concatenate([seen, targets.directions]).reshape(2, 3, 3))
            if straight is None or _breaks_zone(straight, keep_out, keep_in):
                return at_rest(attitude, joints), keep_out, keep_in
    raise AssertionError("there are always more starts")


def _draw_keep_out(rng: np.random.Generator, kind: _Kind, ends: np.ndarray) -> tuple[KeepOut, ...]:
    """Draw keep-out cones for the terminals that are not held, clear of their boresights at start and goal.

    Args:
        rng: source of the draws.
        kind: of the scene.
        ends: (2, 3, 3) inertial boresights of the terminals at start and goal.
    """
    free = ends[:, kind.held :].reshape(-1, 3)
    names = tuple(terminal.name for terminal in setting()[0].terminals[kind.held :])
    cones = []
    for i, degrees in enumerate(rng.uniform(*kind.half_angles, kind.cones)):
        half_angle = math.radians(degrees)
        clear = np.zeros(1, dtype=bool)
        while not clear.any():
            directions = rng.standard_normal((DIRECTIONS, 3))
            directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
            slack = math.cos(half_angle + kind.clearance) - directions @ free.T
            clear = np.all(admissible(slack), axis=-1)
        direction = directions[np.argmax(clear)]
        cones.append(
            KeepOut(
                name=f"cone-{i + 1}",
                direction=direction,
                half_angle=half_angle,
                devices=names if kind.held else (),
            )
        )
    return tuple(cones)


def _breaks_zone(straight: np.ndarray, keep_out: tuple[KeepOut, ...], keep_in: tuple[KeepIn, ...]) -> bool:
    """Tell whether a motion goes deeper than `BROKEN` into a keep-out zone, or as far out of a keep-in zone.

    Args:
        straight: (k, 3, 3) inertial boresights of the three terminals at k samples.
        keep_out: zones for the terminals that are not held.
        keep_in: zones for the held terminals, one for each in order.
    """
    held = len(keep_in)
    depths = [
        np.max(straight[:, held:] @ zone.direction) - math.cos(zone.half_angle - BROKEN) for zone in keep_out
    ] + [
        math.cos(zone.half_angle + BROKEN) - np.min(straight[:, i] @ zone.direction)
        for i, zone in enumerate(keep_in)
    ]
    return bool(np.any(admissible(np.array(depths))))
