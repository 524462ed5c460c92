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

_SMALLEST = (
    1e-3  # rad, least half angle of a cone, and of its complement; `swept` widens and `always` drops smaller
)
_ROOM = float(np.deg2rad(0.25))  # rad, most margin that a cone keeps from start or goal where it is cut back
_BROKEN = -1e-8  # rad, a margin below which a zone does not hold
_ROUNDS = 8  # most fits, each to the goal at the end of the fit before, until duration and goal agree
_SETTLED = 1e-2  # share of the duration by which it may differ from the goal's time; below it they agree
_SLACKS = (1e-3, 4e-3, 1e-2, 3e-2, 1e-1)  # fractions of the shortest time that are added to it, in turn
_DETOUR = 1.4  # first guess of a duration over its lower bound, to make room for a detour
_FACTORS = (1.0, 0.6, 2.0, 4.0)  # on that guess, in turn, where there is no goal then or it is not met


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
            axis[row], reach = _swing(path, time)
            half_angle[row] -= rows.side[row] * reach
            kept[row] &= _SMALLEST < half_angle[row] < np.pi - _SMALLEST
    return replace(rows, axis=axis, half_angle=half_angle, paths=()).part(kept)


def _swing(path: DirectionPath, time: float) -> tuple[np.ndarray, float]:
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
    found = find_goals(_at_first(scenario))
    goal = found.goal if isinstance(found, Plan) else found[0]
    if goal is None:
        craft = scenario.usable
        guess = np.pi / min(np.min(craft.rate_limit), longest(craft, 1))
    else:
        joints = np.stack([scenario.start.joints, goal.joints])
        turn = np.stack([scenario.start.attitude, goal.attitude])
        guess = (
            _DETOUR
            * duration_bound(scenario.usable, turn, joints, np.zeros((2, 3)), np.zeros(joints.shape)).seconds
        )
    guesses = [float(np.clip(factor * guess, min(1.0, known), known)) for factor in _FACTORS]
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
        self._known, self._what = known_until(scenario)
        self._asked = goal.time  # s, for which goals were asked last
        self._early = 0.0  # s, latest end time known to be too short for the motion to its goal
        self._late: tuple[float, Goal, Path] | None = (
            None  # s, earliest end time known to be long enough, its goal and the path
        )
        self._rounds = 0  # fits so far
        self._settled = False  # duration and goal agree
        self._needed = 0.0  # s, how long a manoeuvre takes at least, once it is settled
        self._slacks = list(_SLACKS)  # still to be tried
        self._timed = False  # the motion is fitted in a given time

    def accept_fit(self, fit: Fit) -> None:
        """Take the fit that `need` asked for, and set `need`: to None where the duration is given."""
        self.fit, self.need = fit, None
        if isinstance(self.scenario.trajectory.duration, str):
            if self._timed:
                self._after_timed_fit(fit)
            else:
                self._after_free_fit(fit)

    def accept_goals(self, goals: Sequence[Goal] | None) -> None:
        """Take the goals at the time that was asked for, None if there are none, and set the next `need`."""
        time, self.need = self._asked, None
        if goals is None:
            self._miss(f"the motion takes about {time:.4g} s, and after these there is no goal any more")
            return
        was = self.goal.attitude
        self.goal = min(goals, key=lambda one: float(np.linalg.norm(one.attitude - was)))
        self.path = _ending(self.path, self.goal)
        if time > 0:
            scenario = _timed(self.scenario, time) if self._timed else self.scenario
            self.need = wanted_fit(scenario, self.path, self.goal)

    def _after_free_fit(self, fit: Fit) -> None:
        """After a fit of free duration, ask for the goal at its end, or for a fit in a given time.

        The latter once motion and goal agree on the time, or after `_ROUNDS` fits though they do not.
        """
        curve, expected = fit.trajectory, self.goal.time
        if curve is None or fit.status is Status.LIMITS_TOO_TIGHT:
            if curve is not None and curve.duration > self._known:
                self.fit = replace(fit, trajectory=None)  # nobody can look at all of it
            return
        if curve.duration > self._known:
            self._miss(_unknown(self._what, self._known, curve.duration))
            return
        if seen_from(self.scenario, curve.duration) > curve.duration:
            self._ask(curve.duration)
            return
        if not curve.duration > 0:  # it is there from the start, and need not stay
            self._ask(curve.duration)
            return
        self._rounds += 1
        self._settled = abs(curve.duration - expected) <= _SETTLED * expected
        self._needed = curve.duration
        if not self._settled:
            self._narrow(expected, curve.duration)
        if self._settled:
            self._ask_for_slack()
        elif self._late is not None and (self._rounds == _ROUNDS or self._is_narrow(self._late[0])):
            self._wait_for_goal(*self._late)
        elif self._rounds == _ROUNDS:
            self._needed = max(expected, curve.duration)
            self._ask_for_slack()
        else:
            self._ask(self._next_time(curve.duration))

    def _narrow(self, expected: float, duration: float) -> None:
        """Narrow the bracket of end times by a motion of `duration` s to the goal at `expected` s.

        Where goals jump in time, there may be no time whose goal is reached in exactly that time. The
        shortest end time is then sought between one that is too short to reach its goal and one that is long
        enough.
        """
        late = np.inf if self._late is None else self._late[0]
        if duration <= expected < late:
            self._late = expected, self.goal, self.path
            self._early = self._early if self._early < expected else 0.0
        elif duration > expected and self._early < expected < late:
            self._early = expected

    def _is_narrow(self, late: float) -> bool:
        """Whether the bracket of end times, up to `late` s, is narrow enough to stop."""
        return late - self._early <= _SETTLED * late

    def _next_time(self, duration: float) -> float:
        """Return the time, s, of the goals to ask for next: the last motion's end or the bracket's middle."""
        if self._late is None or not self._early or self._early < duration < self._late[0]:
            return duration
        return (self._early + self._late[0]) / 2

    def _wait_for_goal(self, time: float, goal: Goal, path: Path) -> None:
        """Ask for a fit in `time` s, which is longer than needed, as its goal is not there sooner."""
        self.goal, self.path, self._timed = goal, path, True
        self.need = wanted_fit(_timed(self.scenario, time), path, goal)

    def _after_timed_fit(self, fit: Fit) -> None:
        """After a fit in a given time: stop if it keeps the limits; else ask for a longer one."""
        if fit.status is not Status.LIMITS_TOO_TIGHT:
            return
        if self._slacks and self.goal.time < self._known:
            self._ask_for_slack()
        elif not self._settled:
            self._miss(f"after {_ROUNDS} rounds fit and goal still follow each other")

    def _ask_for_slack(self) -> None:
        """Ask for the goals at a time a little later than the motion needs."""
        self._timed = True
        self._ask(min(self._needed * (1 + self._slacks.pop(0)), self._known))

    def _ask(self, time: float) -> None:
        """Ask for the goals at `time` s; if a target is hidden then, at the next time when all are seen."""
        self._asked = seen_from(self.scenario, time)
        if self._asked > self._known:
            self._miss(
                f"the motion takes about {time:.4g} s, and then not all targets are seen until "
                f"{self._known:g} s, as long as they are known"
            )
            return
        if self._asked > time:
            self._needed, self._settled, self._timed = self._asked, True, True
        self.need = GoalQuery(self.scenario, self._asked)

    def _miss(self, message: str) -> None:
        """End without a trajectory: set `fit` to a failed one with the status GOAL_MISSED and a message."""
        self.fit = Fit(trajectory=None, status=Status.GOAL_MISSED, message=message)


def _timed(scenario: Scenario, time: float) -> Scenario:
    """Return the scenario with a duration of `time` s.

    "minimum" without a node tube stands for an infinite tube, which is kept; else the tube stays as it is.
    """
    settings = scenario.trajectory
    tube = np.inf if settings.duration == MINIMUM and settings.node_tube is None else settings.node_tube
    return replace(scenario, trajectory=replace(settings, duration=time, node_tube=tube))


def _at_first(scenario: Scenario) -> Scenario:
    """Return the scenario without zones, its targets fixed where they are at time zero."""
    asked = scenario.goal
    goal = asked if isinstance(asked, GivenState) else asked.at(0.0)
    return replace(scenario, goal=goal, keep_out=(), keep_in=(), joint_bounds=())


def _ending(path: Path, goal: Goal) -> Path:
    """Return a path bent to end at `goal`: each node moves by the fraction of the path's cost up to it."""
    share = np.concatenate([[0.0], np.cumsum(path.edge_costs)])
    share = share / share[-1] if share[-1] > 0 else np.ones_like(share)
    turn = np.asarray(so3.log(path.attitudes[-1].T @ goal.attitude))
    attitudes = path.attitudes @ np.asarray(so3.exp(share[:, None] * turn))
    joints = path.joints + share[:, None] * (goal.joints - path.joints[-1])
    attitudes[-1], joints[-1] = goal.attitude, goal.joints
    return replace(path, attitudes=attitudes, joints=joints)


def _unknown(what: str, known: float, needed: float) -> str:
    """Return text that `what` is known until `known` s only, although the motion takes `needed` s."""
    return f"{what} is known until {known:g} s, and the motion takes {needed:.4g} s: {messages.FOR_LONGER}"
