"""From what Python gives for a scenario to the model's own types, with all faults reported at once.

Lists become tuples or float64 arrays, numbers of any type floats, and a single number that stands for three
becomes three. What a file may not hold is a fault, told by its attribute and in its unit; what is taken is
what a file would give back, to the last bit.
"""

from typing import Any

from jaxplan.given import as_floats, expect
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Instrument, Spacecraft, Terminal
from jaxplan.scenario.checks import ZONES, check_count, check_parts, check_paths, check_spacecraft
from jaxplan.scenario.faults import DeviceNames, Ear, Place, ScenarioError
from jaxplan.scenario.layout import SCENARIO, SPACECRAFT
from jaxplan.scenario.spelling import python_root


def take_in(given: object) -> Scenario:
    """The scenario with arrays, tuples and floats of Python's own where something else was given.

    Raises:
        TypeError: if it is no scenario.
        ScenarioError: if an attribute is one that no file may hold, has the wrong type or shape, or does not
            go with others; the message lists every fault.
    """
    scenario = expect("scenario", given, Scenario)
    ear = Ear([], _device_names(scenario))
    taken = _taken(scenario, ear)
    if ear.faults:
        raise _all_faults(scenario)
    return taken


def refuse_types(given: object) -> None:
    """Raise what `take_in` raises where an attribute has the wrong type or shape, and not for its value."""
    scenario = expect("scenario", given, Scenario)
    ear = Ear([], _device_names(scenario))
    _taken(scenario, ear)
    if ear.refused:
        raise _all_faults(scenario)


def _all_faults(scenario: Scenario) -> ScenarioError:
    """The error that tells them, of a scenario that has some."""
    root = python_root(_device_names(scenario))
    _taken(scenario, root)
    return ScenarioError(root.faults)


def _taken(scenario: Scenario, root: Place) -> Any:
    """The scenario as it is taken, or what could be taken of it after noting its faults."""
    if not check_count([getattr(scenario, attribute) for attribute in ZONES.values()], root):
        return None
    terminals, others = root.devices.terminals, None
    if terminals is None:
        terminals, others = _names(scenario, "terminals", Terminal), _of_states(scenario)
    if terminals is not None and others is not None:
        complaint = f"must be as many as start and goal are for, {others}, not {len(terminals)}"
        root.key("spacecraft").key("terminal").fault(complaint)
    taken = SCENARIO.take(scenario, root)
    check_parts(taken, root)
    check_paths(taken, root)
    return taken


def checked_spacecraft(given: object) -> Spacecraft:
    """A spacecraft by itself, taken in as that of a scenario, its numbers within the ranges of a file.

    Raises:
        TypeError: if it is none.
        ScenarioError: for what no scenario may have; the message lists every fault.
    """
    expect("spacecraft", given, Spacecraft)
    place = python_root(DeviceNames(None, None)).key("spacecraft")
    taken: Spacecraft = SPACECRAFT.take(given, place)
    check_spacecraft(taken, place)
    if place.faults:
        raise ScenarioError(place.faults, "the argument")
    return taken


def _device_names(scenario: Scenario) -> DeviceNames:
    """The names of the devices, as far as start and goal are for as many terminals."""
    terminals, others = _names(scenario, "terminals", Terminal), _of_states(scenario)
    if terminals is not None and others is not None and len(terminals) != others:
        return DeviceNames(None, None)  # so that start and goal are not blamed, too
    return DeviceNames(terminals, _names(scenario, "instruments", Instrument))


def _names(scenario: Scenario, kind: str, model: type) -> tuple[str, ...] | None:
    """The names of devices; None where something else stands among them, or in their place."""
    devices: Any = getattr(scenario.spacecraft, kind, None)
    if isinstance(devices, list | tuple) and all(isinstance(one, model) for one in devices):
        return tuple(str(one.name) for one in devices)
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
