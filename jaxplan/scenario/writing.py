"""From the model to the dict of a scenario file, its text and the file itself.

Reading the result gives every number back with the same bits, for all that can be said in the file's units.
Required keys are written, and settings that differ from their default.
"""

import os
from typing import Any

from jaxplan.given import file_path
from jaxplan.model.scenario import Scenario
from jaxplan.runtime.files import replacing_file
from jaxplan.scenario import toml
from jaxplan.scenario.layout import SCENARIO
from jaxplan.scenario.taking import take_in


def scenario_to_dict(scenario: Scenario) -> dict[str, Any]:
    """The tables of the scenario's file.

    Args:
        scenario: in radians and seconds.

    Returns:
        Dicts, lists, numbers and strings with the keys and units of a file, ready for TOML or JSON.

    Raises:
        ScenarioError: if it could not be read again; the message lists every fault.
    """
    return SCENARIO.write(take_in(scenario))


def dump_scenario(scenario: Scenario) -> str:
    """The text of the scenario's file.

    Args:
        scenario: in radians and seconds.

    Returns:
        TOML. A quaternion comes out as the rotation vector it was read to.

    Raises:
        ScenarioError: if it could not be read again; the message lists every fault.
    """
    return toml.write(scenario_to_dict(scenario))


def save_scenario(scenario: Scenario, path: str | os.PathLike[str]) -> None:
    """Write the scenario's file, whole or not at all.

    Args:
        scenario: in radians and seconds.
        path: of the file; one that is there is replaced.

    Raises:
        ScenarioError: if it could not be read again; the message lists every fault.
        OSError: the file cannot be written; one that was there is left as it was.
    """
    text = dump_scenario(scenario)
    with replacing_file(file_path("path", path)) as temporary:
        temporary.write_bytes(text.encode())
