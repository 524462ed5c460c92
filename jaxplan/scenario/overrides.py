"""Settings changed by their names, as in ``{"search.max_expansions": 500}``, in a file's keys and units."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from jaxplan.model.scenario import Scenario
from jaxplan.scenario.faults import ScenarioError, quote
from jaxplan.scenario.reading import scenario_from_dict
from jaxplan.scenario.writing import scenario_to_dict

SETTINGS_TABLES = ("search", "trajectory")


def with_settings(scenario: Scenario, settings: Mapping[str, Any]) -> Scenario:
    """The scenario with other settings; the scene itself stays as it is, to the last bit.

    Args:
        scenario: in radians and seconds.
        settings: values as a scenario file holds them, by table and key: ``search.<key>`` or
            ``trajectory.<key>``.

    Raises:
        TypeError: if settings are no dict.
        ScenarioError: if one of them is no setting, or its value is none that a file may hold; the message
            lists every fault.
    """
    given: object = settings  # whatever its type says
    if not isinstance(given, Mapping):
        raise TypeError(f'settings must be a dict such as {{"search.seed": 1}}, not {type(given).__name__}')
    if not settings:
        return scenario
    tables = scenario_to_dict(scenario)
    faults = []
    for name, value in settings.items():
        table, _, key = name.partition(".")
        if table in SETTINGS_TABLES and key:
            tables[table] = {**tables.get(table, {}), key: value}
        else:
            beginnings = " or ".join(f"{known}." for known in SETTINGS_TABLES)
            faults.append(f"{name or quote(name)}: no setting, those begin with {beginnings}")
    try:
        read = scenario_from_dict(tables)
    except ScenarioError as error:
        raise ScenarioError([*faults, *error.faults], "settings") from error
    if faults:
        raise ScenarioError(faults, "settings")
    return replace(scenario, search=read.search, trajectory=read.trajectory)
