"""From a scenario file, its text or the dict it holds to the model, with all faults reported at once.

Single values are checked by their kind (`layout`); what concerns several tables is checked here. Whether
start and goal keep the constraints is no matter of the file: planning answers that with a status.
"""

import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from jaxplan.given import file_path
from jaxplan.model.scenario import MINIMUM, STRETCHED, Scenario
from jaxplan.scenario import toml
from jaxplan.scenario.faults import DeviceNames, Place, ScenarioError, quote
from jaxplan.scenario.kinds import shortest_degrees
from jaxplan.scenario.layout import SCENARIO
from jaxplan.scenario.resolving import resolve_directions

MOST_ZONES = 1000
ZONES = ("keep_out", "keep_in", "joint_bound")
"""Keys of a file under which pointing constraints stand."""


def load_scenario(path: str | os.PathLike[str]) -> Scenario:
    """Read a scenario file.

    Args:
        path: of a TOML file in UTF-8.

    Returns:
        The scenario in radians and seconds.

    Raises:
        ScenarioError: the file cannot be read or is no scenario; the message lists every fault.
    """
    file_path("path", path)
    try:
        with open(path, "rb") as file:
            content = file.read(toml.LARGEST_FILE + 1)
        if len(content) > toml.LARGEST_FILE:
            raise toml.too_large()
        return parse_scenario(content.decode("utf-8-sig"))
    except OSError as error:
        faults = [f"cannot be read: {error.strerror or error}"]
    except UnicodeDecodeError as error:
        faults = [f"not UTF-8 text, byte {error.start} is none of it"]
    except ScenarioError as error:
        faults = list(error.faults)
    raise ScenarioError(faults, os.fspath(path) or quote(""))


def parse_scenario(text: str) -> Scenario:
    """Read a scenario from the text of a file.

    Args:
        text: TOML.

    Returns:
        The scenario in radians and seconds.

    Raises:
        ScenarioError: the text is no scenario; the message lists every fault.
    """
    return scenario_from_dict(toml.parse(text))


def scenario_from_dict(tables: Mapping[str, Any]) -> Scenario:
    """Make a scenario from the tables of a file.

    Args:
        tables: dicts, lists and numbers with the keys and units of a file, as TOML or JSON give them.

    Returns:
        The scenario in radians and seconds.

    Raises:
        ScenarioError: it is no scenario; the message lists every fault.
    """
    return read_scenario(tables, Place(faults=[], devices=device_names(tables)))


def read_scenario(tables: Mapping[str, Any], root: Place) -> Scenario:
    """Likewise, with faults told as a place tells them."""
    _check_number_of_zones(tables, root)
    read = SCENARIO.read(tables, root)
    if read is not None:
        check_names(tables, root)
        check_inertia(tables, root)
        _check_zones(tables, root)
        _check_goal_limits(read, root)
        _check_duration(tables, read, root)
        _check_epoch(tables, read, root)
        resolve_directions(tables, read, root)
    if root.faults:
        raise ScenarioError(root.faults)
    scenario: Scenario = SCENARIO.build(read)
    return scenario


def _check_epoch(tables: Mapping[str, Any], read: Mapping[str, Any], root: Place) -> None:
    """The start has one time."""
    seen, given = (read.get("sky") or {}).get("epoch"), read.get("epoch")
    if seen is not None and given is not None and seen != given:
        root.key("epoch_utc").fault(f"is not that of [sky], {seen}: give one of them", tables["epoch_utc"])


def _rows(table: object, key: str) -> list[dict[str, Any]] | None:
    """The tables of an array of tables, None if it is something else; an absent one is empty."""
    rows = table.get(key, []) if isinstance(table, dict) else None
    return rows if isinstance(rows, list) and all(isinstance(row, dict) for row in rows) else None


def device_names(tables: object) -> DeviceNames:
    """The names that zones and goals may use, as far as the file gives them."""

    def names(key: str) -> tuple[str, ...] | None:
        rows = _rows(tables.get("spacecraft") if isinstance(tables, dict) else None, key)
        found = None if rows is None else [row.get("name") for row in rows]
        texts = tuple(name for name in found or () if isinstance(name, str))
        return None if found is None or len(texts) < len(found) else texts

    return DeviceNames(names("terminal"), names("instrument"))


def _check_number_of_zones(tables: object, root: Place) -> None:
    """Raise at once where there are more zones than any scene has."""
    count = sum(len(_rows(tables, key) or ()) for key in ZONES)
    if count > MOST_ZONES:
        root.fault(f"{count} zones, more than the {MOST_ZONES} that are allowed")
        raise ScenarioError(root.faults)


def check_names(tables: Mapping[str, Any], root: Place) -> None:
    """Devices, and zones, need names of their own."""
    spacecraft = root.key("spacecraft")
    _check_unique(tables.get("spacecraft"), ("terminal", "instrument"), spacecraft)
    _check_unique(tables, ZONES, root)


def _check_unique(table: object, keys: Iterable[str], place: Place) -> None:
    first: dict[str, Place] = {}
    for key in keys:
        for i, row in enumerate(_rows(table, key) or ()):
            here, name = place.key(key).item(i).key("name"), row.get("name")
            if isinstance(name, str) and first.setdefault(name, here) is not here:
                here.fault(f"the same as {first[name].path}", name)


def _check_zones(tables: Mapping[str, Any], root: Place) -> None:
    """A zone binds something, other than its own axis, and an entry is one of a group."""
    for key in ZONES:
        for i, row in enumerate(_rows(tables, key) or ()):
            place, devices = root.key(key).item(i), row.get("devices", ())
            aside = key == "keep_in" or "axis_body" in row or "axis_device" in row
            if key != "joint_bound" and aside and not row.keys() & {"devices", "vector"}:
                place.key("devices").fault("missing (or vector), must be an array of names of devices")
            if "axis_device" in row and isinstance(devices, list) and row["axis_device"] in devices:
                complaint = "is the axis, so it must not be among the devices that are bound"
                place.key("axis_device").fault(complaint, row["axis_device"])
            if "entry" in row and "any_of" not in row:
                place.key("entry").fault("needs any_of, the name of its group", row["entry"])


def check_inertia(tables: Mapping[str, Any], root: Place) -> None:
    """Torque and angular momentum follow from the motion only with the inertia."""
    spacecraft = tables.get("spacecraft")
    if isinstance(spacecraft, dict) and "inertia_kg_m2" not in spacecraft:
        for key in ("torque_limit_nm", "wheel_momentum_limit_nms"):
            if key in spacecraft:
                place = root.key("spacecraft")
                place.key(key).fault(f"needs {place.key('inertia_kg_m2').path}", spacecraft[key])


def _check_goal_limits(read: Mapping[str, Any], root: Place) -> None:
    """The goal's limits tighten those of every terminal, they do not widen any."""
    terminals = (read.get("spacecraft") or {}).get("terminals") or []
    for axis in ("yaw_limit", "pitch_limit"):
        limit = (read.get("goal") or {}).get(axis)
        for i, terminal in enumerate(terminals):
            own = (terminal or {}).get(axis)
            if limit is not None and own is not None and limit > own:
                key = f"{axis}_deg"
                bound = root.key("spacecraft").key("terminal").item(i).key(key).told(shortest_degrees(own))
                root.key("goal").key(key).fault(f"must not exceed {bound}", shortest_degrees(limit))
                break


def _check_duration(tables: Mapping[str, Any], read: Mapping[str, Any], root: Place) -> None:
    """The paper's method knows no shortest motion, and scales the time, with it the rates at both ends."""
    settings = tables.get("trajectory", {})
    if not isinstance(settings, dict) or settings.get("method") != "paper":
        return
    duration, place = settings.get("duration_s", STRETCHED), root.key("trajectory").key("duration_s")
    if duration == MINIMUM:
        place.fault('only trajectory.method = "global" has it', duration)
    if duration != STRETCHED:
        return
    moving = [
        root.key(table).key(f"{key}_rad_s").path
        for table in ("start", "goal")
        for key in ("angular_velocity", "joint_rates")
        if np.any((read.get(table) or {}).get(key, 0.0))
    ]
    if moving:
        complaint = f"must be a number of seconds, since stretching the time would change {', '.join(moving)}"
        place.fault(complaint, duration)
