"""Scenarios in which something moves: as they are at an instant, and for how long they are known.

A scenario as of an instant has zones that stand still and fixed targets, so all that knows of these only can
work on it.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import TypeVar

import numpy as np

from jaxplan.moving import DirectionPath
from jaxplan.scenario.model import MovingTargets, Scenario, Targets
from jaxplan.zones import KeepIn, KeepOut

Zone = TypeVar("Zone", KeepOut, KeepIn)


def paths(scenario: Scenario) -> Iterator[tuple[str, DirectionPath]]:
    """All that moves, with its name in messages: zones by theirs, targets by their terminal's."""
    zones: list[KeepOut | KeepIn] = [*scenario.keep_out, *scenario.keep_in]
    for zone in zones:
        if isinstance(zone.direction, DirectionPath):
            yield f"zone {zone.name}", zone.direction
    if isinstance(scenario.goal, MovingTargets):
        for terminal, target in zip(scenario.spacecraft.terminals, scenario.goal.directions, strict=True):
            if isinstance(target, DirectionPath):
                yield f"the target of {terminal.name}", target


def moves(scenario: Scenario) -> bool:
    """Whether a zone or a target moves."""
    return next(paths(scenario), None) is not None or isinstance(scenario.goal, MovingTargets)


def known_until(scenario: Scenario) -> tuple[float, str]:
    """Until when all that moves is known, s, and what is not from then on; infinite where nothing moves."""
    ends = [(float(path.times[-1]), name) for name, path in paths(scenario)]
    return min(ends, default=(np.inf, ""))


def at(scenario: Scenario, time: float) -> Scenario:
    """The scenario as it is at an instant: zones and targets where they are then, and standing still.

    Args:
        scenario: one in which nothing moves is returned itself.
        time: s from the start of the manoeuvre on.

    Raises:
        ValueError: if something that moves is not known then.
    """
    if not moves(scenario):
        return scenario
    goal = scenario.goal
    return replace(
        scenario,
        goal=targets_at(goal, time) if isinstance(goal, MovingTargets) else goal,
        keep_out=tuple(zone_at(zone, time) for zone in scenario.keep_out),
        keep_in=tuple(zone_at(zone, time) for zone in scenario.keep_in),
    )


def targets_at(goal: MovingTargets, time: float) -> Targets:
    """The targets where they are at an instant, s, and at rest."""
    directions = [one.at(time) if isinstance(one, DirectionPath) else one for one in goal.directions]
    return Targets(
        directions=np.array(directions, float).reshape(-1, 3),
        yaw_limit=goal.yaw_limit,
        pitch_limit=goal.pitch_limit,
        angular_velocity=np.zeros(3),
        joint_rates=np.zeros(2 * len(directions)),
    )


def target_rates(goal: MovingTargets, time: float) -> np.ndarray:
    """(n, 3) 1/s: how fast the targets' directions turn at an instant, s."""
    rates = [one.rate(time) if isinstance(one, DirectionPath) else np.zeros(3) for one in goal.directions]
    return np.array(rates, float).reshape(-1, 3)


def axis_at(zone: KeepOut | KeepIn, time: float = 0.0) -> np.ndarray:
    """(3,) axis of a zone at an instant, s; of one that stands still, at any."""
    moving = zone.direction
    return np.asarray(moving.at(time)) if isinstance(moving, DirectionPath) else moving


def zone_at(zone: Zone, time: float) -> Zone:
    """A zone as it is at an instant, s; one that stands still is returned itself."""
    return replace(zone, direction=axis_at(zone, time)) if is_moving(zone) else zone


def is_moving(zone: KeepOut | KeepIn) -> bool:
    """Whether its axis moves."""
    return isinstance(zone.direction, DirectionPath)
