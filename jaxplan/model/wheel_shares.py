"""What each wheel of an array gives and holds, wheel by wheel.

By the pseudo-inverse that is a row of the array (`jaxplan.model.wheels`). By the envelope it is the
distribution in which the largest ratio of a wheel's part to its limit is least, for torque and momentum
separately: the least ``s`` with ``x = sum a_k u_k`` and ``|u_k| <= s limit_k`` (Markley, Reynolds, Liu and
Lebsock, "Maximum torque and momentum envelopes for reaction wheel arrays", NASA 20110015369). It needs no
linear program: ``s`` is that of the face ``f`` of the envelope which ``x`` comes nearest to. Every wheel
whose axis is not in the plane of the face works at ``s`` of its limit, on the side of ``f``. The rest of
``x`` lies in the plane, and is distributed in the same way: all wheels in the plane work at the ratio of the
line which the rest comes nearest to, except those along that line, which take what is left.
"""

import numpy as np

from jaxplan.model.kinematics import Kinematics
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import PSEUDO_INVERSE, least_shares

_ORTHOGONALITY_TOLERANCE = 1e-9  # product of unit vectors below which they count as at right angles


def wheel_loads(motion: Kinematics, craft: Spacecraft) -> tuple[np.ndarray, np.ndarray]:
    """Return the torques (n, ...) N m and momenta (n, ...) N m s of the n wheels, positive about their axes.

    Args:
        motion: the motion, with inertia, total momentum and array of wheels; of numpy arrays.
        craft: the spacecraft.

    Raises:
        ValueError: if there are no wheels.
    """
    array = motion.array
    if array is None or motion.total is None:
        raise ValueError("without wheels they give and hold nothing")
    if craft.allocation == PSEUDO_INVERSE:
        return np.asarray(motion.wheel_torques), np.asarray(motion.wheel_momenta)
    given, held = np.asarray(motion.torque), np.asarray(motion.total - motion.momentum)
    parts = ((given, array.each_torque), (held, array.each_momentum))
    torque, momentum = (shared_out(array.axes, limit, vectors) for vectors, limit in parts)
    return torque, momentum


def shared_out(axes: np.ndarray, limit: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Distribute vectors over wheels so that the largest ratio of a wheel's part to its limit is least.

    Args:
        axes: (n, 3) unit vectors that span space, the wheels' axes.
        limit: (n,) positive limits of the wheels.
        vectors: (3, ...) in the unit of the limits.

    Returns:
        (n, ...) the part of each wheel, along its axis; the parts add up to the vectors.
    """
    x = np.moveaxis(vectors, 0, -1).reshape(-1, 3)
    share, face = least_shares(axes, limit, x)
    side = face @ axes.T  # (k, n)
    within = np.abs(side) <= _ORTHOGONALITY_TOLERANCE
    found = np.where(within, 0, np.sign(side) * share[:, None] * limit)
    rest = x - found @ axes
    lines = np.cross(face[:, None], axes)  # (k, n, 3), in the plane and across each wheel of it
    reach = np.abs(np.einsum("kni,mi->knm", lines, axes)) * within[:, None] @ limit
    shares = np.where(within, np.einsum("kni,ki->kn", lines, rest) / np.where(reach > 0, reach, 1), 0)
    own = np.argmax(np.where(within, np.abs(shares), -1), axis=1)
    each = np.arange(len(x))
    share, line = shares[each, own], lines[each, own]
    side = line @ axes.T
    along = within & (np.abs(side) <= _ORTHOGONALITY_TOLERANCE)
    found += np.where(within & ~along, np.sign(side) * share[:, None] * limit, 0)
    rest = x - found @ axes
    chosen = axes[own]
    turned = np.where(along, np.sign(chosen @ axes.T), 0) * limit
    found += turned * (np.sum(rest * chosen, axis=1) / np.abs(turned).sum(axis=1))[:, None]
    return np.moveaxis(found.reshape(*np.moveaxis(vectors, 0, -1).shape[:-1], len(axes)), -1, 0)
