"""Whether a goal meets targets that move: when the manoeuvre ends, along their directions and at their rates.

It is plain numpy, from equation (13) and the derivative of ``p = R v(q)``, ``p' = R (omega x v + v_q q')``;
of what finds goals nothing is used.
"""

from collections.abc import Iterator

import numpy as np

from jaxplan.geometry.directions import outward, slopes
from jaxplan.model.moments import known_until, moves
from jaxplan.model.path import Goal
from jaxplan.model.scenario import GivenState, Scenario
from jaxplan.trajectory import Trajectory

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
