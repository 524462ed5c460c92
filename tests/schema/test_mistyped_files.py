"""Files with one value mistyped anywhere: they have faults or none, and nothing else is raised.

The files have what `test_scenario_faults` does not: drives, inertias of moving parts in any mounting, a start
by targets with wishes, names of ``[sky]``, and activities.
"""

import tomllib

import pytest
from tables import put

import jaxplan.schema as sc

pytest.importorskip("erfa", reason="pyerfa is not installed")

CRAFT = """
name = "mistyped"
[spacecraft]
rate_limit_deg_s = 1.0
acceleration_limit_deg_s2 = 0.5
inertia_kg_m2 = [80, 110, 95]
[[spacecraft.terminal]]
name = "antenna"
mount = { yaw_axis = [0, 0, 1], boresight = [1, 0, 0] }
yaw_range_deg = [-270, 270]
pitch_range_deg = [0, 85]
rate_limit_deg_s = 4
acceleration_limit_deg_s2 = 2
yaw_inertia_kg_m2 = [0.3, 0.3, 0.4]
[[spacecraft.instrument]]
name = "telescope"
boresight = [0, 0, 1]
[[spacecraft.drive]]
name = "array"
axis = [0, 1, 0]
boresight = [0, 0, -1]
range_deg = [-180, 180]
rate_limit_deg_s = 0.5
acceleration_limit_deg_s2 = 0.1
inertia_kg_m2 = [0.1, 0.1, 0.2]
[sky]
epoch_utc = 2026-06-20T09:30:00
for_duration_s = 60
[sky.observer]
altitude_km = 550
inclination_deg = 97
ascending_node_deg = 233
argument_of_latitude_deg = 0
[[sky.ground]]
name = "lisbon"
latitude_deg = 38.72
longitude_deg = -9.14
"""
AIMS = """
telescope = [0, 0, 1]
antenna = "zenith"
"""
SCENARIO = f"""schema_version = 1
{CRAFT}
[start]
prefer = [{{ device = "array", direction = "sun" }}]
joints_deg = {{ array = [10] }}
[start.targets]{AIMS}
[goal]
prefer = [{{ device = "array", direction = "sun" }}]
[goal.targets]{AIMS}
[[keep_out]]
name = "sun"
direction = [0, 0, -1]
half_angle_deg = 20
[trajectory]
duration_s = 60
"""
TIMELINE = f"""schema_version = 1
kind = "timeline"
{CRAFT}
[timeline]
until_s = 60
[start]
attitude = [0, 0, 0]
joints_deg = {{}}
[[activity]]
name = "look"
for_s = 12
prefer = [{{ device = "array", direction = "sun" }}]
[activity.track]{AIMS}
[[activity]]
name = "stow"
attitude = [0, 0, 0.1]
joints_deg = {{ antenna = [10, 45] }}
for_s = 30
"""


def places(value, keys=()):
    """Keys and indices that lead to each value of nested tables and arrays, and those values."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in pairs:
        yield (*keys, key), item
        yield from places(item, (*keys, key))


def mistypings(value):
    """What may stand in the place of a value by mistake: brackets too few or too many, and wrong values."""
    brackets = value[0] if isinstance(value, list) else [value]
    return [brackets, -5, "north", [], {}, [1], [0, 0, 2]]


@pytest.mark.parametrize(
    ("text", "read"), [(SCENARIO, sc.scenario_from_dict), (TIMELINE, sc.timeline_from_dict)], ids=["s", "t"]
)
def test_a_mistyped_value_raises_nothing_but_the_scenario_error(text, read):
    tables = tomllib.loads(text) | {"unit": 1}  # whose fault keeps a start by targets from being looked for
    with pytest.raises(sc.ScenarioError, match=r"^the \w+: unit: unknown key"):  # the only one
        read(tables)
    for keys, value in places(tables):
        for wrong in mistypings(value):
            try:
                read(put(tables, keys, wrong))
            except sc.ScenarioError:
                continue
            except Exception as error:
                error.add_note(f"{'.'.join(map(str, keys))} = {wrong!r}")
                raise
