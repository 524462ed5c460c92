"""Writers of two formats that are text: CCSDS Attitude Ephemeris Messages (AEM), and the files of STK.

An AEM 2.0 (504.0-B-2) is written as keywords, with a segment for each activity. For STK there are an attitude
file of the platform, sensor files of devices with joints, and an interval list. Other formats share
`table_lines` and `plain`.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TextIO

import numpy as np

from jaxplan.exporting.flight import Segment
from jaxplan.exporting.sampled import Sampling, continued, device_frames
from jaxplan.model.epochs import utc_texts
from jaxplan.tables.devices import sensor_files

_NUMBER_FORMAT = "% .15e"  # 16 digits, as many as CCSDS allows and a double has
_DEFAULT_BODY_FRAME = "SC_BODY_1"  # name of the body's frame where the user gives none
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_AXES_BY_FRAME = {"EME2000": "J2000", "ICRF": "ICRF", "GCRF": "ICRF"}  # STK's names of the inertial frames


def table_lines(columns: Sequence[np.ndarray], separator: str = " ") -> Iterator[str]:
    """Yield the lines of a table of numbers as text, each with its line end.

    Args:
        columns: arrays (k,) or (k, c), side by side.
        separator: text between two numbers.
    """
    table = np.column_stack(columns)
    form = separator.join([_NUMBER_FORMAT] * table.shape[1]) + "\n"
    for first in range(0, len(table), 4096):  # a list of all would take several times the array's space
        for row in table[first : first + 4096].tolist():
            yield form % tuple(row)


def plain(text: str, longest: int = 80) -> str:
    """Return a text cut to `longest` characters, with ``?`` for backslashes and all but printable ASCII.

    Backslashes have a meaning in SPICE's kernels. A blank text becomes ``?``.
    """
    return "".join(c if " " <= c <= "~" and c != "\\" else "?" for c in text)[:longest].strip() or "?"


@dataclass(frozen=True)
class _Stretch:
    """Rows of one segment of a message, from `first` to `last`, and the segments of the day in them."""

    first: int
    last: int
    segments: tuple[Segment, ...]


def write_aem(sampling: Sampling, path: Path) -> None:
    """Write an Attitude Ephemeris Message.

    Frame A is the inertial one, and frame B the body. Quaternions turn A into B as the message defines it,
    which means body to inertial as everywhere here, but the scalar is last. Angular velocities are in deg/s
    in body axes, times are UTC. The instant at which one activity ends and the next begins is in the segments
    of both. Activities that take no time are mentioned in a comment of the segment beside.

    Args:
        sampling: the motion's sampling, with a start.
        path: the file. From one writing to the next only the line of CREATION_DATE differs.
    """
    assert sampling.start is not None
    stretches = _split_into_stretches(sampling)
    fresh = iter(stretches)
    with path.open("w", encoding="ascii") as file:
        file.write("CCSDS_AEM_VERS = 2.0\n")
        if sampling.tolerance is not None:
            degrees = np.rad2deg(sampling.tolerance)
            file.write(f"COMMENT attitudes between epochs are linear to within {degrees:.3g} deg\n")
        file.write(f"CREATION_DATE = {datetime.now(UTC):%Y-%m-%dT%H:%M:%S}\n")
        file.write(f"ORIGINATOR = {sampling.names.originator}\n")
        for block in sampling.blocks([stretch.first for stretch in stretches]):
            if block.opens:
                if block.first:
                    file.write("DATA_STOP\n")
                file.writelines(_metadata_lines(sampling, next(fresh)))
            stamps = utc_texts(sampling.start, block.times)
            rates = np.rad2deg(block.values.angular_velocity)
            numbers = table_lines([np.roll(block.quaternions, -1, axis=1), rates])
            file.writelines(f"{stamp} {row}" for stamp, row in zip(stamps, numbers, strict=True))
        file.write("DATA_STOP\n")


def _split_into_stretches(sampling: Sampling) -> list[_Stretch]:
    """Return the message's segments, which meet in a row; segments of the day without rows join the next."""
    last = len(sampling.times) - 1
    found: list[_Stretch] = []
    waiting: tuple[Segment, ...] = ()
    begin = 0
    for segment in sampling.flight.segments:
        end, waiting = sampling.row(segment.end), (*waiting, segment)
        if end > begin:
            found.append(_Stretch(begin, end, waiting))
            begin, waiting = end, ()
    if not found:
        return [_Stretch(0, last, waiting)]
    if waiting:  # nothing comes after them that they could join
        found[-1] = _Stretch(found[-1].first, last, (*found[-1].segments, *waiting))
    return found


def _metadata_lines(sampling: Sampling, stretch: _Stretch) -> Iterator[str]:
    """Yield the lines before the rows of a message's segment, from META_START to DATA_START."""
    assert sampling.start is not None
    names = sampling.names
    body = names.frame_name or _DEFAULT_BODY_FRAME
    begin, end = utc_texts(sampling.start, sampling.times[[stretch.first, stretch.last]])
    yield "META_START\n"
    for segment in stretch.segments:
        moment = "" if segment.end > segment.start else f", at {_utc_text(sampling, segment.start)}"
        yield f"COMMENT {plain(segment.kind)}: {plain(segment.name)}{moment}\n"
    pairs = {
        "OBJECT_NAME": names.object_name or plain(sampling.flight.name),
        "OBJECT_ID": names.object_id,
        "REF_FRAME_A": names.reference_frame,
        "REF_FRAME_B": body,
        "TIME_SYSTEM": "UTC",
        "START_TIME": begin,
        "STOP_TIME": end,
        "ATTITUDE_TYPE": "QUATERNION/ANGVEL",
        "ANGVEL_FRAME": body,
    }
    if sampling.tolerance is not None:  # the instants are chosen for linear interpolation
        pairs |= {"INTERPOLATION_METHOD": "LINEAR", "INTERPOLATION_DEGREE": "1"}
    yield from (f"{key} = {value}\n" for key, value in pairs.items())
    yield "META_STOP\n"
    yield "DATA_START\n"


def _utc_text(sampling: Sampling, time: float) -> str:
    """Return the UTC text of a time, s from the start."""
    assert sampling.start is not None
    return utc_texts(sampling.start, np.array([time]))[0]


def write_stk(sampling: Sampling, folder: Path) -> None:
    """Write ``platform.a``, a ``.sp`` file for each device with joints, and ``segments.int`` for days.

    Quaternions turn the reference axes into the object's as STK defines it, which means object to reference
    as everywhere here, but the scalar is last. The reference is inertial for the platform. For a device with
    joints it is the platform's body axes, which STK assumes where a sensor file names none. A sensor's
    boresight is its z axis. Attitude files have no place for the names of segments, so these are a list of
    intervals, each with its kind and name as its data.

    Args:
        sampling: the motion's sampling, with a start.
        folder: an empty one.
    """
    assert sampling.start is not None
    craft, count = sampling.spacecraft, sampling.spacecraft.gimbals.count
    inertial = ("CentralBody Earth", f"CoordinateAxes {_AXES_BY_FRAME[sampling.names.reference_frame]}")
    names = sensor_files(craft)
    with ExitStack() as stack:
        files = [
            stack.enter_context((folder / name).open("w", encoding="ascii"))
            for name in ("platform.a", *names)
        ]
        for file, axes in zip(files, (inertial, *[()] * count), strict=True):
            file.writelines(_header_lines(sampling, axes))
        before: list[np.ndarray | None] = [None] * count
        for block in sampling.blocks():
            _write_rows(files[0], block.times, block.quaternions)
            for number, file in enumerate(files[1:]):
                matrices = device_frames(craft, block.values.joints, number)
                quaternions = continued(matrices, before[number])
                before[number] = quaternions[-1]
                _write_rows(file, block.times, quaternions)
        for file in files:
            file.write("END Attitude\n")
    if sampling.flight.segments:
        lines = _interval_lines(sampling.flight.segments, sampling.start)
        (folder / "segments.int").write_text("".join(lines), encoding="ascii")


def _header_lines(sampling: Sampling, axes: tuple[str, ...]) -> Iterator[str]:
    """Yield the lines before the rows of an attitude file; lines `axes` name what it is relative to."""
    assert sampling.start is not None
    lines = (
        "stk.v.11.0",
        "BEGIN Attitude",
        f"NumberOfAttitudePoints {len(sampling.times)}",
        f"ScenarioEpoch {_format_epoch(sampling.start)}",
        "InterpolationOrder 1",
        *axes,
        "AttitudeTimeQuaternions",
    )
    yield from (f"{line}\n" for line in lines)


def _write_rows(file: TextIO, times: np.ndarray, quaternions: np.ndarray) -> None:
    """Write rows of times (k,) s and quaternions (k, 4), given scalar first and written scalar last."""
    file.writelines(table_lines([times, np.roll(quaternions, -1, axis=1)]))


def _interval_lines(segments: tuple[Segment, ...], start: np.datetime64) -> Iterator[str]:
    """Yield the lines of an interval list; segments that take no time are left out."""
    yield f"stk.v.11.0\nBEGIN IntervalList\nScenarioEpoch {_format_epoch(start)}\nBEGIN Intervals\n"
    for each in segments:
        if each.end > each.start:
            words = (re.sub(r"[^A-Za-z0-9.-]+", "_", text).strip("_") for text in (each.kind, each.name))
            label = "/".join(filter(None, words))
            yield f"{each.start:.9f} {each.end:.9f} {label}\n"
    yield "END Intervals\nEND IntervalList\n"


def _format_epoch(start: np.datetime64) -> str:
    """Format UTC as STK writes it, ``1 Jan 2026 00:00:00.000000``."""
    moment = start.astype("datetime64[us]").item()
    return f"{moment.day} {_MONTHS[moment.month - 1]} {moment:%Y %H:%M:%S.%f}"
