"""Writer of a SPICE C-kernel of type 3 with its other kernels: ``attitude.bc``, ``frames.tf``, ``clock.tsc``.

Where devices have rectangular fields of view, these are in an instrument kernel ``instruments.ti``.

SPICE stores C-matrices, which map inertial to body coordinates. That is the inverse of attitudes here, so
quaternions are conjugated. Angular velocities are those of a frame relative to its base frame, in components
of the base, in rad/s. Times are ephemeris time (TDB).

A flight is in one file without gaps: each frame has one SPICE segment for each block of rows, and the last
row of a block is the first of the next, so that the attitude is interpolated at every instant.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.exporting.sampled import Sampled, Sampling, device_frames, device_rates
from jaxplan.exporting.text_kernels import (
    Frames,
    clock_kernel,
    frame_kernel,
    frames_of,
    instrument_kernel,
    ticks,
)
from jaxplan.exporting.text_lines import plain
from jaxplan.geometry import quaternion
from jaxplan.model.epochs import ephemeris_time, utc_texts

_TIME_MARGIN = 1e-6  # s, by which a kernel extends beyond both ends, as times near 2030 are rounded to 1e-7 s


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
