"""Scenario files that are to be refused, and what the refusal must say: key, value and range.

Most are the example that has every key, with one wrong value.
"""

import json
import pickle
import re
import tomllib
from collections.abc import Callable
from functools import reduce
from importlib.util import find_spec
from pathlib import Path

from tables import put

from jaxplan.cases import case_path

Command = tuple[str, ...]
Make = Callable[[Path], Command]

EVERY_KEY = Path(__file__).parents[1] / "scenarios" / "every_key.toml"
TABLES = tomllib.loads(EVERY_KEY.read_text())

# Each line is the fault that its value causes at its place, and the only one.
WRONG_VALUES = """\
keep_out[1].half_angle_deg = 210: must lie in (0, 180)
keep_in[0].half_angle_deg = 0: must lie in (0, 180)
keep_in[0].half_angle_deg = 180.0: must lie in (0, 180)
spacecraft.terminal[0].yaw_limit_deg = 180.1: must lie in (0, 180]
spacecraft.terminal[0].yaw_limit_deg = 0: must lie in (0, 180]
spacecraft.terminal[0].pitch_limit_deg = 90: must lie in (0, 90)
spacecraft.terminal[1].rate_limit_deg_s = 0.0: must lie in [1e-6, 1e6]
spacecraft.terminal[1].acceleration_limit_deg_s2 = -3: must lie in [1e-9, 1e9]
spacecraft.rate_limit_deg_s = -1.0: must lie in [1e-6, 1e6]
spacecraft.acceleration_limit_deg_s2 = 0: must lie in [1e-9, 1e9]
spacecraft.jerk_limit_deg_s3 = 0: must lie in [1e-12, 1e12]
spacecraft.torque_limit_nm = 0: must lie in [1e-12, 1e12]
spacecraft.torque_limit_nm[1] = -0.3: must lie in [1e-12, 1e12]
spacecraft.torque_limit_nm = "much": must be a number in [1e-12, 1e12], or 3, one a body axis
spacecraft.wheel_momentum_limit_nms = []: must be a number in [1e-12, 1e12], or 3, one a body axis, not 0
spacecraft.rate_limit_deg_s = [1.0, 2.0]: must be a number in [1e-6, 1e6], or 3, one a body axis, not 2
spacecraft.acceleration_limit_deg_s2 = [1.5]: must be a number in [1e-9, 1e9], or 3, one a body axis, not 1
spacecraft.rate_norm_limit_deg_s = 0: must lie in [1e-6, 1e6]
spacecraft.rate_norm_limit_deg_s = [1, 2, 3]: must be a number in [1e-6, 1e6]
spacecraft.acceleration_norm_limit_deg_s2 = -0.1: must lie in [1e-9, 1e9]
spacecraft.acceleration_norm_limit_deg_s2 = nan: must be finite and lie in [1e-9, 1e9]
spacecraft.jerk_limit_deg_s3[0] = 0.0: must lie in [1e-12, 1e12]
spacecraft.jerk_limit_deg_s3[1] = nan: must be finite and lie in [1e-12, 1e12]
spacecraft.jerk_limit_deg_s3[2] = "much": must be a number in [1e-12, 1e12]
spacecraft.inertia_kg_m2 = 12.0: must be an array of 3 moments, or 3 rows of 3 numbers
keep_out[0].name = "": must not be empty
keep_in[0].any_of = "  ": must not be empty
spacecraft.terminal[0].name = 7: must be a line of text
spacecraft.instrument[0].boresight = [0.0, 0.0, 0.0]: must be a unit vector, not zero
spacecraft.instrument[0].boresight = [0, 1]: must be a unit vector of 3 numbers, not of 2
keep_in[0].name = "earth": the same as keep_out[1].name
keep_out[0].direction = [0.0, 0.0, 1.0011]: must be a unit vector, its norm is 1.0011
keep_out[0].direction[1] = "north": must be a number
keep_out[0].devices = []: must be an array of names of devices, at least one
keep_in[0].devices = "fore": must be an array of names of devices, at least one
keep_in[0].devices[0] = "for": no such device, perhaps fore is meant
keep_in[0].devices[0] = "camera": no such device, the devices are fore, aft, star-tracker
keep_out[0].devices[1] = "star-tracker": is named twice
keep_out[0].devices[1] = 3: must be the name of a device
keep_in[0].any_of = false: must be a line of text
start.attitude = [0.0, 0.0]: must be a rotation vector of 3 numbers, not of 2
start.yaw_rad = [0.1]: must be an array of 2 numbers, one a terminal, not of 1
start.pitch_rad = 0.1: must be an array of 2 numbers, one a terminal
goal.targets = [[0.0, 0.0, 1.0]]: must be an array of 2 directions, one a terminal, not of 1
goal.targets[1] = [0.0, 0.0, 2.0]: must be a unit vector, its norm is 2
goal.yaw_limit_deg = 90.5: must not exceed spacecraft.terminal[1].yaw_limit_deg = 90.0
goal.pitch_limit_deg = 16.0: must not exceed spacecraft.terminal[0].pitch_limit_deg = 15.5
search.method = "dijkstra": must be "mha", "mha-paper", "wastar", "rrt_star" or "rrt_connect"
search.method = 1: must be "mha", "mha-paper", "wastar", "rrt_star" or "rrt_connect"
search.attitude_step_rad = 0: must lie in [1e-3, 3.14]
search.joint_step_rad = 3.2: must lie in [1e-3, 3.14]
search.terminal_step_scale = 0.5: must be a table from names of jointed devices to numbers
search.terminal_step_scale.fore = 0: must lie in [1e-3, 1e3]
search.heuristic_weight = 0.99: must lie in [1, 1e6]
search.clearance_deg = 5e-324: too small to tell from zero
search.anchor_weight = 0: must lie in [1, 1e6]
search.attitude_moves = 0: must lie in [1, 256]
search.attitude_moves = 6.0: must be an integer in [1, 256]
search.clearance_deg = -0.1: must lie in [0, 90)
search.max_expansions = 0: must be at least 1
search.time_limit_s = 0: must be greater than 0
search.time_limit_s = "none": must be a number in (0, inf) or "off"
search.max_goals = 101: must lie in [1, 100]
search.improvements = -1: must lie in [0, 10000]
search.seed = -1: must be at least 0
search.seed = true: must be an integer in [0, inf)
trajectory.method = "spline": must be "global" or "paper"
trajectory.duration_s = 0: must lie in [1e-3, 1e7]
trajectory.duration_s = "long": must be a number in [1e-3, 1e7], "stretched" or "minimum"
trajectory.segments = 0: must lie in [1, 1000]
trajectory.order = 4: must lie in [5, 24]
trajectory.order = 25: must lie in [5, 24]
trajectory.rate_weight = -1: must lie in [0, 1e6]
trajectory.acceleration_weight = 0: must lie in [1e-6, 1e6]
trajectory.jerk_weight = -0.1: must lie in [0, 1e6]
trajectory.node_tube_deg = -0.5: must lie in [0, 180]
trajectory.node_tube_deg = 180.5: must lie in [0, 180]
trajectory.node_tube_deg = "wide": must be a number in [0, 180] or "inf"
trajectory.end_acceleration = "none": must be "zero" or "free"
trajectory.end_acceleration = 0: must be "zero" or "free"
schema_version = 2: must be 1
schema_version = 1.0: must be 1
name = "two\\nlines": must be a line of text
spacecraft = 3: must be a table
spacecraft.terminal[0] = 3: must be a table
keep_out = (a table): must be an array of tables, each under [[keep_out]]
trajectory = (an array of 1): must be a table
name = 4: must be a line of text
trajectory.order = 12.5: must be an integer in [5, 24]
keep_in[0].half_angle_deg = 1e+300: must lie in (0, 180)
keep_out[0].direction = "north": must be a unit vector of 3 numbers; a name needs [sky], with epoch_utc and \
observer
start.attitude = [1, 0, 0, 0]: must be a rotation vector of 3 numbers, not of 4
start.attitude[0] = 1e+308: must lie in [-1e3, 1e3]
start.yaw_rad[1] = -1e+308: must lie in [-1e3, 1e3]
start.joint_rates_rad_s[3] = 1001.0: must lie in [-1e3, 1e3]
spacecraft.terminal[0].mount_deg = 60000.0: must lie in [-5e4, 5e4]
spacecraft.rate_limit_deg_s = nan: must be finite and lie in [1e-6, 1e6]
search.time_limit_s = inf: must be finite and be greater than 0
spacecraft.inertia_kg_m2[0][0] = 1e+300: must lie in [-1e12, 1e12]
spacecraft.wheel_momentum_limit_nms = 1e-300: must lie in [1e-12, 1e12]
search.terminal_step_scale.fore = 1e-300: must lie in [1e-3, 1e3]
trajectory.duration_s = 1e-300: must lie in [1e-3, 1e7]
trajectory.duration_s = 1e+308: must lie in [1e-3, 1e7]
""".splitlines()
SHORTENED = {"(a table)": {}, "(an array of 1)": [{}]}

# A sky without a fault, but for what is changed in it; and two lines of an orbit.
SKY = """
[sky]
epoch_utc = "2024-03-20T03:06:00"
observer = { tle = ["%s", "%s"] }
"""
ONE = "1 25544U 98067A   24079.07757601  .00016717  00000-0  30270-3 0  9992"
TWO = "2 25544  51.6400 208.9163 0006317  69.9862  25.2906 15.49560532444998"
TLE = {
    "a wrong digit": (ONE, TWO.replace("51.6400", "51.6401"), "check sum"),
    "an eccentric orbit": (ONE, TWO.replace("0006317", "9zz6317"), "eccentricity"),
    "lines of two satellites": (ONE, TWO.replace("2 25544", "2 25545")[:-1] + "9", "satellite"),
    "a short line": (ONE[:60], TWO, "has 60 characters, must have 69"),
}


def split(place):
    """The keys and indices of a place, such as ``keep_out[1].direction``."""
    return [int(part) if part.isdigit() else part for part in re.findall(r"[\w-]+", place)]


def at(tables, place):
    for key in split(place):
        tables = tables[key]
    return tables


def changed(changes):
    """The tables of the example, with the values at some places changed, added or taken out."""
    return reduce(lambda tables, change: put(tables, split(change[0]), change[1]), changes.items(), TABLES)


def with_fault(line):
    """The tables of the example, with the fault that a line of `WRONG_VALUES` tells of."""
    place, shown = re.match(r"(\S+) = (.*?): ", line).groups()
    return changed({place: SHORTENED[shown] if shown in SHORTENED else tomllib.loads(f"x = {shown}")["x"]})


def toml(value):
    """A value as TOML has it on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {toml(own)}" for key, own in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value) if isinstance(value, bool | str) else str(value)


def scenarios() -> dict[str, tuple[Make, str]]:
    """Scenario files, and what is none."""
    text = Path(str(case_path("case-4"))).read_text()

    def written(content: str | bytes) -> Make:
        def make(folder: Path) -> Command:
            content_ = content if isinstance(content, bytes) else content.encode()
            (folder / "scene.toml").write_bytes(content_)
            return ("plan", str(folder / "scene.toml"), "-o", str(folder / "out"))

        return make

    found = {}
    for line in WRONG_VALUES:
        tables = [f"{key} = {toml(value)}" for key, value in with_fault(line).items()]
        found[f"values: {line}"] = (written("\n".join(tables)), line)
    for name, (one, two, complaint) in TLE.items() if find_spec("erfa") and find_spec("sgp4") else ():
        found[f"two lines: {name}"] = (written(text + SKY % (one, two)), complaint)
    zone = '\n[[keep_out]]\nname = "z{}"\ndirection = [0, 0, 1]\nhalf_angle_deg = 1\n'
    zones = text + "".join(zone.format(k) for k in range(1000))
    for name, content, complaint in [
        ("nothing", "", "schema_version: missing, must be 1"),
        ("a key twice", "x = 1\nx = 2", "not TOML, cannot overwrite a value"),
        ("half a heading", "[search", "not TOML"),
        ("text", "once upon a time", "line 1, column"),
        ("no UTF-8", b'name = "\xff\xfe"', "not UTF-8 text, byte 8"),
        ("zeros", b"\x00" * 1000, "not TOML"),
        ("too large", "#" * (2**20 + 1), "larger than 1 MiB"),
        ("too many zones", zones, "1004 zones, more than the 1000 that are allowed"),
        ("nested", "x = " + "[" * 100_000, "nested more than 16 deep"),
        ("a long number", "x = " + "9" * 5000, "longer than 1000 characters"),
        ("a pickle", pickle.dumps({"a": 1}), "not UTF-8 text"),
        ("JSON", '{"name": "case 4"}', "not TOML"),
    ]:
        found[f"file: {name}"] = (written(content), complaint)
    return found
