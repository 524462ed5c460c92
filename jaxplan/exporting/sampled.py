"""A flight's motion as tables for export, a block of rows at a time, with the frames of its devices.

A day has more rows than memory should hold, so a table is made in blocks, each checked before a writer sees
it. The frame of a device has the boresight as its z axis. At azimuth ``a`` and elevation ``b``, which for
devices with joints are in the gimbal's own axes and for instruments in body axes, it is
``Rz(a) Ry(pi/2 - b)`` relative to these. The columns of this matrix are the device's axes: z is ``v(a, b)``
of equation (13), y lies in the xy plane, and x points down.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from jaxplan.exporting.flight import Flight
from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import AnyArray, azimuth_elevation, frame
from jaxplan.model.export_names import ExportNames
from jaxplan.model.outlines import FORWARD, UP, field_corners
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheel_reach import wheel_loads
from jaxplan.runtime.progress import progress_bar
from jaxplan.sky import Satellite
from jaxplan.trajectory.curve import Samples, total_momentum

ROWS = 32_768  # most rows of a block: some 20 MB with all of its columns
_ROTATION_TOLERANCE = 1e-9  # largest entry of |R^T R - 1| of an attitude; a trajectory's are within 1e-14


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """A block of k rows of a flight's table.

    Attributes:
        spacecraft: the one that moves.
        first: index of the first row.
        opens: whether it is the first block, or the first one after a cut.
        times: (k,) s from the start of the flight, rising.
        values: the trajectory at these times, in radians and seconds, with angular velocities in body axes.
        quaternions: (k, 4) body to inertial, scalar first, of unit length; the sign does not jump between
            rows.
        wheels: torques (k, n) N m and momenta (k, n) N m s of n wheels; empty without wheels.
    """

    spacecraft: Spacecraft
    first: int
    opens: bool
    times: np.ndarray
    values: Samples
    quaternions: np.ndarray
    wheels: tuple[np.ndarray, ...] = ()

    def inertial(self, vectors: np.ndarray) -> np.ndarray:
        """Convert vectors (k, 3), one for each row, from body to inertial axes."""
        return np.asarray(np.einsum("kij,kj->ki", self.values.attitude, vectors))


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampling:
    """A flight, the instants at which files have it, and the names that they give it.

    Attributes:
        flight: what is exported.
        start: UTC of time zero; None where the file has none.
        times: (k,) s, rising from 0 to the duration, with all ends of segments.
        names: how files call the spacecraft and its frames.
        tolerance: rad, bound of the errors of linear interpolation; None where a step was given.
        observer: orbit of the spacecraft; None where that is not known.
    """

    flight: Flight
    start: np.datetime64 | None
    times: np.ndarray
    names: ExportNames = field(default_factory=ExportNames)
    tolerance: float | None = None
    observer: Satellite | None = None

    @property
    def spacecraft(self) -> Spacecraft:
        """The spacecraft that moves."""
        return self.flight.spacecraft

    def row(self, time: float) -> int:
        """Return the index of the row nearest to a time, s."""
        after = int(np.searchsorted(self.times, time))
        near = np.clip([after - 1, after], 0, len(self.times) - 1)
        return int(near[np.argmin(np.abs(self.times[near] - time))])

    def blocks(self, cuts: Sequence[int] = ()) -> Iterator[Sampled]:
        """Yield the table in blocks of at most `ROWS` rows, in order; show progress where that takes long.

        Args:
            cuts: rising indices of rows that end a block and are repeated as the first row of the next one.
                All other rows are in one block each.

        Raises:
            ValueError: if a value is not finite, or a matrix is no rotation.
        """
        last = len(self.times) - 1
        edges = [0, *(cut for cut in cuts if 0 < cut < last), last]
        before: np.ndarray | None = None
        with progress_bar("writing", "samples", total=len(self.times)) as bar:
            for begin, end in pairwise(edges):
                for first in range(begin, end + 1, ROWS):
                    block = self._make_block(first, min(first + ROWS, end + 1), first == begin, before)
                    before = block.quaternions[-1]
                    yield block
                    bar.update(len(block.times))

    def overlapping(self) -> list[int]:
        """Return cuts for `blocks` such that full blocks share a row with their neighbours."""
        return list(range(ROWS - 1, len(self.times) - 1, ROWS - 1))

    def _make_block(self, first: int, end: int, opens: bool, before: np.ndarray | None) -> Sampled:
        """Make and check the block of rows `first` to `end` - 1, after a quaternion `before` or None."""
        times, craft = self.times[first:end], self.spacecraft
        values = self.flight.trajectory.sample(times)
        _check_samples(values, times)
        wheels: tuple[np.ndarray, ...] = ()
        if craft.wheels:
            loads = wheel_loads(values.kinematics(craft, self._total_momentum), craft)
            wheels = tuple(own.T for own in loads)
        return Sampled(
            spacecraft=craft,
            first=first,
            opens=opens,
            times=times,
            values=values,
            quaternions=continued(values.attitude, before),
            wheels=wheels,
        )

    @cached_property
    def _total_momentum(self) -> AnyArray | None:
        """Momentum (3,) N m s of platform and wheels, inertial axes, constant; None without wheels."""
        return total_momentum(self.flight.trajectory, self.spacecraft)


def continued(matrices: np.ndarray, before: np.ndarray | None) -> np.ndarray:
    """Return quaternions (k, 4), scalar first, of rotations (k, 3, 3), whose sign does not jump.

    `before` is the quaternion (4,) that the first must agree with in sign; None if any sign will do.
    """
    found = np.asarray(quaternion.continuous(matrices))
    return found if before is None or found[0] @ before >= 0 else -found


def _check_samples(values: Samples, times: np.ndarray) -> None:
    """Raise a ValueError if values at times (k,) s are not finite, or attitudes are no rotations."""
    for each in fields(values):
        curve = np.asarray(getattr(values, each.name))
        finite = np.isfinite(curve).reshape(len(times), -1).all(axis=1)
        if not np.all(finite):
            raise ValueError(f"{each.name} is not finite at {times[np.argmin(finite)]:.6g} s")
    attitude = values.attitude
    off = np.abs(np.swapaxes(attitude, 1, 2) @ attitude - np.eye(3)).max(axis=(1, 2))
    good = (off <= _ROTATION_TOLERANCE) & (np.linalg.det(attitude) > 0)
    if not np.all(good):
        raise ValueError(f"attitude is not a rotation at {times[np.argmin(good)]:.6g} s")


def frames(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Return the frames of devices whose z axis is the boresight; see the module.

    Args:
        azimuth: (...) rad, azimuth of the boresight.
        elevation: (...) rad, elevation of the boresight.

    Returns:
        (..., 3, 3) rotation matrices, from the device to the axes in which the angles are.
    """
    a, b = np.broadcast_arrays(azimuth, elevation)
    outward, left, up = (
        np.stack(axis, axis=-1) for axis in frame(np.cos(a), np.sin(a), np.cos(b), np.sin(b))
    )
    return np.stack([-up, left, outward], axis=-1)


def device_frames(craft: Spacecraft, joints: np.ndarray, number: int) -> np.ndarray:
    """Return frames (k, 3, 3), device to body, of a device with joints by its index, at joints (k, J) rad."""
    azimuth, elevation = (part[:, number] for part in craft.gimbals.angles(joints))
    return np.asarray(craft.gimbals.frames[number] @ frames(azimuth, elevation))


def device_rates(block: Sampled, number: int) -> np.ndarray:
    """Return angular velocities (k, 3) rad/s of a device with joints relative to the body, in body axes.

    Args:
        block: a block of the flight's rows.
        number: index of the device: terminals from 0 on, then drives.
    """
    gimbals, values = block.spacecraft.gimbals, block.values
    azimuth, _ = (part[:, number] for part in gimbals.angles(values.joints))
    yaw_rate, pitch_rate = (part[:, number, None] for part in gimbals.parts(values.joint_rates))
    yaw_axis, pitch_axis = gimbals.axes(azimuth, np.full(len(azimuth), number))
    return np.asarray(yaw_rate * yaw_axis + pitch_rate * pitch_axis)


def instrument_frames(boresights: np.ndarray) -> np.ndarray:
    """Return the frames of instruments.

    Args:
        boresights: (i, 3) unit vectors in body axes.

    Returns:
        (i, 3, 3) rotation matrices, instrument to body. If the boresight is the body's z axis, both y axes
        agree.
    """
    return frames(*azimuth_elevation(boresights))


def field_in_own_axes(device: Any, fixed: np.ndarray | None) -> np.ndarray | None:
    """Return unit vectors to the corners of a device's field of view.

    Args:
        device: a terminal, drive or instrument.
        fixed: (3, 3) frame of an instrument, device to body; None for devices with joints.

    Returns:
        (4, 3) in the device's frame, in order around the field; None without a field of view.
    """
    angles = getattr(device, "field_of_view", None)
    if angles is None:
        return None
    if fixed is None:  # boresight, left, up of the moving part
        corners = field_corners(FORWARD, UP if device.up is None else device.up, angles)
        return np.stack([-corners[:, 2], corners[:, 1], corners[:, 0]], axis=1)
    return np.asarray(field_corners(device.boresight, device.up, angles) @ fixed)
