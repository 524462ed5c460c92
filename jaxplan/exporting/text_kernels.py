"""SPICE text kernels that go with a C-kernel: of frames, of the clock, and of fields of view.

The platform is a frame based on J2000, a device with joints a frame based on the platform, and an instrument
a frame fixed to the platform. The boresight of each is its z axis. Numbers follow SPICE's convention: a
spacecraft -999 has the frame -999000, and what it carries has numbers below that.

The spacecraft clock counts microseconds of TDB from 1950 on. It is the same in all exports, so that the
kernels of several manoeuvres can be loaded at once.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jaxplan.exporting.sampled import instrument_frames
from jaxplan.exporting.text_lines import plain
from jaxplan.model.export_names import LONGEST_FRAME, ExportNames, labels
from jaxplan.model.outlines import UP
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.tables.devices import FIRST_TURNING

MOST_DEVICES = 499
"""Most devices with joints, and most instruments, for which there are numbers."""
_FIRST_INSTRUMENT = 501  # how far the first instrument's number is below that of the bus, the platform
_DEFAULT_BUS_NAME = "JAXPLAN_BUS"  # the platform's frame where the user gives no name
_LONGEST_STEM = 15  # characters of the prefix of devices' frame names, before an underscore
_LONGEST_BODY = 36  # characters of a body's name
_SECONDS_BEFORE_J2000 = 1577880000  # s, from the clock's zero to J2000
_TICKS_PER_SECOND = 1_000_000  # of the clock in a second


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A frame of SPICE: its number, its name, and what it is the frame of, in words."""

    number: int
    name: str
    what: str


@dataclass(frozen=True, kw_only=True)
class Frames:
    """The frames of a spacecraft.

    Attributes:
        craft: SPICE's number of the spacecraft and of its clock.
        body: name of the spacecraft in SPICE; None for no name.
        bus: the platform's, based on J2000.
        turning: those of devices with joints, based on the platform.
        instruments: those of instruments, fixed to the platform.
    """

    craft: int
    body: str | None
    bus: Frame
    turning: tuple[Frame, ...]
    instruments: tuple[Frame, ...]


def frames_of(craft: Spacecraft, names: ExportNames) -> Frames:
    """Return the numbered and named frames of a spacecraft.

    Raises:
        ValueError: if it has more devices than there are numbers.
    """
    bus = Frame(
        number=1000 * names.naif_id, name=(names.frame_name or _DEFAULT_BUS_NAME).upper(), what="the platform"
    )
    stem = re.sub(r"_(BUS|BODY|SC)$", "", bus.name)[:_LONGEST_STEM] + "_"
    count, fixed = craft.gimbals.count, len(craft.instruments)
    if max(count, fixed) > MOST_DEVICES:
        raise ValueError(
            f"the spacecraft has {count} devices with joints and {fixed} instruments: format ck has numbers "
            f"for {MOST_DEVICES} of each"
        )
    spelled = (name.replace("-", "_") for name in craft.device_names)
    own = labels(spelled, taken=[bus.name.removeprefix(stem)], longest=LONGEST_FRAME - len(stem))
    below = [*range(FIRST_TURNING, FIRST_TURNING + count)]
    below += range(_FIRST_INSTRUMENT, _FIRST_INSTRUMENT + fixed)
    devices = tuple(
        Frame(number=bus.number - away, name=stem + name.upper(), what=plain(device))
        for away, name, device in zip(below, own, craft.device_names, strict=True)
    )
    body = names.object_name if names.object_name and len(names.object_name) <= _LONGEST_BODY else None
    return Frames(
        craft=names.naif_id, body=body, bus=bus, turning=devices[:count], instruments=devices[count:]
    )


def ticks(ephemeris: np.ndarray) -> np.ndarray:
    """Return clock ticks (k,), with fractions, at times (k,) s of TDB from J2000."""
    return np.asarray((ephemeris + _SECONDS_BEFORE_J2000) * _TICKS_PER_SECOND)


def clock_kernel(frames: Frames) -> str:
    """Return the text of the clock kernel."""
    number = -frames.craft
    return f"""KPL/SCLK

   Microseconds of barycentric dynamical time from 1950-01-01 12:00:00 on.

\\begindata
SCLK_KERNEL_ID             = ( @2000-01-01/12:00:00 )
SCLK_DATA_TYPE_{number}         = ( 1 )
SCLK01_TIME_SYSTEM_{number}     = ( 1 )
SCLK01_N_FIELDS_{number}        = ( 2 )
SCLK01_MODULI_{number}          = ( 4294967296 {_TICKS_PER_SECOND} )
SCLK01_OFFSETS_{number}         = ( 0 0 )
SCLK01_OUTPUT_DELIM_{number}    = ( 1 )
SCLK_PARTITION_START_{number}   = ( 0 )
SCLK_PARTITION_END_{number}     = ( 4294967295999999 )
SCLK01_COEFFICIENTS_{number}    = ( 0 -{_SECONDS_BEFORE_J2000} 1 )
\\begintext
"""


def frame_kernel(frames: Frames, craft: Spacecraft, title: str) -> str:
    """Return the text of the frame kernel: the platform, devices with joints, and instruments."""
    bus = frames.bus
    lines = ["KPL/FK", "", f"   Frames of the spacecraft of: {plain(title)}", ""]
    lines += [f"   {bus.name:<26}  {bus.number}  the platform, based on J2000"]
    lines += [f"   {f.name:<26}  {f.number}  {f.what}, turning on the bus" for f in frames.turning]
    lines += [f"   {f.name:<26}  {f.number}  {f.what}, fixed to the bus" for f in frames.instruments]
    lines += ["", "   The boresight of a device is the z axis of its frame.", "", "\\begindata"]
    if frames.body is not None:
        quoted = frames.body.replace("'", "''")
        lines += [f"NAIF_BODY_NAME += ( '{quoted}' )", f"NAIF_BODY_CODE += ( {frames.craft} )"]
    for frame in (bus, *frames.turning):
        lines += _frame_definition(frame, kind=3, center=frames.craft)
        lines += [f"CK_{frame.number}_SCLK = {frames.craft}", f"CK_{frame.number}_SPK = {frames.craft}"]
    matrices = instrument_frames(craft.fixed_boresights)
    for frame, matrix in zip(frames.instruments, matrices, strict=True):
        lines += _frame_definition(frame, kind=4, center=frames.craft)
        lines += [
            f"TKFRAME_{frame.number}_RELATIVE = '{bus.name}'",
            f"TKFRAME_{frame.number}_SPEC = 'MATRIX'",
        ]
        columns = ["  " + " ".join(f"{value:.17g}" for value in axis) for axis in matrix.T]
        lines += [f"TKFRAME_{frame.number}_MATRIX = (", *columns, ")"]
    return "\n".join([*lines, "\\begintext", ""])


def instrument_kernel(frames: Frames, craft: Spacecraft, title: str) -> str | None:
    """Return the text of the instrument kernel, with rectangular fields of view; None where there are none.

    In SPICE, a device with a field of view is an instrument with the number and the name of its frame.
    """
    fields = list(_fields_of_view(frames, craft))
    if not fields:
        return None
    lines = ["KPL/IK", "", f"   Fields of view of the spacecraft of: {plain(title)}", "", "\\begindata"]
    for frame, up, angles in fields:
        variable = f"INS{frame.number}"
        across, along = (f"{angle / 2:.17g}" for angle in angles)
        lines += [
            f"NAIF_BODY_NAME += ( '{frame.name}' )",
            f"NAIF_BODY_CODE += ( {frame.number} )",
            f"{variable}_FOV_FRAME = '{frame.name}'",
            f"{variable}_FOV_SHAPE = 'RECTANGLE'",
            f"{variable}_FOV_CLASS_SPEC = 'ANGLES'",
            f"{variable}_FOV_ANGLE_UNITS = 'RADIANS'",
            f"{variable}_BORESIGHT = ( 0 0 1 )",
            f"{variable}_FOV_REF_VECTOR = ( {' '.join(f'{part:.17g}' for part in up)} )",
            f"{variable}_FOV_REF_ANGLE = ( {along} )",
            f"{variable}_FOV_CROSS_ANGLE = ( {across} )",
        ]
    return "\n".join([*lines, "\\begintext", ""])


def _fields_of_view(frames: Frames, craft: Spacecraft) -> Iterator[tuple[Frame, np.ndarray, np.ndarray]]:
    """Yield each device's frame, its field's up direction (3,) in that frame, and its full angles (2,) rad.

    The first angle is across up, the second along it. Devices without a field of view are left out.
    """
    for frame, terminal in zip(frames.turning, craft.terminals, strict=False):  # then come the drives
        if terminal.field_of_view is not None:
            forward, left, above = UP if terminal.up is None else terminal.up
            yield frame, np.array([-above, left, forward]), terminal.field_of_view
    matrices = instrument_frames(craft.fixed_boresights)
    for frame, instrument, matrix in zip(frames.instruments, craft.instruments, matrices, strict=True):
        if instrument.field_of_view is not None and instrument.up is not None:
            yield frame, instrument.up @ matrix, instrument.field_of_view


def _frame_definition(frame: Frame, *, kind: int, center: int) -> list[str]:
    """Return the lines that define a frame of SPICE's class `kind`: 3 by a C-kernel, 4 by a fixed matrix."""
    variable = f"FRAME_{frame.number}"
    return [
        f"FRAME_{frame.name} = {frame.number}",
        f"{variable}_NAME = '{frame.name}'",
        f"{variable}_CLASS = {kind}",
        f"{variable}_CLASS_ID = {frame.number}",
        f"{variable}_CENTER = {center}",
    ]
