"""What a search, which knows only zones that stand still, takes for those that move.

`swept`: for each a cone that holds it, or for keep-in is held by it, over the whole manoeuvre, as far as the
zone leaves start and goal clear at their own times. It guides the search; whether the motion keeps the zones
as they move is for the fit and the certificate to say.

`always`: cones of directions that are forbidden at every instant. A ring of these parts start from goal for
good, so they serve for the proof that there is no path.
"""

from dataclasses import replace

import numpy as np

from jaxplan.geometry.vectors import separation
from jaxplan.model.constraints import Constraints, pair_margins
from jaxplan.model.directions import DirectionPath
from jaxplan.model.path import Goal
from jaxplan.model.scenario import Scenario, known_until

_SMALLEST = 1e-3  # rad, of a cone, and of what it leaves
_ROOM = float(np.deg2rad(0.25))  # rad, at most left to a start or goal by a cone that is cut back for it
_BROKEN = -1e-8  # rad, a margin below which a zone does not hold


def swept(scenario: Scenario, goal: Goal, share: float = 1.0) -> Constraints:
    """The constraints with cones that stand for those that move over the manoeuvre.

    Args:
        scenario: of one in which nothing moves they are its own.
        goal: where and when the manoeuvre ends.
        share: of what zones sweep that the cones are to hold, 0 for zones as they are in the middle of it.
    """
    rows = scenario.constraints
    if not rows.paths:
        return rows
    craft, start = scenario.spacecraft, scenario.start
    sights = rows.sights(craft.mounts, craft.fixed_boresights)
    ends = []
    for time, attitude, joints in (
        (0.0, start.attitude, start.joints),
        (goal.time, goal.attitude, goal.joints),
    ):
        seen = sights.in_body(joints) @ attitude.T
        ends.append((seen, pair_margins(rows, seen, rows.axes(time))))
    axis, half_angle = np.array(rows.axis), np.array(rows.half_angle)
    for row, path in enumerate(rows.paths):
        if path is None:
            continue
        side, bound = rows.side[row], rows.bound[row]
        axis[row], reach = _swing(path, goal.time)
        half_angle[row] += side * share * reach
        for seen, margins in ends:
            margin = margins[row, bound]
            if np.all(margin >= _BROKEN):  # else another zone of its group holds there
                cut = side * separation(axis[row], seen[bound]) - np.clip(margin / 2, 0, _ROOM)
                half_angle[row] = side * min(side * half_angle[row], np.min(cut, initial=np.inf))
        half_angle[row] = np.clip(half_angle[row], _SMALLEST, np.pi - _SMALLEST)
    return replace(rows, axis=axis, half_angle=half_angle, paths=())


def always(scenario: Scenario, goal: Goal) -> Constraints:
    """The rows, and cones for what those that move forbid at every instant, where they forbid anything.

    Where the duration is to be found, that is as long as zones are known; and where targets move then, too,
    so that the goal may be elsewhere, nothing is forbidden for good.

    Args:
        scenario: of one in which nothing moves they are its own.
        goal: where and when the manoeuvre ends.
    """
    rows = scenario.constraints
    time = goal.time
    if isinstance(scenario.trajectory.duration, str):
        if scenario.goal.moves:
            return rows.part(np.zeros(len(rows.zone), bool))
        time = known_until(scenario)[0]
    if not rows.paths:
        return rows
    axis, half_angle = np.array(rows.axis), np.array(rows.half_angle)
    kept = rows.single & (rows.zone >= 0)  # no proof may use the others
    for row, path in enumerate(rows.paths):
        if path is not None:
            axis[row], reach = _swing(path, time)
            half_angle[row] -= rows.side[row] * reach
            kept[row] &= _SMALLEST < half_angle[row] < np.pi - _SMALLEST
    return replace(rows, axis=axis, half_angle=half_angle, paths=()).part(kept)


def _swing(path: DirectionPath, time: float) -> tuple[np.ndarray, float]:
    """Where an axis is in the middle of the manoeuvre, and how far it gets from there, rad."""
    axis = np.asarray(path.at(time / 2))
    return axis, path.reach(axis, 0.0, time)
