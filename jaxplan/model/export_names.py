"""Names and numbers that exported files give to a spacecraft and its frames, and the rules for them.

They are data of a mission, agreed with those who read the files, and do not change the motion. The rules are
those that all formats accept: messages of CCSDS have lines of ASCII, SPICE has frame names of at most 26
characters, since it calls variables of at most 32 after them, and numbers of 32 bits.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from jaxplan.runtime.arguments import show
from jaxplan.runtime.display import shown

REFERENCE_FRAMES = ("EME2000", "ICRF", "GCRF")
"""Names of the inertial frame, which is the scenario's however it is called: they are 1.2e-7 rad apart."""
LONGEST_TEXT = 80
"""Characters of a name in a message at most."""
LONGEST_FRAME = 26
"""Characters of the name of a frame at most."""
NAIF_IDS = (-2147482, -1)
"""Least and greatest number of a spacecraft: 1000 times it, less 999, is a number of 32 bits."""
_RESERVED_FRAMES = {"J2000", "B1950", "FK4", "GALACTIC", "ECLIPJ2000", "ECLIPB1950", "ITRF93", "EARTH_FIXED"}


@shown()
@dataclass(frozen=True, kw_only=True)
class ExportNames:
    """What exported files call the spacecraft, its frames and whoever wrote them.

        >>> names = jp.ExportNames(object_name="EO-1", object_id="2000-075A", naif_id=-2000)
        >>> jp.export(plan, "slew.aem", format="aem", epoch="2026-01-01T00:00:00", names=names)

    Attributes:
        object_name: OBJECT_NAME of messages, and SPICE's name of the body; None for the scenario's name.
        object_id: OBJECT_ID of messages, the international designator where there is one, ``"2000-075A"``.
        originator: ORIGINATOR of messages, who wrote them.
        frame_name: name of the body frame: at most 26 letters, digits and underscores, a letter first. None
            for ``SC_BODY_1`` in messages and ``JAXPLAN_BUS`` in kernels. In kernels the frames of devices are
            called after it: ``EO1_ANTENNA`` where it is ``EO1_BUS``, and also where it is ``EO1``.
        reference_frame: name of the inertial frame in messages and STK's files: ``"EME2000"`` (STK's
            ``J2000``), ``"ICRF"`` or ``"GCRF"``; SPICE calls it J2000 in any case.
        naif_id: SPICE's number of the spacecraft and of its clock, from -2147482 to -1. The body frame has
            1000 times this number; frames of devices with joints have that less 1, 2, ..., frames of
            instruments that less 501, 502, ...

    Raises:
        ValueError: for values that a file could not hold; the message lists all of them.
    """

    object_name: str | None = None
    object_id: str = "UNKNOWN"
    originator: str = "JAXPLAN"
    frame_name: str | None = None
    reference_frame: str = "EME2000"
    naif_id: int = -999

    def __post_init__(self) -> None:
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        faults = [f"{key} = {show(values[key])}: {words}" for key, words in name_faults(values).items()]
        if faults:
            raise ValueError("\n  ".join([f"{len(faults)} faults:", *faults] if len(faults) > 1 else faults))
        object.__setattr__(self, "naif_id", int(self.naif_id))


def name_faults(values: Mapping[str, Any]) -> dict[str, str]:
    """Check values of `ExportNames`.

    Args:
        values: values of any type by the names of the attributes. Those that are absent are not checked, and
            an attribute whose default is None may be None.

    Returns:
        For each wrong value, under its name, what it must be; empty if all are right.
    """
    checks = {
        "object_name": lambda value: None if value is None else _text_fault(value),
        "object_id": _text_fault,
        "originator": _text_fault,
        "frame_name": lambda value: None if value is None else _frame_fault(value),
        "reference_frame": _reference_fault,
        "naif_id": _number_fault,
    }
    found = {key: check(values[key]) for key, check in checks.items() if key in values}
    return {key: words for key, words in found.items() if words is not None}


def _text_fault(value: object) -> str | None:
    """Return what a text of a message must be; None if `value` is such a text."""
    printable = isinstance(value, str) and all(" " <= c <= "~" and c != "\\" for c in value)
    if printable and isinstance(value, str) and 0 < len(value) <= LONGEST_TEXT and value == value.strip():
        return None
    return (
        f"must be a text of 1 to {LONGEST_TEXT} printable ASCII characters, without backslashes and without "
        "blanks at its ends"
    )


def _frame_fault(value: object) -> str | None:
    """Return what the name of a frame must be; None if `value` is such a name."""
    if not isinstance(value, str) or not re.fullmatch(
        rf"[A-Za-z][A-Za-z0-9_]{{0,{LONGEST_FRAME - 1}}}", value
    ):
        return f"must be 1 to {LONGEST_FRAME} letters, digits and underscores, of which the first is a letter"
    upper = value.upper()
    if upper in _RESERVED_FRAMES or upper in REFERENCE_FRAMES or upper.startswith("IAU_"):
        return "must be none of the frames that SPICE or CCSDS know, since this one turns with the body"
    return None


def _reference_fault(value: object) -> str | None:
    """Return what the name of the inertial frame must be; None if `value` is such a name."""
    known = isinstance(value, str) and value in REFERENCE_FRAMES
    return None if known else f"must be one of {', '.join(REFERENCE_FRAMES)}"


def _number_fault(value: object) -> str | None:
    """Return what the number of a spacecraft must be; None if `value` is such a number."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if whole and NAIF_IDS[0] <= value <= NAIF_IDS[1]:  # type: ignore[operator]
        return None
    return (
        f"must be a whole number in [{NAIF_IDS[0]}, {NAIF_IDS[1]}], since SPICE numbers spacecraft below zero"
    )


def labels(names: Iterable[str], taken: Iterable[str], longest: int) -> list[str]:
    """Make short unique names of letters, digits, ``-`` and ``_``; case does not make names different.

    Args:
        names: any texts, such as names of devices.
        taken: names that must not result.
        longest: largest number of characters of a result, 10 or more.

    Returns:
        One label for each name: the name with all other characters replaced by ``_``, or such as ``device_3``
        where that is too long, blank or taken.
    """
    used = {name.lower() for name in taken}
    result = []
    for number, name in enumerate(names, start=1):
        label = re.sub(r"[^A-Za-z0-9_-]", "_", name)
        spare = (f"device_{k}" for k in range(number, 10**9))
        while not label.strip("_-") or len(label) > longest or label.lower() in used:
            label = next(spare)
        used.add(label.lower())
        result.append(label)
    return result
