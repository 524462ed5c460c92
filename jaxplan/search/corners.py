"""Paths along straight motions between states, which are their corners.

A state is a row of ``4 + 2n`` numbers: the attitude relative to the start as a unit quaternion, and the
joints in radians. All of it is small and plain numpy.
"""

import numpy as np

from jaxplan import quaternion, so3
from jaxplan.geometry import rotations
from jaxplan.model.path import Path
from jaxplan.search.problem import Scene, steps_between

# A node this near to the goal, in steps, is the goal.
ARRIVED = 1e-9


def between(first: np.ndarray, second: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    """States (k, 4 + 2n) at fractions (k,) of straight motions."""
    states = first + fraction[:, None] * (second - first)
    states[:, :4] = np.stack(rotations.slerp(first[:, :4].T, second[:, :4].T, fraction), axis=-1)
    return states


def subdivide(scene: Scene, corners: np.ndarray) -> Path:
    """The path along straight motions between corners, cut into equal parts of at most one step.

    Args:
        scene: gives the steps, and its start and goal, which are the ends of the path to the last bit.
        corners: (k + 1, 4 + 2n) from start to goal; one alone if these are the same.
    """
    first, second = corners[:-1], corners[1:]
    rotation = quaternion.distance(first[:, :4], second[:, :4])
    costs = steps_between(scene, rotation, second[:, 4:] - first[:, 4:])
    parts = np.maximum(np.ceil(costs - ARRIVED).astype(int), 1)
    edge = np.repeat(np.arange(len(parts)), parts)
    fraction = np.concatenate([np.zeros(0), *(np.arange(1, count + 1) / count for count in parts)])
    states = np.concatenate([corners[:1], between(first[edge], second[edge], fraction)])
    attitudes, joints = scene.start_attitude @ quaternion.to_matrix(states[:, :4]), states[:, 4:]
    attitudes[0], joints[0] = scene.start_attitude, scene.start_joints
    if len(parts):
        attitudes[-1], joints[-1] = scene.goal_attitude, scene.goal_joints
    return Path(attitudes=attitudes, joints=joints, edge_costs=(costs / parts)[edge])


def make_path(scene: Scene, attitudes: np.ndarray, joints: np.ndarray) -> Path:
    """A path with the cost of its edges.

    Args:
        scene: gives the steps.
        attitudes: (m + 1, 3, 3).
        joints: (m + 1, 2n) rad.
    """
    costs = steps_between(scene, edge_rotations(attitudes), np.diff(joints, axis=0))
    return Path(attitudes=attitudes, joints=joints, edge_costs=costs)


def edge_rotations(attitudes: np.ndarray) -> np.ndarray:
    """(m,) rad, between neighbours of attitudes (m + 1, 3, 3)."""
    return np.asarray(so3.distance(attitudes[:-1], attitudes[1:]))
