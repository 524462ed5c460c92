"""Plan files: a plan as JSON, and its timings in a file beside it, since they alone are not deterministic.

Numbers are written with all their digits, so a plan that is loaded again is the same to the last bit. Nothing
in a file is executed, and nothing is taken on trust: the scenario goes through the scenario's own checks, all
else through those of `layout`, and NaN and infinity are refused. The stored certificate is only a record;
``jaxplan check`` makes it anew.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from jaxplan.given import file_path
from jaxplan.model.moments import moves
from jaxplan.model.status import Status
from jaxplan.planner import layout
from jaxplan.runtime.files import replacing_file
from jaxplan.scenario import ScenarioError, scenario_from_dict, scenario_to_dict
from jaxplan.scenario.faults import DeviceNames, Place

# A plan of 200 nodes with 12 terminals takes about 1 MB.
LARGEST_FILE = 64 * 2**20
_TIMINGS = ".timings.json"


class PlanFileError(ValueError):
    """A plan file that cannot be read; the message names the key and what is wrong."""


def write_plan(plan: Any, path: str | os.PathLike[str]) -> None:
    """Write a plan to a JSON file, and its timings to ``<name>.timings.json`` beside it.

    Args:
        plan: a `jaxplan.planner.record.Plan`, also one that failed.
        path: the file; an old one is replaced in one step, so that a crash leaves the old or the new, and
            never the new one beside the timings of the old.

    Raises:
        ValueError: if the path is called like a file of timings.
    """
    target = file_path("path", path)
    if target.name.endswith(_TIMINGS):
        raise ValueError(
            f"{target}: files that end in {_TIMINGS} hold the timings of plans: take another name"
        )
    content = {
        "schema_version": layout.SCHEMA_VERSION,
        "scenario": scenario_to_dict(plan.scenario),
        "status": plan.status.name,
        "message": plan.message,
        **{key: _plain(getattr(plan, key)) for key in layout.STEPS},
    }
    if plan.goal is not None and not moves(plan.scenario):
        content["goal"] = {key: content["goal"][key] for key in layout.STILL_GOAL}
    timings = _timings_file(target)
    with _replacing(target, content):
        timings.unlink(missing_ok=True)
    with _replacing(timings, dict(plan.timings)):
        pass


def read_plan(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What a file that `write_plan` wrote holds: the attributes of a plan.

    Args:
        path: the JSON file; timings are read if their file is there.

    Raises:
        PlanFileError: if the file is missing, too large, no JSON, or not a plan.
    """
    source = file_path("path", path)
    content = _read(source, "plan")
    try:
        return _parts(content) | {"timings": _timings(_timings_file(source))}
    except ScenarioError as error:
        raise PlanFileError(str(ScenarioError(error.faults, os.fspath(path)))) from error


def _parts(content: dict[str, Any]) -> dict[str, Any]:
    """The attributes that a file's content stands for; its faults are raised as those of a scenario are."""
    root = Place(faults=[], devices=DeviceNames(None, None))
    rest = dict(content)
    layout.HEAD.read({f.key: rest.pop(f.key) for f in layout.HEAD.fields if f.key in content}, root)
    if root.faults:
        raise ScenarioError(root.faults)
    try:
        scenario = scenario_from_dict(content["scenario"])
    except ScenarioError as error:
        raise ScenarioError([f"scenario: {fault}" for fault in error.faults]) from error
    table = layout.plan_table(scenario)
    read = table.read(rest, root)
    if not root.faults:
        layout.check_agreement(read or {}, root)
    if root.faults:
        raise ScenarioError(root.faults)
    return {"scenario": scenario, **table.build(read)}


def _timings(path: FilePath) -> dict[str, float]:
    """The seconds by step of a plan; none where their file is not there."""
    if not path.exists():
        return {}
    root = Place(faults=[], devices=DeviceNames(None, None))
    read = layout.TIMINGS.read(_read(path, "timings"), root)
    if read is None:
        raise PlanFileError(str(ScenarioError(root.faults, os.fspath(path))))
    return read


def _timings_file(path: FilePath) -> FilePath:
    return path.with_name(path.name.removesuffix(".json") + _TIMINGS)


def _plain(record: Any) -> Any:
    """A dataclass, array or mapping as what JSON has."""
    if isinstance(record, np.ndarray | np.generic):
        return record.tolist()
    if isinstance(record, Status):
        return record.name
    if isinstance(record, Mapping):
        return {key: _plain(value) for key, value in record.items()}
    if isinstance(record, tuple | list):
        return [_plain(value) for value in record]
    if record is None or isinstance(record, bool | int | float | str):
        return record
    return {field.name: _plain(getattr(record, field.name)) for field in fields(record)}


@contextmanager
def _replacing(path: FilePath, content: Mapping[str, Any]) -> Iterator[None]:
    """Write a file that takes its place when the block ends, which begins once all is written."""
    text = json.dumps(content, indent=1, allow_nan=False)
    with replacing_file(path) as file:
        file.write_text(text + "\n", encoding="utf-8")
        yield


def _read(path: FilePath, kind: str) -> dict[str, Any]:
    """The table of a JSON file; of which kind, a message says if it is none."""

    def refuse(word: str) -> float:
        raise ValueError(f"{word} is not allowed")

    try:
        with path.open("rb") as file:  # what a device or pipe will give, its size does not tell
            text = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise PlanFileError(f"{path}: cannot be read: {error.strerror}") from error
    if len(text) > LARGEST_FILE:
        raise PlanFileError(f"{path}: too large, at most {LARGEST_FILE} bytes are read")
    try:
        content = json.loads(text.decode(), parse_constant=refuse)
    except (ValueError, RecursionError) as error:  # of the former, no UTF-8 and no JSON are kinds
        raise PlanFileError(f"{path}: not a {kind} file ({error})") from error
    if not isinstance(content, dict):
        raise PlanFileError(f"{path}: not a {kind} file (no table at its top)")
    return content
