"""When the manoeuvre ends, where the goal moves while the platform is on its way to it.

In a given duration that is known. In the shortest, or one stretched to the limits, the duration depends on
the goal and the goal on the duration: fits and goals follow each other until both agree. That goes fast,
since targets turn slowly. At last the motion is fitted in just the time after which its goal is there.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from jaxplan.model.moments import known_until, moves
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import MINIMUM, GivenState, Scenario
from jaxplan.model.status import Status
from jaxplan.planner.goals import find_goals
from jaxplan.planner.record import Plan
from jaxplan.trajectory import Fit, duration_bound

_ROUNDS = 5
_SETTLED = 1e-2  # of the duration: it changes no more
_LEISURE = (1e-3, 4e-3, 1e-2, 3e-2, 1e-1)  # of the duration, beyond the shortest, one after the other
_DETOUR = 1.4  # of the bound, as a first guess of a duration
_FACTORS = (1.0, 2.0, 0.6, 4.0)  # on that, where there is no goal then

FitTo = Callable[[Scenario, Path, Goal], Fit]


@dataclass(frozen=True, kw_only=True, eq=False)
class Meeting:
    """A motion, and the goal that it meets.

    Attributes:
        fit: of step 3.
        goal: as it is when the motion ends.
        path: with this goal for its last node.
    """

    fit: Fit
    goal: Goal
    path: Path


def guesses(scenario: Scenario) -> tuple[float | None, ...]:
    """When the manoeuvre may end, s, the likeliest first: its duration alone where that is given.

    Args:
        scenario: the problem; where nothing moves it does not matter, which is None.
    """
    if not moves(scenario):
        return (None,)
    duration = scenario.trajectory.duration
    if not isinstance(duration, str):
        return (float(duration),)
    known, _ = known_until(scenario)
    found = find_goals(_at_first(scenario))
    goal = found.goal if isinstance(found, Plan) else found[0]
    if goal is None:
        guess = np.pi / scenario.spacecraft.rate_limit
    else:
        joints = np.stack([scenario.start.joints, goal.joints])
        turn = np.stack([scenario.start.attitude, goal.attitude])
        guess = _DETOUR * duration_bound(
            scenario.spacecraft, turn, joints, np.zeros((2, 3)), np.zeros(joints.shape)
        )
    return tuple(float(np.clip(factor * guess, min(1.0, known), known)) for factor in _FACTORS)


def meet(scenario: Scenario, goal: Goal, path: Path, fit: FitTo) -> Meeting:
    """A motion that ends at its goal when that is there.

    Args:
        scenario: in which something moves.
        goal: where it is after a duration that is given, or guessed.
        path: to it.
        fit: step 3 of a scenario along a path to a goal.

    Returns:
        The motion, perhaps along a path with another last node; GOAL_MISSED if none was found.
    """
    if not isinstance(scenario.trajectory.duration, str):
        return Meeting(fit=fit(scenario, path, goal), goal=goal, path=path)

    def moved(meeting: Meeting, time: float) -> Meeting | None:
        """The goal at another time, with the path to it; None if there is none any more."""
        found = find_goals(scenario, time)
        if isinstance(found, Plan):
            return None
        was = meeting.goal.attitude
        nearest = min(found, key=lambda one: float(np.linalg.norm(one.attitude - was)))
        return replace(meeting, goal=nearest, path=_ending(meeting.path, nearest))

    known, what = known_until(scenario)
    durations: list[float] = []
    now = Meeting(fit=fit(scenario, path, goal), goal=goal, path=path)
    while True:
        curve, expected = now.fit.trajectory, now.goal.time
        if curve is None or now.fit.status is Status.LIMITS_TOO_TIGHT:
            return now
        if curve.duration > known:
            return _missed(now, _unknown(what, known, curve.duration))
        if curve.duration == 0:  # it is there from the start, and need not stay
            then = moved(now, 0.0)
            return _missed(now, _lost(0.0)) if then is None else replace(then, fit=now.fit)
        durations.append(curve.duration)
        settled = abs(curve.duration - expected) <= _SETTLED * expected
        if settled or len(durations) == _ROUNDS:
            break
        then = moved(now, curve.duration)
        if then is None:
            return _missed(now, _lost(curve.duration))
        now = replace(then, fit=fit(scenario, then.path, then.goal))
    # Fits to goals near each other may differ, as by another number of intervals: then the longer of two.
    needed = durations[-1] if settled else max(durations[-2:])
    for leisure in _LEISURE:
        time = min(needed * (1 + leisure), known)
        then = moved(now, time)
        if then is None:
            return _missed(now, _lost(time))
        now = replace(then, fit=fit(_timed(scenario, time), then.path, then.goal))
        if now.fit.status is not Status.LIMITS_TOO_TIGHT:
            return now
        if time == known:
            break
    return now if settled else _missed(now, f"after {_ROUNDS} rounds fit and goal still follow each other")


def _timed(scenario: Scenario, time: float) -> Scenario:
    """The scenario with a duration that is given, and the tube of the word that it had."""
    settings = scenario.trajectory
    tube = np.inf if settings.duration == MINIMUM and settings.node_tube is None else settings.node_tube
    return replace(scenario, trajectory=replace(settings, duration=time, node_tube=tube))


def _at_first(scenario: Scenario) -> Scenario:
    """The scenario with its targets where they are at first, and no zones."""
    asked = scenario.goal
    goal = asked if isinstance(asked, GivenState) else asked.at(0.0)
    return replace(scenario, goal=goal, keep_out=(), keep_in=(), joint_bounds=())


def _ending(path: Path, goal: Goal) -> Path:
    """The path with another last node."""
    attitudes, joints = np.array(path.attitudes), np.array(path.joints)
    attitudes[-1], joints[-1] = goal.attitude, goal.joints
    return replace(path, attitudes=attitudes, joints=joints)


def _missed(meeting: Meeting, message: str) -> Meeting:
    """Without a trajectory, since there is none whose end means anything."""
    return replace(meeting, fit=Fit(trajectory=None, status=Status.GOAL_MISSED, message=message))


def _lost(time: float) -> str:
    return f"the motion takes about {time:.4g} s, and after these there is no goal any more"


def _unknown(what: str, known: float, needed: float) -> str:
    return (
        f"{what} is known until {known:g} s, and the motion takes {needed:.4g} s: "
        "give samples for longer, of [sky] a longer for_duration_s"
    )
