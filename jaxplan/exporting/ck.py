"""Writer of a SPICE C-kernel of type 3 with its other kernels: ``attitude.bc``, ``frames.tf``, ``clock.tsc``.

Where devices have rectangular fields of view, these are in an instrument kernel ``instruments.ti``.

**The C-kernel.** SPICE stores C-matrices, which map inertial to body coordinates. That is the inverse of
attitudes here, so quaternions are conjugated. Angular velocities are those of a frame relative to its base
frame, in components of the base, in rad/s. Times are ephemeris time (TDB). A flight is in one file without
gaps: each frame has one SPICE segment for each block of rows, and the last row of a block is the first of the
next, so that the attitude is interpolated at every instant.

**The text kernels** tell of frames, of the clock, and of fields of view. The platform is a frame based on
J2000, a device with joints a frame based on the platform, and an instrument a frame fixed to the platform.
The boresight of each is its z axis. Numbers follow SPICE's convention: a spacecraft -999 has the frame
-999000, and what it carries has numbers below that. The spacecraft clock counts microseconds of TDB from 1950
on. It is the same in all exports, so that the kernels of several manoeuvres can be loaded at once.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.exporting.messages import plain
from jaxplan.exporting.sampled import Sampled, Sampling, device_frames, device_rates, instrument_frames
from jaxplan.geometry import quaternion
from jaxplan.model.epochs import ephemeris_time, utc_texts
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
_TIME_MARGIN = 1e-6  # s, by which a kernel extends beyond both ends, as times near 2030 are rounded to 1e-7 s


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


def write_spice(sampling: Sampling, folder: Path) -> None:
    """Write the kernels of attitude, frames, clock and perhaps fields of view to a folder.

    Args:
        sampling: the motion's sampling, with a start.
        folder: an empty one.

    Raises:
        ValueError: if SPICE refuses, with its message; if there are too many devices.
    """
    from spiceypy.utils.exceptions import SpiceyError

    craft, title = sampling.spacecraft, sampling.flight.name
    frames = frames_of(craft, sampling.names)
    kernel, clock = frame_kernel(frames, craft, title), clock_kernel(frames)
    (folder / "frames.tf").write_text(kernel, encoding="ascii")
    (folder / "clock.tsc").write_text(clock, encoding="ascii")
    fields = instrument_kernel(frames, craft, title)
    if fields is not None:
        (folder / "instruments.ti").write_text(fields, encoding="ascii")
    try:
        with _loaded_in_pool(kernel + clock):
            _write_c_kernel(sampling, frames, folder / "attitude.bc")
    except SpiceyError as error:
        raise ValueError(f"SPICE cannot write the C-kernel: {error}") from error


@contextmanager
def _loaded_in_pool(kernel: str) -> Iterator[None]:
    """Load a text kernel into SPICE's pool of variables within a with block, and restore the pool afterwards.

    Loading and unloading a file would lose what the user has put into the pool by hand.
    """
    import spiceypy as spice

    lines = "".join(re.findall(r"(?<=\\begindata\n).*?(?=\\begintext)", kernel, re.DOTALL)).splitlines()
    names = [line.split()[0] for line in lines if " = " in line or " += " in line]
    before: dict[str, tuple[str, Any]] = {}
    for name in names:
        with spice.no_found_check():  # expool would find numeric variables only
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


def _write_c_kernel(sampling: Sampling, frames: Frames, path: Path) -> None:
    """Write the C-kernel of platform and devices with joints; SPICE must know their frames and clock."""
    import spiceypy as spice

    assert sampling.start is not None
    last, comments = len(sampling.times) - 1, list(_comment_lines(sampling))
    handle = spice.ckopn(str(path), "jaxplan", sum(len(line) + 1 for line in comments))
    try:
        if comments:
            spice.dafac(handle, comments)
        for block in sampling.blocks(sampling.overlapping()):
            ends = block.first == 0, block.first + len(block.times) - 1 == last
            moments = _repeat_ends(ephemeris_time(sampling.start, block.times), ends)
            moments[0] -= _TIME_MARGIN * ends[0]
            moments[-1] += _TIME_MARGIN * ends[1]
            clock = ticks(moments)
            for number, base, matrices, rates in _frame_motions(block, frames):
                inverse = quaternion.continuous(matrices) * [1.0, -1.0, -1.0, -1.0]
                spice.ckw03(
                    handle,
                    clock[0],
                    clock[-1],
                    number,
                    base,
                    True,
                    f"jaxplan {number} on {base}"[:40],
                    len(clock),
                    clock,
                    _repeat_ends(inverse, ends),
                    _repeat_ends(rates, ends),
                    1,
                    clock[:1],
                )
    finally:
        spice.ckcls(handle)


def _repeat_ends(rows: np.ndarray, ends: tuple[bool, bool]) -> np.ndarray:
    """Return the rows (k, ...) with the first or last one doubled where `ends` (first, last) is True."""
    return np.pad(rows, ((int(ends[0]), int(ends[1])), *[(0, 0)] * (rows.ndim - 1)), mode="edge")


def _frame_motions(block: Sampled, frames: Frames) -> Iterator[tuple[int, str, np.ndarray, np.ndarray]]:
    """Yield each moving frame's number, its base, matrices (k, 3, 3) frame to base, and rates (k, 3) rad/s.

    Rates are the frame's angular velocity relative to the base, in components of the base.
    """
    values = block.values
    yield frames.bus.number, "J2000", values.attitude, block.inertial(values.angular_velocity)
    for number, frame in enumerate(frames.turning):
        matrices = device_frames(block.spacecraft, values.joints, number)
        yield frame.number, frames.bus.name, matrices, device_rates(block, number)


def _comment_lines(sampling: Sampling) -> Iterator[str]:
    """Yield lines for the comment area: the scenario's name and a day's segments; none for a plan."""
    segments = sampling.flight.segments
    if not segments or sampling.start is None:
        return
    yield f"Attitude of the spacecraft of: {plain(sampling.flight.name)}"
    yield ""
    yield f"{'from (UTC)':<29}  {'to (UTC)':<29}  what"
    begins = utc_texts(sampling.start, np.array([each.start for each in segments]))
    ends = utc_texts(sampling.start, np.array([each.end for each in segments]))
    for begin, end, each in zip(begins, ends, segments, strict=True):
        yield f"{begin}  {end}  {plain(each.kind)}: {plain(each.name)}"


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
