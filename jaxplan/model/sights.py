"""Sights: the directions that pointing constraints bind, fixed to what carries them.

A sight is the boresight of a device, an axis of the body, or another vector of a device's moving part.
Shapes: S sights, devices first (terminals, then instruments), then axes of the body, then vectors of moving
parts. All of it computes with numpy or JAX, as its arguments do.
"""

from dataclasses import dataclass

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxplan.display import shown
from jaxplan.geometry import directions
from jaxplan.geometry.arrays import AnyArray, array_module, arrays
from jaxplan.geometry.vectors import length
from jaxplan.model.spacecraft import body_boresights
from jaxplan.once import made_once


@shown("mounts deg", "fixed", "carrier", "carried")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Sights:
    """The directions that constraints bind, fixed to what carries them.

    Attributes:
        mounts: (n,) rad, of the terminals, whose boresights come first.
        fixed: (f, 3) unit vectors in body axes: boresights of the instruments, then axes of the body.
        carrier: (v,) int, the terminal whose moving part each further vector is fixed to.
        carried: (v, 3) unit vectors along the terminal's boresight, to its left and upward, at any angles.
    """

    mounts: np.ndarray
    fixed: np.ndarray
    carrier: np.ndarray
    carried: np.ndarray

    @property
    def count(self) -> int:
        """Number of sights, S."""
        return self.mounts.shape[0] + self.fixed.shape[0] + self.carried.shape[0]

    @property
    @made_once
    def carriers(self) -> AnyArray:
        """(S,) int, the terminal whose moving part each sight is fixed to; -1 of those fixed to the body."""
        xp = array_module(self.carrier)
        own, still = xp.arange(self.mounts.shape[0]), xp.full(self.fixed.shape[0], -1)
        return xp.concatenate([own, still, xp.asarray(self.carrier, int)])

    @property
    @made_once
    def turning(self) -> AnyArray:
        """(2, S), one where the yaw, and the pitch, of its terminal turns a sight, else zero."""
        carried: AnyArray = self.carriers >= 0
        return array_module(carried).stack([carried, carried]).astype(float)

    def in_body(self, joints: ArrayLike) -> AnyArray:
        """Unit vectors (..., S, 3) in body axes at joints (..., 2n), by equation (13)."""
        xp, q, mounts = arrays(joints, self.mounts)
        seen = body_boresights(mounts, self.fixed, q)
        if not self.carried.shape[0]:
            return seen
        count = mounts.shape[0]
        a, e = (q[..., :count] + mounts)[..., self.carrier], q[..., count:][..., self.carrier]
        own = self.carried_at(xp.cos(a), xp.sin(a), xp.cos(e), xp.sin(e))
        return xp.concatenate([seen, xp.stack(own, axis=-1)], axis=-2)

    def carried_at(
        self, ca: AnyArray, sa: AnyArray, ce: AnyArray, se: AnyArray, *, behind: int = 0
    ) -> directions.Vector:
        """Components of the further vectors of moving parts.

        Args:
            ca: (..., v, ...) cosine of the azimuth of each vector's terminal.
            sa: (..., v, ...) its sine.
            ce: (..., v, ...) cosine of the elevation.
            se: (..., v, ...) its sine.
            behind: number of axes behind that of the vectors.
        """
        _, own = arrays(self.carried)
        return directions.carried([part.reshape(-1, *(1,) * behind) for part in own.T], ca, sa, ce, se)

    def bounds(self, joint_change: ArrayLike) -> tuple[AnyArray, AnyArray]:
        """How fast sights turn and bend, seen from the body, while joints move steadily by some change.

        With ``y = |dyaw|`` and ``p = |dpitch|`` a vector of the moving part turns about the yaw axis and one
        at right angles to it, so at ``hypot(y, p)`` at most, and its second derivative is at most the square
        of that plus ``y p``. That of the boresight, by equation (13), has a square that is linear in
        ``cos^2 pitch``: at most ``(y^2 + p^2)^2`` (pitch 0) or ``p^2 (p^2 + 4 y^2)`` (pitch 90 deg).

        Args:
            joint_change: (..., 2n) rad over the motion.

        Returns:
            (..., S) each: bounds of the first and second derivative in the share of the motion.
        """
        xp, given = arrays(joint_change)
        change = xp.abs(given)
        count = self.mounts.shape[0]
        yaw, pitch = change[..., :count], change[..., count:]
        rate = length(xp.stack([yaw, pitch], axis=-1))
        bend = xp.maximum(rate * rate, pitch * length(xp.stack([pitch, 2 * yaw], axis=-1)))
        still = xp.zeros((*change.shape[:-1], self.fixed.shape[0]), change.dtype)
        rates, bends = [rate, still], [bend, still]
        if self.carried.shape[0]:
            rates.append(rate[..., self.carrier])
            bends.append((rate * rate + yaw * pitch)[..., self.carrier])
        return xp.concatenate(rates, axis=-1), xp.concatenate(bends, axis=-1)
