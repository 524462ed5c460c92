"""Scenarios from files and Python objects, and back to files, with all faults reported at once.

All pass through one reader, the tables of `layout`, which judge single values; what concerns several of them
is in `checks`. Whether start and goal keep the constraints is not checked here: planning answers that with a
status. Values from Python are converted to the model's own types: lists become tuples or float64 arrays,
numbers of any type floats, and a single number that stands for three becomes three. A value that a file may
not hold is a fault, which names the attribute and its unit.

Reading what was written gives every number back with the same bits, if it can be expressed in the file's
units. Written are required keys, and settings that differ from their default.
"""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pkgutil import resolve_name
from typing import Any, TypeVar

import numpy as np

from jaxplan.model.file_keys import unit_of
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.arguments import as_floats, expect, file_path, show
from jaxplan.runtime.files import Source, replacing_file
from jaxplan.schema import text as texts
from jaxplan.schema.checks import ZONES, check_count, check_parts, check_paths
from jaxplan.schema.faults import WRONG, Place, Reading, ScenarioError, Spelled, quote, spell_path
from jaxplan.schema.layout import SCENARIO, SPACECRAFT
from jaxplan.schema.sky import View, resolve
from jaxplan.schema.states import Pointing, in_inertial
from jaxplan.schema.tables import Table
from jaxplan.schema.value_kinds import Epoch, Kind
from jaxplan.schema.zone_checks import check_robust, check_zones

Read = TypeVar("Read")

_POINTING_FUNCTION = "jaxplan.goal.pointing_start:pointing_state"  # of a package that this one may not import
SETTINGS_TABLES = ("search", "trajectory", "robust")


class PythonReading(Reading):
    """Reading of an object that was made in Python: faults name attributes, in the model's units.

    Args:
        layout: the table by which it is read.
        root: what messages call the object.
    """

    python = True

    def __init__(self, layout: Table = SCENARIO, root: str = "the scenario") -> None:
        super().__init__()
        self.layout, self.root = layout, root

    def spelled(self, steps: Sequence[str | int]) -> Spelled:
        kind: Kind = self.layout
        path: list[str | int] = []
        unit = ""
        for step in steps:
            entry = next((entry for entry in kind.fields if step in (entry.key, entry.held)), None)
            if entry is None:
                path.append(step)
                continue
            path += (entry.held or entry.attribute).split(".")
            kind, unit = entry.kind, unit_of(entry.key)
        factor = math.pi / 180 if "deg" in unit else 1.0
        return Spelled(spell_path(path), unit.replace("deg", "rad"), factor)

    def show(self, value: object) -> str:
        return show(value)


def load_scenario(path: str | os.PathLike[str]) -> Scenario:
    """Read a scenario file.

    Args:
        path: path of a TOML file in UTF-8.

    Returns:
        The scenario in radians and seconds.

    Raises:
        ScenarioError: if the file cannot be read or is no scenario; the message lists every fault.
    """
    return read_file(path, parse_scenario)


def read_file(
    path: str | os.PathLike[str], parse: Callable[..., Read], largest: int = texts.LARGEST_FILE
) -> Read:
    """Read a file of limited size by a given function.

    Args:
        path: path of the file.
        parse: function of its text and of its `folder`, which returns what is read.
        largest: largest size, bytes.

    Returns:
        What `parse` returns.

    Raises:
        ScenarioError: as for `load_scenario`, with the path as its source.
    """
    file_path("path", path)
    try:
        with open(path, "rb") as file:
            content = file.read(largest + 1)
        if len(content) > largest:
            raise texts.too_large(largest)
        return parse(content.decode("utf-8-sig"), folder=os.path.dirname(path))
    except OSError as error:
        faults = [f"cannot be read: {error.strerror or error}"]
    except UnicodeDecodeError as error:
        faults = [f"not UTF-8 text, byte {error.start} is none of it"]
    except ScenarioError as error:
        faults = list(error.faults)
    raise ScenarioError(faults, os.fspath(path) or quote(""))


def parse_scenario(text: str, *, folder: str | os.PathLike[str] = "") -> Scenario:
    """Read a scenario from the text of a file.

    Args:
        text: TOML.
        folder: folder to which paths in it are relative; by default that of the process.

    Returns:
        The scenario in radians and seconds.

    Raises:
        ScenarioError: if the text is no scenario; the message lists every fault.
    """
    return scenario_from_dict(texts.parse(text), folder=folder)


def scenario_from_dict(tables: Mapping[str, Any], *, folder: str | os.PathLike[str] = "") -> Scenario:
    """Make a scenario from the tables of a file.

    Args:
        tables: dicts, lists and numbers with the keys and units of a file, as TOML or JSON give them.
        folder: folder to which paths in it are relative; by default that of the process.

    Returns:
        The scenario in radians and seconds.

    Raises:
        ScenarioError: if it is no scenario; the message lists every fault.
    """
    root = Place(Reading())
    root.reading.folder = folder
    given = dict(tables)
    if check_count([given.get(key) for key in ZONES], root):
        scenario, view = SCENARIO.read(given, root)
        check_parts(scenario, root)
        scenario = with_epoch(scenario, view, root)
        scenario = resolve(scenario, view, root)
        scenario = _convert_to_inertial(scenario, view, root)
        check_robust(scenario, root)
        scenario = with_start(scenario, root)
        check_paths(scenario, root)
        check_zones(scenario, root)
    if root.reading.faults:
        raise ScenarioError(root.reading.faults)
    return scenario


def _convert_to_inertial(scenario: Scenario, view: Any, root: Place) -> Scenario:
    """Return the scenario with inertial start and goal, which a file may give in the local orbital frame."""
    duration = getattr(scenario.trajectory, "duration", None)
    times = {"start": 0.0, "goal": duration if isinstance(duration, float) else None}
    ends = {name: in_inertial(getattr(scenario, name), view, times[name], root[name]) for name in times}
    return replace(scenario, **ends)


def with_epoch(scenario: Scenario, view: Any, root: Place) -> Scenario:
    """Return the scenario with the epoch of ``[sky]``, noting a fault if its own epoch differs.

    `view` is the table ``[sky]`` as it was read; the scenario is returned as it is if there is none.
    """
    if not (isinstance(view, View) and isinstance(view.epoch, np.datetime64)):
        return scenario
    own: Any = scenario.epoch
    if own not in (None, WRONG, view.epoch):
        complaint = f"is not that of [sky], {view.epoch}: give one of them"
        root["epoch_utc"].fault(complaint, Epoch().write(own))
    return replace(scenario, epoch=view.epoch)


def with_start(scenario: Scenario, root: Place) -> Scenario:
    """Return the scenario with the state of a start that the file gives by targets.

    A fault is noted if there is no such state. A scenario with faults is returned as it is.
    """
    asked: Any = scenario.start
    if not isinstance(asked, Pointing) or root.reading.faults:
        return scenario
    find: Any = resolve_name(_POINTING_FUNCTION)
    try:
        start = find(scenario, asked, joints=asked.joints)
    except ValueError as error:
        root["start"]["targets"].fault(str(error))
        return scenario
    return replace(scenario, start=start)


def take_in(given: object) -> Scenario:
    """Check a scenario made in Python, and convert it to the model's types.

    These are float64 arrays, tuples and floats.

    Returns:
        The scenario; where all types were right, the same object.

    Raises:
        TypeError: if it is no scenario.
        ScenarioError: if an attribute has a value that no file may hold, has the wrong type or shape, or does
            not go with others; the message lists every fault.
    """
    scenario, reading = _read_from_python(given)
    if reading.faults:
        raise ScenarioError(reading.faults)
    return scenario


def refuse_types(given: object) -> None:
    """Raise what `take_in` raises, but only if an attribute has the wrong type or shape."""
    _, reading = _read_from_python(given)
    if reading.refused:
        raise ScenarioError(reading.faults)


def _read_from_python(given: object) -> tuple[Any, Reading]:
    """Read a scenario made in Python.

    Returns:
        The scenario, with `WRONG` where it could not be read, or None if nothing was read; and the `Reading`
        with its faults.
    """
    scenario = expect("scenario", given, Scenario)
    root = Place(PythonReading())
    root.reading.terminals = count_terminals(scenario)
    taken: Any = None
    if check_count([getattr(scenario, name) for name in ZONES.values()], root):
        taken = SCENARIO.read(scenario, root)
        check_parts(taken, root)
        check_paths(taken, root)
        check_zones(taken, root)
        check_robust(taken, root)
    return taken, root.reading


def checked_spacecraft(given: object) -> Spacecraft:
    """Check a spacecraft, and convert it to the model's types, as `take_in` does for that of a scenario.

    Raises:
        TypeError: if it is no spacecraft.
        ScenarioError: for values that no scenario may have; the message lists every fault.
    """
    expect("spacecraft", given, Spacecraft)
    place = Place(PythonReading())["spacecraft"]
    taken: Spacecraft = SPACECRAFT.read(given, place)
    if place.reading.faults:
        raise ScenarioError(place.reading.faults, "the argument")
    return taken


def count_terminals(scenario: Scenario) -> int | None:
    """Return the number of terminals for which start and goal are made.

    The result is None if they differ, or if it cannot be told.
    """
    start, goal, craft = scenario.start, scenario.goal, scenario.spacecraft
    if getattr(goal, "devices", ()) or getattr(craft, "drives", ()):
        return None
    directions = getattr(goal, "directions", None)
    if directions is None:
        count = _array_length(getattr(goal, "joints", None), 2)
    elif isinstance(directions, list | tuple):
        count = len(directions)
    else:
        count = _array_length(directions)
    return count if count == _array_length(getattr(start, "joints", None), 2) else None


def _array_length(value: object, of: int = 1) -> int | None:
    """Return the length of an array divided by `of`.

    The result is None if it is no array of numbers, or if a remainder is left.
    """
    array = as_floats(value)
    return len(array) // of if array is not None and array.ndim and len(array) % of == 0 else None


def scenario_to_dict(scenario: Scenario) -> dict[str, Any]:
    """Make the tables of the scenario's file.

    Args:
        scenario: the scenario, in radians and seconds.

    Returns:
        Dicts, lists, numbers and strings with the keys and units of a file, ready for TOML or JSON.

    Raises:
        ScenarioError: if it could not be read again; the message lists every fault.
    """
    return SCENARIO.write(take_in(scenario))


def dump_scenario(scenario: Scenario) -> str:
    """Make the text of the scenario's file.

    Args:
        scenario: the scenario, in radians and seconds.

    Returns:
        TOML. An attitude that was read from a quaternion is written as a rotation vector.

    Raises:
        ScenarioError: if it could not be read again; the message lists every fault.
    """
    return texts.write(scenario_to_dict(scenario))


def save_scenario(scenario: Scenario, path: str | os.PathLike[str]) -> None:
    """Write the scenario's file, completely or not at all.

    Args:
        scenario: the scenario, in radians and seconds.
        path: path of the file; an existing file is replaced.

    Raises:
        ScenarioError: if it could not be read again; the message lists every fault.
        OSError: if it cannot be written, or must not replace what is there, such as a plan; that is left as
            it was.
    """
    text = dump_scenario(scenario)
    with replacing_file(file_path("path", path), kind=Source.SCENE) as temporary:
        temporary.write_bytes(text.encode())


def with_settings(scenario: Scenario, settings: Mapping[str, Any]) -> Scenario:
    """Return the scenario with other settings; everything else stays the same to the last bit.

    Args:
        scenario: the scenario, in radians and seconds.
        settings: values as a scenario file holds them, by table and key: ``search.<key>``,
            ``trajectory.<key>`` or ``robust.<key>``.

    Raises:
        TypeError: if settings are no dict.
        ScenarioError: if one of them is no setting, or has a value that a file may not hold; the message
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
    return replace(scenario, **{table: getattr(read, table) for table in SETTINGS_TABLES})
