"""From what Python gives for a scenario to the model's own types, with all faults reported at once.

Lists become tuples or float64 arrays, numbers of any type floats, and a single number that stands for three
becomes three. A value of the wrong type or shape is a fault, by its attribute; whether numbers are in range
is checked where the tables of a file are read, which `read_back` does with those that would be written.
"""

from collections.abc import Mapping
from typing import Any

from jaxplan.given import as_floats, expect
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft, Terminal
from jaxplan.scenario.faults import DeviceNames, Place, ScenarioError
from jaxplan.scenario.layout import SCENARIO, SPACECRAFT
from jaxplan.scenario.reading import (
    check_inertia,
    check_names,
    device_names,
    read_scenario,
    scenario_from_dict,
)
from jaxplan.scenario.spelling import python_root


def take_in(given: object) -> Scenario:
    """The scenario with arrays, tuples and floats of Python's own where something else was given.

    Raises:
        TypeError: if it is no scenario.
        ScenarioError: if an attribute has the wrong type or shape; the message lists every fault.
    """
    scenario = expect("scenario", given, Scenario)
    terminals, others = _terminals(scenario), _of_states(scenario)
    if terminals is None or others is None or len(terminals) == others:
        devices = DeviceNames(terminals, None)
        quick = Place(faults=[], devices=devices)
        taken: Scenario = SCENARIO.take(scenario, quick)
        if not quick.faults:
            return taken
        root = python_root(devices)  # once more, to tell them
    else:
        root = python_root(DeviceNames(None, None))  # so that start and goal are not blamed, too
        complaint = f"must be as many as start and goal are for, {others}, not {len(terminals)}"
        root.key("spacecraft").key("terminal").fault(complaint)
    SCENARIO.take(scenario, root)
    raise ScenarioError(root.faults)


def read_back(tables: Mapping[str, Any]) -> Scenario:
    """The scenario that tables hold, which were written from one that Python gave.

    Raises:
        ScenarioError: if a number is out of its range, or parts do not go together; the message lists every
            fault by its attribute and in its unit.
    """
    try:
        return scenario_from_dict(tables)
    except ScenarioError:
        return read_scenario(tables, python_root(device_names(tables)))  # once more, to tell them


def checked_spacecraft(given: object) -> Spacecraft:
    """A spacecraft by itself, taken in as that of a scenario, its numbers within the ranges of a file.

    Raises:
        TypeError: if it is none.
        ScenarioError: for what no scenario may have; the message lists every fault.
    """
    expect("spacecraft", given, Spacecraft)
    root = python_root(DeviceNames(None, None))
    taken: Spacecraft = SPACECRAFT.take(given, root.key("spacecraft"))
    if not root.faults:
        tables = {"spacecraft": SPACECRAFT.write(taken)}
        SPACECRAFT.read(tables["spacecraft"], root.key("spacecraft"))
        check_names(tables, root)
        check_inertia(tables, root)
    if root.faults:
        raise ScenarioError(root.faults, "the argument")
    return taken


def _terminals(given: Scenario) -> tuple[str, ...] | None:
    """The names of the terminals; None where something else stands among them, or in their place."""
    terminals: object = getattr(given.spacecraft, "terminals", None)
    if isinstance(terminals, list | tuple) and all(isinstance(one, Terminal) for one in terminals):
        return tuple(str(one.name) for one in terminals)
    return None


def _of_states(given: Scenario) -> int | None:
    """Of how many terminals start and goal are; None where they do not agree, or cannot be told."""
    directions = getattr(given.goal, "directions", None)
    if isinstance(directions, list | tuple):
        goal: float | None = len(directions)
    else:
        goal = (
            _length(directions) if directions is not None else _length(getattr(given.goal, "joints", None), 2)
        )
    start = _length(getattr(given.start, "joints", None), 2)
    return int(start) if start is not None and start == goal and start % 1 == 0 else None


def _length(value: object, of: int = 1) -> float | None:
    """How often an array has so many entries; None for what is no array of numbers."""
    array = as_floats(value)
    return len(array) / of if array is not None and array.ndim else None
