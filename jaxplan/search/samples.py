"""Random states for the planners that grow trees: uniform, or such that terminals are held.

A state is a row of ``4 + 2n`` numbers: the attitude relative to the start as a unit quaternion, and the
joints.
"""

import numpy as np

from jaxplan import quaternion
from jaxplan.model.spacecraft import joints_toward
from jaxplan.search.problem import Scene

# States of which one is taken, where terminals are to be held.
CANDIDATES = 32


def draw(scene: Scene, rng: np.random.Generator, count: int) -> np.ndarray:
    """Random states, uniform on SO(3) times the box of the joints.

    Where terminals are held, which few states satisfy, every second state is chosen among `CANDIDATES`: the
    one whose held terminals can best be turned onto the axes of their cones, and are. The others
    remain, so that no part of the space is left out.

    Args:
        scene: the problem.
        rng: where the numbers come from.
        count: of states.

    Returns:
        (count, 4 + 2n).
    """
    states = _uniform(scene, rng, count)
    if np.any(scene.held) and count > 1:
        candidates = _uniform(scene, rng, count // 2 * CANDIDATES)
        excess = _turn_to_hold(scene, candidates).reshape(-1, CANDIDATES)
        states[1::2] = candidates.reshape(*excess.shape, -1)[np.arange(len(excess)), excess.argmin(axis=1)]
    return states


def _uniform(scene: Scene, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 4 + 2n)."""
    turns = rng.standard_normal((count, 4))
    turns /= np.sqrt(np.sum(turns * turns, axis=1, keepdims=True))
    limits = scene.joint_limits
    return np.concatenate([turns, rng.uniform(-1.0, 1.0, (count, len(limits))) * limits], axis=1)


def _turn_to_hold(scene: Scene, states: np.ndarray) -> np.ndarray:
    """Turn the held terminals of states (k, 4 + 2n) onto their cones' axes, within the limits.

    Returns:
        (k,) rad by which the limits would have been broken.
    """
    held = np.flatnonzero(scene.held)
    axes = scene.held_axes[held] @ scene.start_attitude
    joints = joints_toward(scene.mounts[held], quaternion.to_matrix(states[:, :4]), axes)
    places = np.concatenate([held, held + len(scene.mounts)])
    limits = scene.joint_limits[places]
    inside = np.maximum(np.minimum(joints, limits), -limits)
    states[:, 4 + places] = inside
    return np.max(np.abs(joints - inside), axis=1)
