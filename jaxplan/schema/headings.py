"""The table ``[timeline]`` of a file: when a timeline ends, how it slews, and names for exported files."""

from dataclasses import dataclass, fields, replace
from typing import Any

from jaxplan.model.activities import LOOK_AHEAD, SHORTEST, SLEWS
from jaxplan.model.export_names import REFERENCE_FRAMES, ExportNames, name_faults
from jaxplan.model.file_keys import keyed
from jaxplan.schema.faults import WRONG, Place
from jaxplan.schema.model_tables import KINDS
from jaxplan.schema.tables import Field, table
from jaxplan.schema.value_kinds import Epoch, Kind


@dataclass(frozen=True, kw_only=True)
class Heading:
    """The contents of ``[timeline]``: when it ends, how it slews, and names for exported files."""

    until: float | None = keyed(None, "until_s", "when it ends; required if anything moves", "[0, 86400]")
    slew: str = keyed(
        SHORTEST, "slew", "whether slews take the shortest time, or all that there is", options=SLEWS
    )
    look_ahead: bool = keyed(False, "look_ahead", LOOK_AHEAD)
    object_name: str | None = keyed(
        None, "object_name", "of the spacecraft in exported files; the timeline's name if absent"
    )
    object_id: str | None = keyed(None, "object_id", 'international designator, such as "2000-075A"')
    originator: str | None = keyed(None, "originator", "who makes the exported files")
    frame_name: str | None = keyed(None, "frame_name", "of the body's frame in exported files")
    reference_frame: str | None = keyed(
        None, "reference_frame", "of the inertial frame in exported files", options=REFERENCE_FRAMES
    )
    naif_id: int | None = keyed(None, "naif_id", "SPICE's number of the spacecraft", "[-2147482, -1]")

    @property
    def given(self) -> dict[str, Any]:
        """The names for exports that are given, by attribute of `ExportNames`."""
        values = {part.name: getattr(self, part.name) for part in fields(ExportNames)}
        return {name: value for name, value in values.items() if value is not None}


def _make_heading(parts: dict[str, Any], place: Place) -> Heading:
    """Make the heading from what was read, by attribute; its end may still be in UTC, as datetime64."""
    utc = parts.pop("until_utc", None)
    return Heading(**parts | ({} if utc is None else {"until": utc}))


def _check_heading(heading: Heading, place: Place) -> None:
    """Note a fault for each name that exported files cannot have."""
    given = {name: value for name, value in heading.given.items() if value is not WRONG}
    for name, complaint in name_faults(given).items():
        place[name].fault(complaint, given[name])


class Names(Kind):
    """What exported files call the spacecraft, as an object of Python.

    `ExportNames` checks its values itself.
    """

    wanted = "ExportNames"

    def read(self, value: Any, place: Place) -> Any:
        wrong = not isinstance(value, ExportNames)
        return place.refuse(f"must be {self.wanted}", value) if wrong else value


KINDS[ExportNames] = Names()
_DECLARED_HEADING = table(Heading, KINDS)
HEADING = replace(
    _DECLARED_HEADING,
    fields=(
        _DECLARED_HEADING.fields[0],
        Field("until_utc", Epoch(), "until_utc", "until_s as UTC", instead_of="until"),
        *_DECLARED_HEADING.fields[1:],
    ),
    make=_make_heading,
    check=_check_heading,
)
