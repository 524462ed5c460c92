"""What is planned is what a scenario file would say: checked alike, with the numbers that it would hold."""

from jaxplan.given import expect
from jaxplan.model.scenario import Scenario
from jaxplan.scenario import ScenarioError
from jaxplan.scenario.taking import take_in
from jaxplan.search import PLANNERS
from jaxplan.trajectory import METHODS


def as_filed(name: str, given: object) -> Scenario:
    """A scenario that was made in Python, as a file would hold it.

    Args:
        name: of the argument, for messages.
        given: to be planned.

    Raises:
        TypeError: for what is no scenario, such as the name of a file.
        ScenarioError: for values that a file may not have, and those of a wrong type or shape; the message
            lists every fault by its attribute.
        ValueError: for methods that do not exist.
    """
    several = isinstance(given, list | tuple)
    advice = "jp.plan_batch plans several" if several else "jp.load_scenario reads one from a file"
    scenario = expect(name, given, Scenario, advice)
    for part, methods in (("search", PLANNERS), ("trajectory", METHODS)):
        method = getattr(getattr(scenario, part), "method", None)
        if isinstance(method, str) and method not in methods:
            known = " or ".join(f'"{known}"' for known in methods)
            raise ValueError(f"{name}.{part}.method = {method!r}: must be {known}")
    try:
        return take_in(scenario)
    except ScenarioError as error:
        raise ScenarioError(error.faults, name) from error
