"""Zones and targets that move, for stages that see none: still cones that hold theirs, rates at arrival.

What a search takes for zones that move, which itself knows only zones that stand still.

`swept`: for each a cone that holds it, or for keep-in is held by it, over the whole manoeuvre, as far as the
zone leaves start and goal clear at their own times. It guides the search; whether the motion keeps the zones
as they move is for the fit and the certificate to say.

`always`: cones of directions that are forbidden at every instant. A ring of these parts start from goal for
good, so they serve for the proof that there is no path.

Whether a goal meets targets that move: when the manoeuvre ends, along their directions and at their rates.

It is plain numpy, from equation (13) and the derivative of ``p = R v(q)``, ``p' = R (omega x v + v_q q')``;
of what finds goals nothing is used.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jaxplan.geometry.vectors import outward, separation, slopes
from jaxplan.model.constraints import Constraints, pair_margins
from jaxplan.model.directions import DirectionPath
from jaxplan.model.path import Goal
from jaxplan.model.scenario import GivenState, Scenario, known_until, moves
from jaxplan.trajectory import Trajectory

_SMALLEST = 1e-3  # rad, of a cone, and of what it leaves
_ROOM = float(np.deg2rad(0.25))  # at most left to a start or goal by a cone that is cut back for it
_BROKEN = -1e-8  # rad, a margin


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


# What a beam may be off its target, rad, and its rate, rad/s; the certificate allows as much of the ends.
TOLERANCE = 1e-8
_SAME_TIME = 1e-12


def arrival_faults(scenario: Scenario, goal: Goal, trajectory: Trajectory) -> tuple[str, ...]:
    """A sentence for each way in which a goal is not where its moving targets are.

    Args:
        scenario: what is asked; of one in which nothing moves nothing is wrong here.
        goal: of the manoeuvre.
        trajectory: that goes there.
    """
    if not moves(scenario):
        return ()
    return tuple(_faults(scenario, goal, trajectory.duration))


def _faults(scenario: Scenario, goal: Goal, duration: float) -> Iterator[str]:
    if not abs(goal.time - duration) <= _SAME_TIME * max(duration, 1.0):
        yield f"the goal is one at {goal.time:.6g} s, the trajectory ends at {duration:.6g} s"
    asked = scenario.goal
    if isinstance(asked, GivenState) or not asked.moves:
        return
    if goal.angular_velocity is None or goal.joint_rates is None:
        yield "the goal has no rates, though targets move"
        return
    if not 0 <= goal.time <= known_until(scenario)[0]:
        yield f"the targets are not known at {goal.time:.6g} s, the time of the goal"
        return
    beams, rates = beam_motion(scenario, goal)
    apart = np.linalg.norm(beams - asked.at(goal.time).directions, axis=-1)
    slip = np.linalg.norm(rates - asked.rates(goal.time), axis=-1)
    for terminal, off, too_fast in zip(scenario.spacecraft.terminals, apart, slip, strict=True):
        if not off <= TOLERANCE:
            yield f"at the goal {terminal.name} points {off:.3g} rad off its moving target"
        if not too_fast <= TOLERANCE:
            yield f"at the goal {terminal.name} turns {too_fast:.3g} rad/s otherwise than its moving target"


def beam_motion(scenario: Scenario, goal: Goal) -> tuple[np.ndarray, np.ndarray]:
    """Directions (n, 3) of the terminals' beams at a goal with rates, inertial, and theirs (n, 3), 1/s."""
    assert goal.angular_velocity is not None
    yaw, pitch = np.split(np.asarray(goal.joints, float), 2)
    yaw_rate, pitch_rate = (part[:, None] for part in np.split(np.asarray(goal.joint_rates, float), 2))
    azimuth = yaw + scenario.spacecraft.mounts
    circles = np.cos(azimuth), np.sin(azimuth), np.cos(pitch), np.sin(pitch)
    body, by_yaw, by_pitch = (np.stack(one, axis=-1) for one in (outward(*circles), *slopes(*circles)))
    moving = np.cross(goal.angular_velocity, body) + yaw_rate * by_yaw + pitch_rate * by_pitch
    return body @ goal.attitude.T, moving @ goal.attitude.T
