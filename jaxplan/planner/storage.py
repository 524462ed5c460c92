"""Plan files: a plan as JSON, and its timings in a file beside it, since they alone are not deterministic.

Numbers are written with all their digits, so a plan that is loaded again is the same to the last bit. Nothing
in a file is executed, and nothing is taken on trust: the scenario goes through the scenario's own checks, the
shape of every array is checked against it, and NaN and infinity are refused. The stored certificate is only a
record; ``jaxplan check`` makes it anew.
"""

import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from jaxplan.certificate import Report
from jaxplan.path import Goal, Path
from jaxplan.planner.record import Plan
from jaxplan.scenario import ScenarioError, scenario_from_dict, scenario_to_dict
from jaxplan.search import SearchResult
from jaxplan.status import Status
from jaxplan.trajectory import Trajectory

SCHEMA_VERSION = 1
# A plan of 200 nodes with 12 terminals takes about 1 MB.
LARGEST_FILE = 64 * 2**20


class PlanFileError(ValueError):
    """A plan file that cannot be read; the message names the key and what is wrong."""


def save_plan(plan: Plan, path: str | os.PathLike[str]) -> None:
    """Write a plan to a JSON file, and its timings to ``<name>.timings.json`` beside it.

    Args:
        plan: any plan, also one that failed.
        path: the file; an old one is replaced in one step, so that a crash leaves the old or the new.
    """
    target = FilePath(path)
    content = {
        "schema_version": SCHEMA_VERSION,
        "scenario": scenario_to_dict(plan.scenario),
        "status": plan.status.name,
        "message": plan.message,
        **{key: _plain(getattr(plan, key)) for key in ("goal", "search", "path", "trajectory", "report")},
    }
    _write(target, content)
    _write(_timings_file(target), dict(plan.timings))


def load_plan(path: str | os.PathLike[str]) -> Plan:
    """Read a plan that `save_plan` wrote.

    Args:
        path: the JSON file; timings are read if their file is there.

    Raises:
        PlanFileError: if the file is missing, too large, no JSON, or not a plan.
    """
    source = FilePath(path)
    content = _read(source)
    if content.get("schema_version") != SCHEMA_VERSION:
        found = content.get("schema_version")
        raise PlanFileError(f"schema_version = {found!r}: this version reads {SCHEMA_VERSION}")
    try:
        scenario = scenario_from_dict(_mapping(content, "scenario"))
    except ScenarioError as error:
        raise PlanFileError(f"scenario: {error}") from error
    status = content.get("status")
    if not isinstance(status, str) or status not in Status.__members__:
        raise PlanFileError(f"status = {status!r}: must be one of {', '.join(Status.__members__)}")
    timings_file = _timings_file(source)
    joints = 2 * len(scenario.spacecraft.terminals)
    readers = {
        "goal": _goal,
        "path": _path,
        "trajectory": _trajectory,
        "search": _search,
        "report": _report,
    }
    parts = {
        key: reader(_mapping(content, key), joints) if content.get(key) is not None else None
        for key, reader in readers.items()
    }
    return Plan(
        scenario=scenario,
        status=Status[status],
        message=str(content.get("message", "")),
        timings=_read(timings_file) if timings_file.exists() else {},
        **parts,  # type: ignore[arg-type]
    )


def _timings_file(path: FilePath) -> FilePath:
    return path.with_name(path.stem + ".timings.json")


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


def _write(path: FilePath, content: Mapping[str, Any]) -> None:
    text = json.dumps(content, indent=1, allow_nan=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text + "\n")
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _read(path: FilePath) -> dict[str, Any]:
    def refuse(word: str) -> float:
        raise PlanFileError(f"{path}: {word} is not allowed")

    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise PlanFileError(f"{path}: {size} bytes, at most {LARGEST_FILE} are read")
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    except OSError as error:
        raise PlanFileError(f"{path}: {error.strerror}") from error
    except (UnicodeDecodeError, RecursionError, json.JSONDecodeError) as error:
        raise PlanFileError(f"{path}: not a plan file ({error})") from error
    if not isinstance(content, dict):
        raise PlanFileError(f"{path}: not a plan file (no table at its top)")
    return content


def _mapping(content: Mapping[str, Any], key: str) -> dict[str, Any]:
    value = content.get(key)
    if not isinstance(value, dict):
        raise PlanFileError(f"{key}: must be a table")
    return value


def _array(table: Mapping[str, Any], key: str, shape: tuple[int | None, ...]) -> np.ndarray:
    """An array of finite numbers; None in the shape stands for any length."""
    try:
        value = np.array(table.get(key), dtype=float)
    except (TypeError, ValueError) as error:
        raise PlanFileError(f"{key}: must be numbers of shape {shape}") from error
    fits = len(shape) == value.ndim and all(n in (None, m) for n, m in zip(shape, value.shape, strict=True))
    if not fits or not np.all(np.isfinite(value)):
        raise PlanFileError(f"{key}: must be finite numbers of shape {shape}, has shape {value.shape}")
    return value


def _goal(table: Mapping[str, Any], joints: int) -> Goal:
    return Goal(
        attitude=_array(table, "attitude", (3, 3)),
        joints=_array(table, "joints", (joints,)),
        slew_angle=float(_array(table, "slew_angle", ())),
    )


def _path(table: Mapping[str, Any], joints: int) -> Path:
    costs = _array(table, "edge_costs", (None,))
    nodes = len(costs) + 1
    return Path(
        attitudes=_array(table, "attitudes", (nodes, 3, 3)),
        joints=_array(table, "joints", (nodes, joints)),
        edge_costs=costs,
    )


def _trajectory(table: Mapping[str, Any], joints: int) -> Trajectory:
    breaks, joint_breaks = _array(table, "breaks", (None,)), _array(table, "joint_breaks", (None,))
    pieces, joint_pieces = len(breaks) - 1, len(joint_breaks) - 1
    return Trajectory(
        breaks=breaks,
        chart_attitude=_array(table, "chart_attitude", (pieces, 3, 3)),
        chart_start=_array(table, "chart_start", (pieces,)),
        chart_rate=_array(table, "chart_rate", (pieces, 3)),
        coefficients=_array(table, "coefficients", (pieces, None, 3)),
        joint_breaks=joint_breaks,
        joint_coefficients=_array(table, "joint_coefficients", (joint_pieces, None, joints)),
        node_times=_array(table, "node_times", (None,)),
        smoothness=int(_array(table, "smoothness", ())),
        method=str(table.get("method")),
    )


def _search(table: Mapping[str, Any], joints: int) -> SearchResult:
    if table.get("status") not in Status.__members__:
        raise PlanFileError(f"search.status = {table.get('status')!r}: unknown")
    counts = _array(table, "queue_expansions", (None,))
    return SearchResult(
        status=Status[table["status"]],
        path=_path(_mapping(table, "path"), joints) if table.get("path") is not None else None,
        expansions=int(_array(table, "expansions", ())),
        queue_expansions=tuple(int(count) for count in counts),
    )


def _report(table: Mapping[str, Any], joints: int) -> Report:
    known = {field.name for field in fields(Report)}
    if set(table) != known:
        raise PlanFileError(f"report: must have the keys {', '.join(sorted(known))}")
    content: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in table.items()}
    return Report(**content)
