"""How joints turn devices: the directions of what is mounted on gimbals, and the angles toward a direction.

A device with joints has axes of its own at zero angles: its boresight, the left of that, and the yaw axis. In
these a terminal points along ``v(yaw, pitch)`` of equation (13). A drive turns about one axis: it is a
terminal whose yaw is the drive's angle and whose pitch is always the tilt of the boresight above the plane
across that axis. So a *gimbal* is either, and has an azimuth and an elevation. Shapes: n terminals, d drives,
g = n + d gimbals, joints ``(2n + d,)`` as `jaxplan.model.spacecraft` has them. All of it computes with numpy
or JAX, as its arguments do.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import (
    AnyArray,
    array_module,
    arrays,
    azimuth_elevation,
    cross,
    pointing,
    unit,
)
from jaxplan.runtime.display import shown
from jaxplan.runtime.once import made_once

TURN = 2 * np.pi


def stacked(values: Sequence[ArrayLike]) -> np.ndarray:
    """The values stacked to a read-only array of numpy, or to one of JAX where one of them is."""
    if array_module(*values) is jnp:
        return jnp.stack([jnp.asarray(value) for value in values])  # type: ignore[return-value]
    array = np.array(values)
    array.flags.writeable = False
    return array


def wrap(angle: ArrayLike) -> AnyArray:
    """Angles (...) rad brought into (-pi, pi] by whole turns."""
    xp, a = arrays(angle)
    return a - TURN * xp.ceil((a - xp.pi) / TURN)


def frame_about_z(angle: ArrayLike) -> AnyArray:
    """Rotation (3, 3) from a terminal's axes to body axes, of one mounted at an angle, rad, about body z."""
    xp, a = arrays(angle)
    cosine, sine, zero = xp.cos(a), xp.sin(a), xp.zeros_like(a)
    return xp.stack([cosine, -sine, zero, sine, cosine, zero, zero, zero, zero + 1]).reshape(3, 3)


def frame_of(axis: ArrayLike, boresight: ArrayLike) -> AnyArray:
    """Rotation (3, 3) from a device's axes to body axes.

    Its columns are the part of the boresight across the axis, the left of that, and the axis.

    Args:
        axis: (3,) body axes, of any length.
        boresight: (3,) likewise, not along the axis.
    """
    xp, about, ahead = arrays(axis, boresight)
    up = xp.stack(unit(about))
    left = xp.stack(unit(xp.stack(cross(up, ahead))))
    return xp.stack([xp.stack(cross(left, up)), left, up], axis=-1)


def in_range(angle: ArrayLike, ranges: ArrayLike, near: ArrayLike | None = None) -> AnyArray:
    """Angles moved by whole turns into ranges, where that can be.

    Args:
        angle: (..., k) rad.
        ranges: (k, 2) rad, least and largest.
        near: (..., k) rad; of several angles within a range that span more than a turn the nearest to it is
            taken. None for the middle of the ranges.

    Returns:
        (..., k) rad; of an angle that no turn brings into its range the one nearest to that.
    """
    xp, a, bounds = arrays(angle, ranges)
    low, high = bounds[:, 0], bounds[:, 1]
    middle = (low + high) / 2
    found = middle + wrap(a - middle)
    if near is None:
        return found
    _, wanted = arrays(near)
    # whole turns are taken as they are: the angle has its own slope
    turns = xp.clip(
        xp.round((wanted - found) / TURN), xp.ceil((low - found) / TURN), xp.floor((high - found) / TURN)
    )
    inside = (found >= low) & (found <= high)
    return xp.where(inside, found + TURN * turns, found)


def angles_toward(frames: AnyArray, attitude: AnyArray, directions: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Azimuth and elevation at which gimbals point along inertial directions, as equations (3) and (4) ask.

    Corrected: the azimuth is ``atan2(s2, s1)`` of ``s = F^T R^T z``.

    Args:
        frames: (g, 3, 3) ``F``.
        attitude: (..., 3, 3) ``R``, body to inertial.
        directions: (g, 3) ``z``, one each.

    Returns:
        (..., g) rad in [-pi, pi], and (..., g) rad.
    """
    return angles_along(frames, directions @ attitude)


def angles_along(frames: AnyArray, body: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Azimuth and elevation, (..., g) rad each, of directions (..., g, 3) in body axes, one a gimbal.

    They are in the gimbals' own axes, from which `frames` (g, 3, 3) lead to body axes.
    """
    xp = array_module(frames, body)
    return azimuth_elevation(xp.sum(body[..., :, None] * frames.astype(body.dtype), axis=-2))


@shown("frames", "tilts deg")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Gimbals:
    """How the devices with joints are mounted: terminals, then drives.

    Attributes:
        frames: (g, 3, 3) body from each device's axes at zero angles: boresight, left, yaw axis.
        tilts: (d,) rad, elevations that the drives' boresights always have.
    """

    frames: np.ndarray
    tilts: np.ndarray

    @property
    def count(self) -> int:
        """Number of gimbals, g."""
        return self.frames.shape[0]

    @property
    def terminals(self) -> int:
        """Number of gimbals that are terminals, n."""
        return self.frames.shape[0] - self.tilts.shape[0]

    @property
    def joint_count(self) -> int:
        """Number of joints, ``2n + d``."""
        return self.count + self.terminals

    @property
    @made_once
    def yaws(self) -> np.ndarray:
        """(g,) int, the joint that turns the azimuth of each gimbal."""
        n = self.terminals
        return np.concatenate([np.arange(n), np.arange(2 * n, self.joint_count)])

    @property
    @made_once
    def pitches(self) -> np.ndarray:
        """(n,) int, the joint that turns the elevation of each terminal."""
        return np.arange(self.terminals, 2 * self.terminals)

    def joints_of(self, number: int) -> np.ndarray:
        """Numbers of a gimbal's one or two joints."""
        return np.array([self.yaws[number], *self.pitches[number : number + 1]])

    def parts(self, joints: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Yaws and pitches (..., g) of gimbals, from joints (..., 2n + d); of drives the angle and zero."""
        n, drives = self.terminals, self.tilts.shape[0]
        yaw, pitch = joints[..., :n], joints[..., n : 2 * n]
        if drives:
            xp, angle = array_module(joints), joints[..., 2 * n :]
            yaw = xp.concatenate([yaw, angle], axis=-1)
            pitch = xp.concatenate([pitch, xp.zeros_like(angle)], axis=-1)
        return yaw, pitch

    def angles(self, joints: ArrayLike) -> tuple[AnyArray, AnyArray]:
        """Azimuths and elevations (..., g) rad of boresights in gimbals' axes, at joints (..., 2n + d)."""
        xp, q, tilts = arrays(joints, self.tilts)
        azimuth, elevation = self.parts(q)
        if tilts.shape[0]:
            elevation = elevation + xp.concatenate([xp.zeros(self.terminals), tilts]).astype(q.dtype)
        return azimuth, elevation

    def boresights(self, joints: ArrayLike) -> AnyArray:
        """Boresights (..., g, 3), unit vectors in body axes, at joints (..., 2n + d) rad, equation (13)."""
        xp, own, frames = arrays(pointing(*self.angles(joints)), self.frames)
        return xp.sum(frames.astype(own.dtype) * own[..., None, :], axis=-1)

    def axes(self, azimuth: AnyArray, which: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Rotation axes (r, 3) of yaws and of pitches, unit vectors in body axes.

        Args:
            azimuth: (r,) rad, of some gimbals.
            which: (r,) int, their numbers.

        Returns:
            The yaw axes; and the pitch axes, which are opposite to the left of the boresights.
        """
        xp, a, frames = arrays(azimuth, self.frames)
        ahead, left, up = (frames[which][..., column] for column in range(3))
        return up, xp.sin(a)[:, None] * ahead - xp.cos(a)[:, None] * left
