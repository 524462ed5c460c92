"""Look for shorter motions to targets that move, by trying given durations.

The shortest motion to a moving target is found together with the instant at which it ends
(`jaxplan.planner.moving`), along one path to one goal after the other, and may stay far above the lower
bound. A given duration fixes the goal, and with it all else. So durations between the bound and the shortest
motion so far are tried, each in the middle of what is left, and the shortest with a certified plan is taken.
"""

from dataclasses import replace

from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import MINIMUM, Scenario
from jaxplan.model.status import Status
from jaxplan.planner.attempts import Attempts
from jaxplan.planner.clock import Clock
from jaxplan.planner.record import Plan

_MAX_TRIES = 3  # durations to try; one in which there is no plan takes longer to compute
_SHORT_ENOUGH_RATIO = 1.05  # times the longest duration known as too short, up to which it is short enough


class Sooner:
    """The search for a shorter plan to moving targets, once there is one.

    Args:
        plan: a certified plan of the shortest motion.
        clock: counts the computation time of all attempts.

    Attributes:
        plan: the shortest certified plan so far.
        attempts: those in the duration that is being tried; None at the end.
    """

    def __init__(self, plan: Plan, clock: Clock) -> None:
        self.plan, self._clock = plan, clock
        self._scenario, self._tries_left = plan.scenario, _MAX_TRIES
        self._too_short_duration = float(plan.duration_bound or 0.0)  # s
        self.attempts: Attempts | None = None
        self._try_next_duration()

    def advance(self, found: Plan) -> None:
        """Take the plan with which the attempts ended, and begin attempts in the next duration."""
        if found.ok and found.trajectory is not None:
            self.plan = replace(found, scenario=self._scenario, message="")  # which is on a given duration
        else:
            self._too_short_duration = float(found.scenario.trajectory.duration)
        self._try_next_duration()

    def _try_next_duration(self) -> None:
        """Begin attempts in the next duration.

        `attempts` is None if the plan is short enough, or no tries or time are left.
        """
        self.attempts, trajectory = None, self.plan.trajectory
        if trajectory is None or not self._tries_left or not self._clock.left():
            return
        if trajectory.duration <= _SHORT_ENOUGH_RATIO * self._too_short_duration:
            return
        self._tries_left -= 1
        middle = (self._too_short_duration + trajectory.duration) / 2
        settings = replace(self._scenario.trajectory, duration=middle)
        self.attempts = Attempts(replace(self._scenario, trajectory=settings), self._clock)


def may_be_sooner(scenario: Scenario, plan: Plan | None) -> bool:
    """Tell whether to look for shorter motions than a plan's, which must be certified and to moving targets.

    The duration must be "minimum", and `first_guesses` at least 1.
    """
    settings, goal = scenario.trajectory, scenario.goal
    asked = settings.duration == MINIMUM and settings.first_guesses > 0
    if not asked or isinstance(goal, GivenState) or not goal.moves:
        return False
    return plan is not None and plan.status is Status.OK and plan.duration_bound is not None
