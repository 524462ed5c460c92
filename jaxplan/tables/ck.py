"""Reading SPICE C-kernels of types 2 and 3, with the clock kernel that lies beside them.

SPICE stores C-matrices, which map inertial to body coordinates. That is the inverse of the attitudes used
here, so quaternions are conjugated; both have the scalar first. Angular velocities of kernels are in
components of the base frame. A *row* of a kernel is (8,): time in s of TDB since J2000, SPICE's quaternion,
and angular velocity in rad/s. *Devices* are those with joints, each an object of its own whose base is the
platform.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.geometry import quaternion
from jaxplan.model.epochs import ephemeris_time
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.tables.devices import FIRST_TURNING, OtherDevicesError, joint_rates_of, joints_of
from jaxplan.tables.table import RATE, SLERP, AttitudeTable

_J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
_INERTIAL_FRAME = 1  # SPICE's number of the frame J2000, to which the platform's attitude is relative
_TIME_TOLERANCE = 1e-4  # s, within which rows of neighbouring segments are one; kernels are padded by less
_INTERPOLATION_BY_TYPE = {2: RATE, 3: SLERP}


def read_ck(path: Path, craft: Spacecraft | None = None) -> AttitudeTable:
    """Read the first object of a C-kernel that is relative to J2000, and the joints of its devices if asked.

    Args:
        path: path of the ``.bc`` file; clock kernels (``.tsc``) in its folder are loaded meanwhile.
        craft: spacecraft whose joints are computed from the frames of its devices, where the kernel has these
            under the numbers that exports give them (those just below the platform's). None to read no
            joints.

    Raises:
        ValueError: if there is no clock kernel, or nothing of type 2 or 3 relative to J2000; an
            `OtherDevicesError` if devices have rows at other times, or frames that devices of the spacecraft
            cannot have.
        ImportError: if the extra ``spice`` is not installed.
    """
    try:
        import spiceypy as spice
        from spiceypy.utils.exceptions import SpiceyError
    except ImportError as error:
        raise ImportError("spiceypy is missing: pip install 'jaxplan[spice]'") from error
    clocks = sorted(path.parent.glob("*.tsc"))
    if not clocks:
        raise ValueError(f"{path}: needs a clock kernel (.tsc) in the same folder")
    try:
        with _loaded_kernels(spice, clocks):
            kind, rows, devices = _read_rows(spice, path, 0 if craft is None else craft.gimbals.count)
    except SpiceyError as error:
        raise ValueError(f"{path}: no C-kernel that SPICE reads ({error})") from error
    moments, quaternions, rates = _split_rows(rows)
    new = np.append(True, np.abs(np.diff(moments)) > _TIME_TOLERANCE)
    start = _to_utc(moments[0])
    attitudes = np.asarray(quaternion.to_matrix(quaternions))
    joints = joint_rates = None
    if craft is not None and devices:
        joints, joint_rates = _compute_joints(path, craft, moments, devices)
        joints, joint_rates = joints[new], joint_rates[new]
    return AttitudeTable(
        times=(moments - float(ephemeris_time(start)))[new],
        quaternions=quaternions[new],
        angular_velocity=np.einsum("kji,kj->ki", attitudes, rates)[new],
        joints=joints,
        joint_rates=joint_rates,
        joint_names=() if craft is None or joints is None else craft.joint_names,
        spacecraft=None if joints is None else craft,
        epoch=start,
        interpolation=_INTERPOLATION_BY_TYPE[kind],
        name=str(path),
    )


def _split_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split rows (k, 8) into times (k,), body-to-inertial quaternions (k, 4), angular velocities (k, 3)."""
    return rows[:, 0], rows[:, 1:5] * [1.0, -1.0, -1.0, -1.0], rows[:, 5:8]


def _compute_joints(
    path: Path, craft: Spacecraft, moments: np.ndarray, devices: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Compute joints (k, J) rad and their rates (k, J) rad/s from the rows of devices.

    Args:
        path: path of the kernel, for messages.
        craft: spacecraft with the devices.
        moments: (k,) s of TDB, times of the platform's rows.
        devices: rows (k, 8) of each device.

    Raises:
        OtherDevicesError: if a device has rows at other times than the platform, or a frame that it cannot
            have.
    """
    frames, spins = [], []
    for name, rows in zip(craft.device_names, devices, strict=False):
        times, quaternions, rates = _split_rows(rows)
        if times.shape != moments.shape or not np.all(np.abs(times - moments) <= _TIME_TOLERANCE):
            raise OtherDevicesError(f"{path}: {name} has rows at other times than the platform")
        frames.append(np.asarray(quaternion.to_matrix(quaternions)))
        spins.append(rates)
    joints = joints_of(frames, craft, str(path))
    return joints, joint_rates_of(spins, joints, craft)


@contextmanager
def _loaded_kernels(spice: Any, files: list[Path]) -> Iterator[None]:
    """Load kernels into SPICE for the duration of a with block."""
    try:
        for file in files:
            spice.furnsh(str(file))
        yield
    finally:
        for file in files:
            spice.unload(str(file))


def _read_rows(spice: Any, path: Path, count: int) -> tuple[int, np.ndarray, list[np.ndarray]]:
    """Read the rows of the first object relative to J2000, and those of the devices on it.

    Args:
        spice: the module.
        path: path of the kernel.
        count: number of devices to look for.

    Returns:
        Type of the segments; rows (k, 8) of the object; rows of each device, none where the kernel has none.

    Raises:
        ValueError: if there is no such object, its segments are of several types, or some have no rates; an
            `OtherDevicesError` if some of the devices are there and others are not.
    """
    handle = spice.dafopr(str(path))
    try:
        segments = list(_read_segments(spice, handle))
        bus = next((number for number, base, *_ in segments if base == _INERTIAL_FRAME), None)
        if bus is None:
            raise ValueError(f"{path}: has no attitude relative to J2000")
        kind, rows = _read_object(spice, path, handle, segments, bus, _INERTIAL_FRAME)
        numbers = [bus - FIRST_TURNING - device for device in range(count)]
        known = {number for number, base, *_ in segments if base == bus}
        there = [number for number in numbers if number in known]
        if there and there != numbers:
            missing = next(number for number in numbers if number not in known)
            raise OtherDevicesError(
                f"{path}: has {len(there)} of {count} devices with joints upon {bus}, and no {missing}"
            )
        devices = []
        for number in there:
            own, found = _read_object(spice, path, handle, segments, number, bus)
            if own != kind:
                raise OtherDevicesError(f"{path}: {number} is of type {own}, and {bus} of type {kind}")
            devices.append(found)
        return kind, rows, devices
    finally:
        spice.dafcls(handle)


def _read_segments(spice: Any, handle: int) -> Iterator[tuple[int, int, int, bool, np.ndarray]]:
    """Yield number, base and type of each segment, whether it has rates, and its descriptor."""
    spice.dafbfs(handle)
    while spice.daffna():
        summary = np.array(spice.dafgs(5))
        _, about = spice.dafus(summary, 2, 6)
        number, base, kind, has_rates = (int(part) for part in about[:4])
        yield number, base, kind, bool(has_rates), summary


def _read_object(
    spice: Any, path: Path, handle: int, segments: list[Any], wanted: int, upon: int
) -> tuple[int, np.ndarray]:
    """Return the type and the rows (k, 8) of all segments of an object.

    Args:
        spice: the module.
        path: path of the kernel, for messages.
        handle: SPICE's handle of the open kernel.
        segments: what `_read_segments` yields.
        wanted: number of the object.
        upon: number of its base.

    Raises:
        ValueError: if the segments are not all of one type, 2 or 3, with angular velocities.
    """
    own = [each[2:] for each in segments if each[0] == wanted and each[1] == upon]
    kinds = {kind for kind, _, _ in own}
    if len(kinds) != 1 or not kinds <= set(_INTERPOLATION_BY_TYPE) or not all(rated for _, rated, _ in own):
        told = ", ".join(map(str, sorted(kinds)))
        raise ValueError(
            f"{path}: segments of type {told}: must be of one type, 2 or 3, with angular velocities"
        )
    clock = wanted // 1000 if upon == _INERTIAL_FRAME else upon // 1000  # devices share the platform's clock
    (kind,) = kinds
    rows = [row for _, _, summary in own for row in _read_segment_rows(spice, handle, summary, kind, clock)]
    return kind, np.array(rows)


def _read_segment_rows(spice: Any, handle: int, summary: Any, kind: int, clock: int) -> Iterator[np.ndarray]:
    """Yield the rows (8,) of a segment; in type 2 the end of the last interval makes a further row."""
    count, get = (spice.cknr03, spice.ckgr03) if kind == 3 else (spice.cknr02, spice.ckgr02)
    for number in range(1, count(handle, summary) + 1):
        record = np.asarray(get(handle, summary, number))
        values = record[1:8] if kind == 3 else record[3:10]
        yield np.append(spice.sct2e(clock, float(record[0])), values)
        if kind == 2 and number == count(handle, summary):  # the end of the last interval is a row, too
            stop = spice.sct2e(clock, float(record[1]))
            lasts = stop - spice.sct2e(clock, float(record[0]))
            yield np.append(
                stop, _propagate_rotation(values[:4] * [1.0, -1.0, -1.0, -1.0], values[4:], lasts)
            )


def _propagate_rotation(first: Any, rate: np.ndarray, seconds: float) -> np.ndarray:
    """Return SPICE's quaternion and the rates (7,) after some seconds at constant rate in base components.

    Args:
        first: (4,) quaternion at the start, body to base.
        rate: (3,) rad/s.
        seconds: s.
    """
    ours = np.asarray(quaternion.product(quaternion.exp(seconds * rate), first))
    return np.concatenate([ours * [1.0, -1.0, -1.0, -1.0], rate])


def _to_utc(moment: float) -> np.datetime64:
    """Convert an ephemeris time, s of TDB since J2000, to UTC, to the microsecond."""
    guess = _J2000 + np.timedelta64(round(moment * 1e6), "us")
    for _ in range(3):
        off = moment - float(ephemeris_time(guess))
        guess = guess + np.timedelta64(round(off * 1e6), "us")
    return guess.astype("datetime64[ns]")
