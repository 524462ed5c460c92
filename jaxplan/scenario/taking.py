"""From what Python gives for a scenario to the model's own types, with all faults reported at once.

Lists become tuples or float64 arrays, numbers of any type floats, and a single number that stands for three
becomes three. A value of the wrong type or shape is a fault, by its attribute; whether numbers are in range
is checked where the tables of a file are read, which planning does with every scenario.
"""

from jaxplan.given import expect, show
from jaxplan.scenario.faults import DeviceNames, Place, ScenarioError
from jaxplan.scenario.layout import SCENARIO, SPACECRAFT
from jaxplan.scenario.model import Scenario
from jaxplan.scenario.reading import check_inertia, check_names
from jaxplan.spacecraft import Spacecraft


def take_in(given: object) -> Scenario:
    """The scenario with arrays, tuples and floats of Python's own where something else was given.

    Raises:
        TypeError: if it is no scenario.
        ScenarioError: if an attribute has the wrong type or shape; the message lists every fault.
    """
    expect("scenario", given, Scenario)
    root = Place(faults=[], devices=_device_names(given), show=show)
    taken: Scenario = SCENARIO.take(given, root)
    if root.faults:
        raise ScenarioError(root.faults)
    return taken


def checked_spacecraft(given: object) -> Spacecraft:
    """A spacecraft by itself, taken in as that of a scenario, its numbers within the ranges of a file.

    Raises:
        TypeError: if it is none.
        ScenarioError: for what no scenario may have; the message lists every fault.
    """
    expect("spacecraft", given, Spacecraft)
    root = Place(faults=[], devices=DeviceNames(None, None), show=show)
    taken: Spacecraft = SPACECRAFT.take(given, root.key("spacecraft"))
    if not root.faults:
        tables = {"spacecraft": SPACECRAFT.write(taken)}
        SPACECRAFT.read(tables["spacecraft"], root.key("spacecraft"))
        check_names(tables, root)
        check_inertia(tables, root)
    if root.faults:
        raise ScenarioError(root.faults, "the argument")
    return taken


def _device_names(given: object) -> DeviceNames:
    """The names of terminals, of which there must be as many joints and targets; None where none can tell."""
    terminals = getattr(getattr(given, "spacecraft", None), "terminals", None)
    if not isinstance(terminals, list | tuple):
        return DeviceNames(None, None)
    return DeviceNames(tuple(str(getattr(one, "name", "")) for one in terminals), None)
