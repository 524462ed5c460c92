"""Scenarios without what no number of a plan follows from: titles, the epoch, and how it was looked for.

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

    Zones are named by their places. Devices, wheels and groups of zones keep their names.
    """
    found_by: dict[str, Any] = {
        field.name: field.default for field in fields(SearchSettings) if field.metadata["static"]
    }

    def numbered(key: str) -> tuple[Any, ...]:
        zones = getattr(scenario, key)
        return tuple(replace(zone, name=f"{key}[{number}]") for number, zone in enumerate(zones))

    return unlabelled(
        replace(
            bare(scenario),
            keep_out=numbered("keep_out"),
            keep_in=numbered("keep_in"),
            joint_bounds=numbered("joint_bounds"),
            search=replace(scenario.search, **found_by),
            trajectory=replace(scenario.trajectory, first_guesses=0, optimal=False),
        )
    )


def unlabelled(tree: Tree) -> Tree:
    """Return a tree whose directions do not tell what lies there, and when it is hidden (`DirectionPath`)."""
    plain: Tree = jax.tree.map(
        lambda one: replace(one, hidden=(), called="") if isinstance(one, DirectionPath) else one,
        tree,
        is_leaf=lambda one: isinstance(one, DirectionPath),
    )
    return plain
