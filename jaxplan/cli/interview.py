"""The interview of ``jaxplan new --ask``: questions about a spacecraft and a task that make a scenario file.

It has parts: platform, instruments, terminals, drives, duration, date and orbit, zones, start and goal. Each
question asks for a key of the file, with the explanation from the file's layout. After each part all answers
so far are read as a scenario file would be, with states at rest in the place of a start and goal not yet
known. A part with faults is asked again, with the earlier answers as defaults.

Tables are dicts of keys and values, nested as in the file.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from jaxplan.cli.questions import NOTHING, Dialog
from jaxplan.model.scenario import MINIMUM, Scenario
from jaxplan.schema import ScenarioError, scenario_from_dict
from jaxplan.schema.arrays import Array
from jaxplan.schema.directions import Axis
from jaxplan.schema.faults import Place, Reading
from jaxplan.schema.layout import SCENARIO, SCHEMA_VERSION, SPACECRAFT
from jaxplan.schema.model_tables import ANGLE_DEG
from jaxplan.schema.orbits import Orbit
from jaxplan.schema.text import commented, table_at
from jaxplan.sky import BODIES, LOCAL
from jaxplan.sky.frames import library

Tables = dict[str, Any]
Path = tuple[str | int, ...]
Known = Callable[[], Reading]
_AT_REST = {"attitude": [0.0, 0.0, 0.0], "joints_deg": {}}  # joints are at zero, or nearest to it in range
_PYRAMID_AXES = [[0.5774 * x, 0.5774 * y, 0.5774] for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
_RATES, _TORQUE, _WHEELS = "rates", "torque", "wheels"
_ATTITUDE, _QUATERNION, _TARGETS = "attitude", "quaternion", "targets"
_DIRECTION = "direction"
_CIRCULAR, _TLE = "circular", "tle"
_ORBIT_TITLES = {  # answers to choose from, with the title of each one's table in the file's layout
    _CIRCULAR: "on a circular orbit",
    "elliptic": "on a Keplerian orbit",
    _TLE: "by two-line elements",
    "oem": "by an ephemeris",
    "spk": "by SPICE kernels",
}
_MIN_ACCELERATION = 1e-3  # deg/s^2, the smallest that is considered, also about an axis without torque
_TWO_ANGLES = Array((2,), ANGLE_DEG, noun="2 numbers, yaw and pitch")
_USUAL_ORBIT: Tables = {"altitude_km": 550.0, "inclination_deg": 97.6, "eccentricity": 0.0}
_EPHEMERIS_LIBRARY = "erfa"  # library, from an extra, that computes the places of Sun, Moon and Earth
_INTRODUCTION = """\
# Made of the answers to jaxplan new --ask.
#
#   jaxplan validate FILE         what it holds, or everything that is wrong with it
#   jaxplan plan FILE -o out      plan it: out/plan.json and figures
#
# A line that begins with # and no blank is an option: take the # away to use it. What else there is, such as
# jerk limits, masks, fields of view, zones to stay in and margins for errors, is in what jaxplan new writes.

"""


def interview(dialog: Dialog, name: str, broken: Callable[[Scenario], tuple[list[str], list[str]]]) -> str:
    """Ask for everything that a scenario file needs.

    Args:
        dialog: asks the questions and reads the answers.
        name: name proposed for the scene.
        broken: function of a scenario that returns messages on what its start violates, and what is wrong at
            its goal.

    Returns:
        Text of the file, which is valid.

    Raises:
        AnswersEnded: if there are fewer answers than questions, or they are refused again and again.
    """
    dialog.say(
        "An empty answer takes what stands in brackets; words and numbers need no quotes or brackets. For a "
        "direction x, y, z, -x, -y or -z will do, too. Nothing is written before the last answer; Ctrl-C "
        "ends this at any question."
    )
    tables: Tables = {"schema_version": SCHEMA_VERSION, "name": dialog.ask((), "name", name)}
    for title, part in (
        ("Platform", _ask_platform),
        ("Instruments, fixed to the body: cameras, star trackers, antennas", _ask_instruments),
        ("Terminals with a yaw and a pitch joint, such as of lasers", _ask_terminals),
        ("Drives that turn about one axis, such as of solar arrays", _ask_drives),
        ("Duration of the manoeuvre", _ask_duration),
        ("Date and orbit, if Sun, Moon or Earth matter", _ask_sky),
        ("Zones to keep out of", _ask_zones),
        ("Start", _ask_start),
        ("Goal", _ask_goal),
    ):
        dialog.say()
        dialog.say(title)
        tables = _ask_until_valid(dialog, tables, part)
    while any(found := broken(scenario_from_dict(tables, folder=dialog.folder))):
        dialog.say()
        for fault in (*found[0], *found[1]):
            dialog.faulty([fault])
        if not dialog.confirm("again", "whether start and goal are asked for again", True):
            break
        dialog.forget()
        tables = _ask_until_valid(dialog, _ask_until_valid(dialog, tables, _ask_start), _ask_goal)
    craft = {key: value for key, value in tables["spacecraft"].items() if value != []}
    tables |= {"spacecraft": craft, "search": {}}  # an empty table: its options are listed as comments
    ordered = {entry.key: tables[entry.key] for entry in SCENARIO.fields if tables.get(entry.key, []) != []}
    return _INTRODUCTION + commented(ordered)


def _ask_until_valid(dialog: Dialog, tables: Tables, part: Callable[[Dialog, Tables], Tables]) -> Tables:
    """Ask the questions of a part, again if need be, until all answers so far have no faults.

    Args:
        dialog: asks the questions.
        tables: answers of the parts before.
        part: function that asks the questions of a part and returns its answers.

    Returns:
        The tables with the answers of the part.
    """
    while True:
        grown = _merge_tables(tables, part(dialog, tables))
        filled = {"start": _AT_REST, "goal": _AT_REST, **grown}
        try:
            scenario_from_dict(filled, folder=dialog.folder)
        except ScenarioError as error:
            dialog.faulty(error.faults)
            dialog.say("  so once more:")
            dialog.forget()
        else:
            return grown


def _merge_tables(tables: Tables, more: Mapping[str, Any]) -> Tables:
    """Join two sets of tables without changing them; the spacecraft's keys are joined one by one."""
    craft = {**tables.get("spacecraft", {}), **more.get("spacecraft", {})}
    merged = {**tables, **more}
    return {**merged, "spacecraft": craft} if craft else merged


def _ask_keys(dialog: Dialog, path: Path, usual: Mapping[str, Any], known: Known = Reading) -> Tables:
    """Ask for keys of a table.

    Args:
        dialog: asks the questions.
        path: keys and indices that lead to the table in the file.
        usual: the keys with their defaults, see `Dialog.ask`; a dict is a table within, asked likewise.
        known: makes the reading that checks answers.

    Returns:
        The answers by key; keys that were left out are missing.
    """
    found: Tables = {}
    for key, default in usual.items():
        if isinstance(default, dict):
            found[key] = _ask_keys(dialog, (*path, key), default, known)
        elif (value := dialog.ask(path, key, default, reading=known)) is not NOTHING:
            found[key] = value
    return found


def _ask_valid_row(dialog: Dialog, path: Path, usual: Mapping[str, Any], known: Known = Reading) -> Tables:
    """Ask for keys of a table, as `_ask_keys` does, until the table as a whole has no faults."""
    table, _ = table_at(".".join(step for step in path if isinstance(step, str)), SCENARIO, usual)
    while True:
        row = _ask_keys(dialog, path, usual, known)
        place = _place_at(known(), path)
        table.read(row, place)
        if not place.reading.faults:
            return row
        dialog.faulty(place.reading.faults)


def _place_at(reading: Reading, path: Path) -> Place:
    """The place in a file, for messages, that keys and indices lead to."""
    place = Place(reading)
    for step in path:
        place = place[step]
    return place


def _reading_factory(tables: Tables) -> Known:
    """Return a function that makes readings which know the names of the devices in `tables`.

    Answers that name a device can then be checked.
    """

    def known() -> Reading:
        reading = Reading()
        SPACECRAFT.read(tables["spacecraft"], _place_at(reading, ("spacecraft",)))
        return reading

    return known


def _device_names(tables: Tables, *kinds: str) -> list[str]:
    """Names of the devices of some kinds, such as "terminal", in the order of the kinds."""
    craft = tables["spacecraft"]
    return [row["name"] for kind in kinds for row in craft.get(kind, ())]


def _ask_platform(dialog: Dialog, tables: Tables) -> Tables:
    """Ask what limits the turning of the platform: rates and accelerations, torque, or reaction wheels."""
    limited = dialog.choose(
        "limited by",
        "what limits its turning: rates and accelerations alone, torque about an inertia, or reaction wheels",
        (_RATES, _TORQUE, _WHEELS),
        _RATES,
    )
    path = ("spacecraft",)
    found: Tables = {}
    most: Any = 0.5
    if limited != _RATES:
        found["inertia_kg_m2"] = dialog.ask(path, "inertia_kg_m2")
        if limited == _TORQUE:
            found["torque_limit_nm"] = torque = dialog.ask(path, "torque_limit_nm", 0.1)
        else:
            found["wheel"] = wheels = _ask_wheels(dialog)
            torque = np.abs([each["axis"] for each in wheels]).T @ [each["torque_nm"] for each in wheels]
        reached = np.rad2deg(np.broadcast_to(torque, (3,)) / np.diag(found["inertia_kg_m2"]))
        # above what the torque can do, so that it is the torque that limits
        most = [float(f"{1.5 * max(each, _MIN_ACCELERATION):.2g}") for each in reached]
    return {
        "spacecraft": _ask_keys(dialog, path, {"rate_limit_deg_s": 1.0, "acceleration_limit_deg_s2": most})
        | found
    }


def _ask_wheels(dialog: Dialog) -> list[Tables]:
    """Ask for the reaction wheels; the defaults of each are the values of the one before."""
    count = dialog.count("wheels", "how many reaction wheels", 4)
    axes = {3: np.eye(3).tolist(), 4: _PYRAMID_AXES}.get(count, [None] * count)
    rows: list[Tables] = []
    usual: Tables = {"torque_nm": 0.1, "momentum_nms": 4.0, "stored_nms": 0.0}
    for number in range(count):
        asked = {"name": f"wheel {number + 1}", "axis": axes[number]} | {key: usual[key] for key in usual}
        rows.append(_ask_valid_row(dialog, ("spacecraft", "wheel", number), asked))
        usual = {key: rows[-1][key] for key in usual}
    return rows


def _ask_instruments(dialog: Dialog, tables: Tables) -> Tables:
    """Ask for the instruments."""
    rows = []
    for number in range(dialog.count("instruments", "how many", 1)):
        usual = {"name": f"instrument {number + 1}", "boresight": None if number else [0.0, 0.0, 1.0]}
        rows.append(_ask_valid_row(dialog, ("spacecraft", "instrument", number), usual))
    return {"spacecraft": {"instrument": rows}}


def _ask_terminals(dialog: Dialog, tables: Tables) -> Tables:
    """Ask for the terminals; the default ranges and limits of each are those of the one before."""
    rows: list[Tables] = []
    usual: Tables = {
        "yaw_range_deg": [-180.0, 180.0],
        "pitch_range_deg": [-20.0, 80.0],
        "rate_limit_deg_s": 3.0,
        "acceleration_limit_deg_s2": 1.0,
    }
    for number in range(dialog.count("terminals", "how many", 0)):
        mount = {"yaw_axis": [0.0, 0.0, 1.0], "boresight": None if number else [1.0, 0.0, 0.0]}
        asked = {"name": f"terminal {number + 1}", "mount": mount} | usual
        rows.append(_ask_valid_row(dialog, ("spacecraft", "terminal", number), asked))
        usual = {key: rows[-1][key] for key in usual}
    return {"spacecraft": {"terminal": rows}}


def _ask_drives(dialog: Dialog, tables: Tables) -> Tables:
    """Ask for the drives."""
    rows = []
    for number in range(dialog.count("drives", "how many", 0)):
        usual = {
            "name": f"drive {number + 1}",
            "axis": None if number else [0.0, 1.0, 0.0],
            "boresight": None if number else [0.0, 0.0, -1.0],
            "range_deg": [-180.0, 180.0],
            "rate_limit_deg_s": 0.5,
            "acceleration_limit_deg_s2": 0.1,
        }
        rows.append(_ask_valid_row(dialog, ("spacecraft", "drive", number), usual))
    return {"spacecraft": {"drive": rows}}


def _ask_duration(dialog: Dialog, tables: Tables) -> Tables:
    """Ask how long the manoeuvre may take."""
    return {"trajectory": _ask_keys(dialog, ("trajectory",), {"duration_s": MINIMUM})}


def _ask_sky(dialog: Dialog, tables: Tables) -> Tables:
    """Ask for the date and the spacecraft's orbit, if directions to bodies or along the orbit are needed.

    Returns:
        The table [sky], or nothing if it is not needed or the library for it is missing.
    """
    if not dialog.confirm("sky", "whether places of Sun, Moon, Earth or of the orbit are needed", False):
        return {}
    try:
        library(_EPHEMERIS_LIBRARY)
    except ImportError as error:
        dialog.faulty([f"{error}; then ask again, or go on with fixed directions"])
        return {}
    path = ("sky",)
    found = _ask_keys(dialog, path, {"epoch_utc": None})
    told = dialog.choose(
        "orbit", "of the spacecraft, told by elements or from", tuple(_ORBIT_TITLES), _CIRCULAR
    )
    table = Orbit().tables[_ORBIT_TITLES[told]]
    if told == _TLE:
        lines = [dialog.line(f"line {number}", "two-line elements") for number in (1, 2)]
        found["observer"] = {"tle": lines}
    else:
        found["observer"] = {
            entry.key: dialog.ask((*path, "observer"), entry.key, _USUAL_ORBIT.get(entry.key), table=table)
            for entry in table.fields
        }
    if isinstance(tables["trajectory"]["duration_s"], str):
        found |= _ask_keys(dialog, path, {"for_duration_s": 600.0})
    return {"sky": found}


def _ask_zones(dialog: Dialog, tables: Tables) -> Tables:
    """Ask for the keep-out zones."""
    every = _device_names(tables, "terminal", "drive", "instrument")
    if not every:
        dialog.say("  There is no device that a zone could bind.")
        return {}
    known = _reading_factory(tables)
    bodies = BODIES if "sky" in tables else ()
    rows = []
    for number in range(dialog.count("zones", "how many", 1 if bodies else 0)):
        path = ("keep_out", number)
        about = _DIRECTION
        if bodies:
            about = dialog.choose(
                f"zone {number + 1}", "what it is about", (*bodies, _DIRECTION), bodies[number % len(bodies)]
            )
        usual: Tables = {"name": about if bodies else f"zone {number + 1}"}
        if about == _DIRECTION:
            usual |= {"direction": None, "half_angle_deg": 30.0}
        else:
            usual |= {"exclusion_deg": 30.0 if about == "sun" else 10.0, "moving": about == "earth"}
        usual["devices"] = _device_names(tables, "instrument") or every
        fixed = {} if about == _DIRECTION else {"body": about}
        rows.append(fixed | _ask_keys(dialog, path, usual, known))
    return {"keep_out": rows}


def _ask_start(dialog: Dialog, tables: Tables) -> Tables:
    """Ask for the state at the start."""
    return {"start": _ask_state(dialog, tables, "start", _ATTITUDE)}


def _ask_goal(dialog: Dialog, tables: Tables) -> Tables:
    """Ask for the goal."""
    return {"goal": _ask_state(dialog, tables, "goal", _TARGETS)}


def _ask_state(dialog: Dialog, tables: Tables, end: str, usual: str) -> Tables:
    """Ask for a start or a goal: an attitude with joint angles, or the directions in which devices point.

    Args:
        dialog: asks the questions.
        tables: answers of the parts before.
        end: "start" or "goal".
        usual: default way to give it: "attitude", "quaternion" or "targets".
    """
    path, devices = (end,), _device_names(tables, "terminal", "drive", "instrument")
    told = _ATTITUDE
    while devices:
        told = dialog.choose(
            f"{end} by",
            "how it is told: an attitude (rotation vector or quaternion), or targets of devices",
            (_ATTITUDE, _QUATERNION, _TARGETS),
            usual,
        )
        if told != _TARGETS:
            break
        if targets := _ask_targets(dialog, path, devices, known_sky="sky" in tables):
            return {"targets": targets}
        one = f"must name a device at least, and what it points at; or else {end} by {_ATTITUDE}"
        dialog.faulty([f"{end}.targets: {one}"])
    if told == _QUATERNION:
        found = _ask_keys(dialog, path, {"quaternion_wxyz": [1.0, 0.0, 0.0, 0.0]})
    else:
        found = _ask_keys(dialog, path, {"attitude": [0.0, 0.0, 0.0]})
    joints: Tables = {}
    for kind, of, words in (
        ("terminal", _TWO_ANGLES, "its yaw and pitch, deg"),
        ("drive", ANGLE_DEG, "its angle, deg"),
    ):
        for device in tables["spacecraft"].get(kind, ()):
            name, nearest = device["name"], _joints_nearest_zero(device, kind)
            value = dialog.ask((*path, "joints_deg"), name, nearest, kind=of, words=words)
            joints[name] = value if isinstance(value, list) else [value]
    return found | ({"joints_deg": joints} if joints else {})


def _joints_nearest_zero(device: Mapping[str, Any], kind: str) -> Any:
    """The joint angles (deg) within range that are nearest to zero.

    Args:
        device: table of the device.
        kind: "drive", for which a number is returned, or "terminal", for which it is [yaw, pitch].
    """
    if kind == "drive":
        return float(np.clip(0.0, *device["range_deg"]))
    return [float(np.clip(0.0, *device[key])) for key in ("yaw_range_deg", "pitch_range_deg")]


def _ask_targets(dialog: Dialog, path: Path, devices: Sequence[str], *, known_sky: bool) -> Tables:
    """Ask for each device what it points at; returns the targets by name, without the devices left free."""
    named = f"; or a name: {', '.join((*BODIES, *LOCAL))}" if known_sky else ""
    words = f"where the device points, a unit vector along inertial axes{named}; none where it is free"
    found: Tables = {}
    for name in devices:
        value = dialog.ask((*path, "targets"), name, NOTHING, kind=Axis(inline=True), words=words)
        if value is not NOTHING:
            found[name] = value
    return found
