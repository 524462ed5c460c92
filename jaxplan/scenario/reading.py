"""From a scenario file, its text or the dict it holds to the model, with all faults reported at once.

Single values are checked by their kind (`layout`), what concerns several tables by `checks`. Whether start
and goal keep the constraints is no matter of the file: planning answers that with a status.
"""

import os
from collections.abc import Mapping
from typing import Any

from jaxplan.given import file_path
from jaxplan.model.scenario import Scenario
from jaxplan.scenario import toml
from jaxplan.scenario.checks import ZONES, check_count, check_parts, check_paths
from jaxplan.scenario.faults import DeviceNames, Place, ScenarioError, quote
from jaxplan.scenario.layout import SCENARIO
from jaxplan.scenario.resolving import resolve_directions


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
