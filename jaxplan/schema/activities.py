"""Activities of a timeline in a file: what devices point at, or the state that is held, how long and when.

A file has targets under ``track`` or ``point``, and beside these what belongs to them (wishes, what is held,
the tolerance); a state to be held has the keys of a start. Instants are seconds from the timeline's start, or
UTC. In Python, the attributes of `Activity` are read. As in `checks`, `WRONG` stands for a value whose fault
was noted.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from jaxplan.model.activities import REST, Activity, in_order
from jaxplan.model.directions import DirectionPath
from jaxplan.model.epochs import seconds_between
from jaxplan.model.goals import Targets
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.schema.checks import RATES, check_targets, check_unique
from jaxplan.schema.directions import TargetList
from jaxplan.schema.faults import WRONG, Place, Reading, nearest
from jaxplan.schema.model_tables import KINDS, declared
from jaxplan.schema.sky import Followed
from jaxplan.schema.states import STATE, TARGETS, StateOf, make_state, make_targets, split_state
from jaxplan.schema.tables import Field, Table
from jaxplan.schema.value_kinds import Choice, Epoch, Interval

TRACKED = float(np.deg2rad(0.01))
"""rad, the tolerance of an activity that tracks, if the file does not say."""
_TIME_RANGE = Interval("[0, 86400]")  # s, of all times of a timeline
_WINDOW_TOLERANCE = 1e-9  # s by which rounding may make a window too short
_WINDOW_KEY_STEMS = {"earliest": "from", "latest": "until"}  # beginnings of the keys of a window


class Aims(TargetList):
    """Targets of an activity, by names of devices or one for each terminal; they may never be left out."""

    def may_miss(self, reading: Reading) -> bool:
        return False


def _make_kind_field(key: str, kind: Any, attribute: str, meaning: str) -> Field:
    """Make one of the keys that say what an activity is, of which exactly one must be given."""
    first = key == "track"
    return Field(key, kind, attribute, meaning, required=first, instead_of="" if first else "track")


def _find_fields(table: Table, *attributes: str) -> list[Field]:
    """Return the keys of a table that set given attributes."""
    return [entry for entry in table.fields if entry.attribute in attributes]


_DECLARED = declared(Activity)
_DECLARED_FIELDS = {entry.attribute: entry for entry in _DECLARED.attributes}
_STATE_FIELDS = [
    replace(entry, required=False)
    for entry in STATE.fields
    if entry.attribute not in (*RATES.values(), "frame")
]
_ONLY_GOALS_FAULT = "is of goals, an activity has none"
_ATTITUDE_ATTRIBUTES = ("rotation_vector", "quaternion")
_TARGET_FIELDS = [
    *_find_fields(TARGETS, "prefer", "hold"),
    replace(
        *_find_fields(TARGETS, "tolerance"),
        meaning="by which devices may be off their targets; if absent 0.01 of track, 1e-6 of point",
    ),
]


def _window_fields(attribute: str) -> tuple[Field, Field]:
    """Return the two keys of an end of a window ("earliest" or "latest"), in seconds and in UTC."""
    own = _DECLARED_FIELDS[attribute]
    utc = Field(
        f"{_WINDOW_KEY_STEMS[attribute]}_utc",
        Epoch(),
        f"{attribute}_utc",
        f"{own.key} as UTC",
        instead_of=attribute,
    )
    return own, utc


def _make_activity(parts: dict[str, Any], place: Place) -> Activity:
    """Make an activity from what was read, by attribute.

    Its window may stay in UTC until `timed` is called.
    """
    state = {entry.attribute: entry for entry in _STATE_FIELDS if entry.attribute in parts}
    held = {name: parts.pop(name) for name in state}
    beside = {e.attribute: (parts.pop(e.attribute), e.key) for e in _TARGET_FIELDS if e.attribute in parts}
    aims = {name: parts.pop(name) for name in ("track", "point") if name in parts}
    for name in _WINDOW_KEY_STEMS:
        utc = parts.pop(f"{name}_utc", None)
        parts |= {} if utc is None else {name: utc}
    if not held.keys().isdisjoint(_ATTITUDE_ATTRIBUTES):
        parts["attitude"] = make_state(held, place)
    else:
        for entry in state.values():
            place[entry.key].fault("is of an attitude, which is not given")
    if not aims:
        for _, key in beside.values():
            place[key].fault("is of track or point, by which devices have targets")
    for name, read in aims.items():
        usual = {"tolerance": TRACKED} if name == "track" else {}
        own = usual | {attribute: value for attribute, (value, _) in beside.items()}
        parts[name] = make_targets({"directions": read, **own}, place)
        check_targets(parts[name], place)
    return Activity(**parts | {"idle": parts.pop("rest", False)})


def _check_activity(activity: Any, place: Place) -> None:
    """Note what does not go together in an activity.

    If it was made in Python, also note faults that only such an activity can have.
    """
    if place.reading.python:
        _check_made(activity, place)
    for key in ("track", "point"):
        targets = getattr(activity, key)
        directions = getattr(targets, "directions", None)
        if directions is not None and directions is not WRONG and not len(directions):
            place[key].fault("must name a device at least, and what it points at")
    if activity.point is not None and activity.duration not in (None, WRONG):
        place["for_s"].fault(
            "is of what lasts, and to point takes an instant; track follows", activity.duration
        )


def _check_made(activity: Any, place: Place) -> None:
    """Note faults that only an activity made in Python can have."""
    given = [key for key in ("track", "point", "attitude") if getattr(activity, key) is not None]
    given += ["idle"] if activity.idle is True else []
    if len(given) != 1:
        told = " and ".join(given) or "none of them"
        place.fault(f"must be one of track, point, attitude and idle, is {told}")
    for key in ("track", "point"):
        targets = getattr(activity, key)
        if not isinstance(targets, Targets):
            continue
        usual = {part.name: part.default for part in fields(Targets)}
        for name in ("criterion", "yaw_limit", "pitch_limit", "clearance"):
            if getattr(targets, name) not in (WRONG, usual[name]):
                place[key][_find_key(TARGETS, name)].fault(_ONLY_GOALS_FAULT, getattr(targets, name))
        _refuse_rates(targets, place[key], "follows from the targets; leave it out")
    if activity.attitude is not None and activity.attitude is not WRONG:
        _refuse_rates(activity.attitude, place["attitude"], "must be zero, since it is held at rest")


def _refuse_rates(owner: Any, place: Place, complaint: str) -> None:
    """Note a fault for each rate of a state or of targets that is not zero."""
    for key, name in RATES.items():
        rates = getattr(owner, name)
        if rates is not None and rates is not WRONG and np.any(rates):
            place[key].fault(complaint, rates.tolist())


def _find_key(table: Table, attribute: str) -> str:
    """Return the key of a table that sets an attribute."""
    return next(entry.key for entry in table.fields if entry.attribute == attribute)


ACTIVITY = replace(
    _DECLARED,
    fields=(
        _DECLARED_FIELDS["name"],
        _make_kind_field("track", Aims(), "track", _DECLARED_FIELDS["track"].meaning),
        _make_kind_field("point", Aims(), "point", _DECLARED_FIELDS["point"].meaning),
        *(
            replace(
                entry, instead_of="track" if entry.attribute in _ATTITUDE_ATTRIBUTES else entry.instead_of
            )
            for entry in _STATE_FIELDS
        ),
        _make_kind_field("idle", Choice((True,)), "rest", _DECLARED_FIELDS["idle"].meaning),
        *_TARGET_FIELDS,
        _DECLARED_FIELDS["duration"],
        *_window_fields("earliest"),
        *_window_fields("latest"),
        _DECLARED_FIELDS["after"],
    ),
    make=_make_activity,
    split=lambda parts: parts,
    check=_check_activity,
    refused=dict.fromkeys(RATES, "an attitude is held at rest")
    | {"frame": 'an attitude is held at rest along inertial axes; track what turns, such as "nadir"'}
    | dict.fromkeys(
        ("criterion", "clearance_deg", "yaw_limit_deg", "pitch_limit_deg"),
        _ONLY_GOALS_FAULT,
    ),
)
MADE_ACTIVITY = replace(ACTIVITY, fields=_DECLARED.attributes)
"""The same by its attributes, for what is made in Python."""
KINDS[Activity] = MADE_ACTIVITY


def split_activity(activity: Activity, craft: Spacecraft, name_of: Callable[[Any], Any]) -> dict[str, Any]:
    """Return the values of an activity's keys in a file, by attribute.

    Args:
        activity: the activity, in radians and seconds.
        craft: the spacecraft that does it.
        name_of: returns what is written for a direction: the direction itself, or the name of its path.
    """
    parts = {name: getattr(activity, name) for name in ("name", "duration", "earliest", "latest")}
    parts["after"] = activity.after or None
    if activity.attitude is not None:
        return parts | split_state(StateOf(activity.attitude, len(craft.terminals)))
    targets = activity.targets
    if targets is None:
        return parts | {"rest": True}
    usual = TRACKED if activity.track is not None else Targets.tolerance
    each = zip(targets.names(craft), targets.directions, strict=True)
    aims = {name: name_of(direction) for name, direction in each}
    wishes = tuple(replace(wish, direction=name_of(wish.direction)) for wish in targets.prefer)
    return parts | {
        activity.kind: aims,
        "prefer": wishes or None,
        "hold": targets.hold or None,
        "tolerance": None if targets.tolerance == usual else targets.tolerance,
    }


def timed(activity: Activity, place: Place, epoch: Any) -> Activity:
    """Return the activity with its window in seconds from the epoch, noting UTC that is out of range."""
    changed = {}
    for name, key in _WINDOW_KEY_STEMS.items():
        stamp: Any = getattr(activity, name)
        if isinstance(stamp, np.datetime64):
            changed[name] = seconds_after(epoch, stamp, place[f"{key}_utc"])
    return replace(activity, **changed) if changed else activity


def seconds_after(epoch: Any, stamp: np.datetime64, place: Place) -> Any:
    """Return the seconds from an epoch to a UTC time.

    Args:
        epoch: UTC; None if the file has no epoch.
        stamp: UTC.
        place: place of the latter.

    Returns:
        s; `WRONG` after noting why there is no such number, or that it is out of range.
    """
    if not isinstance(epoch, np.datetime64):
        if epoch is None:
            place.fault("needs the epoch, by [sky] or epoch_utc, from which seconds count")
        return WRONG
    try:
        after = seconds_between(epoch, stamp)
    except ValueError as error:
        return place.fault(str(error))
    if after in _TIME_RANGE:
        return after
    told = f"must {_TIME_RANGE.wanted()} s from the epoch {Epoch().write(epoch)} on, is at {after:.10g} s"
    return place.fault(told, Epoch().write(stamp))


def check_order(rows: Sequence[tuple[Place, Any]]) -> list[Any]:
    """Note faults: names that are taken, and an `after` that names no activity or leads to itself.

    Args:
        rows: the activities that could be read, each after its place.

    Returns:
        The activities in the order in which they are done; empty if that cannot be told.
    """
    check_unique(rows)
    for place, one in rows:
        if one.name == REST:
            told = "is the name of the rest after all activities, must be another name"
            place["name"].fault(told, one.name)
    named = {one.name: one for _, one in rows if one.name is not WRONG}
    wrong = False
    for place, one in rows:
        if one.after in ("", WRONG):
            continue
        if one.after not in named:
            advice = nearest(one.after, list(named), "activities")
            wrong |= bool(place["after"].fault(f"no such activity, {advice}", one.after))
            continue
        chain = [one.name]
        while (following := named[chain[-1]].after) in named and following not in chain:
            chain.append(following)
        if following == one.name and one.name == min(chain):
            told = " after ".join([*chain, one.name])
            wrong |= bool(place["after"].fault(f"comes after itself: {told}", one.after))
        wrong |= following in chain
    return [] if wrong or len(named) < len(rows) else in_order([one for _, one in rows])


def check_windows(rows: Sequence[tuple[Place, Any, Any]], until: Any, ends: Place, last: Any) -> None:
    """Note faults: windows that are too short or too late, and activities whose duration is not determined.

    Args:
        rows: place, activity, and the activity as it was read, before its window was converted to seconds.
        until: s, when the timeline ends; None if that is not given.
        ends: place of `until`.
        last: the activity that is done last; None if that is not known.
    """
    for place, one, read in rows:
        keys = {
            name: place[f"{key}_{'utc' if isinstance(getattr(read, name), np.datetime64) else 's'}"]
            for name, key in _WINDOW_KEY_STEMS.items()
        }
        if WRONG in (one.duration, one.earliest, one.latest, until):
            continue
        _check_window(one, place["for_s"], keys["earliest"], keys["latest"])
        _check_until(one, place["for_s"], keys, until, ends)
        lasts = one.duration is None and one.latest is None and one.point is None
        if lasts and last is not None and one is not last:
            most = "only the last activity may last until the timeline ends"
            place["for_s"].fault(f"missing (or {place['until_s'].path}), must be a number, since {most}")
        elif lasts and until is None:
            others = f"{place['until_s'].path}, {ends.path}"
            place["for_s"].fault(f"missing (or {others}), must be a number")


def _check_window(one: Activity, lasts: Place, opens: Place, closes: Place) -> None:
    """Note a fault if a window ends before it begins, or is shorter than what is done in it.

    Args:
        one: the activity.
        lasts: place of its duration.
        opens: place of the start of its window.
        closes: place of the end of its window.
    """
    if one.latest is None:
        return
    begin, asked = one.earliest or 0.0, one.duration or 0.0
    if one.latest < begin:
        closes.fault(f"at {one.latest:.10g} s, must not be before {opens.path}, at {begin:.10g} s")
    elif asked > one.latest - begin + _WINDOW_TOLERANCE:
        since = f"{opens.path}, at {begin:.10g} s" if one.earliest is not None else "the start, at 0 s"
        left = one.latest - begin
        lasts.fault(f"must be at most {left:.10g}, the time from {since}, to {closes.path}", asked)


def _check_until(
    one: Activity, lasts: Place, keys: dict[str, Place], until: float | None, ends: Place
) -> None:
    """Note a fault if an activity cannot end before the timeline does.

    Args:
        one: the activity.
        lasts: place of its duration.
        keys: places of the ends of its window, by attribute.
        until: s, when the timeline ends; None if that is not given.
        ends: place of `until`.
    """
    if until is None:
        return
    end = f"{ends.path}, at {until:.10g} s"
    if one.earliest is not None and one.earliest > until:
        keys["earliest"].fault(f"at {one.earliest:.10g} s, must not be after {end}")
    elif one.latest is not None and one.latest > until:
        keys["latest"].fault(f"at {one.latest:.10g} s, must not be after {end}")
    elif one.latest is None and (one.earliest or 0.0) + (one.duration or 0.0) > until + _WINDOW_TOLERANCE:
        lasts.fault(f"ends after {end}", one.duration)


def paths_of(activity: Activity, craft: Spacecraft) -> list[tuple[str, DirectionPath]]:
    """Return the paths along which targets and wishes of an activity move.

    Each comes after words for it, such as "the target of antenna in activity image".
    """
    targets = activity.targets
    if not isinstance(targets, Targets) or not isinstance(targets.directions, tuple | np.ndarray):
        return []
    each = zip(targets.names(craft), targets.directions, strict=True)
    found = [(f"the target of {name}", one) for name, one in each]
    found += [(f"what {wish.device} prefers", wish.direction) for wish in targets.prefer]
    moving = [(words, one) for words, one in found if isinstance(one, DirectionPath) and one.moves]
    return [(f"{words} in activity {activity.name}", one) for words, one in moving]


def with_paths(targets: Any, given: dict[str, Any]) -> Any:
    """Return targets with paths instead of the names that a file gives to them.

    Args:
        targets: the targets; anything that is no `Targets` is returned as it is.
        given: the paths by name; one that has faults is `WRONG`.
    """
    if not isinstance(targets, Targets) or not given:
        return targets

    def found(one: Any) -> Any:
        return given.get(one.name, one) if isinstance(one, Followed) else one

    directions = targets.directions
    if isinstance(directions, tuple):
        directions = tuple(map(found, directions))
        directions = WRONG if any(one is WRONG for one in directions) else directions
    wishes = targets.prefer
    if isinstance(wishes, tuple):
        wishes = tuple(
            one if one is WRONG else replace(one, direction=found(one.direction)) for one in wishes
        )
    return replace(targets, directions=directions, prefer=wishes)
