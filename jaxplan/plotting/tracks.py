"""Where the boresights of a plan look over time, with marks at start and goal and the tube about each.

Directions are unit vectors in an inertial frame or, where `Inertial` says so, in the local orbital frame.

The tube holds the errors of attitude and joints that the scenario allows for (`Scenario.robust`). On the
sphere the tube of a boresight is a band whose half width is the error of the attitude plus what errors of its
joints add; it is drawn by its two edges and a circle at either end. It holds for directions as seen in
inertial axes. Over joint angles the tube is a band of the error of joints.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from jaxplan import so3
from jaxplan.model.directions import as_path
from jaxplan.model.goals import GivenState
from jaxplan.model.path import Path
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.planner import Plan
from jaxplan.plotting.day import DayPlan
from jaxplan.plotting.frames import INERTIAL, Inertial
from jaxplan.plotting.projections import Projection, circle
from jaxplan.plotting.style import GREY, Entries, Look, device_style, motion
from jaxplan.plotting.zones import draw_line

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
NAME = "tube of errors"
_EDGE_LINE: Look = {"linewidth": 0.8, "linestyle": (0, (1, 1.4)), "zorder": 2.9}
_BAND_OPACITY = 0.22  # opacity of a band
_MIN_CHORD = 1e-9  # length of a chord below which a direction stands still
_MAX_SQUARES = 400  # most squares of which a band in a map of yaw and pitch is made


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


def radii(scenario: Scenario) -> np.ndarray:
    """Return how far each boresight may be off the plan in inertial axes, (D,) rad; 0 without errors."""
    robust, devices = scenario.robust, scenario.spacecraft.devices
    if robust is None:
        return np.zeros(len(devices))
    return np.array([float(robust.loss(one, None, inertial=True)) for one in devices])


def draw_tubes(axes: Axes, projection: Projection, scenario: Scenario, tracks: np.ndarray) -> Entries:
    """Draw tubes about the tracks (k, D, 3) of D devices; returns one legend entry, or none without tubes."""
    found = radii(scenario)
    for device, radius in enumerate(found):
        for line in edges(tracks[:, device], radius) if radius > 0 else ():
            draw_line(axes, projection, line, {"color": device_style(device)["color"], **_EDGE_LINE})
    return [(Line2D([], [], color=GREY, **_EDGE_LINE), told(found))] if np.any(found > 0) else []


def told(radii: np.ndarray | float) -> str:
    """Return the legend text of a tube: its name and its radius, or the least and largest of radii (D,), rad.

    The numbers are needed since a tube of a tenth of a degree looks the same as its track.
    """
    least, largest = (f"{np.rad2deg(own):.3g}" for own in (np.min(radii), np.max(radii)))
    return f"{NAME},\n\N{PLUS-MINUS SIGN}{least if least == largest else f'{least} to {largest}'} deg"


def edges(track: np.ndarray, radius: float) -> Iterator[np.ndarray]:
    """Yield lines (m, 3) at `radius` rad to either side of a track (k, 3), and circles about its ends.

    A track that stands still has one circle.
    """
    steps = np.diff(track, axis=0)
    moving = np.linalg.norm(steps, axis=1) > _MIN_CHORD
    places, steps = track[1:][moving], steps[moving]
    across = np.cross(places, steps)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    for side in (1, -1) if len(places) > 1 else ():
        yield np.cos(radius) * places + side * np.sin(radius) * across
    for end in track[[0, -1]] if len(places) else track[:1]:
        yield circle(end, radius)


def draw_band(axes: Axes, times: np.ndarray, values: np.ndarray, error: float, colour: str) -> None:
    """Fill the band within `error` of values (k,) over times (k,), all in the units of the axes."""
    axes.fill_between(times, values - error, values + error, color=colour, alpha=_BAND_OPACITY, linewidth=0)


def draw_squares(axes: Axes, points: np.ndarray, error: float, colour: str) -> None:
    """Fill a square of half width `error` about each of the points (k, 2), in the units of the axes."""
    own = points[np.linspace(0, len(points) - 1, min(len(points), _MAX_SQUARES)).astype(int)]
    squares = [Rectangle((x - error, y - error), 2 * error, 2 * error) for x, y in own.tolist()]
    pale = 1 - _BAND_OPACITY * (1 - np.array(to_rgb(colour)))
    axes.add_collection(PatchCollection(squares, facecolor=[pale], edgecolor="none", zorder=1.4))


def band_entry(error: float) -> Entries:
    """Return the legend entry of the band of an error, rad."""
    return [(Patch(facecolor=GREY, alpha=_BAND_OPACITY, linewidth=0), told(error))]
