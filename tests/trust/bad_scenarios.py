"""Scenario files that are to be refused: what is changed in a good one, and what the refusal must say.

Grouped by what is wrong. Each line is an edit of the paper's case 4 and the complaint, which names key, value
and range.
"""

import pickle
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from jaxplan.cases import case_path

Command = tuple[str, ...]
Make = Callable[[Path], Command]

EDITS = {
    "not finite": """\
half_angle_deg = 28.0 | half_angle_deg = nan | keep_out[2].half_angle_deg = nan: must be finite
[-0.1504, -0.8529, | [inf, -0.8529, | keep_out[2].direction[0] = inf: must be finite
rate_limit_deg_s = 3.0 | rate_limit_deg_s = inf | spacecraft.rate_limit_deg_s = inf: must be finite
attitude = [-0.3050, | attitude = [nan, | start.attitude[0] = nan: must be finite
yaw_rad = [1.1601, | yaw_rad = [-inf, | start.yaw_rad[0] = -inf: must be finite
duration_s = 80.0 | duration_s = nan | trajectory.duration_s = nan: must be finite
heuristic_weight = 8.0 | heuristic_weight = inf | search.heuristic_weight = inf: must be finite
[0.4212, -0.9032, | [0.4212, nan, | goal.targets[1][1] = nan: must be finite
mount_deg = 120.0 | mount_deg = -inf | spacecraft.terminal[1].mount_deg = -inf: must be finite""",
    "no direction": """\
[-0.1504, -0.8529, -0.5000] | [0.0, 0.0, 0.0] | keep_out[2].direction = [0.0, 0.0, 0.0]: must be a unit vector
[-0.1504, -0.8529, -0.5000] | [0.0, 0.0, 2.0] | must be a unit vector, its norm is 2
[-0.1504, -0.8529, -0.5000] | [0.0, 1.0] | must be a unit vector of 3 numbers, not of 2
[-0.1504, -0.8529, -0.5000] | "north" | keep_out[2].direction = "north": must be
[0.4212, -0.9032, -0.0832] | [0.4212, -0.9032, 0.9] | goal.targets[1] = [0.4212, -0.9032, 0.9]: must be a unit
[0.4212, -0.9032, -0.0832], | # | goal.targets""",
    "no cone": """\
half_angle_deg = 28.0 | half_angle_deg = 0 | keep_out[2].half_angle_deg = 0: must lie in (0, 180)
half_angle_deg = 28.0 | half_angle_deg = 180 | keep_out[2].half_angle_deg = 180: must lie in (0, 180)
half_angle_deg = 28.0 | half_angle_deg = -3.5 | keep_out[2].half_angle_deg = -3.5: must lie in (0, 180)
half_angle_deg = 15.0 | half_angle_deg = 1e300 | keep_in[0].half_angle_deg = 1e+300: must lie in (0, 180)""",
    "no attitude": """\
attitude = [-0.3050, 2.2751, 0.9203] | quaternion_wxyz = [0.6, 0.2, 0.3, 0.4] | order w x y z, its norm is
attitude = [-0.3050, 2.2751, 0.9203] | quaternion_wxyz = [1, 0, 0] | quaternion_wxyz = [1, 0, 0]: must be
attitude = [-0.3050, 2.2751, 0.9203] | quaternion_wxyz = [0, 0, 0, 0] | quaternion_wxyz = [0, 0, 0, 0]: must
attitude = [-0.3050, 2.2751, 0.9203] | attitude = [1, 0, 0, 0] | start.attitude = [1, 0, 0, 0]: must be a
attitude = [-0.3050, 2.2751, 0.9203] | attitude = [1e9, 0, 0] | start.attitude[0] = 1000000000.0:""",
    "keys": """\
schema_version = 1 | schema_version = 2 | schema_version = 2: must be 1
name = "case 4" | name = 4 | name = 4: must be a line of text
name = "case 4" | nmae = "case 4" | nmae: unknown key, perhaps name is meant
name = "case 4" | colour = "red" | colour: unknown key, the keys are schema_version, name
rate_limit_deg_s = 3.0 | rate_limit_deg_s = true | spacecraft.rate_limit_deg_s = true: must be a number
rate_limit_deg_s = 3.0 | rate_limit_deg_s = "3" | spacecraft.rate_limit_deg_s = "3": must be a number
rate_limit_deg_s = 3.0 | # | spacecraft.rate_limit_deg_s: missing, must be a number in [1e-6, 1e6]
name = "CZ3" | name = "CZ2" | keep_out[1].name = "CZ2": the same as keep_out[0].name
name = "terminal-2" | name = "terminal-1" | spacecraft.terminal[1].name = "terminal-1": the same as
order = 12 | order = 12.5 | trajectory.order = 12.5: must be an integer in [5, 24]
order = 12 | order = 25 | trajectory.order = 25: must lie in [5, 24]
[trajectory] | [[trajectory]] | trajectory = (an array of 1): must be a table
order = 12 | order = 12\\norder = 12 | not TOML, cannot overwrite a value
[search] | [search | not TOML""",
    "zones and devices": """\
devices = ["terminal-1"] | devices = ["terminal-4"] | no such device, perhaps terminal-3 is meant
devices = ["terminal-1"] | devices = [] | keep_in[0].devices = []: must be an array of names of devices
devices = ["terminal-1"] | # | keep_in[0].devices: missing (or vector), must be an array of names of devices
devices = ["terminal-1"] | devices = "terminal-1" | keep_in[0].devices = "terminal-1": must be an array
devices = ["terminal-1"] | devices = ["terminal-1", "terminal-1"] | is named twice""",
    "limits": """\
yaw_limit_deg = 90.0 | yaw_limit_deg = 0 | spacecraft.terminal[0].yaw_limit_deg = 0: must lie in (0, 180]
yaw_limit_deg = 90.0 | yaw_limit_deg = 181 | spacecraft.terminal[0].yaw_limit_deg = 181: must lie in (0, 180]
pitch_limit_deg = 15.0 | pitch_limit_deg = 90 | pitch_limit_deg = 90: must lie in (0, 90)
yaw_limit_deg = 88.0 | yaw_limit_deg = 91.0 | goal.yaw_limit_deg = 91.0: must not exceed
yaw_rad = [1.1601, -0.0852, 1.3184] | yaw_rad = [1.1601] | start.yaw_rad = [1.1601]: must be
acceleration_limit_deg_s2 = 2.0 | acceleration_limit_deg_s2 = -2 | = -2: must lie in [1e-9, 1e9]
acceleration_limit_deg_s2 = 2.0 | acceleration_limit_deg_s2 = 2\\ntorque_limit_nm = 1 | needs space
rate_limit_deg_s = 3.0 | rate_limit_deg_s = 3\\ninertia_kg_m2 = [[1,2,0],[2,1,0],[0,0,1]] | positive def
duration_s = 80.0 | duration_s = 0 | trajectory.duration_s = 0: must lie in [1e-3, 1e7]
duration_s = 80.0 | duration_s = "minimum" | only trajectory.method = "global" has it""",
    "settings": """\
method = "mha" | method = "dijkstra" | search.method = "dijkstra": must be "mha"
heuristic_weight = 8.0 | heuristic_weight = 0.5 | search.heuristic_weight = 0.5: must lie in [1, 1e6]
anchor_weight = 2.0 | seed = -1 | search.seed = -1: must be at least 0
anchor_weight = 2.0 | max_expansions = 0 | search.max_expansions = 0: must be at least 1
anchor_weight = 2.0 | time_limit_s = -1 | search.time_limit_s = -1: must be greater than 0
{ "terminal-1" = 0.5 } | { "terminal-9" = 0.5 } | search.terminal_step_scale.terminal-9: no such terminal
attitude_step_rad = 0.12 | attitude_step_rad = 0 | search.attitude_step_rad = 0: must lie in [1e-3, 3.14]""",
}
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


def edits() -> dict[str, tuple[str, str, str]]:
    """Old text, new text and complaint, by a name that tells what is wrong."""
    found = {}
    for group, lines in EDITS.items():
        for line in lines.splitlines():
            old, new, complaint = (part.replace("\\n", "\n") for part in line.split(" | "))
            found[f"{group}: {line}"] = (old, "" if new == "#" else new, complaint)
    return found


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
    for name, (old, new, complaint) in edits().items():
        assert old in text, name
        found[name] = (written(text.replace(old, new, 1)), complaint)
    for name, (one, two, complaint) in TLE.items() if find_spec("erfa") and find_spec("sgp4") else ():
        found[f"two lines: {name}"] = (written(text + SKY % (one, two)), complaint)
    zone = '\n[[keep_out]]\nname = "z{}"\ndirection = [0, 0, 1]\nhalf_angle_deg = 1\n'
    zones = text + "".join(zone.format(k) for k in range(1000))
    for name, content, complaint in [
        ("nothing", "", "schema_version: missing, must be 1"),
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
