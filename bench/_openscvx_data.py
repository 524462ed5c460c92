"""What goes into OpenSCvx and what comes out, in numpy and scipy: zones, first guesses and manoeuvres."""

from collections.abc import Mapping

import numpy as np
from _flight import Flight, joint_bound, rest_to_rest
from scipy.spatial.transform import Rotation, Slerp

from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario

LEISURE = 1.3  # duration of the first guess over the longer of the platform's and the joints' own times


def zones_by_terminal(scenario: Scenario) -> list[list[tuple[int, np.ndarray, float]]]:
    """For each terminal its zones: side (+1 keep out, -1 keep in), direction (3,), half-angle in rad."""
    sided = [(1, zone) for zone in scenario.keep_out] + [(-1, zone) for zone in scenario.keep_in]
    return [
        [
            (s, zone.direction, zone.half_angle)
            for s, zone in sided
            if not zone.devices or t.name in zone.devices
        ]
        for t in scenario.spacecraft.terminals
    ]


def first_duration(scenario: Scenario, goal: Goal) -> float:
    """Duration of the first guess, s: more than the joints, or a turn about a fixed axis, need alone."""
    craft = scenario.spacecraft
    start = Rotation.from_rotvec(scenario.start.rotation_vector)
    turn = (start.inv() * Rotation.from_matrix(goal.attitude)).as_rotvec()
    own = rest_to_rest(np.max(np.abs(turn)), craft.rate_limit, craft.acceleration_limit)
    return LEISURE * max(joint_bound(scenario, goal), float(own))


def first_guess(
    scenario: Scenario, goal: Goal, path: Path | None, duration: float, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """States along a path, or the straight motion, at evenly spread times.

    Args:
        scenario: says where it starts, at rest.
        goal: where it ends.
        path: None for the straight motion.
        duration: s.
        count: number of nodes.

    Returns:
        Attitudes since the start as quaternions with the scalar first (count, 4), rates
        (count, 3), joints and joint rates (count, 2n).
    """
    start = Rotation.from_rotvec(scenario.start.rotation_vector)
    if path is None:
        attitudes = np.stack([start.as_matrix(), goal.attitude])
        path = Path(
            attitudes=attitudes,
            joints=np.stack([scenario.start.joints, goal.joints]),
            edge_costs=np.ones(1),
        )
    along = np.concatenate([[0], np.cumsum(path.edge_costs)])
    along /= along[-1]
    at = np.linspace(0, 1, count)
    turns = Slerp(along, start.inv() * Rotation.from_matrix(path.attitudes))(at)
    joints = np.stack([np.interp(at, along, joint) for joint in path.joints.T], axis=-1)
    quaternions = turns.as_quat(scalar_first=True)
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0
    quaternions[1:] *= np.where(np.cumsum(flips) % 2, -1, 1)[:, None]
    quaternions *= np.sign(quaternions[0, 0])
    step = duration / (count - 1)
    edges = (turns[:-1].inv() * turns[1:]).as_rotvec() / step
    rates = np.zeros((count, 3))
    rates[1:-1] = (edges[:-1] + edges[1:]) / 2
    joint_rates = np.gradient(joints, step, axis=0)
    joint_rates[[0, -1]] = 0
    return quaternions, rates, joints, joint_rates


def flight_of(scenario: Scenario, nodes: Mapping[str, np.ndarray], *, jumps: bool) -> Flight:
    """The manoeuvre that the accelerations of an answer make, whatever its states say.

    Args:
        scenario: says where it starts.
        nodes: the answer's arrays at the nodes, by their names.
        jumps: whether accelerations are held from node to node; otherwise they are linear between nodes.
    """
    steps = nodes["_time_dilation"][:-1, 0] / (len(nodes["time"]) - 1)
    breaks = np.concatenate([[0.0], np.cumsum(steps)])
    held = np.concatenate([nodes["acceleration"], nodes["joint_accelerations"]], axis=-1)
    slopes = np.zeros_like(held[1:]) if jumps else np.diff(held, axis=0) / steps[:, None]
    first = np.concatenate([scenario.start.angular_velocity, scenario.start.joint_rates])
    gains = held[:-1] * steps[:, None] + slopes * steps[:, None] ** 2 / 2
    begins = first + np.concatenate([np.zeros((1, len(first))), np.cumsum(gains, axis=0)])

    def rates(t: np.ndarray, piece: int) -> np.ndarray:
        since = (t - breaks[piece])[:, None]
        return begins[piece] + held[piece] * since + slopes[piece] * since**2 / 2

    def accelerations(t: np.ndarray, piece: int) -> np.ndarray:
        return held[piece] + slopes[piece] * (t - breaks[piece])[:, None]

    return Flight(breaks=breaks, rates=rates, accelerations=accelerations)
