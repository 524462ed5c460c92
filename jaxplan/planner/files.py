"""Plans in files: the layout of their tables, and how they are saved and loaded.

The layout of a plan file: its tables and keys with their ranges, and what must agree between them.

It is read by the kinds that scenario files are read by. Lengths of arrays have names: the first array of a
file that has an axis of a name says how long all others must be. Radians and seconds, as in the model.

Plan files: a plan as JSON, and its timings in a file beside it, since they alone are not deterministic.

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
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from jaxplan.certificate import Certificate
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario, moves
from jaxplan.model.status import Status
from jaxplan.model.zones import sight_names
from jaxplan.planner.arrays import (
    Array,
    ByName,
    Known,
    Lines,
    Nullable,
    Rotations,
    Tables,
    Times,
    Words,
)
from jaxplan.runtime.arguments import file_path
from jaxplan.runtime.files import replacing_file
from jaxplan.schema import ScenarioError, scenario_from_dict, scenario_to_dict
from jaxplan.schema.faults import DeviceNames, Place
from jaxplan.schema.kinds import Choice, Integer, Interval, Kind, Number, Text, YesNo
from jaxplan.schema.tables import Field, Table
from jaxplan.search import SearchResult
from jaxplan.trajectory import Trajectory

SCHEMA_VERSION = 1

# In the order in which they are made; of a plan, the first few are filled.
STEPS = ("goal", "search", "path", "trajectory", "report")
# How many steps a plan of each status has: at least, at most.
_STEPS_OF = {
    Status.OK: (5, 5),
    Status.INVALID_START: (0, 0),
    Status.INVALID_GOAL: (1, 1),
    Status.GOAL_UNREACHABLE: (0, 0),
    Status.NO_PATH: (1, 2),
    Status.NODE_LIMIT: (2, 2),
    Status.TIME_LIMIT: (2, 2),
    Status.LIMITS_TOO_TIGHT: (3, 5),
    Status.GOAL_MISSED: (3, 5),
    Status.INFEASIBLE: (3, 5),
    Status.UNCERTIFIED: (5, 5),
}
_SMALLEST_MARGIN = ("min_margin", "worst_time", "worst_device", "worst_zone")
_ROUNDING = 1e-9  # of the duration

_STATUS = Choice(tuple(Status.__members__))
_SEARCH_STATUS = Choice(("OK", "NO_PATH", "NODE_LIMIT", "TIME_LIMIT"))
_COUNT = Integer(Interval("[0, inf)"))
_POSITIVE = Number(Interval("[0, inf)"))


def _table(model: type, make: Any = None, **kinds: Kind) -> Table:
    """A table whose keys are those of the model, all of which must be there."""
    return Table(model, tuple(Field(key, kind, key, "", required=True) for key, kind in kinds.items()), make)


STILL_GOAL = ("attitude", "joints", "slew_angle")
"""What there is to keep of a goal where nothing moves: time and rates are the scenario's."""
HEAD = _table(dict, schema_version=Choice((SCHEMA_VERSION,)), scenario=Tables())
"""What the rest of a plan file is read by."""
TIMINGS = ByName(_POSITIVE)
"""What the file beside it may hold."""


def plan_table(scenario: Scenario) -> Table:
    """What the file of a plan may hold, but for its `HEAD`.

    Args:
        scenario: of the plan; it says how many joints there are, and the names of devices and zones.
    """
    craft = scenario.spacecraft
    sizes = {"joints": 2 * len(craft.terminals)}
    array, rotations, times = partial(Array, sizes), partial(Rotations, sizes), partial(Times, sizes)
    zones = tuple(zone.name for zone in scenario.zones)
    sights = tuple(sight_names(craft.device_names, scenario.constraints))

    def path(edges: str) -> Table:
        return _table(
            Path,
            edge_costs=array((edges,), Interval("[0, inf)")),
            attitudes=rotations((f"{edges} + 1", 3, 3)),
            joints=array((f"{edges} + 1", "joints")),
        )

    search = _table(
        SearchResult,
        _make_search,
        status=_SEARCH_STATUS,
        path=Nullable(path("found edges")),
        expansions=_COUNT,
        queue_expansions=array(("queues",), Interval("[0, inf)"), whole=True),
    )
    trajectory = _table(
        Trajectory,
        breaks=times(("pieces + 1",)),
        chart_attitude=rotations(("pieces", 3, 3)),
        chart_start=times(("pieces",)),
        chart_rate=array(("pieces", 3)),
        coefficients=array(("pieces", "terms", 3)),
        joint_breaks=times(("joint pieces + 1",)),
        joint_coefficients=array(("joint pieces", "joint terms", "joints")),
        node_times=times(("edges + 1",)),
        smoothness=_COUNT,
        method=Text(),
    )
    report = _table(
        Certificate,
        certified=YesNo(),
        min_margin=Nullable(Number(Interval("[-3.1416, 3.1416]"))),
        worst_time=Nullable(_POSITIVE),
        worst_device=Nullable(Known("device", sights)),
        worst_zone=Nullable(Known("zone", zones)),
        peaks=ByName(_POSITIVE),
        peak_times=ByName(_POSITIVE),
        jumps=ByName(_POSITIVE),
        faults=Lines(),
        evaluations=_COUNT,
    )
    still = rotations((3, 3)), array(("joints",)), Number(Interval("[0, 3.1416]"))
    of_goal: dict[str, Kind] = dict(zip(STILL_GOAL, still, strict=True))
    if moves(scenario):
        of_goal |= {"time": _POSITIVE, "angular_velocity": array((3,)), "joint_rates": array(("joints",))}
    steps = {
        "goal": _table(Goal, **of_goal),
        "search": search,
        "path": path("edges"),
        "trajectory": trajectory,
        "report": report,
    }
    kinds = {key: Nullable(kind) for key, kind in steps.items()}
    return _table(dict, _make_parts, status=_STATUS, message=Words(), **kinds)


def _make_search(*, status: str, queue_expansions: np.ndarray, **parts: Any) -> SearchResult:
    counts = tuple(int(count) for count in queue_expansions)
    return SearchResult(**{"path": None, **parts}, status=Status[status], queue_expansions=counts)


def _make_parts(*, status: str, report: Certificate | None = None, **parts: Any) -> dict[str, Any]:
    return {"status": Status[status], "certificate": report, **parts}


def check_agreement(read: Mapping[str, Any], root: Place) -> None:
    """Note where tables that are well by themselves contradict each other.

    Args:
        read: what `plan_table` read without fault.
        root: the place of the file.
    """
    _check_steps(read, root)
    if "search" in read:
        _check_found_path(read["search"], root.key("search"))
    if "report" in read:
        _check_report(read, root.key("report"))
    if "trajectory" in read:
        _check_times(read, root)


def _check_steps(read: Mapping[str, Any], root: Place) -> None:
    """Which steps are filled follows from the status, and none is left out before one that is filled."""
    least, most = _STEPS_OF[Status[read["status"]]]
    filled = [number for number, step in enumerate(STEPS) if step in read]
    last = max(filled, default=-1)
    for number, step in enumerate(STEPS):
        here, because = root.key(step), f'since status = "{read["status"]}"'
        if number in filled and number >= most:
            here.fault(f"must be null, {because}")
        elif number not in filled and number < least:
            here.fault(f"must be a table, {because}", None)
        elif number not in filled and number < last:
            here.fault(f"must be a table, since {STEPS[last]} is one", None)


def _check_found_path(search: Mapping[str, Any], place: Place) -> None:
    because, found = f'since search.status = "{search["status"]}"', search["status"] == Status.OK.name
    if found and "path" not in search:
        place.key("path").fault(f"must be a table, {because}", None)
    elif not found and "path" in search:
        place.key("path").fault(f"must be null, {because}")


def _check_report(read: Mapping[str, Any], place: Place) -> None:
    report = read["report"]
    proved = {Status.OK.name: True, Status.UNCERTIFIED.name: False}.get(read["status"], report["certified"])
    if report["certified"] is not proved:
        complaint = f'must be {str(proved).lower()}, since status = "{read["status"]}"'
        place.key("certified").fault(complaint, report["certified"])
    if 0 < sum(key in report for key in _SMALLEST_MARGIN) < len(_SMALLEST_MARGIN):
        missing = next(key for key in _SMALLEST_MARGIN if key not in report)
        place.key(missing).fault(f"must not be null, unless all of {', '.join(_SMALLEST_MARGIN)} are", None)


def _check_times(read: Mapping[str, Any], root: Place) -> None:
    """Every time lies within the trajectory, whose breaks start at zero."""
    breaks = read["trajectory"]["breaks"]
    if breaks[0] != 0:
        root.key("trajectory").key("breaks").item(0).fault("must be 0", float(breaks[0]))
    for place, time in _instants(read, root):
        if not time <= breaks[-1] * (1 + _ROUNDING):
            place.fault(f"must lie within the trajectory, which ends at {breaks[-1]:g} s", time)


def _instants(read: Mapping[str, Any], root: Place) -> Iterator[tuple[Place, float]]:
    for key in ("chart_start", "joint_breaks", "node_times"):
        for i, time in enumerate(read["trajectory"][key]):
            yield root.key("trajectory").key(key).item(i), float(time)
    report, place = read.get("report", {}), root.key("report")
    if "worst_time" in report:
        yield place.key("worst_time"), report["worst_time"]
    for name, time in report.get("peak_times", {}).items():
        yield place.key("peak_times").key(name), time


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
        "schema_version": SCHEMA_VERSION,
        "scenario": scenario_to_dict(plan.scenario),
        "status": plan.status.name,
        "message": plan.message,
        **{key: _plain(getattr(plan, key)) for key in STEPS},
    }
    if plan.goal is not None and not moves(plan.scenario):
        content["goal"] = {key: content["goal"][key] for key in STILL_GOAL}
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
    HEAD.read({f.key: rest.pop(f.key) for f in HEAD.fields if f.key in content}, root)
    if root.faults:
        raise ScenarioError(root.faults)
    try:
        scenario = scenario_from_dict(content["scenario"])
    except ScenarioError as error:
        raise ScenarioError([f"scenario: {fault}" for fault in error.faults]) from error
    table = plan_table(scenario)
    read = table.read(rest, root)
    if not root.faults:
        check_agreement(read or {}, root)
    if root.faults:
        raise ScenarioError(root.faults)
    return {"scenario": scenario, **table.build(read)}


def _timings(path: FilePath) -> dict[str, float]:
    """The seconds by step of a plan; none where their file is not there."""
    if not path.exists():
        return {}
    root = Place(faults=[], devices=DeviceNames(None, None))
    read = TIMINGS.read(_read(path, "timings"), root)
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
