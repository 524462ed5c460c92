"""How faults of a scenario that was made in Python are told: by its attributes, with numbers in its units.

What a file calls ``keep_out[0].half_angle_deg = 401`` is ``keep_out[0].half_angle = 7.0 rad``, and must lie
in a range of radians. Names and units follow from the layout.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from jaxplan.given import show
from jaxplan.scenario.arrays import Direction
from jaxplan.scenario.faults import DeviceNames, Place
from jaxplan.scenario.kinds import Kind
from jaxplan.scenario.layout import SCENARIO
from jaxplan.scenario.paths import PATH, TargetList
from jaxplan.scenario.reference import unit_of
from jaxplan.scenario.tables import Either, Field, Rows, Table


@dataclass(slots=True)
class PythonPlace(Place):
    """A place in the tables of a scenario that was made in Python.

    Attributes:
        kind: what stands here, of which keys are looked up; None where there are none.
        unit: of the numbers here, as Python has them; empty for none.
    """

    kind: Kind | None = None
    unit: str = ""

    def key(self, name: str) -> Place:
        """The place of a key of this table, by the attribute that it is written from."""
        field = next((field for field in _fields(self.kind) if field.key == name), None)
        if field is None:
            return PythonPlace(self.faults, self.devices, (*self.steps, name), self.show)
        in_file = unit_of(field.key) or ""
        return PythonPlace(
            self.faults,
            self.devices,
            (*self.steps, *(field.held or field.attribute).split(".")),
            self.show,
            math.pi / 180 if "deg" in in_file else 1.0,
            kind=field.kind,
            unit=in_file.replace("deg", "rad"),
        )

    def item(self, index: int) -> Place:
        """The place of an entry of this array."""
        steps = (*self.steps, index)
        return PythonPlace(
            self.faults, self.devices, steps, self.show, self.factor, kind=self.kind, unit=self.unit
        )

    @property
    def name(self) -> str:
        """The path of attributes, or what has none."""
        return self.path or "the scenario"

    def refuse(self, complaint: str, value: object) -> None:
        """Note a wrong type or shape, of which no unit can be told."""
        PythonPlace(self.faults, self.devices, self.steps, self.show).fault(complaint, value)

    def spelled(self, kind: Kind, value: Any) -> Any:
        """A value of the model as Python has it, one number where a file would have one."""
        return value if isinstance(value, float) else kind.write(value)

    def told(self, value: object) -> str:
        """The value with its unit."""
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return f"{Place.told(self, value)} {self.unit if number else ''}".rstrip()


def python_root(devices: DeviceNames) -> PythonPlace:
    """The place of the scenario itself, with no faults yet."""
    return PythonPlace([], devices, show=show, kind=SCENARIO)


def _fields(kind: Kind | None) -> Iterable[Field]:
    """The fields of the table or tables that may stand here."""
    if isinstance(kind, Rows):
        kind = kind.table
    if isinstance(kind, Table):
        return kind.fields
    if isinstance(kind, Either):
        return [field for table in kind.tables.values() for field in table.fields]
    return PATH.fields if isinstance(kind, TargetList | Direction) else ()
