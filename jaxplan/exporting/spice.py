"""A SPICE C-kernel of type 3 with its frame and clock kernels: ``attitude.bc``, ``frames.tf``, ``clock.tsc``.

Where devices have rectangular fields of view, these are in an instrument kernel ``instruments.ti``; an
instrument has the number and the name of its frame.

The platform is the frame JAXPLAN_BUS on J2000, a terminal a frame on the bus, an instrument a fixed frame on
it; a device's boresight is its z axis. SPICE stores the C-matrix, which maps inertial to body: the inverse of
ours, hence the conjugate quaternion; angular velocities are those of the frame in the components of the
frame it is based on, in rad/s. Time is ephemeris time (TDB).

The spacecraft clock counts microseconds of TDB from 1950 on. It is the same in all exports, so that the
kernels of several manoeuvres can be loaded at once.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.exporting.sampled import Sampled, device_motion, instrument_frames, labels, plain, progress
from jaxplan.geometry import quaternion
from jaxplan.model.epochs import ephemeris_time
from jaxplan.model.outlines import UP
from jaxplan.model.spacecraft import Spacecraft

_CRAFT = -999  # number of the spacecraft, one of those that NAIF leaves to everybody
_BUS = -999000
_FIRST_TERMINAL, _FIRST_INSTRUMENT = -999001, -999501  # those that follow count downward
_BUS_NAME = "JAXPLAN_BUS"
_LONGEST_NAME = 26  # characters of a frame's name, since variables of at most 32 are called after it
_MARGIN = 1e-6  # s, by which a kernel is valid longer at both ends, as times near 2030 are rounded to 1e-7 s

_CLOCK = f"""KPL/SCLK

   Microseconds of barycentric dynamical time from 1950-01-01 12:00:00 on.

\\begindata
SCLK_KERNEL_ID             = ( @2000-01-01/12:00:00 )
SCLK_DATA_TYPE_{-_CRAFT}         = ( 1 )
SCLK01_TIME_SYSTEM_{-_CRAFT}     = ( 1 )
SCLK01_N_FIELDS_{-_CRAFT}        = ( 2 )
SCLK01_MODULI_{-_CRAFT}          = ( 4294967296 1000000 )
SCLK01_OFFSETS_{-_CRAFT}         = ( 0 0 )
SCLK01_OUTPUT_DELIM_{-_CRAFT}    = ( 1 )
SCLK_PARTITION_START_{-_CRAFT}   = ( 0 )
SCLK_PARTITION_END_{-_CRAFT}     = ( 4294967295999999 )
SCLK01_COEFFICIENTS_{-_CRAFT}    = ( 0 -1577880000 1 )
\\begintext
"""


@dataclass(frozen=True, kw_only=True)
class _Frame:
    """A frame of SPICE: its number, its name, and the name of what it is the frame of."""

    number: int
    name: str
    what: str  # it is the frame of


def write_spice(sampled: Sampled, folder: Path) -> None:
    """Write the kernels of attitude, frames and clock to a folder.

    Args:
        sampled: with a start.
        folder: an empty one.

    Raises:
        ValueError: if SPICE refuses, with its words.
    """
    from spiceypy.utils.exceptions import SpiceyError

    assert sampled.start is not None
    craft = sampled.spacecraft
    turning, instruments = _device_frames(craft)
    kernel = _frame_kernel(sampled, turning, instruments)
    (folder / "frames.tf").write_text(kernel, encoding="ascii")
    (folder / "clock.tsc").write_text(_CLOCK, encoding="ascii")
    fields = list(_fields(craft, turning, instruments))
    if fields:
        (folder / "instruments.ti").write_text(_instrument_kernel(sampled, fields), encoding="ascii")
    try:
        with _pool_holding(kernel + _CLOCK):
            _write_c_kernel(sampled, turning, folder / "attitude.bc")
    except SpiceyError as error:
        raise ValueError(f"SPICE cannot write the C-kernel: {error}") from error


def _device_frames(craft: Spacecraft) -> tuple[list[_Frame], list[_Frame]]:
    """Frames of the devices with joints, and those of the instruments, numbered and named."""
    prefix = "JAXPLAN_"
    plain_names = (name.replace("-", "_") for name in craft.device_names)
    names = labels(plain_names, taken=["bus"], longest=_LONGEST_NAME - len(prefix))
    count = craft.gimbals.count
    numbers = [_FIRST_TERMINAL - i for i in range(count)]
    numbers += [_FIRST_INSTRUMENT - i for i in range(len(craft.instruments))]
    frames = [
        _Frame(number=number, name=prefix + name.upper(), what=plain(device))
        for number, name, device in zip(numbers, names, craft.device_names, strict=True)
    ]
    return frames[:count], frames[count:]


def _frame_kernel(sampled: Sampled, turning: Sequence[_Frame], instruments: Sequence[_Frame]) -> str:
    """Text of the frame kernel: the platform, devices with joints (`turning`), and instruments."""
    lines = ["KPL/FK", "", f"   Frames of the spacecraft of: {plain(sampled.name)}", ""]
    lines += [f"   {_BUS_NAME:<26}  {_BUS}  the platform, based on J2000"]
    lines += [f"   {f.name:<26}  {f.number}  {f.what}, turning on the bus" for f in turning]
    lines += [f"   {f.name:<26}  {f.number}  {f.what}, fixed to the bus" for f in instruments]
    lines += ["", "   The boresight of a device is the z axis of its frame.", "", "\\begindata"]
    for frame in (_Frame(number=_BUS, name=_BUS_NAME, what=""), *turning):
        lines += _definition(frame, kind=3)
        lines += [f"CK_{frame.number}_SCLK = {_CRAFT}", f"CK_{frame.number}_SPK = {_CRAFT}"]
    matrices = instrument_frames(sampled.spacecraft.fixed_boresights)
    for frame, matrix in zip(instruments, matrices, strict=True):
        lines += _definition(frame, kind=4)
        lines += [
            f"TKFRAME_{frame.number}_RELATIVE = '{_BUS_NAME}'",
            f"TKFRAME_{frame.number}_SPEC = 'MATRIX'",
        ]
        columns = ["  " + " ".join(f"{value:.17g}" for value in axis) for axis in matrix.T]
        lines += [f"TKFRAME_{frame.number}_MATRIX = (", *columns, ")"]
    return "\n".join([*lines, "\\begintext", ""])


def _fields(
    craft: Spacecraft, turning: Sequence[_Frame], instruments: Sequence[_Frame]
) -> Iterator[tuple[_Frame, np.ndarray, np.ndarray]]:
    """Yield for each device with a field of view its frame, up (3,) in that, and the full angles (2,) rad.

    The first angle is across up, the second along it.
    """
    for frame, terminal in zip(turning, craft.terminals, strict=False):  # then come the drives
        if terminal.field_of_view is not None:
            forward, left, above = UP if terminal.up is None else terminal.up
            yield frame, np.array([-above, left, forward]), terminal.field_of_view
    matrices = instrument_frames(craft.fixed_boresights)
    for frame, instrument, matrix in zip(instruments, craft.instruments, matrices, strict=True):
        if instrument.field_of_view is not None and instrument.up is not None:
            yield frame, instrument.up @ matrix, instrument.field_of_view


def _instrument_kernel(sampled: Sampled, fields: Sequence[tuple[_Frame, np.ndarray, np.ndarray]]) -> str:
    """Text of the instrument kernel: fields of view, as `_fields` has them, as rectangles about up."""
    lines = [
        "KPL/IK",
        "",
        f"   Fields of view of the spacecraft of: {plain(sampled.name)}",
        "",
        "\\begindata",
    ]
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


def _definition(frame: _Frame, kind: int) -> list[str]:
    """Lines of a kernel that define a frame of a class of SPICE: 3 by a C-kernel, 4 by a fixed matrix."""
    variable = f"FRAME_{frame.number}"
    return [
        f"FRAME_{frame.name} = {frame.number}",
        f"{variable}_NAME = '{frame.name}'",
        f"{variable}_CLASS = {kind}",
        f"{variable}_CLASS_ID = {frame.number}",
        f"{variable}_CENTER = {_CRAFT}",
    ]


@contextmanager
def _pool_holding(kernel: str) -> Iterator[None]:
    """Load a text kernel into SPICE's pool of variables for a while, and restore the pool afterwards.

    Loading and unloading a file would throw away what the user has put into the pool by hand.
    """
    import spiceypy as spice

    lines = "".join(re.findall(r"(?<=\\begindata\n).*?(?=\\begintext)", kernel, re.DOTALL)).splitlines()
    names = [line.split()[0] for line in lines if " = " in line]
    before: dict[str, tuple[str, Any]] = {}
    for name in names:
        with spice.no_found_check():  # expool would find numbers only
            count, kind, found = spice.dtpool(name)
        if found:
            before[name] = (kind, (spice.gcpool if kind == "C" else spice.gdpool)(name, 0, count))
    try:
        spice.lmpool(lines)
        yield
    finally:
        for name in names:
            spice.dvpool(name)
        for name, (kind, values) in before.items():
            (spice.pcpool if kind == "C" else spice.pdpool)(name, values)


def _write_c_kernel(sampled: Sampled, turning: Sequence[_Frame], path: Path) -> None:
    """Write the C-kernel, a segment each for platform and devices with joints; their frames are loaded."""
    import spiceypy as spice

    assert sampled.start is not None
    ephemeris = ephemeris_time(sampled.start) + sampled.times
    ephemeris = np.concatenate([[ephemeris[0] - _MARGIN], ephemeris, [ephemeris[-1] + _MARGIN]])
    ticks = np.array([spice.sce2c(_CRAFT, moment) for moment in ephemeris])
    handle = spice.ckopn(str(path), "jaxplan", 0)
    try:
        for number, base, *motion in progress(_motions(sampled, turning), 1 + len(turning)):
            # The first and the last sample stand twice.
            inverse, rates = (np.pad(array, ((1, 1), (0, 0)), mode="edge") for array in motion)
            inverse, name = inverse * [1.0, -1.0, -1.0, -1.0], f"jaxplan {number} on {base}"
            span = ticks[0], ticks[-1]
            spice.ckw03(
                handle, *span, number, base, True, name, len(ticks), ticks, inverse, rates, 1, ticks[:1]
            )
    finally:
        spice.ckcls(handle)


def _motions(
    sampled: Sampled, turning: Sequence[_Frame]
) -> Iterator[tuple[int, str, np.ndarray, np.ndarray]]:
    """Yield each moving frame's number, its base, quaternions (k, 4) frame to base, and rates (k, 3) rad/s.

    Rates are the frame's angular velocity relative to the base, in the base's components.
    """
    yield _BUS, "J2000", sampled.quaternions, sampled.inertial(sampled.values.angular_velocity)
    for number, frame in enumerate(turning):
        matrices, rates = device_motion(sampled, number)
        yield frame.number, _BUS_NAME, quaternion.continuous(matrices), rates
