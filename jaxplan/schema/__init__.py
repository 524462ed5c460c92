"""Scenario files: reading, writing and checking; their dataclasses are those of `jaxplan.model.scenario`.

What a file may hold is declared with the fields of these dataclasses. `kinds` and `arrays` read single
values, `tables` makes tables of dataclasses, and `layout` adds what no field can say. `checks` knows what
must go together, `sky` what bodies and satellites stand for. `reading` has the entry points, `text` is TOML
and has words for every key, and `numbers` finds numbers that may be tuned.
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
