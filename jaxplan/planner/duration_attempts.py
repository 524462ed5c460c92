"""Attempts at a plan in a given duration: of one that was asked for, and of shorter ones to moving targets.

A duration may be too short for the nearest goal, or along the path that was found, and yet long enough for
the manoeuvre. So where it is found too short, the shortest manoeuvre is planned as well, to a goal of least
time unless the scenario names another criterion. If that fits into the given duration, the plan follows its
path. Else the message says which longer duration has a certified plan. This is done with the method "global"
where nothing moves: if something moves, goals and durations depend on each other
(`jaxplan.planner.moving`), and the paper's method has no shortest motion, so the first answer stands.

The shortest motion to a moving target is found together with the instant at which it ends
(`jaxplan.planner.moving`), along one path to one goal after the other, and may stay far above the lower
bound. A given duration fixes the goal, and with it all else. So durations between the bound and the shortest
motion so far are tried, each in the middle of what is left, and the shortest with a certified plan is taken.
"""

from dataclasses import replace

import numpy as np

from jaxplan.model.goals import LEAST_TIME, GivenState
from jaxplan.model.hidden_spans import rounded_up
from jaxplan.model.scenario import MINIMUM, Scenario, moves
from jaxplan.model.status import Status
from jaxplan.planner import messages
from jaxplan.planner.attempts import Attempts
from jaxplan.planner.clock import Clock
from jaxplan.planner.nearest_goal import shorter_of, to_the_nearest
from jaxplan.planner.record import Plan, end_rates
from jaxplan.planner.tube_room import with_advice

# Outcomes after which another goal, or another path, may give a plan in the same time.
_PERHAPS_TOO_SHORT = (
    Status.LIMITS_TOO_TIGHT,
    Status.GOAL_UNREACHABLE,
    Status.INFEASIBLE,
    Status.UNCERTIFIED,
)
_DURATION_SLACKS = (0.0, 1e-3, 4e-3, 1e-2, 3e-2, 1e-1)
"""Shares of the shortest time that are added to it in turn, where rates at the ends forbid to scale it."""
_MAX_TRIES = 3  # durations to try; one in which there is no plan takes longer to compute
_SHORT_ENOUGH_RATIO = 1.05  # times the longest duration known as too short, up to which it is short enough


class InTime:
    """The attempts at a scenario; if they fail, those at its shortest manoeuvre, then at fits along its path.

    Args:
        scenario: the problem and its settings.
        clock: counts the computation time of all attempts together.

    Attributes:
        attempts: the attempts under way.
    """

    def __init__(self, scenario: Scenario, clock: Clock) -> None:
        self.scenario, self._clock = scenario, clock
        self.attempts = self._first_attempts = Attempts(scenario, clock)
        self._asks_for_shortest = scenario.trajectory.timed and not moves(scenario)
        self._shortest_plan: Plan | None = None
        self._durations_left: list[float] = []  # s, of fits along the shortest manoeuvre still to be tried
        self._answer: Plan | None = None
        self._least_time_attempts: Attempts | None = None  # while one of least rotation is tried
        self._compared_attempts: list[Attempts] = []  # beside which that was tried, or was not to be
        self._sooner: Sooner | None = None

    def advance(self) -> bool:
        """Begin the next attempts if those under way are over.

        Returns:
            True while `attempts.need` is to be answered; False once the plan is settled.
        """
        if self.attempts.need is None and self._sooner is None:
            self._compare_with_nearest()
        while self.attempts.need is None and self._try_shorter_duration():
            pass
        if self._sooner is not None:
            return self._answer is None
        over = self.attempts.need is None
        if self._asks_for_shortest and self._may_be_too_short():
            self._asks_for_shortest, self._clock.improve_for = False, 0.0  # which is for "minimum"
            enough = float(self.scenario.trajectory.duration)
            self.attempts = Attempts(self._with_duration(MINIMUM), self._clock, enough=enough)
        elif over and self._shortest_plan is not None:
            self._accept_fit_along(self.attempts.result())
        elif over and self.attempts is not self._first_attempts:
            self._accept_shortest(self.attempts.result())
        return self._answer is None and self.attempts.need is not None

    def result(self) -> Plan:
        """Return the plan, once it is settled, with its computation times."""
        answer = self._first_attempts.result() if self._answer is None else self._answer
        return replace(with_advice(answer), timings=self._clock.timings())

    def _compare_with_nearest(self) -> None:
        """Try the goal of least rotation after the goals of least time, once, and keep the shorter plan."""
        soonest = self._least_time_attempts
        if soonest is not None and soonest.plan is not None:
            soonest.plan = shorter_of(soonest.plan, self.attempts.plan)
            self.attempts, self._least_time_attempts = soonest, None
        elif self.attempts not in self._compared_attempts:
            self._compared_attempts.append(self.attempts)
            beside = to_the_nearest(self.attempts)
            if beside is not None:
                self._least_time_attempts, self.attempts = self.attempts, beside

    def _try_shorter_duration(self) -> bool:
        """Begin with the next given duration in which a motion to moving targets may be shorter.

        Returns False at the end; the answer is then the shortest plan so far, if any duration was tried.
        """
        if self._answer is not None:
            return False
        if self._sooner is None:
            if self.attempts is not self._first_attempts or not may_be_sooner(
                self.scenario, self._first_attempts.plan
            ):
                return False
            self._sooner = Sooner(self._first_attempts.result(), self._clock)
        else:
            self._sooner.advance(self.attempts.result())
        if self._sooner.attempts is None:
            self._answer = self._sooner.plan
            return False
        self.attempts = self._sooner.attempts
        return True

    def _may_be_too_short(self) -> bool:
        """Tell whether the first attempts failed in a way in which the shortest manoeuvre may help."""
        plan = self._first_attempts.plan
        if plan is None or self.scenario.trajectory.method != "global":
            return False
        if self._first_attempts.need is None:
            return plan.status in _PERHAPS_TOO_SHORT
        # A goal of least time tells more than other ones of least rotation, which are tried after it.
        return plan.status is Status.LIMITS_TOO_TIGHT and self._chooses_criterion

    @property
    def _chooses_criterion(self) -> bool:
        """Whether the goal is targets without a criterion, so that the planner chooses it."""
        goal = self.scenario.goal
        return not isinstance(goal, GivenState) and goal.criterion is None

    def _with_duration(self, duration: float | str) -> Scenario:
        """Return the scenario with another duration: seconds or a word.

        If its goal is targets that name no criterion, they get that of least time.
        """
        scenario, goal = self.scenario, self.scenario.goal
        if not isinstance(goal, GivenState) and self._chooses_criterion:
            scenario = replace(scenario, goal=replace(goal, criterion=LEAST_TIME))
        return replace(scenario, trajectory=replace(scenario.trajectory, duration=duration))

    def _accept_shortest(self, plan: Plan) -> None:
        """Begin fits along the shortest manoeuvre's path, or answer that the given duration is too short.

        If `plan`, that of the shortest manoeuvre, is not certified, the first attempts go on instead.
        """
        if not plan.ok or plan.trajectory is None or plan.goal is None:
            self.attempts = self._first_attempts
            return
        self._shortest_plan = plan
        given, least = float(self.scenario.trajectory.duration), plan.trajectory.duration
        start, end = self.scenario.start, end_rates(plan.scenario, plan.goal)
        at_speed = any(np.any(rates) for rates in (start.angular_velocity, start.joint_rates, *end))
        if least > given and not at_speed:
            self._refuse_duration(float(rounded_up(least)))
            return
        longer = [float(rounded_up(least * (1 + slack))) for slack in _DURATION_SLACKS]
        self._durations_left = [given] if least <= given else []
        self._durations_left += [one for one in longer if one > given]
        self._fit_along_shortest()

    def _fit_along_shortest(self) -> None:
        """Begin a fit along the shortest manoeuvre's path in the next duration.

        If no duration is left, the answer is that of the first attempts.
        """
        if self._shortest_plan is None or not self._durations_left:
            self._answer = self._first_attempts.result()
        else:
            self.attempts = Attempts(self._with_duration(self._durations_left.pop(0)), self._clock)
            self.attempts.go_along(self._shortest_plan)

    def _accept_fit_along(self, plan: Plan) -> None:
        """Settle the answer by a fit along the shortest manoeuvre's path, or begin the next one if it failed.

        A plan in the given duration is the answer; one in a longer duration shows which duration is enough.
        """
        given, tried = self.scenario.trajectory.duration, plan.scenario.trajectory.duration
        if not plan.ok:
            self._fit_along_shortest()
        elif tried == given:
            self._answer = replace(plan, message=messages.sooner(self._first_attempts.result(), plan))
        else:
            self._refuse_duration(float(tried))

    def _refuse_duration(self, enough: float) -> None:
        """Answer that the duration is too short, and that there is a certified plan in `enough` s."""
        plan = self._first_attempts.result()
        self._answer = replace(plan, message=messages.too_short(plan, enough))


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
