"""The moving stages of gimbals: their momentum, and the torque by which they act on the platform.

A *stage* is a part that joints turn. A terminal has two: the part that yaws without pitching, and the part
that does both; a drive has one. The inertia ``I`` of a stage is about its own centre of mass, in the device's
axes (boresight, left, yaw axis) at zero angles. The centre of mass lies on the axis that turns the stage, and
for the part that pitches on both axes. So no mass is displaced, and the inertia of the whole in body axes is

    J(q) = J_0 + sum C_k I_k C_k^T,    J_0 = J - sum F_k I_k F_k^T,

with ``C_k = F_k Z(yaw) Y(pitch)`` from the axes of stage k to body axes, ``F_k = C_k`` at zero angles, and
``J`` the inertia of the whole with all joints at zero. With the angular velocity ``w`` of the body, and
``g_k`` that of the stage relative to it, the momentum ``L`` of the whole and its derivative in body axes are

    L  = J_0 w  + sum C_k m_k,                      m_k = I_k (C_k^T w + g_k),
    L' = J_0 w' + sum C_k (m_k' + g_k x m_k),       m_k' = I_k (C_k^T w' - g_k x C_k^T w + g_k'),

where ``g_k`` and all that has the index ``k`` alone is in the stage's own axes, in which ``I_k`` is constant.
Torque from outside is ``L' + w x L``; wheels give ``L' + w x (R^T H)`` and hold ``R^T H - L``.

The first axis of an array of vectors is that of their components, (3, ...); with s stages the axis of the
stages follows it. There are 2n + d joints of n terminals and d drives. Units: rad, s, kg m^2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxplan.geometry.vectors import AnyArray, array_module, arrays, cross
from jaxplan.runtime.display import shown

_MOMENTS_SHAPE = (3,)  # shape of an inertia that is given by the moments about the device's axes


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Stages:
    """The s stages of a spacecraft that have an inertia.

    Attributes:
        frames: (s, 3, 3) rotations to body axes from each device's own at zero angles, ``F``.
        inertias: (s, 3, 3) kg m^2, ``I``, in the device's own axes.
        yaws: (s,) number of the joint that turns each stage about its yaw axis.
        pitches: (s,) number of the joint that lifts it; -1 for none.
        joints: number of joints of the spacecraft, 2n + d.
    """

    frames: AnyArray
    inertias: AnyArray
    yaws: tuple[int, ...] = field(metadata={"static": True})
    pitches: tuple[int, ...] = field(metadata={"static": True})
    joints: int = field(metadata={"static": True})

    @property
    def turned(self) -> tuple[tuple[int, ...], tuple[int, ...], int]:
        """Which joints turn the stages, and the number of joints.

        Stages of two spacecraft for which this is equal may share a compiled kernel.
        """
        return self.yaws, self.pitches, self.joints

    @property
    def at_zero(self) -> AnyArray:
        """(3, 3) kg m^2, sum of the stages' inertias in body axes with all joints at zero."""
        xp, frames, inertias = arrays(self.frames, self.inertias)
        return xp.einsum("sij,sjk,slk->il", frames, inertias, frames)

    def carried(self, spin: Sequence[AnyArray], joints: Sequence[AnyArray]) -> tuple[AnyArray, ...]:
        """Return the momentum that the stages carry, ``sum C_k m_k``, and where possible its derivative.

        Args:
            spin: angular velocity (3, ...) rad/s of the body, body axes, and perhaps its derivative.
            joints: angles and rates (2n + d, ...), rad and rad/s, and perhaps accelerations, rad/s^2.

        Returns:
            (3, ...) N m s, body axes; with both optional arguments also its derivative (3, ...) N m in body
            axes.
        """
        of_each = self._momentum_by_stage(spin, [self._split_joints(own) for own in joints])
        return tuple(_sum_over_stages(own) for own in of_each)

    def slopes(self, spin: Sequence[AnyArray], joints: Sequence[AnyArray]) -> "StageSlopes":
        """Return the results of `carried` with their derivatives, by JAX.

        Arguments are as for `carried`; angular acceleration and joint accelerations must be given.
        """
        velocity, acceleration = spin[:2]
        own = jnp.stack([jnp.stack(self._split_joints(each)) for each in joints])  # (3, 2, s, ...)

        def stacked(velocity: AnyArray, own: AnyArray) -> AnyArray:
            of_each = self._momentum_by_stage([velocity, acceleration], own)
            return jnp.stack([jnp.stack(vector) for vector in of_each])  # (2, 3, s, ...)

        def along(way: AnyArray) -> AnyArray:
            turned = jnp.broadcast_to(way[:3].reshape(3, *[1] * (velocity.ndim - 1)), velocity.shape)
            moved = jnp.broadcast_to(way[3:].reshape(3, 2, *[1] * (own.ndim - 2)), own.shape)
            return jax.jvp(stacked, (velocity, own), (turned, moved))[1]

        # What a stage carries depends on its own two joints alone, so one tangent serves all stages.
        slopes = jax.vmap(along)(jnp.eye(9, dtype=own.dtype))
        by_own = slopes[3:].reshape(3, 2, *slopes.shape[1:])
        which = np.array([self.yaws, self.pitches])[:, :, None] == np.arange(self.joints)  # (2, s, J)
        return StageSlopes(
            carried=jnp.sum(stacked(velocity, own), axis=2),
            by_spin=jnp.moveaxis(jnp.sum(slopes[:3], axis=3), 0, 2),
            by_joints=jnp.einsum("odtcs...,dsj->tcoj...", by_own, which.astype(own.dtype)),
        )

    def _momentum_by_stage(
        self, spin: Sequence[AnyArray], joints: Sequence[tuple[AnyArray, AnyArray]]
    ) -> list[tuple[AnyArray, ...]]:
        """Return the results of `carried` for each stage, as components (3, s, ...).

        Args:
            spin: as for `carried`.
            joints: from `_split_joints`, for each of angles, rates and perhaps accelerations.
        """
        at = _StageMotion.of(self, joints)
        velocity = at.inward(spin[0])
        momentum = _apply_matrices(self.inertias, _add_vectors(velocity, at.rate))
        found = [at.outward(momentum)]
        if len(spin) > 1 and len(joints) > 2:
            of_body = (
                own - swept for own, swept in zip(at.inward(spin[1]), cross(at.rate, velocity), strict=True)
            )
            own = _apply_matrices(self.inertias, _add_vectors(tuple(of_body), at.acceleration(joints[2])))
            found.append(at.outward(_add_vectors(own, cross(at.rate, momentum))))
        return found

    def _split_joints(self, joints: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Return values (s, ...) of the stages' yaws and pitches, from those (2n + d, ...) of the joints.

        The value is zero for a stage that has no pitch.
        """
        xp, values = arrays(joints)
        padded = xp.concatenate(
            [values, xp.zeros_like(values[:1])]
        )  # index -1, of a stage without pitch, finds the zero
        return padded[np.array(self.yaws)], padded[np.array(self.pitches)]


class StageSlopes(NamedTuple):
    """What stages carry, with its derivatives.

    The first axis, of 2, is that of the momentum (N m s) and its derivative with respect to time (N m). All
    are in body axes, with components on the second axis.

    Attributes:
        carried: (2, 3, ...) results of `Stages.carried`.
        by_spin: (2, 3, 3, ...) their derivatives with respect to the angular velocity, on the third axis. The
            derivative of the second result with respect to the angular acceleration equals that of the first
            with respect to the angular velocity.
        by_joints: (2, 3, 3, 2n + d, ...) their derivatives with respect to angles, rates and accelerations
            (third axis) of the joints (fourth axis).
    """

    carried: AnyArray
    by_spin: AnyArray
    by_joints: AnyArray


def stages_of(devices: Sequence[Any], terminals: int, joints: int) -> Stages | None:
    """Collect the stages that have an inertia.

    Args:
        devices: terminals, then drives.
        terminals: number of terminals.
        joints: number of joints.

    Returns:
        The stages; None if no device gives an inertia.
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
    """Return an inertia as a matrix (3, 3), given as a matrix or as its moments (3,) about the axes."""
    _, given = arrays(inertia)
    return given[:, None] * np.eye(3) if given.shape == _MOMENTS_SHAPE else given


@dataclass(frozen=True, eq=False)
class _StageMotion:
    """Stages at given joint angles and rates.

    Attributes:
        stages: the stages of the spacecraft.
        yaw: cosine and sine (s, ...) of the yaws.
        pitch: cosine and sine (s, ...) of the pitches.
        rates: (s, ...) rad/s, of yaws and of pitches.
        rate: (3, s, ...) rad/s, components in stages' axes of ``g``, their angular velocity relative to the
            body.
    """

    stages: Stages
    yaw: tuple[AnyArray, AnyArray]
    pitch: tuple[AnyArray, AnyArray]
    rates: tuple[AnyArray, AnyArray]
    rate: tuple[AnyArray, AnyArray, AnyArray]

    @classmethod
    def of(cls, stages: Stages, joints: Sequence[tuple[AnyArray, AnyArray]]) -> "_StageMotion":
        """Make it from the angles and the rates of yaws and pitches, each (s, ...)."""
        (yaw, pitch), (yaw_rate, pitch_rate) = joints[0], joints[1]
        xp = array_module(yaw)
        lifted = xp.cos(pitch), xp.sin(pitch)
        return cls(
            stages=stages,
            yaw=(xp.cos(yaw), xp.sin(yaw)),
            pitch=lifted,
            rates=(yaw_rate, pitch_rate),
            rate=_combine_joint_axes(lifted, yaw_rate, pitch_rate),
        )

    def acceleration(self, own: tuple[AnyArray, AnyArray]) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Return the derivatives (3, s, ...) rad/s^2 of the components of ``g`` in stages' axes.

        Args:
            own: accelerations (s, ...) rad/s^2 of yaws and of pitches.
        """
        (yaw_rate, pitch_rate), (cosine, sine) = self.rates, self.pitch
        x, y, z = _combine_joint_axes(self.pitch, *own)
        both = yaw_rate * pitch_rate
        return x + both * cosine, y, z - both * sine

    def inward(self, vector: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Turn vectors (3, ...) in body axes into components (3, s, ...) in the axes of each stage."""
        x, y, z = _apply_matrices(
            array_module(self.stages.frames).swapaxes(self.stages.frames, 1, 2), vector, shared=True
        )
        (cosine, sine), (level, lift) = self.yaw, self.pitch
        x, y = cosine * x + sine * y, cosine * y - sine * x
        return level * x + lift * z, y, level * z - lift * x

    def outward(self, vector: tuple[AnyArray, ...]) -> tuple[AnyArray, ...]:
        """Turn vectors (3, s, ...) in stages' axes into components (3, s, ...) in body axes."""
        x, y, z = vector
        (cosine, sine), (level, lift) = self.yaw, self.pitch
        x, z = level * x - lift * z, level * z + lift * x
        x, y = cosine * x - sine * y, cosine * y + sine * x
        return _apply_matrices(self.stages.frames, (x, y, z))


def _combine_joint_axes(
    lifted: tuple[AnyArray, AnyArray], yaw: AnyArray, pitch: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Return ``yaw`` times the yaw axis plus ``pitch`` times the pitch axis, in stages' axes.

    Args:
        lifted: cosine and sine of the pitches.
        yaw: factor of the yaw axis, such as a rate.
        pitch: factor of the pitch axis, which points to the right of the boresight.
    """
    cosine, sine = lifted
    return yaw * sine, -pitch, yaw * cosine


def _sum_over_stages(of_each: tuple[AnyArray, ...]) -> AnyArray:
    """Sum vectors, given as components (3, s, ...), over all stages, to (3, ...)."""
    xp = array_module(*of_each)
    return xp.stack([xp.sum(own, axis=0) for own in of_each])


def _add_vectors(first: Sequence[AnyArray], second: Sequence[AnyArray]) -> tuple[AnyArray, ...]:
    """Add two vectors that are given as components."""
    return tuple(a + b for a, b in zip(first, second, strict=True))


def _apply_matrices(matrices: AnyArray, vector: Any, *, shared: bool = False) -> tuple[AnyArray, ...]:
    """Multiply matrices (s, 3, 3) by vectors (3, s, ...), or if `shared` all by the same ones (3, ...)."""
    own = vector[0].ndim - (not shared)
    m = matrices.reshape(*matrices.shape, *[1] * own)
    x, y, z = vector
    return tuple(m[:, i, 0] * x + m[:, i, 1] * y + m[:, i, 2] * z for i in range(3))
