"""Plain tables: CSV with a header, and numpy's NPZ.

Names end with their unit. Angular velocity and acceleration are in body axes, quaternions body to inertial
with the scalar first, joints stand under the name of their terminal.
"""

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.exporting.sampled import Sampled, progress
from jaxplan.model.epochs import utc_texts


def write_csv(sampled: Sampled, path: Path) -> None:
    """Write a table in UTF-8: ``time_s``, ``quaternion_w``, ..., ``terminal-1 yaw_rad``, ...

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
    """Stem and unit of a name, and what it stands for: (k,), (k, 3), or (k, 4) for the quaternion."""
    values, terminals = sampled.values, sampled.spacecraft.terminals
    arrays = [
        ("time", "_s", sampled.times),
        ("quaternion", "", sampled.quaternions),
        ("angular_velocity", "_rad_s", values.angular_velocity),
        ("angular_acceleration", "_rad_s2", values.angular_acceleration),
    ]
    for number, terminal in enumerate(terminals):
        for joint, column in (("yaw", number), ("pitch", number + len(terminals))):
            name = f"{terminal.name} {joint}"
            arrays += [
                (name, "_rad", values.joints[:, column]),
                (f"{name}_rate", "_rad_s", values.joint_rates[:, column]),
                (f"{name}_acceleration", "_rad_s2", values.joint_accelerations[:, column]),
            ]
    return arrays
