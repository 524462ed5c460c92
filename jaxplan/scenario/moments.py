"""Scenarios in which something moves: what does, and for how long it is known."""

from collections.abc import Iterator

import numpy as np

from jaxplan.moving import DirectionPath
from jaxplan.scenario.model import GivenState, Scenario


def paths(scenario: Scenario) -> Iterator[tuple[str, DirectionPath]]:
    """All that moves, with its name in messages: zones by theirs, targets by their terminal's."""
    named = [(f"zone {zone.name}", zone.path) for zone in scenario.zones]
    if not isinstance(scenario.goal, GivenState):
        terminals = scenario.spacecraft.terminals
        named += [
            (f"the target of {terminal.name}", path)
            for terminal, path in zip(terminals, scenario.goal.paths, strict=False)
        ]
    for name, path in named:
        if path is not None and path.moves:
            yield name, path


def moves(scenario: Scenario) -> bool:
    """Whether a zone or a target moves."""
    return next(paths(scenario), None) is not None


def targets_move(scenario: Scenario) -> bool:
    """Whether a target moves, so that where the goal is depends on when."""
    return not isinstance(scenario.goal, GivenState) and scenario.goal.moves


def known_until(scenario: Scenario) -> tuple[float, str]:
    """Until when all that moves is known, s, and what is not from then on; infinite where nothing moves."""
    ends = [(float(path.times[-1]), name) for name, path in paths(scenario)]
    return min(ends, default=(np.inf, ""))
