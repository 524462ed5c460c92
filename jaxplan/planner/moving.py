"""Manoeuvres in which zones or targets move: still cones for the search, and when the manoeuvre ends.

The search knows only zones that stand still. For each moving zone `swept` has a cone that contains all it
covers during the manoeuvre (a keep-in cone is contained in the zone throughout), cut back where it would
cover start or goal although the zone itself leaves them clear at their times. These cones guide the search;
whether the motion keeps the moving zones is for the fit and the certificate to say. `always` has cones of
directions that are forbidden at every instant: a ring of these separates start from goal for good, so they
serve to prove that there is no path.

A moving goal is the one at the end of the manoeuvre, which is known in a given duration. If the duration is
"minimum" or "stretched", it depends on the goal and the goal on it: in a `Meeting` fits and goals follow each
other until both agree. That converges fast, since targets turn slowly. At last the motion is fitted in just
the time after which its goal is there. Where a target is hidden then, the manoeuvre lasts until it is seen.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jaxplan import so3
from jaxplan.geometry.vectors import separation
from jaxplan.model.constraints import Constraints, pair_margins
from jaxplan.model.directions import DirectionPath
from jaxplan.model.duration_bound import duration_bound
from jaxplan.model.goals import GivenState
from jaxplan.model.limits import longest
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import MINIMUM, Scenario, known_until, moves, seen_from
from jaxplan.model.status import Status
from jaxplan.planner import messages
from jaxplan.planner.record import Plan
from jaxplan.planner.steps import GoalQuery, find_goals, wanted_fit
from jaxplan.trajectory import Fit, FitQuery

# rad, least half angle of a cone, and of its complement; `swept` widens and `always` drops smaller
_MIN_HALF_ANGLE = 1e-3
_MAX_END_MARGIN = float(np.deg2rad(0.25))  # rad, most margin to start or goal where a cone is cut back
_MIN_MARGIN = -1e-8  # rad, a margin below which a zone does not hold
_MAX_ROUNDS = 8  # most fits, each to the goal at the end of the fit before, until duration and goal agree
_TIME_TOLERANCE = 1e-2  # share of the duration by which it may differ from the goal's time
_DURATION_SLACKS = (1e-3, 4e-3, 1e-2, 3e-2, 1e-1)  # fractions of the shortest time added to it
_DETOUR_FACTOR = 1.4  # first guess of a duration over its lower bound, to make room for a detour
_GUESS_FACTORS = (1.0, 0.6, 2.0, 4.0)  # on that guess, in turn, where there is no goal then or it is not met


def swept(scenario: Scenario, goal: Goal, share: float = 1.0) -> Constraints:
    """Return the constraints with still cones in place of moving ones, for all they sweep in the manoeuvre.

    Args:
        scenario: the problem; if nothing moves, its own constraints are returned.
        goal: where and when the manoeuvre ends.
        share: fraction of the swept angle that the cones cover; 0 for zones as they are halfway in time.
    """
    rows = scenario.constraints
    if not rows.paths:
        return rows
    craft, start = scenario.usable, scenario.start
    sights = rows.sights(craft.gimbals, craft.fixed_boresights)
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
        axis[row], reach = _enclosing_cone(path, goal.time)
        half_angle[row] += side * share * reach
        for seen, margins in ends:
            margin = margins[row, bound]
            if np.all(margin >= _MIN_MARGIN):  # else another zone of its group holds there
                cut = side * separation(axis[row], seen[bound]) - np.clip(margin / 2, 0, _MAX_END_MARGIN)
                half_angle[row] = side * min(side * half_angle[row], np.min(cut, initial=np.inf))
        half_angle[row] = np.clip(half_angle[row], _MIN_HALF_ANGLE, np.pi - _MIN_HALF_ANGLE)
    return replace(rows, axis=axis, half_angle=half_angle, paths=())


def always(scenario: Scenario, goal: Goal) -> Constraints:
    """Return still cones of what is forbidden at every instant, without zones that forbid nothing for good.

    If something moves, groups of zones are dropped, too. If the duration is to be found, every instant is up
    to when zones are known. If targets move as well, the goal may be elsewhere, so no row is left.

    Args:
        scenario: the problem; if nothing moves, its own constraints are returned.
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
            axis[row], reach = _enclosing_cone(path, time)
            half_angle[row] -= rows.side[row] * reach
            kept[row] &= _MIN_HALF_ANGLE < half_angle[row] < np.pi - _MIN_HALF_ANGLE
    return replace(rows, axis=axis, half_angle=half_angle, paths=()).part(kept)


def _enclosing_cone(path: DirectionPath, time: float) -> tuple[np.ndarray, float]:
    """Return a path's direction (3,) at `time / 2`, and an upper bound, rad, of its angle from there.

    The bound holds from 0 to `time` s.
    """
    axis = np.asarray(path.at(time / 2))
    return axis, path.reach(axis, 0.0, time)


def duration_guesses(scenario: Scenario) -> tuple[float | None, ...]:
    """Return times, s, at which the manoeuvre may end, the likeliest first.

    Args:
        scenario: the problem. If nothing moves, (None,) is returned; if the duration is given, it alone.
    """
    if not moves(scenario):
        return (None,)
    duration = scenario.trajectory.duration
    if not isinstance(duration, str):
        return (float(duration),)
    known, _ = known_until(scenario)
    found = find_goals(_freeze_at_start(scenario))
    goal = found.goal if isinstance(found, Plan) else found[0]
    if goal is None:
        craft = scenario.usable
        guess = np.pi / min(np.min(craft.rate_limit), longest(craft, 1))
    else:
        joints = np.stack([scenario.start.joints, goal.joints])
        turn = np.stack([scenario.start.attitude, goal.attitude])
        guess = (
            _DETOUR_FACTOR
            * duration_bound(scenario.usable, turn, joints, np.zeros((2, 3)), np.zeros(joints.shape)).seconds
        )
    guesses = [float(np.clip(factor * guess, min(1.0, known), known)) for factor in _GUESS_FACTORS]
    seen = [time for time in (seen_from(scenario, guess) for guess in guesses) if time <= known]
    return tuple(dict.fromkeys(seen or guesses[:1]))


class Meeting:
    """Alternates fits and goals until a motion ends at its goal at the very time of that goal.

    Args:
        scenario: a problem in which something moves.
        goal: the goal at the end of the given duration, or of a guessed one.
        path: a path to this goal.

    Attributes:
        need: the fit or the goals that are needed next; None at the end.
        fit: the last fit, unset before the first. If the goal is not met, at the end it has no trajectory and
            the status GOAL_MISSED.
        goal: the goal at the time at which the motion ends.
        path: the path, its last node at this goal.
    """

    def __init__(self, scenario: Scenario, goal: Goal, path: Path) -> None:
        self.scenario, self.goal, self.path = scenario, goal, path
        self.fit: Fit
        self.need: FitQuery | GoalQuery | None = wanted_fit(scenario, path, goal)
        self._known_until, self._limiting_name = known_until(scenario)
        self._asked_time = goal.time  # s, for which goals were asked last
        self._bracket_low = 0.0  # s, latest end time known to be too short for the motion to its goal
        # s, earliest known long enough, with goal and path
        self._bracket_high: tuple[float, Goal, Path] | None = None
        self._rounds = 0  # fits so far
        self._times_agree = False  # duration and goal agree
        self._needed_duration = 0.0  # s, how long a manoeuvre takes at least, once it is settled
        self._slacks_left = list(_DURATION_SLACKS)  # still to be tried
        self._is_timed = False  # the motion is fitted in a given time

    def accept_fit(self, fit: Fit) -> None:
        """Take the fit that `need` asked for, and set `need`: to None where the duration is given."""
        self.fit, self.need = fit, None
        if isinstance(self.scenario.trajectory.duration, str):
            if self._is_timed:
                self._accept_timed_fit(fit)
            else:
                self._accept_free_fit(fit)

    def accept_goals(self, goals: Sequence[Goal] | None) -> None:
        """Take the goals at the time that was asked for, None if there are none, and set the next `need`."""
        time, self.need = self._asked_time, None
        if goals is None:
            self._fail(f"the motion takes about {time:.4g} s, and after these there is no goal any more")
            return
        was = self.goal.attitude
        self.goal = min(goals, key=lambda one: float(np.linalg.norm(one.attitude - was)))
        self.path = _bend_to_goal(self.path, self.goal)
        if time > 0:
            scenario = _with_duration(self.scenario, time) if self._is_timed else self.scenario
            self.need = wanted_fit(scenario, self.path, self.goal)

    def _accept_free_fit(self, fit: Fit) -> None:
        """After a fit of free duration, ask for the goal at its end, or for a fit in a given time.

        The latter once motion and goal agree on the time, or after `_MAX_ROUNDS` fits though they do not.
        """
        curve, expected = fit.trajectory, self.goal.time
        if curve is None or fit.status is Status.LIMITS_TOO_TIGHT:
            if curve is not None and curve.duration > self._known_until:
                self.fit = replace(fit, trajectory=None)  # nobody can look at all of it
            return
        if curve.duration > self._known_until:
            self._fail(_known_time_message(self._limiting_name, self._known_until, curve.duration))
            return
        if seen_from(self.scenario, curve.duration) > curve.duration:
            self._ask_for_goals(curve.duration)
            return
        if not curve.duration > 0:  # it is there from the start, and need not stay
            self._ask_for_goals(curve.duration)
            return
        self._rounds += 1
        self._times_agree = abs(curve.duration - expected) <= _TIME_TOLERANCE * expected
        self._needed_duration = curve.duration
        if not self._times_agree:
            self._narrow_bracket(expected, curve.duration)
        if self._times_agree:
            self._ask_with_slack()
        elif self._bracket_high is not None and (
            self._rounds == _MAX_ROUNDS or self._is_bracket_narrow(self._bracket_high[0])
        ):
            self._wait_for_goal(*self._bracket_high)
        elif self._rounds == _MAX_ROUNDS:
            self._needed_duration = max(expected, curve.duration)
            self._ask_with_slack()
        else:
            self._ask_for_goals(self._next_time(curve.duration))

    def _narrow_bracket(self, expected: float, duration: float) -> None:
        """Narrow the bracket of end times by a motion of `duration` s to the goal at `expected` s.

        Where goals jump in time, there may be no time whose goal is reached in exactly that time. The
        shortest end time is then sought between one that is too short to reach its goal and one that is long
        enough.
        """
        late = np.inf if self._bracket_high is None else self._bracket_high[0]
        if duration <= expected < late:
            self._bracket_high = expected, self.goal, self.path
            self._bracket_low = self._bracket_low if self._bracket_low < expected else 0.0
        elif duration > expected and self._bracket_low < expected < late:
            self._bracket_low = expected

    def _is_bracket_narrow(self, late: float) -> bool:
        """Tell whether the bracket of end times, up to `late` s, is narrow enough to stop."""
        return late - self._bracket_low <= _TIME_TOLERANCE * late

    def _next_time(self, duration: float) -> float:
        """Return the time, s, of the goals to ask for next: the last motion's end or the bracket's middle."""
        if (
            self._bracket_high is None
            or not self._bracket_low
            or self._bracket_low < duration < self._bracket_high[0]
        ):
            return duration
        return (self._bracket_low + self._bracket_high[0]) / 2

    def _wait_for_goal(self, time: float, goal: Goal, path: Path) -> None:
        """Ask for a fit in `time` s, which is longer than needed, as its goal is not there sooner."""
        self.goal, self.path, self._is_timed = goal, path, True
        self.need = wanted_fit(_with_duration(self.scenario, time), path, goal)

    def _accept_timed_fit(self, fit: Fit) -> None:
        """After a fit in a given time: stop if it keeps the limits; else ask for a longer one."""
        if fit.status is not Status.LIMITS_TOO_TIGHT:
            return
        if self._slacks_left and self.goal.time < self._known_until:
            self._ask_with_slack()
        elif not self._times_agree:
            self._fail(f"after {_MAX_ROUNDS} rounds fit and goal still follow each other")

    def _ask_with_slack(self) -> None:
        """Ask for the goals at a time a little later than the motion needs."""
        self._is_timed = True
        self._ask_for_goals(min(self._needed_duration * (1 + self._slacks_left.pop(0)), self._known_until))

    def _ask_for_goals(self, time: float) -> None:
        """Ask for the goals at `time` s; if a target is hidden then, at the next time when all are seen."""
        self._asked_time = seen_from(self.scenario, time)
        if self._asked_time > self._known_until:
            self._fail(
                f"the motion takes about {time:.4g} s, and then not all targets are seen until "
                f"{self._known_until:g} s, as long as they are known"
            )
            return
        if self._asked_time > time:
            self._needed_duration, self._times_agree, self._is_timed = self._asked_time, True, True
        self.need = GoalQuery(self.scenario, self._asked_time)

    def _fail(self, message: str) -> None:
        """End without a trajectory: set `fit` to a failed one with the status GOAL_MISSED and a message."""
        self.fit = Fit(trajectory=None, status=Status.GOAL_MISSED, message=message)


def _with_duration(scenario: Scenario, time: float) -> Scenario:
    """Return the scenario with a duration of `time` s.

    "minimum" without a node tube stands for an infinite tube, which is kept; else the tube stays as it is.
    """
    settings = scenario.trajectory
    tube = np.inf if settings.duration == MINIMUM and settings.node_tube is None else settings.node_tube
    return replace(scenario, trajectory=replace(settings, duration=time, node_tube=tube))


def _freeze_at_start(scenario: Scenario) -> Scenario:
    """Return the scenario without zones, its targets fixed where they are at time zero."""
    asked = scenario.goal
    goal = asked if isinstance(asked, GivenState) else asked.at(0.0)
    return replace(scenario, goal=goal, keep_out=(), keep_in=(), joint_bounds=())


def _bend_to_goal(path: Path, goal: Goal) -> Path:
    """Return a path bent to end at `goal`: each node moves by the fraction of the path's cost up to it."""
    share = np.concatenate([[0.0], np.cumsum(path.edge_costs)])
    share = share / share[-1] if share[-1] > 0 else np.ones_like(share)
    turn = np.asarray(so3.log(path.attitudes[-1].T @ goal.attitude))
    attitudes = path.attitudes @ np.asarray(so3.exp(share[:, None] * turn))
    joints = path.joints + share[:, None] * (goal.joints - path.joints[-1])
    attitudes[-1], joints[-1] = goal.attitude, goal.joints
    return replace(path, attitudes=attitudes, joints=joints)


def _known_time_message(what: str, known: float, needed: float) -> str:
    """Return text that `what` is known until `known` s only, although the motion takes `needed` s."""
    return f"{what} is known until {known:g} s, and the motion takes {needed:.4g} s: {messages.FOR_LONGER}"
