"""How faults of a scenario that was made in Python are told: by its attributes, with numbers in its units.

Its numbers are checked as those of a file, in the tables that would be written. What a file calls
``keep_out[0].half_angle_deg = 401`` is then ``keep_out[0].half_angle = 7.0 rad``, and must lie in a range of
radians. Names and units follow from the layout.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from jaxplan.given import show
from jaxplan.scenario.faults import DeviceNames, Place
from jaxplan.scenario.kinds import Kind
from jaxplan.scenario.layout import SCENARIO
from jaxplan.scenario.paths import PATH, TargetList
from jaxplan.scenario.reference import unit_of
from jaxplan.scenario.tables import Either, Field, Rows, Table

_DIGITS = 12  # of a number that went to degrees and back


@dataclass(slots=True)
class PythonPlace(Place):
    """A place in the tables of a scenario that was made in Python.

    Attributes:
        kind: what stands here, of which keys are looked up; None where there are none.
        unit: of the numbers here, as Python has them; empty for none.
        first: index of the first entry here in the array that Python has.
    """

    kind: Kind | None = None
    unit: str = ""
    first: int = 0

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
            first=field.half * len(self.devices.terminals or ()),
        )

    def item(self, index: int) -> Place:
        """The place of an entry of this array."""
        steps = (*self.steps, self.first + index)
        return PythonPlace(
            self.faults, self.devices, steps, self.show, self.factor, kind=self.kind, unit=self.unit
        )

    @property
    def name(self) -> str:
        """The path of attributes, or what has none."""
        return self.path or "the scenario"

    def told(self, value: object) -> str:
        """The value in Python's unit, which is told with it."""
        if isinstance(value, list):
            return f"{Place.told(self, value)} {self.unit}".rstrip()
        if isinstance(value, bool) or not isinstance(value, int | float):
            return Place.told(self, value)
        number = value if self.factor == 1 else float(f"{value * self.factor:.{_DIGITS}g}")
        return f"{Place.told(self, number)} {self.unit}".rstrip()


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
    return PATH.fields if isinstance(kind, TargetList) else ()
