"""From what Python gives for a scenario to the model's own types, with all faults reported at once.

Lists become tuples or float64 arrays, numbers of any type floats, and a single number that stands for three
becomes three. A value of the wrong type or shape is a fault, by its attribute; whether numbers are in range
is checked where the tables of a file are read, which planning does with every scenario.
"""

from jaxplan.given import expect, show
from jaxplan.scenario.faults import DeviceNames, Place, ScenarioError
from jaxplan.scenario.layout import SCENARIO
from jaxplan.scenario.model import Scenario


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


def _device_names(given: object) -> DeviceNames:
    """The names of terminals, of which there must be as many joints and targets; None where none can tell."""
    terminals = getattr(getattr(given, "spacecraft", None), "terminals", None)
    if not isinstance(terminals, list | tuple):
        return DeviceNames(None, None)
    return DeviceNames(tuple(str(getattr(one, "name", "")) for one in terminals), None)
