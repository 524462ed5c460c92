"""What is planned is what a scenario file would say: checked alike, and the same when it is read back."""

from typing import Any

import jax
import numpy as np

from jaxplan.scenario import Scenario, ScenarioError, scenario_from_dict, scenario_to_dict
from jaxplan.scenario.moments import moves
from jaxplan.search import PLANNERS
from jaxplan.trajectory import METHODS


def as_filed(name: str, given: object) -> Scenario:
    """A scenario that was made in Python, as a file would hold it.

    Args:
        name: of the argument, for messages.
        given: to be planned.

    Raises:
        TypeError: for what is no scenario, such as the name of a file, or holds what no file could.
        ScenarioError: for values that a file may not have, every fault by its key.
        ValueError: for methods that do not exist, or cannot follow what moves.
    """
    if not isinstance(given, Scenario):
        kind = type(given).__name__
        raise TypeError(f"{name} must be a Scenario, not {kind}; jp.load_scenario reads one from a file")
    for part, methods in (("search", PLANNERS), ("trajectory", METHODS)):
        method = getattr(given, part).method
        if method not in methods:
            known = " or ".join(f'"{known}"' for known in methods)
            raise ValueError(f"{name}.{part}.method = {method!r}: must be {known}")
    filed = _through_tables(name, given) if _told(given.start) and _told(given.goal) else given
    duration = filed.trajectory.duration
    if isinstance(duration, str) and moves(filed) and filed.trajectory.method == "paper":
        raise ValueError(
            f'{name}.trajectory.duration = "{duration}": must be a number with '
            'trajectory.method = "paper", since something moves'
        )
    return filed


def _told(end: object) -> bool:
    """Whether a start or goal is made of numbers; one that is not is a plan's status to tell."""
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(end)]
    return all(leaf.dtype.kind not in "fc" or bool(np.all(np.isfinite(leaf))) for leaf in leaves)


def _through_tables(name: str, given: Scenario) -> Scenario:
    """The scenario after a way through the tables of a file."""
    try:
        tables: dict[str, Any] = scenario_to_dict(given)
    except (AttributeError, IndexError, TypeError, ValueError) as error:
        raise TypeError(
            f"{name}: a field is not of the type that jp.Scenario documents, such as an array ({error})"
        ) from error
    try:
        return scenario_from_dict(tables)
    except ScenarioError as error:
        raise ScenarioError(error.faults, name) from error
