"""Gimbals whose stages have an inertia, for tests, and their momentum by plain numpy and scipy."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

import jaxplan as jp

STEP = 1e-2  # s


def random_inertia(rng, size):
    """An inertia (3, 3) that a body can have, of a size in kg m^2, about axes of its own."""
    turn = Rotation.random(rng=rng).as_matrix()
    shares = rng.uniform(0.2, 1, 3)
    return (
        size * turn @ np.diag([shares[1] + shares[2], shares[0] + shares[2], shares[0] + shares[1]]) @ turn.T
    )


def with_stages(craft, size, seed=0, drives=True):
    """A spacecraft whose stages all have random inertias of a size in kg m^2."""
    rng = np.random.default_rng(seed)
    return replace(
        craft,
        terminals=tuple(
            replace(one, yaw_inertia=random_inertia(rng, size), pitch_inertia=random_inertia(rng, size))
            for one in craft.terminals
        ),
        drives=tuple(
            replace(one, inertia=random_inertia(rng, size)) if drives else one for one in craft.drives
        ),
    )


def frames_of(craft):
    """Columns (3, 3) boresight, left, axis in body axes of terminals, then of drives, by plain numpy."""
    found = []
    for device in (*craft.terminals, *craft.drives):
        if isinstance(device, jp.Drive):
            axis, ahead = np.asarray(device.axis), np.asarray(device.boresight)
        elif device.mounting is None:
            axis, ahead = np.array([0.0, 0, 1]), np.array([np.cos(device.mount), np.sin(device.mount), 0])
        else:
            axis, ahead = np.asarray(device.mounting.yaw_axis), np.asarray(device.mounting.boresight)
        axis = axis / np.linalg.norm(axis)
        ahead = ahead - (ahead @ axis) * axis
        ahead = ahead / np.linalg.norm(ahead)
        found.append(np.column_stack([ahead, np.cross(axis, ahead), axis]))
    return found


def parts(craft):
    """Yield of each stage its frame (3, 3) and inertia (3, 3), and its yaw and pitch, or None, by number."""
    n = len(craft.terminals)
    frames = frames_of(craft)
    for k, (one, frame) in enumerate(zip(craft.terminals, frames, strict=False)):
        for inertia, pitch in ((one.yaw_inertia, None), (one.pitch_inertia, n + k)):
            if inertia is not None:
                yield frame, _matrix(inertia), k, pitch
    for k, (one, frame) in enumerate(zip(craft.drives, frames[n:], strict=True)):
        if one.inertia is not None:
            yield frame, _matrix(one.inertia), 2 * n + k, None


def _matrix(inertia):
    inertia = np.asarray(inertia)
    return np.diag(inertia) if inertia.ndim == 1 else inertia


def momentum(craft, velocity, joints, rates):
    """Momentum (k, 3) N m s of the whole in body axes, of velocities (k, 3), joints and rates (k, J)."""
    inertia = np.asarray(craft.inertia)
    found = velocity @ inertia.T
    for frame, own, yaw, pitch in parts(craft):
        found = found - velocity @ (frame @ own @ frame.T).T
        turn = Rotation.from_rotvec(joints[:, yaw, None] * frame[:, 2])
        spin = rates[:, yaw, None] * frame[:, 2]
        if pitch is not None:
            about = turn.apply(-frame[:, 1])
            turn = turn * Rotation.from_rotvec(joints[:, pitch, None] * -frame[:, 1])
            spin = spin + rates[:, pitch, None] * about
        at = turn.as_matrix() @ frame
        found = found + np.einsum("kij,jl,kml,km->ki", at, own, at, velocity + spin)
    return found


def change(craft, spin, joints):
    """Derivative (k, 3) N m of `momentum` in body axes, by differences of eighth order.

    Args:
        spin: angular velocities and accelerations (k, 3).
        joints: angles, rates and accelerations (k, J).
    """

    def at(step):
        angles = joints[0] + step * joints[1] + step**2 / 2 * joints[2]
        return momentum(craft, spin[0] + step * spin[1], angles, joints[1] + step * joints[2])

    weights = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
    return sum(w * (at(k * STEP) - at(-k * STEP)) for k, w in enumerate(weights, 1)) / STEP


def motion(trajectory, craft, time):
    """Momentum (k, 3) N m s of the whole in body axes, and its derivative there (k, 3) N m, at times (k,)."""
    samples = trajectory.sample(np.minimum(time, trajectory.duration))
    spin = samples.angular_velocity, samples.angular_acceleration
    joints = samples.joints, samples.joint_rates, samples.joint_accelerations
    return momentum(craft, spin[0], *joints[:2]), change(craft, spin, joints), samples


def torque(trajectory, craft, time):
    """Torque (k, 3) N m that something from outside gives, body axes, at times (k,)."""
    own, rising, samples = motion(trajectory, craft, time)
    return rising + np.cross(samples.angular_velocity, own)


def exchanged(trajectory, craft, time):
    """The wheels' torque on the body (k, 3) N m and their momentum (k, 3) N m s, body axes, at times (k,)."""
    own, rising, samples = motion(trajectory, craft, time)
    stored = sum(wheel.stored * np.asarray(wheel.axis) for wheel in craft.wheels)
    first, _, start = motion(trajectory, craft, np.zeros(1))
    carried = np.einsum("kji,j->ki", samples.attitude, start.attitude[0] @ (first[0] + stored))
    return rising + np.cross(samples.angular_velocity, carried), carried - own
