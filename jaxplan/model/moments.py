"""Scenarios in which something moves: what does, and for how long it is known."""

from collections.abc import Iterator

import numpy as np

from jaxplan.model.moving import DirectionPath
from jaxplan.model.scenario import Scenario


def paths(scenario: Scenario) -> Iterator[tuple[str, DirectionPath]]:
    """All that moves, with its name in messages: zones by theirs, targets by their terminal's."""
    for zone in scenario.zones:
        if zone.moves and zone.path is not None:
            yield f"zone {zone.name}", zone.path
    if scenario.goal.moves:
        for terminal, path in zip(scenario.spacecraft.terminals, scenario.goal.paths, strict=True):
            if path.moves:
                yield f"the target of {terminal.name}", path


def moves(scenario: Scenario) -> bool:
    """Whether a zone or a target moves."""
    return next(paths(scenario), None) is not None


def known_until(scenario: Scenario) -> tuple[float, str]:
    """Until when all that moves is known, s, and what is not from then on; infinite where nothing moves."""
    ends = [(float(path.times[-1]), name) for name, path in paths(scenario)]
    return min(ends, default=(np.inf, ""))
