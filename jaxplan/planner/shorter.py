"""Look for shorter plans than one that was found: to other goals, on other ways, and from more bent curves.

The goal of least time is the one with the least bound, which knows no zones and takes platform and joints
each by itself. So where the shortest motion to it is far above that, the other goals of step 1 are tried, the
one of least rotation among them, unless their own bounds say that they take longer.

Zones can be passed on several sides, and a search finds one way. Where the shortest motion along it is far
above the bound, other searches look for other ways, unless the straight one is open, which is the quickest. A
search is quick and a fit is not, so of a round of searches the paths that look quickest are fitted. A motion
along one of them that is quicker, once it is certified, is the plan. There is always a certified plan at
hand.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jaxplan.certificate import Certificate
from jaxplan.model.duration_bound import duration_bound, time_along
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

METHODS = ("rrt_connect", "mha")  # of the other searches, in turn: the first one varies most with its seed
_FIRST_SEED = 100  # number of the first other search among those whose seeds are derived
_SHORTER = 1 - 1e-4  # share of the duration below which a motion's has to be for its plan to be taken
_MOST_BENT = 1000  # curves; with more nothing is found that fewer would not find
_FITS, _SEARCHES = 0.5, 3  # in a round, of paths, for each of the curves that are asked for
_NEAR = 0.25  # rad, of attitude and joints; a path that stays so near to one that was fitted is the same way
_BENT = 1.001  # times what the straight path looks to take; a path that takes no more is straight
_SLOWER = 1.25  # times what the plan's own path looks to take; paths that look slower are not fitted


def is_improvable(plan: Plan, improve_for: float, goals: Sequence[Goal] = (), enough: float = 0.0) -> bool:
    """Whether a shorter plan than one that was found is to be looked for.

    Args:
        plan: the one that was found; False where it is not certified.
        improve_for: s, for which it is to be looked for at least.
        goals: others that meet the same targets and wishes as well.
        enough: s, a duration that is short enough.
    """
    scenario, settings = plan.scenario, plan.scenario.trajectory
    if plan.status is not Status.OK or plan.trajectory is None or plan.path is None:
        return False
    asked = settings.duration == MINIMUM and settings.method == "global" and settings.node_tube is None
    others = settings.first_guesses > 0 and (
        _is_bent(plan) or any(_may_be_sooner(plan, one) for one in goals)
    )
    worthwhile = improve_for > 0 or others
    bound = plan.duration_bound
    far = bound is not None and plan.trajectory.duration > max(NEAR_THE_BOUND * bound, enough)
    return asked and worthwhile and far and not moves(scenario)


def _may_be_sooner(plan: Plan, goal: Goal) -> bool:
    """Whether the bound of the time to a goal leaves room below the duration of a plan."""
    scenario, trajectory = plan.scenario, plan.trajectory
    start, end = scenario.start, end_rates(scenario, goal)
    bound = duration_bound(
        scenario.usable,
        np.stack([start.attitude, goal.attitude]),
        np.stack([start.joints, goal.joints]),
        np.stack([start.angular_velocity, end[0]]),
        np.stack([start.joint_rates, end[1]]),
    )
    return trajectory is not None and bound.seconds < _SHORTER * trajectory.duration


def _time_along(plan: Plan, path: Path) -> float:
    """About what a motion of a plan's spacecraft along a path takes, s."""
    return time_along(plan.scenario.usable, path.attitudes, path.joints)


def _is_near(path: Path, other: Path) -> bool:
    """Whether every node of a path is within `_NEAR` of some node of another."""
    cosine = (np.einsum("aij,bij->ab", path.attitudes, other.attitudes) - 1) / 2
    joints = np.abs(path.joints[:, None] - other.joints)
    apart = np.maximum(np.arccos(np.clip(cosine, -1, 1)), np.max(joints, axis=-1, initial=0))
    return bool(np.max(np.min(apart, axis=1)) <= _NEAR)


def _is_bent(plan: Plan) -> bool:
    """Whether a motion along the path of a plan takes longer than one along the straight path."""
    path = plan.path
    if path is None:
        return False
    ends = Path(attitudes=path.attitudes[[0, -1]], joints=path.joints[[0, -1]], edge_costs=np.ones(1))
    return _time_along(plan, path) > _BENT * _time_along(plan, ends)


class Shorter:
    """The search for a shorter plan, as a state machine like `attempts.Attempts`.

    Args:
        plan: to begin with, certified.
        scene: of its search.
        left: s, of the scenario's time limit.
        improve_for: s, to go on for, beyond that limit and as many searches as the settings ask for.
        goals: others that meet the same targets and wishes as well.

    Attributes:
        plan: the shortest so far.
        need: the search, fit or certificate that is needed next; None at the end.
    """

    def __init__(
        self, plan: Plan, scene: Scene, left: float, improve_for: float, goals: Sequence[Goal] = ()
    ) -> None:
        self.plan, self._scene, self._goals = plan, scene, list(goals)
        self._tried: tuple[Goal, Scene] | None = None  # another goal, while its search or fits are under way
        now = time.monotonic()
        self._limit, self._until = now + max(left, improve_for), now + improve_for
        self._searches, self._bent = 0, plan.scenario.trajectory.first_guesses
        self._so_far = plan
        self._fitted = [] if plan.path is None else [plan.path]
        self._begin_round(bends=0)
        self._rough = False  # whether the fit under way only tells whether a better one is worth it
        self.need: SearchQuery | FitQuery | ProofQuery | None = None
        self._next()

    @property
    def _scenario(self) -> Scenario:
        """The scenario of the plans."""
        return self.plan.scenario

    def accept_path(self, result: SearchResult) -> None:
        """Take the result of another search, and set `need`."""
        if self._tried is not None and result.path is not None:
            self._so_far = replace(self.plan, goal=self._tried[0], search=result, path=result.path)
            self._fit(result.path, first_guesses=0)
            return
        if result.path is not None:
            self._found.append((_time_along(self.plan, result.path), result))
        self._next()

    def accept_fit(self, fitted: Fit) -> None:
        """Take the fit along another path, or from more curves, and set `need`."""
        if not self._is_shorter(fitted):
            self._next()
        elif self._rough and self._bent and self._so_far.path is not None:
            self._fit(self._so_far.path, first_guesses=self._bent)
        else:
            self._so_far = fitted_plan(self._so_far, fitted)
            goal, trajectory = self._so_far.goal, self._so_far.trajectory
            if goal is not None and trajectory is not None:
                self.need = ProofQuery(scenario=self._scenario, goal=goal, trajectory=trajectory)

    def accept_certificate(self, certificate: Certificate) -> None:
        """Take the certificate that was needed, keep its plan if it is certified, and set `need`."""
        found = judged(self._so_far, certificate)
        if found.status is Status.OK:
            self.plan = found
            if self._tried is not None:
                _, self._scene = self._tried
                self._fitted = [] if found.path is None else [found.path]
        self._next()

    def _begin_round(self, bends: int) -> None:
        """Begin a round of searches and fits, with `bends` fits from more bent curves at its end."""
        self._found: list[tuple[float, SearchResult]] = []  # each with what its path looks to take, s
        worthwhile = bool(self._scenario.zones) and (bends > 0 or _is_bent(self.plan))
        asked = max(self._scenario.trajectory.first_guesses, 1) if worthwhile else 0
        self._searches_left, self._fits_left = _SEARCHES * asked, math.ceil(_FITS * asked)
        self._bends_left = bends

    def _next(self) -> None:
        """Set `need` to what the round needs next; to None at the end of the last round."""
        self.need, now = None, time.monotonic()
        if now >= self._limit or self._try_goal(self._limit - now):
            return
        if self._searches_left:
            self._searches_left -= 1
            self._search(self._limit - now)
        elif self._fits_left and self._take_quickest():
            self._fits_left -= 1
        elif self._bends_left and self._bent < _MOST_BENT and self.plan.path is not None:
            self._bends_left -= 1
            self._bent = min(2 * max(self._bent, 1), _MOST_BENT)
            self._so_far = self.plan
            self._fit(self.plan.path, first_guesses=self._bent)
        elif now < self._until and (self._scenario.zones or self._bent < _MOST_BENT):
            self._begin_round(bends=1)
            self._next()

    def _try_goal(self, time_limit: float) -> bool:
        """Set `need` to a search to the next goal that may be sooner; False where none is left."""
        while self._goals:
            goal = self._goals.pop(0)
            if not _may_be_sooner(self.plan, goal):
                continue
            scene = make_scene(self._scenario, goal)
            if find_barrier(scene) is None and find_joint_barrier(scene, range(scene.gimbals.count)) is None:
                self._tried = goal, scene
                self.need = SearchQuery(scene, replace(self._scenario.search, time_limit=time_limit))
                return True
        if self._tried is not None:
            self._tried = None
            self._begin_round(bends=0)
        return False

    def _search(self, time_limit: float) -> None:
        """Set `need` to another search, of at most `time_limit` s."""
        self._searches += 1
        search = self._scenario.search
        settings = replace(
            search,
            method=METHODS[self._searches % len(METHODS)],
            seed=derived_seed(search.seed, _FIRST_SEED + self._searches),
            time_limit=time_limit,
        )
        self.need = SearchQuery(self._scene, settings)

    def _take_quickest(self) -> bool:
        """Set `need` to a fit along the other way that looks quickest; False where there is none."""
        if self.plan.path is None:
            return False
        longest = _SLOWER * _time_along(self.plan, self.plan.path)
        self._found.sort(key=lambda found: found[0])
        while self._found and self._found[0][0] <= longest:
            _, result = self._found.pop(0)
            if result.path is not None and not any(_is_near(result.path, other) for other in self._fitted):
                self._fitted.append(result.path)
                self._so_far = replace(self.plan, search=result, path=result.path)
                self._fit(result.path, first_guesses=0)
                return True
        return False

    def _fit(self, path: Path, first_guesses: int) -> None:
        """Set `need` to a fit along a path, from a number of bent curves, `first_guesses`."""
        goal = self._so_far.goal
        if goal is None:
            raise RuntimeError("a certified plan has a goal")
        self._rough = first_guesses == 0
        query = wanted_fit(self._scenario, path, goal)
        optimal = query.settings.optimal and not self._rough
        self.need = replace(
            query, settings=replace(query.settings, first_guesses=first_guesses, optimal=optimal)
        )

    def _is_shorter(self, fitted: Fit) -> bool:
        """Whether a fit succeeded and takes less than `_SHORTER` of the shortest plan's duration."""
        if fitted.status is not Status.OK or fitted.trajectory is None or self.plan.trajectory is None:
            return False
        return fitted.trajectory.duration < _SHORTER * self.plan.trajectory.duration
