"""Files that hold scenarios; their dataclasses are those of `jaxplan.model.scenario`.

`layout` and `states` say what a file may hold, `reading` and `writing` go from one to the other, `taking`
from what Python gives to the dataclasses' own types, and `overrides` changes settings by their names.
"""

from jaxplan.scenario.faults import ScenarioError
from jaxplan.scenario.overrides import with_settings
from jaxplan.scenario.reading import load_scenario, parse_scenario, scenario_from_dict
from jaxplan.scenario.writing import dump_scenario, save_scenario, scenario_to_dict

__all__ = [
    "ScenarioError",
    "dump_scenario",
    "load_scenario",
    "parse_scenario",
    "save_scenario",
    "scenario_from_dict",
    "scenario_to_dict",
    "with_settings",
]
