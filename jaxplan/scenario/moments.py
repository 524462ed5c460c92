"""Scenarios in which something moves: what does, for how long it is known, and targets at an instant."""

from collections.abc import Iterator

import numpy as np

from jaxplan.moving import DirectionPath
from jaxplan.scenario.model import MovingTargets, Scenario, Targets


def paths(scenario: Scenario) -> Iterator[tuple[str, DirectionPath]]:
    """All that moves, with its name in messages: zones by theirs, targets by their terminal's."""
    for zone in scenario.zones:
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


def targets_at(goal: Targets | MovingTargets, time: float) -> Targets:
    """The targets where they are at an instant, s; of such as move, at rest."""
    if isinstance(goal, Targets):
        return goal
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
