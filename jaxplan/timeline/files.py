"""Save and load plans of timelines, each as one compressed file.

A day has some 10,000 pieces of polynomials, so the file is a zip archive like `numpy.savez_compressed` makes:
an ``.npy`` entry for each array of the trajectory and for each long list of numbers in the timeline, and
``plan.json`` with all else. `numpy.load` opens it. The same plan gives the same bytes on the same machine;
computation times, which differ, are not stored.

Nothing in a file is executed, and nothing is taken on trust: entries are numbers in float64 or text, never
pickled objects; the timeline goes through the checks of timeline files, the rest through those of its table,
and contradictions are refused. The stored certificate is only a record; ``jaxplan check`` computes it anew.
"""

import io
import json
import math
import os
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxplan.model.activities import REST, Timeline, in_order
from jaxplan.model.status import Status
from jaxplan.planner.files import CERTIFICATE, PlanFileError, plain, record_table, trajectory_table
from jaxplan.runtime.arguments import file_path
from jaxplan.runtime.files import DAY_ENTRY, Source, replacing_file
from jaxplan.schema import ScenarioError, timeline_from_dict, timeline_to_dict
from jaxplan.schema.faults import Place, Reading
from jaxplan.schema.value_kinds import Choice, Interval, Name, Nullable, Number, Several, Text
from jaxplan.trajectory import Trajectory

SCHEMA_VERSION = 1
KIND = "plan of a timeline"
LARGEST = 2**30
"""Bytes of all entries together, unpacked; a day of a spacecraft with eight joints has 10 MB."""
_MIN_ENTRY_LENGTH = 32  # least length of a list of numbers that is an entry of its own
_ENTRY_KEY = "entry"  # key of a dict that stands in place of such a list, with the entry's name
_TIME_STAMP = (1980, 1, 1, 0, 0, 0)  # time stamp of all entries, the same for equal bytes
_TIME_TOLERANCE = 1e-9  # s, by which equal times may differ
_SECONDS = Number(Interval("[0, 1e6]"))
_ARRAY_NAMES = (
    "breaks",
    "chart_attitude",
    "chart_start",
    "chart_rate",
    "coefficients",
    "joint_breaks",
    "joint_coefficients",
    "node_times",
)
_STATUS_KIND = Choice(tuple(Status.__members__), Status.__members__)


def _keep_dict(parts: dict[str, Any], place: Place) -> dict[str, Any]:
    """Return the values read from a table as a dict by key; used where a table makes no object."""
    return parts


_SEGMENT_TABLE = record_table(
    dict,
    _keep_dict,
    name=Text(),
    kind=Choice(("slew", "track", "attitude", "idle")),
    start=_SECONDS,
    end=_SECONDS,
)
_ACTIVITY_TABLE = record_table(
    dict,
    _keep_dict,
    name=Name("activity"),
    kind=Choice(("track", "point", "attitude", "idle")),
    status=_STATUS_KIND,
    message=Text(empty=True),
    start=Nullable(_SECONDS),
    end=Nullable(_SECONDS),
    slew=Nullable(_SECONDS),
    pointing_error=Nullable(Number(Interval("[0, inf)"), words={"inf": math.inf})),
)
_PLAN_TABLE = record_table(
    dict,
    _keep_dict,
    status=_STATUS_KIND,
    message=Text(empty=True),
    activities=Several(_ACTIVITY_TABLE),
    segments=Several(_SEGMENT_TABLE),
    trajectory=Nullable(trajectory_table("timeline", "tracking", "global")),
    certificate=Nullable(CERTIFICATE),
)


def save_plan(plan: Any, path: str | os.PathLike[str]) -> None:
    """Write a timeline's plan to one file, whole or not at all.

    Args:
        plan: a `jaxplan.timeline.TimelinePlan`, also one that failed.
        path: the file, usually ``.npz``; an existing one is replaced.

    Raises:
        ScenarioError: if the timeline could not be read again.
        OSError: if it cannot be written, or must not replace what is there, such as a scenario; that is left
            as it was.
    """
    target = file_path("path", path)
    arrays: dict[str, np.ndarray] = {}
    content = {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "timeline": _pack_arrays(timeline_to_dict(plan.timeline), "timeline", arrays),
        "status": plan.status.name,
        "message": plan.message,
        "activities": [plain(one) for one in plan.activities],
        "segments": [plain(one) for one in plan.segments],
        "trajectory": None,
        "certificate": plain(plan.certificate),
    }
    for one in content["activities"]:
        if one["pointing_error"] == math.inf:
            one["pointing_error"] = "inf"
    if plan.trajectory is not None:
        own = plain(plan.trajectory)
        for name in _ARRAY_NAMES:
            arrays[f"trajectory.{name}"] = np.asarray(getattr(plan.trajectory, name), float)
            own[name] = {_ENTRY_KEY: f"trajectory.{name}"}
        content["trajectory"] = own
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    with replacing_file(target, kind=Source.DAY_PLAN) as file, zipfile.ZipFile(file, "w") as archive:
        _add_entry(archive, DAY_ENTRY, text.encode())
        for name, array in arrays.items():
            _add_entry(archive, f"{name}.npy", _npy_bytes(array))


def _pack_arrays(value: Any, name: str, arrays: dict[str, np.ndarray]) -> Any:
    """Return tables with each long list of numbers replaced by the name of an entry.

    The lists themselves are put into `arrays` by that name, which begins with `name`.
    """
    if isinstance(value, dict):
        return {key: _pack_arrays(inner, f"{name}.{key}", arrays) for key, inner in value.items()}
    if not isinstance(value, list):
        return value
    if len(value) >= _MIN_ENTRY_LENGTH and _is_array(value):
        arrays[name] = np.array(value)
        return {_ENTRY_KEY: name}
    return [_pack_arrays(inner, f"{name}.{number}", arrays) for number, inner in enumerate(value)]


def _is_array(rows: list[Any]) -> bool:
    """Tell whether a list consists of floats alone, or of lists of floats that are all of the same length."""
    if all(type(row) is float for row in rows):
        return True
    return all(
        isinstance(row, list) and len(row) == len(rows[0]) and all(type(number) is float for number in row)
        for row in rows
    )


def _npy_bytes(array: np.ndarray) -> bytes:
    """Return an array as the bytes of an ``.npy`` file."""
    file = io.BytesIO()
    np.lib.format.write_array(file, np.ascontiguousarray(array, "<f8"), version=(1, 0), allow_pickle=False)
    return file.getvalue()


def _add_entry(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    """Add an entry without time and system of its creation, so that equal plans give equal bytes."""
    entry = zipfile.ZipInfo(name, _TIME_STAMP)
    entry.compress_type, entry.create_system, entry.external_attr = zipfile.ZIP_DEFLATED, 3, 0o644 << 16
    archive.writestr(entry, content)


def read_plan(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the attributes of a timeline's plan from a file that `save_plan` wrote.

    Args:
        path: the file.

    Returns:
        The attributes by name; activities and segments are dicts of their own attributes.

    Raises:
        PlanFileError: if the file is missing, too large, not such an archive, or not a plan of a timeline.
    """
    source = file_path("path", path)
    try:
        with zipfile.ZipFile(source) as archive:
            entries = _read_entries(archive)
        content = json.loads(entries.pop(DAY_ENTRY).decode(), parse_constant=_refuse_constant)
        if not isinstance(content, dict) or content.get("kind") != KIND:
            raise ValueError(f"its {DAY_ENTRY} has no kind = {KIND!r}")
        arrays = {name.removesuffix(".npy"): _parse_npy(name, entry) for name, entry in entries.items()}
        return _parse_plan(_unpack_arrays(content, arrays))
    except ScenarioError as error:
        raise PlanFileError(str(ScenarioError(error.faults, os.fspath(path)))) from error
    except OSError as error:
        raise PlanFileError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (
        ValueError,
        KeyError,
        EOFError,
        RecursionError,
        RuntimeError,  # of entries that are encrypted, or compressed in ways that zipfile does not know
        zipfile.BadZipFile,
        zlib.error,
    ) as error:
        raise PlanFileError(f"{path}: not a plan of a timeline ({error})") from error


def _refuse_constant(word: str) -> float:
    raise ValueError(f"{word} is not allowed")


def _read_entries(archive: zipfile.ZipFile) -> dict[str, bytes]:
    """Return the bytes of all entries of an archive, by name; raises ValueError if they are too large."""
    listed = archive.infolist()
    if sum(entry.file_size for entry in listed) > LARGEST:
        raise ValueError(f"unpacked it is larger than {LARGEST >> 20} MiB")
    names = [entry.filename for entry in listed]
    if len(set(names)) < len(names) or DAY_ENTRY not in names:
        raise ValueError(f"it needs one {DAY_ENTRY}, and no entry twice")
    return {entry.filename: archive.read(entry) for entry in listed}


def _parse_npy(name: str, content: bytes) -> np.ndarray:
    """Return the array of an ``.npy`` entry; raises ValueError if it is not one of float64."""
    file = io.BytesIO(content)
    try:
        array: np.ndarray = np.lib.format.read_array(file, allow_pickle=False)
    except (ValueError, MemoryError, OverflowError) as error:
        raise ValueError(f"{name}: no array of numbers, {error}") from error
    if array.dtype != np.dtype("<f8") or file.read(1):
        raise ValueError(f"{name}: must be one array of float64")
    return array


def _unpack_arrays(value: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """Return tables with names of entries replaced by their lists of numbers; KeyError if one is missing."""
    if isinstance(value, dict):
        if value.keys() == {_ENTRY_KEY}:
            if value[_ENTRY_KEY] not in arrays:
                raise KeyError(f"no entry {value[_ENTRY_KEY]}.npy")
            return arrays[value[_ENTRY_KEY]].tolist()
        return {key: _unpack_arrays(inner, arrays) for key, inner in value.items()}
    return [_unpack_arrays(inner, arrays) for inner in value] if isinstance(value, list) else value


def _parse_plan(content: dict[str, Any]) -> dict[str, Any]:
    """Return a plan's attributes, by name, from a file's content; raises ScenarioError with all faults.

    `content` is emptied of version, kind and timeline.
    """
    root = Place(Reading())
    Choice((SCHEMA_VERSION,)).read(content.pop("schema_version", None), root["schema_version"])
    tables = content.pop("timeline", None)
    if not isinstance(tables, dict):
        root["timeline"].fault("must be a table", tables)
    if root.reading.faults:
        raise ScenarioError(root.reading.faults)
    try:
        timeline = timeline_from_dict(tables)
    except ScenarioError as error:
        raise ScenarioError([f"timeline: {fault}" for fault in error.faults]) from error
    scene = timeline.scene
    names = {
        "activity": (*(one.name for one in timeline.activities), REST),
        "device": scene.sight_names,
        "zone": tuple(zone.name for zone in scene.zones),
    }
    root = Place(Reading(names, {"joint": scene.spacecraft.joint_count}))
    del content["kind"]
    read: dict[str, Any] = _PLAN_TABLE.read(content, root)
    if not root.reading.faults:
        _check_agreement(read, timeline, root)
    if root.reading.faults:
        raise ScenarioError(root.reading.faults)
    return {"timeline": timeline, **read}


def _check_agreement(read: Mapping[str, Any], timeline: Timeline, root: Place) -> None:
    """Note a fault wherever parts of a plan contradict each other, or the timeline.

    Args:
        read: the values read, by name.
        timeline: the plan's timeline.
        root: place of the whole file, to which faults are added.
    """
    trajectory, certificate = read["trajectory"], read["certificate"]
    if (trajectory is None) != (certificate is None):
        root["certificate"].fault("must be there where a trajectory is, and only there")
        return
    ordered = in_order(timeline.activities)
    for number, (one, asked) in enumerate(zip(read["activities"], ordered, strict=False)):
        if (one["name"], one["kind"]) != (asked.name, asked.kind):
            root["activities"][number]["name"].fault(f"must be {asked.name}, {asked.kind}", one["name"])
    failed = next((one["status"] for one in read["activities"] if one["status"] is not Status.OK), None)
    if read["status"] is Status.OK and (
        failed is not None
        or len(read["activities"]) < len(ordered)
        or (certificate is not None and not certificate.certified)
    ):
        complaint = "cannot be, since not all activities are planned and certified"
        root["status"].fault(complaint, read["status"].name)
    _check_segments(read["segments"], trajectory, root["segments"])
    for number, one in enumerate(read["activities"]):
        _check_activity_times(one, read["segments"], root["activities"][number])


def _check_segments(segments: Any, trajectory: Trajectory | None, place: Place) -> None:
    """Note a fault unless segments follow each other from the start of the trajectory to its end."""
    end = 0.0
    for number, one in enumerate(segments):
        if one["start"] != end:
            place[number]["start"].fault(f"must be the end of the one before, {end:.10g}", one["start"])
        if not one["start"] < one["end"]:
            place[number]["end"].fault(f"must be later than its start, {one['start']:.10g}", one["end"])
        end = one["end"]
    last = 0.0 if trajectory is None else trajectory.duration
    if end != last:
        place.fault(f"must end with the trajectory, at {last:.10g} s, and end at {end:.10g} s")
    if trajectory is not None:
        starts = [one["start"] for one in segments]
        for name in ("breaks", "joint_breaks"):
            if not np.isin(starts, getattr(trajectory, name)).all():
                place.fault(f"must begin at {name} of the trajectory")


def _check_activity_times(one: Mapping[str, Any], segments: Any, place: Place) -> None:
    """Note a fault if an activity's times are missing or reversed, or no segment covers them."""
    start, end = one["start"], one["end"]
    if one["status"] is Status.OK and (start is None or end is None):
        place["start"].fault("must be a number, as the end must, of what is planned", start)
    if start is None or end is None:
        return
    if not start <= end + _TIME_TOLERANCE:
        place["end"].fault(f"must not be before its start, {start:.10g}", end)
    if end - start <= _TIME_TOLERANCE or one["kind"] == "point":
        return
    own = [seg for seg in segments if seg["name"] == one["name"] and seg["kind"] == one["kind"]]
    if not any(
        seg["start"] <= start + _TIME_TOLERANCE and seg["end"] >= end - _TIME_TOLERANCE for seg in own
    ):
        place["name"].fault("has no segment over its time", one["name"])
