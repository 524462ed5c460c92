"""Save and load plans as JSON files; the tables of such a file are defined and checked here.

A plan file is JSON. Its computation times are in a file beside it, since they alone are not deterministic. It
is read by the same classes of values (*kinds*) as scenario files. Lengths of arrays have names: the first
array of a file that has an axis of a name fixes the length for all others. Units are radians and seconds.

Numbers are written with all their digits, so a plan that is loaded again is the same to the last bit. Nothing
in a file is executed, and nothing is taken on trust: the scenario goes through the scenario's own checks, the
rest through those of its table, and NaN and infinity are refused. The stored certificate is only a record;
``jaxplan check`` computes it anew.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from jaxplan.certificate import Certificate
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import TRAJECTORY_METHODS, Scenario, moves
from jaxplan.model.status import Status
from jaxplan.runtime.arguments import file_path
from jaxplan.runtime.files import Source, expect_replaceable, replacing_file
from jaxplan.schema import ScenarioError, scenario_from_dict, scenario_to_dict
from jaxplan.schema.arrays import Array, not_falling, rotations
from jaxplan.schema.faults import Place, Reading
from jaxplan.schema.tables import Field, Table
from jaxplan.schema.value_kinds import (
    ByName,
    Choice,
    Integer,
    Interval,
    Kind,
    Name,
    Nullable,
    Number,
    Several,
    Text,
    YesNo,
)
from jaxplan.search import SearchResult
from jaxplan.trajectory import Trajectory
from jaxplan.trajectory.splines import SMOOTHNESS

SCHEMA_VERSION = 1

# The steps of a plan in the order in which they are made; a plan has the first few of them.
STEPS = ("goal", "search", "path", "trajectory", "report")
# How many of these steps a plan of each status has: (at least, at most).
_STEP_COUNTS = {
    Status.OK: (5, 5),
    Status.INVALID_START: (0, 0),
    Status.INVALID_GOAL: (0, 1),
    Status.GOAL_UNREACHABLE: (0, 0),
    Status.NO_PATH: (1, 2),
    Status.NODE_LIMIT: (2, 2),
    Status.TIME_LIMIT: (2, 2),
    Status.LIMITS_TOO_TIGHT: (3, 5),
    Status.GOAL_MISSED: (3, 5),
    Status.INFEASIBLE: (3, 5),
    Status.UNCERTIFIED: (5, 5),
}
_MIN_MARGIN_KEYS = ("min_margin", "worst_time", "worst_device", "worst_zone")
_TIME_TOLERANCE = 1e-9  # share of the duration by which a time may lie beyond the end of the trajectory
_NODE_TOLERANCE = 1e-6  # rad, or part of a matrix, by which a path may miss start and goal; above rounding

_COUNT = Integer(Interval("[0, inf)"))
_NON_NEGATIVE = Number(Interval("[0, inf)"))
# Beyond any angle, rate or coefficient of a manoeuvre, and small enough for what is computed from them.
_BOUNDED_NUMBER = Number(Interval("[-1e6, 1e6]"))
_SECONDS = Number(Interval("[0, 1e12]"))


def record_table(model: type, make: Any = None, **kinds: Kind) -> Table:
    """Return a table whose keys are attributes of `model`, all of them required.

    Args:
        model: class whose attributes are stored.
        make: called with the values read, as a dict, and their place in the file; None to construct `model`.
        kinds: the kind of each value, by key.
    """
    return Table(model, [Field(key, kind, key, required=True) for key, kind in kinds.items()], make=make)


def _array_kind(*shape: int | str) -> Array:
    """Kind of an array of numbers; `shape` has the length of each axis as a number or a name."""
    return Array(shape, _BOUNDED_NUMBER)


def _rotations_kind(*shape: int | str) -> Array:
    """Kind of an array of rotation matrices, (*shape, 3, 3)."""
    return Array((*shape, 3, 3), _BOUNDED_NUMBER, rule=rotations)


def _times_kind(*shape: int | str) -> Array:
    """Kind of an array of times in seconds, none less than the one before."""
    return Array(shape, _SECONDS, rule=not_falling)


def _path_table(edges: str) -> Table:
    """Table of a path; `edges` is the name by which its number of edges is known in the file."""
    return record_table(
        Path,
        edge_costs=Array((edges,), _NON_NEGATIVE),
        attitudes=_rotations_kind(f"{edges} + 1"),
        joints=_array_kind(f"{edges} + 1", "joint"),
    )


def trajectory_table(*methods: str) -> Table:
    """Table of a trajectory made by one of `methods`; reading needs the length named "joint" beforehand."""
    return record_table(
        Trajectory,
        breaks=_times_kind("pieces + 1"),
        chart_attitude=_rotations_kind("pieces"),
        chart_start=_times_kind("pieces"),
        chart_rate=_array_kind("pieces", 3),
        coefficients=_array_kind("pieces", "terms", 3),
        joint_breaks=_times_kind("joint pieces + 1"),
        joint_coefficients=_array_kind("joint pieces", "joint terms", "joint"),
        node_times=_times_kind("edges + 1"),
        smoothness=Integer(Interval(f"[0, {SMOOTHNESS}]")),
        method=Choice(methods),
    )


CERTIFICATE = record_table(
    Certificate,
    certified=YesNo(),
    min_margin=Nullable(Number(Interval("[-3.1416, 3.1416]"))),
    worst_time=Nullable(_NON_NEGATIVE),
    worst_device=Nullable(Name("device")),
    worst_zone=Nullable(Name("zone")),
    peaks=ByName(_NON_NEGATIVE),
    peak_times=ByName(_NON_NEGATIVE),
    jumps=ByName(_NON_NEGATIVE),
    faults=Several(Text(empty=True)),
    evaluations=_COUNT,
)
"""Table of a certificate; the reading must know the names of devices and zones."""
# What is stored of a goal where nothing moves: time and rates are the scenario's.
_STILL_GOAL = {
    "attitude": _rotations_kind(),
    "joints": _array_kind("joint"),
    "slew_angle": Number(Interval("[0, 3.1416]")),
}
_MOVING_GOAL = _STILL_GOAL | {
    "time": _NON_NEGATIVE,
    "angular_velocity": _array_kind(3),
    "joint_rates": _array_kind("joint"),
}
_SEARCH_STATUSES = ("OK", "NO_PATH", "NODE_LIMIT", "TIME_LIMIT")
_STEP_KINDS = {
    "search": record_table(
        SearchResult,
        status=Choice(_SEARCH_STATUSES, Status.__members__),
        path=Nullable(_path_table("found edges")),
        expansions=_COUNT,
        queue_expansions=Several(_COUNT),
    ),
    "path": _path_table("edges"),
    "trajectory": trajectory_table(*TRAJECTORY_METHODS),
    "report": CERTIFICATE,
}


def _plan_table(moving: bool) -> Table:
    """Table of a plan file except version and scenario; if `moving`, goals have a time and end rates."""
    steps = {"goal": record_table(Goal, **(_MOVING_GOAL if moving else _STILL_GOAL)), **_STEP_KINDS}
    return record_table(
        dict,
        lambda parts, place: parts,
        status=Choice(tuple(Status.__members__), Status.__members__),
        message=Text(empty=True),
        **{key: Nullable(kind) for key, kind in steps.items()},
    )


def _check_agreement(read: Mapping[str, Any], scenario: Scenario, root: Place) -> None:
    """Note a fault wherever tables that are valid by themselves contradict each other, or the scenario.

    Args:
        read: the values read, by name of their table.
        scenario: the plan's scenario.
        root: place of the whole file, to which faults are added.
    """
    _check_steps(read, root)
    if read["search"] is not None:
        _check_search(read, root["search"])
    if read["path"] is not None and read["goal"] is not None:
        _check_path(read["path"], scenario, read["goal"], root["path"])
    if read["report"] is not None:
        _check_report(read["status"], read["report"], root["report"])
    if read["trajectory"] is not None:
        _check_method(read["trajectory"], scenario, root["trajectory"])
        _check_times(read["trajectory"], read["report"], root)


def _check_steps(read: Mapping[str, Any], root: Place) -> None:
    """Note a fault for each step that is filled though the status rules it out, or missing though needed."""
    least, most = _STEP_COUNTS[read["status"]]
    because = f'since status = "{read["status"].name}"'
    last = max((number for number, step in enumerate(STEPS) if read[step] is not None), default=-1)
    for number, step in enumerate(STEPS):
        if read[step] is not None and number >= most:
            root[step].fault(f"must be null, {because}")
        elif read[step] is None and number < least:
            root[step].fault(f"must be a table, {because}", None)
        elif read[step] is None and number < last:
            root[step].fault(f"must be a table, since {STEPS[last]} is one", None)


def _check_search(read: Mapping[str, Any], place: Place) -> None:
    """Note faults of a search result: it must have a path, or else end with the plan's status."""
    search, status = read["search"], read["status"]
    found = search.status is Status.OK
    because = f'since search.status = "{search.status.name}"'
    if found and search.path is None:
        place["path"].fault(f"must be a table, {because}", None)
    elif not found and search.path is not None:
        place["path"].fault(f"must be null, {because}")
    expected = status if read["path"] is None else Status.OK
    if search.status is not expected:
        complaint = f'must be "{expected.name}", since status = "{status.name}"'
        place["status"].fault(complaint, search.status.name)


def _check_path(path: Path, scenario: Scenario, goal: Goal, place: Place) -> None:
    """Note a fault for each end of a path that differs from the scenario's start, or from the goal."""
    for number, name, end in ((0, "start", scenario.start), (-1, "goal", goal)):
        for key, node, wanted in (
            ("attitudes", path.attitudes[number], end.attitude),
            ("joints", path.joints[number], end.joints),
        ):
            if not np.allclose(node, wanted, rtol=0, atol=_NODE_TOLERANCE):
                place[key][number % len(path.joints)].fault(f"must be that of the {name}", node.tolist())


def _check_method(trajectory: Trajectory, scenario: Scenario, place: Place) -> None:
    """Note a fault if the trajectory was made by another method than the scenario asks for."""
    asked = scenario.trajectory.method
    if trajectory.method != asked:
        place["method"].fault(f'must be "{asked}", as scenario.trajectory.method is', trajectory.method)


def _check_report(status: Status, report: Certificate, place: Place) -> None:
    """Note faults if a certificate contradicts the status, or states only part of the smallest margin."""
    proved = {Status.OK: True, Status.UNCERTIFIED: False}.get(status, report.certified)
    if report.certified is not proved:
        complaint = f'must be {str(proved).lower()}, since status = "{status.name}"'
        place["certified"].fault(complaint, report.certified)
    missing = [key for key in _MIN_MARGIN_KEYS if getattr(report, key) is None]
    if 0 < len(missing) < len(_MIN_MARGIN_KEYS):
        place[missing[0]].fault(f"must not be null, unless all of {', '.join(_MIN_MARGIN_KEYS)} are", None)


def _check_times(trajectory: Trajectory, report: Certificate | None, root: Place) -> None:
    """Note faults for times outside the trajectory, and for breaks or nodes that do not span it.

    Times may exceed the end of the trajectory by the relative rounding `_TIME_TOLERANCE`.
    """
    first, end = float(trajectory.breaks[0]), float(trajectory.breaks[-1])
    nodes, last = trajectory.node_times, len(trajectory.node_times) - 1
    if first != 0:
        root["trajectory"]["breaks"][0].fault("must be 0", first)
    if nodes[0] != 0:
        root["trajectory"]["node_times"][0].fault("must be 0", float(nodes[0]))
    if nodes[-1] < end * (1 - _TIME_TOLERANCE) and last:
        complaint = f"must be the end of the trajectory, {end:g} s"
        root["trajectory"]["node_times"][last].fault(complaint, float(nodes[-1]))
    for place, time in _iterate_times(trajectory, report, root):
        if not time <= end * (1 + _TIME_TOLERANCE):
            place.fault(f"must lie within the trajectory, which ends at {end:g} s", time)


def _iterate_times(
    trajectory: Trajectory, report: Certificate | None, root: Place
) -> Iterator[tuple[Place, float]]:
    """Yield the place in the file and the value, s, of each time of a trajectory and its certificate."""
    for key in ("chart_start", "joint_breaks", "node_times"):
        for i, time in enumerate(getattr(trajectory, key).tolist()):
            yield root["trajectory"][key][i], time
    if report is not None:
        if report.worst_time is not None:
            yield root["report"]["worst_time"], report.worst_time
        for name, time in report.peak_times.items():
            yield root["report"]["peak_times"][name], time


# A plan of 200 nodes with 12 terminals takes about 1 MB.
LARGEST_FILE = 64 * 2**20
_TIMINGS_SUFFIX = ".timings.json"


class PlanFileError(ValueError):
    """Raised for a plan file that cannot be read; the message names the key and what is wrong."""


def save_plan(plan: Any, path: str | os.PathLike[str]) -> None:
    """Write a plan to a JSON file, and its computation times to ``<name>.timings.json`` beside it.

    Args:
        plan: a `jaxplan.planner.record.Plan`, also one that failed.
        path: the file. An old one is replaced in one step, so that a crash leaves either the old plan or the
            new one, and never the new plan beside the old computation times.

    Raises:
        ValueError: if the path has the name of a file of timings.
        OSError: if it cannot be written, or must not replace what is there; that is left as it was.
    """
    target = file_path("path", path)
    if target.name.endswith(_TIMINGS_SUFFIX):
        raise ValueError(
            f"{target}: files that end in {_TIMINGS_SUFFIX} hold the timings of plans: take another name"
        )
    content = {
        "schema_version": SCHEMA_VERSION,
        "scenario": scenario_to_dict(plan.scenario),
        "status": plan.status.name,
        "message": plan.message,
        **{key: plain(getattr(plan, key)) for key in STEPS},
    }
    if plan.goal is not None and not moves(plan.scenario):
        content["goal"] = {key: content["goal"][key] for key in _STILL_GOAL}
    timings = _timings_file(target)
    expect_replaceable(timings)
    with _replacing_json_file(target, content, Source.PLAN):
        timings.unlink(missing_ok=True)
    with _replacing_json_file(timings, dict(plan.timings)):
        pass


def read_plan(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the attributes of a plan, by name, from a file that `save_plan` wrote.

    Args:
        path: the JSON file; computation times are read too if their file stands beside it.

    Raises:
        PlanFileError: if the file is missing, too large, not JSON, or not a plan.
    """
    source = file_path("path", path)
    content = _read_json_table(source, "plan")
    try:
        return _parse_plan(content) | {"timings": _read_timings(_timings_file(source))}
    except ScenarioError as error:
        raise PlanFileError(str(ScenarioError(error.faults, os.fspath(path)))) from error


def _parse_plan(content: dict[str, Any]) -> dict[str, Any]:
    """Return a plan's attributes, by name, from a file's content; raises ScenarioError with all faults."""
    root = Place(Reading())
    if "schema_version" in content:
        Choice((SCHEMA_VERSION,)).read(content["schema_version"], root["schema_version"])
    else:
        root["schema_version"].fault(f"missing, must be {SCHEMA_VERSION}")
    if not isinstance(content.get("scenario"), dict):
        root["scenario"].fault("must be a table", content.get("scenario"))
    if root.reading.faults:
        raise ScenarioError(root.reading.faults)
    try:
        scenario = scenario_from_dict(content["scenario"])
    except ScenarioError as error:
        raise ScenarioError([f"scenario: {fault}" for fault in error.faults]) from error
    craft = scenario.spacecraft
    names = {
        "device": scenario.sight_names,
        "zone": tuple(zone.name for zone in scenario.zones),
    }
    root = Place(Reading(names, {"joint": craft.joint_count}))
    rest = {key: value for key, value in content.items() if key not in ("schema_version", "scenario")}
    read = _plan_table(moves(scenario)).read(rest, root)
    if not root.reading.faults:
        _check_agreement(read, scenario, root)
    if root.reading.faults:
        raise ScenarioError(root.reading.faults)
    return {"scenario": scenario, "certificate": read.pop("report"), **read}


def _read_timings(path: FilePath) -> dict[str, float]:
    """Read the computation times by step, s; an empty dict if there is no such file.

    Raises:
        PlanFileError: if the file is not one of timings.
    """
    if not path.exists():
        return {}
    root = Place(Reading())
    read: dict[str, float] = ByName(_NON_NEGATIVE).read(_read_json_table(path, "timings"), root)
    if root.reading.faults:
        raise PlanFileError(str(ScenarioError(root.reading.faults, os.fspath(path))))
    return read


def _timings_file(path: FilePath) -> FilePath:
    """Return the path of the file of computation times that belongs to a plan file."""
    return path.with_name(path.name.removesuffix(".json") + _TIMINGS_SUFFIX)


def plain(record: Any) -> Any:
    """Convert a dataclass, array, status or mapping to what JSON has: dicts, lists, texts and numbers."""
    if isinstance(record, np.ndarray | np.generic):
        return record.tolist()
    if isinstance(record, Status):
        return record.name
    if isinstance(record, Mapping):
        return {key: plain(value) for key, value in record.items()}
    if isinstance(record, tuple | list):
        return [plain(value) for value in record]
    if record is None or isinstance(record, bool | int | float | str):
        return record
    return {field.name: plain(getattr(record, field.name)) for field in fields(record)}


@contextmanager
def _replacing_json_file(
    path: FilePath, content: Mapping[str, Any], kind: Source | None = None
) -> Iterator[None]:
    """Write `content` as JSON to a temporary file, run the block, then move the file to `path`."""
    text = json.dumps(content, indent=1, allow_nan=False)
    with replacing_file(path, kind=kind) as file:
        file.write_text(text + "\n", encoding="utf-8")
        yield


def _read_json_table(path: FilePath, kind: str) -> dict[str, Any]:
    """Read the table at the top of a JSON file; `kind` names such files in the message of PlanFileError."""

    def refuse(word: str) -> float:
        raise ValueError(f"{word} is not allowed")

    try:
        with path.open("rb") as file:  # the size of a device or pipe is unknown before it is read
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
