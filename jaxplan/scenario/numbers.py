"""Single numbers of a scenario by their dotted names, such as ``keep_out[0].half_angle_deg``.

A name spells the tables and keys of a scenario file, rows counted from zero; values are in the file's units.
Reading and replacing a number work with traced values, so they may stand between a parameter that is
differentiated and the scenario.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxplan.scenario.faults import nearest
from jaxplan.scenario.kinds import Integer, Interval, Number
from jaxplan.scenario.layout import SCENARIO
from jaxplan.scenario.model import GivenState, Scenario
from jaxplan.scenario.states import STATE, TARGETS, Goal
from jaxplan.scenario.tables import Rows, Table

_PART = re.compile(r"(\w+)(?:\[(\d+)\])?")


@dataclass(frozen=True)
class NumberPlace:
    """Where a number stands.

    Attributes:
        name: dotted, in the file's keys.
        path: attributes and indices from the scenario to the number.
        factor: what takes the file's unit to the model's.
        interval: where it must lie, in the file's units; None for anywhere.
    """

    name: str
    path: tuple[str | int, ...]
    factor: float
    interval: Interval | None

    def get(self, scenario: Scenario) -> Any:
        """The number, in the file's units."""
        value: Any = scenario
        for step in self.path:
            value = value[step] if isinstance(step, int) else getattr(value, step)
        return value / self.factor


def find_number(scenario: Scenario, name: str) -> NumberPlace:
    """Where a number of a scenario stands.

    Args:
        scenario: that has it.
        name: such as ``trajectory.duration_s`` or ``spacecraft.terminal[1].mount_deg``.

    Raises:
        KeyError: if there is no such key or row, or no number there; the message says what there is.
    """
    table: Table = SCENARIO
    value: Any = scenario
    path: list[str | int] = []
    *tables, last = name.split(".")
    for part in tables:
        key, row = _parsed(part, name)
        entry = _entry(table, key, name)
        path.append(entry.attribute)
        if not hasattr(value, entry.attribute):
            raise KeyError(f"{name}: {key} is used when a file is read, and is no part of a scenario")
        value, kind = getattr(value, entry.attribute), entry.kind
        if isinstance(kind, Rows):
            if row is None or not row < len(value):
                raise KeyError(f"{name}: {key} has {len(value)} rows, write {key}[0] for the first")
            path.append(row)
            value, table = value[row], kind.table
        elif isinstance(kind, Goal):
            table = STATE if isinstance(value, GivenState) else TARGETS
        elif isinstance(kind, Table) and row is None:
            table = kind
        else:
            raise KeyError(f"{name}: {key} is no table with rows")
    key, row = _parsed(last, name)
    entry = _entry(table, key, name)
    held = next(other.key for other in table.fields if other.attribute == entry.attribute)
    if held != key:
        raise KeyError(f"{name}: {key} is held as {held}")
    value = getattr(value, entry.attribute, None)
    if (
        row is not None
        or not isinstance(entry.kind, Number)
        or not isinstance(value, float | int | np.number)
    ):
        if isinstance(entry.kind, Integer):
            number = "is a whole number, no single number that has a slope"
        elif isinstance(entry.kind, Number) and value is None:
            number = "is not a number here but not set: give it a value first"
        elif isinstance(entry.kind, Number):
            number = "is not a number here" + (f" but {value}" if isinstance(value, str) else "")
        else:
            number = "is no single number"
        raise KeyError(f"{name}: {key} {number}")
    factor = np.pi / 180 if entry.kind.degrees else 1.0
    return NumberPlace(name, (*path, entry.attribute), factor, entry.kind.interval)


def with_numbers(scenario: Scenario, numbers: Mapping[NumberPlace, Any]) -> Scenario:
    """The scenario with other numbers in some places, given in the file's units."""
    for place, number in numbers.items():
        scenario = _replaced(scenario, place.path, number * place.factor)
    return scenario


def _replaced(value: Any, path: tuple[str | int, ...], number: Any) -> Any:
    if not path:
        return number
    step, *rest = path
    if isinstance(step, int):
        return (*value[:step], _replaced(value[step], tuple(rest), number), *value[step + 1 :])
    return replace(value, **{step: _replaced(getattr(value, step), tuple(rest), number)})


def _parsed(part: str, name: str) -> tuple[str, int | None]:
    found = _PART.fullmatch(part)
    if found is None:
        raise KeyError(f"{name}: {part!r} is no key; write keys with dots, and rows such as keep_out[0]")
    return found[1], None if found[2] is None else int(found[2])


def _entry(table: Table, key: str, name: str) -> Any:
    known = [entry.key for entry in table.fields]
    for entry in table.fields:
        if entry.key == key:
            return entry
    raise KeyError(f"{name}: unknown key {key}, {nearest(key, known, 'keys')}")
