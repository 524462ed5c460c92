"""A plan's motion as a table for export, with the frames of its devices and the texts that formats share.

The motion is sampled and checked before any file is begun. Frames of devices have the boresight as z axis. A
device at azimuth ``a`` and elevation ``b`` in body axes has the frame ``Rz(a) Ry(pi/2 - b)``, whose columns
are its axes: z is ``v(a, b)`` of equation (13), y lies in the body's xy plane and x points down. A terminal's
azimuth is its yaw plus its mount, its elevation the pitch.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np

from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import azimuth_elevation, frame
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheel_shares import wheel_loads
from jaxplan.planner import Plan
from jaxplan.runtime.progress import progress_bar
from jaxplan.trajectory.curve import Samples, total_momentum

MOST_SAMPLES = 10_000_000  # most samples of a file
SHORTEST_STEP = 1e-6  # s: nearer instants would coincide in files that count seconds from the year 2000
_CHUNK = 4096  # samples between two updates of the bar, which take some hundredths of a second
_ROUNDING = 1e-9  # how far a matrix may be from a rotation; a trajectory's are within 1e-14
_NUMBER = "% .15e"  # 16 digits, as many as CCSDS allows and a double has

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """A manoeuvre sampled on a grid of times.

    Attributes:
        name: of the scenario.
        spacecraft: that flies it.
        start: UTC of time zero, None where the file does without.
        times: (k,) s, rising from 0 to the duration.
        values: the trajectory there, in radians and seconds; angular velocities in body axes.
        quaternions: (k, 4) body to inertial, scalar first, of unit length; neighbours have no change of sign.
        wheels: torques (k, n) N m and momenta (k, n) N m s of the wheels; none without wheels.
    """

    name: str
    spacecraft: Spacecraft
    start: np.datetime64 | None
    times: np.ndarray
    values: Samples
    quaternions: np.ndarray
    wheels: tuple[np.ndarray, ...] = ()

    def inertial(self, vectors: np.ndarray) -> np.ndarray:
        """Convert vectors (k, 3) from body to inertial axes."""
        return np.asarray(np.einsum("kij,kj->ki", self.values.attitude, vectors))


def sample(plan: Plan, start: np.datetime64 | None, times: np.ndarray) -> Sampled:
    """Sample a plan's trajectory, with a bar where that takes long.

    Args:
        plan: with a trajectory.
        start: UTC of time zero.
        times: (k,) s.

    Raises:
        ValueError: if a value is not a number, or a matrix no rotation, which no reader would notice.
    """
    assert plan.trajectory is not None
    parts = []
    with progress_bar("sampling", "samples", total=len(times)) as bar:
        for first in range(0, len(times), _CHUNK):
            parts.append(plan.trajectory.sample(times[first : first + _CHUNK]))
            bar.update(len(parts[-1].joints))
    curves = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Samples)}
    for name, curve in curves.items():
        finite = np.isfinite(curve).reshape(len(times), -1).all(axis=1)
        if not np.all(finite):
            raise ValueError(f"{name} is not finite at {times[np.argmin(finite)]:.6g} s")
    attitude = curves["attitude"]
    off = np.abs(np.swapaxes(attitude, 1, 2) @ attitude - np.eye(3)).max(axis=(1, 2))
    good = (off <= _ROUNDING) & (np.linalg.det(attitude) > 0)
    if not np.all(good):
        raise ValueError(f"attitude is not a rotation at {times[np.argmin(good)]:.6g} s")
    craft, values = plan.scenario.spacecraft, Samples(**curves)
    wheels: tuple[np.ndarray, ...] = ()
    if craft.wheels:
        loads = wheel_loads(values.kinematics(craft, total_momentum(plan.trajectory, craft)), craft)
        wheels = tuple(own.T for own in loads)
    return Sampled(
        name=plan.scenario.name,
        spacecraft=craft,
        start=start,
        times=times,
        values=values,
        quaternions=quaternion.continuous(attitude),
        wheels=wheels,
    )


def instants(duration: float, step: float) -> np.ndarray:
    """Times (k,) s to sample at: multiples of the step, and the duration in the place of one close to it.

    Raises:
        ValueError: if the step is out of range.
    """
    if isinstance(step, bool) or not isinstance(step, int | float | np.integer | np.floating):
        raise ValueError(f"step_s = {step!r}: must be a number of seconds")
    if not SHORTEST_STEP <= step < np.inf:
        raise ValueError(f"step_s = {step}: must lie in [{SHORTEST_STEP:g}, inf)")
    if not duration / step < MOST_SAMPLES:
        raise ValueError(
            f"step_s = {step:g}: must be more than {duration / MOST_SAMPLES:.3g} for a manoeuvre of "
            f"{duration:.2f} s, since a file holds at most {MOST_SAMPLES} samples"
        )
    grid = step * np.arange(int(duration / step) + 1)
    apart = max(1e-3 * min(step, duration), SHORTEST_STEP)
    return np.append(grid[grid < duration - apart], duration) if duration > apart else np.zeros(1)


def frames(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Frames of devices whose z axis is the boresight, see the module.

    Args:
        azimuth: (...) rad, of the boresight.
        elevation: (...) rad, likewise.

    Returns:
        (..., 3, 3) from the device to the axes in which the angles are.
    """
    a, b = np.broadcast_arrays(azimuth, elevation)
    outward, left, up = (
        np.stack(axis, axis=-1) for axis in frame(np.cos(a), np.sin(a), np.cos(b), np.sin(b))
    )
    return np.stack([-up, left, outward], axis=-1)


def device_motion(sampled: Sampled, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Frames and angular velocities, relative to the body, of a device with joints.

    Args:
        sampled: the manoeuvre.
        number: of the device: terminals from 0 on, then drives.

    Returns:
        (k, 3, 3) frames, device to body, and (k, 3) rad/s, their angular velocity in body axes.
    """
    gimbals, values = sampled.spacecraft.gimbals, sampled.values
    azimuth, elevation = (part[:, number] for part in gimbals.angles(values.joints))
    yaw_rate, pitch_rate = (part[:, number, None] for part in gimbals.parts(values.joint_rates))
    yaw_axis, pitch_axis = gimbals.axes(azimuth, np.full(len(azimuth), number))
    own = np.asarray(gimbals.frames[number] @ frames(azimuth, elevation))
    return own, yaw_rate * yaw_axis + pitch_rate * pitch_axis


def instrument_frames(boresights: np.ndarray) -> np.ndarray:
    """Frames of instruments.

    Args:
        boresights: (i, 3) unit vectors in body axes.

    Returns:
        (i, 3, 3) instrument to body; one along the body's z axis has its y axis along the body's.
    """
    return frames(*azimuth_elevation(boresights))


def table_lines(columns: Sequence[np.ndarray], separator: str = " ") -> Iterator[str]:
    """Yield the lines of a table of numbers as text, each with its line end.

    Args:
        columns: (k,) or (k, c), side by side.
        separator: between two numbers.
    """
    table = np.column_stack(columns)
    form = separator.join([_NUMBER] * table.shape[1]) + "\n"
    for first in range(0, len(table), 4096):  # a list of all would take several times the array's space
        for row in table[first : first + 4096].tolist():
            yield form % tuple(row)


def progress(rows: Iterable[T], total: int) -> Iterator[T]:
    """Yield the rows, of which there are `total`, and show a bar where writing them takes long."""
    with progress_bar("writing", "rows", total=total) as bar:
        for row in rows:
            yield row
            bar.update()


def plain(text: str, longest: int = 80) -> str:
    """Cut a text to `longest` characters, with ``?`` for what is no printable ASCII and for backslashes.

    To SPICE a backslash has a meaning. Of a text that is blank, ``?`` is left.
    """
    return "".join(c if " " <= c <= "~" and c != "\\" else "?" for c in text)[:longest].strip() or "?"


def labels(names: Iterable[str], taken: Iterable[str], longest: int) -> list[str]:
    """Short names of letters, digits, ``-`` and ``_`` that differ also where case does not count.

    Args:
        names: any text, such as names of devices.
        taken: names that they must not have.
        longest: characters of one at most.

    Returns:
        For each name itself with other characters made ``_``, or ``device_3`` where that is too long, empty
        or taken.
    """
    used = {name.lower() for name in taken}
    result = []
    for number, name in enumerate(names, start=1):
        label = re.sub(r"[^A-Za-z0-9_-]", "_", name)
        spare = (f"device_{k}" for k in range(number, 10**9))
        while not label.strip("_-") or len(label) > longest or label.lower() in used:
            label = next(spare)
        used.add(label.lower())
        result.append(label)
    return result
