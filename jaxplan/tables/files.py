"""Reading attitude files: finding out the format of a file, and the formats that are mere numbers."""

import csv
import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from jaxplan.geometry import quaternion
from jaxplan.model.epochs import parse_epoch
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.arguments import expect, file_path
from jaxplan.tables.ck import read_ck
from jaxplan.tables.messages import read_aem, read_stk
from jaxplan.tables.table import RODRIGUES, AttitudeTable

_COMPONENT_SUFFIXES = ("_w", "_x", "_y", "_z")
_NPZ_MAGIC = b"PK\x03\x04"  # how files of npz begin
_BASILISK_COLUMNS = 11  # columns: time, quaternion, angular velocity and acceleration


def load_attitude(path: str | os.PathLike[str], spacecraft: Spacecraft | None = None) -> AttitudeTable:
    """Read a table of attitudes, and of joints if there are any, from a file of `export` or of another tool.

    By the name of the file and its first line it is recognised as a CCSDS AEM (needs ``jaxplan[oem]``), a
    SPICE C-kernel of type 2 or 3 with its clock kernel in the same folder (``.bc``, needs
    ``jaxplan[spice]``), an STK attitude file (``.a``), a table with a header as of format ``"csv"``, one
    without as of ``"basilisk"``, or an archive as of ``"npz"``. Joints are read from ``"csv"`` and ``"npz"``
    by their names, in the order of the file, or with `spacecraft` in its order. C-kernels and STK's files
    have frames of devices but not how these are mounted, so there joints are only read with `spacecraft`.

    Args:
        path: path of the file, or of a folder of format ``"ck"`` or ``"stk"``.
        spacecraft: the one whose joints are found by their names, or computed from the frames of its devices
            where the files have them as `export` writes them (then up to whole turns: all angles of a joint
            are moved together to be nearest to the middle of its range). None to take joints as the file has
            them.

    Returns:
        The table, with the interpolation that programs reading this format use.

    Raises:
        ValueError: if it is no such file, or its rows are no attitudes; if devices have frames that those of
            the spacecraft cannot have, or if the file has columns for some of its joints and not for others.
        OSError: if it cannot be read.
        ImportError: if an extra is missing.

    Example:
        >>> start = jp.load_attitude("yesterday.aem").state(-1)
    """
    given = file_path("path", path)
    if spacecraft is not None:
        expect("spacecraft", spacecraft, Spacecraft, "scenario.spacecraft is one")
    target = _find_attitude_file(given) if given.is_dir() else given
    suffix = target.suffix.lower()
    read = _READERS_BY_SUFFIX.get(suffix)
    if read is None:
        with target.open("rb") as file:
            first = file.readline(4096)
        read = _reader_by_first_line(first)
        if read is None:
            raise ValueError(
                f"{target}: no attitude file: must be a CCSDS AEM, a C-kernel (.bc), an attitude file of STK "
                "(.a), an archive (.npz) or a table with the columns time_s and quaternion_w to quaternion_z"
            )
    if spacecraft is not None and spacecraft.joint_count and read in (read_ck, read_stk):
        return (read_ck if read is read_ck else read_stk)(target, spacecraft)
    table = read(target)
    return table if spacecraft is None else table.of(spacecraft)


def _find_attitude_file(folder: Path) -> Path:
    """Return the only attitude file (.bc or .a) in a folder; raise ValueError if there is none or several."""
    found = sorted([*folder.glob("*.bc"), *folder.glob("*.a")])
    if len(found) != 1:
        raise ValueError(f"{folder}: holds {len(found)} attitude files (.bc, .a): name one file")
    return found[0]


def _reader_by_first_line(line: bytes) -> Callable[[Path], AttitudeTable] | None:
    """Return the function that reads files with this first line; None if the format is not recognised."""
    if line.startswith(_NPZ_MAGIC):
        return _read_npz
    text = line.decode("utf-8", "replace").strip().lstrip("\ufeff")
    if text.startswith("CCSDS_AEM_VERS"):
        return read_aem
    if text.startswith("stk.v"):
        return read_stk
    if "quaternion_w" in text and "time_s" in text:
        return _read_csv
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        return None
    return _read_basilisk if len(numbers) == _BASILISK_COLUMNS else None


def _read_csv(path: Path) -> AttitudeTable:
    """Read a UTF-8 table with a header.

    Where there is a column ``utc``, the epoch is its first entry less the first ``time_s``; else it is None.
    """
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.reader(file))
    header, body = rows[0], [row for row in rows[1:] if row]
    wrong = [number for number, row in enumerate(body, 2) if len(row) != len(header)]
    if wrong:
        raise ValueError(f"{path}: line {wrong[0]} has not {len(header)} columns, as the header has")
    columns: dict[str, np.ndarray] = {}
    for place, name in enumerate(header):
        if name in ("utc", "segment", "segment_kind"):
            continue
        try:
            columns[name] = np.array([float(row[place]) for row in body])
        except ValueError as error:
            raise ValueError(f"{path}: column {name}: {error}") from error
    epoch = None
    if "utc" in header and body:
        first = parse_epoch(body[0][header.index("utc")][:26])
        epoch = first - np.timedelta64(round(float(columns["time_s"][0]) * 1e9), "ns")
    for stem, count in (("quaternion", 4), ("angular_velocity", 3)):
        unit = "" if count == 4 else "_rad_s"
        names = [f"{stem}{axis}{unit}" for axis in _COMPONENT_SUFFIXES[4 - count :]]
        if all(name in columns for name in names):
            columns[f"{stem}{unit}"] = np.stack([columns[name] for name in names], axis=1)
    return _table_from_columns(path, columns, epoch)


def _read_npz(path: Path) -> AttitudeTable:
    """Read an archive of numpy arrays named as `export` names them; raise ValueError if it is none."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            columns = {name: archive[name] for name in archive.files}
    except (ValueError, EOFError, OSError) as error:
        raise ValueError(f"{path}: no archive of arrays ({error})") from error
    stamp = str(columns.pop("epoch_utc", ""))
    return _table_from_columns(path, columns, parse_epoch(stamp[:26]) if stamp else None)


def _table_from_columns(
    path: Path, columns: Mapping[str, np.ndarray], epoch: np.datetime64 | None
) -> AttitudeTable:
    """Make a table of columns, which have the names that `export` gives them.

    Raises:
        ValueError: if there are no times or quaternions.
    """
    for name in ("time_s", "quaternion"):
        if name not in columns:
            wanted = "quaternion_w to quaternion_z" if name == "quaternion" else name
            raise ValueError(f"{path}: has no {wanted}, only {', '.join(columns)}")
    taken = ("angular_velocity", "angular_acceleration")
    joints = [
        name.removesuffix("_rad")
        for name in columns
        if name.endswith("_rad") and np.ndim(columns[name]) == 1 and not name.startswith(taken)
    ]
    rates = [f"{name}_rate_rad_s" for name in joints]
    have_rates = bool(joints) and all(name in columns for name in rates)
    return AttitudeTable(
        times=columns["time_s"],
        quaternions=columns["quaternion"],
        angular_velocity=columns.get("angular_velocity_rad_s"),
        joints=np.stack([columns[f"{name}_rad"] for name in joints], axis=1) if joints else None,
        joint_rates=np.stack([columns[name] for name in rates], axis=1) if have_rates else None,
        joint_names=tuple(joints),
        epoch=epoch,
        name=str(path),
    )


def _read_basilisk(path: Path) -> AttitudeTable:
    """Read waypoints: time, s, quaternion, angular velocity in inertial components; the rest is not used."""
    try:
        rows = np.loadtxt(path, delimiter=",", ndmin=2)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if rows.shape[1] != _BASILISK_COLUMNS:
        raise ValueError(f"{path}: has {rows.shape[1]} columns, waypoints have {_BASILISK_COLUMNS}")
    attitudes = np.asarray(quaternion.to_matrix(rows[:, 1:5]))
    return AttitudeTable(
        times=rows[:, 0],
        quaternions=rows[:, 1:5],
        angular_velocity=np.einsum("kji,kj->ki", attitudes, rows[:, 5:8]),
        interpolation=RODRIGUES,
        name=str(path),
    )


_READERS_BY_SUFFIX: dict[str, Callable[[Path], AttitudeTable]] = {
    ".aem": read_aem,
    ".a": read_stk,
    ".bc": read_ck,
    ".npz": _read_npz,
    ".xml": read_aem,
}
