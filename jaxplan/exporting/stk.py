"""STK's attitude file of the platform and a sensor pointing file of each terminal.

Quaternions turn the reference axes into the object's in STK's sense, which is ours of object to reference,
with the scalar last. The reference is J2000 for the platform, and for a terminal the platform's body axes,
which is what STK takes where a sensor file names none. A sensor's boresight is its z axis. Times are seconds
from the epoch, so leap seconds need no care.
"""

from pathlib import Path

import numpy as np

from jaxplan.exporting.sampled import Sampled, labels, progress, table_lines, terminal_motion
from jaxplan.geometry import quaternion

_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def write_stk(sampled: Sampled, folder: Path) -> None:
    """Write ``platform.a`` and, named after each terminal, ``terminal-1.sp``.

    Args:
        sampled: with a start.
        folder: an empty one.
    """
    axes = ("CentralBody Earth", "CoordinateAxes J2000")
    _write(sampled, folder / "platform.a", sampled.quaternions, axes)
    names = labels((t.name for t in sampled.spacecraft.terminals), taken=(), longest=100)
    for number, name in enumerate(names):
        frames, _ = terminal_motion(sampled, number)
        _write(sampled, folder / f"{name}.sp", quaternion.continuous(frames), ())


def _write(sampled: Sampled, path: Path, quaternions: np.ndarray, axes: tuple[str, ...]) -> None:
    header = (
        "stk.v.11.0",
        "BEGIN Attitude",
        f"NumberOfAttitudePoints {len(sampled.times)}",
        f"ScenarioEpoch {_epoch(sampled.start)}",
        "InterpolationOrder 1",
        *axes,
        "AttitudeTimeQuaternions",
    )
    with path.open("w", encoding="ascii") as file:
        file.writelines(f"{line}\n" for line in header)
        rows = table_lines([sampled.times, np.roll(quaternions, -1, axis=1)])
        file.writelines(progress(rows, len(sampled.times)))
        file.write("END Attitude\n")


def _epoch(start: np.datetime64 | None) -> str:
    """Gregorian UTC as STK writes it, ``1 Jan 2026 00:00:00.000000``."""
    assert start is not None
    moment = start.astype("datetime64[us]").item()
    return f"{moment.day} {_MONTHS[moment.month - 1]} {moment:%Y %H:%M:%S.%f}"
