"""What a search takes for zones that move, which itself knows only zones that stand still.

`swept`: for each a cone that holds it, or for keep-in is held by it, over the whole manoeuvre, as far as the
zone leaves start and goal clear at their own times. It guides the search; whether the motion keeps the zones
as they move is for the fit and the certificate to say.

`always`: cones of directions that are forbidden at every instant. A ring of these parts start from goal for
good, so they serve for the proof that there is no path.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from jaxplan.geometry.directions import separation
from jaxplan.moving import DirectionPath
from jaxplan.path import Goal, MovingGoal
from jaxplan.scenario import MovingTargets, Scenario
from jaxplan.scenario.moments import Zone, axis_at, known_until
from jaxplan.search import alone_and_grouped
from jaxplan.zones import KeepIn, KeepOut

_SMALLEST = 1e-3  # rad, of a cone, and of what it leaves
_ROOM = float(np.deg2rad(0.25))  # at most left to a start or goal by a cone that is cut back for it
_BROKEN = -1e-8  # rad, a margin


def swept(scenario: Scenario, goal: Goal, attitude: np.ndarray, share: float = 1.0) -> Scenario:
    """The scenario with cones that stand for zones that move over the manoeuvre.

    Args:
        scenario: one in which nothing moves is returned itself.
        goal: where and when the manoeuvre ends.
        attitude: (3, 3) of the start.
        share: of what zones sweep that the cones are to hold, 0 for zones as they are in the middle of it.
    """
    if not isinstance(goal, MovingGoal):
        return scenario
    craft, last_time = scenario.spacecraft, goal.time
    ends = (
        (0.0, craft.boresights(attitude, scenario.start.joints)),
        (last_time, craft.boresights(goal.attitude, goal.joints)),
    )

    def cone(zone: Zone) -> Zone:
        if not isinstance(zone.direction, DirectionPath):
            return zone
        axis, reach = _swing(zone.direction, last_time)
        side = _side(zone)
        half_angle = zone.half_angle + side * share * reach
        for time, seen in ends:
            bound = [seen[i] for i, name in enumerate(craft.device_names) if _binds(zone, name)]
            margins = [side * (separation(axis_at(zone, time), one) - zone.half_angle) for one in bound]
            if min(margins, default=-np.inf) < _BROKEN:
                continue  # another zone of its group holds there
            for one, margin in zip(bound, margins, strict=True):
                nearest = separation(axis, one) - side * np.clip(margin / 2, 0, _ROOM)
                half_angle = side * min(side * half_angle, side * nearest)
        return replace(
            zone, direction=axis, half_angle=float(np.clip(half_angle, _SMALLEST, np.pi - _SMALLEST))
        )

    return replace(
        scenario,
        keep_out=tuple(cone(zone) for zone in scenario.keep_out),
        keep_in=tuple(cone(zone) for zone in scenario.keep_in),
    )


def always(scenario: Scenario, goal: Goal) -> Scenario:
    """The scenario with cones for what zones that move forbid at every instant, where they forbid anything.

    Where the duration is to be found, that is as long as zones are known; and where targets move then, too,
    so that the goal may be elsewhere, nothing is forbidden for good.

    Args:
        scenario: one in which nothing moves is returned itself.
        goal: where and when the manoeuvre ends.
    """
    if not isinstance(goal, MovingGoal):
        return scenario
    time = goal.time
    if isinstance(scenario.trajectory.duration, str):
        if isinstance(scenario.goal, MovingTargets):
            return replace(scenario, keep_out=(), keep_in=())
        time = known_until(scenario)[0]

    def cones(zones: Iterable[Zone]) -> Iterator[Zone]:
        for zone in zones:
            if not isinstance(zone.direction, DirectionPath):
                yield zone
                continue
            axis, reach = _swing(zone.direction, time)
            half_angle = zone.half_angle - _side(zone) * reach
            if _SMALLEST < half_angle < np.pi - _SMALLEST:
                yield replace(zone, direction=axis, half_angle=half_angle)

    alone, _ = alone_and_grouped(scenario.keep_in)  # no proof may use the others
    return replace(scenario, keep_out=tuple(cones(scenario.keep_out)), keep_in=tuple(cones(alone)))


def _swing(path: DirectionPath, time: float) -> tuple[np.ndarray, float]:
    """Where an axis is in the middle of the manoeuvre, and how far it gets from there, rad."""
    axis = np.asarray(path.at(time / 2))
    return axis, path.reach(axis, 0.0, time)


def _side(zone: KeepOut | KeepIn) -> int:
    """Whether devices stay outside, +1, or inside, -1."""
    return -1 if isinstance(zone, KeepIn) else 1


def _binds(zone: Zone, device: str) -> bool:
    return not zone.devices or device in zone.devices
