"""Tables of the model's dataclasses, and the named kinds of values that their fields declare.

Ranges that do not follow from nature are wider than any spacecraft needs, and narrow enough that nothing
computed from the numbers overflows.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from jaxplan.model.file_keys import Key
from jaxplan.schema.arrays import (
    PLANE_DIRECTION,
    Array,
    Numbers,
    PerAxis,
    Polygons,
    each_joint,
    range_of,
    rising,
    units,
    within_a_turn,
)
from jaxplan.schema.inertias import Moments
from jaxplan.schema.tables import Table, table
from jaxplan.schema.value_kinds import ByName, Epoch, FromZero, Interval, Kind, Name, Names, Number, Text

ANGLE = Number(Interval("[-1e3, 1e3]"))
"""rad, or rad/s: any number of turns that a file may mean."""
ANGLE_DEG = Number(Interval("[-5e4, 5e4]"), degrees=True)
"""The same in degrees."""


def _from_number(make: Callable[[Number], Kind]) -> Callable[[Key], Kind]:
    """Return a function that makes a kind of values from the description of a field in files, a `Key`.

    It hands `make` the kind of a single number that has the key's range and unit.
    """
    return lambda told: make(Number(Interval(told.range), degrees="_deg" in told.name))


KINDS: dict[Any, Any] = {
    "plane unit vector": PLANE_DIRECTION,
    "rotation vector": Array(
        (3,),
        ANGLE,
        noun="a rotation vector of 3 numbers",
        hint=", as scipy's Rotation has by as_rotvec()",
        rule=within_a_turn,
    ),
    "angular velocity": Array((3,), ANGLE, zero=True),
    "joints": each_joint(ANGLE),
    "joint rates": each_joint(ANGLE, zero=True),
    "per axis": _from_number(PerAxis),
    "range": _from_number(lambda each: Array((2,), each, noun="2 numbers, least and largest", rule=range_of)),
    "inertia": _from_number(Moments),
    "device": Name("device"),
    "terminal": Name("terminal"),
    "gimbal": Name("gimbal"),
    "devices": Names(),
    "two angles": _from_number(partial(Numbers, 2)),
    "polygons": _from_number(Polygons),
    "half angle": lambda told: FromZero(Interval(told.range), degrees=True),
    "factors": _from_number(lambda each: ByName(each, "gimbal")),
    "epoch": Epoch(),
    "activity name": Text(empty=True),
    "target name": Text(empty=True),
    "samples": Array(("sample", 3), noun="unit vectors of 3 numbers, one a time", rule=units),
    "slopes": Array(("sample", 3), noun="vectors of 3 numbers, one a time"),
    "sample times": _from_number(
        lambda each: Array(("sample",), each, noun="rising numbers, the first at most 0", rule=rising)
    ),
}
"""Kinds by name, as `jaxplan.model.file_keys.Key.kind` has it, or by the class that makes a table."""


def declared(model: type, **more: Any) -> Table:
    """Make the table of a class of the model, and add it to `KINDS`, so that other tables may contain it.

    Args:
        model: the dataclass.
        more: further arguments of `table`.
    """
    KINDS[model] = table(model, KINDS, **more)
    return KINDS[model]
