"""The layout of a scenario file: its tables, derived from what the model's fields declare about their keys.

Key, range and meaning of an attribute are declared with the attribute. This module has what no single field
can declare, and what files hold in another form than the model does, for zones and for the whole file. For
directions that is in `directions`, for start and goal in `states`; kinds of values that have a name are in
`model_tables`.
"""

from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any

from jaxplan.model.devices import Drive, Instrument, Mount, Terminal
from jaxplan.model.goals import GivenState
from jaxplan.model.outlines import FORWARD
from jaxplan.model.robust import Robust
from jaxplan.model.scenario import Scenario, SearchSettings, TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import Wheel
from jaxplan.model.zones import FixedVector, JointBound, KeepIn, KeepOut
from jaxplan.schema.checks import check_drive, check_mount, check_spacecraft, check_terminal, check_wheel
from jaxplan.schema.directions import PATH, path_of
from jaxplan.schema.faults import WRONG, Place
from jaxplan.schema.model_tables import declared
from jaxplan.schema.sky import SKY, Followed
from jaxplan.schema.states import StateOf
from jaxplan.schema.tables import Field
from jaxplan.schema.value_kinds import Choice, Interval, Number, Text, YesNo, shortest_degrees
from jaxplan.schema.zone_checks import check_field
from jaxplan.sky import BODIES

SCHEMA_VERSION = 1


def _check_terminal(terminal: Terminal, place: Place) -> None:
    """Note faults of a terminal: attributes that do not go together, those of its field of view included."""
    check_terminal(terminal, place)
    check_field(terminal, place, FORWARD)


MOUNT = declared(Mount, check=check_mount, exact=attrgetter("squared"))
TERMINAL = declared(Terminal, check=_check_terminal)
DRIVE = declared(Drive, check=check_drive)
INSTRUMENT = declared(Instrument, check=check_field)
WHEEL = declared(Wheel, check=check_wheel)
SPACECRAFT = declared(Spacecraft, check=check_spacecraft)
VECTOR = declared(FixedVector)
ROBUST = declared(Robust)
SEARCH = declared(SearchSettings)
TRAJECTORY = declared(TrajectorySettings)


def _make_zone(model: type, parts: dict[str, Any], place: Place) -> Any:
    """Make a zone from what was read of it, noting keys that do not go together.

    Its axis may be given by samples at times. If it is given by a name of ``[sky]``, a `Followed` stands for
    the direction until `resolve` replaces it.

    Args:
        model: the class, `KeepOut` or `KeepIn`.
        parts: values by attribute; changed in place.
        place: place of the zone.
    """
    samples, times = parts.pop("samples", None), parts.pop("times", None)
    if samples is not None:
        if times is None:
            times = place["times_s"].fault(f"missing, must be {_TIMES_FIELD.kind.wanted}")
        parts["direction"] = path_of({"samples": samples, "times": times}, place)
    elif times is not None:
        place["times_s"].fault("needs direction_samples, whose times they are")
        place.reading.sizes.pop("sample", None)
    body, moving = parts.pop("body", None), parts.pop("moving", None)
    exclusion, satellite = parts.pop("exclusion", None), parts.pop("satellite", None)
    if body is None and exclusion not in (None, WRONG):
        complaint = "needs a body, from whose limb it counts"
        place["exclusion_deg"].fault(complaint, shortest_degrees(exclusion))
    if body is None and moving not in (None, WRONG):
        place["moving"].fault("needs a body, which the axis follows or not", moving)
    if exclusion is not None:
        parts["half_angle"] = exclusion
    if body is not None or satellite is not None:
        name, key = (satellite, "satellite") if body is None else (body, "body")
        found = Followed(name, key, from_limb=exclusion is not None, moving=bool(moving))
        parts["direction"] = WRONG if name is WRONG else found
    return model(**parts)


def _split_zone(zone: Any) -> dict[str, Any]:
    """Return the values of a zone's keys in a file, by attribute; a moving axis as its samples and times."""
    if not zone.moves:
        return vars(zone)
    return vars(zone) | {"direction": None, "samples": zone.direction.samples, "times": zone.direction.times}


_SAMPLES_FIELD, _TIMES_FIELD = (
    replace(entry, required=False, held=f"direction.{entry.attribute}") for entry in PATH.fields[:2]
)
_MOVING_AXIS_FIELDS = (
    Field(
        "satellite",
        Text(),
        "satellite",
        "the axis follows it; a satellite or ground point of [sky]",
        instead_of="direction",
    ),
    replace(_SAMPLES_FIELD, instead_of="direction"),
    _TIMES_FIELD,
)
_BODY_FIELDS = (
    Field("body", Choice(BODIES), "body", "the axis points to it, as [sky] has it", instead_of="direction"),
    Field(
        "exclusion_deg",
        Number(Interval("[0, 180)"), degrees=True),
        "exclusion",
        "from the body's limb to the edge",
        instead_of="half_angle",
    ),
    Field(
        "moving",
        YesNo(),
        "moving",
        "whether the axis follows the body; if false or absent, a wider zone stands still for as long",
    ),
)
KEEP_OUT, KEEP_IN = (
    declared(model, before={"devices": further}, make=partial(_make_zone, model), split=_split_zone)
    for model, further in ((KeepOut, (*_BODY_FIELDS, *_MOVING_AXIS_FIELDS)), (KeepIn, _MOVING_AXIS_FIELDS))
)
JOINT_BOUND = declared(JointBound)


def _make_scenario(parts: dict[str, Any], place: Place) -> tuple[Scenario, Any]:
    """Make the scenario from what was read, by attribute.

    Returns:
        The scenario, and the `View` of ``[sky]``; None for the latter if the file has no ``[sky]``.
    """
    del parts["schema_version"]
    view = parts.pop("sky", None)
    return Scenario(**parts), view


def split_scenario(scenario: Scenario) -> dict[str, Any]:
    """Return the values of a scenario's keys in a file, by attribute."""
    terminals = len(scenario.spacecraft.terminals)
    ends = {
        name: StateOf(end, terminals) if isinstance(end, GivenState) else end
        for name, end in (("start", scenario.start), ("goal", scenario.goal))
    }
    return {"schema_version": SCHEMA_VERSION, **vars(scenario), **ends}


SCENARIO = declared(
    Scenario,
    before={
        "name": (
            Field(
                "schema_version", Choice((SCHEMA_VERSION,)), "schema_version", "of this layout", required=True
            ),
        ),
        "keep_out": (
            Field(
                "sky", SKY, "sky", "whence and when bodies and satellites are seen; resolved, never written"
            ),
        ),
    },
    make=_make_scenario,
    split=split_scenario,
    refused=dict.fromkeys(
        ("kind", "timeline", "activity", "direction"),
        'is of a timeline, which has kind = "timeline", and which load_timeline and jaxplan timeline read',
    ),
)
