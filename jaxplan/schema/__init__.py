"""Scenario and timeline files: reading, writing and checking; their dataclasses are those of `jaxplan.model`.

What a file may hold is declared with the fields of these dataclasses. `value_kinds` and `arrays` read single
values, `tables` makes tables of dataclasses, and `layout` adds what no field can declare. `checks` finds
values that do not go together, and `sky` replaces names of bodies and satellites by directions. `reading` and
`timelines` have the entry points, `text` reads and writes TOML and makes commented files, `observers` reads
the table [sky] alone, and `numbers` finds the numbers that may be tuned. Terms that all of them use are
explained in `faults`.
"""

from jaxplan.schema.faults import ScenarioError
from jaxplan.schema.observers import Sky, find_observer, load_observer, load_sky
from jaxplan.schema.reading import (
    dump_scenario,
    load_scenario,
    parse_scenario,
    save_scenario,
    scenario_from_dict,
    scenario_to_dict,
    with_settings,
)
from jaxplan.schema.timelines import (
    dump_timeline,
    load_timeline,
    parse_timeline,
    save_timeline,
    take_in_timeline,
    timeline_from_dict,
    timeline_to_dict,
)

__all__ = [
    "ScenarioError",
    "Sky",
    "dump_scenario",
    "dump_timeline",
    "find_observer",
    "load_observer",
    "load_scenario",
    "load_sky",
    "load_timeline",
    "parse_scenario",
    "parse_timeline",
    "save_scenario",
    "save_timeline",
    "scenario_from_dict",
    "scenario_to_dict",
    "take_in_timeline",
    "timeline_from_dict",
    "timeline_to_dict",
    "with_settings",
]
