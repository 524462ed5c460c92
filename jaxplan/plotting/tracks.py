"""Where the boresights of a plan look over time, and the marks at start and goal of each.

Directions are unit vectors in an inertial frame or, where `Inertial` says so, in the local orbital frame.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxplan import so3
from jaxplan.model.directions import as_path
from jaxplan.model.goals import GivenState
from jaxplan.model.path import Path
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.planner import Plan
from jaxplan.plotting.day import DayPlan
from jaxplan.plotting.frames import INERTIAL, Inertial
from jaxplan.plotting.style import Look, motion

# The square is open, and the star fits into it, so that both show where a device does not move.
START_MARK: Look = {"marker": "*", "markersize": 12, "linestyle": "none", "markeredgewidth": 0.5}
END_MARK: Look = {
    "marker": "s",
    "markersize": 12,
    "linestyle": "none",
    "fillstyle": "none",
    "markeredgewidth": 1.8,
}
_TARGET_MARK: Look = {"marker": "x", "markersize": 8, "linestyle": "none", "markeredgewidth": 2}
_WISH_MARK: Look = {
    "marker": "D",
    "markersize": 7,
    "linestyle": "none",
    "fillstyle": "none",
    "markeredgewidth": 1.1,
}


def boresight_tracks(plan: Plan, frame: Inertial = INERTIAL) -> np.ndarray | None:
    """Return boresights (k, D, 3) in a frame along the trajectory, else the path; None without both."""
    if plan.trajectory is not None:
        moves = motion(plan)
        return frame.seen(moves.boresights, moves.times)
    return None if plan.path is None else path_boresights(plan.path, plan.scenario.spacecraft)


def path_boresights(path: Path, craft: Spacecraft, points_an_edge: int = 24) -> np.ndarray:
    """Return inertial boresights (k, D, 3) along a path, with `points_an_edge` points for each edge."""
    attitudes, joints, edges = path.attitudes, path.joints, path.edges
    if edges:
        places = np.linspace(0, edges, points_an_edge * edges + 1)
        edge = np.minimum(places.astype(int), edges - 1)
        part = places - edge
        attitudes = so3.geodesic(attitudes[edge], attitudes[edge + 1], part)
        joints = joints[edge] + part[:, None] * (joints[edge + 1] - joints[edge])
    return np.asarray(craft.boresights(attitudes, joints))


class Marks(NamedTuple):
    """Marks of one kind: directions (k, 3) of k devices with one look and one name in the legend."""

    look: Look
    name: str
    devices: Sequence[int]
    directions: np.ndarray


def end_marks(plan: Plan, frame: Inertial = INERTIAL) -> list[Marks]:
    """Return the marks of boresights at start and goal, of targets and of wishes that a plan has.

    Targets are marked if no goal was found, or if they name their devices, since then not every device has
    one. They and wishes are drawn where they are at the time of the goal.
    """
    scenario, goal = plan.scenario, plan.scenario.goal
    craft = scenario.spacecraft
    every = range(len(craft.device_names))
    then = frame.end(plan)
    marks = [Marks(START_MARK, "start", every, frame.seen(_given_boresights(scenario, scenario.start), 0.0))]
    if plan.goal is not None:
        points = np.asarray(craft.boresights(plan.goal.attitude, plan.goal.joints))
        word = "end" if isinstance(plan, DayPlan) else "goal"
        marks.append(Marks(END_MARK, word, every, frame.seen(points, then)))
    elif isinstance(goal, GivenState) and not isinstance(plan, DayPlan):
        marks.append(Marks(END_MARK, "goal", every, frame.seen(_given_boresights(scenario, goal), then)))
    if not isinstance(goal, GivenState):
        if plan.goal is None or goal.devices:
            targets = np.array([path.at(then) for path in goal.paths]).reshape(-1, 3)
            marks.append(Marks(_TARGET_MARK, "target", goal.numbers(craft), frame.seen(targets, then)))
        wishing = [craft.device_names.index(wish.device) for wish in goal.prefer]
        wishes = np.array([as_path(wish.direction).at(then) for wish in goal.prefer]).reshape(-1, 3)
        marks.append(Marks(_WISH_MARK, "wish", wishing, frame.seen(wishes, then)))
    return [mark for mark in marks if len(mark.directions)]


def _given_boresights(scenario: Scenario, state: GivenState) -> np.ndarray:
    """Return the inertial boresights (D, 3) of all devices in a state."""
    return np.asarray(scenario.spacecraft.boresights(state.attitude, state.joints))
