"""Files that hold scenarios; their dataclasses are those of `jaxplan.model.scenario`.

`layout` says what a file may hold, of `tables` and `kinds` of values, and `checks` what must go together;
`reading` goes from files to the dataclasses and back, and from what Python gives to the dataclasses' own
types. `spelling` has words for every key, `numbers` those numbers that may be tuned.
"""

from jaxplan.schema.faults import ScenarioError
from jaxplan.schema.reading import (
    dump_scenario,
    load_scenario,
    parse_scenario,
    save_scenario,
    scenario_from_dict,
    scenario_to_dict,
    with_settings,
)

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
