"""What a path is judged by, the same for every planner: its length, and its margins found in two ways."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from jaxplan.model.path import Path
from jaxplan.search import Scene
from jaxplan.study.printed_planners import TOLERANCE, least_margins

SAMPLES = 64  # intervals into which an edge is cut, which is at most one step long


@dataclass(frozen=True, kw_only=True)
class Measures:
    """A path in numbers.

    Attributes:
        steps: length in steps, `jaxplan.model.path.step_cost`.
        travel: rotation of the platform and changes of all joints summed, rad.
        edges: their number, each at most one step long.
        below: number of edges whose margin is below zero by the bound of `jaxplan.model.path.edge_margins`.
        below_sampled: likewise by dense samples.
        margin: the least, by the bound, rad.
    """

    steps: float
    travel: float
    edges: int
    below: int
    below_sampled: int
    margin: float


def measure(scene: Scene, path: Path) -> Measures:
    """Measure a path of a search problem."""
    bounds, sampled = least_margins(scene, path), sampled_margins(scene, path)
    turns = Rotation.from_matrix(path.attitudes)
    rotation = (turns[:-1].inv() * turns[1:]).magnitude()
    return Measures(
        steps=path.length,
        travel=float(np.sum(rotation) + np.sum(np.abs(np.diff(path.joints, axis=0)))),
        edges=path.edges,
        below=int(np.sum(~(bounds >= -TOLERANCE))),
        below_sampled=int(np.sum(~(sampled >= -TOLERANCE))),
        margin=float(np.min(bounds)),
    )


def straight_lengths(scene: Scene) -> tuple[float, float]:
    """Length in steps and travel, rad, of the straight motion from start to goal, which no path undercuts."""
    change = np.abs(scene.goal_joints - scene.start_joints)
    return scene.straight_steps, float(np.linalg.norm(scene.goal_coordinates) + np.sum(change))


def sampled_margins(scene: Scene, path: Path) -> np.ndarray:
    """Least margin (m,) rad of each edge at `SAMPLES` + 1 states, in numpy and scipy alone.

    Raises:
        ValueError: for instruments and zones in groups.
    """
    if np.any(scene.grouped_cones.bound) or len(scene.fixed_boresights):
        raise ValueError("zones in groups and instruments are not sampled")
    part = np.linspace(0, 1, SAMPLES + 1)
    turns = Rotation.from_matrix(path.attitudes)
    vectors = (turns[:-1].inv() * turns[1:]).as_rotvec()
    steps = Rotation.from_rotvec((part[:, None, None] * vectors).reshape(-1, 3)).as_matrix()
    attitudes = path.attitudes[:-1] @ steps.reshape(SAMPLES + 1, -1, 3, 3)  # (samples, m, 3, 3)
    joints = path.joints[:-1] + part[:, None, None] * np.diff(path.joints, axis=0)
    yaw, pitch = np.split(joints, 2, axis=-1)
    own = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=-1)
    body = np.einsum("gij,...gj->...gi", scene.gimbals.frames, own)
    inertial = body @ np.swapaxes(attitudes, -1, -2)  # (samples, m, n, 3)
    cones = scene.cones
    angles = np.arccos(np.clip(inertial @ cones.axis.T, -1, 1))  # (samples, m, n, Z)
    margins = np.where(cones.bound.T, cones.side * (angles - cones.half_angle), np.inf)
    return np.min(margins, axis=(0, 2, 3), initial=np.inf)
