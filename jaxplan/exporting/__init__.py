"""Plans and days as files of other tools, reached as ``jp.export``.

    >>> jp.export(plan, "slew.aem", format="aem", epoch="2026-01-01T00:00:00")

Most formats hold the same samples of the motion, in steps of time: the attitude as quaternions whose sign
does not jump, the angular velocity, and the joints where the format has room for them. What they differ in,
such as the order of a quaternion's components or the axes of a rate, is described with the writer of each.
The inertial frame is the scenario's; files that must name one call it J2000 or EME2000 unless `ExportNames`
says otherwise.
"""

from jaxplan.exporting.flight import Day, DaySegment, UncertifiedError, ending
from jaxplan.exporting.formats import FORMATS, default_path, export, needed_by
from jaxplan.exporting.table_proof import SPARSEST

__all__ = [
    "FORMATS",
    "SPARSEST",
    "Day",
    "DaySegment",
    "UncertifiedError",
    "default_path",
    "ending",
    "export",
    "needed_by",
]
