"""Writer of CCSDS Attitude Ephemeris Messages 2.0 (504.0-B-2) as keywords, a segment for each activity."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from jaxplan.exporting.flight import Segment
from jaxplan.exporting.sampled import Sampling
from jaxplan.exporting.text_lines import plain, table_lines
from jaxplan.model.epochs import utc_texts

_DEFAULT_BODY_FRAME = "SC_BODY_1"  # name of the body's frame where the user gives none


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
