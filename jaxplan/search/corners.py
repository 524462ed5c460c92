"""Paths along straight motions between states, which are their corners.

A state is a row of ``4 + 2n`` numbers: the attitude relative to the start as a unit quaternion, and the
joints in radians. All of it is small and plain numpy.
"""

import numpy as np

from jaxplan.path import Path
from jaxplan.search.problem import Scene, steps_between

# A node this near to the goal, in steps, is the goal.
ARRIVED = 1e-9


def between(first: np.ndarray, second: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    """States (k, 4 + 2n) at fractions (k,) of straight motions."""
    part = fraction[:, None]
    states = first + part * (second - first)
    start, end = first[:, :4], second[:, :4]
    end = np.where(np.sum(start * end, axis=1, keepdims=True) < 0, -end, end)
    half = half_turn(start, end)[:, None]
    sine = np.sin(half)
    small = sine < 1e-6  # where a straight line in quaternions is as good
    divisor = np.where(small, 1.0, sine)
    before = np.where(small, 1 - part, np.sin((1 - part) * half) / divisor)
    after = np.where(small, part, np.sin(part * half) / divisor)
    turned = before * start + after * end
    states[:, :4] = turned / np.sqrt(np.sum(turned * turned, axis=1, keepdims=True))
    return states


def half_turn(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(...) rad, half the rotation between unit quaternions (..., 4), at most pi / 2."""
    apart, sum_ = first - second, first + second
    chord = np.minimum(np.sum(apart * apart, axis=-1), np.sum(sum_ * sum_, axis=-1))
    return 2 * np.arcsin(np.minimum(np.sqrt(chord) / 2, 1.0))


def subdivide(scene: Scene, corners: np.ndarray) -> Path:
    """The path along straight motions between corners, cut into equal parts of at most one step.

    Args:
        scene: gives the steps, and its start and goal, which are the ends of the path to the last bit.
        corners: (k + 1, 4 + 2n) from start to goal; one alone if these are the same.
    """
    first, second = corners[:-1], corners[1:]
    rotation = 2 * half_turn(first[:, :4], second[:, :4])
    costs = steps_between(scene, rotation, second[:, 4:] - first[:, 4:])
    parts = np.maximum(np.ceil(costs - ARRIVED).astype(int), 1)
    edge = np.repeat(np.arange(len(parts)), parts)
    fraction = np.concatenate([np.zeros(0), *(np.arange(1, count + 1) / count for count in parts)])
    states = np.concatenate([corners[:1], between(first[edge], second[edge], fraction)])
    attitudes, joints = scene.start_attitude @ _matrices(states[:, :4]), states[:, 4:]
    attitudes[0], joints[0] = scene.start_attitude, scene.start_joints
    if len(parts):
        attitudes[-1], joints[-1] = scene.goal_attitude, scene.goal_joints
    return Path(attitudes=attitudes, joints=joints, edge_costs=(costs / parts)[edge])


def _matrices(quaternions: np.ndarray) -> np.ndarray:
    """(k, 3, 3) of unit quaternions (k, 4), `jaxplan.quaternion.to_matrix` in numpy."""
    w, x, y, z = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def make_path(scene: Scene, attitudes: np.ndarray, joints: np.ndarray) -> Path:
    """A path with the cost of its edges.

    Args:
        scene: gives the steps.
        attitudes: (m + 1, 3, 3).
        joints: (m + 1, 2n) rad.
    """
    costs = steps_between(scene, rotations(attitudes), np.diff(joints, axis=0))
    return Path(attitudes=attitudes, joints=joints, edge_costs=costs)


def rotations(attitudes: np.ndarray) -> np.ndarray:
    """(m,) rad, between neighbours of attitudes (m + 1, 3, 3)."""
    chord = np.linalg.norm(np.diff(attitudes, axis=0), axis=(1, 2))  # 2 sqrt(2) sin(rotation / 2)
    return 2 * np.arcsin(np.minimum(chord / np.sqrt(8), 1))
