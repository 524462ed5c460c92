"""Reading CCSDS Attitude Ephemeris Messages (AEM) and STK attitude files."""

from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.geometry import quaternion
from jaxplan.model.epochs import leaps
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.sky.ephemeris import atomic
from jaxplan.sky.frames import library
from jaxplan.tables.devices import OtherDevicesError, joints_of, sensor_files
from jaxplan.tables.table import HERMITE, AttitudeTable

INERTIAL = ("EME2000", "J2000", "ICRF", "GCRF", "ICRF1", "ICRF2", "ICRF3")
"""Frames that are taken for the inertial one; they are apart by 1e-7 rad."""
_ATTITUDE_TYPES = ("QUATERNION", "QUATERNION/ANGVEL")
_TIME_TOLERANCE = 1e-6  # s, within which a segment of a message must begin where the one before ends
_STK_DATA = ("AttitudeTimeQuaternions", "AttitudeTimeQuatScalarFirst", "AttitudeTimeQuatAngVels")
_STK_AXES = ("J2000", "ICRF", "Inertial")


def read_aem(path: Path) -> AttitudeTable:
    """Read an Attitude Ephemeris Message of quaternions, with rates if it has them; as keywords (KVN) or XML.

    Raises:
        ValueError: if it is no such message, or has types, frames or times that are not supported.
        ImportError: if the extra ``oem`` is not installed.
    """
    reader = library("ccsds_ndm")
    try:
        message = reader.Aem.from_str(path.read_bytes().decode())
    except (ValueError, reader.NdmError) as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"{path}: no Attitude Ephemeris Message ({reason})") from error
    if not message.segments:
        raise ValueError(f"{path}: has no segment")
    day = _midnight(path, message.segments[0])
    parts = [_read_segment(path, number, segment, day) for number, segment in enumerate(message.segments, 1)]
    for number, (before, after) in enumerate(pairwise(parts), 1):
        apart = float(after[0][0] - before[0][-1])
        if not abs(apart) <= _TIME_TOLERANCE:
            raise ValueError(
                f"{path}: segment {number + 1} begins {apart:.6g} s after segment {number} ends, and no "
                "attitude is known between: must be where it ends"
            )
    times, quaternions = (np.concatenate([part[k] for part in parts]) for k in range(2))
    rates = None if any(part[2] is None for part in parts) else np.concatenate([part[2] for part in parts])
    # the row at which one segment ends and the next begins is in both
    new = np.append(True, np.diff(times) > 1e-9) | np.append(False, np.diff(times) < -1e-9)
    return AttitudeTable(
        times=times[new] - times[0],
        quaternions=quaternions[new],
        angular_velocity=None if rates is None else rates[new],
        epoch=day + np.timedelta64(round(float(times[0]) * 1e9), "ns"),
        alternative=None if rates is None else HERMITE,  # Orekit interpolates so, whatever the message says
        name=str(path),
    )


def _midnight(path: Path, segment: Any) -> np.datetime64:
    """Return the UTC midnight before the first row of a message's first segment.

    Raises:
        ValueError: if the row has no valid time.
    """
    try:
        days, _ = atomic(segment.data.attitude_states_epochs[:1], "UTC")
    except (ValueError, IndexError) as error:
        raise ValueError(f"{path}: segment 1: {error}") from error
    midnight: np.datetime64 = days[0].astype("datetime64[ns]")
    return midnight


def _seconds_after(day: np.datetime64, dates: Sequence[str]) -> np.ndarray:
    """Convert UTC dates to seconds (k,) after a UTC midnight `day`, counting leap seconds."""
    midnights, seconds = atomic(dates, "UTC")
    return np.asarray((midnights - day) / np.timedelta64(1, "s") + seconds - leaps(day))


def _read_segment(
    path: Path, number: int, segment: Any, day: np.datetime64
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Read a segment of a message.

    Args:
        path: path of the message, for errors.
        number: number of the segment, from 1 on, for errors.
        segment: as the package ccsds_ndm reads it.
        day: midnight of UTC from which times are counted.

    Returns:
        Times (k,) s after midnight; quaternions (k, 4), body to inertial, scalar first; angular velocities
        (k, 3) rad/s in body axes, or None.

    Raises:
        ValueError: if its type, frames, times or interpolation are not supported.
    """
    told = segment.metadata
    kind, first, second = (str(getattr(told, key)) for key in ("attitude_type", "ref_frame_a", "ref_frame_b"))
    where = f"{path}: segment {number}"
    if kind not in _ATTITUDE_TYPES:
        raise ValueError(f"{where}: ATTITUDE_TYPE = {kind}: must be one of {', '.join(_ATTITUDE_TYPES)}")
    method, degree = (getattr(told, f"interpolation_{key}", None) for key in ("method", "degree"))
    if method is not None and (str(method).upper() != "LINEAR" or degree not in (None, 1)):
        raise ValueError(
            f"{where}: INTERPOLATION_METHOD = {method}, INTERPOLATION_DEGREE = {degree}: must be LINEAR of "
            "degree 1, whose motion between rows is known"
        )
    if str(told.time_system) != "UTC":
        raise ValueError(f"{where}: TIME_SYSTEM = {told.time_system}: must be UTC")
    inertial = [frame.upper() in INERTIAL for frame in (first, second)]
    if inertial not in ([True, False], [False, True]):
        raise ValueError(
            f"{where}: REF_FRAME_A = {first}, REF_FRAME_B = {second}: one must be the body's, and the other "
            f"one of {', '.join(INERTIAL)}"
        )
    try:
        times = _seconds_after(day, segment.data.attitude_states_epochs)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
    states = np.asarray(segment.data.attitude_states_numpy, float)
    quaternions = np.roll(states[:, :4], 1, axis=1)
    if inertial[1]:  # given from the body to the inertial frame
        quaternions = quaternions * [1.0, -1.0, -1.0, -1.0]
    if kind == _ATTITUDE_TYPES[0]:
        return times, quaternions, None
    rates = np.deg2rad(states[:, 4:7])
    frame = str(told.angvel_frame)
    if frame.upper() in INERTIAL:
        rates = np.einsum("kji,kj->ki", np.asarray(quaternion.to_matrix(quaternions)), rates)
    return times, quaternions, rates


def read_stk(path: Path, craft: Spacecraft | None = None) -> AttitudeTable:
    """Read an STK attitude file of quaternions on an inertial frame, and joints from sensor files if asked.

    Args:
        path: path of the file.
        craft: spacecraft whose joints are computed from the sensor files (``.sp``) in the folder, where these
            have the names that exports give them. None to read no joints.

    Raises:
        ValueError: if it is no such file, or has data or axes that are not supported; an `OtherDevicesError`
            if sensor files have rows at other times, or frames that the spacecraft's devices cannot have.
    """
    header, times, quaternions = _read_stk_rows(path)
    axes = header.get("coordinateaxes", "")
    if axes not in _STK_AXES:
        raise ValueError(f"{path}: CoordinateAxes {axes or '(none)'}: must be one of {', '.join(_STK_AXES)}")
    joints = None if craft is None else _stk_joints(path, craft, times)
    return AttitudeTable(
        times=times,
        quaternions=quaternions,
        joints=joints,
        joint_names=() if craft is None or joints is None else craft.joint_names,
        spacecraft=None if joints is None else craft,
        epoch=_stk_epoch(path, header.get("scenarioepoch")),
        name=str(path),
    )


def _stk_joints(path: Path, craft: Spacecraft, times: np.ndarray) -> np.ndarray | None:
    """Compute joints (k, J) rad from the sensor files beside an attitude file.

    Args:
        path: path of the attitude file.
        craft: spacecraft with the devices.
        times: (k,) s, times of the attitude file's rows.

    Returns:
        None where there is no sensor file with a name of the spacecraft's devices.

    Raises:
        OtherDevicesError: if some of the files are missing, have rows at other times, are relative to other
            axes than the body's, or have frames that the devices cannot have.
    """
    names = sensor_files(craft)
    there = [name for name in names if (path.parent / name).is_file()]
    if not there:
        return None
    if there != names:
        missing = next(name for name in names if name not in there)
        raise OtherDevicesError(f"{path}: has {there[0]} beside it, and no {missing}")
    frames = []
    for name in names:
        file = path.parent / name
        header, rows, quaternions = _read_stk_rows(file)
        if "coordinateaxes" in header:
            axes = header["coordinateaxes"]
            raise OtherDevicesError(f"{file}: CoordinateAxes {axes}: must be none, which are the body's")
        if rows.shape != times.shape or not np.all(np.abs(rows - times) <= _TIME_TOLERANCE):
            raise OtherDevicesError(f"{file}: has rows at other times than {path.name}")
        length = np.linalg.norm(quaternions, axis=1, keepdims=True)
        frames.append(np.asarray(quaternion.to_matrix(quaternions / length)))
    return joints_of(frames, craft, str(path))


def _read_stk_rows(path: Path) -> tuple[dict[str, str], np.ndarray, np.ndarray]:
    """Return the header of an STK attitude file by lower-case keywords, times (k,) s, and quaternions (k, 4).

    Quaternions are returned scalar first.

    Raises:
        ValueError: if it is no such file, or its motion between rows is not known.
    """
    lines = [line.strip() for line in path.read_text(encoding="utf-8", errors="replace").splitlines()]
    words = [line.split() for line in lines if line and not line.startswith("#")]
    begins = [number for number, line in enumerate(words) if line[0] in _STK_DATA]
    if not begins:
        raise ValueError(f"{path}: has no data of {' or '.join(_STK_DATA)}")
    header = {line[0].lower(): " ".join(line[1:]) for line in words[: begins[0]]}
    order = header.get("interpolationorder", "1")
    if order != "1":
        raise ValueError(f"{path}: InterpolationOrder {order}: must be 1, whose motion between rows is known")
    kind, rows = words[begins[0]][0], []
    for line in words[begins[0] + 1 :]:
        if line[0].upper() == "END":
            break
        try:
            rows.append([float(word) for word in line])
        except ValueError as error:
            raise ValueError(f"{path}: row {len(rows) + 1}: {error}") from error
    width = 8 if kind == _STK_DATA[2] else 5
    if any(len(row) != width for row in rows) or not rows:
        raise ValueError(f"{path}: {kind} must have rows of {width} numbers")
    table = np.array(rows)
    scalar_first = kind == _STK_DATA[1]
    return header, table[:, 0], table[:, 1:5] if scalar_first else np.roll(table[:, 1:5], 1, axis=1)


def _stk_epoch(path: Path, text: str | None) -> np.datetime64 | None:
    """Convert STK's Gregorian text, such as ``1 Jan 2026 00:00:00.000000``, to UTC; None for none or ""."""
    if not text:
        return None
    try:
        return np.datetime64(datetime.strptime(text, "%d %b %Y %H:%M:%S.%f"), "ns")
    except ValueError as error:
        raise ValueError(
            f"{path}: ScenarioEpoch {text}: must be UTC such as 1 Jan 2026 00:00:00.000000"
        ) from error
