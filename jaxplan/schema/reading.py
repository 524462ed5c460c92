"""Scenarios from files or Python objects and back, with all faults reported at once.

From a scenario file, its text or the dict it holds to the model, with all faults reported at once.

Single values are checked by their kind (`layout`), what concerns several tables by `checks`. Whether start
and goal keep the constraints is no matter of the file: planning answers that with a status.

From what Python gives for a scenario to the model's own types, with all faults reported at once.

Lists become tuples or float64 arrays, numbers of any type floats, and a single number that stands for three
becomes three. What a file may not hold is a fault, told by its attribute and in its unit; what is taken is
what a file would give back, to the last bit.

From the model to the dict of a scenario file, its text and the file itself.

Reading the result gives every number back with the same bits, for all that can be said in the file's units.
Required keys are written, and settings that differ from their default.

Settings changed by their names, as in ``{"search.max_expansions": 500}``, in a file's keys and units.
"""

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Instrument, Spacecraft, Terminal
from jaxplan.runtime.arguments import as_floats, expect, file_path
from jaxplan.runtime.files import replacing_file
from jaxplan.schema import toml
from jaxplan.schema.checks import (
    ZONES,
    check_count,
    check_parts,
    check_paths,
    check_spacecraft,
    resolve_directions,
)
from jaxplan.schema.faults import DeviceNames, Ear, Place, ScenarioError, quote
from jaxplan.schema.layout import SCENARIO, SPACECRAFT
from jaxplan.schema.spelling import python_root


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
    root = Place(faults=[], devices=device_names(tables))
    zones = [_rows(tables, key) or () for key in ZONES]
    read = SCENARIO.read(tables, root) if check_count(zones, root) else None
    if read is not None:
        check_parts(read, root)
        _check_epoch(tables, read, root)
        resolve_directions(tables, read, root)
        check_paths(read, root)
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


def take_in(given: object) -> Scenario:
    """The scenario with arrays, tuples and floats of Python's own where something else was given.

    Raises:
        TypeError: if it is no scenario.
        ScenarioError: if an attribute is one that no file may hold, has the wrong type or shape, or does not
            go with others; the message lists every fault.
    """
    scenario = expect("scenario", given, Scenario)
    ear = Ear([], _device_names(scenario))
    taken = _taken(scenario, ear)
    if ear.faults:
        raise _all_faults(scenario)
    return taken


def refuse_types(given: object) -> None:
    """Raise what `take_in` raises where an attribute has the wrong type or shape, and not for its value."""
    scenario = expect("scenario", given, Scenario)
    ear = Ear([], _device_names(scenario))
    _taken(scenario, ear)
    if ear.refused:
        raise _all_faults(scenario)


def _all_faults(scenario: Scenario) -> ScenarioError:
    """The error that tells them, of a scenario that has some."""
    root = python_root(_device_names(scenario))
    _taken(scenario, root)
    return ScenarioError(root.faults)


def _taken(scenario: Scenario, root: Place) -> Any:
    """The scenario as it is taken, or what could be taken of it after noting its faults."""
    if not check_count([getattr(scenario, attribute) for attribute in ZONES.values()], root):
        return None
    terminals, others = root.devices.terminals, None
    if terminals is None:
        terminals, others = _names(scenario, "terminals", Terminal), _of_states(scenario)
    if terminals is not None and others is not None:
        complaint = f"must be as many as start and goal are for, {others}, not {len(terminals)}"
        root.key("spacecraft").key("terminal").fault(complaint)
    taken = SCENARIO.take(scenario, root)
    check_parts(taken, root)
    check_paths(taken, root)
    return taken


def checked_spacecraft(given: object) -> Spacecraft:
    """A spacecraft by itself, taken in as that of a scenario, its numbers within the ranges of a file.

    Raises:
        TypeError: if it is none.
        ScenarioError: for what no scenario may have; the message lists every fault.
    """
    expect("spacecraft", given, Spacecraft)
    place = python_root(DeviceNames(None, None)).key("spacecraft")
    taken: Spacecraft = SPACECRAFT.take(given, place)
    check_spacecraft(taken, place)
    if place.faults:
        raise ScenarioError(place.faults, "the argument")
    return taken


def _device_names(scenario: Scenario) -> DeviceNames:
    """The names of the devices, as far as start and goal are for as many terminals."""
    terminals, others = _names(scenario, "terminals", Terminal), _of_states(scenario)
    if terminals is not None and others is not None and len(terminals) != others:
        return DeviceNames(None, None)  # so that start and goal are not blamed, too
    return DeviceNames(terminals, _names(scenario, "instruments", Instrument))


def _names(scenario: Scenario, kind: str, model: type) -> tuple[str, ...] | None:
    """The names of devices; None where something else stands among them, or in their place."""
    devices: Any = getattr(scenario.spacecraft, kind, None)
    if isinstance(devices, list | tuple) and all(isinstance(one, model) for one in devices):
        return tuple(str(one.name) for one in devices)
    return None


def _of_states(given: Scenario) -> int | None:
    """Of how many terminals start and goal are; None where they do not agree, or cannot be told."""
    directions = getattr(given.goal, "directions", None)
    if isinstance(directions, list | tuple):
        goal: float | None = len(directions)
    else:
        goal = (
            _length(directions) if directions is not None else _length(getattr(given.goal, "joints", None), 2)
        )
    start = _length(getattr(given.start, "joints", None), 2)
    return int(start) if start is not None and start == goal and start % 1 == 0 else None


def _length(value: object, of: int = 1) -> float | None:
    """How often an array has so many entries; None for what is no array of numbers."""
    array = as_floats(value)
    return len(array) / of if array is not None and array.ndim else None


def scenario_to_dict(scenario: Scenario) -> dict[str, Any]:
    """The tables of the scenario's file.

    Args:
        scenario: in radians and seconds.

    Returns:
        Dicts, lists, numbers and strings with the keys and units of a file, ready for TOML or JSON.

    Raises:
        ScenarioError: if it could not be read again; the message lists every fault.
    """
    return SCENARIO.write(take_in(scenario))


def dump_scenario(scenario: Scenario) -> str:
    """The text of the scenario's file.

    Args:
        scenario: in radians and seconds.

    Returns:
        TOML. A quaternion comes out as the rotation vector it was read to.

    Raises:
        ScenarioError: if it could not be read again; the message lists every fault.
    """
    return toml.write(scenario_to_dict(scenario))


def save_scenario(scenario: Scenario, path: str | os.PathLike[str]) -> None:
    """Write the scenario's file, whole or not at all.

    Args:
        scenario: in radians and seconds.
        path: of the file; one that is there is replaced.

    Raises:
        ScenarioError: if it could not be read again; the message lists every fault.
        OSError: the file cannot be written; one that was there is left as it was.
    """
    text = dump_scenario(scenario)
    with replacing_file(file_path("path", path)) as temporary:
        temporary.write_bytes(text.encode())


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
