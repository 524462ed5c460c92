"""Scenarios in which something moves: what does, and for how long it is known."""

from collections.abc import Iterator
from itertools import chain

import numpy as np

from jaxplan.model.moving import DirectionPath
from jaxplan.model.scenario import Scenario


def paths(scenario: Scenario) -> Iterator[tuple[str, DirectionPath]]:
    """All that moves, with its name in messages: zones by theirs, targets by their terminal's."""
    named = ((f"zone {zone.name}", zone.direction) for zone in scenario.zones)
    targets = zip(scenario.spacecraft.terminals, scenario.goal.directions, strict=False)
    named_targets = ((f"the target of {terminal.name}", direction) for terminal, direction in targets)
    for name, direction in chain(named, named_targets):
        if isinstance(direction, DirectionPath) and direction.moves:
            yield name, direction


def moves(scenario: Scenario) -> bool:
    """Whether a zone or a target moves."""
    return next(paths(scenario), None) is not None


def known_until(scenario: Scenario) -> tuple[float, str]:
    """Until when all that moves is known, s, and what is not from then on; infinite where nothing moves."""
    ends = [(float(path.times[-1]), name) for name, path in paths(scenario)]
    return min(ends, default=(np.inf, ""))
