"""Look for plans that are shorter than a certified one: to other goals, on other ways, from more bent curves.

A *way* is a route past the zones to a goal. *Bent curves* are first guesses of the fit, bent away from the
path; `TrajectorySettings.first_guesses` says how many are asked for.

The goal of least time is the one with the least lower bound, which knows no zones and takes platform and
joints each by itself. So where the shortest motion to it is far above the bound, the other goals of step 1
are tried, that of least rotation among them, unless their own bounds say that they take longer, or direct
motions do, about a fixed axis. Those to which direct motions are quickest come first; in the time that is
to be spent on improvement only bounds decide.

Zones can be passed on several sides, and a search finds one way. If the shortest motion along it is far above
the bound, other searches look for other ways, unless the straight way is open, which is the quickest. Half as
many look for ways to each other goal that was tried, since its first way may have been a bad one. A search is
quick and a fit is not, so in each round of searches only the paths that look quickest are fitted. A motion
along one of them that is shorter, once it is certified, becomes the plan. There is always a certified plan.
"""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count

import numpy as np

from jaxplan import so3
from jaxplan.certificate import Certificate
from jaxplan.model.duration_bound import duration_bound, times_along, ways_of_joints
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import MINIMUM, Scenario, moves
from jaxplan.model.status import Status
from jaxplan.planner.proving import ProofQuery
from jaxplan.planner.record import Plan, end_rates
from jaxplan.planner.steps import SearchQuery, fitted_plan, judged, wanted_fit
from jaxplan.search import (
    Scene,
    SearchResult,
    derived_seed,
    find_barrier,
    find_joint_barrier,
    make_scene,
)
from jaxplan.trajectory import NEAR_THE_BOUND, Fit, FitQuery
from jaxplan.trajectory.node_times import turn_time

METHODS = ("rrt_connect", "mha")  # of other searches, in turn: the first varies most with its seed
_FIRST_SEED = 100  # number of the first other search among those whose seeds are derived
SHORTER = 1 - 1e-4  # times the plan's duration: a motion must take less for its plan to be taken
_MAX_BENT_CURVES = 1000  # curves; with more nothing is found that fewer would not find
_FITS_PER_GUESS, _SEARCHES_PER_GUESS = 0.5, 3  # in a round, to the plan's goal
_OTHER_SEARCHES_PER_GUESS = 1.5  # the same, of searches to each other goal
_HELD_UP = 1.02  # times a direct motion's time; a plan that takes longer is held up, as by zones or jerk
_SHARE_OF_DIRECT = 0.9  # of the time of a direct motion, that of good motions about other axes too
_SAME_WAY_ANGLE = 0.25  # rad, of attitude and joints; a path so near to one that was fitted is the same way
_STRAIGHT_TIME_RATIO = 1.001  # times the estimated time along the straight path; up to it a path is straight
_MAX_TIME_RATIO = 1.25  # times the estimated time along the plan's own path; slower paths are not fitted


def is_improvable(plan: Plan, improve_for: float, goals: Sequence[Goal] = (), enough: float = 0.0) -> bool:
    """Tell whether to look for a shorter plan than the one that was found.

    Args:
        plan: the one that was found; the result is False if it is not certified.
        improve_for: s, how long to look at least; 0 to look as far as the settings ask for.
        goals: other goals that meet the same targets and wishes as well.
        enough: s, a duration that is short enough.
    """
    scenario, settings = plan.scenario, plan.scenario.trajectory
    if plan.status is not Status.OK or plan.trajectory is None or plan.path is None or moves(scenario):
        return False
    asked = settings.duration == MINIMUM and settings.method == "global" and settings.node_tube is None
    if not asked or not is_far(plan, enough):
        return False
    if improve_for > 0 or not settings.first_guesses:
        return improve_for > 0
    return (bool(scenario.zones) and is_bent(plan)) or any(looks_sooner(plan, one) for one in goals)


def is_far(plan: Plan, enough: float) -> bool:
    """Whether a plan takes longer than `NEAR_THE_BOUND` times its lower bound, and longer than `enough` s."""
    bound, trajectory = plan.duration_bound, plan.trajectory
    return (
        bound is not None
        and trajectory is not None
        and trajectory.duration > max(NEAR_THE_BOUND * bound, enough)
    )


def may_be_sooner(plan: Plan, goal: Goal) -> bool:
    """Tell whether the lower bound of the time to `goal` is less than `SHORTER` times the plan's duration."""
    scenario, trajectory = plan.scenario, plan.trajectory
    start, end = scenario.start, end_rates(scenario, goal)
    bound = duration_bound(
        scenario.usable,
        np.stack([start.attitude, goal.attitude]),
        np.stack([start.joints, goal.joints]),
        np.stack([start.angular_velocity, end[0]]),
        np.stack([start.joint_rates, end[1]]),
    )
    return trajectory is not None and bound.seconds < SHORTER * trajectory.duration


def looks_sooner(plan: Plan, goal: Goal) -> bool:
    """Tell whether a goal may be reached sooner than by a plan, and direct motions to both say so, too.

    Lower bounds are loose, by other shares for other goals. So a goal is dropped if its direct motion takes
    longer than that to the plan's own goal. If the plan is held up, the other goal's shortest motion is taken
    to be quicker than its direct one by as much as good ones are. That is a guess, which may drop a goal that
    is reached sooner. Where start or end move it is not made.
    """
    scenario, start, ends = plan.scenario, plan.scenario.start, end_rates(plan.scenario, goal)
    if plan.trajectory is None or plan.goal is None or not may_be_sooner(plan, goal):
        return False
    if any(np.any(rates) for rates in (start.angular_velocity, start.joint_rates, *ends)):
        return True
    own, other = (_direct_time(scenario, one) for one in (plan.goal, goal))
    taken = plan.trajectory.duration
    if taken > _HELD_UP * own or is_bent(plan):
        own = max(own, taken / _SHARE_OF_DIRECT)
    return other < SHORTER * own


def _direct_time(scenario: Scenario, goal: Goal) -> float:
    """Time in s that the slowest of platform and joints takes to a goal, from rest, about a fixed axis."""
    craft, start = scenario.usable, scenario.start
    turn = np.asarray(so3.log(np.asarray(start.attitude).T @ goal.attitude))
    joints = [float(way.rest_time) for way in ways_of_joints(craft, goal.joints - start.joints)]
    return max(turn_time(turn, craft), *joints, 0.0)


def _is_near(path: Path, other: Path) -> bool:
    """Tell whether every node of a path is within `_SAME_WAY_ANGLE` of some node of the other one."""
    cosine = (np.einsum("aij,bij->ab", path.attitudes, other.attitudes) - 1) / 2
    joints = np.abs(path.joints[:, None] - other.joints)
    apart = np.maximum(np.arccos(np.clip(cosine, -1, 1)), np.max(joints, axis=-1, initial=0))
    return bool(np.max(np.min(apart, axis=1)) <= _SAME_WAY_ANGLE)


def is_bent(plan: Plan) -> bool:
    """Whether a motion along a plan's path is estimated to take longer than one along the straight path."""
    return plan.path is not None and _is_detour(plan, plan.path)


def _is_detour(plan: Plan, path: Path) -> bool:
    """Tell whether a motion along `path` is estimated to take longer than one straight to the path's end."""
    nodes = path.attitudes, path.joints
    ends = path.attitudes[[0, -1]], path.joints[[0, -1]]
    along, straight = times_along(plan.scenario.usable, [nodes, ends]).tolist()
    return bool(along > _STRAIGHT_TIME_RATIO * straight)


@dataclass(frozen=True, eq=False)
class _Way:
    """A goal to which searches look for paths, with what they have found.

    Attributes:
        goal: the goal.
        scene: the search problem.
        paths: paths that were fitted; another path near one of these counts as the same way.
        searches: counts the searches, for their seeds.
    """

    goal: Goal
    scene: Scene
    paths: list[Path] = field(default_factory=list)
    searches: Iterator[int] = field(default_factory=lambda: count(1))


class Shorter:
    """The search for a shorter plan, a state machine like `attempts.Attempts`.

    Args:
        plan: a certified plan to begin with.
        scene: the problem of its search.
        left: s, what is left of the scenario's time limit.
        improve_for: s, how long to go on at least, beyond that limit and the searches that the settings ask
            for.
        goals: other goals that meet the same targets and wishes as well.

    Attributes:
        plan: the shortest certified plan so far.
        need: the search, fit or certificate that is needed next; None at the end.
    """

    def __init__(
        self, plan: Plan, scene: Scene, left: float, improve_for: float, goals: Sequence[Goal] = ()
    ) -> None:
        if plan.goal is None or plan.path is None:
            raise RuntimeError("a certified plan has a goal and a path")
        self.plan = plan
        # those likely to be quick come first
        self._goals_left = sorted(goals, key=partial(_direct_time, plan.scenario))
        self._own_way = _Way(plan.goal, scene, [plan.path])  # to the goal of the plan
        self._ways = [self._own_way]  # to all goals that were tried
        self._is_trying_goals = True  # whether other goals are being tried, each along its first path
        now = time.monotonic()
        self._deadline, self._improve_until = now + max(left, improve_for), now + improve_for
        self._bent_curves = plan.scenario.trajectory.first_guesses
        self._candidate, self._candidate_way = plan, self._own_way  # the plan, and the way, of what is needed
        self._found_paths: list[tuple[_Way, SearchResult, Path]] = []  # by other searches of the round
        # The same by the time, s, that a motion along the path looks to take.
        self._ranked_paths: list[tuple[float, _Way, SearchResult, Path]] = []
        self._searches_left: list[_Way] = []  # to which the round still searches
        self._fits_left = self._bends_left = 0
        self._is_rough_fit = False  # whether the fit under way only tells whether a better one is worth it
        self.need: SearchQuery | FitQuery | ProofQuery | None = None
        self._set_next_need()

    @property
    def _scenario(self) -> Scenario:
        """The scenario of all these plans."""
        return self.plan.scenario

    def accept_path(self, result: SearchResult) -> None:
        """Take the result of the search that `need` asked for, and set the next `need`."""
        if result.path is None:
            self._set_next_need()
        elif self._is_trying_goals:
            self._ways.append(self._candidate_way)
            self._fit_along(self._candidate_way, result)
        else:
            self._found_paths.append((self._candidate_way, result, result.path))
            self._set_next_need()

    def accept_fit(self, fitted: Fit) -> None:
        """Take the fit that `need` asked for, and set the next `need`: after a rough fit a better one.

        A fit is dropped if it is not shorter than the plan.
        """
        if not self._is_shorter(fitted):
            self._set_next_need()
        elif self._is_rough_fit and self._bent_curves and self._candidate.path is not None:
            self._request_fit(self._candidate.path, first_guesses=self._bent_curves)
        else:
            self._candidate = fitted_plan(self._candidate, fitted)
            goal, trajectory = self._candidate.goal, self._candidate.trajectory
            if goal is not None and trajectory is not None:
                self.need = ProofQuery(scenario=self._scenario, goal=goal, trajectory=trajectory)

    def accept_certificate(self, certificate: Certificate) -> None:
        """Take the certificate that `need` asked for, keep its plan if it is OK, and set the next `need`."""
        found = judged(self._candidate, certificate)
        if found.status is Status.OK:
            self.plan, self._own_way = found, self._candidate_way
        self._set_next_need()

    def _begin_round(self, bends: int) -> None:
        """Begin a round of searches and fits, with `bends` fits from more bent curves at its end.

        Most searches are for the plan's own goal, some for each other goal that was tried, if zones are in
        the way to it and it is still worth trying.
        """
        self._found_paths, self._ranked_paths, self._searches_left = [], [], []
        self._fits_left, self._bends_left = 0, bends
        asked = max(self._scenario.trajectory.first_guesses, 1)
        for way in self._ways if self._scenario.zones else ():
            own = way is self._own_way
            worthwhile = (own and bends > 0) or _is_detour(self.plan, way.paths[0])
            if worthwhile and (own or self._is_worth_trying(way.goal)):
                self._searches_left += [way] * math.ceil(
                    (_SEARCHES_PER_GUESS if own else _OTHER_SEARCHES_PER_GUESS) * asked
                )
                self._fits_left += math.ceil(_FITS_PER_GUESS * asked) if own else 1

    def _set_next_need(self) -> None:
        """Set `need` to what the round needs next, or to None at the end of the last round."""
        self.need, now = None, time.monotonic()
        if now >= self._deadline or self._try_next_goal(self._deadline - now):
            return
        if self._searches_left:
            self._request_search(self._searches_left.pop(0), self._deadline - now)
        elif self._fits_left and self._fit_quickest():
            self._fits_left -= 1
        elif self._bends_left and self._bent_curves < _MAX_BENT_CURVES and self.plan.path is not None:
            self._bends_left -= 1
            self._bent_curves = min(2 * max(self._bent_curves, 1), _MAX_BENT_CURVES)
            self._candidate, self._candidate_way = self.plan, self._own_way
            self._request_fit(self.plan.path, first_guesses=self._bent_curves)
        elif now < self._improve_until and (self._scenario.zones or self._bent_curves < _MAX_BENT_CURVES):
            self._begin_round(bends=1)
            self._set_next_need()

    def _try_next_goal(self, time_limit: float) -> bool:
        """Set `need` to a search for the next goal that is worth trying.

        Returns:
            False where no goal is left, `need` being as it was; the first time a round is begun as well.
        """
        while self._goals_left:
            goal = self._goals_left.pop(0)
            if not self._is_worth_trying(goal):
                continue
            scene = make_scene(self._scenario, goal)
            scene = replace(scene, attitude_step=self._own_way.scene.attitude_step)
            if find_barrier(scene) is None and find_joint_barrier(scene, range(scene.gimbals.count)) is None:
                self._candidate_way = _Way(goal, scene)
                self.need = SearchQuery(scene, replace(self._scenario.search, time_limit=time_limit))
                return True
        if self._is_trying_goals:
            self._is_trying_goals = False
            self._begin_round(bends=0)
        return False

    def _is_worth_trying(self, goal: Goal) -> bool:
        """Tell whether another goal looks sooner or, while time is left for improvement, may be sooner."""
        spare = time.monotonic() < self._improve_until
        return may_be_sooner(self.plan, goal) if spare else looks_sooner(self.plan, goal)

    def _request_search(self, way: _Way, time_limit: float) -> None:
        """Set `need` to another search for a path to the goal of `way`, of at most `time_limit` s."""
        number, search = next(way.searches), self._scenario.search
        settings = replace(
            search,
            method=METHODS[number % len(METHODS)],
            seed=derived_seed(search.seed, _FIRST_SEED + number),
            time_limit=time_limit,
        )
        self._candidate_way, self.need = way, SearchQuery(way.scene, settings)

    def _fit_quickest(self) -> bool:
        """Set `need` to a fit along the found path that looks quickest; False where none is worth it."""
        if self.plan.path is None:
            return False
        paths = [self.plan.path, *(path for _, _, path in self._found_paths)]
        nodes = [(path.attitudes, path.joints) for path in paths]
        own, *times = times_along(self._scenario.usable, nodes).tolist()
        self._ranked_paths += [(time, *found) for time, found in zip(times, self._found_paths, strict=True)]
        self._ranked_paths.sort(key=lambda found: found[0])
        self._found_paths = []
        while self._ranked_paths and self._ranked_paths[0][0] <= _MAX_TIME_RATIO * own:
            _, way, result, path = self._ranked_paths.pop(0)
            if not any(_is_near(path, other) for other in way.paths):
                self._fit_along(way, result)
                return True
        return False

    def _fit_along(self, way: _Way, result: SearchResult) -> None:
        """Set `need` to a rough fit along the path of a search result, and note the path in its way."""
        if result.path is not None:
            way.paths.append(result.path)
            self._candidate_way = way
            self._candidate = replace(self.plan, goal=way.goal, search=result, path=result.path)
            self._request_fit(result.path, first_guesses=0)

    def _request_fit(self, path: Path, first_guesses: int) -> None:
        """Set `need` to a fit along a path from `first_guesses` bent curves; from none it is a rough fit."""
        goal = self._candidate.goal
        if goal is None:
            raise RuntimeError("a certified plan has a goal")
        self._is_rough_fit = first_guesses == 0
        query = wanted_fit(self._scenario, path, goal)
        optimal = query.settings.optimal and not self._is_rough_fit
        self.need = replace(
            query,
            settings=replace(query.settings, first_guesses=first_guesses, optimal=optimal),
            at_most=self._max_duration,
        )

    @property
    def _max_duration(self) -> float:
        """Duration, s, below which a motion must be for its plan to be taken."""
        shortest = self.plan.trajectory
        return math.inf if shortest is None else SHORTER * shortest.duration

    def _is_shorter(self, fitted: Fit) -> bool:
        """Whether a fit succeeded and its duration is less than `SHORTER` times that of the shortest plan."""
        if fitted.status is not Status.OK or fitted.trajectory is None:
            return False
        return fitted.trajectory.duration < self._max_duration
