"""The least rates of the platform with which devices follow targets that move.

A boresight ``u`` follows its direction ``z`` where ``R (omega x u + y' Y x u + p' P x u) = z'``, with the
axes ``Y`` and ``P`` about which its joints turn at the rates ``y'`` and ``p'``, all vectors but ``z`` in body
axes. A terminal can do so whatever the platform's angular velocity ``omega`` is. An instrument fixes two
components of ``omega``, and a drive one, across what its joint can do; of all ``omega`` that meet these
conditions the shortest is taken, so that nothing turns about a boresight without need. Shapes: k devices with
targets, J joints.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry.vectors import length
from jaxplan.model.goals import Targets
from jaxplan.model.path import Goal
from jaxplan.model.spacecraft import Spacecraft

_RANK_TOLERANCE = 1e-9  # singular values below this share of the largest one count as zero


def least_rates(
    craft: Spacecraft, targets: Targets, state: Goal, target_rates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return rates with which devices follow their targets.

    Args:
        craft: the spacecraft.
        targets: which devices have targets.
        state: attitude and joints at which these devices point along their targets.
        target_rates: (k, 3) 1/s, time derivatives of the inertial directions of k targets.

    Returns:
        (3,) angular velocity, rad/s, body axes, and (J,) joint rates, rad/s; those of other devices are zero.
    """
    gimbals, numbers = craft.gimbals, targets.numbers(craft)
    attitude, joints = np.asarray(state.attitude, float), np.asarray(state.joints, float)
    turned = np.asarray(target_rates, float).reshape(-1, 3) @ attitude  # in body axes
    azimuth, _ = gimbals.angles(joints)
    boresights = np.concatenate([gimbals.boresights(joints), craft.fixed_boresights])
    matrix, right = [np.zeros((0, 3))], [np.zeros(0)]
    by_joints = {}
    for number, rate in zip(numbers, turned, strict=True):
        beam = boresights[number]
        across = np.linalg.svd(beam[None])[2][1:]  # (2, 3), how a direction can change
        if number < gimbals.count:
            axes = np.concatenate(gimbals.axes(azimuth[[number]], np.array([number])))
            axes = axes[: 2 if number < gimbals.terminals else 1]
            by_joints[number] = np.cross(axes, beam)
            across = _uncontrolled_directions(across, by_joints[number])
        # (omega x u) . c = omega . (u x c)
        matrix.append(np.cross(beam, across))
        right.append(across @ rate)
    spin = np.linalg.pinv(np.concatenate(matrix), rcond=_RANK_TOLERANCE) @ np.concatenate(right)
    rates = np.zeros(len(joints))
    for number, rate in zip(numbers, turned, strict=True):
        if number in by_joints:
            left = rate - np.cross(spin, boresights[number])
            own = [gimbals.yaws[number], *gimbals.pitches[number : number + 1]]
            rates[own] = np.linalg.pinv(by_joints[number].T, rcond=_RANK_TOLERANCE) @ left
    return spin, rates


def differentiable_rates(
    craft: Spacecraft, targets: Targets, attitude: Array, joints: Array, target_rates: Array
) -> tuple[Array, Array]:
    """Return the rates of `least_rates` as JAX arrays, with derivatives.

    Args:
        craft: the spacecraft.
        targets: which devices have targets.
        attitude: (3, 3) body to inertial, at which these devices point along their targets.
        joints: (J,) rad, likewise.
        target_rates: (k, 3) 1/s, time derivatives of the inertial directions of k targets.

    Returns:
        (3,) angular velocity, rad/s, body axes, and (J,) joint rates, rad/s. The rates of a terminal that
        points along its yaw axis are NaN or infinite.
    """
    gimbals = craft.gimbals
    turned = jnp.asarray(target_rates).reshape(-1, 3) @ attitude  # in body axes
    azimuth, _ = gimbals.angles(joints)
    fixed = jnp.asarray(craft.fixed_boresights, turned.dtype)
    boresights = jnp.concatenate([gimbals.boresights(joints), fixed])
    matrix, right = [jnp.zeros((0, 3))], [jnp.zeros(0)]
    by_joints: dict[int, Any] = {}
    for number, rate in zip(targets.numbers(craft), turned, strict=True):
        beam = boresights[number]
        across = jnp.zeros((0, 3))
        if number < gimbals.count:
            axes = jnp.concatenate(gimbals.axes(azimuth[np.array([number])], np.array([number])))
            axes = axes[: 2 if number < gimbals.terminals else 1]
            by_joints[number] = jnp.cross(axes, beam)  # at right angles to each other
            if number >= gimbals.terminals:
                across = _normalise(jnp.cross(beam, by_joints[number][0]))[None]
        else:
            first = _normalise(jnp.cross(beam, jnp.eye(3)[jnp.argmin(jnp.abs(beam))]))
            across = jnp.stack([first, jnp.cross(beam, first)])
        matrix.append(jnp.cross(beam, across))
        right.append(across @ rate)
    rows, spin = jnp.concatenate(matrix), jnp.zeros(3)
    if len(rows):
        spin = jnp.linalg.pinv(rows, rtol=_RANK_TOLERANCE) @ jnp.concatenate(right)
    rates = jnp.zeros(joints.shape)
    for number, rate in zip(targets.numbers(craft), turned, strict=True):
        if number in by_joints:
            left = rate - jnp.cross(spin, boresights[number])
            moved = by_joints[number]
            rates = rates.at[gimbals.joints_of(number)].set(moved @ left / jnp.sum(moved**2, axis=1))
    return spin, rates


def _normalise(vector: Array) -> Array:
    """Return a vector (3,) brought to unit length."""
    return jnp.asarray(vector / length(vector))


def _uncontrolled_directions(directions: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Return a basis of the part of a plane in which joints cannot move a beam: c orthonormal rows (c, 3).

    Args:
        directions: (2, 3) orthonormal vectors that span the plane across the beam.
        moved: (j, 3) derivatives of the beam by the j joints.
    """
    across = directions @ moved.T
    _, sizes, own = np.linalg.svd(across.T)
    rank = int(np.sum(sizes > _RANK_TOLERANCE * max(float(np.max(sizes, initial=0.0)), _RANK_TOLERANCE)))
    return np.asarray(own[rank:] @ directions)
