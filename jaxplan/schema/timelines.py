"""Timelines from files and Python objects, and back to files, with all faults reported at once.

A timeline's file is a scenario's without a goal: spacecraft, start, ``[sky]``, zones and settings are read by
the same tables. In addition it has ``[timeline]``, the activities, and paths by name (``[[direction]]``), so
that a path which many activities follow is in the file only once; a name of ``[sky]`` is also looked up only
once. Times count from the epoch. What concerns single activities is in `activities`.
"""

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxplan import sky
from jaxplan.model.activities import SHORTEST, Activity, Timeline
from jaxplan.model.directions import DirectionPath
from jaxplan.model.export_names import ExportNames
from jaxplan.model.scenario import Scenario
from jaxplan.runtime.arguments import expect, file_path
from jaxplan.runtime.files import Source, replacing_file
from jaxplan.schema import text as texts
from jaxplan.schema.activities import (
    ACTIVITY,
    check_order,
    check_windows,
    paths_of,
    seconds_after,
    split_activity,
    timed,
    with_paths,
)
from jaxplan.schema.checks import ZONES, check_count, check_parts, check_unique, placed
from jaxplan.schema.directions import PATH, path_of
from jaxplan.schema.faults import WRONG, Place, Reading, ScenarioError
from jaxplan.schema.headings import HEADING, Heading
from jaxplan.schema.layout import SCENARIO, split_scenario
from jaxplan.schema.model_tables import declared
from jaxplan.schema.reading import PythonReading, count_terminals, read_file, with_epoch, with_start
from jaxplan.schema.sky import Aim, Followed, Lasting, View, looked_up_names, resolve_all
from jaxplan.schema.states import in_inertial
from jaxplan.schema.tables import Field, Rows, Table
from jaxplan.schema.value_kinds import Choice, Text
from jaxplan.schema.zone_checks import check_robust, check_zones

KIND = "timeline"
MOST_ACTIVITIES = 5000  # more are refused before they are read
_SOURCE = "the timeline"


@dataclass(frozen=True, kw_only=True)
class _TimelineParts:
    """The parts of a timeline as its file has them.

    Names are not yet replaced by directions, and UTC not yet by seconds; what has faults is `WRONG`.
    """

    name: Any
    scene: Any
    view: Any
    heading: Any
    directions: Any
    activities: Any


_PATH_STEM = "path"  # name of a path in files that are written; its number follows
_NUMBERED_PATH = re.compile(rf"{_PATH_STEM}-\d+")


@dataclass(frozen=True, kw_only=True)
class Given:
    """A path with a name, by which targets and wishes of activities refer to it."""

    name: str
    path: DirectionPath


def _make_given(parts: dict[str, Any], place: Place) -> Given:
    """Make a path with a name from what was read.

    The target gets this name, too, unless the file gives another.
    """
    name, called = parts.pop("name"), parts.pop("called", "")
    if not called and name is not WRONG and not _NUMBERED_PATH.fullmatch(name):
        called = name
    return Given(name=name, path=path_of({**parts, "called": called}, place))


def _make_parts(parts: dict[str, Any], place: Place) -> _TimelineParts:
    """Make the parts of a timeline from what was read of its file, by attribute.

    Parts that the file does not have get their usual values.
    """
    del parts["schema_version"], parts["kind"]
    own = {name: parts.pop(name, usual) for name, usual in _DEFAULT_PARTS.items()}
    return _TimelineParts(name=parts["name"], scene=Scenario(goal=WRONG, **parts), **own)


GIVEN = Table(
    Given,
    [
        Field("name", Text(), "name", "by which targets and wishes of activities refer to it", required=True),
        *PATH.fields,
    ],
    make=_make_given,
    split=lambda given: {
        **vars(given.path),
        "name": given.name,
        "called": given.path.called or None,
        "hidden": given.path.hidden or None,
    },
)
_DEFAULT_PARTS: dict[str, Any] = {"view": None, "heading": Heading(), "directions": (), "activities": WRONG}
_OWN_FIELDS = {
    "name": (Field("kind", Choice((KIND,)), "kind", "of the file", required=True),),
    "spacecraft": (Field("timeline", HEADING, "heading", "when it ends, and names for other tools"),),
    "keep_out": (
        Field("direction", Rows(GIVEN), "directions", "paths that activities refer to by their names"),
    ),
}


def _timeline_fields() -> list[Field]:
    """Return the keys of a timeline's file: those of a scenario without the goal, and its own."""
    found: list[Field] = []
    for entry in SCENARIO.fields:
        found += _OWN_FIELDS.get(entry.key, ())
        if entry.key != "goal":
            found.append(replace(entry, attribute="view") if entry.key == "sky" else entry)
    return [*found, Field("activity", Rows(ACTIVITY), "activities", "what is to be done", required=True)]


def _split_timeline(timeline: Timeline) -> dict[str, Any]:
    """Return the values of a timeline's keys in a file, by attribute; paths of activities get names."""
    craft = timeline.scene.spacecraft
    names: dict[int, Given] = {}

    def name_of(direction: Any) -> Any:
        if not isinstance(direction, DirectionPath) or not direction.moves:
            return direction
        return Followed(
            names.setdefault(id(direction), Given(name=f"{_PATH_STEM}-{len(names) + 1}", path=direction)).name
        )

    activities = [split_activity(one, craft, name_of) for one in timeline.activities]
    heading = Heading(
        until=timeline.until,
        slew=timeline.slew,
        look_ahead=timeline.look_ahead,
        **({} if timeline.names is None else vars(timeline.names)),
    )
    return split_scenario(timeline.scene) | {
        "kind": KIND,
        "name": timeline.name,
        "heading": None if heading == Heading() else heading,
        "directions": tuple(names.values()) or None,
        "activities": activities,
    }


TIMELINE = Table(
    Scenario,
    _timeline_fields(),
    make=_make_parts,
    split=_split_timeline,
    refused={"goal": "a timeline has none: what devices point at stands in each [[activity]]"},
)
"""The table of a timeline's file."""
MADE = declared(Timeline)
"""The table of a timeline that is made in Python."""


def load_timeline(path: str | os.PathLike[str]) -> Timeline:
    """Read a timeline's file.

    Args:
        path: path of a TOML file in UTF-8.

    Returns:
        The timeline in radians, and seconds from its start.

    Raises:
        ScenarioError: if the file cannot be read or is no timeline; the message lists every fault.

    Example:
        >>> day = jp.plan_timeline(jp.load_timeline("day.toml"))
    """
    return read_file(path, parse_timeline, texts.LARGEST_TIMELINE)


def parse_timeline(text: str, *, folder: str | os.PathLike[str] = "") -> Timeline:
    """Read a timeline from the text of a file.

    Args:
        text: TOML.
        folder: folder to which paths in it are relative; by default that of the process.

    Returns:
        The timeline in radians, and seconds from its start.

    Raises:
        ScenarioError: if the text is no timeline; the message lists every fault.
    """
    return timeline_from_dict(texts.parse(text, texts.LARGEST_TIMELINE), folder=folder)


def timeline_from_dict(tables: Mapping[str, Any], *, folder: str | os.PathLike[str] = "") -> Timeline:
    """Make a timeline from the tables of a file.

    Args:
        tables: dicts, lists and numbers with the keys and units of a file, as TOML or JSON give them.
        folder: folder to which paths in it are relative; by default that of the process.

    Returns:
        The timeline in radians, and seconds from its start.

    Raises:
        ScenarioError: if it is no timeline; the message lists every fault.
    """
    root = Place(Reading())
    root.reading.folder, root.reading.root = folder, "the file"
    given = dict(tables)
    timeline: Any = None
    if check_count([given.get(key) for key in ZONES], root) and _check_activity_count(
        given.get("activity"), root
    ):
        timeline = _assemble_timeline(TIMELINE.read(given, root), root)
    if root.reading.faults:
        raise ScenarioError(root.reading.faults, _SOURCE)
    return timeline


def _check_activity_count(activities: Any, root: Place) -> bool:
    """Note a fault if there are too many activities, or none.

    Returns:
        Whether they are few enough to be read.
    """
    count = len(activities) if isinstance(activities, list | tuple) else 1
    if count > MOST_ACTIVITIES:
        root.fault(f"{count} activities, more than the {MOST_ACTIVITIES} that are allowed")
    elif not count:
        root["activity"].fault("must have an activity at least")
    return count <= MOST_ACTIVITIES


def _assemble_timeline(parts: _TimelineParts, root: Place) -> Any:
    """Make the timeline from what was read of a file, with directions for names and seconds for UTC."""
    scene, heading, ends = parts.scene, parts.heading, root["timeline"]["until_s"]
    check_parts(scene, root)
    scene = with_epoch(scene, parts.view, root)
    until: Any = WRONG if heading is WRONG else heading.until
    if isinstance(until, np.datetime64):
        ends = root["timeline"]["until_utc"]
        until = seconds_after(scene.epoch, until, ends)
    rows = placed(parts.activities, root["activity"])
    activities = [timed(one, place, scene.epoch) for place, one in rows]
    scene, activities, until = _resolve_names(parts, scene, activities, until, root)
    check_robust(scene, root)
    scene = with_start(scene, root)
    check_zones(scene, root)
    scene = replace(scene, goal=scene.start)
    read = [(place, one, before) for (place, before), one in zip(rows, activities, strict=True)]
    _check_consistency(scene, read, until, ends, root)
    named = {} if heading is WRONG else heading.given
    return Timeline(
        name=parts.name,
        scene=scene,
        activities=tuple(activities),
        until=until,
        slew=SHORTEST if heading is WRONG else heading.slew,
        look_ahead=False if heading is WRONG else heading.look_ahead,
        names=ExportNames(**named) if named and not root.reading.faults else None,
    )


def _resolve_names(
    parts: _TimelineParts, scene: Scenario, activities: list[Activity], until: Any, root: Place
) -> tuple[Scenario, list[Activity], Any]:
    """Replace names of the file and of ``[sky]`` in scene and activities by directions.

    Returns:
        Scene, activities, and `until`; this is `WRONG` if it is missing or has faults.
    """
    given = _named_paths(parts, root)
    aims = [Aim(scene.start, root["start"])]
    kinds = ["point" if one.point is not None else "track" for one in activities]
    places = [place for place, _ in placed(parts.activities, root["activity"])]
    for place, one, kind in zip(places, activities, kinds, strict=True):
        aims.append(Aim(with_paths(getattr(one, kind), given), place, kind))
    lasting = Lasting(until if isinstance(until, float) else None, "timeline.until_s")
    view = parts.view
    if isinstance(view, View) and view.for_duration is None:
        if until is None and looked_up_names(scene, aims, root):
            until = root["timeline"]["until_s"].fault(
                "missing (or until_utc), must be a number of seconds, for which names of [sky] are followed"
            )
        if until is WRONG:
            return scene, activities, WRONG  # how long names are followed cannot be told
    scene, found = resolve_all(scene, aims, view, lasting, root)
    start, *targets = found
    start = in_inertial(start, view, 0.0, root["start"])
    scene = replace(scene, start=start)
    changed: list[dict[str, Any]] = [{kind: own} for kind, own in zip(kinds, targets, strict=True)]
    return scene, [replace(one, **own) for one, own in zip(activities, changed, strict=True)], until


def _named_paths(parts: _TimelineParts, root: Place) -> dict[str, Any]:
    """Return the paths that the file gives by name; a path with faults is `WRONG`.

    Names that something else has already are noted.
    """
    rows = placed(parts.directions, root["direction"])
    check_unique(rows)
    things = [getattr(parts.view, name, ()) for name in ("satellites", "ground")]
    taken = {one.name for each in things for _, one in placed(each, root)} | {*sky.BODIES, *sky.LOCAL}
    for place, one in rows:
        if one.name in taken and one.name is not WRONG:
            place["name"].fault("is that of a body, a direction, or something in [sky]", one.name)
    return {one.name: one.path for _, one in rows if one.name is not WRONG}


def _check_consistency(
    scene: Scenario, read: list[tuple[Place, Any, Any]], until: Any, ends: Place, root: Place
) -> None:
    """Note what does not go together in a timeline: order, windows, and how long directions are known.

    Args:
        scene: the scene as it was read.
        read: place, activity, and the activity before its window was converted to seconds.
        until: s, end of the timeline; None for that of the last activity.
        ends: place of `until`.
        root: place of the timeline.
    """
    ordered = check_order([(place, one) for place, one, _ in read])
    check_windows(read, until, ends, ordered[-1] if ordered else None)
    if root.reading.faults:
        return  # paths may have faults, or belong to names that have
    zones = (*scene.keep_out, *scene.keep_in)
    moving: list[tuple[str, Any]] = [(f"zone {zone.name}", zone.direction) for zone in zones if zone.moves]
    for _, one, _ in read:
        moving += paths_of(one, scene.spacecraft)
    known = [(float(path.times[-1]), words) for words, path in moving]
    known += [(zone.lasts, f"zone {zone.name}") for zone in zones if zone.lasts < math.inf]
    if not known:
        return
    if until is None:
        what = f"{moving[0][0]} moves" if moving else f"{known[0][1]} lasts for {known[0][0]:g} s"
        ends.fault(f"missing, must be a number of seconds, since {what}")
        return
    last, words = min(known, key=lambda one: one[0])
    if not until <= last or not all(path.covers(until) for _, path in moving):
        ends.fault(f"must be at most {last:.10g}, until when {words} is known", until)


def take_in_timeline(given: object) -> Timeline:
    """Check a timeline made in Python, and convert it to the model's types: float64 arrays, tuples, floats.

    Args:
        given: a `Timeline`. Its scene may have any goal, which is replaced by its start. A path that several
            activities share is shared in the result, too.

    Returns:
        The timeline; its scene has the timeline's name.

    Raises:
        TypeError: if it is no timeline.
        ScenarioError: if an attribute has a value that no file may hold, has the wrong type or shape, or does
            not go with others; the message lists every fault.
    """
    timeline = expect("timeline", given, Timeline, "jp.load_timeline reads one from a file")
    root = Place(PythonReading(MADE, _SOURCE))
    asked, scene = timeline, getattr(timeline, "scene", None)  # whatever stands there
    if isinstance(scene, Scenario):
        root.reading.terminals = count_terminals(replace(scene, goal=scene.start))
        name: Any = timeline.name
        own = replace(scene, name=name if isinstance(name, str) else scene.name, goal=scene.start)
        asked = replace(timeline, scene=own)
    taken: Any = None
    zones = [getattr(scene, name, ()) for name in ZONES.values()]
    if check_count(zones, root) and _check_activity_count(timeline.activities, root):
        taken = MADE.read(asked, root)
        if taken.scene is not WRONG:
            _check_scene(taken.scene, root["scene"])
            read = [(place, one, one) for place, one in placed(taken.activities, root["activity"])]
            _check_consistency(taken.scene, read, taken.until, root["until_s"], root)
    if root.reading.faults:
        raise ScenarioError(root.reading.faults, _SOURCE)
    done: Timeline = taken
    return done


def _check_scene(scene: Scenario, place: Place) -> None:
    """Note what does not go together in the scene of a timeline made in Python."""
    check_parts(scene, place)
    check_zones(scene, place)
    check_robust(scene, place)


def timeline_to_dict(timeline: Timeline) -> dict[str, Any]:
    """Make the tables of the timeline's file.

    Args:
        timeline: the timeline, in radians and seconds.

    Returns:
        Dicts, lists, numbers and strings with the keys and units of a file, ready for TOML or JSON. Moving
        directions have their samples, each path of activities once, so that no ``[sky]`` is needed.

    Raises:
        ScenarioError: if it could not be read again; the message lists every fault.
    """
    return TIMELINE.write(take_in_timeline(timeline))


def dump_timeline(timeline: Timeline) -> str:
    """Make the text of the timeline's file, as TOML; see `timeline_to_dict`."""
    return texts.write(timeline_to_dict(timeline))


def save_timeline(timeline: Timeline, path: str | os.PathLike[str]) -> None:
    """Write the timeline's file, completely or not at all.

    Args:
        timeline: the timeline, in radians and seconds.
        path: path of the file; an existing file is replaced.

    Raises:
        ScenarioError: if it could not be read again; the message lists every fault.
        OSError: if it cannot be written, or must not replace what is there, such as a plan; that is left as
            it was.
    """
    text = dump_timeline(timeline)
    with replacing_file(file_path("path", path), kind=Source.SCENE) as temporary:
        temporary.write_bytes(text.encode())


def timeline_template() -> str:
    """Make the text of a timeline's file that can be planned as it is, see `jaxplan.schema.text.template`."""
    return texts.template("timeline.toml", TIMELINE)
