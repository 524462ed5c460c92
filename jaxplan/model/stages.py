"""The moving stages of gimbals: their momentum, and how they push back on the platform.

A *stage* is what one joint turns: of a terminal the part that yaws without pitching, and the part that does
both; of a drive its one part. Its inertia ``I`` is that about its own centre of mass, in the device's axes
(boresight, left, yaw axis) at zero angles, and its centre of mass lies on the axis that turns it, that of
what pitches on both axes. So nothing shifts, and the inertia of the whole in body axes is

    J(q) = J_0 + sum C_k I_k C_k^T,    J_0 = J - sum F_k I_k F_k^T,

with ``C_k = F_k Z(yaw) Y(pitch)`` from a stage's axes to body axes, ``F_k = C_k`` at zero angles, and ``J``
that of the whole with all joints at zero. With the angular velocity ``w`` of the body, and ``g_k`` of the
stage relative to it, the momentum of the whole and its derivative in body axes are

    L  = J_0 w  + sum C_k m_k,                      m_k = I_k (C_k^T w + g_k),
    L' = J_0 w' + sum C_k (m_k' + g_k x m_k),       m_k' = I_k (C_k^T w' - g_k x C_k^T w + g_k'),

where ``g_k`` and what depends on ``k`` alone are in the stage's own axes, in which ``I_k`` does not change.
Torque from outside is ``L' + w x L``; wheels give ``L' + w x (R^T H)`` and hold ``R^T H - L``.

Vectors are components first, (3, ...); the axis of s stages stands behind the components. Radians, kg m^2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxplan.geometry.vectors import AnyArray, array_module, arrays, cross
from jaxplan.runtime.display import shown

_MOMENTS = (3,)  # shape of an inertia that is given by the moments about the device's axes


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Stages:
    """The stages of a spacecraft that have an inertia, s of them.

    Attributes:
        frames: (s, 3, 3) body from each device's axes at zero angles, ``F``.
        inertias: (s, 3, 3) kg m^2, ``I``, in these axes.
        yaws: (s,) the joint that turns each about its yaw axis.
        pitches: (s,) the joint that lifts it; -1 for none.
        joints: number of joints of the spacecraft.
    """

    frames: AnyArray
    inertias: AnyArray
    yaws: tuple[int, ...] = field(metadata={"static": True})
    pitches: tuple[int, ...] = field(metadata={"static": True})
    joints: int = field(metadata={"static": True})

    @property
    def turned(self) -> tuple[tuple[int, ...], tuple[int, ...], int]:
        """Which joints turn the stages, and of how many; alike for stages that may share a kernel."""
        return self.yaws, self.pitches, self.joints

    @property
    def at_zero(self) -> AnyArray:
        """(3, 3) kg m^2, the sum of the inertias in body axes with all joints at zero."""
        xp, frames, inertias = arrays(self.frames, self.inertias)
        return xp.einsum("sij,sjk,slk->il", frames, inertias, frames)

    def carried(self, spin: Sequence[AnyArray], joints: Sequence[AnyArray]) -> tuple[AnyArray, ...]:
        """``sum C_k m_k`` (3, ...) N m s in body axes and, with accelerations, its derivative (3, ...) N m.

        Args:
            spin: angular velocity (3, ...) rad/s, body axes, and perhaps its derivative.
            joints: angles and rates (2n + d, ...), rad and rad/s, and perhaps accelerations.
        """
        of_each = self._of_each(spin, [self._split(own) for own in joints])
        return tuple(_summed(own) for own in of_each)

    def slopes(self, spin: Sequence[AnyArray], joints: Sequence[AnyArray]) -> "StageSlopes":
        """`carried` and its derivatives, with JAX; arguments as of `carried`, with accelerations."""
        velocity, acceleration = spin[:2]
        own = jnp.stack([jnp.stack(self._split(each)) for each in joints])  # (3, 2, s, ...)

        def stacked(velocity: AnyArray, own: AnyArray) -> AnyArray:
            of_each = self._of_each([velocity, acceleration], own)
            return jnp.stack([jnp.stack(vector) for vector in of_each])  # (2, 3, s, ...)

        def along(way: AnyArray) -> AnyArray:
            turned = jnp.broadcast_to(way[:3].reshape(3, *[1] * (velocity.ndim - 1)), velocity.shape)
            moved = jnp.broadcast_to(way[3:].reshape(3, 2, *[1] * (own.ndim - 2)), own.shape)
            return jax.jvp(stacked, (velocity, own), (turned, moved))[1]

        # What a stage carries depends on its own two joints alone, so one way serves all stages.
        slopes = jax.vmap(along)(jnp.eye(9, dtype=own.dtype))
        by_own = slopes[3:].reshape(3, 2, *slopes.shape[1:])
        which = np.array([self.yaws, self.pitches])[:, :, None] == np.arange(self.joints)  # (2, s, J)
        return StageSlopes(
            carried=jnp.sum(stacked(velocity, own), axis=2),
            by_spin=jnp.moveaxis(jnp.sum(slopes[:3], axis=3), 0, 2),
            by_joints=jnp.einsum("odtcs...,dsj->tcoj...", by_own, which.astype(own.dtype)),
        )

    def _of_each(
        self, spin: Sequence[AnyArray], joints: Sequence[tuple[AnyArray, AnyArray]]
    ) -> list[tuple[AnyArray, ...]]:
        """`carried` by each stage, components (3, s, ...); of joints' values (s, ...) of yaws and pitches."""
        at = _At.of(self, joints)
        velocity = at.inward(spin[0])
        momentum = _product(self.inertias, _sum(velocity, at.rate))
        found = [at.outward(momentum)]
        if len(spin) > 1 and len(joints) > 2:
            of_body = (
                own - swept for own, swept in zip(at.inward(spin[1]), cross(at.rate, velocity), strict=True)
            )
            own = _product(self.inertias, _sum(tuple(of_body), at.acceleration(joints[2])))
            found.append(at.outward(_sum(own, cross(at.rate, momentum))))
        return found

    def _split(self, joints: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Values (s, ...) of yaws and of pitches from those (2n + d, ...) of joints; zero of no pitch."""
        xp, values = arrays(joints)
        padded = xp.concatenate([values, xp.zeros_like(values[:1])])  # the last, by -1, for no pitch
        return padded[np.array(self.yaws)], padded[np.array(self.pitches)]


class StageSlopes(NamedTuple):
    """What stages carry, with its derivatives.

    Attributes:
        carried: (2, 3, ...) N m s and N m, see `Stages.carried`.
        by_spin: (2, 3, 3, ...) of these in the angular velocity, whose axis is the third. The first is the
            derivative of the second in the angular acceleration, too.
        by_joints: (2, 3, 3, 2n + d, ...) of these in angles, rates and accelerations of the joints.
    """

    carried: AnyArray
    by_spin: AnyArray
    by_joints: AnyArray


def stages_of(devices: Sequence[Any], terminals: int, joints: int) -> Stages | None:
    """The stages with an inertia; None where there are none.

    Args:
        devices: terminals, then drives.
        terminals: number of terminals.
        joints: number of joints.
    """
    found = []
    for number, device in enumerate(devices):
        own: tuple[tuple[Any, int, int], ...]
        if number < terminals:
            own = (device.yaw_inertia, number, -1), (device.pitch_inertia, number, terminals + number)
        else:
            own = ((device.inertia, terminals + number, -1),)
        found += [
            (device.frame, matrix_of(given), yaw, pitch) for given, yaw, pitch in own if given is not None
        ]
    if not found:
        return None
    frames, inertias, yaws, pitches = zip(*found, strict=True)
    xp = array_module(*frames, *inertias)
    return Stages(
        frames=xp.stack([xp.asarray(frame) for frame in frames]),
        inertias=xp.stack([xp.asarray(inertia) for inertia in inertias]),
        yaws=yaws,
        pitches=pitches,
        joints=joints,
    )


def matrix_of(inertia: AnyArray) -> AnyArray:
    """The matrix (3, 3) of an inertia that is given as one or by its moments (3,)."""
    _, given = arrays(inertia)
    return given[:, None] * np.eye(3) if given.shape == _MOMENTS else given


@dataclass(frozen=True, eq=False)
class _At:
    """Stages at joint angles, and the angular velocities ``g`` of these relative to the body.

    Attributes:
        stages: of the spacecraft.
        yaw: cosine and sine (s, ...) of the yaws.
        pitch: likewise.
        rates: (s, ...) rad/s, of yaws and of pitches.
        rate: (3, s, ...) components of ``g`` in stages' axes, rad/s.
    """

    stages: Stages
    yaw: tuple[AnyArray, AnyArray]
    pitch: tuple[AnyArray, AnyArray]
    rates: tuple[AnyArray, AnyArray]
    rate: tuple[AnyArray, AnyArray, AnyArray]

    @classmethod
    def of(cls, stages: Stages, joints: Sequence[tuple[AnyArray, AnyArray]]) -> "_At":
        """Stages where yaws and pitches (s, ...), with their rates, are."""
        (yaw, pitch), (yaw_rate, pitch_rate) = joints[0], joints[1]
        xp = array_module(yaw)
        lifted = xp.cos(pitch), xp.sin(pitch)
        return cls(
            stages=stages,
            yaw=(xp.cos(yaw), xp.sin(yaw)),
            pitch=lifted,
            rates=(yaw_rate, pitch_rate),
            rate=_about(lifted, yaw_rate, pitch_rate),
        )

    def acceleration(self, own: tuple[AnyArray, AnyArray]) -> tuple[AnyArray, AnyArray, AnyArray]:
        """The derivatives (3, s, ...) of the components of ``g`` in stages' axes, rad/s^2.

        `own` are the accelerations (s, ...) of yaws and pitches.
        """
        (yaw_rate, pitch_rate), (cosine, sine) = self.rates, self.pitch
        x, y, z = _about(self.pitch, *own)
        both = yaw_rate * pitch_rate
        return x + both * cosine, y, z - both * sine

    def inward(self, vector: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Vectors (3, ...) in body axes as components (3, s, ...) in stages' axes."""
        x, y, z = _product(
            array_module(self.stages.frames).swapaxes(self.stages.frames, 1, 2), vector, shared=True
        )
        (cosine, sine), (level, lift) = self.yaw, self.pitch
        x, y = cosine * x + sine * y, cosine * y - sine * x
        return level * x + lift * z, y, level * z - lift * x

    def outward(self, vector: tuple[AnyArray, ...]) -> tuple[AnyArray, ...]:
        """Vectors (3, s, ...) in stages' axes as components (3, s, ...) in body axes."""
        x, y, z = vector
        (cosine, sine), (level, lift) = self.yaw, self.pitch
        x, z = level * x - lift * z, level * z + lift * x
        x, y = cosine * x - sine * y, cosine * y + sine * x
        return _product(self.stages.frames, (x, y, z))


def _about(
    lifted: tuple[AnyArray, AnyArray], yaw: AnyArray, pitch: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """``yaw`` times the yaw axis and ``pitch`` times the pitch axis, in stages' axes at these pitches.

    The pitch axis is opposite to the left.
    """
    cosine, sine = lifted
    return yaw * sine, -pitch, yaw * cosine


def _summed(of_each: tuple[AnyArray, ...]) -> AnyArray:
    """The sums (3, ...) of the components (3, s, ...) of vectors."""
    xp = array_module(*of_each)
    return xp.stack([xp.sum(own, axis=0) for own in of_each])


def _sum(first: Sequence[AnyArray], second: Sequence[AnyArray]) -> tuple[AnyArray, ...]:
    """Sum of vectors by components."""
    return tuple(a + b for a, b in zip(first, second, strict=True))


def _product(matrices: AnyArray, vector: Any, *, shared: bool = False) -> tuple[AnyArray, ...]:
    """Matrices (s, 3, 3) times vectors (3, s, ...), or one each (3, ...) that all share."""
    own = vector[0].ndim - (not shared)
    m = matrices.reshape(*matrices.shape, *[1] * own)
    x, y, z = vector
    return tuple(m[:, i, 0] * x + m[:, i, 1] * y + m[:, i, 2] * z for i in range(3))
