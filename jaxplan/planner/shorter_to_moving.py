"""Look for shorter motions to targets that move, by durations that are given.

The shortest motion to a target that moves is found together with the instant at which it ends
(`jaxplan.planner.moving`), along one path to one goal after the other, and may stay far above its bound. A
duration that is given fixes the goal, and so all else. So durations between the bound and the shortest motion
so far are tried, each halving what is left, and the shortest in which there is a certified plan is taken.
"""

from dataclasses import replace

from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import MINIMUM, Scenario
from jaxplan.model.status import Status
from jaxplan.planner.attempts import Attempts
from jaxplan.planner.clock import Clock
from jaxplan.planner.record import Plan

_TRIES = 3  # durations; one in which there is no plan takes longer than others
_WORTHWHILE = 1.05  # times the bound; a motion that takes no longer is short enough


class Sooner:
    """The search for a shorter plan to targets that move, once there is one.

    Args:
        plan: certified, of the shortest motion.
        clock: of all attempts.

    Attributes:
        plan: the shortest so far.
        attempts: in the duration that is tried; None at the end.
    """

    def __init__(self, plan: Plan, clock: Clock) -> None:
        self.plan, self._clock = plan, clock
        self._scenario, self._left = plan.scenario, _TRIES
        self._too_short = float(plan.duration_bound or 0.0)  # s
        self.attempts: Attempts | None = None
        self._next()

    def advance(self, found: Plan) -> None:
        """Take what the attempts ended with, and begin with those in the next duration."""
        if found.ok and found.trajectory is not None:
            self.plan = replace(found, scenario=self._scenario, message="")  # which is on a given duration
        else:
            self._too_short = float(found.scenario.trajectory.duration)
        self._next()

    def _next(self) -> None:
        """Begin with the next duration, unless what was found is short enough or nothing may be tried."""
        self.attempts, trajectory = None, self.plan.trajectory
        if trajectory is None or not self._left or not self._clock.left():
            return
        if trajectory.duration <= _WORTHWHILE * self._too_short:
            return
        self._left -= 1
        middle = (self._too_short + trajectory.duration) / 2
        settings = replace(self._scenario.trajectory, duration=middle)
        self.attempts = Attempts(replace(self._scenario, trajectory=settings), self._clock)


def may_be_sooner(scenario: Scenario, plan: Plan | None) -> bool:
    """Whether shorter motions are to be looked for: a certified plan of the shortest to targets that move.

    Not where no further first guesses are asked for either.
    """
    settings, goal = scenario.trajectory, scenario.goal
    asked = settings.duration == MINIMUM and settings.first_guesses > 0
    if not asked or isinstance(goal, GivenState) or not goal.moves:
        return False
    return plan is not None and plan.status is Status.OK and plan.duration_bound is not None
