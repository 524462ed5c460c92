"""Writers of AEM, STK, Basilisk, CSV and NPZ files, each with the conventions of its format.

Ours are body to inertial, scalar first, with rates in body axes, rad/s. Times are seconds from the start, so
leap seconds need no care but where a format has UTC.
"""

import csv
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.exporting.sampled import Sampled, device_motion, labels, plain, progress, table_lines
from jaxplan.geometry import quaternion
from jaxplan.model.epochs import utc_texts
from jaxplan.model.spacecraft import Spacecraft


def write_aem(sampled: Sampled, path: Path) -> None:
    """Write a CCSDS Attitude Ephemeris Message 2.0 (CCSDS 504.0-B-2) in its keyword form.

    The frame A is EME2000, B the body. Quaternions turn A into B in the message's sense, which is ours of
    body to inertial, with the scalar last; angular velocities are in degrees per second in body axes; times
    are UTC.

    Args:
        sampled: with a start.
        path: the file. Its CREATION_DATE is the one line that differs from one writing to the next.
    """
    assert sampled.start is not None
    stamps = utc_texts(sampled.start, sampled.times)
    body = "SC_BODY_1"
    header = {
        "CCSDS_AEM_VERS": "2.0",
        "CREATION_DATE": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%S}",
        "ORIGINATOR": "JAXPLAN",
        "META_START": None,
        "OBJECT_NAME": plain(sampled.name),
        "OBJECT_ID": "UNKNOWN",
        "REF_FRAME_A": "EME2000",
        "REF_FRAME_B": body,
        "TIME_SYSTEM": "UTC",
        "START_TIME": stamps[0],
        "STOP_TIME": stamps[-1],
        "ATTITUDE_TYPE": "QUATERNION/ANGVEL",
        "ANGVEL_FRAME": body,
        "META_STOP": None,
        "DATA_START": None,
    }
    numbers = table_lines(
        [np.roll(sampled.quaternions, -1, axis=1), np.rad2deg(sampled.values.angular_velocity)]
    )
    with path.open("w", encoding="ascii") as file:
        file.writelines(
            f"{key}\n" if value is None else f"{key} = {value}\n" for key, value in header.items()
        )
        rows = (f"{stamp} {row}" for stamp, row in zip(stamps, numbers, strict=True))
        file.writelines(progress(rows, len(stamps)))
        file.write("DATA_STOP\n")


_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def write_stk(sampled: Sampled, folder: Path) -> None:
    """Write STK's attitude file ``platform.a`` and a sensor file of each terminal, ``terminal-1.sp``.

    Quaternions turn the reference axes into the object's in STK's sense, which is ours of object to
    reference, with the scalar last. The reference is J2000 for the platform, and for a device with joints the
    platform's body axes, which is what STK takes where a sensor file names none. A sensor's boresight is its
    z axis.

    Args:
        sampled: with a start.
        folder: an empty one.
    """
    axes = ("CentralBody Earth", "CoordinateAxes J2000")
    _write_stk(sampled, folder / "platform.a", sampled.quaternions, axes)
    craft = sampled.spacecraft
    names = labels(craft.device_names[: craft.gimbals.count], taken=(), longest=100)
    for number, name in enumerate(names):
        frames, _ = device_motion(sampled, number)
        _write_stk(sampled, folder / f"{name}.sp", quaternion.continuous(frames), ())


def _write_stk(sampled: Sampled, path: Path, quaternions: np.ndarray, axes: tuple[str, ...]) -> None:
    """Write an attitude file: quaternions (k, 4), scalar first, relative to what the lines `axes` name."""
    header = (
        "stk.v.11.0",
        "BEGIN Attitude",
        f"NumberOfAttitudePoints {len(sampled.times)}",
        f"ScenarioEpoch {_stk_epoch(sampled.start)}",
        "InterpolationOrder 1",
        *axes,
        "AttitudeTimeQuaternions",
    )
    with path.open("w", encoding="ascii") as file:
        file.writelines(f"{line}\n" for line in header)
        rows = table_lines([sampled.times, np.roll(quaternions, -1, axis=1)])
        file.writelines(progress(rows, len(sampled.times)))
        file.write("END Attitude\n")


def _stk_epoch(start: np.datetime64 | None) -> str:
    """Gregorian UTC as STK writes it, ``1 Jan 2026 00:00:00.000000``."""
    assert start is not None
    moment = start.astype("datetime64[us]").item()
    return f"{moment.day} {_MONTHS[moment.month - 1]} {moment:%Y %H:%M:%S.%f}"


def write_basilisk(sampled: Sampled, path: Path) -> None:
    """Write what Basilisk's ``fswAlgorithms.waypointReference`` flies, with ``attitudeType = 1``.

    Columns, without a header: time (s, from the start of the simulation), quaternion (body to inertial in
    our sense, scalar first: Basilisk's beta_RN), angular velocity (rad/s) and acceleration (rad/s^2), both in
    inertial components, as ``useReferenceFrame = False`` has it.

    Args:
        sampled: the manoeuvre. Of one that takes no time the waypoint stands twice, a second apart, since
            Basilisk takes the second of a single one for zeros.
        path: the file.
    """
    columns = [
        sampled.times,
        sampled.quaternions,
        sampled.inertial(sampled.values.angular_velocity),
        sampled.inertial(sampled.values.angular_acceleration),
    ]
    if len(sampled.times) == 1:
        columns = [np.repeat(column, 2, axis=0) for column in columns]
        columns[0][1] += 1.0
    with path.open("w", encoding="ascii") as file:
        file.writelines(progress(table_lines(columns, separator=","), len(columns[0])))


def write_csv(sampled: Sampled, path: Path) -> None:
    """Write a table in UTF-8: ``time_s``, ``quaternion_w``, ..., ``terminal-1 yaw_rad``, ...

    Wheels have ``wheel-1_torque_Nm``, ... and then ``wheel-1_momentum_Nms``, ...: what each gives the
    platform about its axis, and what it holds.

    Args:
        sampled: the manoeuvre; with a start, the last column is ``utc``.
        path: the file. Numbers have all their digits.
    """
    names, columns = [], []
    for stem, unit, array in _arrays(sampled):
        axes = {1: [""], 3: ["_x", "_y", "_z"], 4: ["_w", "_x", "_y", "_z"]}[array[0].size]
        names += [f"{stem}{axis}{unit}" for axis in axes]
        columns += list(array.reshape(len(array), -1).T)
    rows: Iterable[tuple[Any, ...]] = zip(*columns, strict=True)
    if sampled.start is not None:
        names.append("utc")
        stamps = utc_texts(sampled.start, sampled.times)
        rows = ((*row, stamp) for row, stamp in zip(rows, stamps, strict=True))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(progress(rows, len(sampled.times)))


def write_npz(sampled: Sampled, path: Path) -> None:
    """Write arrays: ``time_s``, ``quaternion`` (k, 4), ..., ``terminal-1 yaw_rad`` (k,), ...

    Args:
        sampled: the manoeuvre; its start is ``epoch_utc``, a text that is empty where there is none.
        path: the file, which holds no pickled objects.
    """
    arrays = {f"{stem}{unit}": array for stem, unit, array in _arrays(sampled)}
    arrays["epoch_utc"] = np.array("" if sampled.start is None else str(sampled.start))
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def _arrays(sampled: Sampled) -> list[tuple[str, str, np.ndarray]]:
    """Name, suffix of the unit and values of each quantity: (k,), (k, 3), or (k, 4) for the quaternion."""
    values, craft = sampled.values, sampled.spacecraft
    arrays = [
        ("time", "_s", sampled.times),
        ("quaternion", "", sampled.quaternions),
        ("angular_velocity", "_rad_s", values.angular_velocity),
        ("angular_acceleration", "_rad_s2", values.angular_acceleration),
    ]
    for column in sorted(range(craft.joint_count), key=lambda joint: _owner(craft, joint)):
        name = craft.joint_names[column]
        arrays += [
            (name, "_rad", values.joints[:, column]),
            (f"{name}_rate", "_rad_s", values.joint_rates[:, column]),
            (f"{name}_acceleration", "_rad_s2", values.joint_accelerations[:, column]),
        ]
    for load, each in zip(("_torque_Nm", "_momentum_Nms"), sampled.wheels, strict=False):
        arrays += [(wheel.name, load, each[:, k]) for k, wheel in enumerate(craft.wheels)]
    return arrays


def _owner(craft: Spacecraft, joint: int) -> int:
    """The number of the device that a joint, by its index, belongs to."""
    terminals = len(craft.terminals)
    return joint % terminals if joint < 2 * terminals else joint - terminals
