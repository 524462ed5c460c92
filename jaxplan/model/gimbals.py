"""How joints turn devices: the directions of what is mounted on gimbals, and the angles toward a direction.

A device with joints has axes of its own, which are given at zero angles: its boresight, the direction to the
left of that, and the yaw axis. In these axes a terminal points along ``v(yaw, pitch)`` of equation (13). A
drive turns about one axis: it is a terminal whose yaw is the drive's angle and whose pitch is always the
*tilt*, the angle of its boresight above the plane across that axis. A *gimbal* is either of them. The
direction of its boresight is given by an azimuth (the yaw, or the drive's angle) and an elevation (the pitch,
or the tilt). Array shapes: n terminals, d drives, g = n + d gimbals; joints ``(2n + d,)`` are all yaws, all
pitches, then the drives' angles. Everything computes with numpy or JAX, as its arguments do.
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
from jaxplan.runtime.compute_once import made_once
from jaxplan.runtime.display import shown

TURN = 2 * np.pi


def stacked(values: Sequence[ArrayLike]) -> np.ndarray:
    """Stack values to one array: a read-only one of numpy, or one of JAX if a value is of JAX."""
    if array_module(*values) is jnp:
        return jnp.stack([jnp.asarray(value) for value in values])  # type: ignore[return-value]
    array = np.array(values)
    array.flags.writeable = False
    return array


def wrap(angle: ArrayLike) -> AnyArray:
    """Return angles (...) rad changed by whole turns so that they lie in (-pi, pi]."""
    xp, a = arrays(angle)
    return a - TURN * xp.ceil((a - xp.pi) / TURN)


def frame_about_z(angle: ArrayLike) -> AnyArray:
    """Return the rotation (3, 3) from a terminal's axes to body axes, if its mounting is turned about body z.

    `angle` is the angle of that turn, rad.
    """
    xp, a = arrays(angle)
    cosine, sine, zero = xp.cos(a), xp.sin(a), xp.zeros_like(a)
    return xp.stack([cosine, -sine, zero, sine, cosine, zero, zero, zero, zero + 1]).reshape(3, 3)


def frame_of(axis: ArrayLike, boresight: ArrayLike) -> AnyArray:
    """Return the rotation (3, 3) from a device's axes to body axes.

    Its columns are the boresight's component across the axis, the left of that, and the axis, of length one.

    Args:
        axis: (3,) body axes, of any length.
        boresight: (3,) body axes, of any length, not along the axis.
    """
    xp, about, ahead = arrays(axis, boresight)
    up = xp.stack(unit(about))
    left = xp.stack(unit(xp.stack(cross(up, ahead))))
    return xp.stack([xp.stack(cross(left, up)), left, up], axis=-1)


def in_range(angle: ArrayLike, ranges: ArrayLike, near: ArrayLike | None = None) -> AnyArray:
    """Change angles by whole turns so that they lie within their ranges, where that is possible.

    Args:
        angle: (..., k) rad.
        ranges: (k, 2) rad, least and largest.
        near: (..., k) rad; if a range spans more than a turn, the angle nearest to this is taken. None for
            the angle nearest to the middle of the range.

    Returns:
        (..., k) rad. An angle that no whole turn brings into its range is outside of the result's range too:
        it is then the one nearest to the range's middle.
    """
    xp, a, bounds = arrays(angle, ranges)
    low, high = bounds[:, 0], bounds[:, 1]
    middle = (low + high) / 2
    found = middle + wrap(a - middle)
    if near is None:
        return found
    _, wanted = arrays(near)
    # the number of turns is constant, so the result has the derivative of the angle
    turns = xp.clip(
        xp.round((wanted - found) / TURN), xp.ceil((low - found) / TURN), xp.floor((high - found) / TURN)
    )
    inside = (found >= low) & (found <= high)
    return xp.where(inside, found + TURN * turns, found)


def angles_toward(frames: AnyArray, attitude: AnyArray, directions: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return azimuth and elevation at which gimbals point along inertial directions, equations (3) and (4).

    It corrects these: the azimuth is ``atan2(s2, s1)`` of ``s = F^T R^T z``.

    Args:
        frames: (g, 3, 3) ``F``, from the gimbals' own axes to body axes.
        attitude: (..., 3, 3) ``R``, body to inertial.
        directions: (g, 3) ``z``, an inertial unit vector for each gimbal.

    Returns:
        Azimuths (..., g) rad in [-pi, pi], and elevations (..., g) rad.
    """
    return angles_along(frames, directions @ attitude)


def angles_along(frames: AnyArray, body: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return azimuth and elevation at which gimbals point along directions in body axes.

    Args:
        frames: (g, 3, 3) from the gimbals' own axes to body axes.
        body: (..., g, 3) one direction for each gimbal, body axes.

    Returns:
        Azimuths (..., g) rad in [-pi, pi], and elevations (..., g) rad, in the gimbals' own axes.
    """
    xp = array_module(frames, body)
    return azimuth_elevation(xp.sum(body[..., :, None] * frames.astype(body.dtype), axis=-2))


@shown("frames", "tilts deg")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Gimbals:
    """How the devices with joints are mounted: terminals, then drives; shapes are as in the module's text.

    Attributes:
        frames: (g, 3, 3) rotations to body axes from each device's own at zero angles: boresight (its
            component across the axis), left, yaw axis.
        tilts: (d,) rad, elevations of the drives' boresights, which do not change.
    """

    frames: np.ndarray
    tilts: np.ndarray

    @property
    def count(self) -> int:
        """Number g of gimbals: terminals and drives."""
        return self.frames.shape[0]

    @property
    def terminals(self) -> int:
        """Number n of the gimbals that are terminals; the others are drives."""
        return self.frames.shape[0] - self.tilts.shape[0]

    @property
    def joint_count(self) -> int:
        """Number of joints, ``2n + d``: two for each of n terminals, one for each of d drives."""
        return self.count + self.terminals

    @property
    @made_once
    def yaws(self) -> np.ndarray:
        """(g,) int, for each gimbal the number of the joint that turns its azimuth.

        For a terminal that is its yaw, for a drive its angle.
        """
        n = self.terminals
        return np.concatenate([np.arange(n), np.arange(2 * n, self.joint_count)])

    @property
    @made_once
    def pitches(self) -> np.ndarray:
        """(n,) int, for each terminal the number of the joint that turns its elevation, its pitch."""
        return np.arange(self.terminals, 2 * self.terminals)

    def joints_of(self, number: int) -> np.ndarray:
        """Return the numbers of the joints of a gimbal: yaw and pitch of a terminal, or the angle of a drive.

        `number` is that of the gimbal.
        """
        return np.array([self.yaws[number], *self.pitches[number : number + 1]])

    def parts(self, joints: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Split joints (..., 2n + d) rad into yaws and pitches (..., g); a drive has its angle and zero."""
        n, drives = self.terminals, self.tilts.shape[0]
        yaw, pitch = joints[..., :n], joints[..., n : 2 * n]
        if drives:
            xp, angle = array_module(joints), joints[..., 2 * n :]
            yaw = xp.concatenate([yaw, angle], axis=-1)
            pitch = xp.concatenate([pitch, xp.zeros_like(angle)], axis=-1)
        return yaw, pitch

    def angles(self, joints: ArrayLike) -> tuple[AnyArray, AnyArray]:
        """Return azimuths and elevations (..., g) rad of boresights in gimbals' own axes.

        `joints` (..., 2n + d) are in rad.
        """
        xp, q, tilts = arrays(joints, self.tilts)
        azimuth, elevation = self.parts(q)
        if tilts.shape[0]:
            elevation = elevation + xp.concatenate([xp.zeros(self.terminals), tilts]).astype(q.dtype)
        return azimuth, elevation

    def boresights(self, joints: ArrayLike) -> AnyArray:
        """Return the boresights (..., g, 3), unit vectors in body axes, at joints (..., 2n + d) rad.

        That is equation (13), turned into body axes.
        """
        xp, own, frames = arrays(pointing(*self.angles(joints)), self.frames)
        return xp.sum(frames.astype(own.dtype) * own[..., None, :], axis=-1)

    def axes(self, azimuth: AnyArray, which: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Return the axes of rotation of the yaws and of the pitches of some gimbals.

        Args:
            azimuth: (r,) rad, azimuth of each.
            which: (r,) int, number of each.

        Returns:
            (r, 3) yaw axes and (r, 3) pitch axes, unit vectors in body axes. A pitch axis points to the right
            of the boresight, so that a rotation about it lifts the boresight.
        """
        xp, a, frames = arrays(azimuth, self.frames)
        ahead, left, up = (frames[which][..., column] for column in range(3))
        return up, xp.sin(a)[:, None] * ahead - xp.cos(a)[:, None] * left
