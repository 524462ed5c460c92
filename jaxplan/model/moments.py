"""Scenarios in which something moves: what does, and for how long it is known."""

from collections.abc import Iterator

import numpy as np

from jaxplan.model.moving import DirectionPath
from jaxplan.model.scenario import Scenario


def paths(scenario: Scenario) -> Iterator[tuple[str, DirectionPath]]:
    """All that moves, with its name in messages: zones by theirs, targets by their terminal's."""
    targets = zip(scenario.spacecraft.terminals, scenario.goal.paths, strict=False)
    named = [(f"zone {zone.name}", zone.path) for zone in scenario.zones]
    named += [(f"the target of {terminal.name}", path) for terminal, path in targets]
    for name, path in named:
        if path is not None and path.moves:
            yield name, path


def moves(scenario: Scenario) -> bool:
    """Whether a zone or a target moves."""
    return next(paths(scenario), None) is not None


def known_until(scenario: Scenario) -> tuple[float, str]:
    """Until when all that moves is known, s, and what is not from then on; infinite where nothing moves."""
    ends = [(float(path.times[-1]), name) for name, path in paths(scenario)]
    return min(ends, default=(np.inf, ""))
