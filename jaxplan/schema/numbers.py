"""Single numbers of a scenario by their dotted names, such as ``keep_out[0].half_angle_deg``.

A name spells the tables and keys of a scenario file; rows, and numbers of an array, are counted from zero, as
in ``start.angular_velocity_rad_s[2]``. Values are in the file's units. Replacing a number works with traced
values, so it may stand between a parameter with respect to which one differentiates and the scenario.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import EllipsisType
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxplan.geometry.vectors import array_module
from jaxplan.model.activities import Timeline
from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import Scenario
from jaxplan.schema.arrays import Array, PerAxis, range_of, within_a_turn
from jaxplan.schema.directions import Axis, TargetList
from jaxplan.schema.faults import nearest
from jaxplan.schema.inertias import Moments
from jaxplan.schema.layout import SCENARIO
from jaxplan.schema.reading import scenario_to_dict
from jaxplan.schema.states import STATE, TARGETS, Goal, Start
from jaxplan.schema.tables import Field, Rows, Table
from jaxplan.schema.value_kinds import ANY, Integer, Interval, Number

Held = TypeVar("Held", Scenario, Timeline)

_TIME_KEYS = {"duration": "for_s", "earliest": "from_s", "latest": "until_s"}  # of activities
_TIME_RANGE = Interval("[0, 86400]")  # s, of these
_SLEW_SETTINGS = (
    "trajectory.duration_s",
    "trajectory.method",
    "trajectory.first_guesses",
)  # settings that timelines choose themselves
_PART_PATTERN = re.compile(r"(\w+)(?:\[(\d+)\])?")


@dataclass(frozen=True)
class NumberPlace:
    """Where a number stands in a scenario or a timeline.

    Attributes:
        name: dotted name, by the file's keys.
        path: attributes and indices that lead from the scenario or timeline to the number. ``...`` means all
            numbers of an array at once, of which `get` returns the first. An index may also lead into a limit
            that is one number for all axes; it becomes three when one of them is replaced.
        factor: from the file's unit to the model's.
        interval: where the number must lie, in the file's units; None for anywhere.
    """

    name: str
    path: tuple[str | int | EllipsisType, ...]
    factor: float
    interval: Interval | None

    def get(self, scenario: Scenario | Timeline) -> Any:
        """Return the number that stands there in a scenario or timeline, in the file's units."""
        value: Any = scenario
        for step in self.path:
            value = (
                getattr(value, step)
                if isinstance(step, str)
                else _expand_axes(value)[0 if step is ... else step]
            )
        return value / self.factor


def find_number(scenario: Scenario, name: str) -> NumberPlace:
    """Find where a number of a scenario stands.

    Args:
        scenario: the scenario that has the number.
        name: dotted name such as ``trajectory.duration_s`` or ``spacecraft.terminal[1].mount_deg``.

    Raises:
        KeyError: if there is no such key or row, or no number there; the message says what there is.
    """
    table: Table = SCENARIO
    value: Any = scenario
    path: list[str | int] = []
    *tables, last = name.split(".")
    for part in tables:
        key, row = _parse_part(part, name)
        entry = _find_field(table, key, name)
        path.append(entry.attribute)
        if not hasattr(value, entry.attribute):
            raise KeyError(f"{name}: {key} is used when a file is read, and is no part of a scenario")
        value, kind = getattr(value, entry.attribute), entry.kind
        if isinstance(kind, Rows):
            if row is None or not row < len(value):
                raise KeyError(f"{name}: {_count_message(key, row, len(value), 'rows')}")
            path.append(row)
            value, table = value[row], kind.table
        elif isinstance(kind, Goal | Start):
            table = STATE if isinstance(value, GivenState) else TARGETS
        elif isinstance(kind, Table) and row is None:
            table = kind
        else:
            raise KeyError(f"{name}: {key} is no table with rows")
    key, row = _parse_part(last, name)
    entry = _find_field(table, key, name)
    held = next(other.key for other in table.fields if other.says == entry.says)
    if held != key and not hasattr(value, entry.attribute):
        raise KeyError(f"{name}: {key} is held as {held}")
    steps, kind = _find_number(entry, row, value, name, len(scenario.spacecraft.terminals))
    interval = None if kind.interval is ANY else kind.interval
    return NumberPlace(name, (*path, *steps), np.pi / 180 if kind.degrees else 1.0, interval)


def numbers_of(scenario: Scenario) -> tuple[NumberPlace, ...]:
    """Return all numbers of a scenario that may change by themselves, in the order of its file."""
    found = []
    for name in _number_names(scenario_to_dict(scenario), ""):
        try:
            found.append(find_number(scenario, name))
        except KeyError:  # a whole number, or one of a vector or matrix, whose numbers depend on each other
            continue
    return tuple(found)


def numbers_of_timeline(timeline: Timeline) -> tuple[NumberPlace, ...]:
    """Return all numbers of a timeline that may change by themselves, by the keys of its file.

    They are those of its scene without the goal, times and states of its activities, and its end. Their paths
    lead from the timeline: `NumberPlace.get` and `with_numbers` take it instead of a scenario.
    """
    scene = replace(timeline.scene, goal=timeline.scene.start)
    found = [
        replace(place, path=("scene", *place.path))
        for place in numbers_of(scene)
        if place.path[0] != "goal" and not place.name.startswith(_SLEW_SETTINGS)
    ]
    for row, activity in enumerate(timeline.activities):
        for attribute, key in _TIME_KEYS.items():
            if getattr(activity, attribute) is not None:
                path = ("activities", row, attribute)
                found.append(NumberPlace(f"activity[{row}].{key}", path, 1.0, _TIME_RANGE))
        if activity.attitude is not None:
            held = GivenState(
                rotation_vector=activity.attitude.rotation_vector, joints=activity.attitude.joints
            )
            for place in numbers_of(replace(scene, start=held, goal=held)):
                if place.path[0] == "start":
                    name = f"activity[{row}].{place.name.partition('.')[2]}"
                    found.append(
                        replace(place, name=name, path=("activities", row, "attitude", *place.path[1:]))
                    )
    if timeline.until is not None:
        found.append(NumberPlace("timeline.until_s", ("until",), 1.0, _TIME_RANGE))
    return tuple(found)


def _number_names(held: Any, before: str) -> Iterator[str]:
    """Yield the dotted names of all that may be a number in what a file holds.

    `before` is the name of the whole, with which they begin.
    """
    if isinstance(held, Mapping):
        for key, value in held.items():
            yield from _number_names(value, f"{before}.{key}" if before else key)
    elif isinstance(held, list):
        same = bool(held) and all(isinstance(value, int | float) for value in held) and len(set(held)) == 1
        if same:  # one number for all axes, perhaps
            yield before
        for row, value in enumerate(held):
            yield from _number_names(value, f"{before}[{row}]")
    elif isinstance(held, int | float) and not isinstance(held, bool):
        yield before


def _count_message(key: str, row: int | None, count: int, what: str) -> str:
    """Return the message on how many entries a key has, if a row is missing or too high.

    Args:
        key: the key.
        row: index that was given; None if there was none.
        count: number of entries.
        what: what they are, in the plural.
    """
    if not count:
        return f"{key} has no {what}"
    which = f"write {key}[0] for the first" if row is None else f"the last is {key}[{count - 1}]"
    return f"{key} has {count} {what}, {which}"


def _find_number(
    entry: Field, row: int | None, table: Any, name: str, terminals: int
) -> tuple[tuple[Any, ...], Number]:
    """Find a number in a table.

    Args:
        entry: the key.
        row: index of the number in an array; None if none was given.
        table: the object of the model that has the key.
        name: dotted name of the number, for messages.
        terminals: number of terminals, for arrays of joints.

    Returns:
        Attribute and index that lead from the table to the number, and the number's kind.

    Raises:
        KeyError: if there is no number that may change by itself.
    """
    key, kind = entry.key, entry.kind
    attribute = entry.held or entry.attribute
    value: Any = getattr(table, attribute, None)
    if isinstance(kind, Number) and row is None and isinstance(value, float | int | np.number):
        return (attribute,), kind
    # whether each number may change by itself
    apart = isinstance(kind, Array) and kind.rule in (None, range_of, within_a_turn)
    if value is None and attribute == "mount":
        raise KeyError(f"{name}: the terminal has mount, whose vectors may not change by themselves")
    if value is None and (isinstance(kind, Number | PerAxis) or apart):
        raise KeyError(f"{name}: {key} is not set here: give it a value first")
    if isinstance(kind, PerAxis):
        if row is None and np.all(np.asarray(value) == np.ravel(value)[0]):
            return ((attribute, ...) if np.ndim(value) else (attribute,)), kind.of
        if row is None or not row < 3:
            what = "numbers that differ" if row is None else "numbers"
            raise KeyError(f"{name}: {_count_message(key, row, 3, what)}")
        return (attribute, row), kind.of
    if isinstance(kind, Array) and apart:
        first, last = 0, len(value)
        if entry.held:  # joints: yaws, pitches, drives
            ends = [0, terminals, 2 * terminals, last]
            part = ("yaw", "pitch", "drive").index(key.split("_")[0])
            first, last = ends[part], ends[part + 1]
        count = last - first
        if row is None or not row < count:
            raise KeyError(f"{name}: {_count_message(key, row, count, 'numbers')}")
        return (attribute, first + row), kind.of
    if isinstance(kind, Integer):
        said = "is a whole number, no single number that has a slope"
    elif isinstance(kind, Number) and isinstance(value, str):
        said = f'is "{value}" here, and no number'
    elif isinstance(kind, Number):
        said = "is a single number: write no index"
    elif isinstance(kind, Array | Moments | TargetList | Axis):
        said = "is no single number: its numbers depend on each other, and none may change by itself"
    else:
        said = "is no single number"
    raise KeyError(f"{name}: {key} {said}")


def _expand_axes(value: Any) -> Any:
    """Return a tuple or array as it is, and one number for all body axes as an array (3,)."""
    return value if isinstance(value, tuple) or np.ndim(value) else array_module(value).full(3, value)


def with_numbers(scenario: Held, numbers: Mapping[NumberPlace, Any]) -> Held:
    """Return the scenario, or timeline, with other numbers in some places.

    Args:
        scenario: the scenario or timeline; it is not changed.
        numbers: for each place the new number in the file's units, which may be traced.
    """
    for place, number in numbers.items():
        scenario = _replace_number(scenario, place.path, number * place.factor)
    return scenario


def _replace_number(value: Any, path: tuple[Any, ...], number: Any) -> Any:
    """Return an object, tuple or array with another number at the end of a path, in the model's unit."""
    if not path:
        return number
    step, *rest = path
    if isinstance(step, str):
        return replace(value, **{step: _replace_number(getattr(value, step), tuple(rest), number)})
    value = _expand_axes(value)
    if isinstance(value, tuple):
        return (*value[:step], _replace_number(value[step], tuple(rest), number), *value[step + 1 :])
    if isinstance(number, jax.Array) or isinstance(value, jax.Array):
        return jnp.asarray(value).at[step].set(number)
    changed = np.array(value)
    changed[step] = number
    return changed


def _parse_part(part: str, name: str) -> tuple[str, int | None]:
    """Split a part of a dotted name into its key and its index, which is None if there is none.

    Raises:
        KeyError: if it is no such part.
    """
    found = _PART_PATTERN.fullmatch(part)
    if found is None:
        raise KeyError(f"{name}: {part!r} is no key; write keys with dots, and rows such as keep_out[0]")
    return found[1], None if found[2] is None else int(found[2])


def _find_field(table: Table, key: str, name: str) -> Any:
    """Return the field of a table that has a key; raises KeyError if none has it, naming the dotted name."""
    known = [entry.key for entry in table.fields]
    for entry in table.fields:
        if entry.key == key:
            return entry
    raise KeyError(f"{name}: unknown key {key}, {nearest(key, known, 'keys')}")
