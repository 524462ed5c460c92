"""Scenarios without what no number follows from: names, the epoch, and how a plan was looked for.

To JAX these are part of a scenario's structure, and for another structure a kernel is compiled anew.
"""

from dataclasses import fields, replace
from typing import Any, TypeVar

import jax

from jaxplan.model.directions import DirectionPath
from jaxplan.model.scenario import Scenario, SearchSettings

Tree = TypeVar("Tree")


def bare(scenario: Scenario) -> Scenario:
    """Return a scenario without name and epoch."""
    return replace(scenario, name="", epoch=None)


def nameless(scenario: Scenario) -> Scenario:
    """Return a scenario with the same trajectory for the same choices, and without what does not tell it.

    Zones are named by their numbers. Devices keep their names, by which targets and zones refer to them.
    """
    found_by: dict[str, Any] = {
        field.name: field.default for field in fields(SearchSettings) if field.metadata["static"]
    }

    def numbered(zones: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(replace(zone, name=str(number)) for number, zone in enumerate(zones))

    return unlabelled(
        replace(
            bare(scenario),
            keep_out=numbered(scenario.keep_out),
            keep_in=numbered(scenario.keep_in),
            joint_bounds=numbered(scenario.joint_bounds),
            search=replace(scenario.search, **found_by),
        )
    )


def unlabelled(tree: Tree) -> Tree:
    """Return a scenario or targets with directions that do not tell what lies there and when it is hidden."""
    plain: Tree = jax.tree.map(
        lambda one: replace(one, hidden=(), called="") if isinstance(one, DirectionPath) else one,
        tree,
        is_leaf=lambda one: isinstance(one, DirectionPath),
    )
    return plain
