"""Writer of STK's attitude file of the platform, sensor files of devices with joints, and interval list."""

import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TextIO

import numpy as np

from jaxplan.exporting.flight import Segment
from jaxplan.exporting.sampled import Sampling, continued, device_frames
from jaxplan.exporting.text_lines import table_lines
from jaxplan.tables.devices import sensor_files

_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_AXES_BY_FRAME = {"EME2000": "J2000", "ICRF": "ICRF", "GCRF": "ICRF"}  # STK's names of the inertial frames


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
