"""Reading SPICE's C-kernels of types 2 and 3, with the clock kernel that lies beside them.

SPICE stores C-matrices, which map inertial to body: the inverse of ours, hence the conjugate quaternion.
Angular velocities are in components of the base frame.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.geometry import quaternion
from jaxplan.model.epochs import ephemeris_time
from jaxplan.tables.table import RATE, SLERP, AttitudeTable

_J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
_INERTIAL = 1  # SPICE's number of J2000, the base of the platform
_SAME = 1e-4  # s, within which rows of overlapping segments are one row; kernels are padded by less
_KINDS = {2: RATE, 3: SLERP}


def read_ck(path: Path) -> AttitudeTable:
    """Read the first object of a C-kernel whose attitude is relative to J2000.

    Args:
        path: of the ``.bc`` file; clock kernels (``.tsc``) in its folder are loaded meanwhile.

    Raises:
        ValueError: if there is no clock kernel, or nothing of types 2 or 3 on J2000.
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
        with _loaded(spice, clocks):
            kind, rows = _rows(spice, path)
    except SpiceyError as error:
        raise ValueError(f"{path}: no C-kernel that SPICE reads ({error})") from error
    moments, quaternions, rates = rows[:, 0], rows[:, 1:5] * [1.0, -1.0, -1.0, -1.0], rows[:, 5:8]
    new = np.append(True, np.abs(np.diff(moments)) > _SAME)
    start = _utc(moments[0])
    attitudes = np.asarray(quaternion.to_matrix(quaternions))
    return AttitudeTable(
        times=(moments - float(ephemeris_time(start)))[new],
        quaternions=quaternions[new],
        angular_velocity=np.einsum("kji,kj->ki", attitudes, rates)[new],
        epoch=start,
        interpolation=_KINDS[kind],
        name=str(path),
    )


@contextmanager
def _loaded(spice: Any, files: list[Path]) -> Iterator[None]:
    """Load kernels for a while."""
    try:
        for file in files:
            spice.furnsh(str(file))
        yield
    finally:
        for file in files:
            spice.unload(str(file))


def _rows(spice: Any, path: Path) -> tuple[int, np.ndarray]:
    """The type of the segments of the first object on J2000, and their rows: TDB in s, quaternion, rates.

    Raises:
        ValueError: if there is none, or its segments are of several types, or some without rates.
    """
    handle, object_number, kinds, rows = spice.dafopr(str(path)), None, set(), []
    try:
        spice.dafbfs(handle)
        while spice.daffna():
            summary = spice.dafgs(5)
            _, about = spice.dafus(summary, 2, 6)
            number, base, kind, has_rates = (int(part) for part in about[:4])
            if base != _INERTIAL or object_number not in (None, number):
                continue
            object_number = number
            kinds.add(kind)
            if kind not in _KINDS or not has_rates:
                break
            rows += list(_records(spice, handle, summary, kind, number // 1000))
    finally:
        spice.dafcls(handle)
    if object_number is None:
        raise ValueError(f"{path}: has no attitude relative to J2000")
    if len(kinds) != 1 or not kinds <= set(_KINDS) or not rows:
        told = ", ".join(map(str, sorted(kinds)))
        raise ValueError(
            f"{path}: segments of type {told}: must be of one type, 2 or 3, with angular velocities"
        )
    return kinds.pop(), np.array(rows)


def _records(spice: Any, handle: int, summary: Any, kind: int, clock: int) -> Iterator[np.ndarray]:
    """Yield the rows of a segment: TDB in s, quaternion as SPICE has it, and angular velocity in rad/s."""
    count, get = (spice.cknr03, spice.ckgr03) if kind == 3 else (spice.cknr02, spice.ckgr02)
    for number in range(1, count(handle, summary) + 1):
        record = np.asarray(get(handle, summary, number))
        values = record[1:8] if kind == 3 else record[3:10]
        yield np.append(spice.sct2e(clock, float(record[0])), values)
        if kind == 2 and number == count(handle, summary):  # the last one ends the table
            stop = spice.sct2e(clock, float(record[1]))
            lasts = stop - spice.sct2e(clock, float(record[0]))
            yield np.append(stop, _after(values[:4] * [1.0, -1.0, -1.0, -1.0], values[4:], lasts))


def _after(first: Any, rate: np.ndarray, seconds: float) -> np.ndarray:
    """SPICE's quaternion and rates after some seconds at a rate in the base's components."""
    ours = np.asarray(quaternion.product(quaternion.exp(seconds * rate), first))
    return np.concatenate([ours * [1.0, -1.0, -1.0, -1.0], rate])


def _utc(moment: float) -> np.datetime64:
    """UTC of an ephemeris time, s of TDB from J2000, to the microsecond."""
    guess = _J2000 + np.timedelta64(round(moment * 1e6), "us")
    for _ in range(3):
        off = moment - float(ephemeris_time(guess))
        guess = guess + np.timedelta64(round(off * 1e6), "us")
    return guess.astype("datetime64[ns]")
