"""Writers of Basilisk, CSV and NPZ files: tables with a row for each instant.

Quaternions are body to inertial, scalar first, and rates are in body axes, rad/s, where nothing else is said.
Times are seconds from the start, so leap seconds matter only in a column of UTC.
"""

import csv
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.exporting.messages import table_lines
from jaxplan.exporting.sampled import Sampled, Sampling
from jaxplan.model.epochs import utc_texts
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.tables.table import column_name


def write_basilisk(sampling: Sampling, path: Path) -> None:
    """Write what Basilisk's ``fswAlgorithms.waypointReference`` reads, with ``attitudeType = 1``.

    Columns, without a header: time (s, from the start of the simulation), quaternion (body to inertial,
    scalar first; Basilisk's beta_RN), angular velocity (rad/s) and acceleration (rad/s^2), both in inertial
    components, as ``useReferenceFrame = False`` requires.

    Args:
        sampling: the motion's sampling, of two instants or more, since Basilisk reads zeros for the second
            waypoint of a single one.
        path: the file.
    """
    with path.open("w", encoding="ascii") as file:
        for block in sampling.blocks():
            columns = [
                block.times,
                block.quaternions,
                block.inertial(block.values.angular_velocity),
                block.inertial(block.values.angular_acceleration),
            ]
            file.writelines(table_lines(columns, separator=","))


def write_csv(sampling: Sampling, path: Path) -> None:
    """Write a table in UTF-8 with columns ``time_s``, ``quaternion_w``, ..., ``terminal-1_yaw_rad``, ...

    Wheels have columns ``wheel-1_torque_Nm``, ... and ``wheel-1_momentum_Nms``, ...: the torque that each
    gives the platform about its axis, and the momentum that it holds. Blanks in names of devices become
    underscores. A day has ``segment`` and ``segment_kind``, of the segment that a row is in or that begins
    with it.

    Args:
        sampling: the motion's sampling; with a start, the last column is ``utc``.
        path: the file. Numbers have all their digits.

    Raises:
        ValueError: if two columns would have one name.
    """
    segments = sampling.flight.segments
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        for block in sampling.blocks():
            arrays = _named_arrays(block)
            if not block.first:
                names = [
                    f"{stem}{axis}{unit}"
                    for stem, unit, array in arrays
                    for axis in _component_suffixes(array)
                ]
                names += ["segment", "segment_kind"] * bool(segments) + ["utc"] * (sampling.start is not None)
                writer.writerow(names)
            columns = [
                column for _, _, array in arrays for column in array.reshape(len(array), -1).T.tolist()
            ]
            if segments:
                own = [segments[number] for number in _segment_numbers(sampling, block.times)]
                columns += [[each.name for each in own], [each.kind for each in own]]
            if sampling.start is not None:
                columns.append(utc_texts(sampling.start, block.times))
            rows: Iterable[tuple[Any, ...]] = zip(*columns, strict=True)
            writer.writerows(rows)


def write_npz(sampling: Sampling, path: Path) -> None:
    """Write an archive of arrays: ``time_s``, ``quaternion`` (k, 4), ..., ``terminal-1_yaw_rad`` (k,), ...

    A day has ``segment`` (k,) int, the index of the segment that a row is in or that begins with it, and for
    its s segments ``segment_name`` and ``segment_kind`` (s,), texts, ``segment_start_s`` and
    ``segment_end_s`` (s,).

    Args:
        sampling: the motion's sampling; its start is ``epoch_utc``, a text that is empty where there is none.
        path: the file, which holds no pickled objects.

    Raises:
        ValueError: if two arrays would have one name.
    """
    arrays: dict[str, np.ndarray] = {}
    for block in sampling.blocks():
        for stem, unit, array in _named_arrays(block):
            whole = arrays.setdefault(f"{stem}{unit}", np.empty((len(sampling.times), *array.shape[1:])))
            whole[block.first : block.first + len(array)] = array
    arrays["epoch_utc"] = np.array("" if sampling.start is None else str(sampling.start))
    segments = sampling.flight.segments
    if segments:
        arrays["segment"] = _segment_numbers(sampling, sampling.times)
        arrays |= {
            f"segment_{key}": np.array([getattr(s, key) for s in segments]) for key in ("name", "kind")
        }
        arrays |= {
            f"segment_{key}_s": np.array([getattr(s, key) for s in segments]) for key in ("start", "end")
        }
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def _segment_numbers(sampling: Sampling, times: np.ndarray) -> np.ndarray:
    """Return indices (k,) of the segments that contain times (k,) s; at a boundary the one that begins."""
    segments = sampling.flight.segments
    rows = np.array([sampling.row(segment.start) for segment in segments])
    found = np.searchsorted(sampling.times[rows], times, side="right") - 1
    return np.asarray(found)


def _named_arrays(block: Sampled) -> list[tuple[str, str, np.ndarray]]:
    """Return name, unit suffix and values of each quantity: (k,), (k, 3), or (k, 4) for the quaternion."""
    values, craft = block.values, block.spacecraft
    arrays = [
        ("time", "_s", block.times),
        ("quaternion", "", block.quaternions),
        ("angular_velocity", "_rad_s", values.angular_velocity),
        ("angular_acceleration", "_rad_s2", values.angular_acceleration),
    ]
    for column in sorted(range(craft.joint_count), key=lambda joint: _device_of_joint(craft, joint)):
        name = column_name(craft.joint_names[column])
        arrays += [
            (name, "_rad", values.joints[:, column]),
            (f"{name}_rate", "_rad_s", values.joint_rates[:, column]),
            (f"{name}_acceleration", "_rad_s2", values.joint_accelerations[:, column]),
        ]
    for load, each in zip(("_torque_Nm", "_momentum_Nms"), block.wheels, strict=False):
        arrays += [(column_name(wheel.name), load, each[:, k]) for k, wheel in enumerate(craft.wheels)]
    _expect_distinct([f"{stem}{unit}" for stem, unit, _ in arrays])
    return arrays


def _expect_distinct(columns: Sequence[str]) -> None:
    """Raise a ValueError if two columns have one name, as those of devices "a b" and "a_b" have."""
    twice = [name for name, count in Counter(columns).items() if count > 1]
    if twice:
        raise ValueError(
            f"two columns would be called {twice[0]}, since blanks of names become underscores: "
            "rename one of the devices"
        )


def _component_suffixes(array: np.ndarray) -> list[str]:
    """Return what stands in column names between a quantity's name and its unit, such as "_x", "_y", "_z"."""
    return {1: [""], 3: ["_x", "_y", "_z"], 4: ["_w", "_x", "_y", "_z"]}[array[0].size]


def _device_of_joint(craft: Spacecraft, joint: int) -> int:
    """Return the index of the device that a joint, by its index, belongs to."""
    terminals = len(craft.terminals)
    return joint % terminals if joint < 2 * terminals else joint - terminals
